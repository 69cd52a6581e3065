//! Rank 7. Ray queries: Embree 4 behind safe types on plain slices.
//!
//! A [`Scene`] is built from positions and triangles and never changes afterwards, so any number
//! of threads may trace it. Rays come as one origin with a block of directions ([`Rays`]): that
//! is how points are baked, and how packets stay full.
//!
//! *Invariant:* no type of Embree's appears outside `trace/embree/`, and no `unsafe` either.

mod embree;
mod error;
mod rays;

pub use embree::{Candidate, Device, Filter, Scene};
pub use error::{Code, Error};
pub use rays::{Hit, Rays, Width, words_of};

/// Metres. Embree leaves out every triangle with a coordinate beyond this (its `FLT_LARGE`).
pub const POSITION_LIMIT_M: f32 = 1.844e18;

#[cfg(test)]
pub(crate) mod shapes;
#[cfg(test)]
mod tests;
