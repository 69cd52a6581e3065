//! Whether the service lives, whether it can work, and its figures.

use std::sync::{Arc, LazyLock};

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use super::answer::{self, blocking};
use super::problem::Problem;
use super::store::State as JobState;
use super::{Service, disk};
use crate::pipeline::recipe::Recipe;

/// The document of the interface, without the recipe.
const OPENAPI: &str = include_str!("openapi.json");

/// The whole document: the recipe's schema is what the recipe's own type says.
static DOCUMENT: LazyLock<Value> = LazyLock::new(|| {
    let mut document: Value = serde_json::from_str(OPENAPI).unwrap_or_default();
    let mut recipe = schemars::schema_for!(Recipe).to_value();
    // References within the schema are relative to its own name.
    recipe["$id"] = json!("/schemas/recipe");
    document["components"]["schemas"]["Recipe"] = recipe;
    document
});

/// The same as it is sent.
static TEXT: LazyLock<String> = LazyLock::new(|| DOCUMENT.to_string());

/// The whole document.
pub(super) fn document() -> &'static Value {
    &DOCUMENT
}

pub(super) async fn health() -> Response {
    answer::json(
        StatusCode::OK,
        &json!({ "status": "alive", "version": env!("CARGO_PKG_VERSION") }),
    )
}

/// Ready is who can take a job: the disk takes writes wherever a job makes them, and the service is not
/// about to end.
pub(super) async fn ready(State(service): State<Arc<Service>>) -> Response {
    let stopping = *service.stopping.borrow();
    let look = move || {
        let full = disk::is_full(&service);
        service.store.touch()?;
        let fault = service.store.folder().probe().err();
        Ok((full, fault.inspect(|error| tracing::error!(%error, "not ready")).is_some()))
    };
    let (status, state) = match (stopping, blocking(look).await) {
        (true, _) => (StatusCode::SERVICE_UNAVAILABLE, "stopping"),
        (false, Err(_)) => (StatusCode::SERVICE_UNAVAILABLE, "the store takes no writes"),
        (false, Ok((true, _))) => {
            (StatusCode::SERVICE_UNAVAILABLE, "the disk has no room for a job")
        }
        (false, Ok((_, true))) => {
            (StatusCode::SERVICE_UNAVAILABLE, "the disk takes no writes; the log says where")
        }
        (false, Ok(_)) => (StatusCode::OK, "ready"),
    };
    answer::json(status, &json!({ "status": state }))
}

pub(super) async fn metrics(State(service): State<Arc<Service>>) -> Result<Response, Problem> {
    let worker = Arc::clone(&service);
    let read = move || Ok((worker.store.count_jobs()?, worker.store.rays_per_s()?));
    let (counts, rays_per_s) = blocking(read).await?;
    let jobs = JobState::ALL
        .into_iter()
        .map(|state| (state.name(), counts.get(state.name()).copied().unwrap_or(0)));
    let text = service.metrics.text(jobs, rays_per_s, service.hot.figures());
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text).into_response())
}

pub(super) async fn openapi() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], TEXT.as_str()).into_response()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::serve::problem::{KINDS, LIMITS};

    /// The document lists every path and method of the router, every kind of problem and every
    /// state, and no other; every reference in it leads somewhere.
    #[test]
    fn the_document_is_the_interface() {
        let document = document();
        assert_eq!(document["openapi"], "3.1.0");
        let router = include_str!("router.rs");
        let mut routes = BTreeSet::new();
        for line in router.lines().filter_map(|line| line.trim().strip_prefix(".route(\"")) {
            let (path, handlers) = line.split_once('"').expect("a path");
            for method in ["get", "put", "post", "delete"] {
                if handlers.contains(&format!("{method}(")) {
                    routes.insert(format!("{method} {path}"));
                }
            }
        }
        let paths = document["paths"].as_object().expect("paths");
        let methods = |(path, item): (&String, &Value)| -> Vec<String> {
            let item = item.as_object().expect("methods");
            item.keys().map(|method| format!("{method} {path}")).collect()
        };
        let listed: BTreeSet<String> = paths.iter().flat_map(methods).collect();
        assert_eq!(routes, listed);
        let schemas = &document["components"]["schemas"];
        let kinds: Vec<String> =
            KINDS.iter().map(|(kind, _)| format!("/problems/{kind}")).collect();
        assert_eq!(schemas["Problem"]["properties"]["type"]["enum"], json!(kinds));
        let limit = &schemas["Problem"]["properties"]["limit"]["properties"]["name"];
        assert_eq!(limit["enum"], json!(LIMITS));
        assert_eq!(schemas["State"]["enum"], json!(JobState::ALL.map(JobState::name)));
        for reference in OPENAPI.split("\"$ref\": \"#").skip(1) {
            let pointer = reference.split('"').next().unwrap_or_default();
            assert!(document.pointer(pointer).is_some(), "{pointer} leads nowhere");
        }
    }
}
