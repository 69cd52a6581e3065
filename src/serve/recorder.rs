//! What a running job says: its progress, not too often, and its log.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::runner::Pulse;
use super::store::{Job, Level, now_ms};
use super::{Service, StoreError};
use crate::pipeline::{Progress, Stage};

/// Between two records of progress; each costs a write to disk.
const RECORD: Duration = Duration::from_millis(500);

/// Writes down what one job says.
pub(super) struct Recorder<'a> {
    service: &'a Service,
    job: &'a Job,
    pulse: &'a Pulse,
    brake: &'a AtomicBool,
    last: Mutex<Option<Last>>,
}

/// What was written last.
#[derive(Debug, Clone, Copy)]
struct Last {
    at: Instant,
    stage: Stage,
    /// What of the stage was done when this run of it began.
    first: u64,
}

impl<'a> Recorder<'a> {
    /// The brake stops the job where another process has taken it over.
    pub(super) fn new(
        service: &'a Service,
        job: &'a Job,
        (pulse, brake): (&'a Pulse, &'a AtomicBool),
    ) -> Self {
        Self { service, job, pulse, brake, last: Mutex::new(None) }
    }

    /// Takes note of progress; the job is alive.
    pub(super) fn record(&self, progress: Progress) {
        if self.pulse.beat() {
            self.log(Level::Info, "it goes on");
        }
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let begun = last.filter(|last| last.stage == progress.stage);
        let due = begun.is_none_or(|last| last.at.elapsed() > RECORD);
        if !due && progress.done < progress.total {
            return;
        }
        let first = begun.map_or(progress.done, |last| last.first);
        *last = Some(Last { at: Instant::now(), stage: progress.stage, first });
        drop(last);
        if begun.is_none() {
            let Progress { stage, done, total, .. } = progress;
            self.log(Level::Info, &format!("stage {}: {done} of {total} done", stage.name()));
        }
        let text = show(progress, first).to_string();
        if let Err(error) = self.service.store.progress(self.job.seq, &text) {
            if matches!(error, StoreError::Fenced) {
                self.brake.store(true, Ordering::Relaxed);
            }
            tracing::warn!(job = self.job.id, %error, "cannot write down progress");
        }
    }

    /// Adds a line to the job's log, and to the service's.
    pub(super) fn log(&self, level: Level, text: &str) {
        log(self.service, self.job, level, text);
    }
}

/// Adds a line to a job's log, and to the service's.
pub(super) fn log(service: &Service, job: &Job, level: Level, text: &str) {
    match level {
        Level::Info => tracing::info!(job = job.id, "{text}"),
        Level::Warning | Level::Error => tracing::warn!(job = job.id, "{text}"),
    }
    if let Err(error) = service.store.log(job.seq, level, text) {
        tracing::warn!(job = job.id, %error, "cannot write to the job's log");
    }
}

/// Progress as clients see it. What an earlier run had done says nothing of this one's speed.
fn show(progress: Progress, first: u64) -> Value {
    let Progress { stage, done, total, rays, elapsed_s } = progress;
    let rate = if elapsed_s > 0.0 { rays as f64 / elapsed_s } else { 0.0 };
    let now = done.saturating_sub(first);
    let left_s = (now > 0).then(|| elapsed_s * total.saturating_sub(done) as f64 / now as f64);
    json!({
        "stage": stage.name(),
        "done": done,
        "total": total,
        "rays": rays,
        "rays_per_s": rate,
        "elapsed_s": elapsed_s,
        "left_s": left_s,
        "at_ms": now_ms(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The time left is by what this run did: 10 of 20 in 5 s leave 10 s for the other 20.
    #[test]
    fn the_time_left_is_by_this_runs_speed() {
        let progress =
            Progress { stage: Stage::Bake, done: 30, total: 50, rays: 10, elapsed_s: 5.0 };
        let shown = show(progress, 20);
        assert_eq!((&shown["left_s"], &shown["rays_per_s"]), (&json!(10.0), &json!(2.0)));
        assert_eq!(show(progress, 30)["left_s"], Value::Null);
    }
}
