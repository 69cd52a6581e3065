//! The figure as a binary glTF file.

use glam::{DQuat, Vec3};
use serde_json::{Value, json};

use super::body::{HIPS, Joint};
use super::clips::{Motion, RATE_HZ};
use super::surface::Surface;
use super::weights::Skin;

const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_BYTE: u32 = 5121;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// A rotation that never leaves the identity by more than this needs no channel.
const STILL: f64 = 1e-7;

/// Binary data with the accessors that describe it.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Adds a view and an accessor over all of it; returns the accessor's index.
    fn add(&mut self, bytes: &[u8], target: Option<u32>, mut accessor: Value) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view =
            json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        accessor["bufferView"] = json!(self.views.len());
        self.bytes.extend_from_slice(bytes);
        self.views.push(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn add_floats(&mut self, values: &[f32], target: Option<u32>, accessor: Value) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.add(&bytes, target, accessor)
    }
}

/// Writes mesh, skin and clips into one file.
pub(super) fn write(
    joints: &[Joint],
    surface: &Surface,
    skins: &[Skin],
    motions: &[Motion],
) -> Vec<u8> {
    let mut buffer = Buffer::default();
    let primitive = primitive(&mut buffer, surface, skins);
    let inverse_bind = inverse_bind(&mut buffer, joints);
    let animations: Vec<Value> =
        motions.iter().map(|motion| animation(&mut buffer, motion)).collect();
    let figure = joints.len();
    let mut nodes: Vec<Value> = joints.iter().enumerate().map(|(i, _)| node(joints, i)).collect();
    nodes.push(json!({ "name": "Figure", "mesh": 0, "skin": 0 }));
    buffer.bytes.resize(buffer.bytes.len().next_multiple_of(4), 0);
    let document = json!({
        "asset": { "version": "2.0", "generator": "poselight" },
        "scene": 0,
        "scenes": [{ "name": "Scene", "nodes": [HIPS, figure] }],
        "nodes": nodes,
        "meshes": [{ "name": "Figure", "primitives": [primitive] }],
        "materials": [{
            "name": "Clay",
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.72, 0.66, 0.60, 1.0],
                "metallicFactor": 0.0,
                "roughnessFactor": 0.8
            }
        }],
        "skins": [{
            "name": "Figure",
            "joints": (0..joints.len()).collect::<Vec<_>>(),
            "skeleton": HIPS,
            "inverseBindMatrices": inverse_bind
        }],
        "animations": animations,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{ "byteLength": buffer.bytes.len() }]
    });
    container(&document, &buffer.bytes)
}

fn node(joints: &[Joint], index: usize) -> Value {
    let joint = &joints[index];
    let origin = joint.parent.map_or(glam::DVec3::ZERO, |parent| joints[parent].at);
    let children: Vec<usize> =
        (0..joints.len()).filter(|&child| joints[child].parent == Some(index)).collect();
    let mut node = json!({
        "name": joint.name,
        "translation": (joint.at - origin).as_vec3().to_array()
    });
    if !children.is_empty() {
        node["children"] = json!(children);
    }
    node
}

fn primitive(buffer: &mut Buffer, surface: &Surface, skins: &[Skin]) -> Value {
    let count = surface.positions.len();
    let positions: Vec<Vec3> = surface.positions.iter().map(|p| p.as_vec3()).collect();
    let low = positions.iter().copied().fold(Vec3::INFINITY, Vec3::min);
    let high = positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    let vec3 = json!({ "componentType": FLOAT, "type": "VEC3", "count": count });
    let mut bounded = vec3.clone();
    bounded["min"] = json!(low.to_array());
    bounded["max"] = json!(high.to_array());
    let flat: Vec<f32> = positions.iter().flat_map(|p| p.to_array()).collect();
    let position = buffer.add_floats(&flat, Some(ARRAY_BUFFER), bounded);
    let flat: Vec<f32> = surface
        .normals()
        .iter()
        .flat_map(|normal| normal.as_vec3().normalize().to_array())
        .collect();
    let normal = buffer.add_floats(&flat, Some(ARRAY_BUFFER), vec3);
    let bytes: Vec<u8> = skins.iter().flat_map(|skin| skin.joints).collect();
    let vec4 = |kind: u32| json!({ "componentType": kind, "type": "VEC4", "count": count });
    let joint = buffer.add(&bytes, Some(ARRAY_BUFFER), vec4(UNSIGNED_BYTE));
    let flat: Vec<f32> = skins.iter().flat_map(|skin| skin.weights).collect();
    let weight = buffer.add_floats(&flat, Some(ARRAY_BUFFER), vec4(FLOAT));
    let indices: Vec<u8> = surface
        .triangles
        .iter()
        .flatten()
        .flat_map(|&vertex| u16::try_from(vertex).expect("a small mesh").to_le_bytes())
        .collect();
    let scalars = json!({
        "componentType": UNSIGNED_SHORT, "type": "SCALAR", "count": 3 * surface.triangles.len()
    });
    let indices = buffer.add(&indices, Some(ELEMENT_ARRAY_BUFFER), scalars);
    json!({
        "attributes": {
            "POSITION": position, "NORMAL": normal, "JOINTS_0": joint, "WEIGHTS_0": weight
        },
        "indices": indices,
        "material": 0
    })
}

