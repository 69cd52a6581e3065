//! Clients of HTTP/2 that hold on to a connection and take nothing.
//!
//! What such a client does not take never meets the network: its own windows hold it back, while its
//! connection is alive and answers. So every body of an answer notes when it has handed on a part, and
//! takes the note back when it is asked for the next; one whose note grows old waits for its client.
//! A body that waits for us, such as a stream of events between two, has no note.

use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::{Duration, Instant};

use axum::body::{Body as Answer, Bytes};
use hyper::body::{Body, Frame, SizeHint};

/// Bytes that are handed on at once: who takes less than this within the limit is let go. A frame of an
/// evaluation is less, for each part of it costs time.
const PART: usize = 128 << 10;

/// A connection on which nothing was asked for so many times the limit is let go too.
const IDLE: u32 = 10;

/// Requests of one connection.
#[derive(Debug, Clone)]
pub(super) struct Requests(Arc<Mutex<Open>>);

#[derive(Debug)]
struct Open {
    next: u64,
    /// Since when each open request waits for its client, if it does.
    since: BTreeMap<u64, Option<Instant>>,
    /// When the last request began or ended.
    changed: Instant,
}

impl Requests {
    /// Of a connection that has just begun.
    pub(super) fn new() -> Self {
        let open = Open { next: 0, since: BTreeMap::new(), changed: Instant::now() };
        Self(Arc::new(Mutex::new(open)))
    }

    /// One more request, until its answer is gone.
    pub(super) fn begin(&self) -> Request {
        let mut open = self.lock();
        let id = open.next;
        open.next += 1;
        open.since.insert(id, None);
        open.changed = Instant::now();
        drop(open);
        Request { all: self.clone(), id }
    }

    /// Ends when the client takes nothing for so long, or asks for nothing for much longer.
    pub(super) async fn stalled(&self, limit: Duration) {
        while !self.is_stalled(limit, Instant::now()) {
            tokio::time::sleep(limit / 4).await;
        }
    }

    fn is_stalled(&self, limit: Duration, now: Instant) -> bool {
        let open = self.lock();
        let old = |since: Instant, limit| now.saturating_duration_since(since) >= limit;
        let waits = open.since.values().flatten().any(|&since| old(since, limit));
        waits || (open.since.is_empty() && old(open.changed, limit * IDLE))
    }

    fn lock(&self) -> MutexGuard<'_, Open> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One request that is open.
#[derive(Debug)]
pub(super) struct Request {
    all: Requests,
    id: u64,
}

impl Request {
    /// The answer's body, which waits for its client from now on.
    pub(super) fn answer(self, inner: Answer) -> Watched {
        self.waits(true);
        Watched { request: self, inner, rest: Bytes::new() }
    }

    fn waits(&self, waits: bool) {
        self.all.lock().since.insert(self.id, waits.then(Instant::now));
    }
}

impl Drop for Request {
    fn drop(&mut self) {
        let mut open = self.all.lock();
        open.since.remove(&self.id);
        open.changed = Instant::now();
    }
}

/// A body that notes when it waits for its client.
#[derive(Debug)]
pub(super) struct Watched {
    request: Request,
    inner: Answer,
    /// Of a part that is larger than is handed on at once.
    rest: Bytes,
}

impl Body for Watched {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let this = self.get_mut();
        if this.rest.is_empty() {
            this.request.waits(false);
            let frame = match ready!(Pin::new(&mut this.inner).poll_frame(context)) {
                Some(Ok(frame)) => frame,
                other => return Poll::Ready(other),
            };
            match frame.into_data() {
                Ok(data) => this.rest = data,
                Err(trailers) => return Poll::Ready(Some(Ok(trailers))),
            }
        }
        this.request.waits(true);
        let part = this.rest.split_to(this.rest.len().min(PART));
        Poll::Ready(Some(Ok(Frame::data(part))))
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty() && self.inner.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        let (inner, rest) = (self.inner.size_hint(), self.rest.len() as u64);
        let mut hint = SizeHint::new();
        hint.set_lower(inner.lower().saturating_add(rest));
        if let Some(upper) = inner.upper() {
            hint.set_upper(upper.saturating_add(rest));
        }
        hint
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::task::noop_waker;

    const LIMIT: Duration = Duration::from_secs(1);

    fn later(requests: &Requests, seconds: u64) -> bool {
        requests.is_stalled(LIMIT, Instant::now() + Duration::from_secs(seconds))
    }

    /// A body comes out as it went in, in parts; it waits for its client from the answer on, after
    /// each part, and neither while it waits for us nor when it is gone.
    #[test]
    fn a_body_waits_for_its_client() {
        let requests = Requests::new();
        let request = requests.begin();
        assert!(!later(&requests, 100), "we have not answered yet");
        let bytes = Bytes::from(vec![7; PART + 5]);
        let late = futures_util::stream::pending::<Result<Bytes, std::convert::Infallible>>();
        let first = futures_util::stream::iter([Ok(bytes)]);
        let stream = futures_util::StreamExt::chain(first, late);
        let mut body = request.answer(Answer::from_stream(stream));
        assert!(later(&requests, 2), "the client has not taken anything");
        let waker = noop_waker();
        let mut context = Context::from_waker(&waker);
        let mut lengths = Vec::new();
        while let Poll::Ready(Some(Ok(frame))) = Pin::new(&mut body).poll_frame(&mut context) {
            assert!(later(&requests, 2) && !later(&requests, 0), "it waits for the next part");
            lengths.push(frame.into_data().expect("data").len());
        }
        assert_eq!(lengths, [PART, 5]);
        assert!(!later(&requests, 100), "now it waits for us");
        drop(body);
        assert!(!later(&requests, 9) && later(&requests, 11), "nothing is asked for");
    }

    /// Length and end are those of the body.
    #[test]
    fn length_and_end_are_known() {
        let requests = Requests::new();
        let mut body = requests.begin().answer(Answer::from(vec![1; 3 * PART]));
        assert_eq!(body.size_hint().exact(), Some(3 * PART as u64));
        let waker = noop_waker();
        let mut context = Context::from_waker(&waker);
        for left in [2, 1, 0] {
            assert!(!body.is_end_stream());
            let part = Pin::new(&mut body).poll_frame(&mut context);
            assert!(matches!(part, Poll::Ready(Some(Ok(_)))));
            assert_eq!(body.size_hint().exact(), Some(left * PART as u64));
        }
        assert!(body.is_end_stream());
    }
}
