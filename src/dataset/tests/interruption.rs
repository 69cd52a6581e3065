//! Lets a test stop a writer between any two system calls, as a kill would.

use std::cell::Cell;
use std::io;

thread_local! {
    static LEFT: Cell<Option<u32>> = const { Cell::new(None) };
}

/// From now on this thread can make `steps` changes to the disk, and none after that.
pub(super) fn after(steps: Option<u32>) {
    LEFT.set(steps);
}

/// Whether the last allowed change has been made.
pub(in crate::dataset) fn stopped() -> bool {
    LEFT.get() == Some(0)
}

/// Before every change.
pub(in crate::dataset) fn step() -> io::Result<()> {
    match LEFT.get() {
        None => Ok(()),
        Some(0) => Err(io::Error::other("stopped by the test")),
        Some(left) => {
            LEFT.set(Some(left - 1));
            Ok(())
        }
    }
}
