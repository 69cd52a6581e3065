//! `/v1/jobs/{id}/log` and `/v1/jobs/{id}/files/{name}`: what a job had to say, and what it made
//! beside a model.

use std::sync::Arc;

use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::json;

use super::answer::{self, InPath, blocking};
use super::jobs::find;
use super::models::REPORT_POLICY;
use super::problem::Problem;
use super::{Service, StoreError};

pub(super) async fn log(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
) -> Result<Response, Problem> {
    let job = find(&service, id).await?;
    let lines = blocking(move || Ok(service.store.log_of(job.seq)?)).await?;
    let line = |line: &super::store::Line| json!({ "id": line.id, "at_ms": line.at_ms, "level": line.level, "text": line.text });
    let lines: Vec<_> = lines.iter().map(line).collect();
    Ok(answer::json(StatusCode::OK, &json!({ "lines": lines })))
}

pub(super) async fn file(
    State(service): State<Arc<Service>>,
    InPath((id, name)): InPath<(String, String)>,
) -> Result<Response, Problem> {
    let job = find(&service, id).await?;
    let kind = kind(&name).ok_or_else(|| Problem::not_found("file of this job"))?;
    let path = service.store.folder().results(&job.id).join(&name);
    let bytes = match tokio::fs::read(&path).await {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return Err(Problem::not_found("file of this job"));
        }
        read => read.map_err(|source| StoreError::Io { action: "read", path, source })?,
    };
    let mut response = bytes.into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(REPORT_POLICY));
    Ok(response)
}

/// What a file is by its name; only names of this form meet the file system.
fn kind(name: &str) -> Option<&'static str> {
    let (stem, extension) = name.split_once('.')?;
    if stem.is_empty() || !stem.bytes().all(|byte| byte.is_ascii_lowercase() || byte == b'-') {
        return None;
    }
    match extension {
        "json" => Some("application/json"),
        "html" => Some("text/html; charset=utf-8"),
        "svg" => Some("image/svg+xml"),
        "glb" => Some("model/gltf-binary"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Only plain names of known kinds meet the file system.
    #[test]
    fn names_of_files_are_plain() {
        assert_eq!(kind("figures.json"), Some("application/json"));
        assert_eq!(kind("refined.glb"), Some("model/gltf-binary"));
        assert_eq!(kind("report.html"), Some("text/html; charset=utf-8"));
        for bad in ["..", "../a.json", ".json", "a/b.json", "a.json.json", "a.exe", "A.json", ""] {
            assert_eq!(kind(bad), None, "{bad}");
        }
    }
}
