//! Bounds-checked reading of accessors: strided, sparse, normalised, or all zeros.

use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::Checked;

use super::File;
use crate::scene::budget::Quantity;
use crate::scene::error::Error;

/// What an accessor must look like to be read for a purpose.
#[derive(Debug, Clone, Copy)]
pub(super) struct Format {
    pub(super) kind: Type,
    /// Component types, each with whether it must be normalised (`None`: either).
    pub(super) components: &'static [(ComponentType, Option<bool>)],
}

impl Format {
    fn allows(&self, kind: Type, component: ComponentType, normalized: bool) -> bool {
        let fits = |&(allowed, must): &(ComponentType, Option<bool>)| {
            // `normalized` means nothing for floats; some exporters set it.
            let agrees = component == ComponentType::F32 || must.is_none_or(|m| m == normalized);
            allowed == component && agrees
        };
        kind == self.kind && self.components.iter().any(fits)
    }
}

/// Elements at equal distances in a buffer.
#[derive(Debug, Clone, Copy)]
struct Strided<'a> {
    /// From the first element to the end of the view.
    bytes: &'a [u8],
    stride: usize,
}

impl<'a> Strided<'a> {
    /// The component's bytes; zero-filled beyond the end, which the layout check excludes.
    fn component(&self, element: usize, offset: usize) -> [u8; 4] {
        let start = element * self.stride + offset;
        let mut out = [0; 4];
        let rest = self.bytes.get(start..).unwrap_or_default();
        let length = rest.len().min(4);
        out[..length].copy_from_slice(&rest[..length]);
        out
    }
}

/// Replacements of single elements.
#[derive(Debug, Clone, Copy)]
struct Sparse<'a> {
    count: usize,
    indices: Strided<'a>,
    index_type: ComponentType,
    values: Strided<'a>,
}

/// A checked accessor: every element lies within its buffer.
#[derive(Debug)]
pub(super) struct Elements<'a> {
    /// `accessors[7] (POSITION of …)`, for messages.
    pub(super) place: String,
    pub(super) count: usize,
    pub(super) component: ComponentType,
    pub(super) normalized: bool,
    pub(super) kind: Type,
    /// `None`: all zeros.
    base: Option<Strided<'a>>,
    sparse: Option<Sparse<'a>>,
    /// Whether the stated `min` or `max` is another number than zero.
    bounds_exclude_zeros: bool,
}

impl Elements<'_> {
    /// Refuses an accessor without a view and replacements where its stated bounds say that it is
    /// not meant to be zeros. glTF 2.0 §5.1.1 has such an accessor be zeros, unless an extension
    /// or the application supplies the data.
    pub(super) fn require_meant_zeros(&self) -> Result<(), Error> {
        if self.bounds_exclude_zeros { self.require_data("its bounds are not 0") } else { Ok(()) }
    }

    /// As [`Self::require_meant_zeros`], where zeros can never be meant, and why.
    pub(super) fn require_data(&self, why: &str) -> Result<(), Error> {
        if self.base.is_some() || self.sparse.is_some() {
            return Ok(());
        }
        let feature = format!("data from outside the file (it has no bufferView, and {why})");
        Err(Error::Unsupported { feature, place: self.place.clone(), hint: "" })
    }
}

/// Which accessors were read, to tell faults that matter from faults that do not.
#[derive(Debug)]
pub(super) struct Usage(Vec<bool>);

impl Usage {
    pub(super) fn none(accessors: usize) -> Self {
        Self(vec![false; accessors])
    }
}

