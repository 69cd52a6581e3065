//! Animations: samplers and channels to clips.

use std::collections::HashSet;
use std::ops::Range;

use gltf::json::accessor::{ComponentType, Type};
use gltf::json::animation as json;
use gltf::json::validation::Checked;

use super::File;
use super::accessor::{Elements, Format};
use super::node::{Graph, UniqueNames};
use crate::scene::budget::Quantity;
use crate::scene::error::Error;
use crate::scene::{Channel, Clip, Interpolation, Target};

const TIMES: Format = Format { kind: Type::Scalar, components: &[(ComponentType::F32, None)] };
const VECTORS: Format = Format { kind: Type::Vec3, components: &[(ComponentType::F32, None)] };
pub(super) const QUATERNIONS: Format = Format { kind: Type::Vec4, components: SHARES };
const WEIGHTS: Format = Format { kind: Type::Scalar, components: SHARES };
const SHARES: &[(ComponentType, Option<bool>)] = &[
    (ComponentType::F32, None),
    (ComponentType::I8, Some(true)),
    (ComponentType::U8, Some(true)),
    (ComponentType::I16, Some(true)),
    (ComponentType::U16, Some(true)),
];

/// Reads every animation that moves something of the scene. `slots`: weight slots by the file's
/// node.
pub(super) fn read(
    file: &mut File,
    graph: &Graph,
    slots: &[Range<usize>],
) -> Result<Vec<Clip>, Error> {
    let mut names = UniqueNames::default();
    let mut clips = Vec::new();
    for (index, animation) in file.root.animations.iter().enumerate() {
        let place = format!("animations[{index}]");
        let mut channels = Vec::new();
        let mut moved = HashSet::new();
        file.budget.take(Quantity::Channels, animation.channels.len() as u64, &place)?;
        for (at, channel) in animation.channels.iter().enumerate() {
            let place = format!("{place}.channels[{at}]");
            let Some(target) = target(file, graph, slots, channel, &place)? else { continue };
            let sampler = &animation.samplers[channel.sampler.value()];
            if !moved.insert((channel.target.node.value(), key(&target))) {
                file.notices.add(format!("{place} was left out: an earlier one has its target"));
                continue;
            }
            channels.push(read_channel(file, sampler, target, &place)?);
        }
        let name = names.choose(animation.name.as_deref(), || format!("clip{index}"));
        if channels.is_empty() {
            file.notices.add(format!("{place} ({name:?}) was left out: it moves nothing here"));
            continue;
        }
        let last = |channel: &Channel| channel.times_s.last().copied().unwrap_or(0.0);
        let duration_s = channels.iter().map(last).fold(0.0, f32::max);
        clips.push(Clip { name, duration_s, channels });
    }
    Ok(clips)
}

/// Tells the properties of one node apart.
fn key(target: &Target) -> u8 {
    match target {
        Target::Translation(_) => 0,
        Target::Rotation(_) => 1,
        Target::Scale(_) => 2,
        Target::Weights(_) => 3,
    }
}

/// What a channel moves, or `None` with a notice if that is nothing of this scene.
fn target(
    file: &mut File,
    graph: &Graph,
    slots: &[Range<usize>],
    channel: &json::Channel,
    place: &str,
) -> Result<Option<Target>, Error> {
    let Checked::Valid(property) = channel.target.path else {
        file.notices.add(format!("{place} was left out: its path is none of glTF's four"));
        return Ok(None);
    };
    let index = channel.target.node.value();
    let Some(node) = graph.of_file[index] else {
        file.notices.add(format!("{place} was left out: nodes[{index}] is not in the scene"));
        return Ok(None);
    };
    Ok(match property {
        json::Property::Translation => Some(Target::Translation(node)),
        json::Property::Rotation => Some(Target::Rotation(node)),
        json::Property::Scale => Some(Target::Scale(node)),
        json::Property::MorphTargetWeights if slots[index].is_empty() => {
            let why = format!("nodes[{index}] has no morph targets here");
            file.notices.add(format!("{place} was left out: {why}"));
            None
        }
        json::Property::MorphTargetWeights => Some(Target::Weights(slots[index].clone())),
    })
}

