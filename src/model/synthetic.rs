//! Small models with every feature of the format, for the tests of this module.

use glam::{Quat, Vec3};

use super::occluder::ANCHORS;
use super::{
    Cluster, Clustered, Decoder, Family, Form, Frame, Header, MeshIdentity, Model, Multilinear,
    Occluders, PartRange, Precision, Provenance, RigHeader, Signal, TrainingSummary,
};
use crate::num::random::Stream;
use crate::rig::{Bones, Column, Node, Parametrisation, RootMotion, Skeleton, Source, Transform};

/// Points, vertices and parameters of every model here.
pub(super) const POINTS: usize = 37;
pub(super) const VERTICES: usize = 40;
pub(super) const PARAMETERS: usize = 6;

/// Numbers in [-1, 1) that only depend on the seed.
pub(super) fn numbers(seed: u64, count: usize) -> Vec<f32> {
    let mut stream = Stream::new(seed);
    (0..count).map(|_| (stream.uniform() * 2.0 - 1.0) as f32).collect()
}

/// Hips over a spine with an arm and a head; one morph weight.
pub(super) fn rig() -> RigHeader {
    let node = |name: &str, parent, y| Node {
        name: name.to_owned(),
        parent,
        rest: Transform {
            translation: Vec3::new(0.0, y, 0.0),
            rotation: Quat::from_xyzw(0.0, 0.6, 0.0, 0.8),
            scale: Vec3::ONE,
        },
    };
    let skeleton = Skeleton {
        nodes: vec![
            node("Armature", None, 0.0),
            node("Hips", Some(0), 1.0),
            node("Arm", Some(1), 0.5),
            node("Head", Some(1), 0.75),
        ],
    };
    let rotation = |node, axis| Column {
        source: Source::Rotation { node, axis, mean: Quat::from_xyzw(0.28, 0.0, 0.0, 0.96) },
        name: format!("{node} rotation {axis}"),
    };
    let angles = Parametrisation {
        columns: vec![
            rotation(2, 0),
            rotation(2, 1),
            rotation(2, 2),
            Column {
                source: Source::Translation { node: 3, axis: 1, rest: 0.75 },
                name: "Head translation y".to_owned(),
            },
            Column {
                source: Source::Scale { node: 3, axis: 0, rest: 1.0 },
                name: "Head scale x".to_owned(),
            },
            Column { source: Source::Weight { slot: 0 }, name: "Body/smile".to_owned() },
        ],
        size_m: 1.75,
        dropped: vec!["Head rotation".to_owned()],
    };
    let bones = Bones { nodes: vec![1, 2, 3], of_point: Vec::new() };
    RigHeader::new(
        &skeleton,
        (Some(1), RootMotion::Rigid),
        &bones,
        &angles,
        &["Body/smile".to_owned()],
        &[0.25],
    )
}

pub(super) fn header(family: Family, signal: Signal, frame: Frame, channels: u8) -> Header {
    let retained = if family == Family::Mean { 0 } else { 2 };
    let own_directions = matches!(family, Family::Linear | Family::Multilinear);
    Header {
        format_version: super::FORMAT_VERSION,
        family,
        precision: Precision::F32,
        signal,
        order: if signal == Signal::Ao { 1 } else { 3 },
        channels,
        frame,
        conventions: Header::conventions(),
        unshadowed: false,
        occluders: None,
        rest: None,
        rig: rig(),
        mesh: MeshIdentity {
            scene_sha256: "0123456789abcdef".repeat(4),
            shape_sha256: None,
            receivers_sha256: None,
            vertices: VERTICES as u32,
            points: POINTS as u32,
            parts: vec![
                PartRange {
                    name: "Body".to_owned(),
                    node: 0,
                    primitive: 0,
                    first_vertex: 0,
                    vertices: 30,
                },
                PartRange {
                    name: "Hat".to_owned(),
                    node: 3,
                    primitive: 0,
                    first_vertex: 30,
                    vertices: 10,
                },
            ],
        },
        training: TrainingSummary {
            poses: 12,
            centre: vec![0.5, -0.25, 0.125, 0.0, 0.1, 0.3],
            deviations: vec![0.75, 0.5][..retained].to_vec(),
            residual_rms: 0.0625,
            reach: None,
            directions: if own_directions { numbers(9, PARAMETERS * retained) } else { Vec::new() },
        },
        errors: [("rmse".to_owned(), serde_json::json!({"novel": 0.0125}))].into(),
        provenance: Provenance {
            generator: "poselight test".to_owned(),
            recipe: serde_json::json!({"version": 1}),
            hashes: [("bake".to_owned(), "00ff".to_owned())].into(),
        },
    }
}

pub(super) fn decoder(header: &Header) -> Decoder {
    let width = header.width();
    match header.family {
        Family::Mean => Decoder::Mean { mean: numbers(1, POINTS * width) },
        Family::Linear => Decoder::Linear {
            mean: numbers(1, POINTS * width),
            weights: numbers(2, POINTS * width * PARAMETERS),
        },
        Family::PcaLinear => Decoder::PcaLinear {
            projection: numbers(3, PARAMETERS * 2),
            coefficients: numbers(4, width * 3 * 5),
            basis: numbers(5, POINTS * 5),
        },
        Family::Multilinear => Decoder::Multilinear(multilinear(header)),
        Family::ClusteredLinear => Decoder::Clustered(clustered(width, Form::Linear)),
        Family::ClusteredQuadratic => Decoder::Clustered(clustered(width, Form::Quadratic)),
        Family::ClusteredTanh => Decoder::Clustered(clustered(width, Form::Tanh)),
    }
}

