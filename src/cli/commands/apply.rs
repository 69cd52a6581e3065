//! `poselight apply`: a model's values at one pose, written into the scene's own file.

use anyhow::{Context, ensure};
use glam::Vec3;
use serde_json::json;

use crate::cli::Answer;
use crate::cli::args::ApplyArgs;
use crate::model::{Model, Signal};
use crate::pipeline::{self, EvaluateError, Query, files};
use crate::pose;
use crate::rig::Pose;
use crate::scene::{self, Attribute};

/// 2√π: from a transfer's first coefficient to what ambient light of radiance 1 makes of it.
const AMBIENT: f32 = 3.544_907_7;

pub(in crate::cli) fn apply(args: &ApplyArgs) -> anyhow::Result<Answer> {
    let model = Model::from_bytes(&files::read(&args.model, super::MOST_MODEL_BYTES)?)?;
    let scene = pipeline::import(&args.scene)?;
    let vertices = scene.mesh.positions.len();
    let expected = model.header().mesh.vertices as usize;
    ensure!(
        vertices == expected,
        "the scene has {vertices} vertices, but the model is of a mesh with {expected}"
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
    let query = Query::from_pose(&model, &scene, &posed)?;
    let mut values = Vec::new();
    query.values(&model, None, None, &mut values)?;
    let mut attributes = attributes(&model, &values, args.colour);
    if args.bent_normals {
        attributes.push(bent_normals(&model, &values)?);
    }
    let main = scene.sources.first().context("the scene has no file")?;
    let glb = scene::attach(&main.bytes, &scene.mesh.parts, &attributes)?;
    files::publish(&args.output, &glb)?;
    let names: Vec<&str> = attributes.iter().map(|attribute| attribute.name.as_str()).collect();
    let text = format!(
        "{} has {} at {vertices} vertices, root frame",
        args.output.display(),
        names.join(", ")
    );
    Ok(Answer::new(text, json!({ "output": args.output, "attributes": names })))
}

/// `_BENT_NORMAL`: ∫ V (n·ω)₊ ω dω made unit. Band 1 of transfer holds it but for a factor: the
/// coefficients of y, z and x. The first channel counts; a point without light has no direction, 0.
fn bent_normals(model: &Model, values: &[f32]) -> anyhow::Result<Attribute> {
    let header = model.header();
    ensure!(
        header.signal == Signal::Transfer && header.coefficients() >= 4,
        "bent normals are part of transfer of order 2 and more; this model is of {} with {} coefficients",
        header.signal.name(),
        header.coefficients()
    );
    let of = |row: &[f32]| bent(row).to_array();
    let values = values.chunks_exact(header.width()).flat_map(of).collect();
    Ok(Attribute { name: "_BENT_NORMAL".into(), width: 3, values })
}

/// The direction in a row of coefficients.
fn bent(row: &[f32]) -> Vec3 {
    Vec3::new(row[3], row[1], row[2]).normalize_or_zero()
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
        let scale = if header.signal == Signal::Ao { 1.0 } else { AMBIENT };
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
    use crate::sh::{Order, zonal};

    /// The unshadowed transfer of a normal bends to that normal: y₁ = (y, z, x) is taken apart in the
    /// right order.
    #[test]
    fn nothing_blocked_bends_nothing() {
        let order = Order::new(2).unwrap();
        let normal = Vec3::new(0.6, -0.48, 0.64);
        let mut row = [0.0; 4];
        zonal::rotate(order, &zonal::unshadowed(order), normal, &mut row);
        assert!((bent(&row) - normal).length() < 1e-5, "{}", bent(&row));
        assert_eq!(bent(&[0.0; 4]), Vec3::ZERO);
    }
}