impl<'a> File<'a, '_> {
    /// Checks an accessor and its format. Allocates nothing that grows with its count.
    pub(super) fn accessor(
        &mut self,
        index: usize,
        purpose: &str,
        format: Format,
    ) -> Result<Elements<'a>, Error> {
        if let Some(used) = self.usage.0.get_mut(index) {
            *used = true;
        }
        let elements = self.elements(index, purpose)?;
        let (kind, component) = (elements.kind, elements.component);
        if !format.allows(kind, component, elements.normalized) {
            let normalized = if elements.normalized { "normalised " } else { "" };
            let fault = format!("{normalized}{kind:?} of {component:?} is not allowed there");
            return Err(Error::invalid(elements.place, fault));
        }
        Ok(elements)
    }

    /// The faults of accessors that nothing has read, in the file's order, a few at most.
    pub(super) fn unread_accessor_faults(&self) -> Vec<Error> {
        let unread = self.usage.0.iter().enumerate().filter(|(_, used)| !**used);
        unread.filter_map(|(index, _)| self.elements(index, "unused").err()).take(8).collect()
    }

    /// Checks that everything an accessor claims lies within its buffers.
    fn elements(&self, index: usize, purpose: &str) -> Result<Elements<'a>, Error> {
        let place = format!("accessors[{index}] ({purpose})");
        let list = &self.root.accessors;
        let accessor = list.get(index).ok_or_else(|| Error::Reference {
            place: purpose.to_owned(),
            list: "accessors",
            index,
            count: list.len(),
        })?;
        let (component, kind) = declared(accessor, &place)?;
        let count = usize::try_from(accessor.count.0)
            .map_err(|_| Error::invalid(&place, "count is beyond this machine's memory"))?;
        let size = element_bytes(kind, component);
        let base = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                Some(self.strided(view.value(), offset, count, size, &place)?)
            }
            None => None,
        };
        let sparse = match &accessor.sparse {
            Some(sparse) => Some(self.sparse(sparse, count, size, &place)?),
            None => None,
        };
        let normalized = accessor.normalized;
        let stated = [&accessor.min, &accessor.max].into_iter().flatten();
        let bounds_exclude_zeros = stated
            .flat_map(|bound| bound.as_array().map_or(&[][..], Vec::as_slice))
            .any(|number| number.as_f64().is_some_and(|number| number != 0.0));
        Ok(Elements {
            place,
            count,
            component,
            normalized,
            kind,
            base,
            sparse,
            bounds_exclude_zeros,
        })
    }

    /// `count` elements of `size` bytes from `offset` of a view on.
    fn strided(
        &self,
        view: usize,
        offset: u64,
        count: usize,
        size: usize,
        place: &str,
    ) -> Result<Strided<'a>, Error> {
        let (bytes, stride) = self.view(view, place)?;
        let stride = stride.unwrap_or(size);
        if stride < size {
            let fault = format!("byteStride {stride} is less than an element's {size} bytes");
            return Err(Error::invalid(place, fault));
        }
        let last = (count as u64).saturating_sub(1).checked_mul(stride as u64);
        let length =
            if count == 0 { Some(0) } else { last.and_then(|l| l.checked_add(size as u64)) };
        let end = length.and_then(|length| offset.checked_add(length));
        match end {
            Some(end) if end <= bytes.len() as u64 => {
                Ok(Strided { bytes: &bytes[offset as usize..], stride })
            }
            _ => Err(Error::invalid(
                place,
                format!(
                    "{count} elements of {size} bytes at stride {stride} from byte {offset} on do \
                     not fit the {} bytes of bufferViews[{view}]",
                    bytes.len()
                ),
            )),
        }
    }

    /// The bytes and the stride of a view.
    fn view(&self, index: usize, place: &str) -> Result<(&'a [u8], Option<usize>), Error> {
        let list = &self.root.buffer_views;
        let view = list.get(index).ok_or_else(|| Error::Reference {
            place: place.to_owned(),
            list: "bufferViews",
            index,
            count: list.len(),
        })?;
        super::extension::check_view(view, index)?;
        let buffer = view.buffer.value();
        let bytes = self.buffers.get(buffer)?;
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let end = start.checked_add(view.byte_length.0);
        let range =
            end.and_then(|end| Some(usize::try_from(start).ok()?..usize::try_from(end).ok()?));
        let found = range.and_then(|range| bytes.get(range)).ok_or_else(|| {
            let (offset, length, held) = (start, view.byte_length.0, bytes.len());
            Error::invalid(
                format!("bufferViews[{index}]"),
                format!("{length} bytes from byte {offset} on: buffers[{buffer}] has {held}"),
            )
        })?;
        Ok((found, view.byte_stride.map(|stride| stride.0)))
    }

    fn sparse(
        &self,
        sparse: &gltf::json::accessor::sparse::Sparse,
        count: usize,
        size: usize,
        place: &str,
    ) -> Result<Sparse<'a>, Error> {
        let replaced = sparse.count.0;
        if replaced > count as u64 {
            let fault = format!("sparse.count {replaced} is more than count {count}");
            return Err(Error::invalid(place, fault));
        }
        let replaced = replaced as usize;
        let (indices, values) = (&sparse.indices, &sparse.values);
        let Checked::Valid(index_type) = indices.component_type else {
            return Err(Error::invalid(place, "sparse.indices.componentType is not an index type"));
        };
        let index_type = index_type.0;
        let at = |view: usize, offset: u64, size: usize, part: &str| {
            self.strided(view, offset, replaced, size, &format!("{place}, sparse {part}"))
        };
        let index_bytes = index_type.size();
        Ok(Sparse {
            count: replaced,
            indices: at(
                indices.buffer_view.value(),
                indices.byte_offset.0,
                index_bytes,
                "indices",
            )?,
            index_type,
            values: at(values.buffer_view.value(), values.byte_offset.0, size, "values")?,
        })
    }

    /// Reads N numbers per element as f32, normalised integers mapped to [−1, 1] or [0, 1].
    pub(super) fn floats<const N: usize>(
        &mut self,
        elements: &Elements,
    ) -> Result<Vec<[f32; N]>, Error> {
        let (component, normalized) = (elements.component, elements.normalized);
        self.read(elements, |bytes| decode(component, normalized, bytes))
    }

    /// As [`Self::floats`], refusing NaN and infinities.
    pub(super) fn finite_floats<const N: usize>(
        &mut self,
        elements: &Elements,
    ) -> Result<Vec<[f32; N]>, Error> {
        let values = self.floats::<N>(elements)?;
        let bad = values.iter().position(|value| value.iter().any(|number| !number.is_finite()));
        match bad {
            Some(element) => Err(Error::NotFinite { place: elements.place.clone(), element }),
            None => Ok(values),
        }
    }

    /// Reads N unsigned integers per element.
    pub(super) fn unsigned<const N: usize>(
        &mut self,
        elements: &Elements,
    ) -> Result<Vec<[u32; N]>, Error> {
        let component = elements.component;
        self.read(elements, |bytes| decode_unsigned(component, bytes))
    }

    fn read<const N: usize, T: Copy + Default>(
        &mut self,
        elements: &Elements,
        decode: impl Fn([u8; 4]) -> T,
    ) -> Result<Vec<[T; N]>, Error> {
        assert_eq!(N, elements.kind.multiplicity(), "{}", elements.place);
        let size = elements.component.size();
        let bytes = (elements.count as u64).saturating_mul((N * size_of::<T>()) as u64);
        self.budget.take(Quantity::DecodedBytes, bytes, &elements.place)?;
        let element = |data: &Strided, index: usize| {
            std::array::from_fn(|component| decode(data.component(index, component * size)))
        };
        let mut values = match &elements.base {
            Some(data) => (0..elements.count).map(|index| element(data, index)).collect(),
            None => vec![[T::default(); N]; elements.count],
        };
        let Some(sparse) = &elements.sparse else { return Ok(values) };
        for entry in 0..sparse.count {
            let index = decode_unsigned(sparse.index_type, sparse.indices.component(entry, 0));
            let replaced = values.get_mut(index as usize).ok_or_else(|| {
                let fault = format!("sparse index {entry} is {index}, count is {}", elements.count);
                Error::invalid(&elements.place, fault)
            })?;
            *replaced = element(&sparse.values, entry);
        }
        Ok(values)
    }
}

