//! Bytes → model, trusting nothing.

use std::collections::BTreeMap;

use safetensors::tensor::TensorInfo;
use safetensors::{Dtype, SafeTensors};
use serde::Deserialize;

use super::super::clustered::{self, Form};
use super::super::header::{limits, within};
use super::super::multilinear;
use super::super::occluder::ANCHORS;
use super::super::{
    Error, FORMAT_VERSION, Family, Frame, Header, Model, OccluderSizes, Occluders, Precision, Shape,
};
use super::layout::{
    BASIS, BONE_OF_POINT, CLUSTER_OF_POINT, COEFFICIENTS, DIRECTIONS, Detail, Entry, MEAN,
    OCCLUDER_ANCHORS, OCCLUDER_GROUPS, OCCLUDER_OFFSETS, OCCLUDER_RADII, OCCLUDER_SHAPES,
    POINT_OF_VERTEX, PROJECTION, ROW_OF_POINT, TANGENTS, cluster_name, decoder, entries,
    index_dtype, number_dtype, occluder_weights,
};
use super::quantise::{decode, f32_values, index_values};

/// The tensors of a file that have not been read yet.
pub(super) struct Tensors<'a> {
    infos: BTreeMap<String, TensorInfo>,
    data: &'a [u8],
}

/// The only field that every version has.
#[derive(Deserialize)]
struct Version {
    format_version: u32,
}

pub(super) fn read(bytes: &[u8]) -> Result<Model, Error> {
    let (mut header, mut tensors) = open(bytes)?;
    header.check()?;
    header.rig.check_points(header.mesh.points)?;
    let mut shape = shape(&header, &tensors)?;
    let detail = detail(&header, &mut shape, &tensors)?;
    let arrays = entries(header.family, &shape, &detail)
        .iter()
        .map(|entry| tensors.numbers(entry, entry.precision(header.precision)))
        .collect::<Result<Vec<_>, _>>()?;
    let directions = header.training.deviations.len();
    let projected = header.family == Family::PcaLinear || Form::of(header.family).is_some();
    if !projected && directions > 0 {
        let bytes = tensors.take(DIRECTIONS, Dtype::F32, &[shape.parameters, directions])?;
        header.training.directions = f32_values(bytes);
    }
    let vertices = header.mesh.vertices as usize;
    let point_of_vertex = match vertices == shape.points && !tensors.has(POINT_OF_VERTEX) {
        true => (0..header.mesh.points).collect(),
        false => tensors.indices(POINT_OF_VERTEX, &[vertices], shape.points)?,
    };
    let bone_of_point = match header.frame {
        Frame::Root | Frame::Tangent => Vec::new(),
        Frame::Bone => {
            let bones = tensors.indices(BONE_OF_POINT, &[shape.points], header.rig.bones.len())?;
            // More bones than 16 bits name would have been refused with the header.
            bones.into_iter().map(|bone| bone as u16).collect()
        }
    };
    let tangents = match header.frame {
        Frame::Root | Frame::Bone => None,
        Frame::Tangent => {
            let bytes = tensors.take(TANGENTS, Dtype::I8, &[shape.points, 3])?;
            let three = |bytes: &[u8; 3]| bytes.map(|byte| i8::from_le_bytes([byte]));
            Some(bytes.as_chunks().0.iter().map(three).collect())
        }
    };
    let map = own_map(&detail, &shape, &mut tensors)?;
    let occluders = match header.occluders {
        None => None,
        Some(sizes) => Some(occluders(&mut tensors, &header, sizes)?),
    };
    let rest = match header.rest {
        None => None,
        Some(sizes) => Some(super::rest::read(&mut tensors, &header, sizes)?),
    };
    tensors.finish()?;
    let decoder = decoder(header.family, &detail, arrays, map);
    let model = Model::new(header, decoder, point_of_vertex, bone_of_point)?;
    let model = match tangents {
        None => model,
        Some(tangents) => model.with_tangents(tangents)?,
    };
    let model = match occluders {
        None => model,
        Some(occluders) => model.with_occluders(occluders)?,
    };
    match rest {
        None => Ok(model),
        Some(rest) => model.with_rest(rest),
    }
}

