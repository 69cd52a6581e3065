//! `poselight apply`: a model's values at one pose, written into the scene's own file.

use anyhow::{Context, ensure};
use serde_json::json;

use crate::cli::Answer;
use crate::cli::args::ApplyArgs;
use crate::model::{Model, Signal};
use crate::pipeline::{self, EvaluateError, Query, files};
use crate::pose;
use crate::rig::Pose;
use crate::scene::{self, Attribute, Scene};
use crate::sh::bent_normal;

/// From a signal's first coefficient to what is open of the sky, 0 to 1: ambient occlusion is that; light of
/// radiance 1 from everywhere makes 2√π of transfer; the mean of visibility over all directions is 1/√(4π).
fn openness(signal: Signal) -> f32 {
    match signal {
        Signal::Ao => 1.0,
        Signal::Visibility => 0.282_094_8,
        Signal::Transfer => 3.544_907_7,
    }
}

pub(in crate::cli) fn apply(args: &ApplyArgs) -> anyhow::Result<Answer> {
    for output in std::iter::once(&args.output).chain(&args.receivers_output) {
        super::named(output, "glb")?;
    }
    keep_files(args)?;
    let model = super::read_model(&args.model)?.0;
    let whole = pipeline::import(&args.scene)?;
    let receivers = args.receivers.as_deref().map(pipeline::import).transpose()?;
    let valued = pipeline::valued(&model, &whole)?;
    if let Some(receivers) = &receivers {
        pipeline::check_receivers(&model, receivers)?;
    }
    let scene = valued.scene.as_ref();
    let vertices = scene.mesh.positions.len();
    let received = receivers.as_ref().map_or(0, |receivers| receivers.mesh.positions.len());
    let expected = model.header().mesh.vertices as usize;
    ensure!(
        vertices + received == expected,
        "the scene has {vertices} vertices and its receivers {received}, but the model is of a mesh \
         with {expected}"
    );
    let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let posed = match &args.clip {
        None => rest,
        Some(name) => {
            let clip = scene.clips.iter().find(|clip| clip.name == *name).ok_or_else(|| {
                let known = scene.clips.iter().map(|clip| clip.name.clone()).collect();
                EvaluateError::Clip { name: name.clone(), known }
            })?;
            ensure!(
                (0.0..=clip.duration_s).contains(&args.time),
                "clip `{name}` lasts from 0 to {} s, so there is no time {}",
                clip.duration_s,
                args.time
            );
            pose::evaluate(clip, args.time, &rest)
        }
    };
    let query = Query::from_pose(&model, scene, &posed)?;
    let mut values = Vec::new();
    query.values(&model, None, None, &mut values)?;
    let mut attributes = attributes(&model, &values, args.colour);
    if args.bent_normals {
        attributes.push(bent_normals(&model, &values)?);
    }
    let mut written = vec![(&args.output, attached(scene, &attributes, 0)?)];
    if let (Some(receivers), Some(output)) = (&receivers, &args.receivers_output) {
        written.push((output, attached(receivers, &attributes, vertices)?));
    }
    for (output, glb) in &written {
        files::publish(output, glb)?;
    }
    let names: Vec<&str> = attributes.iter().map(|attribute| attribute.name.as_str()).collect();
    let mut text = format!(
        "{} has {} at {vertices} vertices, root frame",
        args.output.display(),
        names.join(", ")
    );
    if let Some(output) = &args.receivers_output {
        text += &format!("; so has {} at {received}", output.display());
    }
    if valued.taken > 0 {
        text += &format!("; {} vertices that only block have none", valued.taken);
    }
    let json = json!({
        "output": args.output,
        "attributes": names,
        "vertices": vertices,
        "vertices_without": valued.taken,
    });
    Ok(Answer::new(text, json))
}

/// Refuses outputs that would replace what is read, or one another.
fn keep_files(args: &ApplyArgs) -> Result<(), super::Usage> {
    let mut inputs = vec![("model", args.model.as_path()), ("scene", args.scene.as_path())];
    inputs.extend(args.receivers.as_deref().map(|path| ("receivers' scene", path)));
    let mut outputs = vec![("the output", args.output.as_path())];
    outputs.extend(args.receivers_output.as_deref().map(|path| ("--receivers-output", path)));
    super::keep_apart(&inputs, &outputs)
}

