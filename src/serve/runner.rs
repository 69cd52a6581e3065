//! Jobs at work: claimed from the store, run on compute threads, and written back.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use axum::http::StatusCode;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::jobs::result;
use super::problem::Problem;
use super::request::{JobRequest, of_pipeline};
use super::store::{self, Done, Job, State, hexadecimal, now_ms};
use super::{Service, StoreError};
use crate::pipeline::{self, Progress, Watch, files};

/// A job that was started so often without an end brings the service down, and is given up.
const MOST_ATTEMPTS: i64 = 5;

/// Between two looks for work that nobody announced.
const LOOK: Duration = Duration::from_secs(1);

/// Between two records of progress; each costs a write to disk.
const RECORD: Duration = Duration::from_millis(500);

/// A model's blob at most.
const MOST_MODEL_BYTES: u64 = 4 << 30;

/// Which jobs run in this process.
#[derive(Debug, Default)]
pub(super) struct Runner {
    active: Mutex<Active>,
    bell: Condvar,
}

#[derive(Debug, Default)]
struct Active {
    stopping: bool,
    /// Job → its brake.
    jobs: BTreeMap<String, Arc<AtomicBool>>,
}

impl Runner {
    /// There may be work.
    pub(super) fn wake(&self) {
        self.bell.notify_all();
    }

    /// Stops one job at its next block of work.
    pub(super) fn cancel(&self, job: &str) {
        if let Some(brake) = self.lock().jobs.get(job) {
            brake.store(true, Ordering::Relaxed);
        }
    }

    /// Stops every job at its next block of work, and takes no other.
    pub(super) fn stop(&self) {
        let mut active = self.lock();
        active.stopping = true;
        active.jobs.values().for_each(|brake| brake.store(true, Ordering::Relaxed));
        drop(active);
        self.wake();
    }

    fn lock(&self) -> MutexGuard<'_, Active> {
        self.active.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Runs jobs until the service stops.
pub(super) fn work(service: &Arc<Service>) {
    std::thread::scope(|scope| {
        let most = service.settings.limits.running_jobs as usize;
        let mut active = service.runner.lock();
        while !active.stopping {
            let claimed = if active.jobs.len() < most { claim(service) } else { None };
            let Some(job) = claimed else {
                let waited = service.runner.bell.wait_timeout(active, LOOK);
                active = waited.unwrap_or_else(PoisonError::into_inner).0;
                continue;
            };
            let brake = Arc::new(AtomicBool::new(false));
            active.jobs.insert(job.id.clone(), Arc::clone(&brake));
            scope.spawn(move || {
                one(service, &job, &brake);
                service.runner.lock().jobs.remove(&job.id);
                service.runner.wake();
            });
        }
    });
}

fn claim(service: &Service) -> Option<Job> {
    service.store.claim().unwrap_or_else(|error| {
        tracing::error!(%error, "cannot take a job");
        None
    })
}

/// One job from its claim to its end.
fn one(service: &Service, job: &Job, brake: &AtomicBool) {
    tracing::info!(job = job.id, attempt = job.attempts, "running");
    // A cancel that came between the claim and the brake.
    if let Ok(Some(Job { state: State::Cancelling, .. })) = service.store.job(&job.id) {
        brake.store(true, Ordering::Relaxed);
    }
    let attempt = || run(service, job, brake);
    let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(attempt));
    let outcome = outcome.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic");
        Err(Failure::Problem(Problem::internal(&text)))
    });
    let written = match outcome {
        Ok(done) => {
            let text = result(&job.fit, Some(done.met)).to_string();
            let model = Some((done.sha256.as_str(), done.bytes));
            let end = Done { state: State::Succeeded, result: Some(&text), error: None, model };
            service.store.finish(job, &end)
        }
        Err(Failure::Stopped) => stopped(service, job),
        Err(Failure::Problem(problem)) => {
            let error = problem.json().to_string();
            tracing::warn!(job = job.id, error, "failed");
            let error = Some(error.as_str());
            let end = Done { state: State::Failed, result: None, error, model: None };
            service.store.finish(job, &end)
        }
    };
    match written {
        Ok(()) => tracing::info!(job = job.id, "ended"),
        // It stays as running in the store, and is taken up again at the next start.
        Err(error) => tracing::error!(job = job.id, %error, "cannot write down how it ended"),
    }
}

