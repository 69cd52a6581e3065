//! Jobs at work: claimed from the store, run on compute threads, and written back.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde_json::json;

use super::problem::Problem;
use super::recorder::{Recorder, log};
use super::stages::{self, Failure};
use super::store::{Claim, Done, Job, Level, NewModel, State};
use super::{Service, StoreError, memory, priority};

/// Between two looks for work that nobody announced.
const LOOK: Duration = Duration::from_secs(1);

/// Jobs that pass one that waits for memory, at most: after them room is made for it.
const MOST_PASSED: u32 = 8;

/// Attempts at a job that a disk refuses which takes what others write.
const MOST_REFUSED: i64 = 3;

/// Which jobs run in this process.
#[derive(Debug, Default)]
pub(super) struct Runner {
    active: Mutex<Active>,
    bell: Condvar,
    /// Whether the disk has refused what a job wrote, and has not been tried since.
    refused: AtomicBool,
}

#[derive(Debug, Default)]
struct Active {
    stopping: bool,
    jobs: BTreeMap<String, Work>,
    short: Option<Short>,
}

/// The first job in the queue, where it waits for memory.
#[derive(Debug)]
struct Short {
    seq: i64,
    id: String,
    /// Jobs that began in its stead.
    passed: u32,
}

/// One job at work.
#[derive(Debug)]
struct Work {
    seq: i64,
    memory_bytes: u64,
    brake: Arc<AtomicBool>,
    pulse: Arc<Pulse>,
}

/// When a job last said something. The clock on the wall may go backwards; this one does not.
#[derive(Debug)]
pub(super) struct Pulse {
    last: Mutex<Instant>,
    stalled: AtomicBool,
}

impl Pulse {
    fn new() -> Self {
        Self { last: Mutex::new(Instant::now()), stalled: AtomicBool::new(false) }
    }

    /// The job is alive; whether it was thought to be stuck.
    pub(super) fn beat(&self) -> bool {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
        self.stalled.swap(false, Ordering::Relaxed)
    }

    fn silent(&self) -> Duration {
        self.last.lock().unwrap_or_else(PoisonError::into_inner).elapsed()
    }

    /// Whether the job has just become silent for so long; true once.
    fn stalls(&self, limit: Duration) -> bool {
        self.silent() >= limit && !self.stalled.swap(true, Ordering::Relaxed)
    }
}

impl Runner {
    /// There may be work.
    pub(super) fn wake(&self) {
        self.bell.notify_all();
    }

    /// Stops one job at its next block of work.
    pub(super) fn cancel(&self, job: &str) {
        if let Some(work) = self.lock().jobs.get(job) {
            work.brake.store(true, Ordering::Relaxed);
        }
    }

    /// Stops every job at its next block of work, and takes no other.
    pub(super) fn stop(&self) {
        let mut active = self.lock();
        active.stopping = true;
        active.jobs.values().for_each(|work| work.brake.store(true, Ordering::Relaxed));
        drop(active);
        self.wake();
    }

    /// Seconds since a job that runs here last said something.
    pub(super) fn silent_s(&self, job: &str) -> Option<u64> {
        self.lock().jobs.get(job).map(|work| work.pulse.silent().as_secs())
    }

    /// What a job that is queued waits for, if not for others before it.
    pub(super) fn waits_for(&self, job: &str) -> Option<&'static str> {
        if self.refused.load(Ordering::Relaxed) {
            return Some("storage");
        }
        self.lock().short.as_ref().filter(|short| short.id == job).map(|_| "memory")
    }

    fn is_stopping(&self) -> bool {
        self.lock().stopping
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
            let claimed = if active.jobs.len() < most { claim(service, &mut active) } else { None };
            let Some(job) = claimed else {
                let waited = service.runner.bell.wait_timeout(active, LOOK);
                active = waited.unwrap_or_else(PoisonError::into_inner).0;
                look_for_stalls(service, &active);
                continue;
            };
            let (brake, pulse) = (Arc::new(AtomicBool::new(false)), Arc::new(Pulse::new()));
            let work = Work {
                seq: job.seq,
                memory_bytes: job.memory_bytes,
                brake: Arc::clone(&brake),
                pulse: Arc::clone(&pulse),
            };
            active.jobs.insert(job.id.clone(), work);
            scope.spawn(move || {
                one(service, &job, &brake, &pulse);
                service.runner.lock().jobs.remove(&job.id);
                service.runner.wake();
            });
        }
    });
}

