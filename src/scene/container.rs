//! A GLB taken apart into JSON values and its binary chunk, and put together again.
//!
//! The JSON is edited as plain values, so extensions, extras, materials and animations survive
//! whether we know them or not; new numbers follow the old ones in the binary chunk.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value, json};

use super::Error;

/// Buffer views of attributes and of indices.
pub(super) const ARRAY_BUFFER: u32 = 34962;
pub(super) const INDEX_BUFFER: u32 = 34963;

const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// The document of a `.glb` or a `.gltf`, and the binary chunk where there is one.
pub(super) fn parse(main: &[u8]) -> Result<(Value, Option<&[u8]>), Error> {
    let json = |text: &[u8]| {
        serde_json::from_slice(text).map_err(|source| Error::Json { fault: source.to_string() })
    };
    let text = main.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(main);
    if text.trim_ascii_start().first() == Some(&b'{') {
        return Ok((json(text)?, None));
    }
    let fault = |offset: usize, fault: &str| Error::Glb { offset, fault: fault.to_owned() };
    if !main.starts_with(b"glTF") {
        return Err(fault(0, "only a glTF can be written into; save the scene as one"));
    }
    let text =
        chunk(main, HEADER_BYTES, b"JSON").ok_or_else(|| fault(HEADER_BYTES, "no JSON chunk"))?;
    let second = HEADER_BYTES + CHUNK_HEADER_BYTES + text.len();
    Ok((json(text)?, chunk(main, second, b"BIN\0")))
}

/// The body of a chunk of this kind at this place.
fn chunk<'a>(glb: &'a [u8], start: usize, kind: &[u8; 4]) -> Option<&'a [u8]> {
    let head = glb.get(start..start.checked_add(CHUNK_HEADER_BYTES)?)?;
    let length = u32::from_le_bytes(head[..4].try_into().ok()?) as usize;
    let body = start + CHUNK_HEADER_BYTES;
    (&head[4..] == kind).then(|| glb.get(body..body.checked_add(length)?)).flatten()
}

/// The document and its binary chunk.
pub(super) fn open(glb: &[u8]) -> Result<(Value, Vec<u8>), Error> {
    let fault = |offset: usize, fault: &str| Error::Glb { offset, fault: fault.to_owned() };
    if !glb.starts_with(b"glTF") {
        return Err(fault(0, "only a .glb can be written into; save the scene as one"));
    }
    let text =
        chunk(glb, HEADER_BYTES, b"JSON").ok_or_else(|| fault(HEADER_BYTES, "no JSON chunk"))?;
    let second = HEADER_BYTES + CHUNK_HEADER_BYTES + text.len();
    let binary = chunk(glb, second, b"BIN\0").ok_or_else(|| fault(second, "no binary chunk"))?;
    let document: Value =
        serde_json::from_slice(text).map_err(|source| Error::Json { fault: source.to_string() })?;
    let buffer = &document["buffers"][0];
    let length = buffer["byteLength"].as_u64().and_then(|length| usize::try_from(length).ok());
    match length.filter(|_| buffer.get("uri").is_none()).and_then(|length| binary.get(..length)) {
        Some(binary) => Ok((document, binary.to_vec())),
        None => Err(fault(second, "the first buffer does not lie in the binary chunk")),
    }
}

pub(super) fn close(document: &Value, binary: &[u8]) -> Result<Vec<u8>, Error> {
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

/// Appends bytes to the binary chunk; the index of their buffer view.
pub(super) fn push_view(
    document: &mut Value,
    binary: &mut Vec<u8>,
    bytes: &[u8],
    target: u32,
) -> Result<usize, Error> {
    binary.resize(binary.len().next_multiple_of(4), 0);
    let start = binary.len();
    binary.extend_from_slice(bytes);
    let view = json!({
        "buffer": 0, "byteOffset": start, "byteLength": bytes.len(), "target": target,
    });
    push(document, "bufferViews", view)
}

/// The file with everything that was appended.
pub(super) fn finish(mut document: Value, mut binary: Vec<u8>) -> Result<Vec<u8>, Error> {
    binary.resize(binary.len().next_multiple_of(4), 0);
    document["buffers"][0]["byteLength"] = json!(binary.len());
    close(&document, &binary)
}

/// The nodes of the scene that is shown, each with its number among the imported ones: parents first,
/// children in the file's order.
pub(super) fn shown(document: &Value) -> BTreeMap<usize, usize> {
    let scene = document["scene"].as_u64().unwrap_or(0) as usize;
    let numbers = |list: &Value| -> Vec<usize> {
        let all = list.as_array().into_iter().flatten();
        all.filter_map(Value::as_u64).map(|number| number as usize).collect()
    };
    let nodes = document["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    let mut open = match document["scenes"][scene].get("nodes") {
        Some(roots) => numbers(roots),
        None => {
            let below: BTreeSet<usize> =
                nodes.iter().flat_map(|node| numbers(&node["children"])).collect();
            (0..nodes.len()).filter(|node| !below.contains(node)).collect()
        }
    };
    open.reverse();
    let mut shown = BTreeMap::new();
    while let Some(node) = open.pop() {
        let number = shown.len();
        if shown.contains_key(&node) {
            continue;
        }
        shown.insert(node, number);
        open.extend(numbers(&document["nodes"][node]["children"]).into_iter().rev());
    }
    shown
}

/// Appends an entry to a list of the document; its index.
pub(super) fn push(document: &mut Value, list: &str, value: Value) -> Result<usize, Error> {
    let whole: Option<&mut Map<String, Value>> = document.as_object_mut();
    let entry = whole.map(|whole| whole.entry(list).or_insert_with(|| json!([])));
    let entries = entry.and_then(Value::as_array_mut);
    let entries = entries.ok_or_else(|| Error::invalid(list, "it is no list"))?;
    entries.push(value);
    Ok(entries.len() - 1)
}
