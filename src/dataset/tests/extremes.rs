//! Full disks, folders that cannot be written, two writers at once, a process that is killed.

use std::fs;
use std::process::Command;

use super::*;

/// Large enough that `coefficients` alone exceeds the file size that [`limited`] allows.
const LARGE: Layout = Layout { points: 4000, vertices: 4000, ..LAYOUT };

/// The child's part of the tests below: bakes into the folder that the environment names.
#[test]
#[ignore = "a child process of the tests of full disks and kills"]
fn child() {
    let Some(path) = std::env::var_os("POSELIGHT_TEST_BAKE") else { return };
    if let Err(error) = bake(Path::new(&path), LARGE) {
        eprintln!("error: {error}");
        std::process::exit(3);
    }
}

/// Runs [`child`] on `path` under a shell that lets no file grow beyond 160 × 512 (or 1024) bytes.
/// With `fails` a longer write is an error as on a full disk; else it kills the process.
fn limited(path: &Path, fails: bool) -> std::process::Output {
    let trap = if fails { "trap '' 25; " } else { "" };
    Command::new("sh")
        .arg("-c")
        .arg(format!("{trap}ulimit -c 0; ulimit -f 160; exec \"$0\" \"$@\""))
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", "dataset::tests::extremes::child", "--ignored", "--nocapture"])
        .env("POSELIGHT_TEST_BAKE", path)
        .output()
        .unwrap()
}

/// When a write fails midway, the error names the file and the system's reason, no file has its
/// final name half-written, no temporary stays, and the bake continues once there is room.
#[test]
fn full_disk() {
    let (place, whole) = (folder(), folder());
    let path = place.path().join("set");
    let output = limited(&path, true);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{text}");
    assert!(text.contains("cannot write") && text.contains("coefficients/c.0.0.0.0"), "{text}");
    assert!(text.contains("os error 27"), "{text}");
    let files = tree(&path);
    assert!(!files.contains_key("coefficients/c.0.0.0.0"));
    assert!(files.keys().all(|name| !name.contains("partial")), "{:?}", files.keys());
    assert_eq!(Dataset::open(&path).unwrap().missing_blocks(), [0, 1, 2]);
    bake(&path, LARGE).unwrap();
    bake(whole.path(), LARGE).unwrap();
    assert!(tree(&path) == tree(whole.path()), "bytes differ");
}

/// A process killed by the kernel in the middle of a write leaves a temporary, which the next
/// writer removes, and the bytes come out the same.
#[test]
fn killed_within_a_write() {
    let (place, whole) = (folder(), folder());
    let path = place.path().join("set");
    let output = limited(&path, false);
    assert_eq!(output.status.code(), None, "{}", String::from_utf8_lossy(&output.stderr));
    assert!(tree(&path).contains_key("coefficients/.c.0.0.0.0.partial"));
    assert_eq!(Dataset::open(&path).unwrap().missing_blocks(), [0, 1, 2]);
    bake(&path, LARGE).unwrap();
    bake(whole.path(), LARGE).unwrap();
    assert!(tree(&path) == tree(whole.path()), "bytes differ");
}

/// Places where nothing can be written, for root too: the error names the path.
#[test]
fn nowhere_to_write() {
    let place = folder();
    let file = place.path().join("file");
    fs::write(&file, "x").unwrap();
    for path in [Path::new("/proc/self/poselight"), &file, &file.join("set")] {
        let error = bake(path, LAYOUT).unwrap_err();
        assert!(matches!(error, Error::Io { .. }), "{error}");
        assert!(error.to_string().contains(&path.display().to_string()), "{error}");
    }
    assert_eq!(fs::read(&file).unwrap(), b"x");
    // A file where an array's folder should be.
    let set = place.path().join("set");
    bake(&set, LAYOUT).unwrap();
    fs::remove_dir_all(set.join("noise")).unwrap();
    fs::write(set.join("noise"), "x").unwrap();
    let error = bake(&set, LAYOUT).unwrap_err();
    assert!(error.to_string().contains("noise"), "{error}");
}

/// A folder with foreign files is never taken over, even where it has arrays of our names.
#[test]
fn occupied_folder() {
    let place = folder();
    fs::create_dir(place.path().join("source")).unwrap();
    fs::write(place.path().join("source/precious.txt"), "x").unwrap();
    let error = bake(place.path(), LAYOUT).unwrap_err();
    assert!(matches!(&error, Error::Occupied { entry, .. } if entry == "source"), "{error}");
    assert_eq!(tree(place.path()).len(), 1);
    assert!(matches!(Dataset::open(place.path()).unwrap_err(), Error::NotADataset { .. }));
    let none = place.path().join("none");
    assert!(matches!(Dataset::open(&none).unwrap_err(), Error::NotADataset { .. }));
}

/// The second of two writers is told; once the first is gone it may go on. Readers never wait.
#[test]
fn two_writers() {
    let place = folder();
    let first = Writer::open(place.path(), &header(LAYOUT), &statics(&LAYOUT)).unwrap();
    let error = bake(place.path(), LAYOUT).unwrap_err();
    assert!(matches!(error, Error::Locked { .. }), "{error}");
    assert!(!Dataset::open(place.path()).unwrap().is_complete());
    drop(first);
    bake(place.path(), LAYOUT).unwrap();
}
