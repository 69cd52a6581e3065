//! What answers and bodies hold in memory: values are kept until their client has taken them, however
//! slowly, a document until it is dealt with; all of them together are bounded beside each of them.

use std::sync::Arc;

use axum::http::StatusCode;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::problem::Problem;

/// The largest answers, or bodies, that there may be at once.
pub(super) const LARGEST: u64 = 4;

/// What is counted by.
const UNIT_BYTES: u64 = 64 << 10;

/// Room that all answers share, or all bodies.
#[derive(Debug)]
pub(super) struct Shared {
    units: Arc<Semaphore>,
    /// What is told where there is none.
    refusal: &'static str,
}

/// The room of one of them, until it is dropped.
#[derive(Debug)]
pub(super) struct Held(OwnedSemaphorePermit);

impl Held {
    /// Whether it is enough for so many bytes.
    pub(super) fn holds(&self, bytes: u64) -> bool {
        units(bytes) <= self.0.num_permits() as u64
    }
}

impl Shared {
    /// Room for the values of a few answers of the largest size.
    pub(super) fn answers(answer_bytes: u64) -> Self {
        let refusal = "other large answers are still on their way; ask again, or for less at once";
        Self::new(answer_bytes, refusal)
    }

    /// Room for a few bodies of the largest size.
    pub(super) fn bodies(body_bytes: u64) -> Self {
        Self::new(body_bytes, "other large bodies are being dealt with; send it again")
    }

    fn new(largest: u64, refusal: &'static str) -> Self {
        let units = LARGEST.saturating_mul(units(largest));
        let units = usize::try_from(units).unwrap_or(usize::MAX).min(Semaphore::MAX_PERMITS);
        Self { units: Arc::new(Semaphore::new(units)), refusal }
    }

    /// Room for so many bytes.
    ///
    /// # Errors
    /// `unavailable` where others have it.
    pub(super) fn hold(&self, bytes: u64) -> Result<Held, Problem> {
        let units = u32::try_from(units(bytes)).unwrap_or(u32::MAX);
        Arc::clone(&self.units).try_acquire_many_owned(units).map(Held).map_err(|_| {
            Problem::new(StatusCode::SERVICE_UNAVAILABLE, "unavailable", self.refusal)
                .retry_after(1)
        })
    }

    /// Makes room that there is enough for so many bytes.
    ///
    /// # Errors
    /// As [`Self::hold`]; it then stays as it was.
    pub(super) fn grow(&self, held: &mut Held, bytes: u64) -> Result<(), Problem> {
        let has = held.0.num_permits() as u64 * UNIT_BYTES;
        if !held.holds(bytes) {
            held.0.merge(self.hold(bytes - has)?.0);
        }
        Ok(())
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
        let answers = Shared::answers(256 << 20);
        let mut held: Vec<Held> =
            (0..4).map(|_| answers.hold(256 << 20).expect("there is room")).collect();
        let refused = answers.hold(1).expect_err("there is none");
        assert_eq!(refused.status, StatusCode::SERVICE_UNAVAILABLE);
        held.pop();
        let small: Vec<_> = (0..4096).map(|_| answers.hold(60_000)).collect();
        assert!(small.iter().all(Result::is_ok) && answers.hold(1).is_err());
        drop((held, small));
        assert!(answers.hold(1 << 30).is_ok(), "all of it is free again");
        let tiny = Shared::answers(10);
        assert!(tiny.hold(10).is_ok() && tiny.hold(5 * UNIT_BYTES).is_err());
    }

    /// Bodies take room as they come, each only what it lacks, and give all of it back.
    #[test]
    fn bodies_take_room_as_they_come() {
        let bodies = Shared::bodies(4 * UNIT_BYTES);
        let mut one = bodies.hold(0).expect("nothing");
        assert!(one.holds(0) && !one.holds(1));
        for bytes in [1, UNIT_BYTES, UNIT_BYTES + 1, 4 * UNIT_BYTES] {
            bodies.grow(&mut one, bytes).expect("there is room");
            assert!(one.holds(bytes) && !one.holds(bytes + UNIT_BYTES));
        }
        let mut rest = bodies.hold(12 * UNIT_BYTES).expect("four of the largest");
        assert!(bodies.grow(&mut one, 5 * UNIT_BYTES).is_err() && one.holds(4 * UNIT_BYTES));
        drop(one);
        bodies.grow(&mut rest, 16 * UNIT_BYTES).expect("what the other had");
        drop(rest);
        assert!(bodies.hold(16 * UNIT_BYTES).is_ok());
    }
}
