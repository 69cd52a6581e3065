//! Which path leads where.

use std::sync::Arc;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::{Method, StatusCode, Uri};
use axum::middleware;
use axum::routing::{get, post, put};

use super::problem::Problem;
use super::{Service, assets, docs, evaluate, events, grpc, guard, health, jobs, models, results};

/// Every path of the service. Called within a runtime.
pub(super) fn router(service: &Arc<Service>) -> Router {
    let router = Router::new()
        .route("/v1/assets/{sha256}", put(assets::put).get(assets::get).delete(assets::delete))
        .route("/v1/jobs", post(jobs::submit).get(jobs::list))
        .route("/v1/jobs/{id}", get(jobs::get).delete(jobs::delete))
        .route("/v1/jobs/{id}/cancel", post(jobs::cancel))
        .route("/v1/jobs/{id}/events", get(events::get))
        .route("/v1/jobs/{id}/log", get(results::log))
        .route("/v1/jobs/{id}/files/{name}", get(results::file))
        .route("/v1/models", get(models::list))
        .route("/v1/models/{id}", get(models::get).delete(models::delete))
        .route("/v1/models/{id}/blob", get(models::blob))
        .route("/v1/models/{id}/report", get(models::report))
        .route("/v1/models/{id}/figures", get(models::figures))
        .route("/v1/models/{id}/evaluate", post(evaluate::post))
        .route("/health", get(health::health))
        .route("/ready", get(health::ready))
        .route("/metrics", get(health::metrics))
        .route("/openapi.json", get(health::openapi))
        .route("/docs", get(docs::get));
    grpc::routes(router, service)
        .fallback(unknown)
        .method_not_allowed_fallback(wrong_method)
        // Bodies are bounded where they are read, each by its own limit.
        .layer(DefaultBodyLimit::disable())
        .layer(middleware::from_fn_with_state(Arc::clone(service), guard::guard))
        .with_state(Arc::clone(service))
}

async fn unknown(uri: Uri) -> Problem {
    Problem::new(StatusCode::NOT_FOUND, "not-found", format!("there is nothing at {}", uri.path()))
}

async fn wrong_method(method: Method, uri: Uri) -> Problem {
    let detail = format!("{} does not take {method}", uri.path());
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "bad-request", detail)
}
