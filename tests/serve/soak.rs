//! A studio's day against the real binary: scenes come in, jobs run side by side, the service is
//! killed at times that nobody chose, one job is cancelled, the disk fills up; at the end every model
//! is, byte for byte, the one that the command line makes. `make soak` plays the long form on a folder
//! of scenes.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use serde_json::{Value, json};

use super::client::{Server, sha256};
use super::hostile::may_mount;
use super::small;

/// What a day is made of.
struct Day {
    /// Scenes, with what tells their recipes apart.
    scenes: Vec<(PathBuf, u64)>,
    recipe: Value,
    kills: u32,
    /// Time between kills, milliseconds at most.
    pause_ms: u64,
    seed: u64,
    /// Whether the service's folder is on a disk that may be filled.
    fills: bool,
}

impl Day {
    fn recipe(&self, seed: u64) -> Value {
        let mut recipe = self.recipe.clone();
        recipe["bake"]["seed"] = json!(seed);
        recipe
    }

    /// Uploads and submits everything; where it was there already, nothing is new.
    fn submit(&self, server: &Server, attempt: &str) -> Vec<String> {
        let submit = |(index, (path, seed)): (usize, &(PathBuf, u64))| {
            let bytes = fs::read(path).expect("a scene");
            let (name, digest) = (file_name(path), sha256(&bytes));
            let asset = format!("/v1/assets/{digest}?name={}", name.replace(' ', "%20"));
            let kept = server.put(&asset, &bytes, &[]);
            assert!([200, 201].contains(&kept.status), "{name}: {}", kept.text());
            let request =
                json!({ "kind": "run", "assets": { &name: digest }, "recipe": self.recipe(*seed) });
            let key = format!("scene-{index}{attempt}");
            let answer = server.post("/v1/jobs", &request, &[("Idempotency-Key", &key)]);
            assert_eq!(answer.status, 202, "{name}: {}", answer.text());
            answer.json()["id"].as_str().expect("an id").to_owned()
        };
        self.scenes.iter().enumerate().map(submit).collect()
    }

    fn play(&self, server: &mut Server) {
        let mut jobs = self.submit(server, "");
        let mut recipe = self.recipe(999);
        recipe["bake"]["rays"] = json!(100_000);
        let unwanted = json!({ "kind": "bake", "assets": { "figure.glb": server.figure() }, "recipe": recipe, "priority": 5 });
        let unwanted = server.post("/v1/jobs", &unwanted, &[]).json();
        let unwanted = format!("/v1/jobs/{}", unwanted["id"].as_str().expect("an id"));
        let mut dice = self.seed;
        for _ in 0..self.kills {
            dice = dice
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            std::thread::sleep(Duration::from_millis((dice >> 33) % self.pause_ms));
            server.kill();
            server.restart();
            assert_eq!(self.submit(server, ""), jobs, "an accepted job is not known");
        }
        let state = server.get(&unwanted, &[]).json()["state"].clone();
        assert_eq!(
            server.post(&format!("{unwanted}/cancel"), &json!({}), &[]).status,
            202,
            "{state}"
        );
        server.wait(&unwanted, |job| job["state"] == "cancelled");
        if self.fills {
            fill(server);
            // Those that met the full disk have failed; who asks again gets them.
            jobs = self.submit(server, "-again");
        }
        for ((path, seed), job) in self.scenes.iter().zip(&jobs) {
            self.compare(server, path, *seed, &format!("/v1/jobs/{job}"));
        }
    }

    /// The job's model beside that of the command line.
    fn compare(&self, server: &Server, path: &Path, seed: u64, place: &str) {
        let ended = |job: &Value| {
            !["queued", "running"].contains(&job["state"].as_str().unwrap_or_default())
        };
        let done = server.wait(place, ended);
        assert_eq!(done["state"], "succeeded", "{}: {done}", path.display());
        fs::write(server.path("recipe.json"), self.recipe(seed).to_string()).expect("written");
        let scene = path.to_str().expect("text");
        server.command(&["run", scene, "-o", "day", "--recipe", "recipe.json"]);
        let expected = fs::read(server.path("day/model.safetensors")).expect("made");
        let model = done["result"]["href"].as_str().expect("a model");
        let blob = server.get(&format!("{model}/blob"), &[]);
        assert!(blob.body == expected, "{}: not the command line's model", path.display());
        fs::remove_dir_all(server.path("day")).expect("removed");
    }
}