/// The next job, where the disk takes what it will write.
fn claim(service: &Service, active: &mut Active) -> Option<Job> {
    if service.runner.refused.load(Ordering::Relaxed) {
        if let Err(error) = service.store.folder().probe() {
            tracing::warn!(%error, "jobs wait for the disk");
            return None;
        }
        service.runner.refused.store(false, Ordering::Relaxed);
    }
    let reserved = active.jobs.values().map(|work| work.memory_bytes).sum();
    let free = memory::free(&service.settings.limits, reserved);
    let claimed = service.store.claim(free, |first| active.may_pass(first));
    let Claim { job, waits } = claimed.unwrap_or_else(|error| {
        tracing::error!(%error, "cannot take a job");
        Claim::default()
    });
    if let Some(waits) = active.note(job.as_ref(), waits) {
        let (needs, free) = (waits.memory_bytes >> 20, free >> 20);
        let text = format!("waits for memory: it needs about {needs} MiB, {free} MiB are free");
        log(service, &waits, Level::Info, &text);
    }
    job
}

impl Active {
    /// Whether others may begin before the first in the queue, which waits for memory. Where nothing of
    /// ours runs it is others on this machine who have the memory: to hold back ours gains nothing.
    fn may_pass(&self, first: i64) -> bool {
        let passed = self.short.as_ref().filter(|short| short.seq == first);
        self.jobs.is_empty() || passed.is_none_or(|short| short.passed < MOST_PASSED)
    }

    /// Takes note of what was claimed and of what waits; gives back the latter where it is news.
    fn note(&mut self, claimed: Option<&Job>, waits: Option<Job>) -> Option<Job> {
        let Some(waits) = waits else {
            // One of a higher priority may have come before it.
            let over = claimed
                .is_none_or(|job| self.short.as_ref().is_some_and(|short| short.seq == job.seq));
            self.short.take_if(|_| over);
            return None;
        };
        let known = self.short.as_ref().is_some_and(|short| short.seq == waits.seq);
        if !known {
            self.short = Some(Short { seq: waits.seq, id: waits.id.clone(), passed: 0 });
        }
        if let (Some(short), Some(_)) = (&mut self.short, claimed) {
            short.passed += 1;
        }
        (!known).then_some(waits)
    }
}

/// Says so where a job has been silent for too long; it is left to go on.
fn look_for_stalls(service: &Service, active: &Active) {
    let limit = Duration::from_secs(u64::from(service.settings.limits.stalled_s));
    for (id, work) in active.jobs.iter().filter(|(_, work)| work.pulse.stalls(limit)) {
        let silent_s = work.pulse.silent().as_secs();
        let text = format!("nothing was heard of it for {silent_s} s");
        tracing::warn!(job = id, "{text}");
        let told =
            service.store.tell(work.seq, "stalled", &json!({ "silent_s": silent_s }).to_string());
        let logged = told.and_then(|()| service.store.log(work.seq, Level::Warning, &text));
        if let Err(error) = logged {
            tracing::warn!(job = id, %error, "cannot write down that it stalls");
        }
    }
}

/// One job from its claim to its end.
fn one(service: &Service, job: &Job, brake: &AtomicBool, pulse: &Pulse) {
    priority::lower_this_thread();
    log(service, job, Level::Info, &format!("{} begins, attempt {}", job.kind, job.attempts));
    // A cancel that came between the claim and the brake.
    if let Ok(Some(Job { state: State::Cancelling, .. })) = service.store.job(&job.id) {
        brake.store(true, Ordering::Relaxed);
    }
    let recorder = Recorder::new(service, job, (pulse, brake));
    let attempt = || stages::run(service, job, brake, &recorder);
    let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(attempt));
    let outcome = outcome.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic");
        Err(Failure::Problem(Problem::internal(&text)))
    });
    let outcome = put_off(service, job, outcome);
    // A disk that is full now may have room later; until then the job stays as running, and is
    // taken up again at the next start.
    while let Err(error) = end(service, job, &outcome) {
        tracing::error!(job = job.id, %error, "cannot write down how it ended");
        if matches!(error, StoreError::Fenced) || service.runner.is_stopping() {
            return;
        }
        std::thread::sleep(LOOK);
    }
}

/// A job that the disk has refused is none that has failed: it waits until the disk takes writes. One
/// that is refused alone, while others could write, is tried a few times.
fn put_off(
    service: &Service,
    job: &Job,
    outcome: Result<stages::Made, Failure>,
) -> Result<stages::Made, Failure> {
    match outcome {
        Err(Failure::Problem(problem)) if problem.is_for_later() => {
            let alone = service.store.folder().probe().is_ok();
            if alone && job.attempts >= MOST_REFUSED {
                return Err(Failure::Problem(problem));
            }
            service.runner.refused.store(true, Ordering::Relaxed);
            Err(Failure::Refused { counts: alone })
        }
        other => other,
    }
}

