//! Rank 13. Reads measurements and decides: which points are worth having, which is the simplest
//! that meets a target, and what would help where none does.
//!
//! *Invariant:* nothing here runs a stage; it is told what was measured.
//! *Invariant:* a choice depends on what it is told alone, and ties go to the earlier point.

mod decide;
mod front;

pub(crate) use decide::errors;
pub use decide::{Choice, Remedy, Shares, Target, decide, is_doubtful};
pub use front::front;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// One model with what it costs and what it is worth.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Family, sizes and precision in words; unique among points.
    pub name: String,
    /// The family's name.
    pub family: String,
    /// The precision's name.
    pub precision: String,
    /// The recipe's part `fit` that makes it, and what it is for: enough to make it again.
    pub fit: serde_json::Value,
    /// `novel` or `trained`.
    pub on: String,
    /// Bytes of the blob's tensors, maps and header.
    pub bytes: u64,
    /// Bytes of the decoder's and encoder's tensors alone: what papers count.
    pub tensor_bytes: u64,
    /// Tensor bytes in per cent of one pose's coefficients in f32.
    pub mesh_percent: f64,
    /// Microseconds of one evaluation of all coefficients on one core.
    pub evaluate_us: f64,
    /// Multiply-adds of the same.
    pub multiply_adds: u64,
    /// Seconds of the fit.
    pub fit_s: f64,
    /// Errors by the name of the split.
    pub errors: BTreeMap<String, SplitError>,
}

impl Point {
    /// Takes costs from what was measured on the same model.
    pub(crate) fn take_costs(&mut self, of: &Self) {
        (self.bytes, self.evaluate_us, self.fit_s) = (of.bytes, of.evaluate_us, of.fit_s);
    }
}

/// What was measured on one split.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct SplitError {
    /// Root mean square of a coefficient's error, free of the reference's noise; 0 where the error
    /// is lost in it.
    pub rms: f64,
    /// Standard error of the mean square that `rms` is the root of.
    pub mean_square_error: Option<f64>,
    /// Mean |error| of ambient occlusion; contains the reference's noise.
    pub ao_mae: f64,
    /// 99th percentile of |error| of ambient occlusion.
    pub ao_p99: f64,
    /// RMS change of the error per frame; absent without consecutive frames.
    pub flicker_rms: Option<f64>,
}
