//! Proves that a machine without Embree is told so in one sentence with the command that mends it: the
//! build script's own search and sentence, compiled into this test.

#[path = "../build.rs"]
#[expect(
    dead_code,
    clippy::print_stdout,
    reason = "the script's main and its linking run when the crate is built, and talk to cargo"
)]
mod script;

use std::fs;

/// A folder is taken where it, or its `lib`, holds the library; without one the sentence names the
/// command, and a folder that was named in vain.
#[test]
fn a_machine_without_embree_is_told_what_to_do() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (root, named) = (folder.path(), Some(folder.path()));
    assert_eq!(script::find(root, named), None);
    let sentence = script::not_found(named);
    let shown = root.display().to_string();
    assert!(sentence.contains("make setup") && sentence.contains(&shown), "{sentence}");
    assert!(script::not_found(None).contains("run `make setup`"));
    let library = root.join("lib");
    fs::create_dir(&library).expect("made");
    fs::write(library.join("libembree4.so.4"), b"").expect("written");
    assert_eq!(script::find(root, named), Some(library));
    let set_up = root.join(".embree/lib");
    fs::create_dir_all(&set_up).expect("made");
    fs::write(set_up.join("libembree4.so"), b"").expect("written");
    assert_eq!(script::find(root, None), Some(set_up));
}
