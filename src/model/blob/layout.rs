//! Which tensors a blob has, in what shapes: the one table that writer and reader share.

use std::borrow::Cow;

use safetensors::Dtype;

use super::super::clustered::{self, Cluster, Clustered, Form};
use super::super::multilinear::{self, Multilinear};
use super::super::{Decoder, Family, Model, Precision, RestSizes, Shape};
use super::Sizes;

pub(super) const MEAN: &str = "mean";
pub(super) const WEIGHTS: &str = "decoder.weights";
pub(super) const COEFFICIENTS: &str = "decoder.coefficients";
pub(super) const BASIS: &str = "decoder.basis";
pub(super) const PROJECTION: &str = "encoder.projection";
pub(super) const CENTRES: &str = "encoder.centres";
pub(super) const EXPONENT: &str = "encoder.blend_exponent";
pub(super) const DIRECTIONS: &str = "encoder.directions";
pub(super) const POINT_OF_VERTEX: &str = "map.point_of_vertex";
pub(super) const ROW_OF_POINT: &str = "map.row_of_point";
pub(super) const CLUSTER_OF_POINT: &str = "map.cluster_of_point";
pub(super) const TANGENTS: &str = "tangents";
pub(super) const BONE_OF_POINT: &str = "map.bone_of_point";
pub(super) const OCCLUDER_WEIGHTS: &str = "occluder.weights";
pub(super) const OCCLUDER_OFFSETS: &str = "occluder.offsets";
pub(super) const OCCLUDER_RADII: &str = "occluder.radii";
pub(super) const OCCLUDER_SHAPES: &str = "occluder.shapes";
pub(super) const OCCLUDER_ANCHORS: &str = "map.occluder_anchors";
pub(super) const OCCLUDER_GROUPS: &str = "map.occluder_groups";

/// One tensor of numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) name: Cow<'static, str>,
    pub(super) shape: Vec<usize>,
    /// The dimension along which 8-bit numbers share a scale: the first or the last.
    shared: usize,
    /// Whether it is f32 in every precision.
    exact: bool,
}

impl Entry {
    fn new(name: impl Into<Cow<'static, str>>, shape: &[usize], shared: usize) -> Self {
        Self { name: name.into(), shape: shape.to_vec(), shared, exact: false }
    }

    fn exact(name: &'static str, shape: &[usize]) -> Self {
        Self { exact: true, ..Self::new(name, shape, 0) }
    }

    /// The precision in which it is stored, in a blob of this one.
    pub(super) fn precision(&self, of_blob: Precision) -> Precision {
        if self.exact { Precision::F32 } else { of_blob }
    }

    /// Shape of the scales: that of the tensor, with 1 along the shared dimension.
    pub(super) fn scale_shape(&self) -> Vec<usize> {
        let mut shape = self.shape.clone();
        shape[self.shared] = 1;
        shape
    }

    /// How many scales.
    pub(super) fn scales(&self) -> usize {
        self.scale_shape().iter().product()
    }

    /// The name of the tensor of scales.
    pub(super) fn scale_name(&self) -> String {
        format!("{}.scale", self.name)
    }

    /// The scale of the number at a flat index.
    pub(super) fn scale_of(&self, index: usize) -> usize {
        if self.shared == 0 {
            index % self.shape[1..].iter().product::<usize>()
        } else {
            index / self.shape[self.shared]
        }
    }
}

/// What shapes the tensors of a family beyond [`Shape`].
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Detail {
    Plain,
    Multilinear(multilinear::Sizes),
    Clustered(Form, Vec<clustered::Sizes>),
}

impl Detail {
    pub(super) fn of(decoder: &Decoder, shape: &Shape) -> Self {
        match decoder {
            Decoder::Mean { .. } | Decoder::Linear { .. } | Decoder::PcaLinear { .. } => {
                Self::Plain
            }
            Decoder::Multilinear(m) => Self::Multilinear(m.sizes(shape.width, shape.parameters)),
            Decoder::Clustered(c) => Self::Clustered(c.form, c.sizes(shape.parameters)),
        }
    }
}

