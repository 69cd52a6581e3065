//! Rebinding to what exporters write: `gltfpack` and `gltf-transform` (npm packages `gltfpack` and
//! `@gltf-transform/cli`), where they are on the path (`npm install --global gltfpack
//! @gltf-transform/cli`); a run without them skips and says so.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Output};

/// How each tool is called on `hero.glb`.
const TOOLS: [(&str, &[&str]); 3] = [
    ("gltfpack", &["-i", "hero.glb", "-o", "again.glb", "-kn"]),
    ("gltf-transform", &["weld", "hero.glb", "again.glb"]),
    ("gltf-transform", &["reorder", "hero.glb", "again.glb"]),
];

fn poselight(folder: &Path, words: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_poselight"));
    command.current_dir(folder).args(words).output().expect("the program runs")
}

fn succeeds(folder: &Path, words: &[&str]) -> String {
    let output = poselight(folder, words);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{words:?}: {told}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Proves that every vertex of what a tool writes (re-ordered, merged, quantised) finds its point,
/// and that the model then evaluates on that file.
#[test]
fn tools_lose_no_vertex() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let mut model_is_made = false;
    for (tool, words) in TOOLS {
        let there = Command::new(tool).arg("--version").output().is_ok();
        if !there {
            // Not by `eprintln!`, which the test harness keeps to itself while tests pass.
            let lack = format!("skipped rebind_tools: there is no {tool} on the path");
            let _ = writeln!(std::io::stderr(), "{lack}; npm has it");
            continue;
        }
        if !model_is_made {
            succeeds(folder, &["sample", "figure", "-o", "hero.glb"]);
            let bake = "bake hero.glb -o hero.zarr --signal ao --rays 4 --fps 2 --clip wave";
            succeeds(folder, &bake.split(' ').collect::<Vec<_>>());
            let fit = "fit hero.zarr -o hero.safetensors --family mean --unshadowed --include-rest";
            succeeds(folder, &fit.split(' ').collect::<Vec<_>>());
            model_is_made = true;
        }
        let done = Command::new(tool).current_dir(folder).args(words).output().expect("it runs");
        assert!(done.status.success(), "{tool} {words:?}: {done:?}");
        let rebind =
            "--json rebind hero.safetensors again.glb --original hero.glb -o again.safetensors";
        let told = succeeds(folder, &rebind.split(' ').collect::<Vec<_>>());
        let told: serde_json::Value = serde_json::from_str(&told).expect("JSON");
        assert_eq!((&told["unmatched"], &told["unused_points"]), (&0.into(), &0.into()), "{told}");
        let evaluate = "evaluate again.safetensors --scene again.glb --clip wave -o again.npy";
        succeeds(folder, &evaluate.split(' ').collect::<Vec<_>>());
    }
}
