//! The folder of real scenes, which is not part of the repository: tests that need it say so and
//! skip where it is absent, in continuous integration too.

use std::io::Write;
use std::path::{Path, PathBuf};

/// The folder that POSELIGHT_ASSETS names, or `shared/assets` beside the repository.
pub(super) fn folder() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/assets");
    let named = std::env::var_os("POSELIGHT_ASSETS").map(PathBuf::from);
    let found = named.into_iter().chain([beside]).find(|at| at.join("MANIFEST.md").is_file());
    if found.is_none() {
        // Not by `eprintln!`, which the test harness keeps to itself while tests pass.
        let _ = writeln!(
            std::io::stderr(),
            "skipped: {} needs the folder of scenes that POSELIGHT_ASSETS names",
            env!("CARGO_CRATE_NAME")
        );
    }
    found
}