/// The tensors of a family, in the order of [`arrays`].
pub(super) fn entries(family: Family, shape: &Shape, detail: &Detail) -> Vec<Entry> {
    let &Shape { points, width, parameters, inputs, outputs } = shape;
    let mean = Entry::new(MEAN, &[points, width], 0);
    match (detail, family) {
        (Detail::Multilinear(sizes), _) => multilinear_entries(shape, sizes, mean),
        (Detail::Clustered(_, sizes), _) => clustered_entries(shape, sizes),
        (Detail::Plain, Family::Linear) => {
            vec![mean, Entry::new(WEIGHTS, &[points, width, parameters], 0)]
        }
        (Detail::Plain, Family::PcaLinear) => vec![
            Entry::new(PROJECTION, &[parameters, inputs], 0),
            Entry::new(COEFFICIENTS, &[width, inputs + 1, outputs], 2),
            Entry::new(BASIS, &[points, outputs], 0),
        ],
        (Detail::Plain, _) => vec![mean],
    }
}

fn multilinear_entries(shape: &Shape, sizes: &multilinear::Sizes, mean: Entry) -> Vec<Entry> {
    let multilinear::Sizes { clusters, inputs, rows, inner, .. } = *sizes;
    let mut entries = vec![
        Entry::exact(EXPONENT, &[1]),
        Entry::exact(CENTRES, &[clusters, shape.parameters]),
        Entry::new(PROJECTION, &[shape.parameters, clusters, inputs], 0),
        Entry::new(COEFFICIENTS, &[rows, clusters, shape.width, inner], 0),
    ];
    if sizes.mean {
        entries.push(mean);
    }
    entries
}

fn clustered_entries(shape: &Shape, sizes: &[clustered::Sizes]) -> Vec<Entry> {
    let mut entries = vec![Entry::new(PROJECTION, &[shape.parameters, shape.inputs], 0)];
    for (i, cluster) in sizes.iter().enumerate() {
        let clustered::Sizes { rows, outputs, features, neurons } = *cluster;
        entries.push(Entry::new(cluster_name(i, "basis"), &[rows, outputs + 1], 0));
        if outputs > 0 {
            entries.push(Entry::new(cluster_name(i, "weights"), &[outputs, features], 0));
        }
        if neurons > 0 {
            let name = cluster_name(i, "hidden");
            entries.push(Entry::new(name, &[neurons, shape.inputs + 1], 0));
        }
    }
    entries
}

/// The tensor of a cluster of points.
pub(super) fn cluster_name(cluster: usize, what: &str) -> String {
    format!("cluster.{cluster}.{what}")
}

/// The weights of occluders, stored like a decoder's numbers.
pub(super) fn occluder_weights(points: usize, groups: usize) -> Entry {
    Entry::new(OCCLUDER_WEIGHTS, &[points, groups], 0)
}

/// A decoder's arrays, in the order of [`entries`].
pub(super) fn arrays(decoder: &Decoder) -> Vec<&[f32]> {
    match decoder {
        Decoder::Mean { mean } => vec![mean],
        Decoder::Linear { mean, weights } => vec![mean, weights],
        Decoder::PcaLinear { projection, coefficients, basis } => {
            vec![projection, coefficients, basis]
        }
        Decoder::Multilinear(m) => {
            let exponent = std::slice::from_ref(&m.blend_exponent);
            let all: [&[f32]; 5] = [exponent, &m.centres, &m.projection, &m.coefficients, &m.mean];
            all[..if m.mean.is_empty() { 4 } else { 5 }].to_vec()
        }
        Decoder::Clustered(c) => {
            let mut all: Vec<&[f32]> = vec![&c.projection];
            for cluster in &c.clusters {
                all.push(&cluster.basis);
                let rest = [&cluster.weights, &cluster.hidden];
                all.extend(rest.into_iter().filter(|x| !x.is_empty()).map(Vec::as_slice));
            }
            all
        }
    }
}

