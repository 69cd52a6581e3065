//! Poses by the stream of gRPC, as many as go through.

use std::time::{Duration, Instant};

use futures_util::{StreamExt, stream};
use tonic::transport::Endpoint;

use v1::evaluation_client::EvaluationClient;

/// The client of the interface; `make grpc` writes it.
#[expect(
    unreachable_pub,
    unused_qualifications,
    clippy::allow_attributes_without_reason,
    reason = "made from proto/poselight.proto"
)]
mod v1 {
    include!("../../tests/serve/grpc/poselight.v1.rs");
}

/// Bytes that a client lets come before it has read them: a dozen frames.
const WINDOW_BYTES: u32 = 1 << 20;

/// Poses a second through one stream, each frame of so many bytes, over so many seconds.
pub(crate) fn rate(
    url: &str,
    model: &str,
    light: &[f32],
    row: &[f32],
    frame_bytes: usize,
    seconds: f64,
) -> f64 {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    runtime.expect("a runtime").block_on(async {
        let endpoint = Endpoint::from_shared(url.to_owned()).expect("an address");
        let endpoint = endpoint
            .initial_stream_window_size(WINDOW_BYTES)
            .initial_connection_window_size(WINDOW_BYTES)
            .tcp_nodelay(true);
        let channel = endpoint.connect().await.expect("connected");
        let light = v1::Light {
            colours: vec![v1::Coefficients { values: light.to_vec() }],
            ..v1::Light::default()
        };
        let mut setup =
            Some(v1::Setup { model: model.to_owned(), light: Some(light), ..v1::Setup::default() });
        let values = row.to_vec();
        let poses = stream::repeat_with(move || v1::Pose {
            setup: setup.take(),
            at: Some(v1::pose::At::Parameters(v1::Parameters { values: values.clone() })),
        });
        let answers = EvaluationClient::new(channel).evaluate(poses).await.expect("begun");
        let mut frames = answers.into_inner();
        frames.next().await.expect("a frame").expect("sound");
        let (start, length) = (Instant::now(), Duration::from_secs_f64(seconds));
        let mut count = 0_u64;
        while start.elapsed() < length {
            let frame = frames.next().await.expect("a frame").expect("sound");
            assert_eq!(frame.values.len(), frame_bytes);
            count += 1;
        }
        count as f64 / start.elapsed().as_secs_f64()
    })
}
