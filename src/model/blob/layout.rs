//! Which tensors a blob has, in what shapes: the one table that writer and reader share.

use safetensors::Dtype;

use super::super::{Decoder, Family, Model, Precision, Shape};
use super::Sizes;

pub(super) const MEAN: &str = "mean";
pub(super) const WEIGHTS: &str = "decoder.weights";
pub(super) const COEFFICIENTS: &str = "decoder.coefficients";
pub(super) const BASIS: &str = "decoder.basis";
pub(super) const PROJECTION: &str = "encoder.projection";
pub(super) const DIRECTIONS: &str = "encoder.directions";
pub(super) const POINT_OF_VERTEX: &str = "map.point_of_vertex";
pub(super) const BONE_OF_POINT: &str = "map.bone_of_point";

/// One tensor of numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) name: &'static str,
    pub(super) shape: Vec<usize>,
    /// The dimension along which 8-bit numbers share a scale: the first or the last.
    shared: usize,
}

impl Entry {
    fn new(name: &'static str, shape: &[usize], shared: usize) -> Self {
        Self { name, shape: shape.to_vec(), shared }
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

/// The tensors of a family, in the order of [`arrays`].
pub(super) fn entries(family: Family, shape: &Shape) -> Vec<Entry> {
    let &Shape { points, width, parameters, inputs, outputs } = shape;
    let mean = Entry::new(MEAN, &[points, width], 0);
    match family {
        Family::Mean => vec![mean],
        Family::Linear => vec![mean, Entry::new(WEIGHTS, &[points, width, parameters], 0)],
        Family::PcaLinear => vec![
            Entry::new(PROJECTION, &[parameters, inputs], 0),
            Entry::new(COEFFICIENTS, &[width, inputs + 1, outputs], 2),
            Entry::new(BASIS, &[points, outputs], 0),
        ],
    }
}

/// A decoder's arrays, in the order of [`entries`].
pub(super) fn arrays(decoder: &Decoder) -> Vec<&[f32]> {
    match decoder {
        Decoder::Mean { mean } => vec![mean],
        Decoder::Linear { mean, weights } => vec![mean, weights],
        Decoder::PcaLinear { projection, coefficients, basis } => {
            vec![projection, coefficients, basis]
        }
    }
}

/// The decoder of these arrays, given in the order of [`entries`].
pub(super) fn decoder(family: Family, arrays: Vec<Vec<f32>>) -> Decoder {
    let mut arrays = arrays.into_iter();
    let mut next = || arrays.next().expect("one array per entry");
    match family {
        Family::Mean => Decoder::Mean { mean: next() },
        Family::Linear => Decoder::Linear { mean: next(), weights: next() },
        Family::PcaLinear => {
            Decoder::PcaLinear { projection: next(), coefficients: next(), basis: next() }
        }
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
    let shape = model.shape();
    let header = model.header();
    let entries = entries(header.family, &shape);
    let scales: usize = match precision {
        Precision::I8 => entries.iter().map(Entry::scales).sum(),
        Precision::F32 | Precision::F16 => 0,
    };
    let points = model.point_of_vertex().len() * index_dtype(shape.points).1;
    let bones = model.bone_of_point().len() * index_dtype(header.rig.bones.len()).1;
    Sizes {
        decoder: shape.numbers(header.family) * precision.bytes(),
        scales: 4 * scales as u64,
        directions: 4 * header.training.directions.len() as u64,
        maps: (points + bones) as u64,
    }
}
