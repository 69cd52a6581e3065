//! A Python interpreter for tests that compare with other people's code. `make test` brings it; a
//! run without it says so and skips, except where `CI` is set: there it fails.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The interpreter that POSELIGHT_PYTHON names, else that of `.venv` or of the system, if it can
/// import the modules, which are separated by commas.
pub(super) fn with(modules: &str) -> Option<PathBuf> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join(".venv/bin/python");
    let named = std::env::var_os("POSELIGHT_PYTHON").map(|named| vec![PathBuf::from(named)]);
    let pythons = named.unwrap_or_else(|| vec![own, "python3".into()]);
    let import = format!("import {modules}");
    let has = |python: &&PathBuf| {
        let output = Command::new(python).args(["-c", import.as_str()]).output();
        output.is_ok_and(|output| output.status.success())
    };
    if let Some(python) = pythons.iter().find(has) {
        return Some(python.clone());
    }
    let lack = format!("no Python of {pythons:?} can {import}; make test brings one");
    assert!(std::env::var_os("CI").is_none(), "{lack}");
    // Not by `eprintln!`, which the test harness keeps to itself while tests pass.
    let _ = writeln!(std::io::stderr(), "skipped {}: {lack}", env!("CARGO_CRATE_NAME"));
    None
}
