//! The stream of gRPC against the HTTP interface: the same values, one for each pose and in their
//! order; faults end it after the frames before them; who does not read is not read.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use futures_util::{Stream, StreamExt, stream};
use serde_json::{Value, json};
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Request, Status};

use super::client::Server;
use v1::evaluation_client::EvaluationClient;

/// The client of the interface; `make grpc` writes it.
#[expect(
    unreachable_pub,
    unused_qualifications,
    clippy::allow_attributes_without_reason,
    reason = "made from proto/poselight.proto"
)]
mod v1 {
    include!("grpc/poselight.v1.rs");
}

use v1::pose::At;

fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime")
}

async fn channel(server: &Server) -> Channel {
    Endpoint::from_shared(server.url()).expect("an address").connect().await.expect("connected")
}

fn setup(model: &str) -> v1::Setup {
    v1::Setup { model: model.to_owned(), ..v1::Setup::default() }
}

fn joint(name: &str, rotation: [f32; 4]) -> At {
    let [x, y, z, w] = rotation;
    let rotation = Some(v1::Quaternion { x, y, z, w });
    let joint = v1::Joint { rotation, ..v1::Joint::default() };
    let joints = [(name.to_owned(), joint)].into_iter().collect();
    At::Joints(v1::Joints { joints, ..v1::Joints::default() })
}

/// Sends poses, the first with the set-up; every frame, and the status that ended them if any.
async fn frames(
    channel: &Channel,
    setup: v1::Setup,
    poses: Vec<At>,
) -> (Vec<v1::Frame>, Option<Status>) {
    let mut setup = Some(setup);
    let pose = move |at| v1::Pose { setup: setup.take(), at: Some(at) };
    let mut client = EvaluationClient::new(channel.clone());
    let poses: Vec<v1::Pose> = poses.into_iter().map(pose).collect();
    let mut answers = match client.evaluate(stream::iter(poses)).await {
        Ok(response) => response.into_inner(),
        Err(status) => return (Vec::new(), Some(status)),
    };
    let mut frames = Vec::new();
    while let Some(frame) = answers.next().await {
        match frame {
            Ok(frame) => frames.push(frame),
            Err(status) => return (frames, Some(status)),
        }
    }
    (frames, None)
}

/// A model's stream beside its evaluation over HTTP.
pub(crate) fn streams(server: &Server, model: &str) {
    let about = server.get(model, &[]).json();
    let id = about["id"].as_str().expect("an id");
    let joint_name = about["model"]["joints"][3].as_str().expect("a joint");
    runtime().block_on(async {
        let channel = channel(server).await;
        in_order(server, &channel, id, joint_name).await;
        let parameters = about["model"]["parameters"].as_array().map_or(0, Vec::len);
        by_parameters(server, &channel, id, parameters).await;
        faults(&channel, id, joint_name).await;
        patience(&channel, id).await;
        neighbours(&channel).await;
    });
    vanish(server, id);
}

