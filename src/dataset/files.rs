//! Files that are either whole or absent, whatever happens to the process or the machine.
//!
//! A file gets its name by write-to-temporary, fsync, rename, fsync of the folder. A temporary is
//! named `.NAME.partial`, lies beside its target and is removed by the next writer.

use std::borrow::Cow;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Write};
use std::path::Path;

use super::Error;

/// Marks a folder whose creation has begun and not ended.
const CREATING: &str = ".creating.partial";

/// What goes into a file: some bytes, then a repeated pattern.
pub(super) struct Content<'a> {
    pub(super) parts: Vec<Cow<'a, [u8]>>,
    /// Repeated after the parts.
    pub(super) fill: [u8; 4],
    /// Bytes of padding, a multiple of 4.
    pub(super) padding: u64,
}

impl<'a> Content<'a> {
    pub(super) fn of(bytes: impl Into<Cow<'a, [u8]>>) -> Self {
        Self { parts: vec![bytes.into()], fill: [0; 4], padding: 0 }
    }
}

/// Gives `name` in `folder` its content, in one step as seen from outside.
pub(super) fn replace(folder: &Path, name: &str, content: &Content<'_>) -> Result<(), Error> {
    let target = folder.join(name);
    let temporary = folder.join(format!(".{name}.partial"));
    let written =
        write_new(&temporary, content).map_err(Error::io("write", &target)).and_then(|()| {
            step().map_err(Error::io("write", &target))?;
            fs::rename(&temporary, &target).map_err(Error::io("rename a temporary to", &target))
        });
    if written.is_err() && !stopped() {
        // Best effort: what remains, the next writer removes.
        let _ = fs::remove_file(&temporary);
    }
    written?;
    sync_folder(folder)
}

fn write_new(path: &Path, content: &Content<'_>) -> io::Result<()> {
    step()?;
    // `create_new`: should two writers meet where no lock works, one fails and neither is torn.
    let mut file = File::options().write(true).create_new(true).open(path)?;
    for part in &content.parts {
        // In halves, so that tests can stop within a file.
        let (first, second) = part.split_at(part.len() / 2);
        file.write_all(first)?;
        step()?;
        file.write_all(second)?;
    }
    let block = content.fill.repeat(1 << 14);
    let mut left = content.padding;
    while left > 0 {
        let length = left.min(block.len() as u64);
        file.write_all(&block[..length as usize])?;
        left -= length;
    }
    step()?;
    file.sync_all()
}

/// Makes a folder, and those above it, unless it is there.
pub(super) fn create_folder(path: &Path) -> Result<(), Error> {
    if path.is_dir() {
        return Ok(());
    }
    step().map_err(Error::io("create", path))?;
    fs::create_dir_all(path).map_err(Error::io("create", path))?;
    match path.parent() {
        Some(parent) if parent != Path::new("") => sync_folder(parent),
        _ => sync_folder(Path::new(".")),
    }
}

fn sync_folder(path: &Path) -> Result<(), Error> {
    step()
        .and_then(|()| File::open(path))
        .and_then(|folder| folder.sync_all())
        .map_err(Error::io("flush", path))
}

/// Begins a new group in `folder`: removes what an interrupted creation left, refuses a folder
/// with anything else in it, and marks it as being created. `own` names the entries of the format.
/// The group's `zarr.json` and [`remove_temporaries`] end the creation.
pub(super) fn begin_group(folder: &Path, own: &[String]) -> Result<(), Error> {
    let names = entries(folder)?;
    let begun = names.iter().any(|name| name == CREATING);
    let is_own = |name: &str| begun && (own.iter().any(|own| own == name) || is_temporary(name));
    if let Some(entry) = names.iter().find(|name| !is_own(name)) {
        return Err(Error::Occupied { path: folder.to_path_buf(), entry: entry.clone() });
    }
    for name in names.iter().filter(|name| *name != CREATING) {
        let path = folder.join(name);
        step().map_err(Error::io("remove", &path))?;
        let removed =
            if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        removed.map_err(Error::io("remove", &path))?;
    }
    if begun {
        return Ok(());
    }
    let marker = folder.join(CREATING);
    step().and_then(|()| File::create_new(&marker)).map_err(Error::io("create", &marker))?;
    sync_folder(folder)
}

/// Removes every temporary in `folder` (not below it).
pub(super) fn remove_temporaries(folder: &Path) -> Result<(), Error> {
    for name in entries(folder)?.iter().filter(|name| is_temporary(name)) {
        let path = folder.join(name);
        step().and_then(|()| fs::remove_file(&path)).map_err(Error::io("remove", &path))?;
    }
    Ok(())
}

fn is_temporary(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(".partial")
}

/// Names in a folder, ascending.
fn entries(folder: &Path) -> Result<Vec<String>, Error> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(Error::io("list", folder))? {
        let entry = entry.map_err(Error::io("list", folder))?;
        names.push(entry.file_name().to_string_lossy().into_owned());
    }
    names.sort_unstable();
    Ok(names)
}

/// Takes the writer's lock of a folder, which lasts as long as the returned file.
///
/// The lock is advisory (`flock` on the folder itself, so no lock file lies among the arrays) and
/// vanishes with its process. A file system without locks gets a warning in the log instead:
/// whole-file renames still keep two writers of the same recipe from harming one another.
pub(super) fn lock(folder: &Path) -> Result<File, Error> {
    let file = File::open(folder).map_err(Error::io("open", folder))?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            return Err(Error::Locked { path: folder.to_path_buf() });
        }
        Err(TryLockError::Error(source)) => {
            tracing::warn!(
                "no lock on {} ({source}): let only one process write it",
                folder.display()
            );
        }
    }
    Ok(file)
}

/// A metadata file as a whole, if it is no larger than `limit`.
pub(super) fn read_small(path: &Path, limit: u64) -> Result<Vec<u8>, Error> {
    let Some(bytes) = size(path)? else {
        return Err(Error::io("read", path)(io::ErrorKind::NotFound.into()));
    };
    if bytes > limit {
        return Err(Error::TooLarge { path: path.to_path_buf(), bytes, limit });
    }
    let mut content = Vec::new();
    let file = File::open(path).map_err(Error::io("read", path))?;
    // Bounded again: the file may grow between the two calls.
    file.take(limit).read_to_end(&mut content).map_err(Error::io("read", path))?;
    Ok(content)
}

/// Size of a regular file, `None` where nothing is.
pub(super) fn size(path: &Path) -> Result<Option<u64>, Error> {
    match fs::metadata(path) {
        Ok(found) if found.is_file() => Ok(Some(found.len())),
        // A pipe or device in place of a file would block or never end.
        Ok(_) => Err(Error::io("read", path)(io::Error::other("it is not a regular file"))),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Error::io("read", path)(error)),
    }
}

/// Refuses a chunk file of the wrong size; `None` where there is none.
pub(super) fn check_size(path: &Path, expected: u64) -> Result<Option<()>, Error> {
    match size(path)? {
        None => Ok(None),
        Some(found) if found == expected => Ok(Some(())),
        Some(found) => Err(Error::ChunkSize { path: path.to_path_buf(), expected, found }),
    }
}

#[cfg(not(test))]
#[expect(clippy::unnecessary_wraps, reason = "tests make it fail")]
fn step() -> io::Result<()> {
    Ok(())
}

#[cfg(not(test))]
fn stopped() -> bool {
    false
}

#[cfg(test)]
use super::tests::interruption::{step, stopped};