/// The decoder of these arrays, given in the order of [`entries`], and of its map.
pub(super) fn decoder(
    family: Family,
    detail: &Detail,
    arrays: Vec<Vec<f32>>,
    map: Vec<u32>,
) -> Decoder {
    let mut arrays = arrays.into_iter();
    let mut next = || arrays.next().expect("one array per entry");
    match (detail, family) {
        (Detail::Multilinear(sizes), _) => Decoder::Multilinear(Multilinear {
            blend_exponent: next().first().copied().unwrap_or(0.0),
            inputs: sizes.inputs,
            intercepts: sizes.inner > sizes.inputs,
            centres: next(),
            projection: next(),
            coefficients: next(),
            mean: if sizes.mean { next() } else { Vec::new() },
            row_of_point: map,
        }),
        (Detail::Clustered(form, sizes), _) => {
            let projection = next();
            let cluster = |sizes: &clustered::Sizes| Cluster {
                outputs: sizes.outputs,
                basis: next(),
                weights: if sizes.outputs > 0 { next() } else { Vec::new() },
                hidden: if sizes.neurons > 0 { next() } else { Vec::new() },
            };
            let clusters = sizes.iter().map(cluster).collect();
            let (form, cluster_of_point) = (*form, map);
            Decoder::Clustered(Clustered { form, projection, cluster_of_point, clusters })
        }
        (Detail::Plain, Family::Linear) => Decoder::Linear { mean: next(), weights: next() },
        (Detail::Plain, Family::PcaLinear) => {
            Decoder::PcaLinear { projection: next(), coefficients: next(), basis: next() }
        }
        (Detail::Plain, _) => Decoder::Mean { mean: next() },
    }
}

/// The map that a decoder has beside its numbers: its tensor, what it counts, and the indices.
pub(super) fn own_map<'a>(
    decoder: &'a Decoder,
    detail: &Detail,
) -> Option<(&'static str, usize, &'a [u32])> {
    match (decoder, detail) {
        (Decoder::Multilinear(m), Detail::Multilinear(sizes)) if sizes.mapped => {
            Some((ROW_OF_POINT, sizes.rows, &m.row_of_point))
        }
        (Decoder::Clustered(c), _) => {
            Some((CLUSTER_OF_POINT, c.clusters.len(), &c.cluster_of_point))
        }
        _ => None,
    }
}

/// The type of a decoder's tensors.
pub(super) fn number_dtype(precision: Precision) -> Dtype {
    match precision {
        Precision::F32 => Dtype::F32,
        Precision::F16 => Dtype::F16,
        Precision::I8 => Dtype::I8,
    }
}

/// The smallest unsigned type that holds indices below `count`, with its bytes.
pub(super) fn index_dtype(count: usize) -> (Dtype, usize) {
    match count {
        0..=0x100 => (Dtype::U8, 1),
        0x101..=0x1_0000 => (Dtype::U16, 2),
        _ => (Dtype::U32, 4),
    }
}

pub(super) fn sizes(model: &Model, precision: Precision) -> Sizes {
    let (shape, header) = (model.shape(), model.header());
    let plain = matches!(header.family, Family::Mean | Family::Linear | Family::PcaLinear);
    let decoder = (!plain).then(|| model.decoder());
    let detail = decoder.as_ref().map_or(Detail::Plain, |d| Detail::of(d, &shape));
    let mut sizes = Sizes { decoder: 0, scales: 0, directions: 0, maps: 0, occluders: 0, rest: 0 };
    for entry in entries(header.family, &shape, &detail) {
        let own = entry.precision(precision);
        sizes.decoder += entry.shape.iter().product::<usize>() as u64 * own.bytes();
        sizes.scales += if own == Precision::I8 { 4 * entry.scales() as u64 } else { 0 };
    }
    let own_map = decoder.as_ref().and_then(|decoder| own_map(decoder, &detail));
    let own_map = own_map.map_or(0, |(_, count, map)| map.len() * index_dtype(count).1);
    let points = match model.points_are_vertices() {
        true => 0,
        false => model.point_of_vertex().len() * index_dtype(shape.points).1,
    };
    let bones = model.bone_of_point().len() * index_dtype(header.rig.bones.len()).1;
    sizes.directions = 4 * header.training.directions.len() as u64;
    let tangents = 3 * model.tangents().len();
    sizes.maps = (points + bones + tangents + own_map) as u64;
    if let Some(mesh) = model.rest() {
        sizes.rest = RestSizes::of(mesh).bytes(shape.points, header.rig.nodes.len());
    }
    if let Some(occluders) = model.occluders() {
        let groups = occluders.groups(shape.points);
        let anchors = occluders.anchors.len() * index_dtype(shape.points).1;
        sizes.scales += if precision == Precision::I8 { 4 * groups as u64 } else { 0 };
        sizes.occluders = occluders.weights.len() as u64 * precision.bytes()
            + (16 * occluders.spheres() + 4 * occluders.shapes.len() + anchors) as u64
            + occluders.group_of.len() as u64;
    }
    sizes
}