/// Clients that vanish in the middle of their streams leave no connection behind.
fn vanish(server: &Server, id: &str) {
    runtime().block_on(async {
        let mut streams = Vec::new();
        for _ in 0..50 {
            let mut client = EvaluationClient::new(channel(server).await);
            let sent = Arc::new(AtomicUsize::new(0));
            let mut frames = client.evaluate(endless(id, &sent)).await.expect("begun").into_inner();
            frames.next().await.expect("a frame").expect("sound");
            streams.push((client, frames));
        }
        assert!(super::hostile::open_connections(server) > 50);
        // They, and the tasks that would speak for them, end with the runtime and say nothing more.
        std::mem::forget(streams);
    });
    let start = std::time::Instant::now();
    while super::hostile::open_connections(server) > 1 {
        assert!(start.elapsed() < Duration::from_secs(60), "connections stay");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// A light in words that a reflectance in words reflects towards an eye, over a clip and by joints, gives
/// the values that HTTP gives; without a light, without an eye, and beside parameters it is refused.
pub(crate) fn reflects(
    server: &Server,
    model: &str,
    (light, brdf, eye): (&str, &str, [f32; 3]),
    (name, times_s, expected): (&str, &[f32], &[f32]),
) {
    let id = model.rsplit('/').next().expect("an id");
    let [x, y, z] = eye;
    let asked = v1::Setup {
        light: Some(v1::Light { form: light.to_owned(), ..v1::Light::default() }),
        brdf: Some(v1::Brdf {
            form: brdf.to_owned(),
            eye: Some(v1::Vector { x, y, z }),
            ..v1::Brdf::default()
        }),
        ..setup(id)
    };
    runtime().block_on(async {
        let channel = channel(server).await;
        let at = |time_s| At::Clip(v1::ClipTime { name: name.to_owned(), time_s });
        let poses = times_s.iter().map(|&time_s| at(time_s)).collect();
        let (lit, fault) = frames(&channel, asked.clone(), poses).await;
        assert!(fault.is_none(), "{fault:?}");
        let bytes: Vec<u8> = lit.iter().flat_map(|f| f.values.iter().copied()).collect();
        let values: Vec<f32> =
            bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        assert!(values == expected, "not what HTTP gives");
        let still = At::Joints(v1::Joints::default());
        let (lit, fault) = frames(&channel, asked.clone(), vec![still]).await;
        assert!(fault.is_none() && lit[0].shape.last() == Some(&3), "{fault:?}");
        let brdf = asked.brdf.clone().expect("a reflectance");
        let blind = v1::Brdf { eye: None, ..brdf };
        for (setup, at) in [
            (v1::Setup { light: None, ..asked.clone() }, at(0.0)),
            (v1::Setup { brdf: Some(blind), ..asked.clone() }, at(0.0)),
            (asked.clone(), At::Parameters(v1::Parameters::default())),
        ] {
            let (_, fault) = frames(&channel, setup, vec![at]).await;
            assert_eq!(fault.map(|fault| fault.code()), Some(Code::InvalidArgument));
        }
    });
}

/// Times of a clip give the values that HTTP gives at them, without a scene being named; a clip that
/// there is not, and a time that is none, are refused.
pub(crate) fn plays(server: &Server, model: &str, name: &str, times_s: &[f32], expected: &[u8]) {
    let id = model.rsplit('/').next().expect("an id");
    runtime().block_on(async {
        let channel = channel(server).await;
        let at = |name: &str, time_s| At::Clip(v1::ClipTime { name: name.to_owned(), time_s });
        let poses = times_s.iter().map(|&time_s| at(name, time_s)).collect();
        let (played, fault) = frames(&channel, setup(id), poses).await;
        assert!(fault.is_none(), "{fault:?}");
        let values: Vec<u8> = played.iter().flat_map(|f| f.values.iter().copied()).collect();
        assert!(values == expected, "not what HTTP gives");
        for at in [at("swim", 0.0), at(name, f32::NAN), at(name, -1.0)] {
            let (_, fault) = frames(&channel, setup(id), vec![at]).await;
            assert_eq!(fault.map(|fault| fault.code()), Some(Code::InvalidArgument));
        }
    });
}

/// A row of parameters gives the values that HTTP gives.
async fn by_parameters(server: &Server, channel: &Channel, id: &str, count: usize) {
    let row: Vec<f32> = (0..count).map(|index| 0.01 * index as f32).collect();
    let body = json!({ "parameters": [row] });
    let raw = [("Accept", "application/octet-stream")];
    let expected = server.post(&format!("/v1/models/{id}/evaluate"), &body, &raw);
    assert_eq!(expected.status, 200, "{}", expected.text());
    let at = At::Parameters(v1::Parameters { values: row });
    let (frames, fault) = frames(channel, setup(id), vec![at]).await;
    assert!(fault.is_none(), "{fault:?}");
    assert!(frames.len() == 1 && frames[0].values == expected.body, "not what HTTP gives");
}

/// Fifty poses that differ give fifty frames, each that of its pose.
async fn in_order(server: &Server, channel: &Channel, id: &str, name: &str) {
    let turn = |index: usize| {
        let half = 0.01 * index as f32;
        [half.sin(), 0.0, 0.0, half.cos()]
    };
    let poses: Vec<Value> =
        (0..50).map(|index| json!({ "joints": { name: { "rotation": turn(index) } } })).collect();
    let body = json!({ "poses": poses, "vertices": [0, 7, 99] });
    let raw = [("Accept", "application/octet-stream")];
    let expected = server.post(&format!("/v1/models/{id}/evaluate"), &body, &raw);
    assert_eq!(expected.status, 200, "{}", expected.text());
    let given = (0..50).map(|index| joint(name, turn(index))).collect();
    let setup = v1::Setup { vertices: vec![0, 7, 99], ..setup(id) };
    let (frames, fault) = frames(channel, setup, given).await;
    assert!(fault.is_none(), "{fault:?}");
    assert!(frames.iter().map(|frame| frame.index).eq(0..50));
    assert!(frames.iter().all(|frame| frame.shape == [3, 1, 1] && frame.axes() == v1::Axes::Root));
    let values: Vec<u8> = frames.iter().flat_map(|frame| frame.values.iter().copied()).collect();
    assert!(values == expected.body, "not what HTTP gives");
    let told = server.post(&format!("/v1/models/{id}/evaluate"), &body, &[]).json();
    for (frame, distance) in frames.iter().zip(told["distances"].as_array().expect("distances")) {
        assert_eq!(Some(frame.mahalanobis), distance["mahalanobis"].as_f64().map(|far| far as f32));
    }
}

/// A fault names its pose, comes after the frames before it, and has the code that it deserves.
async fn faults(channel: &Channel, id: &str, name: &str) {
    let sound = || joint(name, [0.0, 0.0, 0.0, 1.0]);
    let zero = vec![sound(), sound(), joint(name, [0.0; 4]), sound()];
    let (before, fault) = frames(channel, setup(id), zero).await;
    let fault = fault.expect("a zero quaternion passes");
    assert_eq!((before.len(), fault.code()), (2, Code::InvalidArgument), "{fault:?}");
    assert!(fault.message().starts_with("pose 2: "), "{fault:?}");
    let row = |values| At::Parameters(v1::Parameters { values });
    let mesh = At::Positions(v1::Positions { values: vec![0.0; 3] });
    for (setup, at, code) in [
        (setup(id), row(vec![1.0]), Code::InvalidArgument),
        (setup(id), row(vec![f32::NAN; 10_000]), Code::InvalidArgument),
        (setup(id), mesh, Code::InvalidArgument),
        (v1::Setup { vertices: vec![u32::MAX], ..setup(id) }, sound(), Code::InvalidArgument),
        (
            v1::Setup { light: Some(v1::Light::default()), ..setup(id) },
            sound(),
            Code::InvalidArgument,
        ),
        (
            v1::Setup { scene: Some(v1::Scene::default()), ..setup(id) },
            sound(),
            Code::InvalidArgument,
        ),
        (setup(&"0".repeat(64)), sound(), Code::NotFound),
        (setup("../.."), sound(), Code::NotFound),
    ] {
        let (before, fault) = frames(channel, setup, vec![at]).await;
        let fault = fault.expect("a fault passes");
        assert_eq!((before.len(), fault.code()), (0, code), "{fault:?}");
        assert!(fault.message().starts_with("pose 0: "), "{fault:?}");
    }
    let mut client = EvaluationClient::new(channel.clone());
    let nothing = stream::iter([v1::Pose::default()]);
    let mut answers = client.evaluate(nothing).await.expect("begun").into_inner();
    let fault = answers.next().await.expect("an answer").expect_err("a pose without set-up passes");
    assert_eq!(fault.code(), Code::InvalidArgument, "{fault:?}");
}

/// A client that does not read its frames cannot send poses without end.
async fn patience(channel: &Channel, id: &str) {
    let sent = Arc::new(AtomicUsize::new(0));
    let mut client = EvaluationClient::new(channel.clone());
    let answers = client.evaluate(endless(id, &sent)).await.expect("begun").into_inner();
    let mut last = usize::MAX;
    for _ in 0..600 {
        let now = sent.load(Ordering::Relaxed);
        if now == last && now > 0 {
            break;
        }
        last = now;
        tokio::time::sleep(Duration::from_millis(500)).await;
    }
    let stalled = sent.load(Ordering::Relaxed);
    assert!(stalled == last && stalled < 50_000, "{stalled} poses were taken, and it goes on");
    // The connection is not stalled with it.
    let rest = At::Joints(v1::Joints::default());
    let (beside, fault) = frames(channel, setup(id), vec![rest]).await;
    assert!(beside.len() == 1 && fault.is_none(), "{fault:?}");
    drop(answers);
}

/// Poses at rest without end, counted as they are taken.
fn endless(id: &str, sent: &Arc<AtomicUsize>) -> impl Stream<Item = v1::Pose> + Send + 'static {
    let (mut setup, sent) = (Some(setup(id)), Arc::clone(sent));
    stream::repeat_with(move || {
        sent.fetch_add(1, Ordering::Relaxed);
        v1::Pose { setup: setup.take(), at: Some(At::Joints(v1::Joints::default())) }
    })
}

/// Health and reflection answer; what is no service is unimplemented.
async fn neighbours(channel: &Channel) {
    use tonic_health::pb::{HealthCheckRequest, health_client::HealthClient};
    use tonic_reflection::pb::v1 as reflection;
    let mut health = HealthClient::new(channel.clone());
    for service in ["", "poselight.v1.Evaluation"] {
        let request = HealthCheckRequest { service: service.to_owned() };
        let answer = health.check(request).await.expect("healthy").into_inner();
        assert_eq!(answer.status, 1, "`{service}` does not serve");
    }
    let mut client =
        reflection::server_reflection_client::ServerReflectionClient::new(channel.clone());
    let request = reflection::ServerReflectionRequest {
        message_request: Some(reflection::server_reflection_request::MessageRequest::ListServices(
            String::new(),
        )),
        ..Default::default()
    };
    let answers = client.server_reflection_info(stream::iter([request])).await.expect("reflected");
    let answer = answers.into_inner().next().await.expect("an answer").expect("sound");
    let said = format!("{answer:?}");
    assert!(said.contains("poselight.v1.Evaluation") && said.contains("grpc.health.v1"), "{said}");
}

/// Without a token, or with a wrong one, the stream is refused; with one that may read it is let in.
pub(crate) fn asks_for_tokens(server: &Server, token: &str) {
    runtime().block_on(async {
        let channel = channel(server).await;
        for (bearer, code) in [
            (None, Code::Unauthenticated),
            (Some("Bearer psl_0".to_owned()), Code::Unauthenticated),
            (Some(format!("Bearer {token}")), Code::NotFound),
        ] {
            let pose = v1::Pose { setup: Some(setup("x")), at: None };
            let mut request = Request::new(stream::iter([pose]));
            if let Some(bearer) = &bearer {
                request.metadata_mut().insert("authorization", bearer.parse().expect("a value"));
            }
            let answers = EvaluationClient::new(channel.clone()).evaluate(request).await;
            let fault = match answers {
                Ok(answers) => answers.into_inner().next().await.expect("an answer").err(),
                Err(status) => Some(status),
            };
            assert_eq!(fault.map(|fault| fault.code()), Some(code), "{bearer:?}");
        }
        neighbours_are_closed(&channel).await;
    });
}

/// Of the others only the health is for everybody.
async fn neighbours_are_closed(channel: &Channel) {
    use tonic_health::pb::{HealthCheckRequest, health_client::HealthClient};
    let mut health = HealthClient::new(channel.clone());
    health.check(HealthCheckRequest::default()).await.expect("health needs no token");
    let mut client =
        tonic_reflection::pb::v1::server_reflection_client::ServerReflectionClient::new(
            channel.clone(),
        );
    let refused = client.server_reflection_info(stream::iter([])).await.expect_err("open");
    assert_eq!(refused.code(), Code::Unauthenticated);
}
