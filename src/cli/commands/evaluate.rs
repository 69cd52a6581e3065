//! `poselight evaluate`: a model at poses.

use std::path::Path;

use anyhow::{Context, bail, ensure};
use glam::Vec3;
use serde_json::json;

use crate::cli::args::EvaluateArgs;
use crate::cli::{Answer, files as arrays};
use crate::model::{Frame, Model, PosedInput, Signal, Surface};
use crate::pipeline::{self, files};
use crate::pose;
use crate::rig::{self, Deformed, Pose};
use crate::scene::Scene;

/// One pose as the model takes it.
pub(super) struct Query {
    parameters: Vec<f32>,
    /// Absent where only parameters are known: the values then stay in the model's frame.
    pose: Option<Pose>,
    /// Where the model looks at the posed mesh: its points in the root frame.
    surface: Option<Deformed>,
}

pub(in crate::cli) fn evaluate(args: &EvaluateArgs) -> anyhow::Result<Answer> {
    let model = Model::from_bytes(&files::read(&args.model, super::MOST_MODEL_BYTES)?)?;
    let queries = match (&args.parameters, &args.scene, &args.clip) {
        (Some(path), _, _) => from_parameters(&model, path)?,
        (None, Some(scene), Some(clip)) => from_clip(&model, scene, clip, args.fps)?,
        _ => bail!("give --parameters, or --scene with --clip"),
    };
    let light = args.light.as_deref().map(|path| read_light(&model, path)).transpose()?;
    let turned = model.header().frame == Frame::Root
        || model.header().signal == Signal::Ao
        || queries.iter().all(|query| query.pose.is_some());
    if light.is_some() && !turned {
        bail!("the model is in the bone frame: a light needs poses, so give --scene and --clip");
    }
    let mut values = Vec::new();
    let mut furthest = (0.0_f32, 0.0_f32);
    for query in &queries {
        let distance = model.distance(&query.parameters)?;
        furthest = (furthest.0.max(distance.mahalanobis), furthest.1.max(distance.residual));
        let coefficients = coefficients(&model, query)?;
        let points = light.as_ref().map_or(coefficients.clone(), |light| {
            shade(&coefficients, light, usize::from(model.header().channels))
        });
        spread(&model, &points, &mut values);
    }
    let shape = shape(&model, queries.len(), light.as_ref());
    arrays::write_npy(&args.output, &shape, &values)?;
    let frame = if turned { "root" } else { "bone" };
    let text = format!(
        "{} {shape:?} in the {frame} frame; furthest from the training poses: {:.2} deviations within, {:.4} outside of their span",
        args.output.display(),
        furthest.0,
        furthest.1
    );
    let json = json!({
        "output": args.output,
        "shape": shape,
        "frame": frame,
        "mahalanobis_max": furthest.0,
        "residual_max": furthest.1,
    });
    Ok(Answer::new(text, json))
}

fn from_parameters(model: &Model, path: &Path) -> anyhow::Result<Vec<Query>> {
    let (shape, values) = arrays::read_npy(path)?;
    let width = model.header().parameters();
    ensure!(
        !model.needs_surface(),
        "the model looks at the posed mesh, which parameters alone do not give: name a scene with \
         --scene and --clip"
    );
    ensure!(
        shape.len() == 2 && shape[1] == width && width > 0,
        "{} has shape {shape:?}, the model takes [pose, {width}]",
        path.display()
    );
    let rows = values.chunks_exact(width);
    let query = |row: &[f32]| Query { parameters: row.to_vec(), pose: None, surface: None };
    Ok(rows.map(query).collect())
}

fn from_clip(model: &Model, path: &Path, name: &str, fps: f32) -> anyhow::Result<Vec<Query>> {
    ensure!((0.1..=1000.0).contains(&fps), "--fps is {fps}; it must be 0.1 to 1000");
    let scene = pipeline::import(path)?;
    let clip = scene.clips.iter().find(|clip| clip.name == name).with_context(|| {
        let names: Vec<&str> = scene.clips.iter().map(|clip| clip.name.as_str()).collect();
        format!("{} has no clip `{name}`; it has {}", path.display(), names.join(", "))
    })?;
    let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let frames = (clip.duration_s * fps).floor() as usize + 1;
    (0..frames)
        .map(|frame| query(model, &scene, &pose::evaluate(clip, frame as f32 / fps, &rest)))
        .collect()
}

/// A pose of the scene as the model takes it.
pub(super) fn query(model: &Model, scene: &Scene, of_scene: &Pose) -> anyhow::Result<Query> {
    let order = node_order(model, scene)?;
    let local = order.iter().map(|&node| of_scene.local[node]).collect();
    let pose = Pose { local, weights: of_scene.weights.clone() };
    let surface = model.needs_surface().then(|| surface(model, scene, of_scene, &pose));
    let parameters = model.parameters_of_pose(&pose)?;
    Ok(Query { parameters, surface: surface.transpose()?, pose: Some(pose) })
}