/// The tensors of occluders of these sizes; the model checks what they hold.
fn occluders(
    tensors: &mut Tensors<'_>,
    header: &Header,
    sizes: OccluderSizes,
) -> Result<Occluders, Error> {
    within("occluders", u64::from(sizes.spheres), limits::OCCLUDERS)?;
    within("groups of occluders", u64::from(sizes.groups), limits::OCCLUDER_GROUPS)?;
    let [points, spheres, groups] =
        [header.mesh.points, sizes.spheres, sizes.groups].map(|size| size as usize);
    let bones = header.rig.bones.len();
    let (of_anchors, of_groups) = ([spheres, ANCHORS], [bones, spheres]);
    let shapes = match sizes.directions {
        0 => Vec::new(),
        _ => f32_values(tensors.take(OCCLUDER_SHAPES, Dtype::F32, &[spheres, 6])?),
    };
    let groups_of = tensors.indices(OCCLUDER_GROUPS, &of_groups, groups)?;
    Ok(Occluders {
        anchors: tensors.indices(OCCLUDER_ANCHORS, &of_anchors, points)?,
        offsets: f32_values(tensors.take(OCCLUDER_OFFSETS, Dtype::F32, &[spheres, 3])?),
        radii: f32_values(tensors.take(OCCLUDER_RADII, Dtype::F32, &[spheres])?),
        shapes,
        directions: sizes.directions as usize,
        // At most 256 groups, so every index was stored in a byte.
        group_of: groups_of.into_iter().map(|group| group as u8).collect(),
        weights: tensors.numbers(&occluder_weights(points, groups), header.precision)?,
    })
}

/// The header, parsed but not checked, and the tensors.
fn open(bytes: &[u8]) -> Result<(Header, Tensors<'_>), Error> {
    if let Some(&length) = bytes.first_chunk() {
        within("the header's length in bytes", u64::from_le_bytes(length), limits::HEADER_BYTES)?;
    }
    let (length, metadata) = SafeTensors::read_metadata(bytes)
        .map_err(|error| Error::NotSafetensors { reason: error.to_string() })?;
    let json = metadata
        .metadata()
        .as_ref()
        .and_then(|metadata| metadata.get("poselight"))
        .ok_or(Error::NotPoselight)?;
    let reason = |error: serde_json::Error| Error::Header { reason: error.to_string() };
    let Version { format_version: found } = serde_json::from_str(json).map_err(reason)?;
    if found != FORMAT_VERSION {
        return Err(Error::Version { found, supported: FORMAT_VERSION });
    }
    let header = serde_json::from_str(json).map_err(reason)?;
    let infos = metadata.tensors().into_iter().map(|(name, info)| (name, info.clone())).collect();
    Ok((header, Tensors { infos, data: &bytes[8 + length..] }))
}

/// The shape that the header states, with the reduced dimensions that only the tensors state.
fn shape(header: &Header, tensors: &Tensors<'_>) -> Result<Shape, Error> {
    let mut shape = Shape {
        points: header.mesh.points as usize,
        width: header.width(),
        parameters: header.parameters(),
        inputs: 0,
        outputs: 0,
    };
    if header.family == Family::PcaLinear {
        shape.inputs = tensors.columns(PROJECTION)?;
        shape.outputs = tensors.columns(BASIS)?;
        within("input dimensions", shape.inputs as u64, shape.parameters as u64)?;
        within("output dimensions", shape.outputs as u64, limits::OUTPUTS)?;
    }
    Ok(shape)
}

/// The sizes that only the tensors of a family state. What they claim is checked with the model.
fn detail(header: &Header, shape: &mut Shape, tensors: &Tensors<'_>) -> Result<Detail, Error> {
    let has = |name: &str| tensors.infos.contains_key(name);
    if header.family == Family::Multilinear {
        let [_, clusters, inputs] = tensors.shape(PROJECTION)?;
        let [rows, _, _, inner] = tensors.shape(COEFFICIENTS)?;
        let (mean, mapped) = (has(MEAN), has(ROW_OF_POINT));
        let inner = if inner > inputs { inputs.saturating_add(1) } else { inputs };
        shape.inputs = inputs;
        within("pose clusters", clusters as u64, limits::CLUSTERS)?;
        within("input dimensions", inputs as u64, shape.parameters as u64)?;
        let sizes = multilinear::Sizes { clusters, inputs, rows, inner, mean, mapped };
        return Ok(Detail::Multilinear(sizes));
    }
    let Some(form) = Form::of(header.family) else { return Ok(Detail::Plain) };
    shape.inputs = tensors.columns(PROJECTION)?;
    within("input dimensions", shape.inputs as u64, shape.parameters as u64)?;
    let mut sizes = Vec::new();
    while has(&cluster_name(sizes.len(), "basis")) {
        within("clusters", sizes.len() as u64 + 1, limits::CLUSTERS)?;
        let [rows, columns] = tensors.shape(&cluster_name(sizes.len(), "basis"))?;
        let hidden = cluster_name(sizes.len(), "hidden");
        let neurons = if has(&hidden) { tensors.shape::<2>(&hidden)?[0] } else { 0 };
        let outputs = columns.saturating_sub(1);
        within("output dimensions", outputs as u64, limits::OUTPUTS)?;
        within("neurons", neurons as u64, limits::OUTPUTS)?;
        let features = form.count(shape.inputs, neurons) + 1;
        sizes.push(clustered::Sizes { rows, outputs, features, neurons });
    }
    Ok(Detail::Clustered(form, sizes))
}

