//! Vertex attributes of any kind, read as numbers from a document's plain JSON.

use serde_json::Value;

use super::Error;

/// The numbers of one accessor.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Elements {
    /// Numbers per element.
    pub(super) width: usize,
    /// glTF's component type.
    pub(super) component: u64,
    pub(super) normalized: bool,
    /// `[element, number]`; normalised integers as the fractions that they stand for.
    pub(super) values: Vec<f64>,
}

pub(super) const FLOAT: u64 = 5126;

impl Elements {
    /// Reads an accessor that must have `count` elements.
    pub(super) fn read(
        document: &Value,
        binary: &[u8],
        index: usize,
        count: usize,
    ) -> Result<Self, Error> {
        let place = format!("accessors[{index}]");
        let accessor = &document["accessors"][index];
        if accessor["count"].as_u64() != Some(count as u64) {
            return Err(Error::invalid(place, "it has not as many elements as its primitive"));
        }
        let width = match accessor["type"].as_str() {
            Some("SCALAR") => 1,
            Some("VEC2") => 2,
            Some("VEC3") => 3,
            Some("VEC4") => 4,
            _ => return Err(Error::invalid(place, "its type is none of a vertex attribute")),
        };
        let component = accessor["componentType"].as_u64().unwrap_or_default();
        let bytes = size(component)
            .ok_or_else(|| Error::invalid(&place, "its component type is none of glTF's"))?;
        let normalized = accessor["normalized"].as_bool().unwrap_or(false);
        let number = |bytes: &[u8]| number(component, normalized, bytes);
        let mut values = vec![0.0; count * width];
        if let Some(view) = index_of(&accessor["bufferView"]) {
            let offset = index_of(&accessor["byteOffset"]).unwrap_or(0);
            let run = Run { view, offset, element: bytes * width, count };
            for (element, out) in
                run.read(document, binary, &place)?.zip(values.chunks_exact_mut(width))
            {
                element.chunks_exact(bytes).zip(out).for_each(|(bytes, out)| *out = number(bytes));
            }
        }
        if !accessor["sparse"].is_null() {
            let sparse = &accessor["sparse"];
            let changes = Sparse::read(document, binary, sparse, bytes * width, &place)?;
            for (at, element) in changes.at.into_iter().zip(changes.elements) {
                let out = values.get_mut(at * width..(at + 1) * width);
                let out =
                    out.ok_or_else(|| Error::invalid(&place, "a sparse index is too large"))?;
                element.chunks_exact(bytes).zip(out).for_each(|(bytes, out)| *out = number(bytes));
            }
        }
        Ok(Self { width, component, normalized, values })
    }

    /// One element.
    pub(super) fn element(&self, index: usize) -> &[f64] {
        &self.values[index * self.width..(index + 1) * self.width]
    }
}

/// Elements that lie at equal steps in a buffer view.
struct Run {
    view: usize,
    offset: usize,
    /// Bytes.
    element: usize,
    count: usize,
}

impl Run {
    fn read<'a>(
        &self,
        document: &Value,
        binary: &'a [u8],
        place: &str,
    ) -> Result<impl Iterator<Item = &'a [u8]> + use<'a>, Error> {
        let view = &document["bufferViews"][self.view];
        let whole = || {
            if index_of(&view["buffer"])? != 0 || !view["extensions"].is_null() {
                return None;
            }
            let start = index_of(&view["byteOffset"]).unwrap_or(0);
            let end = start.checked_add(index_of(&view["byteLength"])?)?;
            binary.get(start..end)?.get(self.offset..)
        };
        let stride = index_of(&view["byteStride"]).unwrap_or(self.element);
        let (element, count) = (self.element, self.count);
        let last = count.saturating_sub(1).checked_mul(stride).and_then(|l| l.checked_add(element));
        match whole() {
            Some(bytes) if count == 0 || last.is_some_and(|last| last <= bytes.len()) => {
                Ok((0..count).map(move |i| &bytes[i * stride..i * stride + element]))
            }
            _ => Err(Error::invalid(place, "its elements do not lie in the binary chunk")),
        }
    }
}

struct Sparse<'a> {
    at: Vec<usize>,
    elements: Vec<&'a [u8]>,
}

impl<'a> Sparse<'a> {
    fn read(
        document: &Value,
        binary: &'a [u8],
        sparse: &Value,
        element: usize,
        place: &str,
    ) -> Result<Self, Error> {
        let fault = || Error::invalid(place, "its sparse part is incomplete");
        let count = index_of(&sparse["count"]).ok_or_else(fault)?;
        let run = |part: &Value, element: usize| {
            let view = index_of(&part["bufferView"]).ok_or_else(fault)?;
            let offset = index_of(&part["byteOffset"]).unwrap_or(0);
            Run { view, offset, element, count }.read(document, binary, place)
        };
        let component = sparse["indices"]["componentType"].as_u64().unwrap_or_default();
        let bytes = size(component).ok_or_else(fault)?;
        let at = run(&sparse["indices"], bytes)?;
        Ok(Self {
            at: at.map(|bytes| number(component, false, bytes) as usize).collect(),
            elements: run(&sparse["values"], element)?.collect(),
        })
    }
}

fn index_of(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|number| usize::try_from(number).ok())
}

fn size(component: u64) -> Option<usize> {
    match component {
        5120 | 5121 => Some(1),
        5122 | 5123 => Some(2),
        5125 | FLOAT => Some(4),
        _ => None,
    }
}

/// One component (glTF 2.0, §3.6.2.2 and §3.11).
fn number(component: u64, normalized: bool, bytes: &[u8]) -> f64 {
    let scaled = |value: f64, most: f64| {
        if normalized { (value / most).max(-1.0) } else { value }
    };
    match (component, bytes) {
        (5120, &[a]) => scaled(f64::from(a as i8), 127.0),
        (5121, &[a]) => scaled(f64::from(a), 255.0),
        (5122, &[a, b]) => scaled(f64::from(i16::from_le_bytes([a, b])), 32767.0),
        (5123, &[a, b]) => scaled(f64::from(u16::from_le_bytes([a, b])), 65535.0),
        (5125, &[a, b, c, d]) => f64::from(u32::from_le_bytes([a, b, c, d])),
        (FLOAT, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
        _ => 0.0,
    }
}

/// Numbers as bytes of a component type that is not normalised.
pub(super) fn bytes_of(component: u64, values: &[f64]) -> Vec<u8> {
    let one = |&value: &f64| -> Vec<u8> {
        match component {
            5120 => (value as i8).to_le_bytes().to_vec(),
            5121 => (value as u8).to_le_bytes().to_vec(),
            5122 => (value as i16).to_le_bytes().to_vec(),
            5123 => (value as u16).to_le_bytes().to_vec(),
            5125 => (value as u32).to_le_bytes().to_vec(),
            _ => (value as f32).to_le_bytes().to_vec(),
        }
    };
    values.iter().flat_map(one).collect()
}
