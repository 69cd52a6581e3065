//! Morph targets: sparse displacements, and the slots of their weights.

use std::ops::Range;

use glam::Vec3;
use gltf::json::Index;
use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::mesh::{Mesh, Primitive};

use super::File;
use super::accessor::Format;
use super::node::{UniqueNames, shorten};
use crate::rig::MorphTarget;
use crate::scene::error::Error;

/// KHR_mesh_quantization lets deltas be small integers.
pub(super) const DELTAS: Format = Format {
    kind: Type::Vec3,
    components: &[
        (ComponentType::F32, None),
        (ComponentType::I8, None),
        (ComponentType::I16, None),
        (ComponentType::U8, None),
        (ComponentType::U16, None),
    ],
};

/// How many targets each primitive of a mesh has; they must agree.
pub(super) fn target_count(mesh: &Mesh, index: usize) -> Result<usize, Error> {
    let count = |primitive: &Primitive| primitive.targets.as_ref().map_or(0, Vec::len);
    let first = mesh.primitives.first().map_or(0, count);
    match mesh.primitives.iter().position(|primitive| count(primitive) != first) {
        None => Ok(first),
        Some(at) => Err(Error::invalid(
            format!("meshes[{index}].primitives[{at}]"),
            format!("{} morph targets; primitives[0] has {first}", count(&mesh.primitives[at])),
        )),
    }
}

/// The names of a mesh's targets, from `extras.targetNames` as most exporters write them.
pub(super) fn target_names(mesh: &Mesh, count: usize) -> Vec<String> {
    let extras = mesh.extras.as_ref().map_or("", |extras| extras.get());
    let extras: gltf::json::Value = gltf::json::deserialize::from_str(extras).unwrap_or_default();
    let named = |target: usize| extras["targetNames"][target].as_str();
    let mut names = UniqueNames::default();
    (0..count).map(|target| names.choose(named(target), || format!("morph{target}"))).collect()
}

/// Appends the weight slots of a node: names and defaults.
pub(super) fn add_slots(
    file: &File,
    node: usize,
    node_name: &str,
    target_names: &[String],
    mesh: &mut crate::rig::Mesh,
) -> Result<Range<usize>, Error> {
    let start = mesh.weight_names.len();
    let count = target_names.len();
    if count == 0 {
        return Ok(start..start);
    }
    let carrier = &file.root.nodes[node];
    let index = carrier.mesh.map_or(0, |mesh| mesh.value());
    let (weights, place) = match (&carrier.weights, &file.root.meshes[index].weights) {
        (Some(weights), _) => (weights.clone(), format!("nodes[{node}].weights")),
        (None, Some(weights)) => (weights.clone(), format!("meshes[{index}].weights")),
        (None, None) => (vec![0.0; count], String::new()),
    };
    if weights.len() != count {
        let fault = format!("{} weights for {count} morph targets", weights.len());
        return Err(Error::invalid(place, fault));
    }
    if weights.iter().any(|weight| !weight.is_finite()) {
        return Err(Error::invalid(place, "a weight is not finite"));
    }
    let named = |target: &String| format!("{node_name}/{}", shorten(target));
    mesh.weight_names.extend(target_names.iter().map(named));
    mesh.default_weights.extend(weights);
    Ok(start..start + count)
}

/// Reads the targets of one primitive; vertices without displacement are left out.
pub(super) fn read(
    file: &mut File,
    primitive: &Primitive,
    place: &str,
    vertices: Range<usize>,
    slots: Range<usize>,
) -> Result<Vec<MorphTarget>, Error> {
    let targets = primitive.targets.as_deref().unwrap_or_default();
    let mut out = Vec::with_capacity(targets.len());
    for (at, (target, weight)) in targets.iter().zip(slots).enumerate() {
        let place = format!("{place}.targets[{at}]");
        let count = vertices.len();
        let positions = deltas(file, target.positions, &format!("{place}.POSITION"), count)?;
        let normals = deltas(file, target.normals, &format!("{place}.NORMAL"), count)?;
        let moved = |list: &Option<Vec<[f32; 3]>>, vertex: usize| {
            list.as_ref().map_or(Vec3::ZERO, |list| Vec3::from_array(list[vertex]))
        };
        let mut morph = MorphTarget {
            weight,
            vertices: Vec::new(),
            position_deltas: Vec::new(),
            normal_deltas: Vec::new(),
        };
        for vertex in 0..count {
            let (position, normal) = (moved(&positions, vertex), moved(&normals, vertex));
            if position == Vec3::ZERO && normal == Vec3::ZERO {
                continue;
            }
            morph.vertices.push((vertices.start + vertex) as u32);
            morph.position_deltas.push(position);
            if normals.is_some() {
                morph.normal_deltas.push(normal);
            }
        }
        out.push(morph);
    }
    Ok(out)
}

fn deltas(
    file: &mut File,
    accessor: Option<Index<Accessor>>,
    purpose: &str,
    vertices: usize,
) -> Result<Option<Vec<[f32; 3]>>, Error> {
    let Some(accessor) = accessor else { return Ok(None) };
    let elements = file.accessor(accessor.value(), purpose, DELTAS)?;
    super::mesh::check_count(&elements, vertices)?;
    file.finite_floats(&elements).map(Some)
}
