//! Pages of other origins: none may ask, but those that the settings name (the CORS protocol of the
//! Fetch standard).

use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::answer::text;

/// What a page may send.
const HEADERS: &str =
    "authorization, content-type, idempotency-key, if-none-match, last-event-id, range";

/// What a page may read beside the headers that it always may.
const EXPOSED: &str = "etag, location, retry-after, content-range, poselight-shape, poselight-frame, \
     poselight-mahalanobis-max, poselight-residual-max, poselight-notices, poselight-request, \
     poselight-kind";

/// Seconds that a browser remembers what it may do.
const REMEMBER_S: &str = "600";

/// The origin of a request, where the settings allow it.
pub(super) fn allowed(origins: &[String], headers: &HeaderMap) -> Option<HeaderValue> {
    let origin = text(headers, "origin")?;
    origins.iter().any(|known| known == origin).then(|| headers.get("origin").cloned()).flatten()
}

/// The answer to a browser that asks what it may do; it carries no token, and learns nothing else.
pub(super) fn preflight(
    method: &Method,
    headers: &HeaderMap,
    origin: Option<&HeaderValue>,
) -> Option<Response> {
    let asks = *method == Method::OPTIONS && headers.contains_key("access-control-request-method");
    let origin = origin.filter(|_| asks)?;
    let mut response = StatusCode::NO_CONTENT.into_response();
    let out = response.headers_mut();
    let set = |text: &'static str| HeaderValue::from_static(text);
    out.insert(header::ACCESS_CONTROL_ALLOW_METHODS, set("GET, HEAD, PUT, POST, DELETE"));
    out.insert(header::ACCESS_CONTROL_ALLOW_HEADERS, set(HEADERS));
    out.insert(header::ACCESS_CONTROL_MAX_AGE, set(REMEMBER_S));
    mark(&mut response, Some(origin));
    Some(response)
}

/// Lets an allowed page read an answer.
pub(super) fn mark(response: &mut Response, origin: Option<&HeaderValue>) {
    let Some(origin) = origin else { return };
    let out = response.headers_mut();
    out.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, origin.clone());
    out.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, HeaderValue::from_static(EXPOSED));
    out.insert(header::VARY, HeaderValue::from_static("origin"));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Only an origin that is named, to the letter, is let in; others get no word of it.
    #[test]
    fn only_named_origins_are_let_in() {
        let origins = vec!["https://tools.example".to_owned()];
        let asked = |origin: &str| {
            let mut headers = HeaderMap::new();
            headers.insert("origin", origin.parse().expect("a value"));
            headers.insert("access-control-request-method", HeaderValue::from_static("PUT"));
            let allowed = allowed(&origins, &headers);
            preflight(&Method::OPTIONS, &headers, allowed.as_ref())
        };
        let answer = asked("https://tools.example").expect("allowed");
        assert_eq!(answer.headers()["access-control-allow-origin"], "https://tools.example");
        assert!(!answer.headers().contains_key("access-control-allow-credentials"));
        for other in
            ["https://evil.example", "https://tools.example.evil", "null", "http://tools.example"]
        {
            assert!(asked(other).is_none(), "{other}");
        }
    }
}
