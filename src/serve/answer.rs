//! Small things that every handler uses: bodies in, JSON out, work that blocks.

use axum::body::Body;
use axum::extract::{FromRequestParts, Path, Query};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::held::Held;
use super::problem::Problem;
use super::{Service, words};

/// Runs what blocks away from the threads that answer; what it logs bears its request's id.
pub(super) async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    let request = tracing::Span::current();
    let work = move || request.in_scope(work);
    tokio::task::spawn_blocking(work).await.unwrap_or_else(|panic| Err(Problem::internal(&panic)))
}

/// Bytes of a body that no room is asked for: the many small ones do not wait for the large ones.
const SMALL: u64 = 64 << 10;

/// A body, with its room among all that are in memory.
#[derive(Debug)]
pub(super) struct Text {
    bytes: Vec<u8>,
    held: Held,
}

impl std::ops::Deref for Text {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes
    }
}

/// A body of a document, within its limit.
///
/// # Errors
/// `body-too-large`; `unavailable` where other large ones have the room.
pub(super) async fn bytes(
    service: &Service,
    headers: &HeaderMap,
    body: Body,
) -> Result<Text, Problem> {
    let most = service.settings.limits.body_bytes;
    let too_large = || {
        let detail = format!("the body has more than {most} bytes");
        Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "body-too-large", detail)
            .limit("body_bytes", most)
    };
    if content_length(headers).is_some_and(|length| length > most) {
        return Err(too_large());
    }
    let mut text = Text { bytes: Vec::new(), held: service.bodies.hold(0)? };
    let mut stream = body.into_data_stream();
    while let Some(chunk) = stream.next().await {
        let chunk = chunk.map_err(|_| broken())?;
        let length = (text.bytes.len() + chunk.len()) as u64;
        if length > most {
            return Err(too_large());
        }
        if length > SMALL {
            service.bodies.grow(&mut text.held, length)?;
        }
        text.bytes.extend_from_slice(&chunk);
    }
    Ok(text)
}

/// Reads a body that nobody needs, up to so many bytes.
pub(super) async fn drain(body: Body, most: u64) {
    let (mut stream, mut read) = (body.into_data_stream(), 0);
    while let Some(Ok(chunk)) = stream.next().await {
        read += chunk.len() as u64;
        if read > most {
            return;
        }
    }
}

/// A body that ended before its end.
pub(super) fn broken() -> Problem {
    Problem::new(StatusCode::BAD_REQUEST, "bad-request", "the body ended before its end")
}

/// What the client says the body's size is.
pub(super) fn content_length(headers: &HeaderMap) -> Option<u64> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

/// A document of a known kind; a fault names its field.
pub(super) fn document<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    let value: T = serde_path_to_error::deserialize(&mut reader).map_err(|error| {
        let pointer = pointer(&error.path().to_string());
        let fault = words::of_json(error.inner());
        let status = match error.inner().classify() {
            serde_json::error::Category::Data => StatusCode::UNPROCESSABLE_ENTITY,
            _ => StatusCode::BAD_REQUEST,
        };
        Problem::new(status, "invalid-json", format!("{pointer}: {fault}")).at(pointer, fault)
    })?;
    reader.end().map_err(|error| {
        Problem::new(StatusCode::BAD_REQUEST, "invalid-json", error.to_string())
    })?;
    Ok(value)
}

/// `a.b[3].c` as the JSON pointer `#/a/b/3/c`.
pub(super) fn pointer(path: &str) -> String {
    let parts = path.split(['.', '[']).map(|part| part.trim_end_matches(']'));
    let parts = parts.filter(|part| !part.is_empty() && *part != "?");
    parts.fold("#".to_owned(), |pointer, part| pointer + "/" + &escaped(part))
}

/// A name as a part of a JSON pointer.
pub(super) fn escaped(name: &str) -> String {
    name.replace('~', "~0").replace('/', "~1")
}

/// What follows the `?`; a fault is a problem like any other.
#[derive(Debug)]
pub(super) struct Params<T>(pub(super) T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Params<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let query = Query::from_request_parts(parts, state).await;
        query.map(|Query(params)| Self(params)).map_err(|rejection| {
            let detail = words::of_query(&rejection.body_text());
            Problem::new(StatusCode::BAD_REQUEST, "bad-request", detail)
        })
    }
}

/// Names that stand in a path; one that is no text is a problem like any other.
#[derive(Debug)]
pub(super) struct InPath<T>(pub(super) T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for InPath<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let names = Path::from_request_parts(parts, state).await;
        names.map(|Path(names)| Self(names)).map_err(|_| {
            let detail = "a name in the path is no text: its bytes are no UTF-8";
            Problem::new(StatusCode::BAD_REQUEST, "bad-request", detail)
        })
    }
}

/// JSON with a status.
pub(super) fn json(status: StatusCode, value: &Value) -> Response {
    (status, [(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

/// Whether a name in a path can be a SHA-256: what else it says never meets the file system.
pub(super) fn is_sha256(name: &str) -> bool {
    name.len() == 64 && name.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

/// A header's text.
pub(super) fn text<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name)?.to_str().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Paths of serde become pointers of RFC 6901.
    #[test]
    fn faults_point_at_their_field() {
        assert_eq!(pointer("recipe.bake.order"), "#/recipe/bake/order");
        assert_eq!(pointer("poses[3].joints"), "#/poses/3/joints");
        assert_eq!(pointer("."), "#");
    }

    /// Only digests pass as names of files.
    #[test]
    fn names_are_digests() {
        assert!(is_sha256(&"0af".repeat(22)[..64]));
        for bad in ["", "..", &"A".repeat(64), &"a".repeat(63), &format!("../{}", "a".repeat(61))] {
            assert!(!is_sha256(bad), "{bad}");
        }
    }
}
