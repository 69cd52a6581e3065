//! Settings of the service from a file: one JSON object whose names are those of the flags. A flag
//! wins over an environment variable, and both over the file.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Arg, Command, CommandFactory};
use serde_json::Value;

use super::args::Cli;
use crate::pipeline::files;

/// A file with settings is text that a person writes.
const MOST_BYTES: u64 = 1 << 20;

/// The words of the command line with those that the file of `serve --config FILE` adds.
pub(super) fn with_file(words: Vec<OsString>) -> anyhow::Result<Vec<OsString>> {
    let command = Cli::command();
    let Some(serve) = subcommand(&command, &words) else { return Ok(words) };
    if words[serve] != "serve" {
        return Ok(words);
    }
    let Some(path) = named(&words[serve..]) else { return Ok(words) };
    let bytes = files::read(&path, MOST_BYTES)?;
    let settings: BTreeMap<String, Value> =
        serde_json::from_slice(&bytes).with_context(|| path.display().to_string())?;
    let serve_command = command.find_subcommand("serve").context("there is no `serve`")?;
    let known = settings_of(&command, serve_command);
    let mut out = words[..=serve].to_vec();
    for (name, value) in &settings {
        let word = word(&path, &known, name, value)?;
        // What is typed before `serve` wins over the file as well.
        let flag = format!("--{name}");
        let typed = words[1..serve].iter().filter_map(|word| word.to_str());
        let mut flags = typed.map(|word| word.split('=').next().unwrap_or(word));
        out.extend(word.filter(|_| !flags.any(|typed| typed == flag)));
    }
    out.extend_from_slice(&words[serve + 1..]);
    Ok(out)
}

/// What the file may set: the flags of `serve`, and the threads that every command has.
fn settings_of<'a>(command: &'a Command, serve: &'a Command) -> Vec<&'a Arg> {
    let threads = command.get_arguments().filter(|arg| arg.get_long() == Some("threads"));
    serve.get_arguments().chain(threads).collect()
}

/// Which word is the subcommand: the first that is neither a flag nor a flag's value.
fn subcommand(command: &Command, words: &[OsString]) -> Option<usize> {
    let takes_value = |word: &str| {
        let mut flags = command.get_arguments();
        let flag = flags.find(|arg| arg.get_long().is_some_and(|long| word == format!("--{long}")));
        flag.is_some_and(|arg| arg.get_action().takes_values())
    };
    let mut at = 1;
    loop {
        let word = words.get(at)?;
        let Some(text) = word.to_str().filter(|word| word.starts_with('-')) else {
            return Some(at);
        };
        at += if takes_value(text) { 2 } else { 1 };
    }
}

/// The file that is named, by flag or by environment.
fn named(words: &[OsString]) -> Option<PathBuf> {
    let mut words = words.iter();
    while let Some(word) = words.next() {
        if word == "--config" {
            return words.next().map(PathBuf::from);
        }
        if let Some(path) = word.to_str().and_then(|word| word.strip_prefix("--config=")) {
            return Some(path.into());
        }
    }
    std::env::var_os("POSELIGHT_CONFIG").map(PathBuf::from)
}

