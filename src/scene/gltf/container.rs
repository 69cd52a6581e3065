//! From bytes to a glTF document: the GLB container, and JSON of bounded size.

use std::ops::Range;

use gltf::json::{self, Root, Value};

use crate::scene::budget::{Budget, Notices, Quantity};
use crate::scene::error::Error;

/// A parsed document, its indices still unchecked.
#[derive(Debug)]
pub(crate) struct Document {
    pub(super) root: Root,
    /// The GLB's binary chunk, in the main file's bytes.
    pub(super) binary: Option<Range<usize>>,
}

impl Document {
    /// Parses a `.glb` or `.gltf` file.
    pub(crate) fn parse(
        bytes: &[u8],
        budget: &mut Budget,
        notices: &mut Notices,
    ) -> Result<Self, Error> {
        let chunks = if bytes.starts_with(b"glTF") {
            split(bytes, notices)?
        } else {
            Chunks { json: 0..bytes.len(), binary: None }
        };
        let mut text = &bytes[chunks.json];
        if let Some(rest) = text.strip_prefix(b"\xEF\xBB\xBF") {
            notices.add("the JSON starts with a byte order mark, which glTF forbids; skipped");
            text = rest;
        }
        budget.take(Quantity::JsonValues, count_values(text), "the JSON text")?;
        let root = parse_json(text, notices)?;
        check_version(&root.asset.version, "asset.version")?;
        if let Some(version) = &root.asset.min_version {
            check_version(version, "asset.minVersion")?;
        }
        Ok(Self { root, binary: chunks.binary })
    }
}

/// Where the chunks of a GLB lie.
struct Chunks {
    json: Range<usize>,
    binary: Option<Range<usize>>,
}

const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// Walks the chunks of a GLB (glTF 2.0 §4.4), believing no length.
fn split(bytes: &[u8], notices: &mut Notices) -> Result<Chunks, Error> {
    let fault = |offset: usize, fault: String| Error::Glb { offset, fault };
    let word = |offset: usize| {
        let word = bytes.get(offset..offset + 4)?;
        Some(u32::from_le_bytes(word.try_into().ok()?))
    };
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(fault(bytes.len(), "the file ends within its 12-byte header".into()));
    };
    if version != 2 {
        return Err(fault(4, format!("container version is {version}; only 2 is known")));
    }
    let length = length as usize;
    if length < HEADER_BYTES || length > bytes.len() {
        let found = bytes.len();
        return Err(fault(8, format!("the header says {length} bytes, the file has {found}")));
    }
    if length < bytes.len() {
        notices.add(format!("{} bytes after the GLB's end were ignored", bytes.len() - length));
    }
    let (mut json, mut binary) = (None, None);
    let mut offset = HEADER_BYTES;
    while offset < length {
        let (Some(size), Some(kind)) = (word(offset), bytes.get(offset + 4..offset + 8)) else {
            return Err(fault(offset, "the file ends within a chunk header".into()));
        };
        let start = offset + CHUNK_HEADER_BYTES;
        let end = start.saturating_add(size as usize);
        if end > length {
            let rest = length.saturating_sub(start);
            return Err(fault(offset, format!("a chunk of {size} bytes, {rest} are left")));
        }
        match (kind, &json) {
            (b"JSON", None) => json = Some(start..end),
            (_, None) => return Err(fault(offset, "the first chunk must be JSON".into())),
            (b"BIN\0", _) if binary.is_none() => binary = Some(start..end),
            (b"JSON" | b"BIN\0", _) => notices.add(format!(
                "a second {} chunk at byte {offset} was ignored",
                String::from_utf8_lossy(kind).trim_end_matches('\0')
            )),
            _ => {}
        }
        offset = end;
    }
    let json = json.ok_or_else(|| fault(HEADER_BYTES, "there is no JSON chunk".into()))?;
    Ok(Chunks { json, binary })
}

/// Counts openings and commas outside strings: at least the number of values that a parser would
/// allocate for. One byte pass, so that `[{},{},…]` cannot claim a hundred times its size.
fn count_values(text: &[u8]) -> u64 {
    let (mut count, mut in_string, mut escaped) = (0_u64, false, false);
    for &byte in text {
        match byte {
            _ if escaped => escaped = false,
            b'\\' if in_string => escaped = true,
            b'"' => in_string = !in_string,
            b'{' | b'[' | b',' if !in_string => count += 1,
            _ => {}
        }
    }
    count
}

/// Parses the document; where the `gltf` crate does not, once more without the parts that are
/// not looked at, so that an unusual material or a camera does not stop a mesh.
fn parse_json(text: &[u8], notices: &mut Notices) -> Result<Root, Error> {
    let refusal = match json::deserialize::from_slice::<Root>(text) {
        Ok(root) => return Ok(root),
        Err(refusal) => refusal,
    };
    let fault = || Error::Json { fault: refusal.to_string() };
    let mut document: Value = json::deserialize::from_slice(text).map_err(|_| fault())?;
    if let Some(version) = document["asset"]["version"].as_str() {
        check_version(version, "asset.version")?;
    }
    mend(&mut document);
    let root = json::deserialize::from_value(document).map_err(|_| fault())?;
    notices.add(format!("parts of the JSON that are not needed were left out: {refusal}"));
    Ok(root)
}

/// Removes what import does not read; mends what glTF allows and the `gltf` crate refuses:
/// channels without a node, which readers are to ignore, and scenes without nodes.
fn mend(document: &mut Value) {
    let Some(members) = document.as_object_mut() else { return };
    for unread in ["materials", "textures", "images", "samplers", "cameras", "extensions"] {
        members.remove(unread);
    }
    let scenes = members.get_mut("scenes").and_then(Value::as_array_mut);
    for scene in scenes.into_iter().flatten().filter_map(Value::as_object_mut) {
        scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
    }
    let animations = members.get_mut("animations").and_then(Value::as_array_mut);
    for animation in animations.into_iter().flatten() {
        if let Some(channels) = animation.get_mut("channels").and_then(Value::as_array_mut) {
            channels.retain(|channel| {
                channel.get("target").is_none_or(|target| target.get("node").is_some())
            });
        }
    }
}

/// Accepts glTF 2.x.
fn check_version(version: &str, place: &str) -> Result<(), Error> {
    let minor_is_known = place != "asset.minVersion" || version == "2.0";
    if version.starts_with("2.") && minor_is_known {
        return Ok(());
    }
    let shown: String = version.chars().take(32).collect();
    Err(Error::Unsupported { feature: format!("glTF {shown:?}"), place: place.into(), hint: "" })
}