/// Writes down how a job ended.
fn end(
    service: &Service,
    job: &Job,
    outcome: &Result<stages::Made, Failure>,
) -> Result<(), StoreError> {
    let (state, text) = match outcome {
        Ok(made) => {
            let text = made.result.to_string();
            let model = made.model.as_ref().map(|model| NewModel {
                sha256: &model.sha256,
                bytes: model.bytes,
                folder: model.folder.path(),
            });
            let end = Done { state: State::Succeeded, result: Some(&text), error: None, model };
            service.store.finish(job, &end)?;
            (State::Succeeded, String::new())
        }
        Err(Failure::Stopped) => (stopped(service, job, false)?, String::new()),
        Err(Failure::Refused { counts }) => {
            let state = stopped(service, job, *counts)?;
            (state, ": the disk takes no writes; it begins again when it does".to_owned())
        }
        Err(Failure::Problem(problem)) => {
            let error = problem.json().to_string();
            let failed = Some(error.as_str());
            let end = Done { state: State::Failed, result: None, error: failed, model: None };
            service.store.finish(job, &end)?;
            (State::Failed, format!(": {}", problem.detail()))
        }
    };
    let level = match outcome {
        Err(Failure::Refused { .. }) => Level::Warning,
        _ if state == State::Failed => Level::Error,
        _ => Level::Info,
    };
    log(service, job, level, &format!("{}{text}", state.name()));
    Ok(())
}

/// A job that was stopped was cancelled, or waits for the service's next start, or for its disk.
fn stopped(service: &Service, job: &Job, counts: bool) -> Result<State, StoreError> {
    let state = service.store.job(&job.id)?.map(|job| job.state);
    if state == Some(State::Cancelling) {
        let end = Done { state: State::Cancelled, result: None, error: None, model: None };
        service.store.finish(job, &end)?;
        return Ok(State::Cancelled);
    }
    service.store.put_back(job.seq, counts)?;
    Ok(State::Queued)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Silence beyond the limit is told once, and again only after a sign of life.
    #[test]
    fn a_stall_is_told_once() {
        let pulse = Pulse::new();
        assert!(!pulse.stalls(Duration::from_secs(3600)));
        assert!(pulse.stalls(Duration::ZERO) && !pulse.stalls(Duration::ZERO));
        assert!(pulse.beat() && !pulse.beat());
        assert!(pulse.stalls(Duration::ZERO));
    }

    fn job(seq: i64) -> Job {
        Job {
            seq,
            id: seq.to_string(),
            kind: "run".to_owned(),
            state: State::Queued,
            priority: 0,
            request: "{}".to_owned(),
            bake: String::new(),
            key: String::new(),
            memory_bytes: 1,
            cached: false,
            attempts: 0,
            created_ms: 0,
            started_ms: None,
            finished_ms: None,
            progress: None,
            result: None,
            error: None,
        }
    }

    fn work() -> Work {
        let (brake, pulse) = (Arc::new(AtomicBool::new(false)), Arc::new(Pulse::new()));
        Work { seq: 1, memory_bytes: 1, brake, pulse }
    }

    /// Who waits for memory is told of once, is passed so often and no more, even where one of a
    /// higher priority comes between, and is forgotten when it begins or is gone. Where nothing of
    /// ours runs it holds nobody back.
    #[test]
    fn none_is_passed_for_ever() {
        let mut active = Active::default();
        active.jobs.insert("1".to_owned(), work());
        let (large, small) = (job(2), job(3));
        assert!(active.may_pass(2));
        assert_eq!(active.note(Some(&small), Some(large.clone())).map(|job| job.seq), Some(2));
        for passed in 1..MOST_PASSED {
            assert!(active.may_pass(2), "{passed}");
            assert_eq!(active.note(Some(&small), Some(large.clone())), None, "told twice");
        }
        assert!(!active.may_pass(2) && active.may_pass(4));
        assert_eq!(active.note(Some(&job(9)), None), None);
        assert!(!active.may_pass(2), "it is passed anew after one of a higher priority");
        let running = std::mem::take(&mut active.jobs);
        assert!(active.may_pass(2), "it waits for others on this machine");
        active.jobs = running;
        assert_eq!(active.note(Some(&large), None), None);
        assert!(active.short.is_none(), "it has begun");
        active.note(None, Some(large));
        active.note(None, None);
        assert!(active.short.is_none(), "it is gone");
    }
}
