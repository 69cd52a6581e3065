//! Proves the service's promises against the real binary: what it makes is what the command line
//! makes, a killed one goes on, and what is wrong is refused with its place.

#![cfg(feature = "serve")]

#[path = "serve/client.rs"]
mod client;
#[path = "serve/contract.rs"]
mod contract;
#[path = "serve/gloss.rs"]
mod gloss;
#[path = "serve/grpc.rs"]
mod grpc;
#[path = "serve/hostile.rs"]
mod hostile;
#[path = "serve/kinds.rs"]
mod kinds;
#[path = "serve/limits.rs"]
mod limits;
#[path = "serve/posed.rs"]
mod posed;
#[path = "serve/scenes.rs"]
mod scenes;
#[path = "serve/slow.rs"]
mod slow;
#[path = "serve/soak.rs"]
mod soak;
#[path = "serve/storage.rs"]
mod storage;
#[path = "serve/webhooks.rs"]
mod webhooks;

use std::fs;
use std::io::{Read, Write};
use std::path::Path;
use std::time::{Duration, SystemTime};

use client::{Server, sha256};
use serde_json::{Value, json};

/// A recipe that is quick.
fn small() -> Value {
    json!({
        "version": 1,
        "poses": { "rate_hz": 4, "near_repeat": 0, "hold_out": ["jump"] },
        "bake": { "signal": "ao", "rays": 2 },
        "target": { "reference_poses": 1 },
    })
}

/// The same with several blocks of poses.
fn in_blocks() -> Value {
    let mut recipe = small();
    recipe["poses"]["rate_hz"] = json!(8);
    recipe["bake"]["rays"] = json!(8);
    recipe
}

fn job(server: &Server, recipe: &Value) -> Value {
    json!({ "kind": "run", "assets": { "figure.glb": server.figure() }, "recipe": recipe })
}

/// The service's plan has the fields that the contract lists and that the command line prints.
fn same_plan(server: &Server, plan: &Value) {
    let keys = |value: &Value| -> Vec<String> {
        value.as_object().expect("an object").keys().cloned().collect()
    };
    let contract = server.get("/openapi.json", &[]).json();
    assert_eq!(keys(&contract["components"]["schemas"]["Plan"]["properties"]), keys(plan));
    let words =
        ["run", "figure.glb", "-o", "none", "--recipe", "recipe.json", "--dry-run", "--json"];
    let printed = server.command(&words);
    let printed: Value = serde_json::from_slice(&printed.stdout).expect("one JSON object");
    assert_eq!(keys(&printed), keys(plan));
    for same in ["poses", "points", "rays", "reference_rays", "hashes", "notices"] {
        assert_eq!(printed[same], plan[same], "{same}");
    }
    assert!(!server.path("none").exists(), "a dry run writes nothing");
}

