//! What room there is for jobs on the disk of the service.

use std::path::Path;

use axum::http::StatusCode;

use super::Service;
use super::problem::Problem;

/// Left free for the database and for what others upload meanwhile.
const SPARE_BYTES: u64 = 64 << 20;

/// Refuses a job that writes more than there is room for; it would only fail hours later.
///
/// # Errors
/// `storage-full` with the limit.
pub(super) fn check(service: &Service, bytes: u64) -> Result<(), Problem> {
    free(service).map_or(Ok(()), |free| enough(bytes, free))
}

/// Whether there is no room for any job.
pub(super) fn is_full(service: &Service) -> bool {
    free(service).is_some_and(|free| free < SPARE_BYTES)
}

/// Where the system does not say, nothing is held back.
fn free(service: &Service) -> Option<u64> {
    let disk = rustix::fs::statvfs(service.store.folder().root()).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

/// Bytes of the files below a folder; what goes away meanwhile counts as nothing.
pub(super) fn size(folder: &Path) -> u64 {
    let mut bytes = 0;
    visit(folder, &mut |_, entry| bytes += entry.metadata().map_or(0, |data| data.len()));
    bytes
}

/// How many whole files there are below a folder: all but those that are still being written, whose
/// names begin with a dot. A bake that comes further has more of them.
pub(super) fn whole(folder: &Path) -> u64 {
    let mut count = 0;
    visit(folder, &mut |name, _| count += u64::from(!name.starts_with('.')));
    count
}

fn visit(folder: &Path, see: &mut impl FnMut(&str, &std::fs::DirEntry)) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.filter_map(Result::ok) {
        match entry.file_type() {
            Ok(kind) if kind.is_dir() => visit(&entry.path(), see),
            _ => see(&entry.file_name().to_string_lossy(), &entry),
        }
    }
}

fn enough(bytes: u64, free: u64) -> Result<(), Problem> {
    let most = free.saturating_sub(SPARE_BYTES);
    if bytes <= most {
        return Ok(());
    }
    let detail = format!("the job writes about {bytes} bytes, the disk has room for {most}");
    let status = StatusCode::INSUFFICIENT_STORAGE;
    Err(Problem::new(status, "storage-full", detail).limit("disk_bytes", most))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A job gets no more than what is free less what is spared.
    #[test]
    fn some_room_is_spared() {
        assert!(enough(1000, SPARE_BYTES + 1000).is_ok());
        assert_eq!(
            enough(1001, SPARE_BYTES + 1000).map_err(|problem| problem.status),
            Err(StatusCode::INSUFFICIENT_STORAGE)
        );
        assert!(enough(1, 0).is_err() && enough(0, 0).is_ok());
    }

    /// Files of all depths are counted, and those that are not whole only by their bytes.
    #[test]
    fn a_folder_has_the_size_of_its_files() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::create_dir_all(folder.path().join("a/b")).expect("made");
        for (name, bytes) in [("a/b/c", 10), ("d", 5), (".d.partial", 3), ("a/.part-x", 1)] {
            std::fs::write(folder.path().join(name), vec![0; bytes]).expect("written");
        }
        assert_eq!((size(folder.path()), whole(folder.path())), (19, 2));
        let none = folder.path().join("none");
        assert_eq!((size(&none), whole(&none)), (0, 0));
    }
}
