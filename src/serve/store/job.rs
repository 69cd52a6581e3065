//! A job and its states: queued → running → succeeded or failed, and by way of cancelling or at
//! once → cancelled. A job that was running when the process ended is queued again.

use std::path::Path;

/// Where a job is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::serve) enum State {
    Queued,
    Running,
    Cancelling,
    Cancelled,
    Succeeded,
    Failed,
}

impl State {
    pub(in crate::serve) const ALL: [Self; 6] = [
        Self::Queued,
        Self::Running,
        Self::Cancelling,
        Self::Cancelled,
        Self::Succeeded,
        Self::Failed,
    ];

    /// As clients read it.
    pub(in crate::serve) fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Cancelling => "cancelling",
            Self::Cancelled => "cancelled",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
        }
    }

    /// The state of this name.
    pub(in crate::serve) fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.name() == name)
    }

    /// Whether nothing more happens to it.
    pub(in crate::serve) fn is_final(self) -> bool {
        matches!(self, Self::Cancelled | Self::Succeeded | Self::Failed)
    }
}

/// A job as it is kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::serve) struct Job {
    /// Grows with every job; what pages are cut by.
    pub(in crate::serve) seq: i64,
    pub(in crate::serve) id: String,
    /// What is done, as clients name it.
    pub(in crate::serve) kind: String,
    pub(in crate::serve) state: State,
    pub(in crate::serve) priority: i64,
    /// The request's JSON.
    pub(in crate::serve) request: String,
    /// The data set that it works on: jobs of one data set run one after another.
    pub(in crate::serve) bake: String,
    /// Names its result among those of its kind; of a job that makes a model, the model's id.
    pub(in crate::serve) key: String,
    /// Memory that it is expected to take.
    pub(in crate::serve) memory_bytes: u64,
    /// Whether the result was there already.
    pub(in crate::serve) cached: bool,
    /// How often it was started.
    pub(in crate::serve) attempts: i64,
    pub(in crate::serve) created_ms: i64,
    pub(in crate::serve) started_ms: Option<i64>,
    pub(in crate::serve) finished_ms: Option<i64>,
    /// JSON, as are the next two.
    pub(in crate::serve) progress: Option<String>,
    pub(in crate::serve) result: Option<String>,
    pub(in crate::serve) error: Option<String>,
}

/// What is to be run next.
#[derive(Debug, Default, PartialEq, Eq)]
pub(in crate::serve) struct Claim {
    /// Marked as running.
    pub(in crate::serve) job: Option<Job>,
    /// The first in the queue, where it needs more memory than there is.
    pub(in crate::serve) waits: Option<Job>,
}

/// A job to be accepted.
#[derive(Debug)]
pub(in crate::serve) struct NewJob<'a> {
    pub(in crate::serve) id: &'a str,
    pub(in crate::serve) kind: &'a str,
    pub(in crate::serve) priority: i64,
    pub(in crate::serve) request: &'a str,
    pub(in crate::serve) bake: &'a str,
    pub(in crate::serve) key: &'a str,
    pub(in crate::serve) memory_bytes: u64,
    /// Whether it works on a data set that another job has baked: one that is still there.
    pub(in crate::serve) needs_dataset: bool,
    /// Whether its result is a model, of the id `key`.
    pub(in crate::serve) makes_model: bool,
    /// The result's JSON, where it is there already.
    pub(in crate::serve) result: Option<&'a str>,
    /// Jobs that may wait.
    pub(in crate::serve) most_queued: u32,
}

/// A client's `Idempotency-Key`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::serve) struct Key {
    /// Whose key: keys of two clients are two keys.
    pub(in crate::serve) owner: String,
    pub(in crate::serve) key: String,
    pub(in crate::serve) body_sha256: String,
}

/// What became of a submission.
#[derive(Debug)]
pub(in crate::serve) enum Submitted {
    New(Box<Job>),
    /// The key and the body were seen before.
    Same(Box<Job>),
    /// The key was seen before with another body.
    OtherBody,
    /// So many wait already.
    Full(u32),
    /// No job has its data set any more.
    NoDataset,
    /// The asset of this file of it is not there any more.
    NoAsset(String),
}

/// What became of a request to cancel.
#[derive(Debug)]
pub(in crate::serve) enum Cancelled {
    Yes(Box<Job>),
    /// It had ended before.
    Ended(State),
    Unknown,
}

/// What became of a request to delete.
#[derive(Debug)]
pub(in crate::serve) enum Deleted {
    Yes,
    /// It has not ended.
    Active(State),
    Unknown,
}

/// What became of a request to delete an asset.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::serve) enum Forgotten {
    Yes,
    /// By this job, which has not ended.
    Needed(String),
    Unknown,
}

/// How a job ended.
#[derive(Debug)]
pub(in crate::serve) struct Done<'a> {
    pub(in crate::serve) state: State,
    /// JSON.
    pub(in crate::serve) result: Option<&'a str>,
    /// JSON.
    pub(in crate::serve) error: Option<&'a str>,
    /// What it made.
    pub(in crate::serve) model: Option<NewModel<'a>>,
}

/// A model that is whole but not yet in its place.
#[derive(Debug)]
pub(in crate::serve) struct NewModel<'a> {
    /// Of the blob.
    pub(in crate::serve) sha256: &'a str,
    /// Of the blob.
    pub(in crate::serve) bytes: u64,
    /// Where its files are.
    pub(in crate::serve) folder: &'a Path,
}
