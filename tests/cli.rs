//! Proves the promises of the command line with the real binary: a killed bake continues to the
//! same bytes, threads change nothing, Ctrl-C leaves what can be continued, exit statuses say what
//! happened, `--json` is one object, and a scene that does not move needs no pose model.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

/// A temporary folder with the bundled character.
struct Studio {
    folder: tempfile::TempDir,
}

impl Studio {
    fn new() -> Self {
        let studio = Self { folder: tempfile::tempdir().expect("temporary folder") };
        studio.succeed(&["sample", "figure", "-o", "figure.glb"]);
        studio
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_poselight"));
        command.args(words).current_dir(self.folder.path());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn run(&self, words: &[&str]) -> Output {
        self.command(words).output().expect("started")
    }

    fn succeed(&self, words: &[&str]) -> Output {
        let output = self.run(words);
        assert!(output.status.success(), "{words:?}: {}", text(&output.stderr));
        output
    }

    /// The exit status and the message of a command that must not succeed.
    fn fail(&self, words: &[&str]) -> (i32, String) {
        let output = self.run(words);
        let status = output.status.code().expect("ended by itself");
        assert_ne!(status, 0, "{words:?} succeeded");
        (status, text(&output.stderr))
    }
}

impl Studio {
    /// The message of a command on a disk that takes 4 KiB of each file and no more.
    fn fail_full(&self, words: &[&str]) -> String {
        let mut command = Command::new("sh");
        let script = "trap '' XFSZ; ulimit -f 8; exec \"$@\"";
        command.args(["-c", script, "sh", env!("CARGO_BIN_EXE_poselight")]).args(words);
        let output = command.current_dir(self.folder.path()).output().expect("started");
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{words:?}: {message}");
        assert!(message.contains("File too large"), "{words:?}: {message}");
        message
    }
}

/// A disk that fills up while a result is written: the file that was there stands, no part of the new
/// one stays, and the sentence names the file.
#[test]
fn a_full_disk_leaves_what_was_there() {
    let studio = Studio::new();
    let before = tree(&studio.path(""));
    let message = studio.fail_full(&["sample", "figure", "-o", "figure.glb"]);
    assert!(message.contains("could not write figure.glb"), "{message}");
    studio.fail_full(&["sample", "figure", "-o", "new.glb"]);
    assert!(tree(&studio.path("")) == before, "something was left behind");
}

/// A folder that cannot be written is named, whoever asks: `/proc` takes no files from root either.
/// A folder without write permission stops all others.
#[test]
fn a_read_only_folder_is_named() {
    use std::io::Write;
    use std::os::unix::fs::PermissionsExt;
    let studio = Studio::new();
    let closed = studio.path("closed");
    fs::create_dir(&closed).expect("made");
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o555)).expect("closed");
    let free = fs::write(closed.join("try"), b"").is_ok();
    if free {
        // Not by `eprintln!`, which the test harness keeps to itself while tests pass.
        let lack =
            "a_read_only_folder_is_named: permissions do not bind this user; /proc alone is tried";
        let _ = writeln!(std::io::stderr(), "{lack}");
    }
    let closed = (!free).then_some("closed");
    for folder in ["/proc"].into_iter().chain(closed) {
        let place = |name: &str| format!("{folder}/{name}");
        for words in [
            ["sample", "figure", "-o", &place("new.glb")].to_vec(),
            bake(&place("d.zarr"), &[]),
            ["run", "cube.obj", "-o", &place("out"), "--rays", "16"].to_vec(),
        ] {
            fs::write(studio.path("cube.obj"), CUBE).expect("written");
            let (status, message) = studio.fail(&words);
            assert_eq!(status, 1, "{words:?}: {message}");
            assert!(message.contains(folder) && !message.contains("panicked"), "{message}");
        }
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A scene that does not move.
const CUBE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nv 1 1 1\n\
        f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";

/// Flags of a bake that is quick but has several blocks.
const SMALL: [&str; 6] = ["--fps", "8", "--rays", "8", "--near-repeat", "0"];

fn bake<'a>(dataset: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["bake", "figure.glb", "-o", dataset], &SMALL[..], more].concat()
}

/// Every file below a folder with its bytes, locks left out.
fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(next).expect("listed") {
            let path = entry.expect("entry").path();
            if path.is_dir() {
                open.push(path);
            } else if !path.to_string_lossy().ends_with("lock") {
                let name = path.strip_prefix(folder).expect("below").to_string_lossy().into_owned();
                files.insert(name, fs::read(&path).expect("read"));
            }
        }
    }
    files
}

