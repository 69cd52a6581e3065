//! Files as answers: entity tags, ranges, and bodies that stream.

use std::io::SeekFrom;
use std::path::Path;

use axum::body::Body;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio_util::io::ReaderStream;

use super::StoreError;
use super::answer::text;
use super::problem::Problem;

/// Bytes that are read and sent at once.
const CHUNK_BYTES: usize = 256 << 10;

/// A file that never changes, named by its SHA-256: with a strong entity tag, `If-None-Match`,
/// and one range.
///
/// # Errors
/// 416; what the disk objects to.
pub(super) async fn immutable(
    path: &Path,
    sha256: &str,
    kind: &'static str,
    method: &Method,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let tag = format!("\"{sha256}\"");
    if text(headers, "if-none-match").is_some_and(|given| matches(given, &tag)) {
        let mut response = StatusCode::NOT_MODIFIED.into_response();
        mark(response.headers_mut(), &tag);
        return Ok(response);
    }
    let io = |source| StoreError::Io { action: "read", path: path.to_path_buf(), source };
    let mut file = match tokio::fs::File::open(path).await {
        // Deleted since it was looked up.
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            tracing::warn!(path = %path.display(), "a file is gone");
            return Err(Problem::not_found("file any more"));
        }
        opened => opened.map_err(io)?,
    };
    let size = file.metadata().await.map_err(io)?.len();
    // A range of another version than the client has is a range of nothing.
    let same = text(headers, "if-range").is_none_or(|given| given == tag);
    let range = text(headers, "range").filter(|_| same && *method == Method::GET);
    let (status, first, count) = match range.map(|range| parse(range, size)) {
        None | Some(Wanted::All) => (StatusCode::OK, 0, size),
        Some(Wanted::Part(first, last)) => (StatusCode::PARTIAL_CONTENT, first, last - first + 1),
        Some(Wanted::Beyond) => return Ok(beyond(size)),
    };
    file.seek(SeekFrom::Start(first)).await.map_err(io)?;
    let body = match *method {
        Method::HEAD => Body::empty(),
        _ => Body::from_stream(ReaderStream::with_capacity(file.take(count), CHUNK_BYTES)),
    };
    let mut response = (status, [(header::CONTENT_TYPE, kind)], body).into_response();
    let out = response.headers_mut();
    mark(out, &tag);
    out.insert(header::CONTENT_LENGTH, HeaderValue::from(count));
    if status == StatusCode::PARTIAL_CONTENT {
        let range = format!("bytes {first}-{}/{size}", first + count - 1);
        out.insert(header::CONTENT_RANGE, value(&range));
    }
    Ok(response)
}

fn mark(headers: &mut HeaderMap, tag: &str) {
    headers.insert(header::ETAG, value(tag));
    headers.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    let forever = HeaderValue::from_static("private, max-age=31536000, immutable");
    headers.insert(header::CACHE_CONTROL, forever);
}

fn beyond(size: u64) -> Response {
    let detail = format!("the file has {size} bytes");
    let problem = Problem::new(StatusCode::RANGE_NOT_SATISFIABLE, "not-satisfiable", detail);
    let mut response = problem.into_response();
    response.headers_mut().insert(header::CONTENT_RANGE, value(&format!("bytes */{size}")));
    response
}

/// Gives a file a second name; where the file system has no links, a copy. A name that is taken
/// stays as it is: to copy over it could write into the file itself.
///
/// # Errors
/// What the disk objects to.
pub(super) fn link(from: &Path, to: &Path) -> Result<(), StoreError> {
    let linked = match std::fs::hard_link(from, to) {
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => Ok(()),
        Err(_) => std::fs::copy(from, to).map(drop),
        Ok(()) => Ok(()),
    };
    linked.map_err(|source| StoreError::Io { action: "copy", path: to.to_path_buf(), source })
}

/// A response with one more header.
pub(super) fn with(mut response: Response, name: &'static str, text: &str) -> Response {
    response.headers_mut().insert(HeaderName::from_static(name), value(text));
    response
}

/// What we write ourselves is ASCII without control characters.
fn value(text: &str) -> HeaderValue {
    HeaderValue::from_str(text).unwrap_or_else(|_| HeaderValue::from_static(""))
}

/// Whether a list of entity tags has this one; weak ones compare as strong ones here (RFC 9110,
/// §13.1.2).
fn matches(given: &str, tag: &str) -> bool {
    given.split(',').map(str::trim).any(|one| one == "*" || one.trim_start_matches("W/") == tag)
}

/// What a `Range` header asks for.
#[derive(Debug, PartialEq, Eq)]
enum Wanted {
    /// No range, one that we do not serve, or several: the whole file is a right answer.
    All,
    /// First and last byte.
    Part(u64, u64),
    /// Nothing of the file.
    Beyond,
}

fn parse(range: &str, size: u64) -> Wanted {
    let Some((first, last)) = range.strip_prefix("bytes=").and_then(|one| one.split_once('-'))
    else {
        return Wanted::All;
    };
    let (first, last) = (first.trim(), last.trim());
    let (first, last) = match (first.parse::<u64>(), last.parse::<u64>()) {
        (Ok(first), Ok(last)) if first > last => return Wanted::All,
        (Ok(first), Ok(last)) => (first, last),
        (Ok(first), Err(_)) if last.is_empty() => (first, u64::MAX),
        (Err(_), Ok(0)) if first.is_empty() => return Wanted::Beyond,
        (Err(_), Ok(count)) if first.is_empty() => (size.saturating_sub(count), u64::MAX),
        _ => return Wanted::All,
    };
    if first >= size { Wanted::Beyond } else { Wanted::Part(first, last.min(size - 1)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ranges by RFC 9110, §14: first and last, open, suffix, beyond, and nonsense.
    #[test]
    fn ranges_are_read() {
        assert_eq!(parse("bytes=0-3", 10), Wanted::Part(0, 3));
        assert_eq!(parse("bytes=4-", 10), Wanted::Part(4, 9));
        assert_eq!(parse("bytes=-3", 10), Wanted::Part(7, 9));
        assert_eq!(parse("bytes=-30", 10), Wanted::Part(0, 9));
        assert_eq!(parse("bytes=8-99", 10), Wanted::Part(8, 9));
        assert_eq!(parse("bytes=10-", 10), Wanted::Beyond);
        assert_eq!(parse("bytes=-0", 10), Wanted::Beyond);
        for odd in ["bytes=3-1", "lines=0-3", "bytes=a-b", "bytes=0-1,4-5", "bytes=-", ""] {
            assert_eq!(parse(odd, 10), Wanted::All, "{odd}");
        }
    }

    /// A tag is found in a list, weak or strong, and nothing else is.
    #[test]
    fn tags_are_compared() {
        assert!(matches("\"a\", W/\"b\"", "\"b\"") && matches("*", "\"b\""));
        assert!(!matches("\"a\"", "\"b\""));
    }
}
