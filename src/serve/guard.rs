//! What every request passes on its way in and every answer on its way out: who asks, how long it
//! may take, what a browser may do with the answer, and one line in the log.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tracing::Instrument as _;

use super::answer::{blocking, text};
use super::problem::Problem;
use super::store::{hash_of, random_id};
use super::{Service, files, grpc, origins};

/// Who asks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Client {
    /// The token's name; empty where no token is needed.
    pub(super) name: String,
    /// Whether it may change things, and so see whom jobs tell of their end.
    pub(super) may_write: bool,
}

/// On every answer: it is no page, no frame, no script, and nothing tells where it came from.
const HEADERS: [(HeaderName, &str); 4] = [
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CONTENT_SECURITY_POLICY, "default-src 'none'"),
];

pub(super) async fn guard(
    State(service): State<Arc<Service>>,
    mut request: Request,
    next: Next,
) -> Response {
    let start = Instant::now();
    let id = random_id().unwrap_or_default();
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let mut name = String::new();
    name_host(&mut request);
    let headers = request.headers().clone();
    let origin = origins::allowed(&service.settings.origins, &headers);
    if let Some(answer) = origins::preflight(&method, &headers, origin.as_ref()) {
        return answer;
    }
    let admitted = match admit(&service, &method, &path, &headers).await {
        // Whoever watches over the service always gets an answer.
        Ok(client) if matches!(path.as_str(), "/health" | "/ready") => Ok(client),
        Ok(client) => in_rate(&service, client, start),
        refused => refused,
    };
    let mut response = match admitted {
        Err(problem) if grpc::is_grpc(&headers) => grpc::refusal(&problem),
        Err(problem) => problem.into_response(),
        Ok(client) => {
            name.clone_from(&client.name);
            request.extensions_mut().insert(client);
            let span = tracing::info_span!("request", id);
            in_time(&service, request, next).instrument(span).await
        }
    };
    origins::mark(&mut response, origin.as_ref());
    let headers = response.headers_mut();
    for (key, value) in HEADERS {
        headers.entry(key).or_insert(HeaderValue::from_static(value));
    }
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    let status = response.status().as_u16();
    service.metrics.answered(status);
    let ms = start.elapsed().as_millis() as u64;
    tracing::info!(request = id, client = name, %method, path, status, ms, "answered");
    files::with(response, "poselight-request", &id)
}

/// HTTP/2 names the host as a part of the address; the rest of the service finds it where HTTP/1 has
/// it.
fn name_host(request: &mut Request) {
    let authority = request.uri().authority().map(|authority| authority.as_str().to_owned());
    if let Some(Ok(host)) = authority.map(|host| HeaderValue::from_str(&host)) {
        request.headers_mut().insert(header::HOST, host);
    }
}

/// Lets a client pass that does not ask too often.
fn in_rate(service: &Service, client: Client, now: Instant) -> Result<Client, Problem> {
    let Some(rate_hz) = service.settings.limits.rate_hz else { return Ok(client) };
    match service.rates.take(&client.name, rate_hz, now) {
        Ok(()) => Ok(client),
        Err(wait) => {
            let detail = format!("at most {rate_hz} requests a second are answered");
            Err(Problem::new(StatusCode::TOO_MANY_REQUESTS, "rate-limited", detail)
                .limit("rate_hz", u64::from(rate_hz))
                .retry_after(wait.as_secs_f64().ceil() as u32))
        }
    }
}

/// Answers within the time limit, where the request is not a stream.
async fn in_time(service: &Service, request: Request, next: Next) -> Response {
    if is_stream(request.method(), request.uri().path()) {
        return next.run(request).await;
    }
    let seconds = service.settings.limits.request_s;
    let limit = Duration::from_secs(u64::from(seconds));
    let answer = tokio::time::timeout(limit, next.run(request)).await;
    answer.unwrap_or_else(|_| Problem::late(seconds).into_response())
}

/// Uploads, downloads and events take as long as they take; a submission keeps its own time, for what
/// is accepted must not be answered with a refusal.
fn is_stream(method: &Method, path: &str) -> bool {
    (path.starts_with("/v1/assets/") && *method != Method::HEAD)
        || (path == "/v1/jobs" && *method == Method::POST)
        || path.ends_with("/events")
        || grpc::is_path(path)
        || path.ends_with("/blob")
}