/// Three pose clusters of two dimensions. In the bone frame the points have rows of their own with
/// intercepts; in the root frame they share eight rows about a mean, as published.
fn multilinear(header: &Header) -> Multilinear {
    let width = header.width();
    let own = header.frame == Frame::Bone;
    let (rows, inner) = if own { (POINTS, 3) } else { (8, 2) };
    Multilinear {
        blend_exponent: 2.0,
        inputs: 2,
        intercepts: own,
        centres: numbers(6, 3 * PARAMETERS),
        projection: numbers(7, PARAMETERS * 3 * 2),
        mean: if own { Vec::new() } else { numbers(8, POINTS * width) },
        coefficients: numbers(10, rows * 3 * width * inner),
        row_of_point: match own {
            true => Vec::new(),
            false => (0..3 * POINTS).map(|i| (i * 5 % 8) as u32).collect(),
        },
    }
}

/// Four clusters with 0 to 3 outputs, of which the second has no points.
fn clustered(width: usize, form: Form) -> Clustered {
    let cluster_of_point: Vec<u32> = (0..POINTS).map(|p| [0, 2, 3][p * 7 % 3]).collect();
    let cluster = |i: usize| {
        let count = cluster_of_point.iter().filter(|&&c| c as usize == i).count();
        let neurons = if form == Form::Tanh && i > 0 { i + 1 } else { 0 };
        let features = form.count(2, neurons) + 1;
        let seed = 20 + 3 * i as u64;
        Cluster {
            outputs: i,
            basis: numbers(seed, count * width * (i + 1)),
            weights: numbers(seed + 1, i * features),
            hidden: numbers(seed + 2, neurons * 3),
        }
    };
    let clusters = (0..4).map(cluster).collect();
    Clustered { form, projection: numbers(3, PARAMETERS * 2), cluster_of_point, clusters }
}

pub(super) fn maps() -> (Vec<u32>, Vec<u16>) {
    let point_of_vertex = (0..VERTICES).map(|vertex| (vertex % POINTS) as u32).collect();
    let bone_of_point = (0..POINTS).map(|point| (point / 5 % 3) as u16).collect();
    (point_of_vertex, bone_of_point)
}

pub(super) fn model(family: Family, signal: Signal, frame: Frame, channels: u8) -> Model {
    let header = header(family, signal, frame, channels);
    let decoder = decoder(&header);
    let (point_of_vertex, bone_of_point) = maps();
    let model = Model::new(header, decoder, point_of_vertex, bone_of_point).expect("a valid model");
    match frame {
        Frame::Root | Frame::Bone => model,
        Frame::Tangent => model.with_tangents(tangents()).expect("one for each point"),
    }
}

/// Of the points at rest.
fn tangents() -> Vec<[i8; 3]> {
    let vectors = numbers(66, POINTS * 3);
    vectors.as_chunks().0.iter().map(|v| v.map(|x: f32| (100.0 * x) as i8)).collect()
}

/// One model of every family, signal and frame that it has, with one channel and with three.
pub(super) fn all() -> Vec<Model> {
    let mut models = Vec::new();
    for &family in Family::ALL {
        for &signal in Signal::ALL {
            for &frame in
                Frame::ALL.iter().filter(|f| signal != Signal::Ao || **f != Frame::Tangent)
            {
                for channels in [1, 3] {
                    models.push(model(family, signal, frame, channels));
                }
            }
        }
    }
    models
}

/// A model with five occluders in three groups that learns only what occlusion takes away.
pub(super) fn occluded(family: Family, signal: Signal) -> Model {
    let header = Header { unshadowed: true, ..header(family, signal, Frame::Bone, 1) };
    let decoder = decoder(&header);
    let (point_of_vertex, bone_of_point) = maps();
    let model = Model::new(header, decoder, point_of_vertex, bone_of_point);
    model.and_then(|model| model.with_occluders(occluders())).expect("a valid model")
}

pub(super) fn occluders() -> Occluders {
    let spheres = 5;
    Occluders {
        anchors: (0..spheres * ANCHORS).map(|i| (i * 7 % POINTS) as u32).collect(),
        offsets: numbers(61, spheres * 3).iter().map(|x| 0.1 * x).collect(),
        radii: numbers(62, spheres).iter().map(|x| 0.3 + 0.2 * x).collect(),
        group_of: (0..3 * spheres).map(|i| (i * 5 % 3) as u8).collect(),
        weights: numbers(63, POINTS * 3),
        ..Occluders::default()
    }
}

/// The same as ellipsoids whose union is looked at.
pub(super) fn united() -> Occluders {
    let spheres = occluders();
    let shape = |(i, &radius): (usize, &f32)| {
        let [a, b, c] = [1.0, 1.5, 2.0].map(|by| by / radius);
        let off = 0.1 * (i as f32 - 2.0) / radius;
        [a, b, c, off, -off, 0.5 * off]
    };
    let shapes = spheres.radii.iter().enumerate().flat_map(shape).collect();
    Occluders { shapes, directions: 64, ..spheres }
}

/// Positions and unit normals of a posed mesh.
pub(super) fn surface() -> (Vec<Vec3>, Vec<Vec3>) {
    let vectors = |seed| numbers(seed, POINTS * 3).as_chunks().0.to_vec();
    let positions = vectors(64).into_iter().map(Vec3::from_array).collect();
    let normals = vectors(65).into_iter().map(|n| Vec3::from_array(n).normalize()).collect();
    (positions, normals)
}
