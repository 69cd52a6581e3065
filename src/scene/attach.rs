//! Values at vertices written into a GLB, everything else of the file as it was.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value, json};

use super::Error;
use super::container::{ARRAY_BUFFER, finish, open, push, push_view, shown};
use crate::rig::Part;

/// glTF's modes of primitives with a surface: lists, strips and fans, in this order.
const TRIANGLES: u64 = 4;
const TRIANGLE_FAN: u64 = 6;

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
/// that name is there. Parts of the scene that are left out get no values.
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

/// Where each part came from: the node that import took it from, and what is there still.
pub(super) fn origins(document: &Value, parts: &[Part]) -> Result<Vec<Origin>, Error> {
    let shown = shown(document);
    let of = |part: &Part| {
        let node = part.source_node;
        let mesh = document["nodes"][node]["mesh"].as_u64()? as usize;
        let primitive = document["meshes"][mesh]["primitives"].get(part.primitive)?;
        let positions = primitive["attributes"]["POSITION"].as_u64()? as usize;
        let count = document["accessors"][positions]["count"].as_u64()?;
        let mode = primitive.get("mode").map_or(Some(TRIANGLES), Value::as_u64)?;
        let same = shown.contains_key(&node)
            && (TRIANGLES..=TRIANGLE_FAN).contains(&mode)
            && count == part.vertices.len() as u64;
        same.then_some(Origin { node, mesh, primitive: part.primitive })
    };
    let one = |part: &Part| {
        of(part).ok_or_else(|| {
            let place = format!("mesh {:?}", part.name);
            Error::invalid(place, "it is not where the scene had it: the file is another one")
        })
    };
    parts.iter().map(one).collect()
}

/// The mesh and primitive of each part, which must be the only one there.
fn targets(document: &Value, parts: &[Part]) -> Result<Vec<(usize, usize)>, Error> {
    let mut nodes_of = BTreeMap::new();
    for node in shown(document).into_keys() {
        if let Some(mesh) = document["nodes"][node]["mesh"].as_u64() {
            *nodes_of.entry(mesh as usize).or_insert(0) += 1;
        }
    }
    let mut used = BTreeSet::new();
    let one = |Origin { node, mesh, primitive }| {
        // Also where the other node is none of the parts: it would show their values.
        let fault = if nodes_of.get(&mesh).is_some_and(|&nodes| nodes > 1) {
            format!("its mesh {mesh} is another node's too; give each its own")
        } else if used.insert((mesh, primitive)) {
            return Ok((mesh, primitive));
        } else {
            "its mesh is shown by many instances, and has room for the values of one".to_owned()
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