/// The declared component type and shape.
fn declared(accessor: &Accessor, place: &str) -> Result<(ComponentType, Type), Error> {
    let Checked::Valid(component) = accessor.component_type else {
        return Err(Error::invalid(place, "componentType is none of glTF's"));
    };
    let Checked::Valid(kind) = accessor.type_ else {
        return Err(Error::invalid(place, "type is none of glTF's"));
    };
    Ok((component.0, kind))
}

/// Bytes from the first to the last component; columns of small matrices start at multiples of
/// four (glTF 2.0 §3.6.2.4).
fn element_bytes(kind: Type, component: ComponentType) -> usize {
    match (kind, component.size()) {
        (Type::Mat2, 1) => 6,
        (Type::Mat3, 1) => 11,
        (Type::Mat3, 2) => 22,
        (kind, size) => kind.multiplicity() * size,
    }
}

/// glTF 2.0 §3.6.2.2 (componentType) and §3.11 (normalised integers).
fn decode(component: ComponentType, normalized: bool, bytes: [u8; 4]) -> f32 {
    let signed = |value: f32, most: f32| if normalized { (value / most).max(-1.0) } else { value };
    let unsigned = |value: f32, most: f32| if normalized { value / most } else { value };
    match component {
        ComponentType::F32 => f32::from_le_bytes(bytes),
        ComponentType::I8 => signed(f32::from(bytes[0] as i8), 127.0),
        ComponentType::U8 => unsigned(f32::from(bytes[0]), 255.0),
        ComponentType::I16 => signed(f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
        ComponentType::U16 => {
            unsigned(f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0)
        }
        ComponentType::U32 => u32::from_le_bytes(bytes) as f32,
    }
}

/// Only unsigned types reach this; a signed one is read by its bit pattern.
fn decode_unsigned(component: ComponentType, bytes: [u8; 4]) -> u32 {
    match component.size() {
        1 => u32::from(bytes[0]),
        2 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        _ => u32::from_le_bytes(bytes),
    }
}
