//! Rank 9. The training set on disk.

mod error;
mod training;

pub use error::Error;
pub use training::{Training, TrainingParts};
