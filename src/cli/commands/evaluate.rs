//! `poselight evaluate`: a model at poses.

use std::path::Path;

use anyhow::{bail, ensure};
use glam::Vec3;
use serde_json::{Value, json};

use crate::cli::args::EvaluateArgs;
use crate::cli::{Answer, files as arrays, light_source};
use crate::model::{Frame, Model, Signal};
use crate::pipeline::{
    self, EvaluateError, GLOSS_LOBES, GLOSS_TERMS, Gloss, Light, Query, Scene, Valued,
};
use crate::rig::{Part, Pose};
use crate::sh::{Order, bent_normal};

pub(in crate::cli) fn evaluate(args: &EvaluateArgs) -> anyhow::Result<Answer> {
    super::named(&args.output, "npy")?;
    let model = super::read_model(&args.model)?.0;
    let scene = args.scene.as_deref().map(pipeline::import).transpose()?;
    let valued = scene.as_ref().map(|scene| pipeline::valued(&model, scene));
    let valued = match valued.transpose() {
        Err(other @ EvaluateError::OtherMesh { .. }) => return Err(other.into()),
        // The motion of another mesh on the same rig will do where the model does not look at the mesh.
        valued => valued.ok().flatten(),
    };
    let posed = valued.as_ref().map(|valued| valued.scene.as_ref()).or(scene.as_ref());
    let queries = match (&args.parameters, posed, &args.clip) {
        (Some(path), _, _) => from_parameters(&model, path)?,
        (None, Some(scene), Some(clip)) => from_clip(&model, scene, clip, args.fps)?,
        (None, Some(scene), None) => vec![at_rest(&model, scene)?],
        (None, None, _) => bail!("give --parameters or --scene"),
    };
    if let Some(brdf) = &args.brdf {
        return reflect(args, (&model, posed), brdf, queries);
    }
    let light = args.light.as_deref().map(|source| read_light(&model, source)).transpose()?;
    let mut values = Vec::new();
    let (mut furthest, mut outside) = ((0.0_f32, 0.0_f32), 0.0_f32);
    for query in &queries {
        let distance = query.distance(&model)?;
        furthest = (furthest.0.max(distance.mahalanobis), furthest.1.max(distance.residual));
        outside = outside.max(query.values(&model, light.as_ref(), None, &mut values)?);
    }
    let mut shape = shape(&model, queries.len(), light.as_ref());
    if args.bent_normals {
        super::apply::bendable(&model)?;
        let of = |row: &[f32]| bent_normal(row).to_array();
        values = values.chunks_exact(model.header().width()).flat_map(of).collect();
        shape = vec![shape[0], shape[1], 3];
    }
    arrays::write_npy(&args.output, &shape, &values)?;
    let turned = queries.iter().all(|query| query.is_turned(&model));
    let frame = if turned { Frame::Root } else { model.header().frame };
    let mut text = format!(
        "{} {shape:?} in the {frame} frame; furthest from the training poses: {:.2} deviations within, {:.4} outside of their span",
        args.output.display(),
        furthest.0,
        furthest.1
    );
    if outside > 0.0 {
        text += &format!("; brought within [0, 1] from up to {outside:.4} outside");
    }
    let rows = valued.as_ref().filter(|valued| valued.taken > 0 || valued.receivers > 0);
    if let Some(valued) = rows {
        text += &format!("\n  {}", told(valued));
    }
    if scene.is_some() && valued.is_none() {
        text += "\n  rows: the model's own vertices, in the order of the scene that it was made of; this one \
                 has others, and gives the motion alone";
    }
    let json = json!({
        "output": args.output,
        "shape": shape,
        "rows": rows.map(rows_of),
        "frame": frame.name(),
        "mahalanobis_max": furthest.0,
        "residual_max": furthest.1,
        "outside_max": outside,
    });
    Ok(Answer::new(text, json))
}

