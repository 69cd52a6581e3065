//! What is bounded, and what an operator may say: limits with their names, clients that hold on for too
//! long, signals, rates, origins and settings.

use std::fs;
use std::io::{Read, Write};
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::json;

use super::client::{Server, sha256};
use super::hostile::{begin, open_connections, rest};
use super::{job, small};

/// A client that asks for a large file and takes nothing of it is let go, as one that vanishes.
#[test]
fn clients_that_do_not_read_are_let_go() {
    let server = Server::start(&["--idle-timeout", "1"]);
    let large: Vec<u8> = (0..32_u32 << 20).map(|i| (i >> 8) as u8).collect();
    let path = format!("/v1/assets/{}", sha256(&large));
    assert_eq!(server.put(&path, &large, &[]).status, 201);
    let slow: Vec<_> =
        (0..5).map(|_| begin(&server, &format!("GET {path} HTTP/1.1"), 0, b"")).collect();
    let start = Instant::now();
    while open_connections(&server) < 6 {
        assert!(start.elapsed() < Duration::from_secs(10), "they are not even met");
    }
    while open_connections(&server) > 1 {
        assert!(start.elapsed() < Duration::from_secs(60), "they may stay for ever");
        std::thread::sleep(Duration::from_millis(200));
    }
    drop(slow);
    assert_eq!(server.get(&path, &[]).body, large, "one that reads gets it");
}

/// A request on a connection that was open when the service was told to end is still answered.
#[test]
fn what_was_on_its_way_is_answered() {
    let server = Server::start(&[]);
    let mut stream = server.connect();
    assert_eq!(server.get("/health", &[]).status, 200, "the connection before is accepted");
    server.signal("TERM");
    std::thread::sleep(Duration::from_millis(300));
    stream.write_all(b"GET /health HTTP/1.1\r\nHost: localhost\r\n\r\n").expect("sent");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("answered, and the connection is closed");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
}

/// The first SIGTERM waits for what is under way, the second for nothing.
#[test]
fn a_second_signal_ends_it_at_once() {
    let mut server = Server::start(&[]);
    let head = format!("PUT /v1/assets/{} HTTP/1.1", sha256(b"abc"));
    let upload = begin(&server, &head, 3, b"a");
    while open_connections(&server) < 2 {}
    server.signal("TERM");
    let start = Instant::now();
    while !fs::read_to_string(server.path("log")).expect("a log").contains("stopping") {
        assert!(start.elapsed() < Duration::from_secs(10), "it does not hear");
    }
    let status = server.terminate();
    assert_eq!(status.code(), Some(130), "it waits for the upload");
    drop(upload);
    server.restart();
    assert_eq!(server.get("/ready", &[]).status, 200);
}

/// A queue that is full, a body and a head beyond their limits are refused, each by its own status and
/// limit; every answer has the headers that keep browsers from making more of it.
#[test]
fn limits_are_named() {
    let server = Server::start(&["--max-queued", "1", "--memory-mib", "4096"]);
    let mut recipe = small();
    recipe["bake"]["rays"] = json!(50_000);
    let submit = |seed: u64| {
        let mut recipe = recipe.clone();
        recipe["bake"]["seed"] = json!(seed);
        server.post("/v1/jobs", &job(&server, &recipe), &[])
    };
    let first = submit(1).header("location").expect("a place");
    server.wait(&first, |job| job["state"] == "running");
    let second = submit(2).header("location").expect("a place");
    let full = submit(3);
    assert_eq!(full.status, 429, "{}", full.text());
    assert_eq!(full.json()["type"], "/problems/queue-full");
    assert_eq!(full.json()["limit"], json!({ "name": "queued_jobs", "most": 1 }));
    assert!(full.header("retry-after").is_some());
    for place in [second, first] {
        assert_eq!(server.post(&format!("{place}/cancel"), &json!({}), &[]).status, 202);
    }
    let large = vec![b' '; (16 << 20) + 1];
    let refused = server.send("POST", "/v1/jobs", &large, &[]);
    assert_eq!(refused.status, 413, "{}", refused.text());
    assert_eq!(refused.json()["limit"]["name"], "body_bytes");
    let long = "x".repeat(100_000);
    assert_eq!(server.get("/health", &[("X-Long", &long)]).status, 431);
    for path in ["/health", "/nowhere", "/docs", "/v1/jobs"] {
        let answer = server.get(path, &[]);
        assert_eq!(answer.header("x-content-type-options").as_deref(), Some("nosniff"), "{path}");
        assert_eq!(answer.header("x-frame-options").as_deref(), Some("DENY"), "{path}");
        let policy = answer.header("content-security-policy").expect("a policy");
        assert!(policy.starts_with("default-src 'none'"), "{path}: {policy}");
    }
    // A body whose length nobody tells is counted as it comes.
    let mut stream = server.connect();
    let head = "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\
                Transfer-Encoding: chunked\r\n\r\n";
    stream.write_all(head.as_bytes()).expect("sent");
    let chunk = [b"100000\r\n".as_slice(), &vec![b' '; 1 << 20], b"\r\n"].concat();
    while stream.write_all(&chunk).is_ok() {}
    assert!(rest(stream).is_empty() || server.get("/health", &[]).status == 200);
}

/// Too many requests of one client are put off with a time; a page is let in where its origin is
/// named; the interface can be read as a page; settings come from a file and are checked.
#[test]
fn operators_have_their_say() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let config = folder.path().join("settings.json");
    let settings = json!({ "rate": 5, "allow-origin": "https://tools.example", "jobs": 2 });
    fs::write(&config, settings.to_string()).expect("written");
    let config = config.to_str().expect("text");
    let server = Server::start(&["--config", config]);
    let answers: Vec<_> = (0..30).map(|_| server.get("/v1/jobs", &[])).collect();
    let limited = answers.iter().find(|answer| answer.status == 429).expect("too many pass");
    assert_eq!(limited.json()["type"], "/problems/rate-limited");
    assert!(limited.header("retry-after").is_some());
    let page = [("Origin", "https://tools.example"), ("Access-Control-Request-Method", "PUT")];
    let answer = server.send("OPTIONS", "/v1/jobs", b"", &page);
    assert_eq!(answer.header("access-control-allow-origin").as_deref(), Some(page[0].1));
    let evil = [("Origin", "https://evil.example"), page[1]];
    let answer = server.send("OPTIONS", "/v1/jobs", b"", &evil);
    assert_eq!(answer.header("access-control-allow-origin"), None);
    let mut docs = server.get("/docs", &[]);
    while docs.status == 429 {
        std::thread::sleep(Duration::from_millis(300));
        docs = server.get("/docs", &[]);
    }
    assert!(docs.text().contains("<h2>Paths</h2>"), "{}", docs.text());
    server.command(&["serve", "--check", "--data", "elsewhere", "--config", config]);
    let wrong = folder.path().join("wrong.json");
    fs::write(&wrong, r#"{"job": 2}"#).expect("written");
    let output = Command::new(env!("CARGO_BIN_EXE_poselight"))
        .args(["serve", "--check", "--config", wrong.to_str().expect("text")])
        .output()
        .expect("started");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("no setting `job`"), "{message}");
}