/// The file of a scene whose first vertex is the model's vertex `first`, with its share of the attributes.
fn attached(scene: &Scene, attributes: &[Attribute], first: usize) -> anyhow::Result<Vec<u8>> {
    let main = scene.sources.first().context("the scene has no file")?;
    let own = |attribute: &Attribute| {
        let (start, count) =
            (first * attribute.width, scene.mesh.positions.len() * attribute.width);
        Attribute { values: attribute.values[start..start + count].to_vec(), ..attribute.clone() }
    };
    let own: Vec<Attribute> = attributes.iter().map(own).collect();
    Ok(scene::attach(&main.bytes, &scene.mesh.parts, &own)?)
}

/// Whether a model's values hold bent normals.
pub(super) fn bendable(model: &Model) -> anyhow::Result<()> {
    let header = model.header();
    ensure!(
        header.signal == Signal::Transfer && header.coefficients() >= 4,
        "bent normals are part of transfer of order 2 and more; this model is of {} with {} coefficients",
        header.signal.name(),
        header.coefficients()
    );
    Ok(())
}

/// `_BENT_NORMAL`, see [`bent_normal`]. The first channel counts.
fn bent_normals(model: &Model, values: &[f32]) -> anyhow::Result<Attribute> {
    bendable(model)?;
    let of = |row: &[f32]| bent_normal(row).to_array();
    let values = values.chunks_exact(model.header().width()).flat_map(of).collect();
    Ok(Attribute { name: "_BENT_NORMAL".into(), width: 3, values })
}

/// `_AO`, or `_TRANSFER_0`, `_TRANSFER_1`, …: four numbers each of channel after channel, filled up
/// with zeros.
pub(super) fn columns(signal: Signal, width: usize, values: &[f32]) -> Vec<Attribute> {
    let prefix = match signal {
        Signal::Ao => "_AO",
        Signal::Visibility => "_VISIBILITY",
        Signal::Transfer => "_TRANSFER",
    };
    if width == 1 {
        return vec![Attribute { name: prefix.into(), width, values: values.to_vec() }];
    }
    let column = |first: usize| {
        let of = |row: &[f32]| [0, 1, 2, 3].map(|i| row.get(first + i).copied().unwrap_or(0.0));
        let values = values.chunks_exact(width).flat_map(of).collect();
        Attribute { name: format!("{prefix}_{}", first / 4), width: 4, values }
    };
    (0..width).step_by(4).map(column).collect()
}

/// A model's values, and `COLOR_0` where that is asked for.
fn attributes(model: &Model, values: &[f32], colour: bool) -> Vec<Attribute> {
    let header = model.header();
    let width = header.width();
    let mut attributes = columns(header.signal, width, values);
    if colour {
        let count = header.coefficients();
        let scale = openness(header.signal);
        let of = |row: &[f32]| {
            let channel = |c: usize| row.get(c * count).or(row.first()).copied().unwrap_or(0.0);
            [0, 1, 2].map(|c| (channel(c) * scale).clamp(0.0, 1.0))
        };
        let values = values.chunks_exact(width).flat_map(of).collect();
        attributes.push(Attribute { name: "COLOR_0".into(), width: 3, values });
    }
    attributes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Under open sky a level surface is white, whatever the signal: ambient occlusion 1, the first coefficient
    /// of its transfer 1/(2√π), and half of the visible sphere, which is 0.5. Half as much is half as bright.
    #[test]
    fn colours_are_what_is_open() {
        let root_pi = std::f32::consts::PI.sqrt();
        for (signal, first, expected) in [
            (Signal::Ao, 1.0, 1.0),
            (Signal::Transfer, 0.5 / root_pi, 1.0),
            (Signal::Visibility, root_pi, 0.5),
            (Signal::Visibility, 2.0 * root_pi, 1.0),
        ] {
            for share in [1.0, 0.5] {
                let found = share * first * openness(signal);
                assert!((found - share * expected).abs() < 1e-6, "{signal:?}: {found}");
            }
        }
    }
}