/// The map that the family's decoder has.
fn own_map(detail: &Detail, shape: &Shape, tensors: &mut Tensors<'_>) -> Result<Vec<u32>, Error> {
    match detail {
        Detail::Multilinear(sizes) if sizes.mapped => {
            let count = sizes.clusters.saturating_mul(shape.points);
            tensors.indices(ROW_OF_POINT, &[count], sizes.rows)
        }
        Detail::Clustered(_, sizes) => {
            tensors.indices(CLUSTER_OF_POINT, &[shape.points], sizes.len())
        }
        _ => Ok(Vec::new()),
    }
}

impl<'a> Tensors<'a> {
    /// The shape of a tensor of N dimensions.
    fn shape<const N: usize>(&self, name: &str) -> Result<[usize; N], Error> {
        let info = self.infos.get(name).ok_or_else(|| missing(name))?;
        info.shape.as_slice().try_into().map_err(|_| Error::TensorShape {
            name: name.to_owned(),
            expected: format!("of {N} dimensions"),
            found: describe(info.dtype, &info.shape),
        })
    }

    /// The second dimension of a matrix.
    fn columns(&self, name: &str) -> Result<usize, Error> {
        let info = self.infos.get(name).ok_or_else(|| missing(name))?;
        match info.shape[..] {
            [_, columns] => Ok(columns),
            _ => Err(Error::TensorShape {
                name: name.to_owned(),
                expected: "a matrix".to_owned(),
                found: describe(info.dtype, &info.shape),
            }),
        }
    }

    /// The bytes of a tensor of exactly this type and shape.
    pub(super) fn take(
        &mut self,
        name: &str,
        dtype: Dtype,
        shape: &[usize],
    ) -> Result<&'a [u8], Error> {
        let info = self.infos.remove(name).ok_or_else(|| missing(name))?;
        if info.dtype != dtype || info.shape != shape {
            return Err(Error::TensorShape {
                name: name.to_owned(),
                expected: describe(dtype, shape),
                found: describe(info.dtype, &info.shape),
            });
        }
        // Offsets agree with type and shape and lie within the file: checked by `read_metadata`.
        let (start, end) = info.data_offsets;
        Ok(&self.data[start..end])
    }

    fn numbers(&mut self, entry: &Entry, precision: Precision) -> Result<Vec<f32>, Error> {
        let bytes = self.take(&entry.name, number_dtype(precision), &entry.shape)?;
        let scales = match precision {
            Precision::F32 | Precision::F16 => Vec::new(),
            Precision::I8 => {
                f32_values(self.take(&entry.scale_name(), Dtype::F32, &entry.scale_shape())?)
            }
        };
        Ok(decode(entry, bytes, &scales, precision))
    }

    /// Indices below `below`, in the smallest type that holds them; the model checks the range.
    pub(super) fn indices(
        &mut self,
        name: &str,
        shape: &[usize],
        below: usize,
    ) -> Result<Vec<u32>, Error> {
        let (dtype, size) = index_dtype(below);
        Ok(index_values(self.take(name, dtype, shape)?, size))
    }

    fn has(&self, name: &str) -> bool {
        self.infos.contains_key(name)
    }

    /// Nothing may be left over.
    fn finish(&self) -> Result<(), Error> {
        match self.infos.keys().next() {
            Some(name) => Err(Error::UnexpectedTensor { name: name.clone() }),
            None => Ok(()),
        }
    }
}

fn missing(name: &str) -> Error {
    Error::MissingTensor { name: name.to_owned() }
}

fn describe(dtype: Dtype, shape: &[usize]) -> String {
    format!("{dtype} {shape:?}")
}
