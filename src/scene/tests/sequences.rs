//! Vertex sequences from archives.

use std::io::{Cursor, Write};

use npyz::WriterBuilder;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use super::*;
use crate::rig::{Deformed, Pose, RigidFrame, deform};

fn array<T: npyz::AutoSerialize + Copy>(shape: &[u64], values: &[T]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let options = npyz::WriteOptions::new().default_dtype().shape(shape);
    let mut writer = options.writer(&mut bytes).begin_nd().unwrap();
    writer.extend(values.iter().copied()).unwrap();
    writer.finish().unwrap();
    bytes
}

fn archive(arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in arrays {
        zip.start_file(format!("{name}.npy"), SimpleFileOptions::default()).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// A triangle that rises by its frame's number and turns about x by a right angle at the third.
const FRAMES: [f32; 27] = [
    0., 0., 0., 1., 0., 0., 0., 1., 0., //
    0., 0., 1., 1., 0., 1., 0., 1., 1., //
    0., 0., 2., 1., 0., 2., 0., 0., 3.,
];

fn sequence() -> Vec<u8> {
    archive(&[
        ("positions", array(&[3, 3, 3], &FRAMES)),
        ("faces", array(&[1, 3], &[0_i64, 1, 2])),
        ("fps", array(&[], &[10.0_f32])),
    ])
}

/// An archive of a sheet of so many vertices a side, all of them twice; frame by frame its ends wave up and down.
pub(crate) fn waving_sheet(side: usize, frames: usize) -> Vec<u8> {
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for frame in 0..frames {
        for i in 0..2 * side * side {
            let [x, y] = [i % side, i / side % side].map(|i| i as f32 / (side - 1) as f32 - 0.5);
            let angle = 1.2 * (0.7 * frame as f32).sin() + 0.5 * y;
            positions.extend([x * angle.cos(), y, (x * angle.sin()).abs()]);
        }
    }
    for i in 0..2 * side * side {
        let [column, row] = [i % side, i / side % side];
        if column.min(row) > 0 {
            let [a, b] = [i - side, i].map(|i| i as i64);
            faces.extend([a - 1, a, b, a - 1, b, b - 1]);
        }
    }
    let shape = [frames as u64, (2 * side * side) as u64, 3];
    archive(&[
        ("positions", array(&shape, &positions)),
        ("faces", array(&[faces.len() as u64 / 3, 3], &faces)),
        ("fps", array(&[], &[10.0_f32])),
    ])
}

fn posed(scene: &Scene, time_s: f32) -> Deformed {
    let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let pose = match scene.clips.first() {
        Some(clip) => {
            let key = (time_s * 10.0).round() as usize;
            let slots = scene.mesh.weight_names.len();
            let weights = &clip.channels[0].values[key * slots..(key + 1) * slots];
            Pose { weights: weights.to_vec(), ..rest }
        }
        None => rest,
    };
    let mut out = Deformed::default();
    let globals = scene.skeleton.globals(&pose.local);
    deform(&scene.mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut out);
    out
}

/// Every frame comes back exactly at its time, with its own normals; the clip has the archive's
/// rate, and the scene can be imported again from what it kept.
#[test]
fn frames_come_back() {
    let scene = import_bytes("cloth.npz", &sequence()).unwrap();
    assert!(scene.is_sequence);
    assert_eq!((scene.clips.len(), scene.clips[0].duration_s), (1, 0.2));
    for (frame, expected) in FRAMES.chunks(9).enumerate() {
        let posed = posed(&scene, frame as f32 / 10.0);
        let found: Vec<f32> = posed.positions.iter().flat_map(|p| p.to_array()).collect();
        assert_eq!(found, expected);
        let normal = if frame < 2 { glam::Vec3::Z } else { -glam::Vec3::Y };
        assert!(posed.normals.iter().all(|n| n.distance(normal) < 1e-6), "{:?}", posed.normals);
    }
    assert_eq!(import_sources(scene.sources.clone(), &Limits::default()).unwrap(), scene);
}

/// One frame is a static scene; doubles and unsigned faces are read; without fps there is a notice.
#[test]
fn other_types_are_read() {
    let positions: Vec<f64> = FRAMES[..9].iter().map(|&v| f64::from(v)).collect();
    let bytes = archive(&[
        ("positions", array(&[1, 3, 3], &positions)),
        ("faces", array(&[1, 3], &[0_u32, 1, 2])),
    ]);
    let scene = import_bytes("one.npz", &bytes).unwrap();
    assert!(scene.clips.is_empty());
    assert_notice(&scene, "no fps");
}

/// Frames that are not finite, shapes that do not fit, faces beyond the vertices, missing arrays,
/// claims beyond the limits and every truncation are refused with the array's name.
#[test]
fn hostile_archives_are_refused() {
    let refusal = |arrays: &[(&str, Vec<u8>)]| {
        import_bytes("bad.npz", &archive(arrays)).expect_err("must be refused").to_string()
    };
    let positions = ("positions", array(&[3, 3, 3], &FRAMES));
    let faces = ("faces", array(&[1, 3], &[0_i64, 1, 2]));
    let mut broken = FRAMES;
    broken[20] = f32::NAN;
    let message = refusal(&[("positions", array(&[3, 3, 3], &broken)), faces.clone()]);
    assert!(message.contains("frame 2, vertex 0"), "{message}");
    let message = refusal(&[("positions", array(&[27], &FRAMES)), faces.clone()]);
    assert!(message.contains("[frame, vertex, 3]"), "{message}");
    assert!(refusal(std::slice::from_ref(&positions)).contains("`faces`"));
    assert!(refusal(std::slice::from_ref(&faces)).contains("`positions`"));
    for corner in [3, -1] {
        let message = refusal(&[positions.clone(), ("faces", array(&[1, 3], &[0, 1, corner]))]);
        assert!(message.contains("3 vertices"), "{message}");
    }
    let message = refusal(&[positions.clone(), ("faces", array(&[1, 3], &[0.0_f32, 1.0, 2.0]))]);
    assert!(message.contains("type"), "{message}");
    let message = refusal(&[positions, faces, ("fps", array(&[], &[0.0_f32]))]);
    assert!(message.contains("`fps`"), "{message}");

    let whole = sequence();
    let limits = Limits { decoded_bytes: 100, ..Limits::default() };
    let source = Source { name: "a.npz".into(), bytes: whole.clone() };
    let message = import_sources(vec![source], &limits).unwrap_err().to_string();
    assert!(message.contains("`decoded_bytes`"), "{message}");
    for length in 4..whole.len() {
        assert!(import_bytes("cut.npz", &whole[..length]).is_err(), "{length}");
    }
}