/// The model's points as the scene poses them, in the root frame. `of_scene` has the scene's order
/// of nodes, `pose` the model's.
fn surface(model: &Model, scene: &Scene, of_scene: &Pose, pose: &Pose) -> anyhow::Result<Deformed> {
    let vertices = model.header().mesh.vertices as usize;
    ensure!(
        scene.mesh.positions.len() == vertices,
        "the scene has {} vertices, but the model is of a mesh with {vertices}",
        scene.mesh.positions.len()
    );
    let globals = scene.skeleton.globals(&of_scene.local);
    let mut deformed = Deformed::default();
    let root = model.root_frame_of(pose)?;
    rig::deform(&scene.mesh, &globals, &of_scene.weights, root, &mut deformed);
    let mut points = Deformed {
        positions: vec![Vec3::ZERO; model.shape().points],
        normals: vec![Vec3::Y; model.shape().points],
    };
    for (vertex, &point) in model.point_of_vertex().iter().enumerate() {
        points.positions[point as usize] = deformed.positions[vertex];
        points.normals[point as usize] = deformed.normals[vertex];
    }
    Ok(points)
}

/// The scene's node for each of the model's.
fn node_order(model: &Model, scene: &Scene) -> anyhow::Result<Vec<usize>> {
    let nodes = model.header().rig.nodes.iter();
    nodes
        .map(|node| {
            scene.skeleton.find(&node.name).with_context(|| {
                format!("the scene has no node `{}`, which the model's rig has", node.name)
            })
        })
        .collect()
}

pub(super) fn coefficients(model: &Model, query: &Query) -> anyhow::Result<Vec<f32>> {
    let header = model.header();
    let mut out = vec![0.0; header.mesh.points as usize * header.width()];
    let Some(pose) = &query.pose else {
        model.evaluate(&query.parameters, None, &mut out)?;
        return Ok(out);
    };
    let surface = query
        .surface
        .as_ref()
        .map(|points| Surface { positions: &points.positions, normals: &points.normals });
    let input = PosedInput {
        parameters: &query.parameters,
        bone_rotations: &model.bone_rotations_of(pose)?,
        surface,
    };
    model.evaluate_posed(&input, &mut out)?;
    Ok(out)
}

/// A light's coefficients by colour.
struct Light {
    colours: Vec<Vec<f32>>,
}

fn read_light(model: &Model, path: &Path) -> anyhow::Result<Light> {
    let header = model.header();
    if header.signal == Signal::Visibility {
        bail!("a model of `visibility` has no shading; `transfer` and `ao` fold a light");
    }
    let (shape, values) = arrays::read_npy(path)?;
    let n = header.coefficients();
    let colours = match shape.as_slice() {
        [found] if *found == n => 1,
        [found, 3] if *found == n => 3,
        _ => bail!("{} has shape {shape:?}, the model takes [{n}] or [{n}, 3]", path.display()),
    };
    ensure!(values.iter().all(|v| v.is_finite()), "{} is not finite everywhere", path.display());
    let colour = |c: usize| values.iter().skip(c).step_by(colours).copied().collect();
    Ok(Light { colours: (0..colours).map(colour).collect() })
}

/// `[point, channel, coefficient]` to `[point, colour]`: a light of one colour lights each channel,
/// a coloured one its own.
fn shade(coefficients: &[f32], light: &Light, channels: usize) -> Vec<f32> {
    let n = light.colours[0].len();
    let colours = channels.max(light.colours.len());
    let dot = |row: &[f32], colour: usize| -> f32 {
        let light = &light.colours[colour.min(light.colours.len() - 1)];
        let own = &row[colour.min(channels - 1) * n..][..n];
        own.iter().zip(light).map(|(t, l)| t * l).sum()
    };
    let rows = coefficients.chunks_exact(n * channels);
    rows.flat_map(|row| (0..colours).map(move |colour| dot(row, colour))).collect()
}

/// Points to the vertices that they stand for.
pub(super) fn spread(model: &Model, points: &[f32], out: &mut Vec<f32>) {
    let width = points.len() / model.header().mesh.points as usize;
    for &point in model.point_of_vertex() {
        out.extend_from_slice(&points[point as usize * width..][..width]);
    }
}

fn shape(model: &Model, poses: usize, light: Option<&Light>) -> Vec<usize> {
    let header = model.header();
    let channels = usize::from(header.channels);
    let mut shape = vec![poses, header.mesh.vertices as usize];
    match light {
        Some(light) => shape.push(channels.max(light.colours.len())),
        None => shape.extend([channels, header.coefficients()]),
    }
    shape
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One-channel transfer under a coloured light gives a colour each; a grey light lights every
    /// channel alike.
    #[test]
    fn shading_pairs_channels_with_colours() {
        let light = Light { colours: vec![vec![1.0, 0.0], vec![0.0, 1.0], vec![1.0, 1.0]] };
        assert_eq!(shade(&[2.0, 3.0], &light, 1), [2.0, 3.0, 5.0]);
        let grey = Light { colours: vec![vec![1.0, 1.0]] };
        assert_eq!(shade(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &grey, 3), [3.0, 7.0, 11.0]);
    }
}
