//! Connections: of HTTP/1.1 or, for gRPC and whoever else begins so, of HTTP/2; bounded in number, in
//! the time and size of a request's head, and let go in peace when the service ends.

use std::convert::Infallible;
use std::io::Cursor;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use axum::Router;
use hyper::body::Incoming;
use hyper::server::conn::{http1, http2};
use hyper::service::Service as _;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use tokio::io::AsyncReadExt;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};

use super::stalled::{Requests, Watched};
use super::{FAREWELL, Limits};

/// Bytes of a request's head at most.
const HEAD_BYTES: u32 = 64 << 10;

/// Headers of a request at most.
const HEADERS: usize = 100;

/// Requests at once on a connection of HTTP/2.
const STREAMS: u32 = 64;

/// Bytes that a client may send ahead on one stream of HTTP/2. Its connection has room for all of its
/// streams, so that one which nobody reads does not hold up the others.
const STREAM_BYTES: u32 = 128 << 10;

/// Between two looks whether the other end of a connection of HTTP/2 is still there.
const LOOK: Duration = Duration::from_secs(20);

/// After a failure to accept, such as no free descriptor.
const PAUSE: Duration = Duration::from_millis(100);

/// How long the first bytes of a connection are waited for once the service ends: a request that was on
/// its way is answered.
const LINGER: Duration = Duration::from_secs(2);

/// What a client of HTTP/2 begins with where nothing else tells the version (RFC 9113, §3.4). No
/// method of HTTP/1 begins as its first three letters do.
const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";

/// Speaks with one client after another, each version in its own way.
struct Speaker {
    http1: http1::Builder,
    http2: http2::Builder<TokioExecutor>,
    app: TowerToHyperService<Router>,
    /// For the first bytes.
    patience: Duration,
    /// How long a client may take nothing.
    idle: Duration,
    stopping: watch::Receiver<bool>,
}

impl Speaker {
    fn new(limits: Limits, app: Router, stopping: watch::Receiver<bool>) -> Self {
        let patience = Duration::from_secs(u64::from(limits.head_s));
        let mut http1 = http1::Builder::new();
        http1
            .timer(TokioTimer::new())
            .header_read_timeout(patience)
            .max_buf_size(HEAD_BYTES as usize)
            .max_headers(HEADERS);
        let mut http2 = http2::Builder::new(TokioExecutor::new());
        http2
            .timer(TokioTimer::new())
            .max_header_list_size(HEAD_BYTES)
            .max_concurrent_streams(STREAMS)
            .initial_stream_window_size(STREAM_BYTES)
            .initial_connection_window_size(STREAMS * STREAM_BYTES)
            .keep_alive_interval(LOOK)
            .keep_alive_timeout(patience.max(PAUSE));
        let idle = Duration::from_secs(u64::from(limits.idle_s));
        Self { http1, http2, app: TowerToHyperService::new(app), patience, idle, stopping }
    }

    /// The service for one connection of HTTP/2, whose requests are known.
    fn watched(
        &self,
        requests: &Requests,
    ) -> impl hyper::service::Service<
        hyper::Request<Incoming>,
        Response = hyper::Response<Watched>,
        Error = Infallible,
        Future: Send + 'static,
    > + use<> {
        let (app, requests) = (self.app.clone(), requests.clone());
        hyper::service::service_fn(move |request| {
            let (open, answer) = (requests.begin(), app.call(request));
            async move { answer.await.map(|answer| answer.map(|body| open.answer(body))) }
        })
    }