/// Radiance towards an eye.
fn reflect(
    args: &EvaluateArgs,
    (model, scene): (&Model, Option<&Scene>),
    brdf: &str,
    queries: Vec<Query>,
) -> anyhow::Result<Answer> {
    let (Some(light), Some(eye), Some(scene)) = (&args.light, &args.eye, scene) else {
        bail!("--brdf wants --light, --eye and --scene");
    };
    let order = Order::new(model.header().order)?;
    let read = light_source::read_light(light, order, 0.0)?;
    read.notices.iter().for_each(|notice| tracing::warn!("{notice}"));
    let mut notices = read.notices;
    let finish = super::brdf::finish(brdf, &mut notices)?;
    let reflector = finish.operator(brdf, order, GLOSS_TERMS)?;
    let gloss = Gloss::new(model, &read.light, reflector, GLOSS_LOBES)?;
    gloss.check_grain(model)?;
    let eye = Vec3::from_slice(eye);
    ensure!(eye.is_finite(), "--eye is no place");
    let (count, mut values) = (queries.len(), Vec::new());
    for query in queries {
        query.posed(model, Some(scene))?.reflected(
            model,
            (&gloss, eye, None),
            None,
            &mut values,
        )?;
    }
    let shape = vec![count, model.header().mesh.vertices as usize, 3];
    arrays::write_npy(&args.output, &shape, &values)?;
    let text = format!(
        "{} {shape:?}: radiance towards the eye; the lobes leave {:.2} % of the light's energy out",
        args.output.display(),
        100.0 * gloss.residual()
    );
    let json = json!({
        "output": args.output,
        "shape": shape,
        "frame": "root",
        "light_residual_energy": gloss.residual(),
        "notices": notices,
    });
    Ok(Answer::new(text, json))
}

fn from_parameters(model: &Model, path: &Path) -> anyhow::Result<Vec<Query>> {
    let (shape, values) = arrays::read_npy(path)?;
    let width = model.header().parameters();
    ensure!(
        shape.len() == 2 && shape[1] == width && width > 0,
        "{} has shape {shape:?}, the model takes [pose, {width}]",
        path.display()
    );
    let rows = values.chunks_exact(width);
    Ok(rows.map(|row| Query::from_parameters(model, row)).collect::<Result<_, _>>()?)
}

fn from_clip(model: &Model, scene: &Scene, name: &str, fps: f32) -> anyhow::Result<Vec<Query>> {
    ensure!((0.1..=1000.0).contains(&fps), "--fps is {fps}; it must be 0.1 to 1000");
    let times = Query::times_of(scene, name, fps);
    Ok(Query::from_clip(model, scene, name, times)?)
}

fn at_rest(model: &Model, scene: &Scene) -> anyhow::Result<Query> {
    let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    Ok(Query::from_pose(model, scene, &rest)?)
}

/// Whose the rows are, where they are not the vertices of the scene one by one.
fn told(valued: &Valued<'_>) -> String {
    let own = valued.scene.mesh.positions.len();
    let mut text = format!("rows: {own} vertices of the scene");
    if valued.taken > 0 {
        text += &format!(", without the {} that only block", valued.taken);
    }
    if valued.receivers > 0 {
        text += &format!("; then {} of the receivers", valued.receivers);
    }
    text
}

/// The same by mesh: rows from `row` on are the scene's vertices from `vertex` on.
fn rows_of(valued: &Valued<'_>) -> Value {
    let of = |(part, &vertex): (&Part, &usize)| {
        let (row, count) = (part.vertices.start, part.vertices.len());
        json!({ "mesh": part.name, "row": row, "vertex": vertex, "vertices": count })
    };
    let parts = valued.scene.mesh.parts.iter().zip(&valued.first_vertices);
    let parts: Vec<Value> = parts.map(of).collect();
    json!({ "scene": parts, "receivers": valued.receivers })
}

fn read_light(model: &Model, source: &str) -> anyhow::Result<Light> {
    let header = model.header();
    if light_source::is_array(source) {
        let colours = light_source::read_array(Path::new(source), header.coefficients())?;
        return Ok(Light::new(model, colours)?);
    }
    let is_ao = header.signal == Signal::Ao;
    ensure!(
        !is_ao,
        "ambient occlusion meets no direction of light: give an array [1] or [1, 3] (.npy)"
    );
    let read = light_source::read_light(source, Order::new(header.order)?, 0.0)?;
    read.notices.iter().for_each(|notice| tracing::warn!("{notice}"));
    let colour = |values: &Vec<f64>| values.iter().map(|&value| value as f32).collect();
    Ok(Light::new(model, read.light.colours().iter().map(colour).collect())?)
}

fn shape(model: &Model, poses: usize, light: Option<&Light>) -> Vec<usize> {
    let header = model.header();
    let mut shape = vec![poses, header.mesh.vertices as usize];
    match light {
        Some(light) => shape.push(light.colours(model)),
        None => shape.extend([usize::from(header.channels), header.coefficients()]),
    }
    shape
}
