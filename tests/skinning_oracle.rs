//! Proves that import, clip evaluation, forward kinematics, morphing and skinning together put the
//! vertices of real characters where an independent Python script (`skinning_oracle.py`, float64,
//! no shared code) puts them: positions to 1e-5 of the model's size, normals to 1e-3.

#![cfg(feature = "bake")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test")]

use std::path::{Path, PathBuf};
use std::process::Command;

use glam::DVec3;
use poselight::pose::evaluate;
use poselight::rig::{Deformed, Pose, RigidFrame, deform};
use poselight::scene::{Limits, Scene, import, size_m};

/// File, and the clips that are compared.
const CASES: [(&str, &[usize]); 7] = [
    ("rigged/CesiumMan.glb", &[0]),
    ("rigged/Fox.glb", &[1, 2]),
    ("rigged/Robot_Quaternius.glb", &[0, 5]),
    ("rigged/MH_Male_CMU02.glb", &[2]),
    ("rigged/KayKit_Knight.glb", &[6, 44]),
    ("rigged/M2M_Dragon.glb", &[0, 2]),
    ("deform/AnimatedMorphSphere.glb", &[0]),
];

/// Parts of a clip's length; beyond its end it stands still.
const INSTANTS: [f32; 3] = [0.0, 0.437, 0.891];

const POSITION_TOLERANCE: f64 = 1e-5;
const NORMAL_TOLERANCE: f64 = 1e-3;

/// Without a normal where the matrix is singular.
type Vertex = (DVec3, Option<DVec3>);

#[test]
fn agrees_with_the_oracle() {
    let Some(assets) = assets() else {
        println!("skipped: no assets (POSELIGHT_ASSETS or ../shared/assets)");
        return;
    };
    let python = std::env::var("POSELIGHT_PYTHON").unwrap_or_else(|_| "python3".into());
    if Command::new(&python).arg("--version").output().is_err() {
        println!("skipped: no {python}");
        return;
    }
    for (name, clips) in CASES {
        let path = assets.join(name);
        let scene = import(&path, &Limits::default()).unwrap();
        for &clip in clips {
            let duration_s = scene.clips[clip].duration_s;
            let times: Vec<f32> = INSTANTS.iter().map(|part| part * duration_s).collect();
            let expected = oracle(&python, &path, clip, &times);
            for (&time_s, expected) in times.iter().zip(&expected) {
                let (position, normal) = worst(&scene, clip, time_s, expected);
                println!(
                    "{name} {} at {time_s:.3} s: position {position:.1e} of size, normal {normal:.1e}",
                    scene.clips[clip].name
                );
                assert!(position < POSITION_TOLERANCE, "positions of {name} differ");
                assert!(normal < NORMAL_TOLERANCE, "normals of {name} differ");
            }
        }
    }
}

fn assets() -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/assets");
    let named = std::env::var_os("POSELIGHT_ASSETS").map(PathBuf::from);
    named.into_iter().chain([beside.into()]).find(|folder| folder.is_dir())
}

/// The script's vertices for each time.
fn oracle(python: &str, file: &Path, clip: usize, times: &[f32]) -> Vec<Vec<Vertex>> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/skinning_oracle.py");
    let output = Command::new(python)
        .arg("-B")
        .arg(script)
        .arg(file)
        .arg(clip.to_string())
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
fn worst(scene: &Scene, clip: usize, time_s: f32, expected: &[Vertex]) -> (f64, f64) {
    let (mesh, skeleton) = (&scene.mesh, &scene.skeleton);
    let rest = Pose::rest(skeleton, &mesh.default_weights);
    let pose = evaluate(&scene.clips[clip], time_s, &rest);
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
