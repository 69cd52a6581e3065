//! Data sets for those who only hand them from job to job.

use std::path::Path;

use super::Error;
use crate::dataset::{self, Dataset};

/// Opens a data set that is whole; `None` where blocks are missing.
///
/// # Errors
/// What is wrong with it.
pub fn open_dataset(path: &Path) -> Result<Option<Dataset>, Error> {
    let dataset = Dataset::open(path)?;
    Ok(dataset.is_complete().then_some(dataset))
}

/// The folder of references that stand in the way, where that is what went wrong: they are of other
/// settings, and are baked anew where the folder is removed.
#[must_use]
pub fn other_references(error: &Error) -> Option<&Path> {
    match error {
        Error::Dataset(dataset::Error::OtherReferences { path, .. }) => Some(path),
        _ => None,
    }
}
