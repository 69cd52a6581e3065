//! Training sets and models that the cases are made of, and evaluation in f64.

use glam::Quat;
use poselight::dataset::{Training, TrainingParts};
use poselight::fit::{Family, Fitted, On, Ridge, Settings, fit};
use poselight::model::{
    Cluster, Clustered, ColumnHeader, Decoder, FORMAT_VERSION, Form, Frame, Header, MeshIdentity,
    Model, Multilinear, NodeHeader, Precision, Provenance, RigHeader, RootMotionHeader, Signal,
    SourceHeader, WeightHeader,
};
use poselight::num::random::Stream;

/// Sizes of a training set.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sizes {
    pub(crate) poses: usize,
    pub(crate) parameters: usize,
    pub(crate) points: usize,
    /// 1, or the square of an order.
    pub(crate) coefficients: usize,
}

/// What most cases change one thing of.
pub(crate) const PLAIN: Sizes = Sizes { poses: 24, parameters: 4, points: 9, coefficients: 1 };

/// Outputs around 1/2 that are linear in the parameters up to a bend and a little noise.
pub(crate) fn data(sizes: Sizes, seed: u64) -> TrainingParts {
    let Sizes { poses, parameters, points, coefficients } = sizes;
    let mut stream = Stream::new(seed);
    let x: Vec<f32> = (0..poses * parameters).map(|_| stream.normal() as f32).collect();
    let outputs = points * coefficients;
    let slopes: Vec<f64> = (0..outputs * parameters).map(|_| 0.1 * stream.normal()).collect();
    let mut values = Vec::with_capacity(poses * outputs);
    for x in x.chunks_exact(parameters) {
        for slopes in slopes.chunks_exact(parameters) {
            let along: f64 = slopes.iter().zip(x).map(|(s, &x)| s * f64::from(x)).sum();
            let y = 0.5 + along + 0.2 * along * along + 0.01 * stream.normal();
            values.push(y as f32);
        }
    }
    TrainingParts {
        points,
        channels: 1,
        coefficients,
        bones: 1,
        parameters: x,
        parameter_names: (0..parameters).map(|j| format!("weight {j}")).collect(),
        clips: vec![0; poses],
        bone_rotations: vec![Quat::IDENTITY; poses],
        point_bones: vec![0; points],
        noise_variance: 1e-4,
        noise_of_points: Vec::new(),
        values,
    }
}

/// The data with every parameter changed.
pub(crate) fn changed(
    mut parts: TrainingParts,
    change: impl Fn(usize, f32) -> f32,
) -> TrainingParts {
    let a = parts.parameter_names.len();
    parts.parameters.iter_mut().enumerate().for_each(|(i, x)| *x = change(i % a, *x));
    parts
}

pub(crate) fn settings(family: Family) -> Settings {
    Settings { family, frame: Frame::Root, ridge: Ridge::LeaveOneOut, ..Settings::default() }
}

pub(crate) fn trained(family: Family) -> Settings {
    Settings { on: On::Trained, ..settings(family) }
}

pub(crate) fn fitted(parts: &TrainingParts, settings: &Settings) -> Fitted {
    fit(&Training::in_memory(parts.clone()), settings).expect("a fit")
}

/// A model that stands on its own: its parameters are morph weights.
pub(crate) fn model(parts: &TrainingParts, fitted: &Fitted, frame: Frame) -> Model {
    let count = parts.parameter_names.len();
    let order = parts.coefficients.isqrt() as u8;
    let name = |slot: usize| format!("weight {slot}");
    let header = Header {
        format_version: FORMAT_VERSION,
        family: fitted.decoder.family(),
        precision: Precision::F32,
        signal: if order == 1 { Signal::Ao } else { Signal::Transfer },
        order,
        channels: 1,
        frame,
        conventions: Header::conventions(),
        unshadowed: false,
        occluders: None,
        rest: None,
        rig: RigHeader {
            nodes: vec![NodeHeader {
                name: "root".to_owned(),
                parent: None,
                translation: [0.0; 3],
                rotation: [0.0, 0.0, 0.0, 1.0],
                scale: [1.0; 3],
            }],
            root_node: Some(0),
            bones: vec![0],
            weights: (0..count).map(|i| WeightHeader { name: name(i), default: 0.0 }).collect(),
            columns: (0..count)
                .map(|i| {
                    let source = SourceHeader::Weight { slot: i as u32 };
                    ColumnHeader { name: name(i), source }
                })
                .collect(),
            size_m: 1.0,
            dropped: Vec::new(),
            root_motion: RootMotionHeader::Rigid,
        },
        mesh: MeshIdentity {
            scene_sha256: "0".repeat(64),
            shape_sha256: None,
            receivers_sha256: None,
            vertices: parts.points as u32,
            points: parts.points as u32,
            parts: Vec::new(),
        },
        training: fitted.training.clone(),
        errors: [].into(),
        provenance: Provenance::default(),
    };
    let maps = ((0..parts.points as u32).collect(), parts.point_bones.clone());
    Model::new(header, fitted.decoder.clone(), maps.0, maps.1).expect("a model")
}

