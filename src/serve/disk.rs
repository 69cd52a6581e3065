//! What room there is for jobs on the disk of the service.

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
    // Where the system does not say, nothing is held back.
    let Ok(disk) = rustix::fs::statvfs(service.store.folder().root()) else { return Ok(()) };
    enough(bytes, disk.f_bavail.saturating_mul(disk.f_frsize))
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
}
