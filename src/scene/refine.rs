//! Primitives with more vertices and triangles written into a GLB, everything else as it was.

use std::collections::BTreeMap;

use glam::Vec3;
use serde_json::{Value, json};

use super::Error;
use super::attach::{Origin, origins};
use super::container::{ARRAY_BUFFER, INDEX_BUFFER, finish, open, push, push_view};
use super::elements::{Elements, FLOAT, bytes_of};
use crate::rig::{Influence, Mesh, Mix, Part};

/// What becomes of one part, and with it of every part of the same primitive.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedPart {
    /// Index into [`Mesh::parts`].
    pub part: usize,
    /// Vertices that follow the part's own, between vertices numbered from the part's first.
    pub added: Vec<Mix>,
    /// What moves each of them; empty for a part without a skin.
    pub influences: Vec<Vec<Influence>>,
    /// How far each of them lies from the place between those vertices, metres in the mesh's space;
    /// empty where all are there.
    pub moved: Vec<Vec3>,
    /// Corners, numbered from the part's first vertex.
    pub triangles: Vec<[u32; 3]>,
}

/// For each part the first that comes from the same primitive of the file, and the file's mesh.
///
/// # Errors
/// [`Error::Glb`] where the file is no GLB with a binary chunk; [`Error::Invalid`] where it is not
/// the scene's.
pub fn primitives(glb: &[u8], parts: &[Part]) -> Result<Vec<(usize, usize)>, Error> {
    let (document, _) = open(glb)?;
    let origins = origins(&document, parts)?;
    let mut first = BTreeMap::new();
    let one = |(part, origin): (usize, &Origin)| {
        (*first.entry((origin.mesh, origin.primitive)).or_insert(part), origin.mesh)
    };
    Ok(origins.iter().enumerate().map(one).collect())
}

/// Writes refined parts. Attributes of new vertices lie between those of the old: positions, texture
/// coordinates, colours, weights and morph deltas linearly, normals and tangents made unit, integers
/// that are no fractions (identifiers) from the heaviest vertex. What was replaced stays in the binary
/// chunk, unused.
///
/// # Errors
/// [`Error::Glb`], [`Error::Invalid`] where the file is not the scene's, or an attribute cannot be read.
pub fn refine(glb: &[u8], mesh: &Mesh, refined: &[RefinedPart]) -> Result<Vec<u8>, Error> {
    let (mut document, mut binary) = open(glb)?;
    let origins = origins(&document, &mesh.parts)?;
    for part in refined {
        let origin = origins[part.part];
        let mut primitive = document["meshes"][origin.mesh]["primitives"][origin.primitive].take();
        let mut file = File { document: &mut document, binary: &mut binary };
        file.attributes(&mut primitive["attributes"], mesh, part)?;
        // Asked for by index, a value that is not there would come to be.
        let targets = primitive.get_mut("targets").and_then(Value::as_array_mut);
        for target in targets.into_iter().flatten() {
            file.deltas(target, mesh, part)?;
        }
        primitive["indices"] = json!(file.indices(mesh, part)?);
        if let Some(primitive) = primitive.as_object_mut() {
            // Strips and fans were taken apart.
            primitive.remove("mode");
        }
        document["meshes"][origin.mesh]["primitives"][origin.primitive] = primitive;
    }
    finish(document, binary)
}

struct File<'a> {
    document: &'a mut Value,
    binary: &'a mut Vec<u8>,
}

impl File<'_> {
    fn attributes(
        &mut self,
        attributes: &mut Value,
        mesh: &Mesh,
        part: &RefinedPart,
    ) -> Result<(), Error> {
        let count = mesh.parts[part.part].vertices.len();
        let mut skin = Skin::default();
        for (name, accessor) in attributes.as_object_mut().into_iter().flatten() {
            let index = accessor.as_u64().unwrap_or(u64::MAX) as usize;
            let elements = Elements::read(self.document, self.binary, index, count)?;
            if let Some(set) = name.strip_prefix("JOINTS_") {
                skin.joints.push((set.to_owned(), elements));
            } else if let Some(set) = name.strip_prefix("WEIGHTS_") {
                skin.weights.push((set.to_owned(), elements));
            } else {
                let (component, mut values) = extend(name, &elements, &part.added);
                if name == "POSITION" {
                    let added = values.iter_mut().skip(elements.values.len());
                    let moved = part.moved.iter().flat_map(|moved| moved.to_array());
                    added.zip(moved).for_each(|(value, moved)| *value += f64::from(moved));
                }
                *accessor = json!(self.accessor(name, component, elements.width, &values)?);
            }
        }
        if skin.joints.is_empty() || part.influences.is_empty() {
            return Ok(());
        }
        skin.extend(mesh, part)?;
        for (prefix, sets) in [("JOINTS_", skin.joints), ("WEIGHTS_", skin.weights)] {
            for (set, elements) in sets {
                let name = format!("{prefix}{set}");
                let component = if prefix == "JOINTS_" { elements.component } else { FLOAT };
                let accessor = self.accessor(&name, component, elements.width, &elements.values)?;
                attributes[&name] = json!(accessor);
            }
        }
        Ok(())
    }

    /// The deltas of one morph target.
    fn deltas(&mut self, target: &mut Value, mesh: &Mesh, part: &RefinedPart) -> Result<(), Error> {
        let count = mesh.parts[part.part].vertices.len();
        for (name, accessor) in target.as_object_mut().into_iter().flatten() {
            let index = accessor.as_u64().unwrap_or(u64::MAX) as usize;
            let elements = Elements::read(self.document, self.binary, index, count)?;
            let mut values = elements.values.clone();
            values.extend(part.added.iter().flat_map(|mix| mixed(&elements, mix)));
            *accessor = json!(self.accessor(name, FLOAT, elements.width, &values)?);
        }
        Ok(())
    }

    fn accessor(
        &mut self,
        name: &str,
        component: u64,
        width: usize,
        values: &[f64],
    ) -> Result<usize, Error> {
        let mut bytes = bytes_of(component, values);
        let element = bytes.len() / (values.len() / width).max(1);
        let stride = element.next_multiple_of(4);
        if stride != element {
            // Each element of an attribute starts at a multiple of four bytes.
            let pad = |element: &[u8]| {
                let mut padded = element.to_vec();
                padded.resize(stride, 0);
                padded
            };
            bytes = bytes.chunks_exact(element).flat_map(pad).collect();
        }
        let view = push_view(self.document, self.binary, &bytes, ARRAY_BUFFER)?;
        if stride != element {
            self.document["bufferViews"][view]["byteStride"] = json!(stride);
        }
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
        let mut accessor = json!({
            "bufferView": view, "componentType": component, "count": values.len() / width, "type": kind,
        });
        if name == "POSITION" {
            let edge = |start: f32, better: fn(f32, f32) -> f32| {
                let of = |axis: usize| {
                    values.iter().skip(axis).step_by(width).map(|&x| x as f32).fold(start, better)
                };
                (0..width).map(of).collect::<Vec<f32>>()
            };
            accessor["min"] = json!(edge(f32::INFINITY, f32::min));
            accessor["max"] = json!(edge(f32::NEG_INFINITY, f32::max));
        }
        push(self.document, "accessors", accessor)
    }

    fn indices(&mut self, mesh: &Mesh, part: &RefinedPart) -> Result<usize, Error> {
        let vertices = mesh.parts[part.part].vertices.len() + part.added.len();
        let corners: Vec<f64> = part.triangles.iter().flatten().map(|&v| f64::from(v)).collect();
        // The largest number of each type restarts a primitive.
        let component = if vertices < 65_535 { 5123 } else { 5125 };
        let bytes = bytes_of(component, &corners);
        let view = push_view(self.document, self.binary, &bytes, INDEX_BUFFER)?;
        let accessor = json!({
            "bufferView": view, "componentType": component, "count": corners.len(), "type": "SCALAR",
        });
        push(self.document, "accessors", accessor)
    }
}