    /// One connection to its end.
    async fn speak(&self, mut stream: TcpStream) {
        let mut first = Vec::with_capacity(PREFACE.len());
        let begun = tokio::select! {
            begun = tokio::time::timeout(self.patience, begin(&mut stream, &mut first)) => begun,
            () = async { self.stopped().await; tokio::time::sleep(LINGER).await } => return,
        };
        let Ok(Ok(is_http2)) = begun else { return };
        // What was read to find out is read again.
        let (reading, writing) = stream.into_split();
        let io = TokioIo::new(tokio::io::join(Cursor::new(first).chain(reading), writing));
        // The connection first: one that is told to end before it has looked at what was read would
        // drop it. A client that vanishes is no fault of ours.
        if is_http2 {
            let requests = Requests::new();
            let mut connection = pin!(self.http2.serve_connection(io, self.watched(&requests)));
            let to_its_end = async {
                tokio::select! {
                    biased;
                    _ = connection.as_mut() => return,
                    () = self.stopped() => connection.as_mut().graceful_shutdown(),
                }
                let _ = connection.await;
            };
            tokio::select! {
                () = to_its_end => {}
                () = requests.stalled(self.idle) => tracing::debug!("a client takes nothing"),
            }
        } else {
            let mut connection = pin!(self.http1.serve_connection(io, self.app.clone()));
            tokio::select! {
                biased;
                _ = connection.as_mut() => return,
                () = self.stopped() => connection.as_mut().graceful_shutdown(),
            }
            let _ = connection.await;
        }
    }

    async fn stopped(&self) {
        // An error says that nobody is left who could stop it: then the process ends.
        let _ = self.stopping.clone().wait_for(|stopping| *stopping).await;
    }
}

/// Lets the system end a connection whose client takes nothing of what is sent to it, whether it has
/// vanished or is only slow on purpose.
fn give_up(stream: &TcpStream, idle_s: u32) {
    #[cfg(target_os = "linux")]
    if let Err(error) =
        rustix::net::sockopt::set_tcp_user_timeout(stream, idle_s.saturating_mul(1000))
    {
        tracing::debug!(%error, "a connection may idle");
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (stream, idle_s);
}

/// Reads until it is known whether a client begins as HTTP/2 does.
async fn begin(stream: &mut TcpStream, first: &mut Vec<u8>) -> std::io::Result<bool> {
    while first.len() < PREFACE.len() {
        let left = (PREFACE.len() - first.len()) as u64;
        let count = (&mut *stream).take(left).read_buf(first).await?;
        if count == 0 || !PREFACE.starts_with(first) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Accepts connections until the service stops, then waits for the open ones, not for ever.
pub(super) async fn accept(
    listener: std::net::TcpListener,
    limits: Limits,
    app: Router,
    open: Arc<AtomicU64>,
    mut stopping: watch::Receiver<bool>,
) {
    let listener = match TcpListener::from_std(listener) {
        Ok(listener) => listener,
        Err(error) => return tracing::error!(%error, "cannot listen"),
    };
    let speaker = Arc::new(Speaker::new(limits, app, stopping.clone()));
    let places = Arc::new(Semaphore::new(limits.connections as usize));
    let graceful = GracefulShutdown::new();
    loop {
        let place = tokio::select! {
            place = Arc::clone(&places).acquire_owned() => place,
            _ = stopping.wait_for(|stopping| *stopping) => break,
        };
        let Ok(place) = place else { break };
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            _ = stopping.wait_for(|stopping| *stopping) => break,
        };
        let stream = match accepted {
            Ok((stream, _)) => stream,
            Err(error) => {
                tracing::warn!(%error, "cannot accept a connection");
                tokio::time::sleep(PAUSE).await;
                continue;
            }
        };
        // Small answers go out at once.
        let _ = stream.set_nodelay(true);
        give_up(&stream, limits.idle_s);
        let (open, speaker, watcher) =
            (Arc::clone(&open), Arc::clone(&speaker), graceful.watcher());
        open.fetch_add(1, Ordering::Relaxed);
        tokio::spawn(async move {
            speaker.speak(stream).await;
            drop(watcher);
            open.fetch_sub(1, Ordering::Relaxed);
            drop(place);
        });
    }
    drop(listener);
    if tokio::time::timeout(FAREWELL, graceful.shutdown()).await.is_err() {
        tracing::warn!("connections were cut that did not end in time");
    }
}
