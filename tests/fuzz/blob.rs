//! Fuzzes `model::Model::from_bytes`. The first byte of an input says how the rest is read:
//! 0 a whole file, 1 our header's JSON in an otherwise valid file (so that mutations reach behind
//! the container), 2 bytes to change in a valid file, as (offset low, offset high, value).

#![no_main]

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use poselight::model::{JointPose, Model, Precision};

/// A valid file of version 1.
const GOLDEN: &[u8] = include_bytes!("../../src/model/blob/golden_v1.safetensors");

fuzz_target!(|data: &[u8]| {
    let Some((way, rest)) = data.split_first() else { return };
    let bytes = match way % 3 {
        0 => rest.to_vec(),
        1 => with_header(rest),
        _ => patched(rest),
    };
    if let Ok(model) = Model::from_bytes(&bytes) {
        use_model(&model);
    }
});

/// The safetensors header of the golden file around our own, and its data.
fn container() -> &'static (serde_json::Value, &'static [u8]) {
    static CONTAINER: OnceLock<(serde_json::Value, &[u8])> = OnceLock::new();
    CONTAINER.get_or_init(|| {
        let length = u64::from_le_bytes(*GOLDEN.first_chunk().expect("eight bytes")) as usize;
        let json = serde_json::from_slice(&GOLDEN[8..8 + length]).expect("the golden header");
        (json, &GOLDEN[8 + length..])
    })
}

fn with_header(text: &[u8]) -> Vec<u8> {
    let (json, data) = container();
    let mut json = json.clone();
    json["__metadata__"]["poselight"] = String::from_utf8_lossy(text).into_owned().into();
    let json = json.to_string();
    [&(json.len() as u64).to_le_bytes(), json.as_bytes(), data].concat()
}

fn patched(patches: &[u8]) -> Vec<u8> {
    let mut bytes = GOLDEN.to_vec();
    for &[low, high, value] in patches.as_chunks().0 {
        let at = usize::from(u16::from_le_bytes([low, high])) % bytes.len();
        bytes[at] = value;
    }
    bytes
}

/// A model that was read does everything without a panic, and writes what it reads again.
fn use_model(model: &Model) {
    let shape = model.shape();
    let mut out = vec![0.0; shape.points * shape.width];
    let parameters = vec![0.5; shape.parameters];
    model.evaluate(&parameters, None, &mut out).expect("the right lengths");
    model.distance(&parameters).expect("the right length");
    let rest = model.pose_of(&JointPose::default()).expect("rest is a pose");
    // Nodes of extreme scale may leave the range of f32, which is an error and no panic.
    let _ = model.parameters_of_pose(&rest);
    let light = vec![1.0; model.header().coefficients()];
    if let Ok(rotations) = model.bone_rotations_of(&rest)
        && model.to_root_frame(&rotations, None, &mut out).is_ok()
        && let Ok(folded) = model.fold(&light, &rotations)
    {
        let mut lit = vec![0.0; shape.points * folded.colours()];
        folded.evaluate(&parameters, &mut lit).expect("the right lengths");
        model.shade(&parameters, &light, &rotations, &mut lit).expect("the right lengths");
    }
    for &precision in Precision::ALL {
        // f16 and i8 have ranges that a finite model may leave.
        let Ok(bytes) = model.to_bytes(precision) else {
            assert_ne!(precision, Precision::F32, "every finite model can be written");
            continue;
        };
        let again = Model::from_bytes(&bytes).expect("what we write we read");
        assert_eq!(again.to_bytes(precision).expect("written before"), bytes);
    }
}