/// What the decoder says of a pose, all arithmetic in f64.
pub(crate) fn reference(parts: &TrainingParts, fitted: &Fitted, x: &[f32]) -> Vec<f64> {
    let x: Vec<f64> = x.iter().map(|&x| f64::from(x)).collect();
    let centre: Vec<f64> = fitted.training.centre.iter().map(|&c| f64::from(c)).collect();
    let offset: Vec<f64> = x.iter().zip(&centre).map(|(x, c)| x - c).collect();
    match &fitted.decoder {
        Decoder::Mean { mean } => mean.iter().map(|&y| f64::from(y)).collect(),
        Decoder::Linear { mean, weights } => {
            let rows = weights.chunks_exact(offset.len());
            mean.iter().zip(rows).map(|(&mean, row)| f64::from(mean) + dot(row, &offset)).collect()
        }
        Decoder::PcaLinear { projection, coefficients, basis } => {
            let mut features = projected(projection, &x);
            features.push(1.0);
            pca(coefficients, basis, &features, parts.coefficients)
        }
        Decoder::Multilinear(local) => multilinear(local, &x, parts),
        Decoder::Clustered(clustered_parts) => {
            let reduced = projected(&clustered_parts.projection, &offset);
            clustered(clustered_parts, &reduced, parts.coefficients)
        }
    }
}

fn dot(row: &[f32], x: &[f64]) -> f64 {
    row.iter().zip(x).map(|(&a, b)| f64::from(a) * b).sum()
}

/// `[parameter, d]`ᵀ x.
fn projected(projection: &[f32], x: &[f64]) -> Vec<f64> {
    let d = projection.len() / x.len();
    let mut out = vec![0.0; d];
    for (row, x) in projection.chunks_exact(d).zip(x) {
        out.iter_mut().zip(row).for_each(|(sum, &p)| *sum += f64::from(p) * x);
    }
    out
}

fn pca(coefficients: &[f32], basis: &[f32], features: &[f64], width: usize) -> Vec<f64> {
    let outputs = coefficients.len() / (width * features.len());
    let reduced: Vec<Vec<f64>> = coefficients
        .chunks_exact(features.len() * outputs)
        .map(|of_c| {
            let mut z = vec![0.0; outputs];
            for (row, f) in of_c.chunks_exact(outputs).zip(features) {
                z.iter_mut().zip(row).for_each(|(z, &x)| *z += f64::from(x) * f);
            }
            z
        })
        .collect();
    let rows = basis.chunks_exact(outputs);
    rows.flat_map(|row| reduced.iter().map(move |z| dot(row, z))).collect()
}

/// Clusters' predictions by ω_j ∝ (d_min/d_j)^α on the distance to the centres.
fn multilinear(m: &Multilinear, x: &[f64], parts: &TrainingParts) -> Vec<f64> {
    let a = x.len();
    let clusters = m.centres.len() / a;
    let centre = |j: usize| &m.centres[j * a..(j + 1) * a];
    let distance = |j: usize| -> f64 {
        let squares = centre(j).iter().zip(x).map(|(&c, x)| (x - f64::from(c)).powi(2));
        squares.sum::<f64>().sqrt()
    };
    let distances: Vec<f64> = (0..clusters).map(distance).collect();
    let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
    let raw: Vec<f64> = distances
        .iter()
        .map(|&d| if d == least { 1.0 } else { (least / d).powf(f64::from(m.blend_exponent)) })
        .collect();
    let total: f64 = raw.iter().sum();
    let inner = m.inputs + usize::from(m.intercepts);
    let (points, width) = (parts.points, parts.coefficients);
    let mut out: Vec<f64> = match m.mean.is_empty() {
        true => vec![0.0; points * width],
        false => m.mean.iter().map(|&y| f64::from(y)).collect(),
    };
    for (j, weight) in raw.iter().enumerate() {
        let offset: Vec<f64> = x.iter().zip(centre(j)).map(|(x, &c)| x - f64::from(c)).collect();
        let mut features: Vec<f64> = (0..m.inputs)
            .map(|k| {
                let column =
                    (0..a).map(|i| f64::from(m.projection[(i * clusters + j) * m.inputs + k]));
                column.zip(&offset).map(|(p, x)| p * x).sum()
            })
            .collect();
        if m.intercepts {
            features.push(1.0);
        }
        for (i, out) in out.iter_mut().enumerate() {
            let (point, c) = (i / width, i % width);
            let row = match m.row_of_point.is_empty() {
                true => point,
                false => m.row_of_point[j * points + point] as usize,
            };
            let at = ((row * clusters + j) * width + c) * inner;
            *out += weight / total * dot(&m.coefficients[at..at + inner], &features);
        }
    }
    out
}

fn clustered(m: &Clustered, reduced: &[f64], width: usize) -> Vec<f64> {
    let z = |cluster: &Cluster| -> Vec<f64> {
        let mut features: Vec<f64> = match m.form {
            Form::Linear => reduced.to_vec(),
            Form::Quadratic => {
                let pairs =
                    (0..reduced.len()).flat_map(|i| (i..reduced.len()).map(move |j| (i, j)));
                let products = pairs.map(|(i, j)| reduced[i] * reduced[j]);
                reduced.iter().copied().chain(products).collect()
            }
            Form::Tanh => {
                let rows = cluster.hidden.chunks_exact(reduced.len() + 1);
                let sum = |row: &[f32]| dot(row, reduced) + f64::from(row[reduced.len()]);
                rows.map(|row| sum(row).tanh()).collect()
            }
        };
        features.push(1.0);
        let rows = cluster.weights.chunks_exact(features.len()).take(cluster.outputs);
        let mut z: Vec<f64> = rows.map(|row| dot(row, &features)).collect();
        z.push(1.0);
        z
    };
    let reduced: Vec<Vec<f64>> = m.clusters.iter().map(z).collect();
    let mut seen = vec![0; m.clusters.len()];
    let mut out = Vec::new();
    for &cluster in &m.cluster_of_point {
        let cluster = cluster as usize;
        let (z, basis) = (&reduced[cluster], &m.clusters[cluster].basis);
        let rows = basis.chunks_exact(z.len()).skip(seen[cluster] * width).take(width);
        out.extend(rows.map(|row| dot(row, z)));
        seen[cluster] += 1;
    }
    out
}
