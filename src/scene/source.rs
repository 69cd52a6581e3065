//! Reading files: bounded, and only from the main file's own folder.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::{Error, Limits, uri};

/// Reads a regular file of at most [`Limits::file_bytes`].
pub(super) fn read(path: &Path, limits: &Limits) -> Result<Vec<u8>, Error> {
    let io = |source| Error::Io { path: path.to_owned(), source };
    // Asked before opening: opening a pipe waits for its other end.
    if !std::fs::metadata(path).map_err(io)?.is_file() {
        return Err(Error::NotAFile { path: path.to_owned() });
    }
    let file = File::open(path).map_err(io)?;
    let mut bytes = Vec::new();
    file.take(limits.file_bytes.saturating_add(1)).read_to_end(&mut bytes).map_err(io)?;
    check_size(&path.display().to_string(), bytes.len() as u64, limits)?;
    Ok(bytes)
}

/// Refuses a file over [`Limits::file_bytes`].
pub(super) fn check_size(file: &str, found: u64, limits: &Limits) -> Result<(), Error> {
    let most = limits.file_bytes;
    if found <= most {
        return Ok(());
    }
    Err(Error::Limit { place: file.to_owned(), what: "bytes", limit: "file_bytes", found, most })
}

/// Turns a URI into a name below the main file's folder, or says why it is none.
///
/// Refused are schemes, absolute paths, `..`, backslashes and NUL: a scene reads what lies beside
/// it and nothing else.
pub(super) fn relative_name(uri: &str) -> Result<String, String> {
    let shown: String = uri.chars().take(80).collect();
    let name = String::from_utf8(uri::decode_percent(uri)?)
        .map_err(|_| format!("the uri {shown:?} is not UTF-8"))?;
    let first = name.split('/').next().unwrap_or_default();
    if first.contains(':') {
        return Err(format!(
            "the uri {shown:?} has a scheme; only files beside the scene are read"
        ));
    }
    let parts: Vec<&str> = name.split('/').filter(|&part| part != ".").collect();
    let outside = |part: &&str| part.is_empty() || *part == ".." || part.contains(['\\', '\0']);
    if parts.is_empty() || parts.iter().any(outside) {
        return Err(format!("the uri {shown:?} does not name a file in the scene's own folder"));
    }
    Ok(parts.join("/"))
}

/// Reads a file below `folder`, also after every symbolic link is followed. A refusal names the
/// file as the scene does.
pub(super) fn read_below(folder: &Path, name: &str, limits: &Limits) -> Result<Vec<u8>, String> {
    let io = |source: std::io::Error| format!("cannot read {name:?} beside the scene: {source}");
    let real_folder = folder.canonicalize().map_err(io)?;
    let real = folder.join(name).canonicalize().map_err(io)?;
    if !real.starts_with(&real_folder) {
        return Err(format!("{name:?} is a link out of the scene's own folder"));
    }
    read(&real, limits).map_err(|refusal| match refusal {
        Error::Io { source, .. } => io(source),
        Error::NotAFile { .. } => format!("{name:?} is not a regular file"),
        Error::Limit { limit, found, most, .. } => {
            format!("{name:?} has {found} bytes or more; the limit `{limit}` is {most}")
        }
        other => other.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names stay below the folder, whatever the URI tries.
    #[test]
    fn uris_cannot_leave_the_folder() {
        assert_eq!(relative_name("a.bin").unwrap(), "a.bin");
        assert_eq!(relative_name("./sub%20dir/a.bin").unwrap(), "sub dir/a.bin");
        for bad in [
            "",
            ".",
            "/etc/passwd",
            "../a.bin",
            "a/../../b",
            "%2e%2e/a",
            "a//b",
            "http://x/y",
            "file:///etc/passwd",
            "C:\\a",
            "c:/a",
            "a\\b",
            "a%00",
            "sub/",
            "%ff",
        ] {
            assert!(relative_name(bad).is_err(), "{bad}");
        }
    }

    /// Links inside the folder are followed, links out of it refused; so are folders and files
    /// over the limit.
    #[test]
    #[cfg(unix)]
    fn files_are_read_only_below_the_folder() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("scene");
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(root.path().join("secret"), b"no").unwrap();
        std::fs::write(folder.join("a.bin"), b"yes").unwrap();
        std::os::unix::fs::symlink(root.path().join("secret"), folder.join("out")).unwrap();
        std::os::unix::fs::symlink("a.bin", folder.join("in")).unwrap();
        let limits = Limits { file_bytes: 3, ..Limits::default() };
        assert_eq!(read_below(&folder, "in", &limits).unwrap(), b"yes");
        assert!(read_below(&folder, "out", &limits).unwrap_err().contains("link out of"));
        assert!(read_below(&folder, "none", &limits).unwrap_err().contains("cannot read"));
        assert!(matches!(read(&folder, &limits), Err(Error::NotAFile { .. })));
        let small = Limits { file_bytes: 2, ..limits };
        assert!(matches!(read(&folder.join("a.bin"), &small), Err(Error::Limit { found: 3, .. })));
        assert!(read_below(&folder, "a.bin", &small).unwrap_err().contains("`file_bytes` is 2"));
    }
}
