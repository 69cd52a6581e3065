//! Fuzzes `scene::import_sources`. The first byte of an input says how the rest is read:
//! 0 a whole file, 1 JSON and buffer of a GLB (so that its lengths are right), 2 an OBJ file,
//! 3 changes to a rich, valid document (so that mutations reach behind the parser).

#![no_main]

mod invariants;

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use poselight::pose;
use poselight::rig::{Deformed, Pose, RigidFrame, deform};
use poselight::scene::{Limits, Scene, Source, import_sources};

fuzz_target!(|data: &[u8]| {
    let Some((way, rest)) = data.split_first() else { return };
    let sources = match way % 4 {
        0 => vec![source("a.gltf", rest.to_vec())],
        1 => vec![source("a.glb", glb(rest))],
        2 => vec![source("a.obj", rest.to_vec())],
        _ => changed(rest),
    };
    if let Ok(scene) = import_sources(sources, &limits()) {
        use_scene(&scene);
    }
});

/// Small, so that an execution is short.
fn limits() -> Limits {
    Limits {
        file_bytes: 1 << 16,
        decoded_bytes: 1 << 16,
        json_values: 2000,
        files: 4,
        nodes: 64,
        parts: 16,
        joints: 64,
        vertices: 512,
        triangles: 512,
        morph_targets: 16,
        channels: 16,
        keys: 512,
    }
}

fn source(name: &str, bytes: Vec<u8>) -> Source {
    Source { name: name.into(), bytes }
}

/// What follows import must not panic either: poses of every clip, and the mesh in them.
fn use_scene(scene: &Scene) {
    invariants::check(scene);
    let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let mut out = Deformed::default();
    for clip in scene.clips.iter().take(2) {
        for time_s in [-1.0, 0.0, 0.4 * clip.duration_s, clip.duration_s, f32::MAX] {
            let pose = pose::evaluate(clip, time_s, &rest);
            let globals = scene.skeleton.globals(&pose.local);
            deform(&scene.mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut out);
        }
    }
}

/// JSON up to the first zero byte, the binary chunk after it.
fn glb(data: &[u8]) -> Vec<u8> {
    let end = data.iter().position(|&byte| byte == 0).unwrap_or(data.len());
    let binary = data.get(end + 1..).unwrap_or_default();
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + end + binary.len()).to_le_bytes()[..4].iter());
    for (kind, chunk) in [(b"JSON", &data[..end]), (b"BIN\0", binary)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

/// A piece of the template: text, then one of several values.
struct Piece {
    text: String,
    choices: Vec<String>,
}

/// Values that are often wrong.
const EXTREMES: [&str; 12] = [
    "255", "65535", "4294967295", "4294967296", "18446744073709551615", "-1", "1e39", "-1e300",
    "0.5", "null", "\"x\"", "[]",
];

/// Cuts the template at its placeholders: `"@3"` is a number, 3 unless changed; `"?A|B"` is one
/// of the strings, the first unless changed.
fn pieces() -> &'static Vec<Piece> {
    static PIECES: OnceLock<Vec<Piece>> = OnceLock::new();
    PIECES.get_or_init(|| {
        let mut pieces = Vec::new();
        let mut text = String::new();
        for part in include_str!("importer.template.json").split('"') {
            if let Some(number) = part.strip_prefix('@') {
                let small = (0..116).map(|value: i32| value.to_string());
                let extreme = EXTREMES.iter().map(ToString::to_string);
                let choices = std::iter::once(number.to_owned()).chain(small).chain(extreme);
                let text = std::mem::take(&mut text);
                pieces.push(Piece { text: cut(text), choices: choices.collect() });
            } else if let Some(words) = part.strip_prefix('?') {
                let choices = words.split('|').map(|word| format!("\"{word}\"")).collect();
                let text = std::mem::take(&mut text);
                pieces.push(Piece { text: cut(text), choices });
            } else {
                text += part;
                text.push('"');
            }
        }
        text.pop();
        pieces.push(Piece { text, choices: vec![String::new()] });
        pieces
    })
}

/// Without the quotation mark that opened the placeholder.
fn cut(mut text: String) -> String {
    text.pop();
    text
}

/// The template with one byte for each placeholder and the rest over the buffer; zeros change
/// nothing.
fn changed(data: &[u8]) -> Vec<Source> {
    let mut text = String::with_capacity(8192);
    let mut bytes = data.iter().copied();
    for piece in pieces() {
        text += &piece.text;
        let choice = usize::from(bytes.next().unwrap_or(0)) % piece.choices.len();
        text += &piece.choices[choice];
    }
    let mut buffer = buffer();
    buffer.iter_mut().zip(bytes).for_each(|(byte, change)| *byte ^= change);
    vec![source("a.gltf", text.into_bytes()), source("data.bin", buffer)]
}

/// The template's data; see its views.
fn buffer() -> Vec<u8> {
    let mut out = Vec::new();
    let mut floats = |values: &[f32]| values.iter().for_each(|v| out.extend(v.to_le_bytes()));
    floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 1.]); // 0: positions
    floats(&[0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1.]); // 48: normals
    floats(&[1., 0., 0., 0., 0.5, 0.5, 0., 0., 0.25, 0.25, 0.25, 0.25, 0., 1., 0., 0.]); // 96
    let identity = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
    floats(&identity); // 160: inverse bind matrices
    floats(&identity);
    floats(&[0., 0.5, 1.]); // 288: times
    floats(&[0., 0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0.]); // 300: rotations
    floats(&[0., 0., 0., 1., 2., 3., 4., 5., 6.]); // 348: translations
    floats(&[0., 0., 0., 1., 0.5, 0.25, 1., 1., 1., 1., 0., 0., 0., 0., 0., 0., 0., 0.]); // 384
    floats(&[0., 0., 1., 0., 2., 0.]); // 456: sparse values
    out.extend([0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 1, 1, 1, 1]); // 480: joints
    out.extend([0, 0, 1, 0, 2, 0, 2, 0, 1, 0, 3, 0]); // 496: indices
    out.extend([1, 3, 0, 0]); // 508: sparse indices
    out
}
