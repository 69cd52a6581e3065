//! Proves that README's commands work as typed: every line of its shell blocks runs, in order, in
//! one temporary folder, with the real binary, but for those that [`LEFT_OUT`] names. Work is made
//! small by appending flags (few rays, few poses); nothing else is changed.

use std::fs;
use std::path::Path;
use std::process::Command;

/// Starts of lines that are not run, and why. A line that is neither here nor known fails the test.
const LEFT_OUT: [(&str, &str); 3] = [
    ("cargo install ", "it builds all of the program again, which takes minutes"),
    ("docker build ", "it needs a container engine and a network"),
    ("docker run ", "it needs the image of the line before"),
];

/// What a block may be tagged beside `sh`; under another tag a command would hide from this test.
/// Blocks of `console` talk to a running service; `tests/serve.rs` runs them.
const OTHER_TAGS: [&str; 4] = ["console", "json", "python", "rust"];

/// Flags that make a command small, by the command's first word.
fn reduction(command: &str) -> &'static [&'static str] {
    match command {
        "bake" => &["--rays", "8", "--fps", "5"],
        "run" => &["--rays", "8", "--fps", "5", "--reference-poses", "3"],
        "still" | "crowd" => &["--size", "40", "50", "--samples", "1", "--rays", "8"],
        "subdivide" => &["--rays", "4", "--fps", "2", "--key-poses", "2"],
        "measure" => &["--reference-poses", "3"],
        "tradeoff" => &["--reference-poses", "3", "--only", "mean"],
        _ => &[],
    }
}

/// Lines of ```sh blocks, continuation lines joined, comments and prompts dropped.
fn shell_lines(readme: &str) -> Vec<String> {
    let mut lines = Vec::new();
    let (mut inside, mut inside_any) = (false, false);
    let mut open = String::new();
    for line in readme.lines() {
        if let Some(tag) = line.strip_prefix("```") {
            let known = inside_any || tag == "sh" || OTHER_TAGS.contains(&tag);
            assert!(known, "a block of README is tagged {tag:?}; a shell block is ```sh");
            inside_any = !inside_any;
            inside = inside_any && tag == "sh";
            continue;
        }
        if !inside {
            continue;
        }
        match line.trim_end().strip_suffix('\\') {
            Some(part) => open.push_str(part),
            None => {
                open.push_str(line);
                lines.push(std::mem::take(&mut open));
            }
        }
    }
    let bare = |line: &String| line.split(" #").next().unwrap_or_default().trim().to_owned();
    lines.iter().map(bare).filter(|line| !line.is_empty() && !line.starts_with('#')).collect()
}

/// Whether a line is to be run; fails on one that nobody has thought of.
fn is_run(line: &str) -> bool {
    let left_out = LEFT_OUT.iter().any(|(start, _)| line.starts_with(start));
    let run = line.starts_with("poselight ") || line == "make demo";
    assert!(run || left_out, "README shows `{line}`; run it in this test, or say why not");
    run
}

fn run(line: &str, folder: &Path) {
    let binary = env!("CARGO_BIN_EXE_poselight");
    let mut words = line.split_whitespace();
    let mut command = match words.next() {
        Some("poselight") => {
            let mut command = Command::new(binary);
            let name = line.split_whitespace().nth(1).unwrap_or_default();
            command.args(words).args(reduction(name));
            command
        }
        _ => {
            let mut command = Command::new("make");
            command.args(words).arg("-C").arg(env!("CARGO_MANIFEST_DIR"));
            command
                .arg(format!("BIN={binary}"))
                .arg("BUILT=")
                .arg(format!("DEMO={}", folder.display()));
            command.arg(format!("DEMO_FLAGS={}", reduction("run").join(" ")));
            command
        }
    };
    let output = command.current_dir(folder).output().expect("started");
    assert!(
        output.status.success(),
        "`{line}` ended with {}:\n{}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
}

/// Every command that README shows succeeds; what is left out is there too.
#[test]
fn every_command_in_the_readme_works() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = fs::read_to_string(root.join("README.md")).expect("README.md");
    let folder = tempfile::tempdir().expect("temporary folder");
    let lines = shell_lines(&readme);
    let ours: Vec<&String> = lines.iter().filter(|line| is_run(line)).collect();
    for (start, why) in LEFT_OUT {
        let shown = lines.iter().any(|line| line.starts_with(start));
        assert!(shown, "README shows no `{start}…` ({why}): take it off the list");
    }
    assert!(ours.len() >= 5, "README shows too little: {lines:?}");
    for line in ours {
        run(line, folder.path());
    }
}

/// The reader of README joins continued lines and drops comments.
#[test]
fn shell_blocks_are_read() {
    let text = "```sh\nmake demo  # look\nposelight run a \\\n  -o b\n```\n```json\n{}\n```\n";
    assert_eq!(shell_lines(text), ["make demo", "poselight run a   -o b"]);
}

/// A command that the test does not know fails it, and so does a shell block by another name.
#[test]
fn nothing_is_skipped_in_silence() {
    assert!(is_run("poselight schema") && is_run("make demo"));
    assert!(!is_run("docker run --rm poselight"));
    for line in ["poselightly", "make test", "make demo DEMO=x", "rm -r hero"] {
        assert!(std::panic::catch_unwind(|| is_run(line)).is_err(), "{line}");
    }
    for tag in ["", "bash", "shell", "dockerfile"] {
        let block = format!("```{tag}\nmake demo\n```\n");
        assert!(std::panic::catch_unwind(|| shell_lines(&block)).is_err(), "{tag}");
    }
}
