//! Scenes of several files that come as one zip: taken apart into assets, each named by its bytes.
//!
//! *Invariant:* an archive comes from anybody. Entries are counted before they are listed, names
//! stay within their folder, and bytes are counted as they are unpacked, whatever the archive says.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

use axum::http::StatusCode;
use sha2::{Digest, Sha256};
use zip::ZipArchive;
use zip::read::ZipFile;

use super::assets::{bad_asset, too_large};
use super::problem::Problem;
use super::request::{MOST_FILES, is_safe};
use super::room::Place;
use super::store::{self, hexadecimal};
use super::{Service, StoreError};
use crate::pipeline;

/// The record that ends an archive without a comment, and its first bytes (APPNOTE 6.3, §4.3.16).
const END_BYTES: usize = 22;
const END: &[u8] = b"PK\x05\x06";

/// Entries of an archive: folders, and what its maker keeps beside each file, are some too.
const MOST_ENTRIES: u64 = 4 * MOST_FILES as u64;

/// One file of an archive.
struct Part {
    sha256: String,
    bytes: u64,
}

/// Takes an archive apart into assets: name → SHA-256. Every scene in it is imported. What is there
/// already stays, so that to do it again changes nothing.
///
/// # Errors
/// `bad-asset` with the entry at fault, `asset-too-large`, `storage-full`.
pub(super) fn unpack(
    service: &Service,
    archive: &Path,
    folder: &Path,
) -> Result<BTreeMap<String, String>, Problem> {
    let limits = service.settings.limits;
    let parts = extract(archive, folder, limits.asset_bytes)?;
    let mut scenes = 0;
    for name in parts.keys().filter(|name| is_scene(name)) {
        pipeline::import(&folder.join(name)).map_err(|error| {
            let (problem, text) = (bad_asset(&error), name.clone());
            problem.at(text, "it cannot be imported")
        })?;
        scenes += 1;
    }
    if scenes == 0 {
        return Err(bad("it has no .gltf, .glb, .obj or .npz".to_owned()));
    }
    let mut new = 0_u64;
    for part in parts.values() {
        new += if service.store.asset(&part.sha256)?.is_some() { 0 } else { part.bytes };
    }
    let mut place = Place::new(service);
    place.hold(service, new)?;
    for (name, part) in &parts {
        if service.store.asset(&part.sha256)?.is_none() {
            service.store.add_asset(&part.sha256, part.bytes, "file", &folder.join(name))?;
        } else {
            service.store.renew_asset(&part.sha256)?;
        }
    }
    Ok(parts.into_iter().map(|(name, part)| (name, part.sha256)).collect())
}

/// Unpacks into a folder, at most so many bytes.
fn extract(archive: &Path, folder: &Path, most: u64) -> Result<BTreeMap<String, Part>, Problem> {
    let io = |path: &Path| {
        let path = path.to_path_buf();
        move |source| Problem::from(StoreError::Io { action: "unpack", path, source })
    };
    let mut file = File::open(archive).map_err(io(archive))?;
    check_end(&mut file).map_err(bad)?;
    let mut zip = ZipArchive::new(file).map_err(|error| bad(error.to_string()))?;
    let mut parts = BTreeMap::new();
    let mut left = most;
    for index in 0..zip.len() {
        let mut entry = zip.by_index(index).map_err(|error| bad(error.to_string()))?;
        if entry.is_dir() {
            continue;
        }
        let name = name_of(&entry)?;
        if is_of_the_finder(&name) {
            continue;
        }
        if parts.len() == MOST_FILES {
            return Err(bad(format!("it has more than {MOST_FILES} files")));
        }
        let path = folder.join(&name);
        store::create(path.parent().unwrap_or(folder))?;
        // Fails where the name was there before, as itself or as a folder.
        let fresh = File::options().write(true).create_new(true).open(&path);
        let mut out = fresh.map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => bad(format!("`{name}` is in it twice")),
            _ => io(&path)(error),
        })?;
        let part = copy(&mut entry, &mut out, left).map_err(|fault| match fault {
            Fault::Read(error) => bad(format!("`{name}`: {error}")),
            Fault::Write(error) => io(&path)(error),
            Fault::TooLarge => too_large(most),
        })?;
        left -= part.bytes;
        parts.insert(name, part);
    }
    Ok(parts)
}

