//! Where the service's files are, and who may use them.

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io::{Read, Write};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use rustix::fs::Access;

use super::{DATABASE, Error, random_id};

/// The parts of the service's folder.
const PARTS: [&str; 6] = ["assets", "incoming", "jobs", "work", "models", "results"];

/// The service's folder.
#[derive(Debug, Clone)]
pub(in crate::serve) struct Folder {
    root: PathBuf,
}

impl Folder {
    /// The folder with its parts, made where they are missing.
    pub(super) fn create(root: &Path) -> Result<Self, Error> {
        let folder = Self { root: root.to_path_buf() };
        for part in PARTS {
            create(&folder.root.join(part))?;
        }
        Ok(folder)
    }

    /// The lock that says who serves the folder.
    pub(super) fn lease(&self) -> Result<File, Error> {
        let path = self.root.join("lock");
        let io = |source| Error::Io { action: "lock", path: path.clone(), source };
        let file = File::options().create(true).truncate(false).write(true).open(&path);
        let file = file.map_err(io)?;
        match file.try_lock() {
            Ok(()) => Ok(file),
            Err(TryLockError::WouldBlock) => Err(Error::Taken(self.root.clone())),
            Err(TryLockError::Error(source)) => Err(io(source)),
        }
    }

    /// Tries whether every part takes a file: nothing is left of it.
    ///
    /// # Errors
    /// [`Error::Io`] of the first part that takes none.
    pub(in crate::serve) fn probe(&self) -> Result<(), Error> {
        PARTS.iter().try_for_each(|part| {
            let path = self.root.join(part);
            // Without a name where the system can: no listing ever shows it.
            let tried = tempfile::tempfile_in(&path).and_then(|mut file| file.write_all(b"?"));
            tried.map_err(|source| Error::Io { action: "write to", path, source })
        })
    }

    /// Removes what a process that was killed left half done, and data sets that are no job's.
    pub(super) fn sweep(
        &self,
        jobs: &BTreeSet<String>,
        bakes: &BTreeSet<String>,
    ) -> Result<(), Error> {
        for entry in list(&self.root.join("incoming"))? {
            remove(&entry)?;
        }
        // A database without jobs may have taken the place of one that will be mended and put back:
        // what took hours is not thrown away for that.
        if jobs.is_empty() {
            return Ok(());
        }
        self.keep("jobs", jobs)?;
        self.keep("results", jobs)?;
        self.keep("work", bakes)
    }

    /// Removes all but these of a part.
    fn keep(&self, part: &str, names: &BTreeSet<String>) -> Result<(), Error> {
        for entry in list(&self.root.join(part))? {
            let name = entry.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if !names.contains(&name) {
                remove(&entry)?;
            }
        }
        Ok(())
    }

    /// All of it is below this.
    pub(in crate::serve) fn root(&self) -> &Path {
        &self.root
    }

    pub(super) fn database(&self) -> PathBuf {
        self.root.join(DATABASE)
    }

    /// An asset's file; `sha256` has been checked to be hexadecimal digits.
    pub(in crate::serve) fn asset(&self, sha256: &str) -> PathBuf {
        self.root.join("assets").join(&sha256[..2]).join(sha256)
    }

    /// A job's scene, as the recipe names its files.
    pub(in crate::serve) fn sources(&self, job: &str) -> PathBuf {
        self.root.join("jobs").join(job)
    }

    /// What a job made beside a model, by name.
    pub(in crate::serve) fn results(&self, job: &str) -> PathBuf {
        self.root.join("results").join(job)
    }

    /// Where jobs of one bake work; a later job of the same bake finds its data set there.
    pub(in crate::serve) fn work(&self, bake: &str) -> PathBuf {
        self.root.join("work").join(bake)
    }

    /// A finished model with its report and figures.
    pub(in crate::serve) fn model(&self, id: &str) -> PathBuf {
        self.root.join("models").join(id)
    }

    /// A new folder for what is not yet whole; removed when dropped.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(in crate::serve) fn incoming(&self) -> Result<Incoming, Error> {
        let path = self.root.join("incoming").join(random_id()?);
        create(&path)?;
        Ok(Incoming { path })
    }
}

/// A folder of something that is not yet whole.
#[derive(Debug)]
pub(in crate::serve) struct Incoming {
    path: PathBuf,
}

impl Incoming {
    /// Where it is.
    pub(in crate::serve) fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Incoming {
    fn drop(&mut self) {
        // What cannot be removed now goes at the next start.
        let _ = fs::remove_dir_all(&self.path);
    }
}

/// Where the process that serves a folder listens, if one does and has said so.
pub(super) fn served_at(root: &Path) -> Option<SocketAddr> {
    let mut file = File::open(root.join("lock")).ok()?;
    if !matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)) {
        return None;
    }
    let mut text = String::new();
    file.read_to_string(&mut text).ok()?;
    text.trim().parse().ok()
}

/// Whether a folder has what only its database can name: jobs, data sets, models, results.
pub(super) fn is_filled(root: &Path) -> bool {
    let of_the_database = PARTS.iter().filter(|part| **part != "incoming");
    of_the_database
        .into_iter()
        .any(|part| fs::read_dir(root.join(part)).is_ok_and(|mut entries| entries.next().is_some()))
}

/// Whether a folder can be written, or made where there is none; nothing is.
///
/// # Errors
/// [`Error::Io`].
pub(super) fn check_writable(path: &Path) -> Result<(), Error> {
    let absolute = std::path::absolute(path);
    let absolute = absolute.unwrap_or_else(|_| path.to_path_buf());
    let there = absolute.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("/"));
    let may = match there.is_dir() {
        true => rustix::fs::access(there, Access::WRITE_OK | Access::EXEC_OK),
        false => Err(rustix::io::Errno::NOTDIR),
    };
    let action = if there == absolute { "write to" } else { "create" };
    let io = |source| Error::Io { action, path: path.to_path_buf(), source };
    may.map_err(|error| io(error.into()))
}

/// Moves a whole file or folder to its name, and makes sure that the name stays.
///
/// # Errors
/// [`Error::Io`].
pub(in crate::serve) fn settle(from: &Path, to: &Path) -> Result<(), Error> {
    let io = |source| Error::Io { action: "keep", path: to.to_path_buf(), source };
    let folder = to.parent().unwrap_or(Path::new("."));
    create(folder)?;
    fs::rename(from, to).map_err(io)?;
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(io)
}

/// A folder and those above it.
///
/// # Errors
/// [`Error::Io`].
pub(in crate::serve) fn create(path: &Path) -> Result<(), Error> {
    let io = |source| Error::Io { action: "create", path: path.to_path_buf(), source };
    fs::create_dir_all(path).map_err(io)
}

/// Removes a file or a folder; nothing there is as good.
///
/// # Errors
/// [`Error::Io`].
pub(in crate::serve) fn remove(path: &Path) -> Result<(), Error> {
    let done = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    match done {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(Error::Io { action: "remove", path: path.to_path_buf(), source })
        }
        _ => Ok(()),
    }
}

/// What is in a folder.
///
/// # Errors
/// [`Error::Io`].
pub(in crate::serve) fn list(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let io = |source| Error::Io { action: "list", path: folder.to_path_buf(), source };
    let entries = fs::read_dir(folder).map_err(io)?;
    entries.map(|entry| Ok(entry.map_err(io)?.path())).collect()
}
