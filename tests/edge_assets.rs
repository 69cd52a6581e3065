//! Every scene among the real assets against a committed table of verdicts.
//!
//! `tests/edge_assets.txt` has one line per file: path, what the official validator says of it,
//! what import says, and why. `POSELIGHT_BLESS=1` rewrites it. The rules that no table may break
//! are tested here: nothing panics or hangs; every rigged character imports; what the validator
//! finds free of errors imports, or the refusal names an unsupported feature, or nothing that has
//! a surface; what it finds broken imports with a stated reason, or is refused with one error.

#![cfg(feature = "bake")]
#![expect(clippy::unwrap_used, reason = "a test that cannot read its input has failed")]

#[path = "needs/assets.rs"]
mod assets;
#[path = "fuzz/invariants.rs"]
mod invariants;

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use poselight::scene::{self, Error, Limits, Scene};

/// Folders of the assets that hold scenes.
const FOLDERS: &[&str] = &["deform", "edge", "rigged", "scene", "static"];

/// Generous: unoptimised builds on a loaded machine.
const MOST_TIME: Duration = Duration::from_secs(20);

/// All scene files below a folder, sorted.
fn scenes(folder: &Path, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let extension = path.extension().unwrap_or_default().to_str().unwrap_or_default();
        if path.is_dir() {
            scenes(&path, out);
        } else if ["glb", "gltf", "obj"].contains(&extension) {
            out.push(path);
        }
    }
}

/// The codes of the official validator's errors (severity 0), sorted; `None` without a report.
fn official(path: &Path) -> Option<Vec<String>> {
    let report = std::fs::read(format!("{}.report.json", path.display())).ok()?;
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    let messages = report["issues"]["messages"].as_array().cloned().unwrap_or_default();
    let errors = messages.iter().filter(|message| message["severity"] == 0);
    let mut codes: Vec<String> =
        errors.map(|message| message["code"].as_str().unwrap_or("?").to_owned()).collect();
    codes.sort();
    codes.dedup();
    Some(codes)
}

/// One line of the table, after checking what must hold of it.
fn line(
    path: &Path,
    name: &str,
    verdict: &Result<Scene, Error>,
    broken: &mut Vec<String>,
) -> String {
    let codes = official(path);
    let judged = match &codes {
        None => "unjudged".to_owned(),
        Some(codes) if codes.is_empty() => "valid".to_owned(),
        Some(codes) => codes.join(" "),
    };
    let valid = codes.as_ref().is_some_and(Vec::is_empty);
    let (verdict, reason) = match verdict {
        Err(refusal) => {
            let unsupported =
                matches!(refusal, Error::Unsupported { .. } | Error::NoTriangles { .. });
            if (valid || name.starts_with("rigged/")) && !unsupported {
                broken.push(format!("{name} must import, but: {refusal}"));
            }
            ("refused".to_owned(), refusal.to_string())
        }
        Ok(scene) => {
            let errors = codes.unwrap_or_default();
            if !errors.is_empty() && scene.notices.is_empty() {
                broken.push(format!("{name} imports without a reason despite {errors:?}"));
            }
            let (mesh, clips) = (&scene.mesh, scene.clips.len());
            let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
            let size_m = scene::size_m(mesh, &scene.skeleton);
            let verdict =
                format!("imports {vertices} v {triangles} t {clips} clips {size_m:.2e} m");
            (verdict, scene.notices.join("; "))
        }
    };
    let reason = if reason.is_empty() { "-" } else { &reason };
    format!("{name} | {judged} | {verdict} | {reason}")
}

/// The table holds, line by line, and so do the rules in this file's head.
#[test]
fn every_asset_has_its_verdict() {
    let Some(assets) = assets::folder() else { return };
    let mut paths = Vec::new();
    FOLDERS.iter().for_each(|folder| scenes(&assets.join(folder), &mut paths));
    let (mut table, mut broken) = (String::new(), Vec::new());
    for path in &paths {
        let name = path.strip_prefix(&assets).unwrap().to_str().unwrap();
        let start = Instant::now();
        let verdict = std::panic::catch_unwind(|| scene::import(path, &Limits::default()));
        let Ok(verdict) = verdict else {
            broken.push(format!("{name} panics"));
            continue;
        };
        if start.elapsed() > MOST_TIME {
            broken.push(format!("{name} takes {:?}", start.elapsed()));
        }
        if let Ok(scene) = &verdict {
            invariants::check(scene);
        }
        writeln!(table, "{}", line(path, name, &verdict, &mut broken)).unwrap();
    }
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/edge_assets.txt");
    if std::env::var_os("POSELIGHT_BLESS").is_some() {
        std::fs::write(&golden, &table).unwrap();
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    let expected = std::fs::read_to_string(&golden).unwrap_or_default();
    for (expected, found) in expected.lines().zip(table.lines()) {
        assert_eq!(expected, found, "verdict changed; POSELIGHT_BLESS=1 accepts it");
    }
    assert_eq!(expected.lines().count(), table.lines().count(), "files came or went");
}
