//! Values at vertices written into a GLB, everything else of the file as it was.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::Error;
use super::container::{ARRAY_BUFFER, finish, open, push, push_view, shown};
use crate::rig::Part;

/// Values of one attribute at all vertices of the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Attribute {
    /// Such as `_AO`; glTF wants a leading underscore of what it does not define itself.
    pub name: String,
    /// Numbers per vertex, 1 to 4.
    pub width: usize,
    /// `[vertex, width]`, in the order of the imported scene.
    pub values: Vec<f32>,
}

/// Adds attributes to the primitives that `parts` of the imported scene came from.
///
/// # Errors
/// [`Error::Glb`] where the file is no GLB with a binary chunk; [`Error::Invalid`] where it is not
/// the scene's, two nodes share a mesh (which has room for the values of one), or an attribute of
/// that name is there.
pub fn attach(glb: &[u8], parts: &[Part], attributes: &[Attribute]) -> Result<Vec<u8>, Error> {
    let (mut document, mut binary) = open(glb)?;
    let targets = targets(&document, parts)?;
    for (part, (mesh, primitive)) in parts.iter().zip(targets) {
        for attribute in attributes {
            let accessor = append(&mut document, &mut binary, part, attribute)?;
            let place = format!("meshes[{mesh}].primitives[{primitive}].attributes");
            let all = document["meshes"][mesh]["primitives"][primitive]["attributes"]
                .as_object_mut()
                .ok_or_else(|| Error::invalid(&place, "it is no object"))?;
            if all.insert(attribute.name.clone(), json!(accessor)).is_some() {
                let fault = format!("there is a {} already", attribute.name);
                return Err(Error::invalid(place, fault));
            }
        }
    }
    finish(document, binary)
}

/// Where a part of the imported scene lies in its document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Origin {
    node: usize,
    pub(super) mesh: usize,
    pub(super) primitive: usize,
}

/// Where each part came from: import goes by node, by instance, then by primitive.
pub(super) fn origins(document: &Value, parts: &[Part]) -> Result<Vec<Origin>, Error> {
    let mut found = Vec::new();
    let shown = shown(document);
    let mut next = parts.iter().peekable();
    let nodes = document["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    for (index, node) in nodes.iter().enumerate() {
        let Some(&number) = shown.get(&index) else { continue };
        let Some(mesh) = node["mesh"].as_u64().map(|mesh| mesh as usize) else { continue };
        let instanced = !node["extensions"]["EXT_mesh_gpu_instancing"].is_null();
        let primitives = document["meshes"][mesh]["primitives"].as_array();
        loop {
            let before = found.len();
            for (at, primitive) in primitives.into_iter().flatten().enumerate() {
                let positions = primitive["attributes"]["POSITION"].as_u64();
                let count =
                    positions.and_then(|p| document["accessors"][p as usize]["count"].as_u64());
                let same = |part: &&Part| {
                    let here = instanced || part.node == number;
                    let size = part.vertices.len() as u64;
                    here && part.primitive == at && count == Some(size)
                };
                if next.next_if(same).is_some() {
                    found.push(Origin { node: index, mesh, primitive: at });
                }
            }
            if !instanced || found.len() == before {
                break;
            }
        }
    }
    match next.next() {
        None => Ok(found),
        Some(part) => Err(Error::invalid(
            format!("mesh {:?}", part.name),
            "it is not where the scene had it: the file is another one",
        )),
    }
}

/// The mesh and primitive of each part, which must be the only one there.
fn targets(document: &Value, parts: &[Part]) -> Result<Vec<(usize, usize)>, Error> {
    let mut used = BTreeMap::new();
    let one = |Origin { node, mesh, primitive }| {
        let fault = match used.insert((mesh, primitive), node) {
            None => return Ok((mesh, primitive)),
            Some(other) if other == node => {
                "its mesh is shown by many instances, and has room for the values of one".to_owned()
            }
            Some(_) => format!("its mesh {mesh} is another node's too; give each its own"),
        };
        Err(Error::invalid(format!("nodes[{node}]"), fault))
    };
    origins(document, parts)?.into_iter().map(one).collect()
}

/// Appends a part's values and returns the index of their accessor.
fn append(
    document: &mut Value,
    binary: &mut Vec<u8>,
    part: &Part,
    attribute: &Attribute,
) -> Result<usize, Error> {
    let width = attribute.width;
    let range = part.vertices.start * width..part.vertices.end * width;
    let values = attribute.values.get(range).ok_or_else(|| {
        Error::invalid(&attribute.name, "there are not as many values as vertices")
    })?;
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let view = push_view(document, binary, &bytes, ARRAY_BUFFER)?;
    let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
    let accessor = json!({
        "bufferView": view, "componentType": 5126, "count": part.vertices.len(), "type": kind,
    });
    push(document, "accessors", accessor)
}