/// A job that was stopped was cancelled, or waits for the service's next start.
fn stopped(service: &Service, job: &Job) -> Result<(), StoreError> {
    let state = service.store.job(&job.id)?.map(|job| job.state);
    if state == Some(State::Cancelling) {
        let end = Done { state: State::Cancelled, result: None, error: None, model: None };
        return service.store.finish(job, &end);
    }
    service.store.put_back(job.seq)
}

/// Why a job did not come to its end.
enum Failure {
    Stopped,
    Problem(Problem),
}

impl From<pipeline::Error> for Failure {
    fn from(error: pipeline::Error) -> Self {
        match error {
            pipeline::Error::Cancelled { .. } | pipeline::Error::Stopped { .. } => Self::Stopped,
            other => Self::Problem(of_pipeline(&other)),
        }
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        Self::Problem(error.into())
    }
}

/// A model in its place.
struct Made {
    sha256: String,
    bytes: u64,
    met: bool,
}

fn run(service: &Service, job: &Job, brake: &AtomicBool) -> Result<Made, Failure> {
    if job.attempts > MOST_ATTEMPTS {
        let detail = format!("the service ended {MOST_ATTEMPTS} times while it ran this job");
        return Err(Failure::Problem(Problem::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "internal",
            detail,
        )));
    }
    if brake.load(Ordering::Relaxed) {
        return Err(Failure::Stopped);
    }
    let request: JobRequest = serde_json::from_str(&job.request)
        .map_err(|error| Failure::Problem(Problem::internal(&error)))?;
    let sources = service.store.folder().sources(&job.id);
    // Names that a power cut took are given again.
    request.lay_out(service, &sources).map_err(Failure::Problem)?;
    let prepared = request.open(&sources)?;
    let work = service.store.folder().work(&job.bake);
    let recorder = Recorder { service, job, last: Mutex::new(None) };
    let report = |progress| recorder.record(progress);
    let outcome = pipeline::run(&prepared, &work, &Watch { report: &report, cancelled: brake })?;
    service.metrics.rays(outcome.baked.rays);
    let (sha256, bytes) = publish(service, job, &work)?;
    Ok(Made { sha256, bytes, met: outcome.met })
}

/// Copies the results to where models are; whole or not at all.
fn publish(service: &Service, job: &Job, work: &Path) -> Result<(String, u64), Failure> {
    let incoming = service.store.folder().incoming()?;
    let blob = files::read(&work.join(pipeline::MODEL), MOST_MODEL_BYTES)?;
    for name in [pipeline::REPORT, pipeline::FIGURES, pipeline::RECIPE] {
        let bytes = files::read(&work.join(name), MOST_MODEL_BYTES)?;
        files::publish(&incoming.path().join(name), &bytes)?;
    }
    files::publish(&incoming.path().join(pipeline::MODEL), &blob)?;
    let place = service.store.folder().model(&job.fit);
    if service.store.model(&job.fit)?.is_none() {
        // Of a process that ended before the store knew of it.
        store::remove(&place)?;
    }
    if !fs::exists(&place).unwrap_or(false) {
        store::settle(incoming.path(), &place)?;
    }
    Ok((hexadecimal(&Sha256::digest(&blob)), blob.len() as u64))
}

/// Writes progress down, not too often.
struct Recorder<'a> {
    service: &'a Service,
    job: &'a Job,
    last: Mutex<Option<(Instant, pipeline::Stage)>>,
}

impl Recorder<'_> {
    fn record(&self, progress: Progress) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let due = last.is_none_or(|(at, stage)| stage != progress.stage || at.elapsed() > RECORD);
        if !due && progress.done < progress.total {
            return;
        }
        *last = Some((Instant::now(), progress.stage));
        drop(last);
        if let Err(error) = self.service.store.progress(self.job.seq, &show(progress).to_string()) {
            tracing::warn!(job = self.job.id, %error, "cannot write down progress");
        }
    }
}

fn show(progress: Progress) -> Value {
    let Progress { stage, done, total, rays, elapsed_s } = progress;
    let rate = if elapsed_s > 0.0 { rays as f64 / elapsed_s } else { 0.0 };
    json!({
        "stage": stage.name(),
        "done": done,
        "total": total,
        "rays": rays,
        "rays_per_s": rate,
        "elapsed_s": elapsed_s,
        "at_ms": now_ms(),
    })
}
