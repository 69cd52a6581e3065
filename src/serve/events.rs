//! `/v1/jobs/{id}/events`: what happens to a job, as server-sent events with ids.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::sse::{Event as Message, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use tokio::sync::watch;

use super::Service;
use super::answer::{InPath, blocking, text};
use super::jobs::find;
use super::problem::Problem;
use super::store::{Event, State as JobState};

/// Between two signs of life while nothing happens.
const HEARTBEAT: Duration = Duration::from_secs(15);

/// One client that listens to one job.
struct Listener {
    service: Arc<Service>,
    bell: watch::Receiver<()>,
    stopping: watch::Receiver<bool>,
    job: i64,
    id: String,
    after: i64,
    /// Read but not sent.
    waiting: VecDeque<Event>,
    ended: bool,
}

impl Listener {
    /// The next event, or none after the job's last one and when the service stops.
    async fn next(mut self) -> Option<(Result<Message, Infallible>, Self)> {
        loop {
            if let Some(event) = self.waiting.pop_front() {
                self.after = event.id;
                self.ended = is_last(&event);
                let message = Message::default().id(event.id.to_string()).event(event.kind);
                return Some((Ok(message.data(event.data)), self));
            }
            if self.ended || *self.stopping.borrow() {
                return None;
            }
            // Before the events are read: what comes later rings again.
            self.bell.mark_unchanged();
            let (service, job, after) = (Arc::clone(&self.service), self.job, self.after);
            let id = self.id.clone();
            let look = blocking(move || {
                // The state first: of a job that has ended all events are there.
                let ended = service.store.job(&id)?.is_none_or(|job| job.state.is_final());
                Ok((ended, service.store.events(job, after)?))
            });
            let (ended, events) = look.await.ok()?;
            self.waiting = events.into();
            if self.waiting.is_empty() && ended {
                return None;
            }
            if self.waiting.is_empty() {
                tokio::select! {
                    rung = self.bell.changed() => rung.ok()?,
                    _ = self.stopping.changed() => return None,
                }
            }
        }
    }
}

/// Whether nothing comes after this event.
fn is_last(event: &Event) -> bool {
    let state = serde_json::from_str::<serde_json::Value>(&event.data).unwrap_or_default();
    let state = state["state"].as_str().and_then(JobState::from_name);
    event.kind == "state" && state.is_some_and(JobState::is_final)
}

pub(super) async fn get(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let after = match text(&headers, "last-event-id") {
        None => 0,
        Some(id) => id.parse().map_err(|_| {
            Problem::field("Last-Event-ID", format!("`{id}` is no number of an event"))
        })?,
    };
    let job = find(&service, id).await?;
    let listener = Listener {
        bell: service.store.bells().listen(job.seq),
        stopping: service.stopping.clone(),
        job: job.seq,
        after,
        waiting: VecDeque::new(),
        ended: false,
        id: job.id,
        service,
    };
    let stream = stream::unfold(listener, Listener::next);
    Ok(Sse::new(stream).keep_alive(KeepAlive::new().interval(HEARTBEAT)).into_response())
}
