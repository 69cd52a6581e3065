//! The files of a glTF as one GLB that can be written into.

use std::borrow::Cow;

use serde_json::{Value, json};

use super::container::{close, parse};
use super::source::relative_name;
use super::{Error, Source, uri};

/// A scene's files, the main one first, as one GLB with every buffer in the binary chunk. Pictures stay
/// in files of their own where they are. A GLB that is whole already is itself.
///
/// # Errors
/// [`Error::Glb`] where the main file is no glTF; [`Error::Invalid`] where a buffer is not at hand.
pub fn as_glb(sources: &[Source]) -> Result<Cow<'_, [u8]>, Error> {
    let main = sources.first().map_or(&[][..], |source| &source.bytes);
    let (mut document, chunk) = parse(main)?;
    let buffers = document["buffers"].as_array().cloned().unwrap_or_default();
    let is_whole = buffers.len() == 1 && buffers[0].get("uri").is_none();
    if chunk.is_some() && is_whole {
        return Ok(Cow::Borrowed(main));
    }
    let mut binary = Vec::new();
    let mut starts = Vec::with_capacity(buffers.len());
    for (index, buffer) in buffers.iter().enumerate() {
        binary.resize(usize::next_multiple_of(binary.len(), 4), 0);
        starts.push(binary.len());
        let found = contents(index, buffer, chunk, sources)?;
        let length = buffer["byteLength"].as_u64().unwrap_or(u64::MAX) as usize;
        let fault = || Error::invalid(format!("buffers[{index}]"), "it is shorter than it says");
        binary.extend_from_slice(found.get(..length).ok_or_else(fault)?);
    }
    for view in document["bufferViews"].as_array_mut().into_iter().flatten() {
        let buffer = view["buffer"].as_u64().unwrap_or(u64::MAX) as usize;
        let start = starts.get(buffer).copied().unwrap_or_default();
        let offset = view["byteOffset"].as_u64().unwrap_or(0) + start as u64;
        view["buffer"] = json!(0);
        view["byteOffset"] = json!(offset);
    }
    binary.resize(binary.len().next_multiple_of(4), 0);
    document["buffers"] = json!([{ "byteLength": binary.len() }]);
    close(&document, &binary).map(Cow::Owned)
}

/// The bytes of one buffer.
fn contents<'a>(
    index: usize,
    buffer: &Value,
    chunk: Option<&'a [u8]>,
    sources: &'a [Source],
) -> Result<Cow<'a, [u8]>, Error> {
    let invalid = |fault: String| Error::invalid(format!("buffers[{index}]"), fault);
    let Some(uri) = buffer["uri"].as_str() else {
        let found = chunk.filter(|_| index == 0).map(Cow::Borrowed);
        return found.ok_or_else(|| invalid("it has no data in this file".to_owned()));
    };
    if uri::is_data(uri) {
        return uri::decode_data(uri).map(Cow::Owned).map_err(invalid);
    }
    let name = relative_name(uri).map_err(invalid)?;
    let found = sources.iter().skip(1).find(|source| source.name == name);
    let found = found.map(|source| Cow::Borrowed(&source.bytes[..]));
    found.ok_or_else(|| invalid(format!("the file {name:?} is not among those of the scene")))
}