fn assert_same(a: &Path, b: &Path) {
    let (a, b) = (tree(a), tree(b));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    let other: Vec<_> = a.iter().filter(|(name, bytes)| b[*name] != **bytes).collect();
    assert!(other.is_empty(), "{:?} differ", other.iter().map(|f| f.0).collect::<Vec<_>>());
}

/// Waits until the first block is committed, or the process has ended.
fn wait_for_a_block(child: &mut Child, dataset: &Path) {
    let start = Instant::now();
    let committed = || {
        let entries = fs::read_dir(dataset.join("coefficients"));
        entries.is_ok_and(|mut all| {
            all.any(|entry| entry.is_ok_and(|e| e.file_name().to_string_lossy().starts_with("c.")))
        })
    };
    while !committed() && child.try_wait().expect("asked").is_none() {
        assert!(start.elapsed() < Duration::from_secs(120), "no block after two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// `kill -9` in the middle, then the same command: the bytes are those of an undisturbed bake, and
/// what was committed is not baked again.
#[test]
fn a_killed_bake_continues_to_the_same_bytes() {
    let studio = Studio::new();
    studio.succeed(&bake("whole.zarr", &[]));
    let mut child = studio.command(&bake("killed.zarr", &[])).spawn().expect("started");
    wait_for_a_block(&mut child, &studio.path("killed.zarr"));
    child.kill().expect("killed");
    child.wait().expect("ended");
    let output = studio.succeed(&bake("killed.zarr", &["--json"]));
    let json: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    let count = |field: &str| json["bake"][field].as_u64().expect("a count");
    assert!((1..count("poses")).contains(&count("poses_now")), "not killed in the middle: {json}");
    assert_same(&studio.path("whole.zarr"), &studio.path("killed.zarr"));
}

/// One thread and three give the same data set and the same model.
#[test]
fn threads_change_no_byte() {
    let studio = Studio::new();
    for threads in ["1", "3"] {
        let dataset = format!("{threads}.zarr");
        let model = format!("{threads}.safetensors");
        studio.succeed(&bake(&dataset, &["--threads", threads]));
        studio.succeed(&["fit", &dataset, "-o", &model, "--threads", threads]);
    }
    assert_same(&studio.path("1.zarr"), &studio.path("3.zarr"));
    let read = |name: &str| fs::read(studio.path(name)).expect("read");
    assert!(read("1.safetensors") == read("3.safetensors"), "models differ");
}

/// Ctrl-C ends the bake with a sentence, and the same command finishes it.
#[test]
fn an_interrupted_bake_says_how_to_go_on() {
    let studio = Studio::new();
    let words = bake("stopped.zarr", &["--rays", "64"]);
    let mut child = studio.command(&words).spawn().expect("started");
    wait_for_a_block(&mut child, &studio.path("stopped.zarr"));
    let pid = child.id().to_string();
    Command::new("kill").args(["-INT", &pid]).status().expect("signalled");
    let output = child.wait_with_output().expect("ended");
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("the same command continues from there"), "{message}");
    let (status, message) = studio.fail(&["fit", "stopped.zarr", "-o", "m.safetensors"]);
    assert_eq!(status, 1);
    assert!(message.contains("poselight bake"), "{message}");
    studio.succeed(&words);
    studio.succeed(&["fit", "stopped.zarr", "-o", "m.safetensors"]);
}

/// Each wrong request ends with status 1 or 2 and a sentence that names what is wrong.
#[test]
fn bad_requests_are_named() {
    let studio = Studio::new();
    fs::write(studio.path("noise.glb"), b"this is no scene").expect("written");
    fs::write(studio.path("noise.png"), b"\x89PNG").expect("written");
    fs::write(studio.path("bad.json"), br#"{"version": 1, "bake": {"rayz": 5}}"#).expect("written");
    let cases: [(&[&str], i32, &str); 21] = [
        (&["bake", "figure.glb", "-o", "d", "--order", "11"], 2, "bake.order"),
        (&["bake", "figure.glb", "-o", "d", "--order", "0"], 2, "bake.order"),
        (&["bake", "figure.glb", "-o", "d", "--rays", "0"], 2, "bake.rays"),
        (&["bake", "figure.glb", "-o", "d", "--clip", "swim"], 1, "no clip named \"swim\""),
        (
            &["bake", "figure.glb", "-o", "d", "--clip", "walk", "--hold-out", "walk"],
            1,
            "holding out walk leaves no clip to train on",
        ),
        (&["bake", "absent.glb", "-o", "d"], 1, "absent.glb"),
        (&["bake", "noise.glb", "-o", "d"], 1, "noise.glb"),
        (
            &["bake", "figure.glb", "-o", "figure.glb/d", "--rays", "8", "--fps", "1"],
            1,
            "figure.glb",
        ),
        (&["bake", "figure.glb", "-o", "d", "--recipe", "bad.json"], 2, "rayz"),
        (&["fit", "figure.glb", "-o", "d.safetensors"], 1, "figure.glb"),
        (&["bake", "figure.glb"], 2, "--output"),
        (&["bake", "figure.glb", "-o", "d", "--signal", "ao", "--order", "9"], 2, "bake.order"),
        (&["bake", "figure.glb", "-o", "d", "--dry-run", "--from", "e"], 2, "--from"),
        (&["run", "figure.glb", "-o", "d", "--alpha", "3"], 2, "fit.alpha"),
        (&["run", "figure.glb", "-o", "d", "--family", "mean", "--inputs", "8"], 2, "fit.inputs"),
        (&["bake", "noise.png", "-o", "d"], 1, "nor a vertex sequence (.npz)"),
        (&["fit", "d.zarr", "-o", "figure.glb"], 2, "figure.safetensors, not figure.glb"),
        (&["fit", "a.safetensors", "-o", "./a.safetensors"], 2, "replace the data set"),
        (&["rebind", "m.safetensors", "figure.glb", "-o", "m.safetensors"], 2, "replace the model"),
        (&["rebind", "m.safetensors", "figure.glb", "-o", "figure.glb"], 2, "a .safetensors file"),
        (&["rebind", "m", "figure.glb", "-o", "d", "--tolerance", "-1"], 2, "a share, 0 to 1"),
    ];
    for (words, expected, evidence) in cases {
        let (status, message) = studio.fail(words);
        assert_eq!(status, expected, "{words:?}: {message}");
        assert!(message.contains(evidence), "{words:?}: {message}");
        assert!(!message.contains("panicked"), "{words:?}: {message}");
        assert!(!studio.path("d").exists(), "{words:?} left something behind");
    }
}

/// A trade-off refuses beforehand what it cannot try: nothing is baked, measured or written.
#[test]
fn a_trade_off_refuses_before_its_work() {
    let studio = Studio::new();
    studio.succeed(&bake("d.zarr", &["--signal", "ao"]));
    let before = tree(&studio.path("d.zarr"));
    fs::write(studio.path("file"), b"").expect("written");
    for (flags, expected, evidence) in [
        (&["--poses", "0"][..], 2, "0 training poses cannot be tried"),
        (&["--poses", "100000"], 2, "100000 training poses cannot be tried"),
        (&["--rays", "0"], 2, "0 rays per point cannot be tried"),
        (&["--orders", "9"], 2, "9 bands cannot be tried"),
        (&["--poses", "1", "--family", "multilinear"], 1, "training poses vary in 0"),
        (&["--family", "linear"], 2, "--family names the model that --rays"),
        (&["--only", "mean", "--only", "nosuch"], 2, "no candidate has `nosuch` in its name"),
        (&["--only", "mean", "-o", "file"], 1, "could not write to file"),
    ] {
        let (status, message) = studio.fail(&[&["tradeoff", "d.zarr", "-o", "to"], flags].concat());
        assert_eq!(status, expected, "{flags:?}: {message}");
        assert!(message.contains(evidence), "{flags:?}: {message}");
        assert!(!studio.path("to").exists(), "{flags:?} left something behind");
    }
    assert!(before == tree(&studio.path("d.zarr")), "references were baked");
    let words = ["tradeoff", "d.zarr", "-o", "to", "--only", "mean", "--reference-poses", "1"];
    let missed = studio.run(&[&words[..], &["--max-error", "1e-9"]].concat());
    let told = text(&missed.stdout);
    assert_eq!(missed.status.code(), Some(3), "{told}");
    assert!(told.contains("MISSED by all; mean"), "{told}");
    studio.succeed(&[&words[..], &["--max-error", "0.9", "--orders", "1"]].concat());
    let page = fs::read_to_string(studio.path("to/report.html")).expect("written");
    assert!(page.contains("Rays, poses and order"), "the page tells what less would do");
}

/// A data set of another recipe is not continued; a damaged chunk is named.
#[test]
fn foreign_and_damaged_data_sets_are_refused() {
    let studio = Studio::new();
    studio.succeed(&bake("d.zarr", &["--signal", "ao"]));
    for flags in
        [&["--signal", "ao", "--seed", "2"][..], &["--signal", "ao", "--seed", "2", "--dry-run"]]
    {
        let (status, message) = studio.fail(&bake("d.zarr", flags));
        assert_eq!(status, 1);
        assert!(message.contains("another recipe"), "{message}");
    }
    for (flags, evidence) in [
        (&["--max-bytes", "1", "--inputs", "4"][..], "--inputs changes nothing"),
        (&["--max-bytes", "1", "--family", "linear", "--include-rest"], "fit.include_rest"),
        (&["--reference-poses", "4"], "poselight measure"),
        (&["--family", "linear", "--spheres", "4"], "fit.spheres"),
    ] {
        let (status, message) =
            studio.fail(&[&["fit", "d.zarr", "-o", "m.safetensors"], flags].concat());
        assert_eq!(status, 2, "{message}");
        assert!(message.contains(evidence), "{flags:?}: {message}");
    }
    let message = studio.fail_full(&["fit", "d.zarr", "-o", "m.safetensors"]);
    assert!(message.contains("m.safetensors") && !studio.path("m.safetensors").exists());
    let chunks = tree(&studio.path("d.zarr"));
    let chunk = chunks.keys().find(|name| name.starts_with("coefficients/c.")).expect("a chunk");
    fs::write(studio.path("d.zarr").join(chunk), b"short").expect("damaged");
    let (status, message) = studio.fail(&["fit", "d.zarr", "-o", "m.safetensors"]);
    assert_eq!(status, 1);
    assert!(message.contains("coefficients"), "{message}");
    assert!(!studio.path("m.safetensors").exists());
}

/// `run` makes its four results, a second run keeps them, a missed target is status 3, and a model
/// lies about nothing: a flipped bit in its header is refused.
#[test]
fn a_run_is_kept_and_judged() {
    let studio = Studio::new();
    let words = ["run", "figure.glb", "-o", "out", "--fps", "4", "--rays", "8", "--signal", "ao"];
    let more = ["--reference-poses", "2", "--hold-out", "jump", "--json"];
    let words = [&words[..], &more[..]].concat();
    let first = studio.succeed(&words);
    let json: Value = serde_json::from_slice(&first.stdout).expect("one JSON object");
    assert!(
        json["figures"]["measured"]["splits"].as_array().is_some_and(|s| s.len() >= 2),
        "{json}"
    );
    let before = tree(&studio.path("out"));
    for name in ["model.safetensors", "report.html", "figures.json", "recipe.json"] {
        assert!(before.contains_key(name), "{name} is missing");
    }
    studio.succeed(&words);
    assert!(before == tree(&studio.path("out")), "a second run changed something");

    let (_, message) = studio.fail(&["inspect", "out"]);
    assert!(message.contains("inspect out/dataset.zarr or out/model.safetensors"), "{message}");

    let said = ["--inputs", "8", "--max-error", "1e-9"];
    let missed = studio.run(&[&words[..], &said].concat());
    assert_eq!(missed.status.code(), Some(3), "{}", text(&missed.stderr));
    let json: Value = serde_json::from_slice(&missed.stdout).expect("one JSON object");
    assert_eq!(json["target_met"], Value::Bool(false));
    assert_eq!(json["figures"]["choice"], Value::Null, "a model that is said is only judged");

    a_run_chooses(&studio, &words);

    lies_are_refused(&studio, &before["model.safetensors"]);
}

/// Where only the family is said, a stated target chooses its size and precision, once; what says the
/// model does not go with a limit that chooses it.
fn a_run_chooses(studio: &Studio, words: &[&'static str]) {
    let target = ["--family", "linear", "--max-bytes", "10000000", "--max-error", "1e-9"];
    let words = [words, &target].concat();
    let first = studio.run(&words);
    assert_eq!(first.status.code(), Some(3), "{}", text(&first.stderr));
    let json: Value = serde_json::from_slice(&first.stdout).expect("one JSON object");
    let choice = &json["figures"]["choice"];
    assert!(choice["name"].as_str().is_some_and(|name| name.starts_with("linear")), "{choice}");
    assert!(choice["remedy"].is_string(), "{choice}");
    let before = tree(&studio.path("out"));
    assert_eq!(studio.run(&words).status.code(), Some(3));
    assert!(before == tree(&studio.path("out")), "a second run changed something");

    let (status, message) = studio.fail(&[&words[..], &["--inputs", "8"]].concat());
    assert_eq!(status, 2);
    assert!(message.contains("--max-bytes chooses the model, but --inputs says"), "{message}");
}

/// One bit of the length before the header, of the JSON around it, and of fields in it.
fn lies_are_refused(studio: &Studio, blob: &[u8]) {
    let after = |text: &str| {
        let at = blob.windows(text.len()).position(|window| window == text.as_bytes());
        at.unwrap_or_else(|| panic!("no {text} in the header")) + text.len()
    };
    for (at, bit, sentence) in [
        (3, 0x40, "more than the limit of"),
        (after("{\"__metadata__"), 0x01, "not a model: the bytes are no safetensors file"),
        (after(r#"\"family\":\""#), 0x20, "the model's header is not valid: unknown variant `P"),
        (after(r#"\"order\":"#), 0x02, "header field `order` is wrong"),
    ] {
        let mut lie = blob.to_vec();
        lie[at] ^= bit;
        fs::write(studio.path("lie.safetensors"), lie).expect("written");
        let (status, message) = studio.fail(&["inspect", "lie.safetensors"]);
        assert_eq!(status, 1, "{message}");
        assert!(message.contains(sentence), "byte {at}: {message}");
        assert!(!message.contains("panicked"), "{message}");
    }
}

/// A scene without motion is baked once; its model is its mean and says so.
#[test]
fn a_static_scene_is_its_mean() {
    let studio = Studio::new();
    fs::write(studio.path("cube.obj"), CUBE).expect("written");
    let words = ["run", "cube.obj", "-o", "out", "--rays", "16", "--json"];
    let output = studio.succeed(&words);
    let json: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(json["figures"]["model"]["family"], "mean");
    assert_eq!(json["bake"]["poses"], 1);
    let notices = json["notices"].to_string();
    assert!(notices.contains("does not move"), "{notices}");
    assert!(text(&output.stderr).is_empty(), "not quiet: {}", text(&output.stderr));
    let occluder = ["run", "cube.obj", "-o", "out2", "--rays", "16", "--family", "occluder"];
    let output = studio.succeed(&[&occluder[..], &["--json"]].concat());
    let json: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(json["figures"]["model"]["family"], "mean");
    let evaluate = ["evaluate", "out/model.safetensors", "--scene", "cube.obj", "-o", "rest.npy"];
    let output = studio.succeed(&evaluate);
    assert!(text(&output.stdout).contains("[1, 8, 1, 36]"), "{}", text(&output.stdout));
}

/// A run is approved and checked: the same scene passes, a figure that is worse than approved fails
/// with status 3 and is named in the JUnit document, and what is no baseline is refused.
#[test]
fn a_regression_is_told() {
    let studio = Studio::new();
    let recipe = r#"{"version": 1, "poses": {"rate_hz": 4}, "bake": {"signal": "ao", "rays": 4},
        "fit": {"family": "mean"}, "target": {"reference_poses": 2}}"#;
    fs::write(studio.path("recipe.json"), recipe).expect("written");
    let check = ["check", "figure.glb", "--baseline", "approved.json", "-o", "work"];
    studio.succeed(&[&check[..], &["--approve", "--recipe", "recipe.json"]].concat());
    let written = ["--junit", "check.xml", "--page", "check.html"];
    studio.succeed(&[&check[..], &written].concat());
    let xml = fs::read_to_string(studio.path("check.xml")).expect("written");
    assert!(xml.contains("failures=\"0\"") && xml.contains("model: bytes"), "{xml}");
    let path = studio.path("approved.json");
    let mut approved: Value =
        serde_json::from_slice(&fs::read(&path).expect("written")).expect("JSON");
    let bytes = approved["figures"]["model: bytes"].as_f64().expect("a number");
    approved["figures"]["model: bytes"] = (bytes / 2.0).into();
    fs::write(&path, approved.to_string()).expect("written");
    assert_eq!(studio.fail(&[&check[..], &written].concat()).0, 3);
    let xml = fs::read_to_string(studio.path("check.xml")).expect("written");
    assert!(xml.contains("failures=\"1\"") && xml.contains("<failure"), "{xml}");
    let page = fs::read_to_string(studio.path("check.html")).expect("written");
    assert!(page.contains("one figure is worse"), "{page}");
    fs::write(&path, "{}").expect("written");
    let (status, message) = studio.fail(&check);
    assert!(status == 1 && message.contains("approved.json"), "{message}");
}

/// A target chooses a model and says so; one that nothing meets ends with status 3, the best that was
/// reached, and what would help.
#[test]
fn a_target_chooses_or_ends_with_status_3() {
    let studio = Studio::new();
    // What a run leaves to its target its data set states; a model that is named for a fit goes before it, and so
    // does a target, here without the bound that nothing meets.
    let stated = r#"{"version": 1, "target": {"choose": "any", "max_us": 1e-3}}"#;
    fs::write(studio.path("stated.json"), stated).expect("written");
    let coarse = ["--signal", "ao", "--rays", "4", "--fps", "2", "--hold-out", "jump"];
    let recipe = ["--recipe", "stated.json"];
    studio.succeed(&[&["bake", "figure.glb", "-o", "d.zarr"], &coarse[..], &recipe].concat());
    let named = ["--json", "fit", "d.zarr", "-o", "named.safetensors"];
    for flags in [&["--family", "linear"][..], &["--inputs", "3", "--precision", "f16"]] {
        let named = studio.succeed(&[&named[..], flags].concat());
        let named: Value = serde_json::from_slice(&named.stdout).expect("one object");
        assert!(named["fit"]["bytes"].is_u64(), "fitted as it was named, not chosen: {named}");
    }
    let words = ["--json", "fit", "d.zarr", "--family", "linear", "--reference-poses", "1"];
    let met =
        studio.succeed(&[&words[..], &["-o", "met.safetensors", "--max-error", "0.5"]].concat());
    let met: Value = serde_json::from_slice(&met.stdout).expect("one object");
    assert_eq!((&met["met"], &met["remedy"]), (&Value::Bool(true), &Value::Null));
    assert_eq!(met["chosen"]["precision"], "i8", "the smallest that meets it: {met}");
    let missed =
        studio.run(&[&words[1..], &["-o", "missed.safetensors", "--max-error", "1e-7"]].concat());
    let told = text(&missed.stdout);
    assert_eq!(missed.status.code(), Some(3), "{told}");
    assert!(told.contains("the target is not met; what would help most:"), "{told}");
    assert!(studio.path("missed.safetensors").is_file(), "the best that was reached is kept");
}

/// A run refines the mesh first where that is asked for: data set and model are of the refined scene,
/// which lies beside them; again, everything is there; another budget is another bake.
#[test]
fn a_run_bakes_the_refined_mesh() {
    let studio = Studio::new();
    let run = |budget: &'static str, more: &[&'static str]| {
        let mut words = vec!["run", "figure.glb", "-o", "out", "--signal", "ao", "--rays", "4"];
        words.extend(["--fps", "2", "--hold-out", "jump", "--reference-poses", "1", "--json"]);
        words.extend(["--subdivide", budget]);
        words.extend(more);
        words
    };
    let object = |output: Output| -> Value { serde_json::from_slice(&output.stdout).expect("one") };
    let planned = object(studio.succeed(&run("16000", &["--dry-run"])));
    assert!(planned["refine_rays"].as_u64() > Some(0), "{planned}");
    let done = object(studio.succeed(&run("16000", &[])));
    assert!(done["notices"].to_string().contains("refined from"), "{done}");
    let refined = object(studio.succeed(&["inspect", "out/refined.glb", "--json"]));
    let triangles = refined["triangles"].as_u64().expect("a number");
    assert!((15_990..=16_000).contains(&triangles), "{refined}");
    let set = object(studio.succeed(&["inspect", "out/dataset.zarr", "--json"]));
    assert_eq!(set["vertices"], refined["vertices"], "{set}");
    let exact = object(studio.succeed(&run("16000", &["--dry-run"])));
    assert_eq!(exact["hashes"]["bake"], planned["hashes"]["bake"], "the name is known before");
    assert_eq!((&exact["refine_rays"], &exact["points"]), (&0.into(), &refined["points"]));
    assert!(planned["points"].as_u64() >= exact["points"].as_u64(), "{planned} {exact}");
    let again = studio.succeed(
        &run("16000", &[])[..].iter().copied().filter(|w| *w != "--json").collect::<Vec<_>>(),
    );
    assert!(text(&again.stdout).contains("there already"), "{}", text(&again.stdout));
    // The model is of the refined scene.
    studio.succeed(&["apply", "out/model.safetensors", "out/refined.glb", "-o", "shown.glb"]);
    let (status, told) = studio.fail(&run("15000", &[]));
    assert!(status == 1 && told.contains("subdivide.triangles"), "{told}");
    let (status, told) = studio.fail(&run("10", &["-o", "other"]));
    assert!(status == 2 && told.contains("less than the"), "{told}");
}

/// A skinned character is refined to a file that still animates; budgets that make no sense, a
/// measure without its constant and a file that cannot be written into are refused.
#[test]
fn a_character_is_refined() {
    let studio = Studio::new();
    let refine = |more: &[&'static str]| {
        let mut words = vec!["subdivide", "figure.glb", "-o", "fine.glb", "--clip", "walk"];
        words.extend(["--fps", "2", "--rays", "4", "--order", "2", "--key-poses", "2", "--json"]);
        words.extend(more);
        words
    };
    let told = studio.succeed(&refine(&["--max-triangles", "20000", "--values", "--colour"]));
    let told: Value = serde_json::from_slice(&told.stdout).expect("one object");
    let triangles = told["triangles"][1].as_u64().expect("a number");
    assert!((19_990..=20_000).contains(&triangles), "{told}");
    let before = studio.succeed(&["inspect", "figure.glb", "--json"]);
    let after = studio.succeed(&["inspect", "fine.glb", "--json"]);
    let [before, after]: [Value; 2] =
        [before, after].map(|output| serde_json::from_slice(&output.stdout).expect("an object"));
    assert_eq!((&before["clips"], &before["joints"]), (&after["clips"], &after["joints"]));
    assert_eq!(after["triangles"].as_u64(), Some(triangles), "{after}");
    // Edges that cannot meet a bound stay whole where that is asked for, and what is left keeps it.
    let bound = |more: &[&'static str]| {
        let mut words = refine(&["--max-triangles", "16000", "--bound", "0.0002"]);
        words.extend(more);
        let told: Value = serde_json::from_slice(&studio.succeed(&words).stdout).expect("one");
        let deviation = &told["deviation"];
        [&deviation["beyond_bound"], &deviation["kept_whole"]]
            .map(|n| n.as_u64().expect("a number"))
    };
    let [split, kept] = [bound(&[]), bound(&["--keep-bound"])];
    assert!(split[0] > 0 && split[1] == 0 && kept[0] == 0 && kept[1] > 0, "{split:?} {kept:?}");
    fs::write(studio.path("plain.gltf"), "{}").expect("written");
    let patch = "v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 3 2\n";
    fs::write(studio.path("patch.obj"), patch).expect("written");
    for (words, status, evidence) in [
        (refine(&["--max-triangles", "10"]), 2, "less than the"),
        (refine(&["--until", "0"]), 2, "positive"),
        (refine(&["--curvature", "2"]), 2, "subdivide.curvature"),
        (refine(&["--max-vertices", "10"]), 2, "subdivide.vertices"),
        (refine(&["--bounces", "1"]), 2, "bake.bounces"),
        (refine(&["--receivers", "patch.obj"]), 2, "bake.surroundings.receivers"),
        (refine(&["--choose-rays"]), 2, "--choose-rays"),
        (vec!["subdivide", "figure.glb", "-o", "figure.glb"], 2, "replace the scene figure.glb"),
        (vec!["apply", "no.st", "figure.glb", "-o", "./figure.glb"], 2, "replace the scene"),
        (vec!["subdivide", "plain.gltf", "-o", "fine.glb"], 1, "plain.gltf"),
        (vec!["subdivide", "patch.obj", "-o", "fine.glb"], 1, "only a glTF can be written into"),
    ] {
        let (found, message) = studio.fail(&words);
        assert_eq!(found, status, "{words:?}: {message}");
        assert!(message.contains(evidence), "{words:?}: {message}");
    }
}