/// Whether an archive says of itself that it has few entries, before anything is made of them: its
/// last bytes must be the record that says so, and what that lists must lie before it.
fn check_end(file: &mut File) -> Result<(), String> {
    let no_zip = |_| "it is no zip archive".to_owned();
    let back = i64::try_from(END_BYTES).unwrap_or(i64::MAX);
    let at = file.seek(SeekFrom::End(-back)).map_err(no_zip)?;
    let mut end = [0; END_BYTES];
    file.read_exact(&mut end).map_err(no_zip)?;
    file.rewind().map_err(no_zip)?;
    if &end[..4] != END {
        return Err("it is no zip archive, or one with a comment, which is not read".to_owned());
    }
    let short = |at: usize| u64::from(u16::from_le_bytes([end[at], end[at + 1]]));
    let long = |at: usize| short(at) | short(at + 2) << 16;
    let (entries, listed, start) = (short(10), long(12), long(16));
    if entries > MOST_ENTRIES {
        return Err(format!("it has {entries} entries; at most {MOST_ENTRIES} are read"));
    }
    match short(4) == 0 && short(8) == entries && start + listed == at {
        true => Ok(()),
        false => Err("its directory is not where its end says".to_owned()),
    }
}

/// The name of an entry that stays in the folder.
fn name_of<R: Read>(entry: &ZipFile<'_, R>) -> Result<String, Problem> {
    let name = entry.name().map_err(|error| bad(error.to_string()))?.into_owned();
    if entry.is_symlink() || entry.encrypted() {
        return Err(bad(format!("`{name}` is a link or encrypted")));
    }
    if !is_safe(&name) {
        return Err(bad(format!("the name `{}` leaves the archive", name.escape_default())));
    }
    Ok(name)
}

/// Why an entry was not unpacked.
enum Fault {
    Read(io::Error),
    Write(io::Error),
    TooLarge,
}

/// Copies at most so many bytes, with their SHA-256.
fn copy(from: &mut impl Read, to: &mut File, most: u64) -> Result<Part, Fault> {
    let (mut hasher, mut bytes) = (Sha256::new(), 0_u64);
    let mut buffer = vec![0; 64 << 10];
    loop {
        let count = from.read(&mut buffer).map_err(Fault::Read)?;
        if count == 0 {
            to.sync_all().map_err(Fault::Write)?;
            return Ok(Part { sha256: hexadecimal(&hasher.finalize()), bytes });
        }
        bytes += count as u64;
        if bytes > most {
            return Err(Fault::TooLarge);
        }
        hasher.update(&buffer[..count]);
        to.write_all(&buffer[..count]).map_err(Fault::Write)?;
    }
}

/// Whether an entry is what the Finder of macOS puts beside a file of the same name: its attributes
/// (AppleDouble), of the same extension but of another form.
fn is_of_the_finder(name: &str) -> bool {
    let file = name.rsplit('/').next().unwrap_or(name);
    name.starts_with("__MACOSX/") || file.starts_with("._")
}

fn is_scene(name: &str) -> bool {
    let extension = Path::new(name).extension().and_then(|extension| extension.to_str());
    let extension = extension.unwrap_or_default().to_ascii_lowercase();
    ["gltf", "glb", "obj", "npz"].contains(&extension.as_str())
}

