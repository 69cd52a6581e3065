//! What a client is told when something is wrong: RFC 9457, with the field that is at fault and
//! the limit that was hit.

use std::io::ErrorKind;

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use super::StoreError;

/// One refusal or failure.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Problem {
    pub(super) status: StatusCode,
    /// Names the kind of problem, as in `/problems/unknown-asset`.
    kind: &'static str,
    detail: String,
    /// JSON pointers into the body, or the names of headers and parameters, each with its fault.
    errors: Vec<(String, String)>,
    limit: Option<(&'static str, u64)>,
    retry_after_s: Option<u32>,
}

/// Every kind with its title; the document of the interface lists them.
pub(super) const KINDS: [(&str, &str); 24] = [
    ("asset-too-large", "The file is larger than the service takes"),
    ("bad-asset", "The file cannot be read as what it is named"),
    ("bad-request", "The request cannot be understood"),
    ("body-too-large", "The body is larger than the service takes"),
    ("conflict", "The job's state does not allow this"),
    ("forbidden", "Who asks may not do this"),
    ("hash-mismatch", "The bytes do not have the SHA-256 that was named"),
    ("internal", "The service failed"),
    ("invalid-field", "A field has a value that it cannot have"),
    ("invalid-json", "The body is not the JSON document that is expected"),
    ("invalid-pose", "The model cannot be evaluated at this pose"),
    ("job-too-large", "The job needs more memory than there is"),
    ("key-in-use", "The first request with this key is still being handled"),
    ("key-reused", "The key was used with another body"),
    ("not-found", "There is no such thing"),
    ("not-satisfiable", "The range lies beyond the file"),
    ("queue-full", "Too many jobs are waiting"),
    ("rate-limited", "Requests come too often"),
    ("storage-full", "There is no room left"),
    ("timeout", "The request took too long"),
    ("unauthorized", "A token is needed that is known and has not expired"),
    ("unavailable", "The service cannot work now"),
    ("unknown-asset", "An asset is not there; upload it first"),
    ("unknown-dataset", "A data set is not there; bake it first"),
];

/// Every limit that a problem may name; the document of the interface lists them.
pub(super) const LIMITS: [&str; 12] = [
    "answer_bytes",
    "asset_bytes",
    "assets_bytes",
    "body_bytes",
    "disk_bytes",
    "idle_s",
    "memory_bytes",
    "page_size",
    "poses",
    "queued_jobs",
    "rate_hz",
    "request_s",
];

impl Problem {
    pub(super) fn new(status: StatusCode, kind: &'static str, detail: impl Into<String>) -> Self {
        debug_assert!(KINDS.iter().any(|(known, _)| *known == kind), "{kind}");
        let (detail, errors) = (detail.into(), Vec::new());
        Self { status, kind, detail, errors, limit: None, retry_after_s: None }
    }

    /// 404.
    pub(super) fn not_found(what: &str) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not-found", format!("there is no such {what}"))
    }

    /// 422 of one field.
    pub(super) fn field(pointer: impl Into<String>, fault: impl Into<String>) -> Self {
        let (pointer, fault) = (pointer.into(), fault.into());
        let detail = format!("{pointer}: {fault}");
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid-field", detail).at(pointer, fault)
    }

    /// 500; the log says more than the client is told.
    pub(super) fn internal(cause: &dyn std::fmt::Display) -> Self {
        tracing::error!(%cause, "a request failed");
        let detail = "the service could not do this; its log says why";
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "internal", detail)
    }

    /// 503 of a disk that takes no writes.
    pub(super) fn no_writes() -> Self {
        let detail = "the disk of the service takes no writes; whoever runs it must mend that, and its \
                      log says what is wrong";
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "unavailable", detail).retry_after(30)
    }

    /// Whether it is none of the request's fault and may pass.
    pub(super) fn is_for_later(&self) -> bool {
        self.kind == "unavailable"
    }

    /// 503 of a request that took too long.
    pub(super) fn late(seconds: u32) -> Self {
        let detail = format!("there was no answer within {seconds} s");
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "timeout", detail)
            .limit("request_s", u64::from(seconds))
            .retry_after(5)
    }

    /// The field that is at fault.
    pub(super) fn at(mut self, pointer: impl Into<String>, fault: impl Into<String>) -> Self {
        self.errors.push((pointer.into(), fault.into()));
        self
    }

    /// The limit that was hit.
    pub(super) fn limit(mut self, name: &'static str, most: u64) -> Self {
        debug_assert!(LIMITS.contains(&name), "{name}");
        self.limit = Some((name, most));
        self
    }

    /// When to come again.
    pub(super) fn retry_after(mut self, seconds: u32) -> Self {
        self.retry_after_s = Some(seconds);
        self
    }

    /// The sentence.
    pub(super) fn detail(&self) -> &str {
        &self.detail
    }

    /// The first field that is at fault, with its fault.
    pub(super) fn fault(&self) -> Option<(&str, &str)> {
        self.errors.first().map(|(pointer, fault)| (pointer.as_str(), fault.as_str()))
    }

    /// Whether a limit was hit.
    pub(super) fn has_limit(&self) -> bool {
        self.limit.is_some()
    }

    /// As it is sent, and as a job's error is kept.
    pub(super) fn json(&self) -> Value {
        let title =
            KINDS.iter().find(|(kind, _)| *kind == self.kind).map_or("", |(_, title)| title);
        let mut value = json!({
            "type": format!("/problems/{}", self.kind),
            "title": title,
            "status": self.status.as_u16(),
            "detail": self.detail,
        });
        if !self.errors.is_empty() {
            let error = |(pointer, detail): &(String, String)| json!({ "pointer": pointer, "detail": detail });
            value["errors"] = self.errors.iter().map(error).collect();
        }
        if let Some((name, most)) = self.limit {
            value["limit"] = json!({ "name": name, "most": most });
        }
        value
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let kind = [(header::CONTENT_TYPE, "application/problem+json")];
        let mut response = (self.status, kind, self.json().to_string()).into_response();
        let headers = response.headers_mut();
        if let Some(seconds) = self.retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        if self.status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        if is_full(&error) {
            tracing::error!(%error, "no room left");
            let detail = "the disk of the service is full; delete jobs or models, or come again";
            return Self::new(StatusCode::INSUFFICIENT_STORAGE, "storage-full", detail);
        }
        if error.takes_no_writes() {
            tracing::error!(%error, "the disk takes no writes");
            return Self::no_writes();
        }
        Self::internal(&error)
    }
}

/// Whether the disk, or what one may have of it, is full.
pub(super) fn is_full_disk(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
}

/// Whether a full disk or database is the reason.
fn is_full(error: &StoreError) -> bool {
    match error {
        StoreError::Io { source, .. } => is_full_disk(source),
        StoreError::Sql(rusqlite::Error::SqliteFailure(cause, _)) => {
            cause.code == rusqlite::ErrorCode::DiskFull
        }
        _ => false,
    }
}