/// Nothing is turned at rest, so the inverse bind is a translation.
fn inverse_bind(buffer: &mut Buffer, joints: &[Joint]) -> usize {
    let flat: Vec<f32> = joints
        .iter()
        .flat_map(|joint| glam::Mat4::from_translation(-joint.at.as_vec3()).to_cols_array())
        .collect();
    let accessor = json!({ "componentType": FLOAT, "type": "MAT4", "count": joints.len() });
    buffer.add_floats(&flat, None, accessor)
}

fn animation(buffer: &mut Buffer, motion: &Motion) -> Value {
    let count = motion.keys.len();
    let times: Vec<f32> = (0..count).map(|key| (key as f64 / RATE_HZ) as f32).collect();
    let input = buffer.add_floats(
        &times,
        None,
        json!({
            "componentType": FLOAT, "type": "SCALAR", "count": count,
            "min": [times[0]], "max": [times[count - 1]]
        }),
    );
    let (mut samplers, mut channels) = (Vec::new(), Vec::new());
    let mut add = |joint: usize, path: &str, output: usize| {
        channels.push(json!({
            "sampler": samplers.len(), "target": { "node": joint, "path": path }
        }));
        samplers.push(json!({ "input": input, "output": output, "interpolation": "LINEAR" }));
    };
    let flat: Vec<f32> =
        motion.keys.iter().flat_map(|key| key.translation.as_vec3().to_array()).collect();
    let accessor = |kind: &str| json!({ "componentType": FLOAT, "type": kind, "count": count });
    add(HIPS, "translation", buffer.add_floats(&flat, None, accessor("VEC3")));
    for joint in 0..motion.keys[0].rotations.len() {
        let rotations = motion.keys.iter().map(|key| key.rotations[joint]);
        if rotations.clone().all(|q| q.xyz().length() < STILL) {
            continue;
        }
        let flat = continuous(rotations);
        add(joint, "rotation", buffer.add_floats(&flat, None, accessor("VEC4")));
    }
    json!({ "name": motion.name, "samplers": samplers, "channels": channels })
}

/// Components of unit quaternions, each on the hemisphere of the one before.
fn continuous(rotations: impl Iterator<Item = DQuat>) -> Vec<f32> {
    let mut last = DQuat::IDENTITY;
    rotations
        .flat_map(|q| {
            last = if q.dot(last) < 0.0 { -q } else { q };
            last.as_quat().normalize().to_array()
        })
        .collect()
}

/// The GLB container: a header, the JSON chunk and the binary chunk, each a multiple of 4 bytes.
fn container(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let word = |value: usize| u32::try_from(value).expect("a small file").to_le_bytes();
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let mut file = Vec::with_capacity(total);
    file.extend_from_slice(b"glTF");
    file.extend_from_slice(&word(2));
    file.extend_from_slice(&word(total));
    for (kind, chunk) in [(b"JSON", json.as_slice()), (b"BIN\0", binary)] {
        file.extend_from_slice(&word(chunk.len()));
        file.extend_from_slice(kind);
        file.extend_from_slice(chunk);
    }
    file
}
