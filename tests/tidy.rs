//! Proves that the code keeps its own rules: modules use only modules of lower rank, `unsafe` and
//! a few libraries stay in their places, files stay small. The rules are checked on the text of
//! every source file, and the checker itself is checked on snippets that break each rule.

use std::fs;
use std::path::{Path, PathBuf};

/// Folders of `src/` with their ranks; `use crate::` reaches strictly lower ones.
const RANKS: [(&str, u32); 17] = [
    ("num", 0),
    ("sh", 1),
    ("rig", 2),
    ("model", 3),
    ("shade", 4),
    ("scene", 5),
    ("pose", 6),
    ("trace", 7),
    ("bake", 8),
    ("dataset", 9),
    ("fit", 10),
    ("measure", 11),
    ("render", 12),
    ("choose", 13),
    ("pipeline", 14),
    ("serve", 15),
    ("cli", 16),
];

/// A word that may stand only under the given prefixes of a path below `src/`.
const PLACES: [(&str, &[&str]); 9] = [
    ("unsafe", &["trace/embree/", "num/kernels"]),
    ("embree4_sys", &["trace/embree/"]),
    ("gltf", &["scene/"]),
    ("tokio", &["serve/"]),
    ("axum", &["serve/"]),
    ("clap", &["cli/"]),
    ("anyhow", &["cli/", "main.rs"]),
    ("indicatif", &["cli/"]),
    ("safetensors", &["model/"]),
];

/// Lines before a file's tests.
const MOST_LINES: usize = 400;

fn rank(folder: &str) -> Option<u32> {
    RANKS.iter().find(|(name, _)| *name == folder).map(|(_, rank)| *rank)
}

/// The code of a line: without comments and string contents that would confuse a word search.
fn code(line: &str) -> String {
    let mut out = String::new();
    let mut in_string = false;
    let mut chars = line.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '\\' if in_string => drop(chars.next()),
            '"' => in_string = !in_string,
            '/' if !in_string && chars.peek() == Some(&'/') => break,
            c if !in_string => out.push(c),
            _ => {}
        }
    }
    out
}

fn words(code: &str) -> impl Iterator<Item = (usize, &str)> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    code.split(move |c| !is_word(c))
        .filter(|word| !word.is_empty())
        .map(move |word| (word.as_ptr() as usize - code.as_ptr() as usize, word))
}

/// Modules that a line names by `crate::module` or `crate::{a, b}`.
fn crate_uses(code: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        let list = rest.strip_prefix('{').map_or(rest, |inner| inner);
        let first_only = !rest.starts_with('{');
        let mut depth = 0;
        let mut name = String::new();
        for c in list.chars().chain([',']) {
            match c {
                '{' => depth += 1,
                '}' if depth > 0 => depth -= 1,
                _ => {}
            }
            if c.is_alphanumeric() || c == '_' {
                name.push(c);
                continue;
            }
            if depth == 0 && !name.is_empty() {
                found.push(std::mem::take(&mut name));
                if first_only || !matches!(c, ',' | ':' | ' ') {
                    break;
                }
                if c == ':' {
                    depth = 1;
                }
            }
            name.clear();
            if c == ',' && depth == 1 {
                depth = 0;
            }
        }
    }
    found
}

/// Every broken rule in one file, `path` relative to `src/`.
fn violations(path: &str, text: &str) -> Vec<String> {
    let mut broken = Vec::new();
    let folder = path.split('/').next().unwrap_or(path);
    let own = rank(folder);
    if own.is_none() && !["lib.rs", "main.rs"].contains(&path) {
        broken.push(format!("{path}: folder {folder} has no rank"));
    }
    let is_test_file = path.ends_with("tests.rs") || path.contains("/tests/");
    let mut lines = 0;
    let all: Vec<&str> = text.lines().collect();
    for (number, line) in all.iter().enumerate() {
        let next = all.get(number + 1).map_or("", |next| next.trim());
        if line.trim() == "#[cfg(test)]" && next.starts_with("mod ") && next.ends_with('{') {
            break;
        }
        lines += 1;
        let code = code(line);
        for (_, word) in words(&code) {
            for (rule, places) in PLACES {
                let lint_name = word == "unsafe" && code.contains("unsafe_code");
                if word == rule && !lint_name && !places.iter().any(|p| path.starts_with(p)) {
                    broken.push(format!("{path}:{}: `{word}` does not belong here", number + 1));
                }
            }
        }
        if is_test_file {
            continue;
        }
        for used in crate_uses(&code) {
            if let (Some(own), Some(other)) = (own, rank(&used))
                && other >= own
                && used != folder
            {
                broken.push(format!(
                    "{path}:{}: rank {own} uses `{used}` of rank {other}",
                    number + 1
                ));
            }
        }
    }
    if lines > MOST_LINES && !is_test_file {
        broken.push(format!("{path}: {lines} lines before its tests, at most {MOST_LINES}"));
    }
    broken
}

fn sources(folder: &Path, into: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> =
        fs::read_dir(folder).expect("src is readable").map(|e| e.expect("entry").path()).collect();
    entries.sort();
    for entry in entries {
        if entry.is_dir() {
            sources(&entry, into);
        } else if entry.extension().is_some_and(|e| e == "rs") {
            into.push(entry);
        }
    }
}

/// The whole tree keeps every rule.
#[test]
fn the_tree_is_tidy() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    assert!(files.len() > 10, "found only {} files", files.len());
    let broken: Vec<String> = files
        .iter()
        .flat_map(|file| {
            let path = file.strip_prefix(&root).expect("below src").to_string_lossy().into_owned();
            violations(&path, &fs::read_to_string(file).expect("utf-8"))
        })
        .collect();
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

/// Each rule fails on a snippet that breaks it, so a green run means something.
#[test]
fn the_checker_sees_each_fault() {
    let faults = [
        ("rig/mod.rs", "use crate::bake::Signal;", "uses `bake`"),
        ("rig/mod.rs", "use crate::{num::random, pose::Split};", "uses `pose`"),
        ("rig/mod.rs", "    crate::model::Model::new();", "uses `model`"),
        ("bake/mod.rs", "unsafe { x() }", "`unsafe`"),
        ("model/mod.rs", "use gltf::Gltf;", "`gltf`"),
        ("pipeline/mod.rs", "use clap::Parser;", "`clap`"),
        ("helpers/mod.rs", "", "no rank"),
    ];
    for (path, text, expected) in faults {
        let found = violations(path, text);
        assert!(found.iter().any(|f| f.contains(expected)), "{path}: {text}: {found:?}");
    }
    let long = "fn f() {}\n".repeat(MOST_LINES + 1);
    assert_eq!(violations("rig/long.rs", &long).len(), 1);
}

/// What is allowed passes: lower ranks, the own module, words in comments and strings.
#[test]
fn the_checker_lets_good_code_pass() {
    let good = "//! unsafe, gltf\nuse crate::{num::random, rig::Mesh};\nuse crate::scene::x;\n\
                let s = \"use gltf and unsafe\"; // crate::cli\n#[cfg(test)]\nmod t {\n use crate::cli; }";
    assert_eq!(violations("scene/mod.rs", good), Vec::<String>::new());
}
