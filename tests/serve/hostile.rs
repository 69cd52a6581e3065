//! What hostile or unlucky clients do, and disks that fail: the service answers with a reason or
//! lets them go, and lives.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::client::{Server, sha256};
use super::{job, small};

/// The head of a request whose body has this length, and what of the body is given.
pub(crate) fn begin(
    server: &Server,
    head: &str,
    length: usize,
    body: &[u8],
) -> std::net::TcpStream {
    let mut stream = server.connect();
    stream.set_read_timeout(Some(Duration::from_secs(30))).expect("set");
    let head = format!(
        "{head}\r\nHost: localhost\r\nConnection: close\r\nContent-Length: {length}\r\n\r\n"
    );
    stream.write_all(&[head.as_bytes(), body].concat()).expect("sent");
    stream
}

pub(crate) fn rest(mut stream: std::net::TcpStream) -> String {
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

fn files_in(server: &Server, folder: &str) -> usize {
    fs::read_dir(server.path(folder)).map_or(0, Iterator::count)
}

/// A key whose first request is still on its way is in use; when that request breaks off the key is
/// free; many requests of one key at once make one job.
#[test]
fn one_key_is_one_job() {
    let server = Server::start(&[]);
    let body = job(&server, &small()).to_string();
    let head = "POST /v1/jobs HTTP/1.1\r\nIdempotency-Key: k";
    let first = begin(&server, head, body.len(), &body.as_bytes()[..10]);
    let send = || server.send("POST", "/v1/jobs", body.as_bytes(), &[("Idempotency-Key", "k")]);
    let start = Instant::now();
    while send().status != 409 {
        assert!(start.elapsed() < Duration::from_secs(10), "the key is not held");
    }
    assert_eq!(send().json()["type"], "/problems/key-in-use");
    assert!(send().header("retry-after").is_some());
    drop(first);
    let answers: Vec<(u16, Value)> = std::thread::scope(|scope| {
        let senders: Vec<_> = (0..8)
            .map(|_| {
                scope.spawn(|| {
                    let answer = send();
                    (answer.status, answer.json())
                })
            })
            .collect();
        senders.into_iter().map(|sender| sender.join().expect("sent")).collect()
    });
    assert!(answers.iter().all(|(status, _)| [202, 409].contains(status)), "{answers:?}");
    let mut last = send();
    while last.status == 409 {
        assert!(start.elapsed() < Duration::from_secs(60), "the key is never free");
        std::thread::sleep(Duration::from_millis(100));
        last = send();
    }
    let id = last.json()["id"].clone();
    assert!(answers.iter().filter(|answer| answer.0 == 202).all(|answer| answer.1["id"] == id));
    assert_eq!(server.get("/v1/jobs", &[]).json()["jobs"].as_array().map(Vec::len), Some(1));
}

/// Bodies that come slowly or not at all are given up within their limits, and leave nothing.
#[test]
fn slow_bodies_are_given_up() {
    let server = Server::start(&["--request-timeout", "1", "--idle-timeout", "1"]);
    let asset = format!("PUT /v1/assets/{} HTTP/1.1", sha256(b"abc"));
    let upload = begin(&server, &asset, 3, b"a");
    let submit = begin(&server, "POST /v1/jobs HTTP/1.1", 100, b"{");
    assert!(rest(upload).starts_with("HTTP/1.1 408"), "an upload may pause for ever");
    assert!(rest(submit).starts_with("HTTP/1.1 503"), "a submission may take for ever");
    for cut in 0..3 {
        drop(begin(&server, &asset, 3, &b"abc"[..cut]));
    }
    let start = Instant::now();
    while files_in(&server, "data/incoming") > 0 {
        assert!(start.elapsed() < Duration::from_secs(10), "half an upload stays");
        std::thread::sleep(Duration::from_millis(50));
    }
    let path = format!("/v1/assets/{}", sha256(b"abc"));
    assert_eq!(server.put(&path, b"abc", &[]).status, 201, "a broken upload blocks a whole one");
    assert_eq!(server.get(&path, &[]).body, b"abc");
}

/// A thousand clients that vanish while they listen leave no connection and no trouble behind.
#[test]
fn clients_that_vanish_are_let_go() {
    let server = Server::start(&[]);
    let mut recipe = small();
    recipe["bake"]["rays"] = json!(50_000);
    let accepted = server.post("/v1/jobs", &job(&server, &recipe), &[]).json();
    let place = format!("/v1/jobs/{}", accepted["id"].as_str().expect("an id"));
    for _ in 0..10 {
        let head = format!("GET {place}/events HTTP/1.1");
        let mut clients: Vec<_> = (0..100).map(|_| begin(&server, &head, 0, b"")).collect();
        let mut byte = [0];
        assert!(clients.iter_mut().all(|client| client.read_exact(&mut byte).is_ok()));
    }
    let open = || open_connections(&server);
    let start = Instant::now();
    while open() > 1 {
        assert!(start.elapsed() < Duration::from_secs(60), "{} connections stay", open());
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(server.post(&format!("{place}/cancel"), &json!({}), &[]).status, 202);
    server.wait(&place, |job| job["state"] == "cancelled");
}

/// Connections that are open, this one too.
pub(crate) fn open_connections(server: &Server) -> u64 {
    let text = server.get("/metrics", &[]).text();
    let line = text.lines().find_map(|line| line.strip_prefix("poselight_connections "));
    line.and_then(|count| count.parse().ok()).expect("a count")
}

/// Numbers and nesting beyond reason are refused in every body that is read, with a status of the
/// client's fault.
#[test]
fn absurd_documents_are_refused() {
    let server = Server::start(&[]);
    let deep = ["[".repeat(10_000), "]".repeat(10_000)].concat();
    let model = format!("/v1/models/{}/evaluate", "0".repeat(64));
    for body in [
        format!(r#"{{"kind":"run","assets":{{}},"recipe":{deep}}}"#),
        format!(r#"{{"recipe":{{"version":{deep}}}}}"#),
        format!(r#"{{"kind":"run","assets":{deep},"recipe":{{"version":1}}}}"#),
        r#"{"kind":"run","assets":{},"recipe":{"version":1e999}}"#.to_owned(),
        r#"{"kind":"run","assets":{},"recipe":{"version":1,"bake":{"noise":NaN}}}"#.to_owned(),
        r#"{"kind":"run","kind":"fit","assets":{},"recipe":{"version":1}}"#.to_owned(),
        "\u{feff}{}".to_owned(),
    ] {
        for path in ["/v1/jobs", "/v1/jobs?dry_run=true", model.as_str()] {
            let answer = server.send("POST", path, body.as_bytes(), &[]);
            assert!((400..500).contains(&answer.status), "{path}: {}", answer.text());
            assert!(answer.json()["type"].is_string(), "{}", answer.text());
        }
    }
    assert_eq!(server.send("POST", "/v1/jobs", &[0xff, 0xfe, 0x00], &[]).status, 400);
    assert_eq!(server.get("/health", &[]).status, 200);
}

/// The most memory that the service has had at once, bytes.
fn peak(server: &Server) -> u64 {
    let status = fs::read_to_string(format!("/proc/{}/status", server.id())).expect("a process");
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("a peak");
    line.trim().trim_end_matches(" kB").parse::<u64>().expect("a number") << 10
}

/// A body of millions of poses is refused with its limit, and takes little more memory than its text;
/// so does one of too many colours.
#[test]
fn long_lists_are_not_read_to_their_end() {
    let server = Server::start(&[]);
    let path = format!("/v1/models/{}/evaluate", "0".repeat(64));
    let before = peak(&server);
    let many = vec!["{}"; 5_500_000].join(",");
    for list in ["poses", "parameters", "positions"] {
        let many = if list == "poses" { many.clone() } else { many.replace("{}", "[]") };
        let body = format!(r#"{{"{list}":[{many}]}}"#);
        let answer = server.send("POST", &path, body.as_bytes(), &[]);
        assert_eq!(answer.status, 422, "{}", answer.text());
        let told = answer.json();
        assert_eq!(told["limit"], json!({ "name": "poses", "most": 4096 }), "{told}");
        assert_eq!(told["errors"][0]["pointer"], format!("#/{list}"), "{told}");
    }
    let colours = many.replace("{}", "[]");
    let body = format!(r#"{{"poses":[{{}}],"light":{{"coefficients":[{colours}]}}}}"#);
    let answer = server.send("POST", &path, body.as_bytes(), &[]);
    assert_eq!(answer.json()["errors"][0]["pointer"], "#/light/coefficients", "{}", answer.text());
    // The text itself, with room to grow.
    let more = peak(&server).saturating_sub(before);
    assert!(more < 120 << 20, "{} MiB for a body of 16", more >> 20);
    let times = json!({ "clip": { "name": "a", "times_s": vec![0; 4097] } });
    let answer = server.post(&path, &times, &[]);
    assert_eq!(answer.json()["limit"]["name"], "poses", "{}", answer.text());
}

/// With a database that is no database the service lives, is not ready, and begins when the
/// database is mended.
#[test]
fn a_broken_database_is_waited_out() {
    let mut server = Server::start(&[]);
    server.terminate();
    let (path, aside) = (server.path("data/poselight.db"), server.path("aside.db"));
    fs::rename(&path, &aside).expect("moved");
    fs::write(&path, vec![7; 100_000]).expect("written");
    server.restart();
    assert_eq!(server.get("/health", &[]).status, 200);
    assert_eq!(server.get("/ready", &[]).status, 503);
    let answer = server.get("/v1/jobs", &[]);
    assert_eq!((answer.status, &answer.json()["type"]), (503, &json!("/problems/unavailable")));
    fs::rename(&aside, &path).expect("moved");
    let start = Instant::now();
    while server.get("/ready", &[]).status != 200 {
        assert!(start.elapsed() < Duration::from_secs(60), "it does not begin");
        std::thread::sleep(Duration::from_millis(100));
    }
    let asset = format!("/v1/assets/{}", server.figure());
    assert_eq!(server.get(&asset, &[]).status, 200, "what was there is there");
    assert!(server.terminate().success());
}

/// Whether this machine lets a test mount a file system of its own.
pub(crate) fn may_mount() -> bool {
    let may =
        Command::new("unshare").args(["-rm", "mount", "-t", "tmpfs", "none", "/mnt"]).output();
    let may = may.is_ok_and(|output| output.status.success());
    if !may {
        let _ = writeln!(std::io::stderr(), "skipped: `unshare -rm mount` is not allowed here");
    }
    may
}

/// On a disk that fills up an upload is refused with 507 and leaves nothing; what was there is
/// served, small things still fit, and the service lives.
#[test]
fn a_full_disk_is_told() {
    if !may_mount() {
        return;
    }
    let server = Server::start_within(&[], "mount -t tmpfs -o size=8m none data");
    let large: Vec<u8> = (0..16_u32 << 20).map(|i| (i >> 8) as u8).collect();
    let path = format!("/v1/assets/{}", sha256(&large));
    let answer = server.put(&path, &large, &[]);
    assert_eq!(answer.status, 507, "{}", answer.text());
    assert_eq!(answer.json()["type"], "/problems/storage-full");
    let asset = format!("/v1/assets/{}", server.figure());
    assert_eq!(server.get(&asset, &[]).status, 200);
    assert_eq!(server.get("/health", &[]).status, 200);
    let refused = server.post("/v1/jobs", &job(&server, &small()), &[]);
    assert_eq!(refused.status, 507, "a job without room is taken: {}", refused.text());
    assert_eq!(refused.json()["limit"]["name"], "disk_bytes", "{}", refused.text());
    // What was begun needs the rest of its room all the same.
    let plan = server.post("/v1/jobs?dry_run=true", &job(&server, &small()), &[]).json();
    let bake = plan["hashes"]["bake"].as_str().expect("a hash");
    fs::create_dir(server.data().join("work").join(bake)).expect("made");
    let refused = server.post("/v1/jobs", &job(&server, &small()), &[]);
    assert_eq!(refused.status, 507, "a job without room is taken: {}", refused.text());
    let small = vec![1; 10_000];
    let path = format!("/v1/assets/{}", sha256(&small));
    assert_eq!(server.put(&path, &small, &[]).status, 201, "half an upload takes the room");
}

/// A disk that fills while a job writes: the job fails with that reason as soon as there is room to
/// say so, and the next one is done.
#[test]
fn a_disk_that_fills_is_told() {
    if !may_mount() {
        return;
    }
    let server = Server::start_within(&[], "mount -t tmpfs -o size=160m none data");
    let mut recipe = super::in_blocks();
    recipe["bake"]["rays"] = json!(60);
    let accepted = server.post("/v1/jobs", &job(&server, &recipe), &[]);
    assert_eq!(accepted.status, 202, "{}", accepted.text());
    let place = accepted.header("location").expect("a place");
    server.wait(&place, |job| job["progress"]["stage"] == "bake");
    assert_eq!(server.get("/ready", &[]).status, 200);
    let path = server.data().join("ballast");
    let mut ballast = fs::File::create(&path).expect("made");
    let block = vec![1; 1 << 20];
    while ballast.write_all(&block).is_ok() {}
    drop(ballast);
    let log = || fs::read_to_string(server.path("log")).expect("a log");
    let start = Instant::now();
    while !log().contains("cannot write down how it ended") {
        assert!(start.elapsed() < Duration::from_secs(200), "it bakes on: {}", log());
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(server.get("/health", &[]).status, 200);
    let ready = server.get("/ready", &[]);
    assert_eq!(ready.status, 503, "no job can be taken: {}", ready.text());
    fs::remove_file(&path).expect("removed");
    assert_eq!(server.get("/ready", &[]).status, 200);
    let failed = server.wait(&place, |job| job["state"] != "running");
    assert_eq!(failed["error"]["type"], "/problems/storage-full", "{failed}");
    super::kinds::finish(&server, &job(&server, &small()));
}

/// A log that takes nothing more, as one on a full disk, does not keep the service from answering.
#[test]
fn a_full_log_stops_nothing() {
    let Ok(full) = fs::File::options().write(true).open("/dev/full") else { return };
    let folder = tempfile::tempdir().expect("temporary folder");
    let free = TcpListener::bind("127.0.0.1:0").expect("bound").local_addr().expect("an address");
    let mut service = Command::new(env!("CARGO_BIN_EXE_poselight"))
        .args(["serve", "--data", "data", "--listen", &free.to_string()])
        .current_dir(folder.path())
        .stderr(full)
        .spawn()
        .expect("started");
    let start = Instant::now();
    let mut answer = String::new();
    while answer.is_empty() && start.elapsed() < Duration::from_secs(20) {
        std::thread::sleep(Duration::from_millis(100));
        let Ok(mut stream) = std::net::TcpStream::connect(free) else { continue };
        let head = "GET /health HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
        stream.write_all(head.as_bytes()).expect("sent");
        answer = rest(stream);
    }
    service.kill().expect("killed");
    service.wait().expect("ended");
    assert!(answer.starts_with("HTTP/1.1 200"), "`{answer}`");
}

/// In a folder that cannot be written the service lives and says that it is not ready.
#[test]
fn a_read_only_folder_is_told() {
    if !may_mount() {
        return;
    }
    let mount = "mount --bind data data && mount -o remount,ro,bind data";
    let server = Server::spawn_within(&[], mount);
    assert_eq!(server.get("/health", &[]).status, 200);
    assert_eq!(server.get("/ready", &[]).status, 503);
    assert_eq!(server.get("/v1/models", &[]).status, 503);
}

/// A map is a light: uniform radiance shades like the constant light that it is; a broken map is
/// refused when it comes.
#[test]
fn a_map_lights_a_model() {
    let server = Server::start(&[]);
    let mut recipe = small();
    recipe["bake"] = json!({ "signal": "transfer", "order": 2, "rays": 4 });
    recipe["fit"] = json!({ "family": "mean" });
    let done = super::kinds::finish(&server, &job(&server, &recipe));
    let model = format!("{}/evaluate", done["result"]["href"].as_str().expect("a model"));
    // Radiance HDR, flat: 8 × 4 texels of mantissa 128 and exponent 129, which is 1.
    let mut map = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n".to_vec();
    map.extend([128, 128, 128, 129].repeat(32));
    let digest = sha256(&map);
    let broken = server.put(&format!("/v1/assets/{}?name=a.hdr", sha256(b"#?no")), b"#?no", &[]);
    assert_eq!(broken.json()["type"], "/problems/bad-asset", "{}", broken.text());
    let kept = server.put(&format!("/v1/assets/{digest}?name=sky.hdr"), &map, &[]);
    assert_eq!((kept.status, &kept.json()["kind"]), (201, &json!("light")), "{}", kept.text());
    let shade = |light: Value| {
        let body = json!({ "poses": [{}], "vertices": [0, 7], "light": light });
        let answer = server.post(&model, &body, &[]);
        assert_eq!(answer.status, 200, "{}", answer.text());
        let values = answer.json()["values"].as_array().expect("values").clone();
        values.iter().filter_map(Value::as_f64).collect::<Vec<f64>>()
    };
    let constant = (4.0 * std::f64::consts::PI).sqrt();
    let white = shade(json!({ "coefficients": vec![vec![constant, 0.0, 0.0, 0.0]; 3] }));
    let mapped = shade(json!({ "asset": digest, "turn_degrees": 30 }));
    assert_eq!(white.len(), 6);
    for (a, b) in white.iter().zip(&mapped) {
        assert!((a - b).abs() < 1e-4, "{white:?} {mapped:?}");
    }
    for light in [json!({}), json!({ "asset": "x" }), json!({ "asset": server.figure() })] {
        let body = json!({ "poses": [{}], "light": light });
        assert_eq!(server.post(&model, &body, &[]).status, 422, "{light}");
    }
}