/// Upload, job, events and download give, byte for byte, what the command line makes; the same job
/// again is done at once; the blob has a tag and ranges; the model evaluates by all three ways.
#[test]
fn a_job_makes_what_the_command_line_makes() {
    let server = Server::start(&[]);
    let recipe = small();
    fs::write(server.path("recipe.json"), recipe.to_string()).expect("written");
    server.command(&["run", "figure.glb", "-o", "out", "--recipe", "recipe.json"]);
    let expected = fs::read(server.path("out/model.safetensors")).expect("made");

    let again = server.put(&format!("/v1/assets/{}", server.figure()), b"", &[]);
    assert_eq!(again.status, 200, "an asset that is there costs nothing");
    let plan = server.post("/v1/jobs?dry_run=true", &job(&server, &recipe), &[]);
    assert_eq!(plan.status, 200, "{}", plan.text());
    assert!(plan.json()["rays"].as_u64().is_some_and(|rays| rays > 0), "{}", plan.text());
    same_plan(&server, &plan.json());

    let key = [("Idempotency-Key", "once")];
    let accepted = server.post("/v1/jobs", &job(&server, &recipe), &key);
    assert_eq!(accepted.status, 202, "{}", accepted.text());
    let location = accepted.header("location").expect("a place");
    let same = server.post("/v1/jobs", &job(&server, &recipe), &key);
    assert_eq!((same.status, same.json()["id"].clone()), (202, accepted.json()["id"].clone()));
    let other = server.post("/v1/jobs", &job(&server, &json!({ "version": 1 })), &key);
    assert_eq!(other.status, 422, "{}", other.text());

    let events = server.get(&format!("{location}/events"), &[]).text();
    assert!(
        events.contains(r#"{"state":"running"}"#) && events.contains("event: progress"),
        "{events}"
    );
    assert!(events.trim_end().ends_with(r#"{"state":"succeeded"}"#), "{events}");
    let last =
        events.lines().rfind(|line| line.starts_with("id: ")).expect("an id")[4..].to_owned();
    let rest = server.get(&format!("{location}/events"), &[("Last-Event-ID", &last)]);
    assert_eq!(rest.text().trim(), "", "nothing comes after the end");

    let late = server.post(&format!("{location}/cancel"), &json!({}), &[]);
    assert_eq!(late.status, 409, "a job that succeeded is not cancelled: {}", late.text());
    let done = server.get(&location, &[]).json();
    assert_eq!(done["state"], "succeeded");
    let model = done["result"]["href"].as_str().expect("a model").to_owned();
    let blob = server.get(&format!("{model}/blob"), &[]);
    assert!(blob.body == expected, "the service's model is not the command line's");
    let tag = blob.header("etag").expect("a tag");
    assert_eq!(tag, format!("\"{}\"", sha256(&expected)));
    assert_eq!(server.get(&format!("{model}/blob"), &[("If-None-Match", &tag)]).status, 304);
    let part = server.get(&format!("{model}/blob"), &[("Range", "bytes=8-15")]);
    assert_eq!((part.status, part.body.as_slice()), (206, &expected[8..16]));
    assert_eq!(server.get(&format!("{model}/figures"), &[]).status, 200);
    assert!(server.get(&format!("{model}/report"), &[]).text().contains("<html"));

    let again = server.post("/v1/jobs", &job(&server, &recipe), &[]).json();
    assert_eq!((&again["state"], &again["cached"]), (&json!("succeeded"), &json!(true)));
    evaluations(&server, &model);
    grpc::streams(&server, &model);
    let page = server.get("/v1/jobs?page_size=1", &[]).json();
    let token = page["next_page_token"].as_i64().expect("more");
    let next = server.get(&format!("/v1/jobs?page_size=5&page_token={token}"), &[]).json();
    assert_eq!(next["jobs"].as_array().map(Vec::len), Some(1), "{next}");
    assert!(server.get("/metrics", &[]).text().contains("poselight_jobs{state=\"succeeded\"} 2"));

    assert_eq!(server.delete(&location).status, 204);
    assert_eq!(server.get(&location, &[]).status, 404);
    assert_eq!(server.delete(&model).status, 204);
    assert_eq!(server.get(&format!("{model}/blob"), &[]).status, 404);
    let gone = server.post(&format!("{model}/evaluate"), &json!({ "poses": [{}] }), &[]);
    assert_eq!(gone.status, 404, "a deleted model is evaluated");
}

/// A clip's poses are what `poselight evaluate` gives; joints and parameters are taken; what is no
/// pose is refused at its field.
fn evaluations(server: &Server, model: &str) {
    server.command(&[
        "evaluate",
        "out/model.safetensors",
        "--scene",
        "figure.glb",
        "--clip",
        "jump",
        "--fps",
        "4",
        "-o",
        "jump.npy",
    ]);
    let expected = fs::read(server.path("jump.npy")).expect("made");
    let times: Vec<f32> = (0..2).map(|frame| frame as f32 / 4.0).collect();
    let clip = json!({ "clip": { "assets": { "figure.glb": server.figure() }, "name": "jump", "times_s": times } });
    let path = format!("{model}/evaluate");
    let raw = server.post(&path, &clip, &[("Accept", "application/octet-stream")]);
    assert_eq!(raw.status, 200, "{}", raw.text());
    let header = 10 + usize::from(u16::from_le_bytes([expected[8], expected[9]]));
    assert!(expected[header..].starts_with(&raw.body), "not what the command line gives");
    assert!(raw.header("poselight-shape").is_some_and(|shape| shape.starts_with("2,")));

    let about = server.get(model, &[]).json();
    let joint = about["model"]["joints"][1].as_str().expect("a joint").to_owned();
    let pose = |rotation: [f32; 4]| json!({ "poses": [{ "joints": { &joint: { "rotation": rotation } } }], "vertices": [0, 5] });
    let unit = server.post(&path, &pose([0.0, 0.0, 0.0, 1.0]), &[]);
    let long = server.post(&path, &pose([0.0, 0.0, 0.0, 3.0]), &[]);
    assert_eq!(unit.json()["values"], long.json()["values"], "quaternions are normalised");
    assert_eq!(unit.json()["shape"], json!([1, 2, 1, 1]));
    assert!(unit.json()["distances"][0]["mahalanobis"].is_number());
    let count = about["model"]["parameters"].as_array().map_or(0, Vec::len);
    let zeros = json!({ "parameters": [vec![0.0; count]] });
    assert_eq!(server.post(&path, &zeros, &[]).status, 200);

    let refused = |body: &Value, pointer: &str| {
        let answer = server.post(&path, body, &[]);
        assert_eq!(answer.status, 422, "{}", answer.text());
        assert_eq!(answer.json()["errors"][0]["pointer"], pointer, "{}", answer.text());
    };
    refused(&pose([0.0; 4]), &format!("#/poses/0/joints/{joint}/rotation"));
    refused(&json!({ "poses": [{ "joints": { "tail": {} } }] }), "#/poses/0/joints");
    refused(&json!({ "parameters": [[1.0]] }), "#/parameters/0");
    refused(&json!({ "poses": [{}], "vertices": [99_999_999] }), "#/vertices");
    // Numbers beyond f32, and beyond f64.
    for endless in ["1e39", "1e999"] {
        let body = format!(r#"{{"parameters":[[{endless}]]}}"#);
        let answer = server.send("POST", &path, body.as_bytes(), &[]);
        assert_eq!(answer.status, 400, "{}", answer.text());
        assert_eq!(answer.json()["type"], "/problems/invalid-json", "{}", answer.text());
    }
    refused(&json!({ "poses": [{}], "parameters": [] }), "#");
    // Finite, but what comes of it is not.
    refused(&json!({ "parameters": [vec![0.0; count], vec![-3e38; count]] }), "#/parameters/1");
}

/// The committed blocks of a data set, each with the time of its making.
fn blocks(folder: &Path) -> Vec<(String, SystemTime)> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let block = |entry: fs::DirEntry| {
        let name = entry.file_name().to_string_lossy().into_owned();
        let made = entry.metadata().and_then(|data| data.modified()).ok()?;
        name.starts_with("c.").then_some((name, made))
    };
    entries.filter_map(Result::ok).filter_map(block).collect()
}

/// `kill -9` in the middle of a bake, then a restart: the job is known, goes on from the blocks
/// that are there, and ends with the bytes of an undisturbed one.
#[test]
fn a_killed_service_goes_on() {
    let mut server = Server::start(&[]);
    let recipe = in_blocks();
    fs::write(server.path("recipe.json"), recipe.to_string()).expect("written");
    server.command(&["run", "figure.glb", "-o", "out", "--recipe", "recipe.json"]);
    let expected = fs::read(server.path("out/model.safetensors")).expect("made");

    let accepted = server.post("/v1/jobs", &job(&server, &recipe), &[]).json();
    let place = format!("/v1/jobs/{}", accepted["id"].as_str().expect("an id"));
    let bake = accepted["hashes"]["bake"].as_str().expect("a hash");
    let folder = server.path(&format!("data/work/{bake}/dataset.zarr/coefficients"));
    server.wait(&place, |_| !blocks(&folder).is_empty());
    server.kill();
    let before = blocks(&folder);
    // However often it was killed before: blocks have come of it.
    ended(&server, "UPDATE jobs SET ends = 1000, whole = 0");
    server.restart();
    let done = server.wait(&place, |job| job["state"] == "succeeded" || job["state"] == "failed");
    assert_eq!(done["state"], "succeeded", "{done}");
    assert_eq!(done["attempts"], 2, "{done}");
    let after = blocks(&folder);
    assert!(before.iter().all(|block| after.contains(block)), "a block was baked again");
    let model = done["result"]["href"].as_str().expect("a model");
    assert!(
        server.get(&format!("{model}/blob"), &[]).body == expected,
        "other bytes after the kill"
    );
    given_up(&mut server);
}

/// Changes what the service remembers of its ends, while it does not run.
fn ended(server: &Server, sql: &str) {
    let path = server.path("data/poselight.db");
    rusqlite::Connection::open(path).and_then(|store| store.execute(sql, [])).expect("changed");
}

/// A job during which the service has ended too often, with nothing of it in between, is given up, and
/// says why.
fn given_up(server: &mut Server) {
    let mut recipe = small();
    recipe["bake"]["rays"] = json!(50_000);
    let accepted = server.post("/v1/jobs", &job(server, &recipe), &[]);
    let place = accepted.header("location").expect("a place");
    server.wait(&place, |job| job["state"] == "running");
    server.kill();
    ended(server, "UPDATE jobs SET ends = 19, whole = 1000000 WHERE state = 'running'");
    server.restart();
    let failed = server.wait(&place, |job| job["state"] != "running" && job["state"] != "queued");
    let detail = failed["error"]["detail"].as_str().unwrap_or_default();
    assert!(detail.contains("came no further"), "{failed}");
}

/// A running job is cancelled, not deleted; a finished one is deleted, not cancelled; a stopped
/// service puts its job back and ends by itself.
#[test]
fn cancel_delete_and_stop() {
    let mut server = Server::start(&[]);
    let mut recipe = small();
    recipe["bake"]["rays"] = json!(20_000);
    let accepted = server.post("/v1/jobs", &job(&server, &recipe), &[]).json();
    let place = format!("/v1/jobs/{}", accepted["id"].as_str().expect("an id"));
    server.wait(&place, |job| job["state"] == "running");
    assert_eq!(server.delete(&place).status, 409);
    let events = format!("{place}/events");
    std::thread::scope(|scope| {
        // Of a client that says it has seen more than there is: it hears nothing, but its stream ends.
        let listens = scope.spawn(|| server.get(&events, &[("Last-Event-ID", "99999")]));
        assert_eq!(server.post(&format!("{place}/cancel"), &json!({}), &[]).status, 202);
        server.wait(&place, |job| job["state"] == "cancelled");
        assert_eq!(listens.join().expect("an end").status, 200);
    });
    assert_eq!(server.post(&format!("{place}/cancel"), &json!({}), &[]).status, 409);
    assert_eq!(server.delete(&place).status, 204);

    let accepted = server.post("/v1/jobs", &job(&server, &recipe), &[]).json();
    let place = format!("/v1/jobs/{}", accepted["id"].as_str().expect("an id"));
    server.wait(&place, |job| job["state"] == "running");
    server.second_process_is_refused();
    let status = server.terminate();
    assert!(status.success(), "SIGTERM ended it with {status}");
    server.restart();
    let job = server.get(&place, &[]).json();
    assert!(["queued", "running"].contains(&job["state"].as_str().unwrap_or_default()), "{job}");
}

/// Each bad request is refused with a status and, where there is a field, its pointer.
#[test]
fn bad_requests_are_refused() {
    let server = Server::start(&["--max-asset-mib", "1", "--head-timeout", "1"]);
    let name = |bytes: &[u8]| format!("/v1/assets/{}", sha256(bytes));
    let status = |path: &str, bytes: &[u8]| server.put(path, bytes, &[]).status;
    assert_eq!(status(&name(b"other"), b"bytes"), 422, "wrong hash");
    assert_eq!(status("/v1/assets/..%2F..%2Fetc", b"bytes"), 422, "no hash at all");
    assert_eq!(status(&name(b""), b""), 422, "no bytes");
    let large = vec![7; (1 << 20) + 1];
    assert_eq!(status(&name(&large), &large), 413, "over the limit");
    let broken =
        server.put(&format!("{}?name=a.glb", name(b"glTF nonsense")), b"glTF nonsense", &[]);
    assert_eq!(broken.status, 422);
    assert_eq!(broken.json()["type"], "/problems/bad-asset", "{}", broken.text());
    assert_eq!(server.get(&name(b"glTF nonsense"), &[]).status, 404, "a broken file was kept");
    assert_eq!(status(&name(b"buffer"), b"buffer"), 201, "any file without a name");

    let pointer = |body: &Value| {
        let answer = server.post("/v1/jobs", body, &[]);
        assert!((400..500).contains(&answer.status), "{}: {}", answer.status, answer.text());
        answer.json()["errors"][0]["pointer"].as_str().unwrap_or_default().to_owned()
    };
    let figure = server.figure();
    let with = |recipe: Value| json!({ "kind": "run", "assets": { "figure.glb": figure }, "recipe": recipe });
    assert_eq!(pointer(&with(json!({ "version": 2 }))), "#/recipe/version");
    assert_eq!(
        pointer(&with(json!({ "version": 1, "bake": { "rayz": 1 } }))),
        "#/recipe/bake/rayz"
    );
    assert_eq!(
        pointer(&with(json!({ "version": 1, "bake": { "rays": 0 } }))),
        "#/recipe/bake/rays"
    );
    assert_eq!(
        pointer(&with(json!({ "version": 1, "poses": { "clips": ["jump", "swim"] } }))),
        "#/recipe/poses/clips/1"
    );
    assert_eq!(
        pointer(&with(json!({ "version": 1, "poses": { "hold_out": ["swim"] } }))),
        "#/recipe/poses/hold_out/0"
    );
    let drawn = with(json!({ "version": 1, "poses": { "rate_hz": 4 } }));
    let plan = server.post("/v1/jobs?dry_run=true", &drawn, &[]).json();
    let notices = plan["notices"].to_string();
    assert!(notices.contains("`poses.hold_out` chooses") && !notices.contains("--"), "{notices}");
    let missing =
        json!({ "kind": "run", "assets": { "a.glb": "0".repeat(64) }, "recipe": { "version": 1 } });
    assert_eq!(pointer(&missing), "#/assets/a.glb");
    let wrong = json!({ "kind": "run", "assets": { "a.glb": sha256(b"buffer") }, "recipe": { "version": 1 } });
    pointer(&wrong);
    for body in [
        "[".repeat(10_000),
        r#"{"kind":"run","priority":1e999}"#.into(),
        "nonsense".into(),
        String::new(),
    ] {
        let answer = server.send("POST", "/v1/jobs", body.as_bytes(), &[]);
        assert_eq!(answer.status, 400, "{}", answer.text());
    }
    for query in ["state=lost", "page_size=0", "page_size=x", "pages=1"] {
        let answer = server.get(&format!("/v1/jobs?{query}"), &[]);
        assert!((400..500).contains(&answer.status), "{query}");
        assert!(answer.json()["type"].is_string(), "{query}: {}", answer.text());
    }
    for query in ["state=queued", "kind=run", "pages=1", "page_size=0"] {
        let answer = server.get(&format!("/v1/models?{query}"), &[]);
        assert!((400..500).contains(&answer.status), "{query}");
    }
    in_words(&server);
    no_places(&server);
    slow_and_truncated(&server);
}

/// What is nowhere, or not this service's, is told so; nothing of what was refused is kept.
fn no_places(server: &Server) {
    for path in [
        "/v1/models/../../etc/passwd",
        "/v1/models/..",
        "/v1/models/a.b/blob",
        "/v1/jobs/%00",
        "/nowhere",
    ] {
        assert_eq!(server.get(path, &[]).status, 404, "{path}");
    }
    assert_eq!(server.get("/health", &[("Host", "evil.example")]).status, 403);
    assert_eq!(server.get("/ready", &[]).status, 200);
    assert_eq!(server.get("/v1/jobs", &[]).json()["jobs"], json!([]), "a refused job was kept");
}

/// A value in the wrong form is told at its place and in words of JSON, not of our types.
fn in_words(server: &Server) {
    let path = format!("/v1/models/{}/evaluate", "0".repeat(64));
    for (body, pointer, fault) in [
        (json!({ "clip": "jump" }), "#/clip", "an object with the clip's `name`"),
        (json!({ "clip": { "name": "jump", "times_s": 1 } }), "#/clip/times_s", "a list is"),
        (json!({ "poses": [{ "joints": [] }] }), "#/poses/0/joints", "an object is expected"),
        (
            json!({ "poses": [{ "joints": { "hip": { "rotation": [0, 0, 1] } } }] }),
            "#/poses/0/joints/hip/rotation",
            "a quaternion of four numbers, x, y, z and w; here 3 are given",
        ),
        (
            json!({ "poses": [{ "joints": { "hip": { "rotation": ["x"] } } }] }),
            "#/poses/0/joints/hip/rotation/0",
            "a number is expected",
        ),
        (json!({ "light": 1 }), "#/light", "an object with `coefficients`, `asset` or `form`"),
        (json!({ "vertices": [-1] }), "#/vertices/0", "a whole number from 0"),
    ] {
        let answer = server.post(&path, &body, &[]);
        assert_eq!(answer.status, 422, "{}", answer.text());
        let error = answer.json()["errors"][0].clone();
        assert_eq!(error["pointer"], pointer, "{error}");
        let told = error["detail"].as_str().unwrap_or_default();
        assert!(told.contains(fault) && !told.contains("struct"), "{told}");
    }
}

/// A client that does not finish its head is let go; an upload that ends early leaves nothing.
fn slow_and_truncated(server: &Server) {
    let mut slow = server.connect();
    slow.write_all(b"GET /health HTTP/1.1\r\nHost: loc").expect("sent");
    slow.set_read_timeout(Some(Duration::from_secs(10))).expect("set");
    let mut answer = Vec::new();
    slow.read_to_end(&mut answer).expect("closed by the service");
    // Nor one that does not say which HTTP it speaks, or speaks the newer one in nonsense.
    for begun in [&b""[..], b"PRI * HTTP/2", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\nnonsense nonsense"] {
        let mut slow = server.connect();
        slow.write_all(begun).expect("sent");
        slow.set_read_timeout(Some(Duration::from_secs(10))).expect("set");
        // The service may have said what it speaks before it closed.
        let closed = slow.read_to_end(&mut answer);
        let reset = |error: &std::io::Error| error.kind() == std::io::ErrorKind::ConnectionReset;
        assert!(closed.as_ref().err().is_none_or(reset), "{begun:?}: {closed:?}");
    }
    let mut cut = server.connect();
    let head = format!(
        "PUT /v1/assets/{} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nabc",
        sha256(b"abc")
    );
    cut.write_all(head.as_bytes()).expect("sent");
    drop(cut);
    assert_eq!(server.get(&format!("/v1/assets/{}", sha256(b"abc")), &[]).status, 404);
}

/// With a token in its store the service asks for one, and for the right scope.
#[test]
fn tokens_are_asked_for() {
    let mut server = Server::start(&[]);
    let token = |name: &str, scope: &str| {
        let words = ["token", "--data", "data", "create", name, "--scope", scope];
        String::from_utf8(server.command(&words).stdout).expect("text").trim().to_owned()
    };
    let (reader, writer) = (token("viewer", "read"), token("maya", "write"));
    server.terminate();
    server.restart();
    let bearer = |token: &str| format!("Bearer {token}");
    assert_eq!(server.get("/v1/jobs", &[]).status, 401);
    assert_eq!(server.get("/health", &[]).status, 200);
    assert_eq!(server.get("/v1/jobs", &[("Authorization", "Bearer psl_0")]).status, 401);
    assert_eq!(server.get("/v1/jobs", &[("Authorization", &bearer(&reader))]).status, 200);
    assert_eq!(server.get("/v1/jobs", &[("Authorization", &bearer(&writer))]).status, 403);
    grpc::asks_for_tokens(&server, &reader);
    let refused = server.put(
        &format!("/v1/assets/{}", sha256(b"a")),
        b"a",
        &[("Authorization", &bearer(&reader))],
    );
    assert_eq!(refused.status, 403);
    let log = fs::read_to_string(server.path("log")).expect("a log");
    assert!(!log.contains(&reader) && !log.contains(&writer), "a token is in the log");
    server.command(&["token", "--data", "data", "revoke", "viewer"]);
    assert_eq!(server.get("/v1/jobs", &[("Authorization", &bearer(&reader))]).status, 401);
}

/// Says what a test lacks; in continuous integration, which brings it, that is a failure. Not by
/// `eprintln!`, which the test harness keeps to itself while tests pass.
fn skip(lack: &str) {
    assert!(std::env::var_os("CI").is_none(), "there is no {lack}; make test brings it");
    let _ = writeln!(std::io::stderr(), "skipped: there is no {lack}");
}

/// A Python that runs the client from a folder as a user does.
struct Python<'a> {
    python: &'a str,
    server: &'a Server,
    folder: String,
}

impl Python<'_> {
    /// Runs some words of Python's own.
    fn run(&self, words: &[&str]) -> std::process::Output {
        std::process::Command::new(self.python)
            .args(words)
            .env("PYTHONPATH", &self.folder)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .env("POSELIGHT_SERVER", self.server.url())
            .current_dir(self.server.path(""))
            .output()
            .expect("started")
    }

    /// The same, which must succeed; what was said.
    fn sound(&self, words: &[&str]) -> String {
        let output = self.run(words);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{words:?}: {said}");
        String::from_utf8_lossy(&output.stdout).into_owned()
    }
}

const CLIENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/clients/python");

/// The Python client uploads, follows, downloads and evaluates, with numpy and without; what it gets
/// is what the command line makes from the same flags, also of a service that puts it off, and a
/// problem comes as an error that names the field.
#[test]
fn the_python_client_works() {
    let python = std::env::var("POSELIGHT_PYTHON").unwrap_or_else(|_| "python3".into());
    if !std::process::Command::new(&python).arg("-V").output().is_ok_and(|o| o.status.success()) {
        return skip(&python);
    }
    let server = Server::start(&["--rate", "3"]);
    let words = ["run", "figure.glb", "-o", "out", "--recipe", "recipe.json"];
    let base = json!({ "version": 1, "poses": { "near_repeat": 0 }, "bake": { "signal": "ao" } });
    fs::write(server.path("recipe.json"), base.to_string()).expect("written");
    let flags = ["--rays", "2", "--fps", "4", "--hold-out", "jump", "--reference-poses", "1"];
    server.command(&[&words[..], &flags].concat());
    let user = Python { python: &python, server: &server, folder: CLIENT.to_owned() };
    let words = ["-m", "poselight_client", "bake", "figure.glb", "--recipe", "recipe.json"];
    let words = [&words[..], &flags].concat();
    let plan = user.sound(&[&words[..], &["--dry-run"]].concat());
    assert!(plan.contains("rays") && plan.contains("memory: "), "{plan}");
    user.sound(
        &[&words[..], &["-o", "made.safetensors", "--clip", "jump", "--values", "jump.f32"]]
            .concat(),
    );
    let read = |name: &str| fs::read(server.path(name)).expect("read");
    assert!(read("made.safetensors") == read("out/model.safetensors"), "another model");
    assert!(read("jump.f32").len() > 4, "no values");
    let bare = "import sys, runpy
sys.modules['numpy'] = None
runpy.run_module('poselight_client', run_name='__main__')";
    let rest = [&words[2..], &["-o", "bare.safetensors", "--clip", "jump", "--values", "bare.f32"]];
    user.sound(&[&["-c", bare][..], &rest.concat()].concat());
    assert!(read("bare.f32") == read("jump.f32"), "other values without numpy");
    scenes_of_several_files(&user);
    installed(&user, &words);
    fs::write(server.path("bad.json"), r#"{"version":1,"bake":{"order":11}}"#).expect("written");
    let bad = ["-m", "poselight_client", "bake", "figure.glb", "-o", "no", "--recipe", "bad.json"];
    let output = user.run(&bad);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("#/recipe/bake/order"), "{message}");
    user.sound(&["-m", "unittest", "-q", "test_poselight_client"]);
}

/// The package that pyproject describes is installed, where pip has what that takes without a network,
/// and works from there.
fn installed(user: &Python, words: &[&str]) {
    let server = user.server;
    fs::create_dir(server.path("package")).expect("made");
    for name in ["pyproject.toml", "poselight_client.py"] {
        let from = Path::new(CLIENT).join(name);
        fs::copy(from, server.path("package").join(name)).expect("copied");
    }
    let pip = ["-m", "pip", "-q", "install", "--no-index", "--no-build-isolation", "--no-deps"];
    let pip = [&pip[..], &["--target", "site", "./package"]].concat();
    let folder = server.path("package").display().to_string();
    let others = [user.python, "python3", "/usr/bin/python3"].map(|python| Python {
        python,
        server,
        folder: folder.clone(),
    });
    if !others.iter().any(|other| other.run(&pip).status.success()) {
        let _ = writeln!(std::io::stderr(), "skipped: no pip here installs without a network");
        return;
    }
    let folder = server.path("site").display().to_string();
    let from = Python { python: user.python, server, folder };
    let plan = from.sound(&[words, &["--dry-run"]].concat());
    assert!(plan.contains("rays"), "{plan}");
    assert!(server.path("site/bin/poselight-client").is_file(), "there is no command");
}

/// A glTF with its buffer, and a zip of both, are uploaded as the same assets.
fn scenes_of_several_files(user: &Python) {
    let server = user.server;
    let glb = fs::read(server.path("figure.glb")).expect("made");
    let (document, buffer) = scenes::apart(&glb);
    let files = [("hero.gltf", &document[..]), ("data/hero one.bin", &buffer[..])];
    fs::create_dir(server.path("apart")).expect("made");
    fs::create_dir(server.path("apart/data")).expect("made");
    for (name, bytes) in files {
        fs::write(server.path("apart").join(name), bytes).expect("written");
    }
    fs::write(server.path("hero.zip"), scenes::zipped(&files)).expect("written");
    let script = "import sys, json; from poselight_client import Client
print(json.dumps([Client(sys.argv[1]).scene(path) for path in sys.argv[2:]]))";
    let said = user.sound(&["-c", script, &server.url(), "apart/hero.gltf", "hero.zip"]);
    let scenes: Value = serde_json::from_str(&said).expect("JSON");
    let names = json!({ "hero.gltf": sha256(&document), "data/hero one.bin": sha256(&buffer) });
    assert_eq!(scenes, json!([[names, "hero.gltf"], [names, "hero.gltf"]]));
}

/// README's blocks of `console` work as typed, against a service elsewhere and with a smaller job.
#[test]
fn the_readme_works_as_typed() {
    let known = |tool: &str| std::process::Command::new(tool).arg("--version").output().is_ok();
    if let Some(tool) = ["bash", "curl", "jq", "python3"].iter().find(|tool| !known(tool)) {
        return skip(tool);
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = fs::read_to_string(root.join("README.md")).expect("README.md");
    let mut script = String::from("set -euo pipefail\n");
    for block in readme.split("```console\n").skip(1) {
        for line in block.split("```").next().unwrap_or_default().lines() {
            script += line.strip_prefix("$ ").unwrap_or(line);
            script.push('\n');
        }
    }
    assert!(script.lines().count() > 5, "README shows nothing: {script}");
    let server = Server::start(&[]);
    let smaller = [
        (r#"{"rays": 64}"#, r#"{"rays": 4, "signal": "ao"}"#),
        (r#"{"rate_hz": 10}"#, r#"{"rate_hz": 4}"#),
        (r#"{"reference_poses": 10}"#, r#"{"reference_poses": 1}"#),
        ("--rays 64", "--recipe recipe.json"),
    ];
    let mut script = script
        .replace("localhost:7878", server.url().trim_start_matches("http://"))
        .replace("clients/python", &root.join("clients/python").display().to_string());
    for (typed, small) in smaller {
        assert!(script.contains(typed), "README has no {typed}: {script}");
        script = script.replace(typed, small);
    }
    let [bake, poses, target] = [smaller[0].1, smaller[1].1, smaller[2].1];
    let recipe =
        format!(r#"{{"version": 1, "bake": {bake}, "poses": {poses}, "target": {target}}}"#);
    fs::write(server.path("recipe.json"), recipe).expect("written");
    fs::copy(server.path("figure.glb"), server.path("hero.glb")).expect("copied");
    let output = std::process::Command::new("bash")
        .args(["-c", &script])
        .env("POSELIGHT_SERVER", server.url())
        .current_dir(server.path(""))
        .output()
        .expect("started");
    let said =
        [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(output.status.success(), "{script}\n{said:?}");
    assert!(said[0].contains("\"mahalanobis\""), "{said:?}");
    assert!(server.path("hero.safetensors").is_file());
}
