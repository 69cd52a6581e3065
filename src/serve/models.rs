//! `/v1/models`: what finished jobs made.

use std::sync::Arc;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use super::answer::{self, InPath, Params, blocking, is_sha256};
use super::page::PageQuery;
use super::poses::needs_scene;
use super::problem::Problem;
use super::store::StoredModel;
use super::{Service, StoreError, files};
use crate::model::Model;
use crate::pipeline;

/// What the report page may do: show itself.
pub(super) const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:; sandbox allow-scripts";

/// A model by the id in a path.
async fn find(service: &Arc<Service>, id: &str) -> Result<StoredModel, Problem> {
    if !is_sha256(id) {
        return Err(Problem::not_found("model"));
    }
    let (service, id) = (Arc::clone(service), id.to_owned());
    let model = blocking(move || Ok(service.store.model(&id)?)).await?;
    model.ok_or_else(|| Problem::not_found("model"))
}

fn show(stored: &StoredModel) -> Value {
    let href = format!("/v1/models/{}", stored.id);
    json!({
        "id": stored.id,
        "sha256": stored.sha256,
        "bytes": stored.bytes,
        "job": stored.job,
        "created_ms": stored.created_ms,
        "href": href,
        "blob": format!("{href}/blob"),
        "report": format!("{href}/report"),
        "figures": format!("{href}/figures"),
    })
}

/// What a client needs to know to evaluate the model.
fn describe(model: &Model) -> Value {
    let header = model.header();
    let rig = &header.rig;
    json!({
        "family": header.family.name(),
        "signal": header.signal.name(),
        "frame": header.frame.name(),
        "precision": header.precision.name(),
        "order": header.order,
        "channels": header.channels,
        "vertices": header.mesh.vertices,
        "points": header.mesh.points,
        "needs_scene": needs_scene(model),
        "joints": rig.nodes.iter().map(|node| &node.name).collect::<Vec<_>>(),
        "weights": rig.weights.iter().map(|weight| &weight.name).collect::<Vec<_>>(),
        "parameters": rig.columns.iter().map(|column| &column.name).collect::<Vec<_>>(),
        "errors": header.errors,
        "recipe": header.provenance.recipe,
        "hashes": header.provenance.hashes,
    })
}

pub(super) async fn list(
    State(service): State<Arc<Service>>,
    Params(query): Params<PageQuery>,
) -> Result<Response, Problem> {
    let (before, count) = query.page()?;
    let models = blocking(move || Ok(service.store.models(before, count)?)).await?;
    let full = models.len() == count as usize;
    let next = models.last().filter(|_| full).map(|model| model.seq);
    let models: Vec<Value> = models.iter().map(show).collect();
    Ok(answer::json(StatusCode::OK, &json!({ "models": models, "next_page_token": next })))
}

pub(super) async fn get(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
) -> Result<Response, Problem> {
    let stored = find(&service, &id).await?;
    let model = blocking(move || service.hot.model(&service, &id)).await?;
    let model = model.ok_or_else(|| Problem::not_found("model"))?;
    let mut value = show(&stored);
    value["model"] = describe(&model);
    Ok(answer::json(StatusCode::OK, &value))
}

pub(super) async fn blob(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let stored = find(&service, &id).await?;
    let path = service.store.folder().model(&id).join(pipeline::MODEL);
    let kind = "application/octet-stream";
    let response = files::immutable(&path, &stored.sha256, kind, &method, &headers).await?;
    let name = format!("attachment; filename=\"{}.safetensors\"", &id[..12]);
    Ok(files::with(response, "content-disposition", &name))
}

pub(super) async fn report(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
) -> Result<Response, Problem> {
    let page = text(&service, &id, pipeline::REPORT).await?;
    let mut response = page.into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8"));
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(REPORT_POLICY));
    Ok(response)
}

pub(super) async fn figures(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
) -> Result<Response, Problem> {
    let figures = text(&service, &id, pipeline::FIGURES).await?;
    Ok(([(header::CONTENT_TYPE, "application/json")], figures).into_response())
}

/// A file of a model, small enough to be read whole.
async fn text(service: &Arc<Service>, id: &str, name: &str) -> Result<Vec<u8>, Problem> {
    find(service, id).await?;
    let path = service.store.folder().model(id).join(name);
    match tokio::fs::read(&path).await {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let detail = "this model was fitted but not measured: submit a job of kind `measure`";
            Err(Problem::new(StatusCode::NOT_FOUND, "not-found", detail))
        }
        read => read.map_err(|source| StoreError::Io { action: "read", path, source }.into()),
    }
}

pub(super) async fn delete(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
) -> Result<Response, Problem> {
    find(&service, &id).await?;
    let delete = move || {
        let gone = service.store.delete_model(&id);
        // Afterwards: what is read in between is forgotten too.
        service.hot.forget(&id);
        Ok(gone?)
    };
    let gone = blocking(delete).await?;
    if gone { Ok(StatusCode::NO_CONTENT.into_response()) } else { Err(Problem::not_found("model")) }
}
