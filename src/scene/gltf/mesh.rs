//! Meshes: every primitive of every shown node becomes one part.

use std::ops::Range;

use glam::Vec3;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::File;
use super::accessor::{Elements, Format};
use super::node::{Graph, shorten};
use super::skin::{Deformers, Influences, Joints, influences};
use super::{extension, morph, topology};
use crate::rig::{Influence, Mesh, Part};
use crate::scene::budget::Quantity;
use crate::scene::error::Error;
use crate::scene::normals;

/// The scene's geometry, and which weight slots each of the file's nodes has.
pub(super) struct Built {
    pub(super) mesh: Mesh,
    pub(super) slots: Vec<Range<usize>>,
}

/// KHR_mesh_quantization lets positions and normals be small integers.
const POSITIONS: Format = morph::DELTAS;
const NORMALS: Format = Format {
    kind: Type::Vec3,
    components: &[
        (ComponentType::F32, None),
        (ComponentType::I8, Some(true)),
        (ComponentType::I16, Some(true)),
    ],
};
const INDICES: Format = Format {
    kind: Type::Scalar,
    components: &[
        (ComponentType::U8, Some(false)),
        (ComponentType::U16, Some(false)),
        (ComponentType::U32, Some(false)),
    ],
};

/// What the primitives of one node have in common.
struct Carrier {
    /// In the skeleton.
    node: usize,
    /// In the file.
    source_node: usize,
    name: String,
    /// Where the node has a skin.
    skin: Option<Joints>,
    /// The deformer of parts without weights, made when the first such part comes.
    rigid: Option<u32>,
    slots: Range<usize>,
}

/// Reads the meshes of all shown nodes, in the file's order of nodes.
pub(super) fn read(file: &mut File, graph: &Graph) -> Result<Built, Error> {
    let root = file.root;
    let mut mesh = Mesh { influence_starts: vec![0], ..Mesh::default() };
    let mut deformers = Deformers::new(root.skins.len());
    let mut slots = vec![0..0; root.nodes.len()];
    let mut target_names: Vec<Option<Vec<String>>> = vec![None; root.meshes.len()];
    for (index, node) in root.nodes.iter().enumerate() {
        let (Some(mesh_index), true, Some(own)) =
            (node.mesh, graph.shown[index], graph.of_file[index])
        else {
            continue;
        };
        let mesh_index = mesh_index.value();
        let source = &root.meshes[mesh_index];
        let count = morph::target_count(source, mesh_index)?;
        let targets = count.saturating_mul(source.primitives.len()) as u64;
        file.budget.take(Quantity::MorphTargets, targets, &format!("meshes[{mesh_index}]"))?;
        let names =
            target_names[mesh_index].get_or_insert_with(|| morph::target_names(source, count));
        let node_name = &graph.skeleton.nodes[own].name;
        slots[index] = morph::add_slots(file, index, node_name, names, &mut mesh)?;
        let skin = match node.skin {
            Some(skin) => {
                let first_deformer = deformers.skin(file, graph, skin.value())?;
                let count = root.skins[skin.value()].joints.len();
                Some(Joints { count, first_deformer })
            }
            None => None,
        };
        let name = shorten(source.name.as_deref().unwrap_or(node_name)).to_owned();
        let slots = slots[index].clone();
        for &node in &graph.carriers[index] {
            let (name, slots) = (name.clone(), slots.clone());
            let source_node = index;
            let mut carrier = Carrier { node, source_node, name, skin, rigid: None, slots };
            for (at, primitive) in source.primitives.iter().enumerate() {
                let place = format!("meshes[{mesh_index}].primitives[{at}]");
                file.budget.take(Quantity::Parts, 1, &place)?;
                let which = (at, primitive, place.as_str());
                add_primitive(file, &mut mesh, &mut deformers, &mut carrier, which)?;
            }
        }
    }
    mesh.deformers = deformers.all;
    Ok(Built { mesh, slots })
}

