//! Rank 11. Errors, costs and the report.
//!
//! A [`Measurement`] is fed one [`Case`] (pose) at a time: two references of many rays and
//! different seeds, and what each candidate predicts. It keeps sums, so its memory does not grow
//! with the data, and ends in [`Measured`], a JSON document. [`report::html`] makes a page of it.
//!
//! *Invariant:* the judge shares no code with the fit; it stands on `num/stats` and `sh` alone.
//! *Invariant:* squared errors are in cross form, (m − r₁)(m − r₂), so the references' noise
//! biases none of them; mean absolute errors cannot be, and stand beside the noise.
//! *Invariant:* sums run in a fixed order: the same cases give the same bytes on any number of
//! threads.

mod blocks;
mod case;
mod error;
mod finish;
mod lights;
mod measured;
mod measurement;
mod probes;
pub mod report;
mod rows;
mod tally;
#[cfg(test)]
mod tests;

pub use crate::model::Signal;
pub use case::{Candidate, Case, Kind, Settings, Split};
pub use error::Error;
pub use lights::{Light, lights};
pub use measured::{
    Added, AoError, BlockMethod, CandidateMeasured, Estimate, Flicker, Frames, FunctionError,
    LightMeasured, Measured, Place, ReferenceMeasured, Residual, ShadingError, SplitMeasured,
    Squared, Surface, VERSION, Worst, WorstPose, WorstSample, WorstVertex,
};
pub use measurement::Measurement;
