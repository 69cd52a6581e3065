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
    let server =
        Server::start(&["--max-queued", "1", "--memory-mib", "4096", "--max-asset-mib", "1"]);
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
    // Before its scene is looked at, which takes far longer.
    let mut missing = job(&server, &recipe);
    missing["assets"]["figure.glb"] = json!("0".repeat(64));
    assert_eq!(server.post("/v1/jobs", &missing, &[]).status, 429);
    assert_eq!(server.post("/v1/jobs?dry_run=true", &missing, &[]).status, 422);
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
    let told = in_chunks(&server, "POST /v1/jobs", 16);
    assert!(told.starts_with("HTTP/1.1 413") && told.contains("\"body_bytes\""), "{told}");
    let told = in_chunks(&server, &format!("PUT /v1/assets/{}", sha256(b"")), 1);
    assert!(told.starts_with("HTTP/1.1 413") && told.contains("\"asset_bytes\""), "{told}");
}

/// Sends so many mebibytes and one byte in chunks, without their end; the answer.
fn in_chunks(server: &Server, request: &str, mebibytes: usize) -> String {
    let mut stream = server.connect();
    let head = format!(
        "{request} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\
         Transfer-Encoding: chunked\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).expect("sent");
    let chunk = [b"100000\r\n".as_slice(), &vec![b' '; 1 << 20], b"\r\n"].concat();
    (0..mebibytes).for_each(|_| stream.write_all(&chunk).expect("sent"));
    stream.write_all(b"1\r\n \r\n").expect("sent");
    rest(stream)
}

/// All assets together are bounded however they come: with a length, or in chunks without one.
#[test]
fn assets_have_no_more_room_than_they_have() {
    let server = Server::spawn_within(&["--max-assets-gib", "0"], "");
    let told = server.put(&format!("/v1/assets/{}", sha256(b"a")), b"a", &[]);
    assert_eq!(told.status, 507, "{}", told.text());
    assert_eq!(told.json()["limit"]["name"], "assets_bytes");
    let mut stream = server.connect();
    let head = format!("PUT /v1/assets/{} HTTP/1.1\r\nHost: localhost\r\n", sha256(b"a"));
    let rest_of_it = "Connection: close\r\nTransfer-Encoding: chunked\r\n\r\n1\r\na\r\n";
    stream.write_all((head + rest_of_it).as_bytes()).expect("sent");
    let told = rest(stream);
    assert!(told.starts_with("HTTP/1.1 507") && told.contains("assets_bytes"), "{told}");
}

/// A flat sheet of so many squares a side, whose import takes its time.
fn sheet(side: usize) -> Vec<u8> {
    let mut text = String::new();
    for row in 0..=side {
        for column in 0..=side {
            text += &format!("v {column} {} {row}\n", (row * column) % 7);
        }
    }
    for row in 0..side {
        for column in 0..side {
            let first = row * (side + 1) + column + 1;
            let next = first + side + 1;
            text +=
                &format!("f {first} {} {}\nf {} {next} {}\n", first + 1, next, first + 1, next + 1);
        }
    }
    text.into_bytes()
}

/// The time of a request is not that of its scene's import: who has a turn is told of the job that there
/// is, and who waits for one in vain has submitted nothing.
#[test]
fn a_refusal_is_no_job() {
    let server = Server::start(&["--request-timeout", "1"]);
    let limit = Duration::from_secs(1);
    // Sheets grow until a scene takes longer than a request may, however fast the machine is.
    let submit = |side: usize| {
        let bytes = sheet(side);
        let digest = sha256(&bytes);
        let path = format!("/v1/assets/{digest}?name=sheet.obj");
        assert_eq!(server.put(&path, &bytes, &[]).status, 201);
        let recipe = json!({ "version": 1, "bake": { "signal": "ao", "rays": 2 } });
        let slow = json!({ "kind": "bake", "assets": { "sheet.obj": digest }, "recipe": recipe });
        let start = Instant::now();
        let accepted = server.post("/v1/jobs", &slow, &[]);
        let took = start.elapsed();
        assert_eq!(accepted.status, 202, "after {took:?}: {}", accepted.text());
        let place = accepted.header("location").expect("a place");
        assert_eq!(server.post(&format!("{place}/cancel"), &json!({}), &[]).status, 202);
        (took > limit).then_some(slow)
    };
    let slow = [450, 900, 1800].into_iter().find_map(submit).expect("a scene that takes so long");
    let count = || server.get("/v1/jobs", &[]).json()["jobs"].as_array().map(Vec::len);
    let before = count();
    std::thread::scope(|scope| {
        let plan = || server.post("/v1/jobs?dry_run=true", &slow, &[]).status;
        let plans = [scope.spawn(plan), scope.spawn(plan)];
        std::thread::sleep(Duration::from_millis(200));
        let start = Instant::now();
        let late = server.post("/v1/jobs", &job(&server, &small()), &[]);
        // Where both plans were quick after all it was its turn in time.
        if late.status != 202 {
            assert_eq!(late.status, 503, "{}", late.text());
            assert!(start.elapsed() >= limit, "it does not wait for its turn");
            assert_eq!(late.json()["limit"]["name"], "request_s");
            assert!(late.header("retry-after").is_some());
            assert_eq!(count(), before, "a refused job is there");
        }
        assert_eq!(plans.map(|plan| plan.join().expect("a plan")), [200, 200]);
    });
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
    server.command(&["serve", "--check", "--data", "elsewhere/data", "--config", config]);
    assert!(!server.path("elsewhere").exists(), "a check makes folders");
    let listed = Command::new(env!("CARGO_BIN_EXE_poselight"))
        .args(["token", "list", "--data", "nowhere"])
        .current_dir(server.path(""))
        .output()
        .expect("started");
    let message = String::from_utf8_lossy(&listed.stderr).into_owned();
    assert!(!listed.status.success() && message.contains("no service in nowhere"), "{message}");
    assert!(!server.path("nowhere").exists(), "a look makes folders");
    let wrong = folder.path().join("wrong.json");
    fs::write(&wrong, r#"{"job": 2}"#).expect("written");
    let output = Command::new(env!("CARGO_BIN_EXE_poselight"))
        .args(["serve", "--check", "--config", wrong.to_str().expect("text")])
        .output()
        .expect("started");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("no setting `job`"), "{message}");
}
