//! The service under load, by clients of its own over loopback: evaluation with and without a bake
//! beside it, request by request and as a stream, downloads, idle listeners, the way of a job from submission to work, long lists.
//!
//! `cargo bench --bench serve`; a number after `--` is the seconds of each load. Requests are sent
//! by the clock: an answer's time counts from when its request was due, so that a service that
//! stands still is not asked less. The model is P(8,22) at order 6 of 14,517 points, its light
//! folded, one pose by parameters for each request, answered as raw f32.

#![expect(clippy::print_stdout, reason = "a benchmark's table is its output")]

#[path = "serve/client.rs"]
mod client;
#[path = "serve/stream.rs"]
mod stream;
#[path = "synthetic/mod.rs"]
mod synthetic;

use std::time::{Duration, Instant};

use client::{Connection, Server, sha256};
use poselight::model::{Frame, Precision};
use serde_json::{Value, json};

const POINTS: usize = 14_517;
const RATE_HZ: f64 = 500.0;
const CLIENTS: usize = 4;
const LISTENERS: usize = 10_000;
const JOBS: usize = 100_000;

fn quantile(sorted: &[f64], q: f64) -> f64 {
    sorted
        .get(((sorted.len() as f64 * q) as usize).min(sorted.len().saturating_sub(1)))
        .copied()
        .unwrap_or(f64::NAN)
}

/// Milliseconds of each answer, counted from when its request was due.
fn load(server: &Server, path: &str, body: &[u8], seconds: f64) -> Vec<f64> {
    let pause = CLIENTS as f64 / RATE_HZ;
    let count = (seconds / pause) as usize;
    let start = Instant::now() + Duration::from_millis(20);
    let client = |index: usize| {
        let mut connection = server.connect();
        let mut times = Vec::with_capacity(count);
        for number in 0..count {
            let due = start
                + Duration::from_secs_f64((number as f64 + index as f64 / CLIENTS as f64) * pause);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            let answer =
                connection.send("POST", path, body, "Accept: application/octet-stream\r\n");
            assert_eq!((answer.status, answer.body.len()), (200, POINTS * 4));
            times.push(due.elapsed().as_secs_f64() * 1e3);
        }
        times
    };
    let mut times: Vec<f64> = std::thread::scope(|scope| {
        let clients: Vec<_> =
            (0..CLIENTS).map(|index| scope.spawn(move || client(index))).collect();
        clients.into_iter().flat_map(|client| client.join().expect("a client")).collect()
    });
    times.sort_by(f64::total_cmp);
    times
}

fn row(name: &str, times: &[f64]) {
    let [p50, p99, p999] = [0.5, 0.99, 0.999].map(|q| quantile(times, q));
    println!("| {name} | {} | {p50:.2} | {p99:.2} | {p999:.2} |", times.len());
}

/// A bake that takes longer than any load.
fn long_bake(server: &Server, seed: u64) -> String {
    let recipe = json!({ "version": 1, "bake": { "rays": 20_000, "seed": seed }, "poses": { "rate_hz": 30 } });
    submit(server, "bake", &recipe)
}

fn submit(server: &Server, kind: &str, recipe: &Value) -> String {
    let request =
        json!({ "kind": kind, "assets": { "figure.glb": server.figure() }, "recipe": recipe });
    let answer = server.connect().send("POST", "/v1/jobs", request.to_string().as_bytes(), "");
    assert_eq!(answer.status, 202, "{}", answer.text());
    format!("/v1/jobs/{}", answer.json()["id"].as_str().expect("an id"))
}

