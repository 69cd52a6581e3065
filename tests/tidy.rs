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
    ("safetensors", &["model/", "shade/"]),
];

/// Lines of a file without its tests.
const MOST_LINES: usize = 400;

fn rank(folder: &str) -> Option<u32> {
    RANKS.iter().find(|(name, _)| *name == folder).map(|(_, rank)| *rank)
}

/// A word, a number, `::` or one other character of the code, with its line, counted from 1.
#[derive(Debug, Clone, PartialEq)]
struct Token {
    text: String,
    line: usize,
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The code of a file: comments dropped, every string and character replaced by `"`.
fn tokens(text: &str) -> Vec<Token> {
    let chars: Vec<char> = text.chars().collect();
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    let (mut out, mut i, mut line) = (Vec::new(), 0, 1);
    while i < chars.len() {
        let word = chars[i..].iter().take_while(|c| is_word(**c)).count();
        let (end, kept) = match (at(i), at(i + 1)) {
            ('/', '/') => (i + chars[i..].iter().take_while(|c| **c != '\n').count(), None),
            ('/', '*') => (comment_end(&chars, i), None),
            ('"', _) => (string_end(&chars, i, None), Some("\"".to_owned())),
            ('\'', next) if next == '\\' || at(i + 2) == '\'' => {
                let end = (i + 3..chars.len()).find(|&end| chars[end] == '\'');
                let end = if next == '\\' { end } else { Some(i + 2) };
                (end.map_or(chars.len(), |end| end + 1), Some("\"".to_owned()))
            }
            (':', ':') => (i + 2, Some("::".to_owned())),
            (c, _) if c.is_whitespace() => (i + 1, None),
            _ if word == 0 => (i + 1, Some(chars[i].to_string())),
            _ => {
                let name: String = chars[i..i + word].iter().collect();
                let end = i + word;
                let fences = chars[end..].iter().take_while(|c| **c == '#').count();
                let raw = ["r", "br", "cr"].contains(&name.as_str()) && at(end + fences) == '"';
                if raw {
                    (string_end(&chars, end + fences, Some(fences)), Some("\"".to_owned()))
                } else {
                    (end, Some(name))
                }
            }
        };
        out.extend(kept.map(|text| Token { text, line }));
        let end = end.min(chars.len());
        line += chars[i..end].iter().filter(|c| **c == '\n').count();
        i = end;
    }
    out
}

/// After a block comment, which may hold others.
fn comment_end(chars: &[char], start: usize) -> usize {
    let (mut depth, mut i) = (0, start);
    while i < chars.len() {
        match (chars[i], chars.get(i + 1)) {
            ('/', Some('*')) => (depth, i) = (depth + 1, i + 2),
            ('*', Some('/')) => (depth, i) = (depth - 1, i + 2),
            _ => i += 1,
        }
        if depth == 0 {
            break;
        }
    }
    i
}

/// After a string whose first `"` is at `start`; a raw one ends with as many `#` as it has fences.
fn string_end(chars: &[char], start: usize, raw_fences: Option<usize>) -> usize {
    let mut i = start + 1;
    while i < chars.len() {
        match (chars[i], raw_fences) {
            ('\\', None) => i += 1,
            ('"', None) => return i + 1,
            ('"', Some(fences)) if chars[i + 1..].iter().take(fences).all(|c| *c == '#') => {
                return i + 1 + fences;
            }
            _ => {}
        }
        i += 1;
    }
    i
}

/// The index after the bracket that closes the one at `open`.
fn closed(tokens: &[Token], open: usize) -> usize {
    let mut depth = 0_usize;
    for (i, token) in tokens.iter().enumerate().skip(open) {
        match token.text.as_str() {
            "{" | "[" | "(" => depth += 1,
            "}" | "]" | ")" => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 {
            return i + 1;
        }
    }
    tokens.len()
}

/// The code without its `#[cfg(test)] mod … { … }`, and how many lines those take.
fn without_tests(tokens: &[Token]) -> (Vec<Token>, usize) {
    let is = |i: usize, text: &str| tokens.get(i).is_some_and(|token| token.text == text);
    let attribute = ["#", "[", "cfg", "(", "test", ")", "]"];
    let (mut kept, mut lines, mut i) = (Vec::new(), 0, 0);
    while i < tokens.len() {
        if (0..attribute.len()).all(|k| is(i + k, attribute[k])) {
            let mut next = i + attribute.len();
            while is(next, "#") {
                next = closed(tokens, next + 1);
            }
            if is(next, "mod") && is(next + 2, "{") {
                let end = closed(tokens, next + 2);
                lines += tokens[end - 1].line - tokens[i].line + 1;
                i = end;
                continue;
            }
        }
        kept.push(tokens[i].clone());
        i += 1;
    }
    (kept, lines)
}

/// What a path that starts at the crate's root names first; `*` or `as` where it takes the root
/// itself, behind which no rank can be seen.
fn root_names(tokens: &[Token], path: &str) -> Vec<Token> {
    let folders = path.strip_suffix("/mod.rs").or(path.strip_suffix(".rs")).unwrap_or(path);
    let file = if ["lib", "main"].contains(&folders) { 0 } else { folders.split('/').count() };
    let is = |i: usize, text: &str| tokens.get(i).is_some_and(|token| token.text == text);
    // Brace depth, and the braces that are inline modules.
    let (mut depth, mut modules) = (0_usize, Vec::new());
    let (mut found, mut i) = (Vec::new(), 0);
    while i < tokens.len() {
        match tokens[i].text.as_str() {
            "mod" if is(i + 2, "{") => modules.push(depth),
            "{" => depth += 1,
            "}" => {
                depth = depth.saturating_sub(1);
                modules.pop_if(|opened| *opened == depth);
            }
            "extern" if is(i + 1, "crate") && is(i + 2, "self") => {
                found.extend(tokens.get(i + 3).cloned());
            }
            "crate" | "super" | "self" => {
                i = follow(tokens, i, file + modules.len(), &mut found);
                continue;
            }
            // In the library, only by `extern crate self`; the name is its own in any case.
            "poselight" if is(i + 1, "::") => {
                i = follow(tokens, i, 0, &mut found);
                continue;
            }
            _ => {}
        }
        i += 1;
    }
    found
}

/// Follows one path, or the tree of paths of a `use`, from a module `level` levels below the root;
/// returns the index after it.
fn follow(tokens: &[Token], start: usize, level: usize, found: &mut Vec<Token>) -> usize {
    let is = |i: usize, text: &str| tokens.get(i).is_some_and(|token| token.text == text);
    let (mut i, mut level) = (start, level);
    while let Some(token) = tokens.get(i) {
        match token.text.as_str() {
            "crate" => level = 0,
            "poselight" if i == start => level = 0,
            "super" => level = level.saturating_sub(1),
            "self" => {}
            "{" if i > start => {
                let end = closed(tokens, i);
                let mut inner = i + 1;
                while inner + 1 < end {
                    let next = follow(tokens, inner, level, found).min(end - 1);
                    let comma = tokens[next..end - 1].iter().position(|token| token.text == ",");
                    inner = comma.map_or(end, |comma| next + comma + 1);
                }
                return end;
            }
            _ => {
                if level == 0 {
                    found.push(token.clone());
                }
                // The tree below a name holds no root; what stands there is not of interest.
                return if is(i + 1, "::") && is(i + 2, "{") {
                    closed(tokens, i + 2)
                } else {
                    i + 1
                };
            }
        }
        if !is(i + 1, "::") {
            if level == 0 && is(i + 1, "as") {
                found.push(tokens[i + 1].clone());
            }
            return i + 1;
        }
        i += 2;
    }
    i
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
    let (code, test_lines) = without_tests(&tokens(text));
    for Token { text: word, line } in &code {
        for (rule, places) in PLACES {
            if word == rule && !places.iter().any(|place| path.starts_with(place)) {
                broken.push(format!("{path}:{line}: `{word}` does not belong here"));
            }
        }
    }
    if is_test_file {
        return broken;
    }
    if let Some(own) = own {
        for Token { text: used, line } in root_names(&code, path) {
            match rank(&used) {
                Some(other) if other >= own && used != folder => {
                    broken.push(format!("{path}:{line}: rank {own} uses `{used}` of rank {other}"));
                }
                None if used == "as" || used == "*" => {
                    broken
                        .push(format!("{path}:{line}: `{used}` hides what it takes of the crate"));
                }
                _ => {}
            }
        }
    }
    let lines = text.lines().count() - test_lines;
    // What a tool writes is as long as its interface.
    let is_generated = text.starts_with("// This file is @generated");
    if lines > MOST_LINES && !is_generated {
        broken.push(format!("{path}: {lines} lines without its tests, at most {MOST_LINES}"));
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
        (
            "num/mod.rs",
            "use crate::{\n    cli::Answer,\n    num,\n};",
            "mod.rs:2: rank 0 uses `cli`",
        ),
        ("num/mod.rs", "use crate::{num::{a, b::{c, d}}, cli::Answer};", "uses `cli`"),
        ("num/simd/avx.rs", "super::super::super::cli::run();", "uses `cli`"),
        ("num/mod.rs", "use super::{self::{bake::Ray}};", "uses `bake`"),
        ("num/mod.rs", "mod inner { use super::super::cli; }", "uses `cli`"),
        ("num/mod.rs", "mod a { mod b {} } use super::cli;", "uses `cli`"),
        ("num/mod.rs", "poselight::cli::run()", "uses `cli`"),
        ("num/mod.rs", "use ::poselight::{\ncli};", "uses `cli`"),
        ("num/mod.rs", "use crate as c;", "`as` hides"),
        ("num/mod.rs", "use crate::{self as c, sh};", "`as` hides"),
        ("num/mod.rs", "use super::*;", "`*` hides"),
        ("num/mod.rs", "extern crate self as c;", "`as` hides"),
        ("num/mod.rs", "if c == '\"' { crate::cli::run() }", "uses `cli`"),
        ("num/mod.rs", "let c = '\\''; crate::cli::run()", "uses `cli`"),
        ("num/mod.rs", "fn f<'a>(a: &'a str) { crate::cli::run('\"') }", "uses `cli`"),
        ("num/mod.rs", "let s = \"\\\"\"; unsafe { x() }", "`unsafe`"),
        ("num/mod.rs", "let s = r#\"\"\"#; unsafe { x() }", "`unsafe`"),
        ("num/mod.rs", "/* a /* b */ */ unsafe { x() }", "`unsafe`"),
        (
            "num/mod.rs",
            "#[cfg(test)]\nmod tests { fn f() {} }\nuse crate::cli;",
            "mod.rs:3: rank 0",
        ),
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
    let passes = [
        "/* unsafe { } /* gltf */\n crate::cli */",
        "let s = r#\"unsafe \" crate::cli\"#;",
        "let s = \"unsafe \\\" crate::cli\";\nlet b = b\"unsafe\";",
        "let s = \"two lines\n of unsafe\"; let c = '\"'; let d = \"unsafe\";",
        "#![deny(unsafe_code)]",
        "use super::super::super::num::{self, random as cli};",
        "use super::{*, cli};",
        "mod inner { use super::super::super::cli; }",
        "use crate::scene::{\n    cli as bake,\n};",
        "#[cfg(test)]\n#[expect(unused, reason = \"}\")]\nmod tests { use crate::cli; }",
    ];
    for text in passes {
        assert_eq!(violations("scene/gltf/mesh.rs", text), Vec::<String>::new(), "{text}");
    }
}
