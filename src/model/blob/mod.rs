//! The blob: one safetensors file per model, specified in `proto/model.md`.

mod layout;
mod quantise;
mod read;
mod rest;
mod write;

use super::{Error, Model, Occluders, Precision};

/// Bytes of a blob's parts. `decoder` is what published sizes count; the rest stands beside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sizes {
    /// The model's own tensors: means, weights, projection, coefficients, basis.
    pub decoder: u64,
    /// Scales of 8-bit columns.
    pub scales: u64,
    /// Directions of the training poses, where the family has no projection that gives them.
    pub directions: u64,
    /// Vertex → point and point → bone.
    pub maps: u64,
    /// Spheres, groups and weights of occluders, where there are any.
    pub occluders: u64,
    /// The rest mesh and what moves it, where the model carries it.
    pub rest: u64,
}

impl Sizes {
    /// All tensors, the JSON header not counted.
    #[must_use]
    pub fn total(self) -> u64 {
        self.decoder + self.scales + self.directions + self.maps + self.occluders + self.rest
    }
}

impl Model {
    /// The model as a safetensors file. The same model gives the same bytes.
    ///
    /// # Errors
    /// [`Error::NotRepresentable`] where a number overflows the precision, [`Error::Limit`] where
    /// the header is larger than a reader accepts.
    pub fn to_bytes(&self, precision: Precision) -> Result<Vec<u8>, Error> {
        write::write(self, precision)
    }

    /// A model from the bytes of a safetensors file, which may come from anybody.
    ///
    /// Memory is bounded by a small multiple of the file's size.
    ///
    /// # Errors
    /// Whatever is wrong with them; every field is checked before it is used.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        read::read(bytes)
    }

    /// How large the blob's tensors are in a precision.
    #[must_use]
    pub fn sizes(&self, precision: Precision) -> Sizes {
        layout::sizes(self, precision)
    }
}

impl Occluders {
    /// The same occluders, their weights rounded to what 8 bits hold: 255 steps for each group.
    /// Then every precision has the same weights, and whatever is fitted to what they leave makes
    /// up for the rounding. Weights that 8 bits cannot hold stay as they are.
    #[must_use]
    pub fn in_eight_bits(mut self, points: usize) -> Self {
        let entry = layout::occluder_weights(points, self.groups(points));
        if let Ok(encoded) = quantise::encode(&entry, &self.weights, Precision::I8) {
            self.weights = quantise::decode(&entry, &encoded.bytes, &encoded.scales, Precision::I8);
        }
        self
    }
}

#[cfg(test)]
mod tests;