fn wait(connection: &mut Connection, place: &str, states: &[&str]) -> Value {
    loop {
        let job = connection.send("GET", place, b"", "").json();
        if job["state"].as_str().is_some_and(|state| states.contains(&state)) {
            return job;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn evaluation(server: &Server, seconds: f64) {
    let model = format!("/v1/models/{}/evaluate", server.model());
    let light = synthetic::numbers(6, synthetic::WIDTH);
    let parameters = synthetic::numbers(5, synthetic::PARAMETERS);
    let body =
        json!({ "parameters": [parameters], "light": { "coefficients": [light] } }).to_string();
    println!("\nEvaluation, {POINTS} points, {RATE_HZ} requests a second, {CLIENTS} clients\n");
    println!("| beside | requests | median ms | p99 ms | p99.9 ms |\n|---|---|---|---|---|");
    load(server, &model, body.as_bytes(), 1.0);
    row("nothing", &load(server, &model, body.as_bytes(), seconds));
    let streamed = || {
        let url = server.url();
        stream::rate(&url, server.model(), &light, &parameters, POINTS * 4, seconds / 2.0)
    };
    let alone = streamed();
    let bake = long_bake(server, 77);
    wait(&mut server.connect(), &bake, &["running"]);
    std::thread::sleep(Duration::from_millis(500));
    row("a bake on all threads", &load(server, &model, body.as_bytes(), seconds));
    let beside = streamed();
    println!("\ngRPC, one stream: {alone:.0} poses/s, beside the bake {beside:.0} poses/s");
    // The service lets go of connections that idle.
    let mut connection = server.connect();
    assert_eq!(
        connection.send("GET", &bake, b"", "").json()["state"],
        "running",
        "the bake ended too soon"
    );
    connection.send("POST", &format!("{bake}/cancel"), b"", "");
    wait(&mut connection, &bake, &["cancelled"]);
}

fn downloads(server: &Server) {
    let bytes: Vec<u8> = (0..256_u32 << 20).map(|i| (i >> 10) as u8).collect();
    let path = format!("/v1/assets/{}", sha256(&bytes));
    let mut connection = server.connect();
    let start = Instant::now();
    assert_eq!(connection.send("PUT", &path, &bytes, "").status, 201);
    let up = bytes.len() as f64 / start.elapsed().as_secs_f64() / 1e9;
    let down = |connection: &mut Connection| {
        let start = Instant::now();
        let length = connection.drain(&path);
        assert_eq!(length, bytes.len());
        length as f64 / start.elapsed().as_secs_f64() / 1e9
    };
    let best = (0..5).map(|_| down(&mut connection)).fold(0.0, f64::max);
    println!(
        "\n256 MiB: upload with its SHA-256 and fsync {up:.2} GB/s, download {best:.2} GB/s (best of 5)"
    );
}

fn listeners(server: &Server) {
    let bake = long_bake(server, 78);
    wait(&mut server.connect(), &bake, &["running"]);
    server.connect().send("POST", &format!("{bake}/cancel"), b"", "");
    // One that waits: nothing is told, and every listener is idle.
    let first = long_bake(server, 79);
    wait(&mut server.connect(), &first, &["running"]);
    let waiting = long_bake(server, 80);
    let before = server.resident_bytes();
    let mut open = Vec::new();
    for _ in 0..LISTENERS {
        let Some(stream) = server.listen(&format!("{waiting}/events")) else { break };
        open.push(stream);
    }
    let taken = server.resident_bytes().saturating_sub(before);
    let each = taken as f64 / open.len() as f64;
    println!(
        "\n{} idle listeners: {:.0} MB, {:.1} kB each",
        open.len(),
        taken as f64 / 1e6,
        each / 1e3
    );
    drop(open);
    for place in [waiting, first] {
        let mut connection = server.connect();
        connection.send("POST", &format!("{place}/cancel"), b"", "");
        wait(&mut connection, &place, &["cancelled"]);
    }
}

/// From the submission's first byte to the moment that the service notes as the job's start, on one
/// clock since both are on one machine.
fn starts(server: &Server) {
    let mut times = Vec::new();
    for seed in 0..20 {
        let recipe = json!({ "version": 1, "poses": { "rate_hz": 1 }, "bake": { "signal": "ao", "rays": 1, "seed": seed } });
        let sent =
            std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("a clock");
        let place = submit(server, "bake", &recipe);
        let job = wait(&mut server.connect(), &place, &["succeeded"]);
        times.push(job["started_ms"].as_f64().expect("a time") - sent.as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    println!(
        "\nsubmitted to started, figure, {} jobs: median {:.0} ms, longest {:.0} ms",
        times.len(),
        quantile(&times, 0.5),
        times[times.len() - 1]
    );
}

fn lists(server: &Server) {
    println!("\n| page of 100 of {JOBS} jobs | median ms | longest ms |\n|---|---|---|");
    for (name, query) in [
        ("first", String::new()),
        ("in the middle", format!("&page_token={}", JOBS / 2)),
        ("of a frequent state", "&state=succeeded".to_owned()),
        ("of a rare state", "&state=failed".to_owned()),
        ("of a rare kind", "&kind=measure".to_owned()),
    ] {
        let mut connection = server.connect();
        let mut times: Vec<f64> = (0..20)
            .map(|_| {
                let start = Instant::now();
                let answer =
                    connection.send("GET", &format!("/v1/jobs?page_size=100{query}"), b"", "");
                assert_eq!(answer.status, 200, "{}", answer.text());
                start.elapsed().as_secs_f64() * 1e3
            })
            .collect();
        times.sort_by(f64::total_cmp);
        println!("| {name} | {:.1} | {:.1} |", quantile(&times, 0.5), times[times.len() - 1]);
    }
}

fn main() {
    let seconds = std::env::args().find_map(|word| word.parse().ok()).unwrap_or(20.0);
    let model = synthetic::model(POINTS, Frame::Root);
    let blob = model.to_bytes(Precision::F32).expect("a blob");
    let server = Server::start(&blob, JOBS);
    evaluation(&server, seconds);
    downloads(&server);
    starts(&server);
    lists(&server);
    listeners(&server);
}
