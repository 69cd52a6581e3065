//! Rank 9. The training set on disk: a Zarr v3 group that zarr-python, xarray and plain
//! `numpy.memmap` open (`proto/dataset.md` describes it for them).
//!
//! # Why the files are written here and not by a Zarr library
//! Arrays are uncompressed (`bytes` codec, little-endian) and one chunk is one file, so a chunk is
//! the raw numbers and an array's metadata is one JSON object that is known beforehand. What a bake
//! needs of its files is that they are whole or absent, in an order that survives a kill and a
//! power cut; a general store gives no such promise.
//!
//! # Commit
//! A file appears by write-to-temporary, fsync, rename, fsync of the folder. A data set is created
//! when its root's `zarr.json` appears, last of all that does not depend on rays. A block is
//! `rays`, `noise`, then `coefficients`; the last one's presence is the commit, and nothing else
//! records progress. So a writer that is killed anywhere leaves temporaries and missing blocks, and
//! the next one ends with the same bytes as an undisturbed bake.
//!
//! *Invariant:* nothing read from a file is believed before it is checked, and no allocation is
//! made for an array before a file of that size is found.
//! *Invariant:* blocks are never held in memory whole by a reader.

mod arrays;
mod blocks;
mod error;
mod files;
mod header;
mod json;
mod layout;
mod movement;
mod reader;
mod reference;
mod tables;
mod training;
mod values;
mod writer;

pub use error::Error;
pub use header::{Attributes, FORMAT_VERSION, Header, PartRange, SPLIT_NAMES};
pub use layout::Layout;
pub use movement::Movement;
pub use reader::Dataset;
pub use reference::{Reference, ReferenceHeader, ReferencePose};
pub use tables::{PoseTable, RestMesh, Static};
pub use training::{Training, TrainingParts};
pub use writer::{PoseData, Writer};

#[cfg(test)]
mod tests;
