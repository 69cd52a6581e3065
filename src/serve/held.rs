//! What answers hold in memory: values are kept until their client has taken them, however slowly, so
//! that all of them together are bounded beside each of them.

use std::sync::Arc;

use axum::http::StatusCode;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::problem::Problem;

/// The largest answers that there may be at once.
const LARGEST: u64 = 4;

/// What is counted by.
const UNIT_BYTES: u64 = 64 << 10;

/// Room for the values of all answers.
#[derive(Debug)]
pub(super) struct Answers(Arc<Semaphore>);

/// Room for the values of one answer, until it is dropped.
#[derive(Debug)]
pub(super) struct Held(
    #[expect(dead_code, reason = "it is kept, not looked at")] OwnedSemaphorePermit,
);

impl Answers {
    /// Room for a few answers of the largest size.
    pub(super) fn new(answer_bytes: u64) -> Self {
        let units = LARGEST.saturating_mul(units(answer_bytes));
        let units = usize::try_from(units).unwrap_or(usize::MAX).min(Semaphore::MAX_PERMITS);
        Self(Arc::new(Semaphore::new(units)))
    }

    /// Room for an answer of so many bytes.
    ///
    /// # Errors
    /// `unavailable` where others have it.
    pub(super) fn hold(&self, bytes: u64) -> Result<Held, Problem> {
        let units = u32::try_from(units(bytes)).unwrap_or(u32::MAX);
        Arc::clone(&self.0).try_acquire_many_owned(units).map(Held).map_err(|_| {
            let detail =
                "other large answers are still on their way; ask again, or for less at once";
            Problem::new(StatusCode::SERVICE_UNAVAILABLE, "unavailable", detail).retry_after(1)
        })
    }
}

fn units(bytes: u64) -> u64 {
    bytes.div_ceil(UNIT_BYTES)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four of the largest pass at once, or many small ones; one more does when one of them is gone.
    #[test]
    fn answers_are_bounded_together() {
        let answers = Answers::new(256 << 20);
        let mut held: Vec<Held> =
            (0..4).map(|_| answers.hold(256 << 20).expect("there is room")).collect();
        let refused = answers.hold(1).expect_err("there is none");
        assert_eq!(refused.status, StatusCode::SERVICE_UNAVAILABLE);
        held.pop();
        let small: Vec<_> = (0..4096).map(|_| answers.hold(60_000)).collect();
        assert!(small.iter().all(Result::is_ok) && answers.hold(1).is_err());
        drop((held, small));
        assert!(answers.hold(1 << 30).is_ok(), "all of it is free again");
        let tiny = Answers::new(10);
        assert!(tiny.hold(10).is_ok() && tiny.hold(5 * UNIT_BYTES).is_err());
    }
}
