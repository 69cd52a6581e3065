//! `/v1/jobs`: submit, list, show, cancel, delete.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{Extension, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tokio::time::{Instant, timeout_at};

use super::answer::{self, InPath, Params, blocking, bytes, escaped, text};
use super::assets::turn;
use super::faults::of_pipeline;
use super::guard::Client;
use super::page::PageQuery;
use super::prepare::prepare;
use super::problem::Problem;
use super::request::{JobRequest, Kind};
use super::store::{Cancelled, Deleted, Job, Key, Submitted, hexadecimal};
use super::words::in_fields;
use super::{Service, store::State as JobState};
use crate::pipeline;

/// Bytes of an `Idempotency-Key`.
const MOST_KEY_BYTES: usize = 255;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SubmitQuery {
    #[serde(default)]
    dry_run: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ListQuery {
    state: Option<String>,
    kind: Option<String>,
    page_size: Option<u32>,
    page_token: Option<i64>,
}

pub(super) async fn submit(
    State(service): State<Arc<Service>>,
    Params(query): Params<SubmitQuery>,
    Extension(client): Extension<Client>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    // Held from the first byte on: who sends slowly holds nobody's key but its own.
    let key = key(&headers, &client.name)?.filter(|_| !query.dry_run);
    let held = key.as_ref().map(|key| hold(&service, key)).transpose()?;
    let limits = service.settings.limits;
    // The time is for the client and for its turn. What is imported then is bounded by its size, and
    // is not given up: a job that is accepted is what its client is told.
    let until = Instant::now() + Duration::from_secs(u64::from(limits.request_s));
    let late = |_| Problem::late(limits.request_s);
    let body = bytes(&service, &headers, body);
    let body = timeout_at(until, body).await.map_err(late)??;
    let request = JobRequest::read(&body)?;
    let body_sha256 = hexadecimal(&Sha256::digest(&*body));
    let key = key.map(|(owner, key)| Key { owner, key, body_sha256 });
    // Not kept while the job waits for its turn.
    drop(body);
    if !query.dry_run
        && let Some(seen) = seen(&service, key.clone()).await?
    {
        return accepted(&service, &client, seen);
    }
    let place = timeout_at(until, turn(&service)).await.map_err(late)??;
    blocking(move || {
        // Both are held until the end, even where the client's patience ends before.
        let _held = (held, place);
        if query.dry_run {
            return dry_run(&service, &request);
        }
        let answer = accepted(&service, &client, prepare(&service, request, key.as_ref())?);
        service.runner.wake();
        answer
    })
    .await
}

/// What is known of a submission before its scene is looked at: an earlier one of its key, or that no
/// more may wait.
async fn seen(service: &Arc<Service>, key: Option<Key>) -> Result<Option<Submitted>, Problem> {
    let service = Arc::clone(service);
    blocking(move || {
        let seen = key.map(|key| service.store.by_key(&key)).transpose()?.flatten();
        let waiting = service.store.waiting()?;
        let full = waiting >= service.settings.limits.queued_jobs;
        Ok(seen.or(full.then_some(Submitted::Full(waiting))))
    })
    .await
}

/// Whose key and which, if there is one.
fn key(headers: &HeaderMap, owner: &str) -> Result<Option<(String, String)>, Problem> {
    let Some(key) = headers.get("idempotency-key") else { return Ok(None) };
    let sound = key.to_str().ok().filter(|key| !key.is_empty() && key.len() <= MOST_KEY_BYTES);
    let Some(key) = sound else {
        let fault = format!("a key is 1 to {MOST_KEY_BYTES} printable ASCII characters");
        return Err(Problem::field("Idempotency-Key", fault));
    };
    Ok(Some((owner.to_owned(), key.to_owned())))
}

/// A key whose request is being handled; free again when dropped.
struct Held {
    service: Arc<Service>,
    key: (String, String),
}

fn hold(service: &Arc<Service>, key: &(String, String)) -> Result<Held, Problem> {
    let mut keys = service.keys.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    if !keys.insert(key.clone()) {
        let detail = "another request with this key is being handled";
        return Err(Problem::new(StatusCode::CONFLICT, "key-in-use", detail).retry_after(1));
    }
    Ok(Held { service: Arc::clone(service), key: key.clone() })
}

impl Drop for Held {
    fn drop(&mut self) {
        let mut keys = self.service.keys.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        keys.remove(&self.key);
    }
}

/// What a job would cost.
fn dry_run(service: &Service, request: &JobRequest) -> Result<Response, Problem> {
    if request.kind.needs_dataset() {
        let fault = "a plan is made for jobs of kind `run` and `bake`";
        return Err(Problem::field("dry_run", fault));
    }
    let incoming = service.store.folder().incoming()?;
    request.lay_out(service, incoming.path())?;
    let job = request.open(incoming.path()).map_err(|error| request.refused(&error))?;
    let plan = planned(&job).map_err(|error| of_pipeline(&error))?;
    let mut document = plan.document(&job);
    for notice in document["notices"].as_array_mut().into_iter().flatten() {
        *notice = json!(in_fields(notice.as_str().unwrap_or_default()));
    }
    Ok(answer::json(StatusCode::OK, &document))
}

/// The plan of a job. Its trial gives way to evaluations, as the job would: threads that it starts are
/// as low as the one that starts them.
fn planned(job: &pipeline::Job) -> Result<pipeline::Plan, pipeline::Error> {
    std::thread::scope(|scope| {
        let plan = || {
            super::priority::lower_this_thread();
            pipeline::plan(job)
        };
        let planned = scope.spawn(plan).join();
        planned.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

fn accepted(service: &Service, client: &Client, submitted: Submitted) -> Result<Response, Problem> {
    let job = match submitted {
        Submitted::New(job) => {
            tracing::info!(job = job.id, cached = job.cached, "accepted");
            job
        }
        Submitted::Same(job) => job,
        Submitted::OtherBody => {
            let detail = "this Idempotency-Key was sent before with another body";
            return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "key-reused", detail));
        }
        Submitted::NoDataset => {
            let detail = "the data set was deleted just now; submit its bake again";
            let status = StatusCode::UNPROCESSABLE_ENTITY;
            return Err(Problem::new(status, "unknown-dataset", detail));
        }
        Submitted::NoAsset(name) => {
            let pointer = format!("#/assets/{}", escaped(&name));
            let fault = "its asset was removed just now; upload it again";
            let status = StatusCode::UNPROCESSABLE_ENTITY;
            return Err(Problem::new(status, "unknown-asset", fault).at(pointer, fault));
        }
        Submitted::Full(waiting) => {
            let detail = format!("{waiting} jobs are waiting");
            return Err(Problem::new(StatusCode::TOO_MANY_REQUESTS, "queue-full", detail)
                .limit("queued_jobs", u64::from(waiting))
                .retry_after(30));
        }
    };
    let mut response = answer::json(StatusCode::ACCEPTED, &show(service, client, &job));
    if let Ok(location) = HeaderValue::from_str(&format!("/v1/jobs/{}", job.id)) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    Ok(response)
}

/// A job as a client sees it: whom it tells of its end, only who may submit jobs.
pub(super) fn show(service: &Service, client: &Client, job: &Job) -> Value {
    let parse = |text: &Option<String>| -> Value {
        text.as_deref().and_then(|text| serde_json::from_str(text).ok()).unwrap_or(Value::Null)
    };
    let mut progress = parse(&job.progress);
    let silent_s = service.runner.silent_s(&job.id);
    if let (Value::Object(progress), Some(silent_s)) = (&mut progress, silent_s) {
        let stalled = silent_s >= u64::from(service.settings.limits.stalled_s);
        progress.insert("silent_s".to_owned(), json!(silent_s));
        progress.insert("stalled".to_owned(), json!(stalled));
    }
    let mut request = serde_json::from_str::<Value>(&job.request).unwrap_or(Value::Null);
    if let (Value::Object(request), false) = (&mut request, client.may_write) {
        request.remove("webhook");
    }
    let mut hashes = json!({ "bake": job.bake, "result": job.key });
    if job.kind == Kind::Run.name() {
        hashes["fit"] = json!(job.key);
    }
    let mut value = json!({
        "id": job.id,
        "kind": job.kind,
        "state": job.state.name(),
        "priority": job.priority,
        "cached": job.cached,
        "attempts": job.attempts,
        "memory_bytes": job.memory_bytes,
        "created_ms": job.created_ms,
        "started_ms": job.started_ms,
        "finished_ms": job.finished_ms,
        "hashes": hashes,
        "progress": progress,
        "request": request,
        "waits_for": null,
    });
    match job.state {
        JobState::Queued => value["waits_for"] = json!(service.runner.waits_for(&job.id)),
        JobState::Succeeded => value["result"] = parse(&job.result),
        JobState::Failed => value["error"] = parse(&job.error),
        _ => {}
    }
    value
}

pub(super) async fn list(
    State(service): State<Arc<Service>>,
    Params(query): Params<ListQuery>,
    Extension(client): Extension<Client>,
) -> Result<Response, Problem> {
    let page = PageQuery { page_size: query.page_size, page_token: query.page_token };
    let (before, count) = page.page()?;
    let state = match query.state.as_deref() {
        None => None,
        Some(name) => Some(JobState::from_name(name).ok_or_else(|| {
            let names = JobState::ALL.map(JobState::name).join(", ");
            Problem::field("state", format!("`{name}` is none of {names}"))
        })?),
    };
    let kind = match query.kind.as_deref() {
        None => None,
        Some(name) => Some(Kind::from_name(name).ok_or_else(|| {
            let names = Kind::ALL.map(Kind::name).join(", ");
            Problem::field("kind", format!("`{name}` is none of {names}"))
        })?),
    };
    let worker = Arc::clone(&service);
    let kind = kind.map(Kind::name);
    let jobs = blocking(move || Ok(worker.store.jobs(before, state, kind, count)?)).await?;
    let next = (jobs.len() == count as usize).then(|| jobs.last().map(|job| job.seq)).flatten();
    let jobs: Vec<Value> = jobs.iter().map(|job| show(&service, &client, job)).collect();
    Ok(answer::json(StatusCode::OK, &json!({ "jobs": jobs, "next_page_token": next })))
}

/// A job by the id in a path.
pub(super) async fn find(service: &Arc<Service>, id: String) -> Result<Job, Problem> {
    let service = Arc::clone(service);
    let job = blocking(move || Ok(service.store.job(&id)?)).await?;
    job.ok_or_else(|| Problem::not_found("job"))
}

pub(super) async fn get(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
    Extension(client): Extension<Client>,
) -> Result<Response, Problem> {
    let job = find(&service, id).await?;
    Ok(answer::json(StatusCode::OK, &show(&service, &client, &job)))
}

pub(super) async fn cancel(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
    Extension(client): Extension<Client>,
) -> Result<Response, Problem> {
    let worker = Arc::clone(&service);
    match blocking(move || Ok(worker.store.cancel(&id)?)).await? {
        Cancelled::Yes(job) => {
            service.runner.cancel(&job.id);
            tracing::info!(job = job.id, "to be cancelled");
            Ok(answer::json(StatusCode::ACCEPTED, &show(&service, &client, &job)))
        }
        Cancelled::Ended(state) => {
            let detail = format!("the job has {}; nothing is left to cancel", state.name());
            Err(Problem::new(StatusCode::CONFLICT, "conflict", detail))
        }
        Cancelled::Unknown => Err(Problem::not_found("job")),
    }
}

pub(super) async fn delete(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
) -> Result<Response, Problem> {
    match blocking(move || Ok(service.store.delete_job(&id)?)).await? {
        Deleted::Yes => Ok(StatusCode::NO_CONTENT.into_response()),
        Deleted::Active(state) => {
            let detail = format!("the job is {}; cancel it first", state.name());
            Err(Problem::new(StatusCode::CONFLICT, "conflict", detail))
        }
        Deleted::Unknown => Err(Problem::not_found("job")),
    }
}

/// Whether a client that accepts `kind` is asked for in so many words.
pub(super) fn accepts(headers: &HeaderMap, kind: &str) -> bool {
    text(headers, "accept").is_some_and(|accept| {
        accept.split(',').any(|one| one.split(';').next().is_some_and(|one| one.trim() == kind))
    })
}
