//! Values at vertices written into a GLB, everything else of the file as it was.
//!
//! The JSON is edited as plain values, so extensions, extras, materials and animations survive
//! whether we know them or not; the new numbers follow the old ones in the binary chunk.

use std::collections::BTreeSet;

use serde_json::{Map, Value, json};

use super::Error;
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

const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

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
    binary.resize(binary.len().next_multiple_of(4), 0);
    document["buffers"][0]["byteLength"] = json!(binary.len());
    close(&document, &binary)
}

/// The document and its binary chunk.
fn open(glb: &[u8]) -> Result<(Value, Vec<u8>), Error> {
    let fault = |offset: usize, fault: &str| Error::Glb { offset, fault: fault.to_owned() };
    if !glb.starts_with(b"glTF") {
        return Err(fault(0, "values are written into a .glb file; save the scene as one"));
    }
    let chunk = |start: usize, kind: &[u8; 4]| {
        let head = glb.get(start..start + CHUNK_HEADER_BYTES)?;
        let length = u32::from_le_bytes(head[..4].try_into().ok()?) as usize;
        let body = start + CHUNK_HEADER_BYTES;
        (&head[4..] == kind).then(|| glb.get(body..body.checked_add(length)?)).flatten()
    };
    let text = chunk(HEADER_BYTES, b"JSON").ok_or_else(|| fault(HEADER_BYTES, "no JSON chunk"))?;
    let second = HEADER_BYTES + CHUNK_HEADER_BYTES + text.len();
    let binary = chunk(second, b"BIN\0").ok_or_else(|| fault(second, "no binary chunk"))?;
    let document: Value =
        serde_json::from_slice(text).map_err(|source| Error::Json { fault: source.to_string() })?;
    let buffer = &document["buffers"][0];
    let length = buffer["byteLength"].as_u64().and_then(|length| usize::try_from(length).ok());
    match length.filter(|_| buffer.get("uri").is_none()).and_then(|length| binary.get(..length)) {
        Some(binary) => Ok((document, binary.to_vec())),
        None => Err(fault(second, "the first buffer does not lie in the binary chunk")),
    }
}

fn close(document: &Value, binary: &[u8]) -> Result<Vec<u8>, Error> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = HEADER_BYTES + 2 * CHUNK_HEADER_BYTES + text.len() + binary.len();
    let word = |length: usize| {
        let fault = "the file would be larger than 4 GiB".to_owned();
        u32::try_from(length).map_err(|_| Error::Glb { offset: 8, fault }).map(u32::to_le_bytes)
    };
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend(word(length)?);
    for (kind, body) in [(b"JSON", text.as_slice()), (b"BIN\0", binary)] {
        glb.extend(word(body.len())?);
        glb.extend(kind);
        glb.extend(body);
    }
    Ok(glb)
}

/// The mesh and primitive of each part: import goes by node, then by primitive.
fn targets(document: &Value, parts: &[Part]) -> Result<Vec<(usize, usize)>, Error> {
    let (mut found, mut used) = (Vec::new(), BTreeSet::new());
    let shown = shown(document);
    let mut next = parts.iter().peekable();
    let nodes = document["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    for (index, node) in nodes.iter().enumerate().filter(|(index, _)| shown.contains(index)) {
        let Some(mesh) = node["mesh"].as_u64().map(|mesh| mesh as usize) else { continue };
        if !node["extensions"]["EXT_mesh_gpu_instancing"].is_null() {
            let fault = "its mesh is shown by many instances, and has room for the values of one";
            return Err(Error::invalid(format!("nodes[{index}]"), fault));
        }
        let primitives = document["meshes"][mesh]["primitives"].as_array();
        for (at, primitive) in primitives.into_iter().flatten().enumerate() {
            let positions = primitive["attributes"]["POSITION"].as_u64();
            let count = positions.and_then(|p| document["accessors"][p as usize]["count"].as_u64());
            let same =
                |part: &&Part| part.primitive == at && count == Some(part.vertices.len() as u64);
            if next.next_if(same).is_none() {
                continue;
            }
            if !used.insert((mesh, at)) {
                let fault = format!("its mesh {mesh} is another node's too; give each its own");
                return Err(Error::invalid(format!("nodes[{index}]"), fault));
            }
            found.push((mesh, at));
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

/// The nodes of the scene that is shown.
fn shown(document: &Value) -> BTreeSet<usize> {
    let scene = document["scene"].as_u64().unwrap_or(0) as usize;
    let numbers = |list: &Value| -> Vec<usize> {
        let all = list.as_array().into_iter().flatten();
        all.filter_map(Value::as_u64).map(|number| number as usize).collect()
    };
    let mut open = match document["scenes"][scene].get("nodes") {
        Some(roots) => numbers(roots),
        None => (0..document["nodes"].as_array().map_or(0, Vec::len)).collect(),
    };
    let mut shown = BTreeSet::new();
    while let Some(node) = open.pop() {
        if shown.insert(node) {
            open.extend(numbers(&document["nodes"][node]["children"]));
        }
    }
    shown
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
    binary.resize(binary.len().next_multiple_of(4), 0);
    let start = binary.len();
    values.iter().for_each(|value| binary.extend(value.to_le_bytes()));
    let view = json!({
        "buffer": 0, "byteOffset": start, "byteLength": binary.len() - start, "target": 34962,
    });
    let view = push(document, "bufferViews", view)?;
    let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
    let accessor = json!({
        "bufferView": view, "componentType": 5126, "count": part.vertices.len(), "type": kind,
    });
    push(document, "accessors", accessor)
}

fn push(document: &mut Value, list: &str, value: Value) -> Result<usize, Error> {
    let whole: Option<&mut Map<String, Value>> = document.as_object_mut();
    let entry = whole.map(|whole| whole.entry(list).or_insert_with(|| json!([])));
    let entries = entry.and_then(Value::as_array_mut);
    let entries = entries.ok_or_else(|| Error::invalid(list, "it is no list"))?;
    entries.push(value);
    Ok(entries.len() - 1)
}