/// Fills the disk for a while. A job that is submitted meanwhile is refused, those that write end with
/// that reason and no other, and the service lives.
fn fill(server: &Server) {
    let path = server.path("ballast");
    let mut ballast = fs::File::create(&path).expect("made");
    let block = vec![1; 1 << 20];
    while ballast.write_all(&block).is_ok() {}
    let request = json!({ "kind": "run", "assets": { "figure.glb": server.figure() }, "recipe": { "version": 1, "bake": { "seed": 4321 } } });
    let refused = server.post("/v1/jobs", &request, &[]);
    assert_eq!(refused.status, 507, "{}", refused.text());
    std::thread::sleep(Duration::from_secs(20));
    assert_eq!(server.get("/health", &[]).status, 200);
    fs::remove_file(&path).expect("removed");
    // How a job ended is written down as soon as there is room to.
    std::thread::sleep(Duration::from_secs(5));
    let failed = server.get("/v1/jobs?state=failed", &[]).json();
    for job in failed["jobs"].as_array().expect("jobs") {
        assert_eq!(job["error"]["type"], "/problems/storage-full", "{job}");
    }
    let count = failed["jobs"].as_array().map_or(0, Vec::len);
    let _ = writeln!(std::io::stderr(), "the disk was full: {count} jobs have failed");
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The short form: two jobs of the bundled character side by side, two kills.
#[test]
fn a_short_day() {
    let mut server = Server::start(&["--jobs", "2"]);
    let figure = server.path("figure.glb");
    let mut recipe = small();
    recipe["poses"]["rate_hz"] = json!(4);
    let scenes = vec![(figure.clone(), 1), (figure, 2)];
    Day { scenes, recipe, kills: 2, pause_ms: 8000, seed: 5, fills: false }.play(&mut server);
}

/// Set where the day is played on a small disk of its own.
const DISK: &str = "POSELIGHT_SOAK_DISK";

/// Plays the day again on a disk of two gigabytes, which is gone with it.
fn on_a_small_disk() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mount = "mount -t tmpfs -o size=2g none \"$0\" && exec \"$@\"";
    let test = std::env::current_exe().expect("a test");
    let status = Command::new("unshare")
        .args(["-rm", "sh", "-c", mount])
        .args([folder.path(), test.as_path()])
        .args(["--ignored", "--exact", "soak::a_long_day", "--nocapture"])
        .env(DISK, "1")
        .env("TMPDIR", folder.path())
        .status();
    assert!(status.expect("started").success(), "the day has failed");
}

/// The long form: twenty scenes of a folder, three kills, and a full disk where one may be mounted. `POSELIGHT_ASSETS` names the folder, where
/// the scenes are below `characters` or anywhere; without it the day is the bundled character's.
#[test]
#[ignore = "it takes a quarter of an hour; `make soak` plays it"]
fn a_long_day() {
    let fills = std::env::var_os(DISK).is_some();
    if !fills && may_mount() {
        return on_a_small_disk();
    }
    let mut server = Server::start(&["--jobs", "3"]);
    let mut found = Vec::new();
    if let Some(folder) = std::env::var_os("POSELIGHT_ASSETS") {
        scenes_in(Path::new(&folder), &mut found);
        found.sort();
    }
    // Scenes that a small machine bakes in seconds.
    found.retain(|path| fs::metadata(path).is_ok_and(|data| data.len() < 8 << 20));
    let sound = |path: &PathBuf| {
        let status = Command::new(env!("CARGO_BIN_EXE_poselight"))
            .args(["bake", path.to_str().unwrap_or_default(), "-o", "none", "--dry-run"])
            .output();
        status.is_ok_and(|output| output.status.success())
    };
    let mut scenes: Vec<(PathBuf, u64)> =
        found.into_iter().filter(sound).take(20).map(|path| (path, 1)).collect();
    let figure = server.path("figure.glb");
    let more = 20_u64.saturating_sub(scenes.len() as u64);
    scenes.extend((0..more).map(|seed| (figure.clone(), seed)));
    let recipe = json!({
        "version": 1,
        "poses": { "rate_hz": 5 },
        "bake": { "signal": "ao", "rays": 16 },
        "fit": { "family": "mean" },
        "target": { "reference_poses": 2 },
    });
    Day { scenes, recipe, kills: 3, pause_ms: 60_000, seed: 11, fills }.play(&mut server);
}

fn scenes_in(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok) {
        let path = entry.path();
        if path.is_dir() {
            scenes_in(&path, out);
        } else if path.extension().is_some_and(|extension| extension == "glb") {
            out.push(path);
        }
    }
}