/// Who asks, if they may.
async fn admit(
    service: &Arc<Service>,
    method: &Method,
    path: &str,
    headers: &HeaderMap,
) -> Result<Client, Problem> {
    if !service.guarded {
        // Anybody on this machine may ask; a page in somebody's browser may not ask for them.
        let page = origins::allowed(&service.settings.origins, headers).is_some();
        return local(headers, page).map(|()| Client { name: String::new(), may_write: true });
    }
    let open = matches!(path, "/health" | "/ready" | "/openapi.json" | "/docs");
    if open || path.starts_with(grpc::HEALTH) {
        return Ok(Client { name: String::new(), may_write: false });
    }
    let secret = text(headers, "authorization")
        .and_then(|value| value.split_once(' '))
        .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"))
        .map(|(_, secret)| hash_of(secret.trim()));
    let unauthorized = |detail| Problem::new(StatusCode::UNAUTHORIZED, "unauthorized", detail);
    let Some(hash) = secret else {
        return Err(unauthorized("send the header `Authorization: Bearer` with a token"));
    };
    let worker = Arc::clone(service);
    let token = blocking(move || Ok(worker.store.token(&hash)?)).await?;
    let token = token.ok_or_else(|| unauthorized("the token is unknown or has expired"))?;
    let needed = scope(method, path);
    let has = |scope| token.scopes.split(' ').any(|own| own == scope);
    if !has(needed) {
        let detail = format!("the token lacks the scope `{needed}`");
        return Err(Problem::new(StatusCode::FORBIDDEN, "forbidden", detail));
    }
    let may_write = has("write");
    Ok(Client { name: token.name, may_write })
}

/// What a token must allow; an evaluation changes nothing.
fn scope(method: &Method, path: &str) -> &'static str {
    let reads = matches!(*method, Method::GET | Method::HEAD)
        || path.ends_with("/evaluate")
        || grpc::is_path(path);
    if reads { "read" } else { "write" }
}

/// Without tokens: the name must be this machine's own, and no other page may be the origin, or
/// any page that somebody looks at could give orders.
fn local(headers: &HeaderMap, page_allowed: bool) -> Result<(), Problem> {
    let refuse = |what: &str| {
        let detail = format!("{what}; without tokens the service answers to this machine only");
        Err(Problem::new(StatusCode::FORBIDDEN, "forbidden", detail))
    };
    let host = text(headers, "host").unwrap_or_default();
    if !is_local(host) {
        return refuse(&format!("the host `{host}` is not this machine"));
    }
    if page_allowed {
        return Ok(());
    }
    match text(headers, "origin").and_then(|origin| origin.split_once("://")) {
        Some((_, origin)) if origin != host => refuse("another origin asks"),
        None if headers.contains_key("origin") => refuse("an origin without a name asks"),
        _ => Ok(()),
    }
}

fn is_local(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name == "localhost" || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(host: &str, origin: Option<&str>) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert("host", host.parse().unwrap());
        if let Some(origin) = origin {
            headers.insert("origin", origin.parse().unwrap());
        }
        headers
    }

    /// A page elsewhere cannot reach the service through a browser on this machine, neither under
    /// its own name nor with its own origin.
    #[test]
    fn other_pages_are_refused() {
        for host in ["localhost:1", "127.0.0.1:1", "[::1]:1", "localhost"] {
            assert!(local(&headers(host, None), false).is_ok(), "{host}");
        }
        assert!(local(&headers("localhost:1", Some("http://localhost:1")), false).is_ok());
        let named = headers("localhost:1", Some("http://tools.example"));
        assert!(
            local(&named, true).is_ok() && local(&headers("evil.example", None), true).is_err()
        );
        for (host, origin) in [
            ("evil.example:1", None),
            ("localhost.evil.example", None),
            ("localhost:1", Some("http://evil.example")),
            ("localhost:1", Some("http://localhost:2")),
            ("localhost:1", Some("null")),
        ] {
            assert!(local(&headers(host, origin), false).is_err(), "{host} {origin:?}");
        }
    }

    /// What changes something needs the right to.
    #[test]
    fn scopes_follow_the_method() {
        assert_eq!(scope(&Method::GET, "/v1/jobs"), "read");
        assert_eq!(scope(&Method::POST, "/v1/jobs"), "write");
        assert_eq!(scope(&Method::POST, "/v1/models/x/evaluate"), "read");
        assert_eq!(scope(&Method::POST, "/poselight.v1.Evaluation/Evaluate"), "read");
        assert_eq!(scope(&Method::DELETE, "/v1/models/x"), "write");
    }
}
