//! Model → bytes.

use std::borrow::Cow;
use std::collections::HashMap;

use safetensors::{Dtype, View};

use super::super::header::{limits, within};
use super::super::occluder::ANCHORS;
use super::super::{Error, Header, Model, Precision};
use super::layout::{
    BONE_OF_POINT, DIRECTIONS, Detail, OCCLUDER_ANCHORS, OCCLUDER_GROUPS, OCCLUDER_OFFSETS,
    OCCLUDER_RADII, OCCLUDER_SHAPES, POINT_OF_VERTEX, TANGENTS, arrays, entries, index_dtype,
    number_dtype, occluder_weights, own_map,
};
use super::quantise::{encode, f32_bytes, index_bytes};

/// A tensor on its way into the file.
pub(super) struct Tensor {
    pub(super) dtype: Dtype,
    pub(super) shape: Vec<usize>,
    pub(super) bytes: Vec<u8>,
}

impl View for Tensor {
    fn dtype(&self) -> Dtype {
        self.dtype
    }
    fn shape(&self) -> &[usize] {
        &self.shape
    }
    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }
    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

pub(super) fn write(model: &Model, precision: Precision) -> Result<Vec<u8>, Error> {
    let header = Header { precision, ..model.header().clone() };
    let json = serde_json::to_string(&header)
        .map_err(|error| Error::Header { reason: error.to_string() })?;
    // One key only: the order of a hash map's keys must not reach the bytes.
    let metadata = HashMap::from([("poselight".to_owned(), json)]);
    let bytes = safetensors::serialize(tensors(model, precision)?, Some(metadata))
        .map_err(|error| Error::NotSafetensors { reason: error.to_string() })?;
    let length = bytes.first_chunk().map_or(0, |&length| u64::from_le_bytes(length));
    within("the header's length in bytes", length, limits::HEADER_BYTES)?;
    Ok(bytes)
}

fn tensors(model: &Model, precision: Precision) -> Result<Vec<(String, Tensor)>, Error> {
    let (shape, header) = (model.shape(), model.header());
    let decoder = model.decoder();
    let mut tensors = Vec::new();
    let detail = Detail::of(&decoder, &shape);
    let entries = entries(header.family, &shape, &detail);
    let mut numbers: Vec<_> = entries.into_iter().zip(arrays(&decoder)).collect();
    if let Some(occluders) = model.occluders() {
        let groups = occluders.groups(shape.points);
        numbers.push((occluder_weights(shape.points, groups), &occluders.weights));
    }
    for (entry, values) in numbers {
        let precision = entry.precision(precision);
        let encoded = encode(&entry, values, precision)?;
        if precision == Precision::I8 {
            let bytes = f32_bytes(&encoded.scales);
            let scales = Tensor { dtype: Dtype::F32, shape: entry.scale_shape(), bytes };
            tensors.push((entry.scale_name(), scales));
        }
        let dtype = number_dtype(precision);
        let tensor = Tensor { dtype, shape: entry.shape, bytes: encoded.bytes };
        tensors.push((entry.name.into_owned(), tensor));
    }
    let directions = &header.training.directions;
    if !directions.is_empty() {
        let shape = vec![shape.parameters, header.training.deviations.len()];
        let bytes = f32_bytes(directions);
        tensors.push((DIRECTIONS.to_owned(), Tensor { dtype: Dtype::F32, shape, bytes }));
    }
    tensors.extend(tangents(model));
    let mut index = |name: &str, below, shape: Vec<usize>, indices: Vec<u32>| {
        let (dtype, size) = index_dtype(below);
        let bytes = index_bytes(indices.into_iter(), size);
        tensors.push((name.to_owned(), Tensor { dtype, shape, bytes }));
    };
    if let Some((name, count, map)) = own_map(&decoder, &detail) {
        index(name, count, vec![map.len()], map.to_vec());
    }
    if !model.points_are_vertices() {
        let points = model.point_of_vertex().to_vec();
        index(POINT_OF_VERTEX, shape.points, vec![points.len()], points);
    }
    let bones = header.rig.bones.len();
    if !model.bone_of_point().is_empty() {
        let of_point = model.bone_of_point().iter().map(|&bone| u32::from(bone)).collect();
        index(BONE_OF_POINT, bones, vec![shape.points], of_point);
    }
    if let Some(occluders) = model.occluders() {
        let spheres = occluders.spheres();
        let groups = occluders.group_of.iter().map(|&group| u32::from(group)).collect();
        index(OCCLUDER_ANCHORS, shape.points, vec![spheres, ANCHORS], occluders.anchors.clone());
        index(OCCLUDER_GROUPS, occluders.groups(shape.points), vec![bones, spheres], groups);
        for (name, shape, values) in [
            (OCCLUDER_OFFSETS, vec![spheres, 3], &occluders.offsets),
            (OCCLUDER_RADII, vec![spheres], &occluders.radii),
            (OCCLUDER_SHAPES, vec![spheres, 6], &occluders.shapes),
        ] {
            if values.is_empty() {
                continue;
            }
            let tensor = Tensor { dtype: Dtype::F32, shape, bytes: f32_bytes(values) };
            tensors.push((name.to_owned(), tensor));
        }
    }
    if let Some(mesh) = model.rest() {
        let own = super::rest::tensors(mesh, header.rig.nodes.len());
        tensors.extend(own.into_iter().map(|(name, tensor)| (name.to_owned(), tensor)));
    }
    Ok(tensors)
}

/// Of a model in the tangent frame.
fn tangents(model: &Model) -> Option<(String, Tensor)> {
    let tangents = model.tangents();
    let bytes: Vec<u8> = tangents.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    let tensor = Tensor { dtype: Dtype::I8, shape: vec![tangents.len(), 3], bytes };
    (!tangents.is_empty()).then(|| (TANGENTS.to_owned(), tensor))
}