fn read_channel(
    file: &mut File,
    sampler: &json::Sampler,
    target: Target,
    place: &str,
) -> Result<Channel, Error> {
    let interpolation = match sampler.interpolation {
        Checked::Valid(json::Interpolation::Linear) => Interpolation::Linear,
        Checked::Valid(json::Interpolation::Step) => Interpolation::Step,
        Checked::Valid(json::Interpolation::CubicSpline) => Interpolation::CubicSpline,
        Checked::Invalid => {
            return Err(Error::invalid(place, "its interpolation is none of glTF's three"));
        }
    };
    let input = file.accessor(sampler.input.value(), &format!("input of {place}"), TIMES)?;
    let times_s = read_times(file, &input)?;
    let mut channel = Channel { target, interpolation, times_s, values: Vec::new() };
    let purpose = format!("output of {place}");
    channel.values = read_values(file, sampler.output.value(), &purpose, &channel)?;
    if channel.times_s.len() > 1 {
        input.require_data("zeros do not ascend")?;
    }
    check_times(&channel.times_s, &input)?;
    if matches!(channel.target, Target::Rotation(_)) {
        normalize_rotations(file, &mut channel, &purpose)?;
    }
    Ok(channel)
}

/// Key times as they are in the file, but finite.
fn read_times(file: &mut File, input: &Elements) -> Result<Vec<f32>, Error> {
    file.budget.take(Quantity::Keys, input.count as u64, &input.place)?;
    Ok(file.finite_floats::<1>(input)?.into_iter().flatten().collect())
}

/// Key times run from 0 on, ascending.
fn check_times(times: &[f32], input: &Elements) -> Result<(), Error> {
    let fault = match times.first() {
        None => Some("there are no keys".to_owned()),
        Some(first) if *first < 0.0 => Some(format!("the first key is at {first} s, before 0")),
        Some(_) => times.windows(2).position(|pair| pair[0] >= pair[1]).map(|at| {
            let (time, next) = (times[at], times[at + 1]);
            format!("key {} is at {next} s, not after the one at {time} s", at + 1)
        }),
    };
    fault.map_or(Ok(()), |fault| Err(Error::invalid(&input.place, fault)))
}

/// Key values, as many as the times, the interpolation and the target ask for.
fn read_values(
    file: &mut File,
    accessor: usize,
    purpose: &str,
    channel: &Channel,
) -> Result<Vec<f32>, Error> {
    let format = match channel.target {
        Target::Translation(_) | Target::Scale(_) => VECTORS,
        Target::Rotation(_) => QUATERNIONS,
        Target::Weights(_) => WEIGHTS,
    };
    let elements = file.accessor(accessor, purpose, format)?;
    let keys = channel.times_s.len();
    let per_key = if channel.interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    let per_value = if let Target::Weights(slots) = &channel.target { slots.len() } else { 1 };
    let expected = keys.saturating_mul(per_key).saturating_mul(per_value);
    if elements.count != expected {
        let fault = format!("{} elements for {keys} keys, which need {expected}", elements.count);
        return Err(Error::invalid(elements.place, fault));
    }
    Ok(match format.kind {
        Type::Vec3 => file.finite_floats::<3>(&elements)?.into_iter().flatten().collect(),
        Type::Vec4 => file.finite_floats::<4>(&elements)?.into_iter().flatten().collect(),
        _ => file.finite_floats::<1>(&elements)?.into_iter().flatten().collect(),
    })
}

/// Makes rotation keys unit quaternions (not those of cubic splines, whose tangents belong to
/// the values as they are) and refuses zero ones.
fn normalize_rotations(file: &mut File, channel: &mut Channel, purpose: &str) -> Result<(), Error> {
    let cubic = channel.interpolation == Interpolation::CubicSpline;
    let (step, offset) = if cubic { (12, 4) } else { (4, 0) };
    let mut worst = 1.0_f64;
    for (key, values) in channel.values.chunks_exact_mut(step).enumerate() {
        let quaternion = &mut values[offset..offset + 4];
        let square: f64 = quaternion.iter().map(|&v| f64::from(v) * f64::from(v)).sum();
        let length = square.sqrt();
        if length < 1e-6 {
            let fault = format!("the rotation of key {key} is zero");
            return Err(Error::invalid(purpose, fault));
        }
        if (length - 1.0).abs() > (worst - 1.0).abs() {
            worst = length;
        }
        if !cubic {
            quaternion.iter_mut().for_each(|v| *v = (f64::from(*v) / length) as f32);
        }
    }
    if (worst - 1.0).abs() > 0.02 {
        file.notices.add(format!(
            "{purpose}: rotations are not of unit length (one has {worst:.4}); normalised"
        ));
    }
    Ok(())
}