fn bad(detail: String) -> Problem {
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "bad-asset", detail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

    /// An archive of these files.
    fn zipped(files: &[(&str, &[u8])]) -> Vec<u8> {
        let mut writer = ZipWriter::new(io::Cursor::new(Vec::new()));
        for (name, bytes) in files {
            writer.start_file(*name, SimpleFileOptions::default()).expect("begun");
            writer.write_all(bytes).expect("written");
        }
        writer.finish().expect("ended").into_inner()
    }

    fn unpacked(bytes: &[u8], most: u64) -> Result<Vec<(String, u64)>, String> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (archive, out) = (folder.path().join("a.zip"), folder.path().join("out"));
        std::fs::write(&archive, bytes).expect("written");
        std::fs::create_dir(&out).expect("made");
        let parts = extract(&archive, &out, most).map_err(|problem| problem.detail().to_owned())?;
        for (name, part) in &parts {
            let bytes = std::fs::read(out.join(name)).expect("unpacked");
            assert_eq!(part.sha256, hexadecimal(&Sha256::digest(&bytes)));
        }
        Ok(parts.into_iter().map(|(name, part)| (name, part.bytes)).collect())
    }

    /// Files come out as they went in, folders and all.
    #[test]
    fn files_come_out() {
        let bytes = zipped(&[("a/b.bin", &[7; 5000]), ("c.gltf", b"{}")]);
        assert_eq!(
            unpacked(&bytes, 5002),
            Ok(vec![("a/b.bin".into(), 5000), ("c.gltf".into(), 2)])
        );
    }

    /// What the Finder of macOS adds to an archive is none of its files, nor one of those that may be
    /// in it.
    #[test]
    fn what_the_finder_adds_is_passed_over() {
        let double = b"\x00\x05\x16\x07";
        let bytes = zipped(&[
            ("hero/hero.gltf", b"{}"),
            ("__MACOSX/hero/._hero.gltf", double),
            ("hero/._hero.gltf", double),
            ("._a.glb", double),
            ("hero/a._b", b"x"),
        ]);
        let files = vec![("hero/a._b".into(), 1), ("hero/hero.gltf".into(), 2)];
        assert_eq!(unpacked(&bytes, 100), Ok(files));
        let names: Vec<String> = (0..MOST_FILES).map(|index| format!("{index}")).collect();
        let doubles: Vec<String> = names.iter().map(|name| format!("__MACOSX/._{name}")).collect();
        let both = names.iter().chain(&doubles).map(|name| (name.as_str(), &b"x"[..]));
        let both: Vec<(&str, &[u8])> = both.collect();
        assert_eq!(unpacked(&zipped(&both), 1000).map(|all| all.len()), Ok(MOST_FILES));
    }

    /// A bomb is cut off at the limit, whether one entry or all together are over it.
    #[test]
    fn bombs_are_cut_off() {
        let zeros = vec![0; 4 << 20];
        let bomb = zipped(&[("a", &zeros)]);
        assert!(bomb.len() < 10_000, "{} bytes", bomb.len());
        assert!(unpacked(&bomb, (4 << 20) - 1).is_err_and(|detail| detail.contains("more than")));
        let two = zipped(&[("a", &zeros[..600]), ("b", &zeros[..600])]);
        assert!(unpacked(&two, 1000).is_err() && unpacked(&two, 1200).is_ok());
    }

    /// Names cannot leave the folder, lie twice in it, or be a file and a folder at once.
    #[test]
    fn names_stay_within() {
        for bad in ["../a", "/etc/a", "a/../../b", "a\\..\\b", "c:a", "a//b"] {
            assert!(unpacked(&zipped(&[(bad, b"x")]), 100).is_err(), "{bad}");
        }
        assert!(unpacked(&zipped(&[("a", b"x"), ("a/b", b"y")]), 100).is_err());
        let mut twice = zipped(&[("aa", b"x"), ("ab", b"y")]);
        for at in 0..twice.len() - 1 {
            if &twice[at..at + 2] == b"ab" {
                twice[at + 1] = b'a';
            }
        }
        assert!(
            unpacked(&twice, 100).is_err() || unpacked(&twice, 100).is_ok_and(|all| all.len() == 1)
        );
    }

    /// Too many entries, every truncation and bytes of no archive are refused, none of them by a
    /// panic.
    #[test]
    fn nonsense_is_refused() {
        let names: Vec<String> = (0..=MOST_ENTRIES).map(|index| format!("{index}")).collect();
        let many: Vec<(&str, &[u8])> = names.iter().map(|name| (name.as_str(), &b""[..])).collect();
        let told = |count: usize| unpacked(&zipped(&many[..count]), 100).expect_err("too many");
        assert!(told(MOST_ENTRIES as usize + 1).contains("entries"));
        assert!(told(MOST_FILES + 1).contains("more than 256 files"));
        assert_eq!(
            unpacked(&zipped(&many[..MOST_FILES]), 100).map(|all| all.len()),
            Ok(MOST_FILES)
        );
        let whole = zipped(&[("a", b"some bytes")]);
        for length in 0..whole.len() {
            assert!(unpacked(&whole[..length], 100).is_err(), "{length}");
        }
        for at in 0..whole.len() {
            let mut other = whole.clone();
            other[at] ^= 0xff;
            drop(unpacked(&other, 100));
        }
        assert!(unpacked(&[b'x'; 100], 100).is_err());
    }
}
