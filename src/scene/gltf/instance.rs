//! Instances of a node's mesh (EXT_mesh_gpu_instancing): each becomes a node of its own below it.

use glam::{DQuat, Quat, Vec3};
use gltf::json::accessor::{ComponentType, Type};
use serde_json::Value;

use super::File;
use super::accessor::{Elements, Format};
use super::clip::QUATERNIONS;
use crate::rig::Transform;
use crate::scene::budget::Quantity;
use crate::scene::error::Error;

/// The extension's name.
pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";

const VECTORS: Format = Format { kind: Type::Vec3, components: &[(ComponentType::F32, None)] };

/// The transforms of a node's instances, or `None` where it shows its mesh once. Each counts as a
/// node of the file.
pub(super) fn read(file: &mut File, index: usize) -> Result<Option<Vec<Transform>>, Error> {
    let node = &file.root.nodes[index];
    let held = node.extensions.as_ref().and_then(|held| held.others.get(INSTANCING));
    let Some(attributes) = held.map(|held| &held["attributes"]) else { return Ok(None) };
    let place = format!("nodes[{index}].extensions.{INSTANCING}");
    if node.skin.is_some() {
        file.notices.add(format!("{place} was ignored: a skin places its mesh itself"));
        return Ok(None);
    }
    let mut count = None;
    let held = (attributes, place.as_str());
    let translations = elements(file, held, ("TRANSLATION", VECTORS), &mut count)?;
    let rotations = elements(file, held, ("ROTATION", QUATERNIONS), &mut count)?;
    let scales = elements(file, held, ("SCALE", VECTORS), &mut count)?;
    let mut instances = vec![Transform::IDENTITY; count.unwrap_or(0)];
    if let Some(elements) = translations {
        for (instance, value) in instances.iter_mut().zip(file.finite_floats::<3>(&elements)?) {
            instance.translation = Vec3::from_array(value);
        }
    }
    if let Some(elements) = rotations {
        for (instance, value) in instances.iter_mut().zip(file.finite_floats::<4>(&elements)?) {
            let quaternion = DQuat::from_array(value.map(f64::from));
            if quaternion.length() == 0.0 {
                return Err(Error::invalid(&place, "a quaternion is zero"));
            }
            let unit = quaternion.normalize().to_array().map(|value| value as f32);
            instance.rotation = Quat::from_array(unit);
        }
    }
    if let Some(elements) = scales {
        for (instance, value) in instances.iter_mut().zip(file.finite_floats::<3>(&elements)?) {
            instance.scale = Vec3::from_array(value);
        }
    }
    if instances.is_empty() {
        file.notices.add(format!("{place} has no instances; its mesh is not shown"));
    }
    Ok(Some(instances))
}

/// An attribute, if there is one; all have as many elements.
fn elements<'a>(
    file: &mut File<'a, '_>,
    (attributes, place): (&Value, &str),
    (name, format): (&str, Format),
    count: &mut Option<usize>,
) -> Result<Option<Elements<'a>>, Error> {
    let Some(accessor) = attributes.get(name) else { return Ok(None) };
    let accessor = accessor.as_u64().and_then(|accessor| usize::try_from(accessor).ok());
    let fault = || Error::invalid(place, format!("its {name} names no accessor"));
    let elements = file.accessor(accessor.ok_or_else(fault)?, place, format)?;
    if count.is_none() {
        file.budget.take(Quantity::Nodes, elements.count as u64, place)?;
    }
    let first = *count.get_or_insert(elements.count);
    if elements.count != first {
        let fault = format!("it has {} of {name} but {first} of another", elements.count);
        return Err(Error::invalid(place, fault));
    }
    Ok(Some(elements))
}
