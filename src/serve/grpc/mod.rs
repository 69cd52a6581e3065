//! gRPC on the port of the HTTP interface: evaluation as a stream, health, reflection.
//!
//! The interface is `proto/poselight.proto`; its code is made by `make grpc` and kept here, so that a
//! build needs no compiler of interfaces.

mod evaluate;
mod status;

use std::sync::Arc;

use axum::Router;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

use super::Service;
pub(super) use status::{is_grpc, refusal};
use v1::evaluation_server::EvaluationServer;

/// What the interface's code is made into.
#[expect(
    unreachable_pub,
    unused_qualifications,
    clippy::allow_attributes_without_reason,
    reason = "made from proto/poselight.proto"
)]
mod v1 {
    include!("poselight.v1.rs");
}

/// The interface as reflection tells it.
const DESCRIPTOR: &[u8] = include_bytes!("descriptor.bin");

/// The paths of the evaluation, without their host.
const EVALUATION: &str = "/poselight.v1.Evaluation/";

/// Paths that anybody may ask for, as `/health`.
pub(super) const HEALTH: &str = "/grpc.health.v1.Health/";

/// Whether a path is one of ours: a stream, that takes as long as it takes.
pub(super) fn is_path(path: &str) -> bool {
    [EVALUATION, HEALTH, "/grpc.reflection."].iter().any(|prefix| path.starts_with(prefix))
}

/// Adds the paths of all services.
pub(super) fn routes(router: Router<Arc<Service>>, service: &Arc<Service>) -> Router<Arc<Service>> {
    let most = usize::try_from(service.settings.limits.body_bytes).unwrap_or(usize::MAX);
    let evaluator = evaluate::Evaluator::new(Arc::clone(service));
    let evaluation = EvaluationServer::new(evaluator).max_decoding_message_size(most);
    let (reporter, health) = tonic_health::server::health_reporter();
    tokio::spawn(tell(reporter, Arc::clone(service)));
    let router = router
        .route_service(&format!("{EVALUATION}{{*rest}}"), evaluation)
        .route_service(&format!("{HEALTH}{{*rest}}"), health);
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(DESCRIPTOR)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    match (reflection().build_v1(), reflection().build_v1alpha()) {
        (Ok(v1), Ok(alpha)) => router
            .route_service("/grpc.reflection.v1.ServerReflection/{*rest}", v1)
            .route_service("/grpc.reflection.v1alpha.ServerReflection/{*rest}", alpha),
        (Err(error), _) | (_, Err(error)) => {
            tracing::error!(%error, "there is no reflection");
            router
        }
    }
}

/// Those who watch the health are told when the service stops.
async fn tell(reporter: HealthReporter, service: Arc<Service>) {
    let all = async |status| {
        reporter.set_service_status("", status).await;
        reporter.set_service_status("poselight.v1.Evaluation", status).await;
    };
    all(ServingStatus::Serving).await;
    let mut stopping = service.stopping.clone();
    drop(service);
    if stopping.wait_for(|stopping| *stopping).await.is_ok() {
        all(ServingStatus::NotServing).await;
    }
}
