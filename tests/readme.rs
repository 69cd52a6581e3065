//! Proves that README's commands work as typed: every line of its shell blocks that starts with
//! `poselight` or `make demo` runs, in order, in one temporary folder, with the real binary. Work
//! is made small by appending flags (few rays, few poses); nothing else is changed.

use std::fs;
use std::path::Path;
use std::process::Command;

/// Flags that make a command small, by the command's first word.
fn reduction(command: &str) -> &'static [&'static str] {
    match command {
        "bake" => &["--rays", "8", "--fps", "5"],
        "run" => &["--rays", "8", "--fps", "5", "--reference-poses", "3"],
        "measure" => &["--reference-poses", "3"],
        _ => &[],
    }
}

/// Lines of ```sh blocks, continuation lines joined, comments and prompts dropped.
fn shell_lines(readme: &str) -> Vec<String> {
    let mut lines = Vec::new();
    let mut inside = false;
    let mut open = String::new();
    for line in readme.lines() {
        if line.starts_with("```") {
            inside = line.starts_with("```sh");
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

/// Every command that README shows succeeds; those of the container, of `make test` and of the
/// long-running targets are left out.
#[test]
fn every_command_in_the_readme_works() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = fs::read_to_string(root.join("README.md")).expect("README.md");
    let folder = tempfile::tempdir().expect("temporary folder");
    let lines = shell_lines(&readme);
    let ours: Vec<&String> = lines
        .iter()
        .filter(|line| line.starts_with("poselight ") || line.starts_with("make demo"))
        .collect();
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