/// The first fault of meshes and skins that the scene does not show: where nothing is left to
/// light, that is a better answer than the emptiness.
pub(super) fn hidden_fault(file: &mut File) -> Result<(), Error> {
    let root = file.root;
    for skin in 0..root.skins.len() {
        super::skin::inverse_binds(file, skin)?;
    }
    for (index, source) in root.meshes.iter().enumerate() {
        let slots = 0..morph::target_count(source, index)?;
        let (mut mesh, mut deformers) = (Mesh::default(), Deformers::new(0));
        let name = String::new();
        let mut carrier = Carrier { node: 0, source_node: 0, name, skin: None, rigid: None, slots };
        for (at, primitive) in source.primitives.iter().enumerate() {
            let place = format!("meshes[{index}].primitives[{at}]");
            file.budget.take(Quantity::Parts, 1, &place)?;
            add_primitive(file, &mut mesh, &mut deformers, &mut carrier, (at, primitive, &place))?;
        }
    }
    Ok(())
}

/// Reads one primitive and appends it, or says in a notice why it has no surface.
fn add_primitive(
    file: &mut File,
    mesh: &mut Mesh,
    deformers: &mut Deformers,
    carrier: &mut Carrier,
    (index, primitive, place): (usize, &Primitive, &str),
) -> Result<(), Error> {
    extension::check_primitive(file.root, primitive, place)?;
    let Checked::Valid(mode) = primitive.mode else {
        return Err(Error::invalid(format!("{place}.mode"), "it is none of glTF's"));
    };
    if topology::triangle_count(mode, 3).is_none() {
        file.notices.add(format!("{place} was left out: {mode:?} have no surface"));
        return Ok(());
    }
    let Some((positions, held)) = positions(file, primitive, place)? else { return Ok(()) };
    let first = mesh.positions.len();
    let triangles = triangles(file, primitive, mode, place, positions.len(), first)?;
    let vertices = first..first + positions.len();
    let mut normals = read_normals(file, primitive, place, positions.len())?;
    let given = normals.iter().any(|normal| *normal != Vec3::ZERO);
    let filled = normals::complete(&positions, &triangles, first as u32, &mut normals);
    if filled > 0 {
        let what = match given {
            true => "some normals are missing and were computed",
            false => "the normals are missing and were computed",
        };
        file.notices.add_alike(what, place);
    }
    let morphs = morph::read(file, primitive, place, vertices.clone(), carrier.slots.clone())?;
    let weights = bind(file, primitive, place, positions.len(), deformers, carrier)?;
    // Last, since any other fault says more than data that the file leaves out.
    held?;
    append_influences(mesh, weights, place)?;
    mesh.parts.push(Part {
        node: carrier.node,
        source_node: carrier.source_node,
        primitive: index,
        name: carrier.name.clone(),
        vertices,
        triangles: mesh.triangles.len()..mesh.triangles.len() + triangles.len(),
    });
    mesh.positions.extend(positions);
    mesh.normals.extend(normals);
    mesh.triangles.extend(triangles);
    mesh.morphs.extend(morphs);
    Ok(())
}

/// Positions, and whether the file holds their data at all.
type Positions = (Vec<Vec3>, Result<(), Error>);

/// The positions of a primitive, or `None` with a notice if there are none.
fn positions(
    file: &mut File,
    primitive: &Primitive,
    place: &str,
) -> Result<Option<Positions>, Error> {
    let Some(accessor) = primitive.attributes.get(&Checked::Valid(Semantic::Positions)) else {
        file.notices.add(format!("{place} was left out: it has no POSITION"));
        return Ok(None);
    };
    let purpose = format!("POSITION of {place}");
    let elements = file.accessor(accessor.value(), &purpose, POSITIONS)?;
    if elements.count == 0 {
        file.notices.add(format!("{place} was left out: it has no vertices"));
        return Ok(None);
    }
    file.budget.take(Quantity::Vertices, elements.count as u64, &purpose)?;
    let positions = file.finite_floats::<3>(&elements)?;
    // Morph targets over zeros hold whole shapes, and exporters state the bounds of those.
    let held = if primitive.targets.is_none() { elements.require_meant_zeros() } else { Ok(()) };
    Ok(Some((positions.into_iter().map(Vec3::from_array).collect(), held)))
}

/// The normals of a primitive; zero where there are none.
fn read_normals(
    file: &mut File,
    primitive: &Primitive,
    place: &str,
    vertices: usize,
) -> Result<Vec<Vec3>, Error> {
    let Some(accessor) = primitive.attributes.get(&Checked::Valid(Semantic::Normals)) else {
        return Ok(vec![Vec3::ZERO; vertices]);
    };
    let elements = file.accessor(accessor.value(), &format!("NORMAL of {place}"), NORMALS)?;
    check_count(&elements, vertices)?;
    let normals = file.floats::<3>(&elements)?;
    Ok(normals.into_iter().map(Vec3::from_array).collect())
}

