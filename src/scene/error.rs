//! Why a file is refused.

use std::path::PathBuf;

/// One reason, with the place in the file and the fault.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A feature that this importer does not have.
    #[error("{place} needs {feature}, which is not supported")]
    Unsupported {
        /// The feature by name, such as an extension.
        feature: String,
        /// Where the file asks for it.
        place: String,
    },
    /// A file cannot be read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// Which file.
        path: PathBuf,
        /// What the operating system says.
        source: std::io::Error,
    },
}
