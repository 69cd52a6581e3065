//! What a running job tells, and how it is stopped.

use std::sync::atomic::{AtomicBool, Ordering};

/// The part of a job that is at work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The mesh is refined; counts triangles.
    Subdivide,
    /// Training poses are baked.
    Bake,
    /// References for measuring are baked.
    Reference,
    /// The model is fitted.
    Fit,
    /// The model is compared with the references.
    Measure,
}

impl Stage {
    /// The stage's name as users read it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Subdivide => "subdivide",
            Self::Bake => "bake",
            Self::Reference => "reference",
            Self::Fit => "fit",
            Self::Measure => "measure",
        }
    }
}

/// Work done so far; counts work, not time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Which stage.
    pub stage: Stage,
    /// Units (poses, or pose bakes of a reference) done, those of earlier runs included.
    pub done: u64,
    /// Units in all.
    pub total: u64,
    /// Rays cast in this run of the stage.
    pub rays: u64,
    /// Seconds since this run of the stage began.
    pub elapsed_s: f64,
}

/// The caller's ear and its hand on the brake.
#[derive(Clone, Copy)]
pub struct Watch<'a> {
    /// Called from the thread that runs the job, at most a few hundred times a second.
    pub report: &'a (dyn Fn(Progress) + Sync),
    /// Set by the caller to stop; checked per block of work.
    pub cancelled: &'a AtomicBool,
}

impl std::fmt::Debug for Watch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Watch").field("cancelled", &self.cancelled).finish_non_exhaustive()
    }
}

impl Watch<'_> {
    /// Whether the caller asked to stop.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
#[path = "progress_tests.rs"]
mod tests;
