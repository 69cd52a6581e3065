//! Proves that import, clip evaluation, forward kinematics, morphing and skinning together put the
//! vertices of real characters where an independent Python script (`skinning_oracle.py`, float64,
//! no shared code) puts them: positions to 1e-5 of the model's size, normals to 1e-5.

#![cfg(feature = "bake")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test")]

#[path = "needs/assets.rs"]
mod assets;
#[path = "needs/python.rs"]
mod python;

use std::path::{Path, PathBuf};
use std::process::Command;

use glam::DVec3;
use poselight::pose::evaluate;
use poselight::rig::{Deformed, Pose, RigidFrame, deform};
use poselight::scene::{Clip, Limits, Scene, import, size_m};

/// Characters, and the clips that are compared.
const CHARACTERS: [(&str, &[usize]); 7] = [
    ("rigged/CesiumMan.glb", &[0]),
    ("rigged/Fox.glb", &[1, 2]),
    ("rigged/Robot_Quaternius.glb", &[0, 5]),
    ("rigged/MH_Male_CMU02.glb", &[2]),
    ("rigged/KayKit_Knight.glb", &[6, 44]),
    ("rigged/M2M_Dragon.glb", &[0, 2]),
    ("deform/AnimatedMorphSphere.glb", &[0]),
];

/// Folders of small files below `edge/` of which every clip is compared, the rest pose where there
/// is none: steps, splines, integer keys, mirrored and unevenly scaled nodes, shared and odd skins.
const FOLDERS: [&str; 9] = [
    "asset_generator/Positive/Animation_Node",
    "asset_generator/Positive/Animation_NodeMisc",
    "asset_generator/Positive/Animation_SamplerType",
    "asset_generator/Positive/Animation_Skin",
    "asset_generator/Positive/Animation_SkinType",
    "asset_generator/Positive/Node_Attribute",
    "asset_generator/Positive/Node_NegativeScale",
    "blender_io/roundtrip/01_cs_scale",
    "blender_io/roundtrip/03_skinned_cylinder",
];

/// Parts of a clip's length; beyond its end it stands still.
const INSTANTS: [f32; 3] = [0.0, 0.437, 0.891];

const POSITION_TOLERANCE: f64 = 1e-5;
const NORMAL_TOLERANCE: f64 = 1e-5;

/// Without a normal where the matrix is singular.
type Vertex = (DVec3, Option<DVec3>);

#[test]
fn agrees_on_characters() {
    let Some((assets, python)) = ready() else { return };
    for (name, clips) in CHARACTERS {
        compare(&python, &assets.join(name), Some(clips));
    }
}

#[test]
fn agrees_on_awkward_files() {
    let Some((assets, python)) = ready() else { return };
    for folder in FOLDERS {
        let entries = std::fs::read_dir(assets.join("edge").join(folder)).unwrap();
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        files.retain(|path| path.extension().is_some_and(|extension| extension == "gltf"));
        files.sort();
        assert!(!files.is_empty(), "{folder} holds files");
        for file in files {
            compare(&python, &file, None);
        }
    }
}

/// Compares some clips of a file, or all.
fn compare(python: &Path, path: &Path, clips: Option<&[usize]>) {
    let scene = import(path, &Limits::default()).unwrap();
    let all: Vec<Option<usize>> = (0..scene.clips.len()).map(Some).collect();
    let clips = match clips {
        Some(some) => some.iter().copied().map(Some).collect(),
        None if all.is_empty() => vec![None],
        None => all,
    };
    for clip in clips {
        let clip = clip.map(|index| (index, &scene.clips[index]));
        let duration_s = clip.map_or(0.0, |(_, clip)| clip.duration_s);
        let mut times: Vec<f32> = INSTANTS.iter().map(|part| part * duration_s).collect();
        times.dedup();
        let name = clip.map_or("rest".to_owned(), |(index, _)| index.to_string());
        let expected = oracle(python, path, &name, &times);
        for (&time_s, expected) in times.iter().zip(&expected) {
            let (position, normal) = worst(&scene, clip.map(|(_, clip)| clip), time_s, expected);
            println!(
                "{} clip {name} at {time_s:.3} s: position {position:.1e}, normal {normal:.1e}",
                path.file_name().unwrap().display(),
            );
            assert!(position < POSITION_TOLERANCE, "positions of {} differ", path.display());
            assert!(normal < NORMAL_TOLERANCE, "normals of {} differ", path.display());
        }
    }
}

/// The assets and a Python, or a line that says what is missing.
fn ready() -> Option<(PathBuf, PathBuf)> {
    let python = python::with("json");
    Some((assets::folder()?, python?))
}

/// The script's vertices for each time.
fn oracle(python: &Path, file: &Path, clip: &str, times: &[f32]) -> Vec<Vec<Vertex>> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/skinning_oracle.py");
    let output = Command::new(python)
        .arg("-B")
        .arg(script)
        .arg(file)
        .arg(clip)
        // As f64: the shortest digits of an f32 are another number to Python.
        .args(times.iter().map(|&time| f64::from(time).to_string()))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let vector = |value: &serde_json::Value| -> Option<DVec3> {
        let numbers = value.as_array()?;
        Some(DVec3::from_array([0, 1, 2].map(|i| numbers[i].as_f64().unwrap())))
    };
    let poses = document["poses"].as_array().unwrap();
    poses
        .iter()
        .map(|pose| {
            let positions = pose["positions"].as_array().unwrap();
            let normals = pose["normals"].as_array().unwrap();
            let pairs = positions.iter().zip(normals);
            pairs.map(|(p, n)| (vector(p).unwrap(), vector(n))).collect()
        })
        .collect()
}

/// The largest distance of positions, in model sizes, and of normals.
fn worst(scene: &Scene, clip: Option<&Clip>, time_s: f32, expected: &[Vertex]) -> (f64, f64) {
    let (mesh, skeleton) = (&scene.mesh, &scene.skeleton);
    let rest = Pose::rest(skeleton, &mesh.default_weights);
    let pose = clip.map_or_else(|| rest.clone(), |clip| evaluate(clip, time_s, &rest));
    let mut out = Deformed::default();
    let globals = skeleton.globals(&pose.local);
    deform(mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut out);
    assert_eq!(out.positions.len(), expected.len(), "as many vertices");
    let size = f64::from(size_m(mesh, skeleton));
    let mut most = (0.0_f64, 0.0_f64);
    for (v, (position, normal)) in expected.iter().enumerate() {
        most.0 = most.0.max(out.positions[v].as_dvec3().distance(*position) / size);
        if let Some(normal) = normal {
            most.1 = most.1.max(out.normals[v].as_dvec3().distance(*normal));
        }
    }
    most
}
