//! Disks, databases and quotas that fail under a running service: what is told, what is waited for, and
//! that nothing is lost.

use std::fs;
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::client::{Server, sha256};
use super::{job, small};

/// Waits for something of the service's.
fn until(what: &str, is_so: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < Duration::from_secs(120), "{what}: not within two minutes");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// A job that takes long.
fn long(server: &Server) -> Value {
    let mut recipe = small();
    recipe["bake"]["rays"] = json!(50_000);
    job(server, &recipe)
}

/// What the service itself advises of a damaged database is done step by step, slowly: it waits for the
/// copy, makes no database of its own in between, and has every job again.
#[test]
fn a_copy_of_the_database_is_taken() {
    let mut server = Server::start(&[]);
    let accepted = server.post("/v1/jobs", &long(&server), &[]);
    let place = accepted.header("location").expect("a place");
    server.wait(&place, |job| job["state"] == "running");
    server.terminate();
    let [path, copy, away] =
        ["data/poselight.db", "copy.db", "away.db"].map(|name| server.path(name));
    fs::copy(&path, &copy).expect("copied");
    let mut bytes = fs::read(&path).expect("read");
    bytes[4096..].fill(0xa5);
    fs::write(&path, bytes).expect("written");
    server.restart();
    let status = || server.get("/ready", &[]).status;
    assert_eq!(status(), 503);
    let log = || fs::read_to_string(server.path("log")).expect("a log");
    assert!(log().contains("put a copy of poselight.db"), "{}", log());
    fs::rename(&path, &away).expect("moved");
    until("the database is missed", || log().contains("there is no poselight.db in"));
    assert!(!path.exists(), "an empty database takes the place");
    assert_eq!(status(), 503);
    fs::copy(&copy, &path).expect("copied");
    until("it begins", || status() == 200);
    let state = server.get(&place, &[]).json()["state"].clone();
    assert!(state == "queued" || state == "running", "the job is lost: {state}");
    let name = place.rsplit('/').next().expect("an id");
    assert!(server.path(&format!("data/jobs/{name}/figure.glb")).is_file(), "its scene is lost");
}

/// Puts a file in the place of a folder, which then takes nothing more, until it is put back.
struct Broken<'a> {
    server: &'a Server,
    part: &'static str,
}

impl<'a> Broken<'a> {
    fn new(server: &'a Server, part: &'static str) -> Self {
        let place = server.path(&format!("data/{part}"));
        fs::rename(&place, server.path(part)).expect("moved");
        fs::write(place, b"no folder").expect("written");
        Self { server, part }
    }

    fn mend(self) {
        let place = self.server.path(&format!("data/{}", self.part));
        fs::remove_file(&place).expect("removed");
        fs::rename(self.server.path(self.part), place).expect("moved");
    }
}

/// A folder that takes no more writes under a running service: it says that it is not ready, what comes
/// is put off with a reason, and the job that runs waits and goes on as if nothing had been.
#[test]
fn a_disk_that_takes_no_writes_is_waited_for() {
    let server = Server::start(&[]);
    let ready = || server.get("/ready", &[]);
    assert_eq!(ready().status, 200);
    let broken = Broken::new(&server, "incoming");
    assert_eq!(ready().status, 503);
    assert!(ready().text().contains("takes no writes"), "{}", ready().text());
    let asset = format!("/v1/assets/{}", sha256(b"abc"));
    for answer in [server.put(&asset, b"abc", &[]), server.post("/v1/jobs", &long(&server), &[])] {
        assert_eq!(answer.status, 503, "{}", answer.text());
        assert_eq!(answer.json()["type"], "/problems/unavailable");
        assert!(answer.text().contains("takes no writes"), "{}", answer.text());
        assert!(answer.header("retry-after").is_some());
    }
    broken.mend();
    assert_eq!((ready().status, server.put(&asset, b"abc", &[]).status), (200, 201));

    let mut recipe = super::in_blocks();
    recipe["bake"]["rays"] = json!(60);
    let accepted = server.post("/v1/jobs", &job(&server, &recipe), &[]);
    let place = accepted.header("location").expect("a place");
    server.wait(&place, |job| job["progress"]["stage"] == "bake");
    let broken = Broken::new(&server, "work");
    let waits = server.wait(&place, |job| job["state"] != "running");
    assert_eq!(
        (&waits["state"], &waits["waits_for"]),
        (&json!("queued"), &json!("storage")),
        "{waits}"
    );
    let log = server.get(&format!("{place}/log"), &[]).text();
    assert!(log.contains("the disk takes no writes"), "{log}");
    assert_eq!(ready().status, 503);
    broken.mend();
    let done =
        server.wait(&place, |job| !["queued", "running"].map(Value::from).contains(&job["state"]));
    assert_eq!(
        (&done["state"], &done["attempts"]),
        (&json!("succeeded"), &json!(1)),
        "an attempt that the disk refused counts: {done}"
    );
}

/// A job that needs more memory than others leave says so; assets are deleted, but none that a job needs.
#[test]
fn a_job_says_what_it_waits_for() {
    let server = Server::start(&[]);
    let plan = server.post("/v1/jobs?dry_run=true", &long(&server), &[]).json();
    let mib = plan["memory_bytes"].as_u64().expect("bytes") * 3 / 2 / (1 << 20);
    let server = Server::start(&["--jobs", "2", "--memory-mib", &mib.to_string()]);
    let submit = |seed: u64| {
        let mut request = long(&server);
        request["recipe"]["bake"]["seed"] = json!(seed);
        let accepted = server.post("/v1/jobs", &request, &[]);
        assert_eq!(accepted.status, 202, "{}", accepted.text());
        accepted.header("location").expect("a place")
    };
    let first = submit(1);
    server.wait(&first, |job| job["state"] == "running");
    let second = submit(2);
    server.wait(&second, |job| job["waits_for"] == "memory");
    let log = server.get(&format!("{second}/log"), &[]).text();
    assert!(log.contains("waits for memory: it needs about"), "{log}");
    let asset = format!("/v1/assets/{}", server.figure());
    let refused = server.delete(&asset);
    assert_eq!(refused.status, 409, "{}", refused.text());
    for place in [&second, &first] {
        assert_eq!(server.post(&format!("{place}/cancel"), &json!({}), &[]).status, 202);
        server.wait(place, |job| job["state"] == "cancelled");
    }
    assert_eq!(server.delete(&asset).status, 204);
    assert_eq!((server.get(&asset, &[]).status, server.delete(&asset).status), (404, 404));
    assert_eq!(server.delete("/v1/assets/..%2Flock").status, 404);
}

/// A check knows the service of its own folder by its address, and does not take another's for it.
#[test]
fn a_check_knows_its_own_service() {
    let server = Server::start(&[]);
    let address = server.url().trim_start_matches("http://").to_owned();
    let check = |data: &str, address: &str| {
        let words = ["serve", "--check", "--data", data, "--listen", address];
        let output = Command::new(env!("CARGO_BIN_EXE_poselight"))
            .args(words)
            .current_dir(server.path(""))
            .output()
            .expect("started");
        (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert!(check("data", &address).0, "{:?}", check("data", &address));
    let (sound, told) = check("elsewhere", &address);
    assert!(!sound && told.contains("cannot listen on"), "{told}");
    let other = Server::start(&[]);
    let (sound, told) = check("data", other.url().trim_start_matches("http://"));
    assert!(!sound && told.contains("cannot listen on"), "{told}");
}
