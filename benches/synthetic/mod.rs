//! A model of the published size, P(8,22) at order 6, of any number of points.

use poselight::model::{
    ColumnHeader, Decoder, FORMAT_VERSION, Family, Frame, Header, MeshIdentity, Model, NodeHeader,
    Precision, Provenance, RigHeader, RootMotionHeader, Signal, SourceHeader, TrainingSummary,
    WeightHeader,
};
use poselight::num::random::Stream;

pub(crate) const PARAMETERS: usize = 54;
pub(crate) const INPUTS: usize = 8;
pub(crate) const OUTPUTS: usize = 22;
pub(crate) const WIDTH: usize = 36;
pub(crate) const BONES: usize = 31;

pub(crate) fn numbers(seed: u64, count: usize) -> Vec<f32> {
    let mut stream = Stream::new(seed);
    (0..count).map(|_| (stream.normal() * 0.1) as f32).collect()
}

fn rig() -> RigHeader {
    let node = |i: usize| NodeHeader {
        name: format!("joint{i}"),
        parent: i.checked_sub(1).map(|parent| parent as u32),
        translation: [0.0; 3],
        rotation: [0.0, 0.0, 0.0, 1.0],
        scale: [1.0; 3],
    };
    RigHeader {
        nodes: (0..BONES).map(node).collect(),
        root_node: Some(0),
        bones: (0..BONES as u32).collect(),
        weights: (0..PARAMETERS)
            .map(|i| WeightHeader { name: format!("{i}"), default: 0.0 })
            .collect(),
        columns: (0..PARAMETERS as u32)
            .map(|slot| ColumnHeader {
                name: format!("{slot}"),
                source: SourceHeader::Weight { slot },
            })
            .collect(),
        size_m: 1.0,
        dropped: Vec::new(),
        root_motion: RootMotionHeader::Rigid,
    }
}

pub(crate) fn model(points: usize, frame: Frame) -> Model {
    let header = Header {
        format_version: FORMAT_VERSION,
        family: Family::PcaLinear,
        precision: Precision::F32,
        signal: Signal::Transfer,
        order: 6,
        channels: 1,
        frame,
        conventions: Header::conventions(),
        unshadowed: false,
        occluders: None,
        rest: None,
        rig: rig(),
        mesh: MeshIdentity {
            scene_sha256: "0".repeat(64),
            shape_sha256: None,
            receivers_sha256: None,
            vertices: points as u32,
            points: points as u32,
            parts: Vec::new(),
        },
        training: TrainingSummary {
            poses: 1,
            centre: vec![0.0; PARAMETERS],
            deviations: vec![1.0; INPUTS],
            residual_rms: 0.0,
            reach: None,
            directions: Vec::new(),
        },
        errors: [].into(),
        provenance: Provenance::default(),
    };
    let decoder = Decoder::PcaLinear {
        projection: numbers(1, PARAMETERS * INPUTS),
        coefficients: numbers(2, WIDTH * (INPUTS + 1) * OUTPUTS),
        basis: numbers(3, points * OUTPUTS),
    };
    let bones = bones_of(points);
    Model::new(header, decoder, (0..points as u32).collect(), bones).expect("a valid model")
}

/// Bones in the vertex order of a scanned character: long regions whose borders zigzag, so that a
/// run has some 14 points, and 32 points in a row belong to 1.7 bones.
fn bones_of(points: usize) -> Vec<u16> {
    let mut stream = Stream::new(4);
    let mut uniform = |below: usize| (stream.uniform() * below as f64) as usize;
    let mut bones = Vec::with_capacity(points);
    let mut bone = 0;
    while bones.len() < points {
        bones.extend(std::iter::repeat_n(bone, 20 + uniform(70)));
        let next = uniform(BONES) as u16;
        for _ in 0..2 {
            bones.extend(std::iter::repeat_n(next, 1 + uniform(7)));
            bones.extend(std::iter::repeat_n(bone, 1 + uniform(7)));
        }
        bone = next;
    }
    bones.truncate(points);
    bones
}