fn mixed(elements: &Elements, mix: &Mix) -> Vec<f64> {
    let mut out = vec![0.0; elements.width];
    for (vertex, weight) in mix.parts() {
        let element = elements.element(vertex);
        out.iter_mut().zip(element).for_each(|(out, x)| *out += f64::from(weight) * x);
    }
    out
}

fn heaviest(mix: &Mix) -> usize {
    let better = |best: usize, i: usize| if mix.weights[i] > mix.weights[best] { i } else { best };
    mix.vertices[(0..3).fold(0, better)] as usize
}

/// An attribute with the new vertices behind the old, and its component type.
fn extend(name: &str, elements: &Elements, added: &[Mix]) -> (u64, Vec<f64>) {
    let whole = elements.component != FLOAT && !elements.normalized;
    let is_number = whole && name.starts_with('_');
    let one = |mix: &Mix| {
        if is_number {
            return elements.element(heaviest(mix)).to_vec();
        }
        let mut out = mixed(elements, mix);
        if matches!(name, "NORMAL" | "TANGENT") {
            let length = out[..3.min(out.len())].iter().map(|x| x * x).sum::<f64>().sqrt();
            let own = elements.element(heaviest(mix));
            if length > 0.0 {
                out.iter_mut().take(3).for_each(|x| *x /= length);
            } else {
                out.copy_from_slice(own);
            }
            // The sign of a tangent's binormal.
            if let (Some(out), Some(own)) = (out.get_mut(3), own.get(3)) {
                *out = *own;
            }
        }
        out
    };
    let mut values = elements.values.clone();
    values.extend(added.iter().flat_map(one));
    (if is_number { elements.component } else { FLOAT }, values)
}

/// The sets of joints and weights of a primitive.
#[derive(Default)]
struct Skin {
    joints: Vec<(String, Elements)>,
    weights: Vec<(String, Elements)>,
}

impl Skin {
    /// The new vertices' influences behind the old ones.
    fn extend(&mut self, mesh: &Mesh, part: &RefinedPart) -> Result<(), Error> {
        let first = self.first_deformer(mesh, &mesh.parts[part.part])?;
        for influences in &part.influences {
            let mut rest = influences.iter();
            for ((_, joints), (_, weights)) in self.joints.iter_mut().zip(&mut self.weights) {
                for _ in 0..joints.width {
                    let next = rest.next();
                    let joint = next.map_or(0.0, |one| f64::from(one.deformer) - first);
                    joints.values.push(joint);
                    weights.values.push(next.map_or(0.0, |one| f64::from(one.weight)));
                }
            }
        }
        Ok(())
    }

    /// The deformer of joint 0: those of a skin lie in the order of its joints, so the least joint
    /// that the part uses is the least deformer.
    fn first_deformer(&self, mesh: &Mesh, part: &Part) -> Result<f64, Error> {
        let used = self.joints.iter().zip(&self.weights).flat_map(|((_, joints), (_, weights))| {
            let both = joints.values.iter().zip(&weights.values);
            both.filter(|(_, weight)| **weight > 0.0).map(|(joint, _)| *joint)
        });
        let least = used.fold(f64::INFINITY, f64::min);
        let deformers = part.vertices.clone().flat_map(|vertex| mesh.influences_of(vertex));
        let deformer = deformers.map(|influence| influence.deformer).min();
        match deformer {
            Some(deformer) if least.is_finite() => Ok(f64::from(deformer) - least),
            _ => Err(Error::invalid(format!("mesh {:?}", part.name), "no vertex has a weight")),
        }
    }
}
