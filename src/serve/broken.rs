//! The service while disk or database do not let it work: alive, not ready, and saying why.

use std::net::TcpListener;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use axum::Router;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use serde_json::json;
use tokio::runtime::Runtime;
use tokio::sync::watch;

use super::problem::Problem;
use super::{
    Error, GLANCE, MENDED, Settings, Store, StoreError, answer, connections, health, open,
};

/// Serves nothing but its state until the store can be opened, or until `stop` is set: then there is
/// none.
///
/// # Errors
/// As [`super::serve`].
pub(super) fn wait(
    runtime: &Runtime,
    listener: &TcpListener,
    settings: &Settings,
    fault: &StoreError,
    stop: &AtomicBool,
) -> Result<Option<Store>, Error> {
    tracing::error!(error = %fault, "not ready");
    let address = settings.address;
    let own = listener.try_clone().map_err(|source| Error::Listen { address, source })?;
    let (stopper, stopping) = watch::channel(false);
    runtime.block_on(async {
        let mending = async {
            let mended = mended(settings, fault, stop).await;
            stopper.send_replace(true);
            mended
        };
        let accepting =
            connections::accept(own, settings.limits, router(), Default::default(), stopping);
        tokio::join!(accepting, mending).1
    })
}

/// The store as soon as it can be had; why not is told whenever it changes.
async fn mended(
    settings: &Settings,
    fault: &StoreError,
    stop: &AtomicBool,
) -> Result<Option<Store>, Error> {
    let (mut last, mut told) = (Instant::now(), fault.to_string());
    loop {
        tokio::time::sleep(GLANCE).await;
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        if last.elapsed() < MENDED {
            continue;
        }
        match open(settings, Store::reopen)? {
            Ok(store) => {
                tracing::info!("the store is mended");
                return Ok(Some(store));
            }
            Err(fault) if fault.to_string() != told => {
                tracing::error!(error = %fault, "not ready");
                told = fault.to_string();
            }
            Err(_) => {}
        }
        last = Instant::now();
    }
}

fn router() -> Router {
    let ready = || async {
        let state = json!({ "status": "the store cannot be opened; the service's log says why" });
        answer::json(StatusCode::SERVICE_UNAVAILABLE, &state)
    };
    let other = || async { unavailable() };
    Router::new().route("/health", get(health::health)).route("/ready", get(ready)).fallback(other)
}

fn unavailable() -> Response {
    let detail = "disk or database do not let the service work; it begins when they do";
    Problem::new(StatusCode::SERVICE_UNAVAILABLE, "unavailable", detail)
        .retry_after(10)
        .into_response()
}