/// A setting as a flag; none where the environment has it.
fn word(
    path: &Path,
    known: &[&Arg],
    name: &str,
    value: &Value,
) -> anyhow::Result<Option<OsString>> {
    let own = |arg: &&&Arg| arg.get_long() == Some(name) && !["config", "check"].contains(&name);
    let Some(arg) = known.iter().find(own) else {
        bail!(
            "{}: there is no setting `{name}`; `poselight serve --help` lists them",
            path.display()
        )
    };
    if arg.get_env().is_some_and(|variable| std::env::var_os(variable).is_some()) {
        return Ok(None);
    }
    let text = match value {
        Value::Bool(true) => return Ok(Some(format!("--{name}").into())),
        Value::Bool(false) => return Ok(None),
        Value::String(text) => text.clone(),
        Value::Number(number) => number.to_string(),
        other => bail!("{}: `{name}` is {other}; text, a number or true", path.display()),
    };
    Ok(Some(format!("--{name}={text}").into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(file: &str, rest: &[&str]) -> anyhow::Result<Vec<String>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("settings.json");
        std::fs::write(&path, file)?;
        let mut words: Vec<OsString> = vec!["poselight".into(), "serve".into(), "--config".into()];
        words.push(path.into());
        words.extend(rest.iter().map(OsString::from));
        let words = with_file(words)?;
        Ok(words.iter().map(|word| word.to_string_lossy().into_owned()).collect())
    }

    /// Every setting of the service is a flag, an environment variable and a name in the file, and
    /// `--help` says what it is.
    #[test]
    fn each_setting_has_three_ways() {
        let command = Cli::command();
        let serve = command.find_subcommand("serve").expect("a command");
        let known = settings_of(&command, serve);
        assert!(known.iter().any(|arg| arg.get_long() == Some("threads")));
        let path = Path::new("settings.json");
        let settings = known
            .iter()
            .filter(|arg| !["config", "check", "help"].contains(&arg.get_id().as_str()));
        for arg in settings {
            let name = arg.get_long().expect("a flag");
            let variable = format!("POSELIGHT_{}", name.replace('-', "_").to_uppercase());
            let own = arg.get_env().and_then(|own| own.to_str()).expect(name);
            assert!(own.starts_with(&variable), "{name}: {own}");
            assert!(arg.get_help().is_some(), "{name} is not explained");
            let switch = !arg.get_action().takes_values();
            let value = if switch { Value::Bool(true) } else { Value::from(1) };
            let flag = word(path, &known, name, &value).expect(name).expect("a flag");
            assert!(flag.to_string_lossy().starts_with(&format!("--{name}")), "{flag:?}");
        }
    }

    /// What the file says comes before what is typed, so that the latter wins; what is no setting is
    /// named.
    #[test]
    fn the_file_comes_first() {
        let words =
            with(r#"{"jobs": 2, "webhook-private": true}"#, &["--jobs", "3"]).expect("read");
        assert_eq!(words[2..4], ["--jobs=2", "--webhook-private"]);
        assert_eq!(words[words.len() - 2..], ["--jobs", "3"]);
        let words = with(r#"{"threads": 2}"#, &["--threads", "3"]).expect("read");
        assert_eq!(
            (words[2].as_str(), &words[words.len() - 2..]),
            ("--threads=2", &["--threads".to_owned(), "3".to_owned()][..])
        );
        for bad in [r#"{"job": 2}"#, r#"{"jobs": []}"#, r#"{"config": "x"}"#, "[]", "{"] {
            assert!(with(bad, &[]).is_err(), "{bad}");
        }
        // Of what stands before `serve` too.
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("settings.json");
        std::fs::write(&path, r#"{"threads": 2, "jobs": 4}"#).expect("written");
        for threads in ["--threads 5", "--threads=5"] {
            let words = format!("poselight {threads} serve --config {}", path.display());
            let words = with_file(words.split(' ').map(OsString::from).collect()).expect("read");
            assert!(words.contains(&"--jobs=4".into()) && !words.contains(&"--threads=2".into()));
        }
        // A word `serve` that is no subcommand has no settings; a flag before one that is has.
        for other in [
            "poselight bake",
            "poselight inspect serve --config nowhere.json",
            "poselight --threads 2 token create serve --config nowhere.json",
            "poselight --json",
        ] {
            let other: Vec<OsString> = other.split(' ').map(OsString::from).collect();
            assert_eq!(with_file(other.clone()).expect("untouched"), other);
        }
        for flags in ["--json", "--threads 2", "--threads=2 --json"] {
            let words = format!("poselight {flags} serve --config nowhere.json");
            let words: Vec<OsString> = words.split(' ').map(OsString::from).collect();
            assert!(with_file(words).is_err(), "{flags}: the file is not looked for");
        }
    }
}