/// The triangles of a primitive, as indices into the whole mesh.
fn triangles(
    file: &mut File,
    primitive: &Primitive,
    mode: Mode,
    place: &str,
    vertices: usize,
    first: usize,
) -> Result<Vec<[u32; 3]>, Error> {
    let corners: Vec<u32> = match primitive.indices {
        Some(accessor) => {
            let purpose = format!("{place}.indices");
            let elements = file.accessor(accessor.value(), &purpose, INDICES)?;
            let indices = file.unsigned::<1>(&elements)?;
            check_indices(file, &indices, &elements, vertices)?;
            indices.into_iter().map(|[index]| index + first as u32).collect()
        }
        None => (first..first + vertices).map(|index| index as u32).collect(),
    };
    let count = topology::triangle_count(mode, corners.len()).unwrap_or(0);
    file.budget.take(Quantity::Triangles, count as u64, place)?;
    if mode == Mode::Triangles && !corners.len().is_multiple_of(3) {
        file.notices.add(format!(
            "{place}: {} corners are no whole number of triangles; the last {} were left out",
            corners.len(),
            corners.len() % 3
        ));
    }
    Ok(topology::triangles(mode, &corners))
}

/// Every index must name a vertex. The largest value of the type restarts the primitive in some
/// APIs, and glTF forbids it; it is taken as the vertex that it names, if there is one.
fn check_indices(
    file: &mut File,
    indices: &[[u32; 1]],
    elements: &Elements,
    vertices: usize,
) -> Result<(), Error> {
    let restart = match elements.component {
        ComponentType::U8 => u32::from(u8::MAX),
        ComponentType::U16 => u32::from(u16::MAX),
        _ => u32::MAX,
    };
    let at = |found: &dyn Fn(u32) -> bool| indices.iter().position(|[index]| found(*index));
    if let Some(at) = at(&|index| index as usize >= vertices) {
        let [index] = indices[at];
        let why = if index == restart { " (primitive restart, which glTF forbids)" } else { "" };
        let fault = format!("index {at} is {index}{why}, but there are {vertices} vertices");
        return Err(Error::invalid(&elements.place, fault));
    }
    if let Some(at) = at(&|index| index == restart) {
        let place = &elements.place;
        file.notices.add(format!(
            "{place}: index {at} is {restart}, which glTF forbids; taken as that vertex, not as \
             a primitive restart"
        ));
    }
    Ok(())
}

/// The influences of a primitive: by its skin, or all by its node.
fn bind(
    file: &mut File,
    primitive: &Primitive,
    place: &str,
    vertices: usize,
    deformers: &mut Deformers,
    carrier: &mut Carrier,
) -> Result<Influences, Error> {
    if let Some(joints) = carrier.skin {
        match influences(file, primitive, place, vertices, joints)? {
            Some(influences) => return Ok(influences),
            None => file.notices.add(format!(
                "{place}: its node has a skin, but it has no JOINTS_0; it moves with the node"
            )),
        }
    }
    let deformer = *carrier.rigid.get_or_insert_with(|| deformers.rigid(carrier.node));
    let all = vec![Influence { deformer, weight: 1.0 }; vertices];
    Ok(Influences { all, counts: vec![1; vertices] })
}

fn append_influences(mesh: &mut Mesh, influences: Influences, place: &str) -> Result<(), Error> {
    let mut end = mesh.influences.len() as u32;
    if u32::try_from(mesh.influences.len() + influences.all.len()).is_err() {
        return Err(Error::invalid(place, "there are more than 2³² influences"));
    }
    for count in influences.counts {
        end += count;
        mesh.influence_starts.push(end);
    }
    mesh.influences.extend(influences.all);
    Ok(())
}

/// All attributes of a primitive have as many elements as POSITION.
pub(super) fn check_count(elements: &Elements, vertices: usize) -> Result<(), Error> {
    if elements.count == vertices {
        return Ok(());
    }
    let fault = format!("{} elements for {vertices} vertices", elements.count);
    Err(Error::invalid(&elements.place, fault))
}
