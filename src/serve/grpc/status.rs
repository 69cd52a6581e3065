//! Problems as gRPC has them.

use axum::body::Body;
use axum::http::{HeaderMap, Response, StatusCode};
use tonic::{Code, Status};

use crate::serve::answer::text;
use crate::serve::problem::Problem;

/// Whether a request expects an answer of gRPC.
pub(in crate::serve) fn is_grpc(headers: &HeaderMap) -> bool {
    text(headers, "content-type").is_some_and(|kind| kind.starts_with("application/grpc"))
}

/// A refusal before any service was asked.
pub(in crate::serve) fn refusal(problem: &Problem) -> Response<Body> {
    of_problem(problem, problem.detail().to_owned()).into_http()
}

/// The status of a problem, with a sentence.
pub(super) fn of_problem(problem: &Problem, text: String) -> Status {
    let code = match problem.status {
        StatusCode::UNAUTHORIZED => Code::Unauthenticated,
        StatusCode::FORBIDDEN => Code::PermissionDenied,
        StatusCode::NOT_FOUND => Code::NotFound,
        StatusCode::PAYLOAD_TOO_LARGE
        | StatusCode::TOO_MANY_REQUESTS
        | StatusCode::INSUFFICIENT_STORAGE => Code::ResourceExhausted,
        _ if problem.has_limit() => Code::ResourceExhausted,
        StatusCode::SERVICE_UNAVAILABLE => Code::Unavailable,
        status if status.is_client_error() => Code::InvalidArgument,
        _ => Code::Internal,
    };
    Status::new(code, text)
}
