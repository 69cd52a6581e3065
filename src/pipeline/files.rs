//! Files that appear whole or not at all.

use std::fs;
use std::io::Write;
use std::path::Path;

use super::Error;

/// Writes `bytes` under the final name only when all of them are safely on disk.
///
/// # Errors
/// [`Error::File`] naming the file and what the system said; the old file, if any, stands.
pub fn publish(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let failed = |source| Error::File { action: "write", path: path.to_path_buf(), source };
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    fs::create_dir_all(folder).map_err(failed)?;
    let file = tempfile::Builder::new().prefix(".part-").tempfile_in(folder);
    // Said of the file that was asked for, not of the temporary one.
    let mut file = file.map_err(|error| failed(std::io::Error::from(error.kind())))?;
    file.write_all(bytes).map_err(failed)?;
    file.as_file().sync_all().map_err(failed)?;
    readable_by_all(file.as_file()).map_err(failed)?;
    file.persist(path).map_err(|error| failed(error.error))?;
    fs::File::open(folder).and_then(|folder| folder.sync_all()).map_err(failed)
}

/// Makes a folder that results will go to, and tries to write there: better said before the work than after it.
///
/// # Errors
/// [`Error::File`] naming the folder and what the system said.
pub fn prepare_folder(folder: &Path) -> Result<(), Error> {
    let failed = |source| Error::File { action: "write to", path: folder.to_path_buf(), source };
    fs::create_dir_all(folder).map_err(failed)?;
    let tried = tempfile::Builder::new().prefix(".part-").tempfile_in(folder);
    tried.map(drop).map_err(|error| failed(std::io::Error::from(error.kind())))
}

/// Temporary files begin private; a result is an ordinary file.
fn readable_by_all(file: &fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(fs::Permissions::from_mode(0o644))
}

/// Reads a whole file of at most `limit` bytes.
///
/// # Errors
/// [`Error::File`] naming the file and what is wrong with it.
pub fn read(path: &Path, limit: u64) -> Result<Vec<u8>, Error> {
    use std::io::Read;
    let failed = |source| Error::File { action: "read", path: path.to_path_buf(), source };
    let file = fs::File::open(path).map_err(failed)?;
    let mut bytes = Vec::new();
    file.take(limit + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > limit {
        let message = format!("it has more than the {limit} bytes allowed");
        return Err(failed(std::io::Error::other(message)));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file is replaced whole, its folder is made, and no temporary stays behind.
    #[test]
    fn publishing_replaces_whole_files() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("new/model");
        publish(&path, b"first").expect("written");
        publish(&path, b"second").expect("written");
        assert_eq!(read(&path, 6).expect("read"), b"second");
        assert!(read(&path, 5).is_err());
        assert_eq!(fs::read_dir(folder.path().join("new")).expect("listed").count(), 1);
    }

    /// Where nothing can be written the error names the file, and no panic comes.
    #[test]
    fn an_impossible_place_is_named() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let blocker = folder.path().join("file");
        fs::write(&blocker, b"").expect("written");
        let error = publish(&blocker.join("model"), b"x").expect_err("a file is no folder");
        assert!(error.to_string().contains("file/model"), "{error}");
        let error = publish(Path::new("/proc/model"), b"x").expect_err("no place for files");
        let told = error.to_string();
        assert!(told.contains("/proc/model: ") && !told.contains(".part-"), "{told}");
    }

    /// A folder that will be written to is made, nothing is left in it, and one that cannot be is named.
    #[test]
    fn a_folder_is_tried_beforehand() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let new = folder.path().join("a/b");
        prepare_folder(&new).expect("made");
        assert_eq!(fs::read_dir(&new).expect("listed").count(), 0);
        for closed in [Path::new("/proc"), &folder.path().join("a/b/../file")] {
            fs::write(folder.path().join("a/file"), b"").expect("written");
            let told = prepare_folder(closed).expect_err("no place for files").to_string();
            assert!(told.contains(&format!("{}: ", closed.display())), "{told}");
        }
    }
}
