//! Why the store cannot do what was asked, and whether it may soon.

use std::path::PathBuf;

use super::SCHEMA;

/// Why the store cannot do what was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The database.
    #[error("the service's database: {0}")]
    Sql(#[from] rusqlite::Error),
    /// A file or folder.
    #[error("could not {action} {path}: {source}", path = path.display())]
    Io {
        /// Such as `create`.
        action: &'static str,
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Another process serves this folder.
    #[error("{folder} is served by another process; stop it, or name another folder", folder = .0.display())]
    Taken(PathBuf),
    /// No service was ever in a folder.
    #[error("there is no service in {folder}; name the folder that `serve` has as --data", folder = .0.display())]
    NoService(PathBuf),
    /// A token of this name is in use.
    #[error(
        "there is a token `{0}` already, which its users would lose: choose another name, or \
         --replace it"
    )]
    KnownToken(String),
    /// Another process has taken the folder over.
    #[error("another process has taken over this folder; this one stops writing to it")]
    Fenced,
    /// The database is not whole.
    #[error(
        "the service's database is damaged: {said}; move poselight.db, poselight.db-wal and \
         poselight.db-shm away and put a copy of poselight.db in their place, and the service begins; \
         to begin without jobs, move them away and restart it"
    )]
    Damaged {
        /// What the database says of it.
        said: String,
    },
    /// The database is gone, while what it had named is there.
    #[error(
        "there is no poselight.db in {folder} any more, but jobs, models or data sets that it named: \
         put a copy of it there, and the service begins; to begin without them, restart it",
        folder = .0.display()
    )]
    Gone(PathBuf),
    /// Written by a later version.
    #[error("the database has version {found}, this build reads {SCHEMA}; use a later build")]
    Newer {
        /// Its version.
        found: i64,
    },
}

impl Error {
    /// Whether a disk that takes no writes is the reason, full ones excepted.
    pub(in crate::serve) fn takes_no_writes(&self) -> bool {
        use rusqlite::ErrorCode::{CannotOpen, PermissionDenied, ReadOnly, SystemIoFailure};
        match self {
            Self::Io { action: "read" | "list", .. } => false,
            Self::Io { source, .. } => source.kind() != std::io::ErrorKind::NotFound,
            Self::Sql(error) => error.sqlite_error_code().is_some_and(|code| {
                matches!(code, CannotOpen | PermissionDenied | ReadOnly | SystemIoFailure)
            }),
            _ => false,
        }
    }

    /// Whether the state of disk or database is the reason, which may be mended while the service
    /// waits; else it is how the service was started.
    pub(in crate::serve) fn is_of_the_disk(&self) -> bool {
        use rusqlite::ErrorCode::{
            CannotOpen, DatabaseCorrupt, DiskFull, NotADatabase, ReadOnly, SystemIoFailure,
        };
        match self {
            Self::Damaged { .. } | Self::Gone(_) | Self::Io { .. } => true,
            Self::Sql(error) => error.sqlite_error_code().is_some_and(|code| {
                matches!(
                    code,
                    CannotOpen
                        | DatabaseCorrupt
                        | DiskFull
                        | NotADatabase
                        | ReadOnly
                        | SystemIoFailure
                )
            }),
            _ => false,
        }
    }
}
