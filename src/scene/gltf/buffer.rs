//! The bytes behind buffers: GLB chunk, `data:` URI, or a file beside the main one.

use std::borrow::Cow;
use std::collections::BTreeSet;

use gltf::json::Root;

use super::container::Document;
use crate::scene::budget::{Budget, Quantity};
use crate::scene::error::Error;
use crate::scene::source::relative_name;
use crate::scene::uri;

/// The files that a document may draw on.
#[derive(Debug)]
pub(crate) struct Sources<'a> {
    /// The main file.
    pub(crate) main: &'a [u8],
    /// Name (relative, `/` between parts) and content, or why it cannot be had.
    pub(crate) external: Vec<(&'a str, Result<&'a [u8], String>)>,
}

/// The loaded buffers of a document; those that cannot be had fail when they are used.
#[derive(Debug)]
pub(super) struct Buffers<'a> {
    bytes: Vec<Result<Cow<'a, [u8]>, Absence>>,
}

/// Why a buffer cannot be had.
#[derive(Debug)]
enum Absence {
    /// The file leaves it to the application to supply the data.
    Elsewhere,
    Fault(String),
}

impl From<String> for Absence {
    fn from(fault: String) -> Self {
        Self::Fault(fault)
    }
}

/// The names of the external buffers that some view uses, each once, in the file's order.
pub(super) fn external(root: &Root, budget: &mut Budget) -> Result<Vec<String>, Error> {
    let used: BTreeSet<usize> = root.buffer_views.iter().map(|view| view.buffer.value()).collect();
    let (mut names, mut seen) = (Vec::new(), BTreeSet::new());
    for index in used {
        let Some(uri) = root.buffers.get(index).and_then(|buffer| buffer.uri.as_deref()) else {
            continue;
        };
        if uri::is_data(uri) {
            continue;
        }
        let place = format!("buffers[{index}].uri");
        let name = relative_name(uri).map_err(|fault| Error::invalid(&place, fault))?;
        if seen.insert(name.clone()) {
            budget.take(Quantity::Files, 1, &place)?;
            names.push(name);
        }
    }
    Ok(names)
}

impl<'a> Buffers<'a> {
    /// Finds or decodes every buffer.
    pub(super) fn load(
        document: &'a Document,
        sources: &Sources<'a>,
        budget: &mut Budget,
    ) -> Result<Self, Error> {
        let mut bytes = Vec::with_capacity(document.root.buffers.len());
        for (index, buffer) in document.root.buffers.iter().enumerate() {
            let loaded = match buffer.uri.as_deref() {
                None => embedded(index, document, sources),
                Some(uri) if uri::is_data(uri) => {
                    budget.take(Quantity::DecodedBytes, uri.len() as u64, "a data: URI")?;
                    uri::decode_data(uri).map(Cow::Owned).map_err(Absence::Fault)
                }
                Some(uri) => find(uri, sources).map(Cow::Borrowed).map_err(Absence::Fault),
            };
            bytes.push(loaded.and_then(|found| Ok(trim(found, buffer.byte_length.0)?)));
        }
        Ok(Self { bytes })
    }

    /// The bytes of one buffer, as long as its `byteLength`.
    pub(super) fn get(&self, index: usize) -> Result<&[u8], Error> {
        let place = format!("buffers[{index}]");
        match self.bytes.get(index) {
            Some(Ok(bytes)) => Ok(bytes),
            Some(Err(Absence::Fault(fault))) => Err(Error::invalid(place, fault)),
            Some(Err(Absence::Elsewhere)) => {
                let feature = "data from outside the file (it has no uri and no binary chunk)";
                Err(Error::Unsupported { feature: feature.into(), place, hint: "" })
            }
            None => {
                let (place, list) = ("bufferViews".to_owned(), "buffers");
                Err(Error::Reference { place, list, index, count: self.bytes.len() })
            }
        }
    }
}

/// A buffer without URI: the GLB's binary chunk, for the first buffer only.
fn embedded<'a>(
    index: usize,
    document: &Document,
    sources: &Sources<'a>,
) -> Result<Cow<'a, [u8]>, Absence> {
    let range = document.binary.clone().filter(|_| index == 0);
    let bytes = range.and_then(|range| sources.main.get(range));
    bytes.map(Cow::Borrowed).ok_or(Absence::Elsewhere)
}

/// An external buffer among the sources.
fn find<'a>(uri: &str, sources: &Sources<'a>) -> Result<&'a [u8], String> {
    let name = relative_name(uri)?;
    let found = sources.external.iter().find(|(known, _)| *known == name);
    match found {
        Some((_, content)) => content.clone(),
        None => Err(format!("the file {name:?} is not among those of the scene")),
    }
}

/// Cuts to the stated length; a GLB chunk may be padded, a file longer.
fn trim(bytes: Cow<'_, [u8]>, length: u64) -> Result<Cow<'_, [u8]>, String> {
    let found = bytes.len();
    let length = usize::try_from(length)
        .ok()
        .filter(|&length| length <= found)
        .ok_or_else(|| format!("byteLength is {length}, but there are {found} bytes"))?;
    Ok(match bytes {
        Cow::Borrowed(bytes) => Cow::Borrowed(&bytes[..length]),
        Cow::Owned(mut bytes) => {
            bytes.truncate(length);
            Cow::Owned(bytes)
        }
    })
}
