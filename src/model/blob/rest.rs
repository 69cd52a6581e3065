//! The tensors of a rest mesh: all F32 or indices, in every precision of the blob.

use safetensors::Dtype;

use super::super::header::limits;
use super::super::rest::{Arrays, RestSizes};
use super::super::{Error, Header};
use super::layout::index_dtype;
use super::quantise::{f32_bytes, f32_values, index_bytes};
use super::read::Tensors;
use super::write::Tensor;
use crate::rig::Mesh;

const NUMBERS: [&str; 6] = [
    "rest.positions",
    "rest.normals",
    "rest.binds",
    "rest.weights",
    "rest.position_deltas",
    "rest.normal_deltas",
];
const INDICES: [&str; 6] = [
    "map.rest_nodes",
    "map.rest_counts",
    "map.rest_deformers",
    "map.rest_slots",
    "map.rest_lengths",
    "map.rest_displaced",
];

/// Shapes of [`NUMBERS`]; lengths of [`INDICES`] with the number that each is below.
struct Layout {
    numbers: [Vec<usize>; 6],
    indices: [(usize, usize); 6],
}

impl Layout {
    fn of(sizes: RestSizes, points: usize, nodes: usize) -> Self {
        let RestSizes { deformers, influences, morphs, deltas } = sizes;
        let [d, i, m, e] = [deformers, influences, morphs, deltas].map(|size| size as usize);
        let numbers =
            [vec![points, 3], vec![points, 3], vec![d, 12], vec![i], vec![e, 3], vec![e, 3]];
        let any = limits::POINTS as usize + 1;
        let indices = [(d, nodes), (points, i + 1), (i, d), (m, any), (m, e + 1), (e, points)];
        Self { numbers, indices }
    }
}

pub(super) fn tensors(mesh: &Mesh, nodes: usize) -> Vec<(&'static str, Tensor)> {
    let layout = Layout::of(RestSizes::of(mesh), mesh.positions.len(), nodes);
    let all = Arrays::of(mesh);
    let numbers = [
        all.positions,
        all.normals,
        all.binds,
        all.weights,
        all.position_deltas,
        all.normal_deltas,
    ];
    let indices = [all.nodes, all.counts, all.deformers, all.slots, all.lengths, all.displaced];
    let mut out = Vec::with_capacity(NUMBERS.len() + INDICES.len());
    for ((name, shape), values) in NUMBERS.into_iter().zip(layout.numbers).zip(numbers) {
        out.push((name, Tensor { dtype: Dtype::F32, shape, bytes: f32_bytes(&values) }));
    }
    for ((name, (length, below)), list) in INDICES.into_iter().zip(layout.indices).zip(indices) {
        let (dtype, size) = index_dtype(below);
        let bytes = index_bytes(list.into_iter(), size);
        out.push((name, Tensor { dtype, shape: vec![length], bytes }));
    }
    out
}

impl RestSizes {
    /// Bytes of the blob's tensors of a rest mesh of these sizes: so many points, in a rig of so many
    /// nodes.
    #[must_use]
    pub fn bytes(self, points: usize, nodes: usize) -> u64 {
        let layout = Layout::of(self, points, nodes);
        let numbers = layout.numbers.iter().map(|shape| 4 * shape.iter().product::<usize>());
        let indices = layout.indices.iter().map(|&(length, below)| length * index_dtype(below).1);
        numbers.chain(indices).sum::<usize>() as u64
    }
}

/// A mesh of these sizes; the model checks what it holds.
pub(super) fn read(
    tensors: &mut Tensors<'_>,
    header: &Header,
    sizes: RestSizes,
) -> Result<Mesh, Error> {
    sizes.check()?;
    let layout = Layout::of(sizes, header.mesh.points as usize, header.rig.nodes.len());
    let mut numbers = Vec::with_capacity(NUMBERS.len());
    for (name, shape) in NUMBERS.into_iter().zip(&layout.numbers) {
        numbers.push(f32_values(tensors.take(name, Dtype::F32, shape)?));
    }
    let mut indices = Vec::with_capacity(INDICES.len());
    for (name, (length, below)) in INDICES.into_iter().zip(layout.indices) {
        indices.push(tensors.indices(name, &[length], below)?);
    }
    let (mut numbers, mut indices) = (numbers.into_iter(), indices.into_iter());
    let mut number = || numbers.next().unwrap_or_default();
    let mut index = || indices.next().unwrap_or_default();
    Arrays {
        positions: number(),
        normals: number(),
        binds: number(),
        weights: number(),
        position_deltas: number(),
        normal_deltas: number(),
        nodes: index(),
        counts: index(),
        deformers: index(),
        slots: index(),
        lengths: index(),
        displaced: index(),
    }
    .mesh()
}
