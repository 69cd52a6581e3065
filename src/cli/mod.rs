//! Rank 16. The command line: arguments to recipe, progress, output.
//!
//! Every command gives one answer, printed as text or, with `--json`, as one JSON
//! object on stdout; progress and messages go to stderr. Exit status: 0 done, 1 failed, 2 usage,
//! 3 done but a stated target was not met, 130 stopped by a second Ctrl-C.

mod args;
mod bake_args;
mod check_args;
mod commands;
mod crowd_args;
mod effort_args;
mod files;
mod fit_args;
mod heights_args;
mod light_args;
mod light_source;
mod look_args;
mod picture_args;
mod rebind_args;
mod screen;
#[cfg(feature = "serve")]
mod serve_args;
#[cfg(feature = "serve")]
mod settings_file;
mod still_args;
mod subdivide_args;
mod subsurface;
mod surroundings;
mod units;

use std::ffi::OsString;
use std::io::Write;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use clap::{CommandFactory, FromArgMatches};

use crate::pipeline::{self, RecipeError, Watch};
use args::{Cli, Command};
use screen::Screen;

/// Set by the first Ctrl-C; every stage looks at it once per block of work.
static STOP: AtomicBool = AtomicBool::new(false);

/// What a command has to say.
struct Answer {
    /// For people.
    text: String,
    /// For programs.
    json: serde_json::Value,
    /// Whether every target that was stated is met.
    met: bool,
}

impl Answer {
    fn new(text: String, json: serde_json::Value) -> Self {
        Self { text, json, met: true }
    }
}

/// The command line's whole life, from the process's arguments to its exit status.
#[must_use]
pub fn main() -> ExitCode {
    let words: Vec<OsString> = std::env::args_os().collect();
    #[cfg(feature = "serve")]
    let words = settings_file::with_file(words);
    #[cfg(not(feature = "serve"))]
    let words: anyhow::Result<Vec<OsString>> = Ok(words);
    let words = match words {
        Ok(words) => words,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "error: {}", sentence(&error));
            return ExitCode::from(2);
        }
    };
    let cli = command().get_matches_from(words);
    let cli = Cli::from_arg_matches(&cli).unwrap_or_else(|error| error.exit());
    let json = cli.json;
    match start(cli) {
        Ok(answer) => {
            say(&if json { answer.json.to_string() } else { answer.text });
            ExitCode::from(if answer.met { 0 } else { 3 })
        }
        Err(error) => {
            let message = sentence(&error);
            if json {
                say(&serde_json::json!({ "error": message }).to_string());
            }
            let _ = writeln!(std::io::stderr(), "error: {message}");
            ExitCode::from(status(&error))
        }
    }
}

/// The command line as clap knows it. A number below zero is a value wherever one is expected: its range
/// is for the recipe to check, whose sentence names it.
fn command() -> clap::Command {
    let signed = |arg: clap::Arg| {
        let takes = arg.get_action().takes_values() && !arg.is_positional();
        if takes { arg.allow_negative_numbers(true) } else { arg }
    };
    let mut command = Cli::command();
    let names: Vec<String> = command.get_subcommands().map(|c| c.get_name().to_owned()).collect();
    for name in names {
        command = command.mut_subcommand(name, |sub| sub.mut_args(signed));
    }
    command
}

/// An error and its causes in one line. Many errors tell their cause in their own sentence; it is
/// not told twice.
fn sentence(error: &anyhow::Error) -> String {
    let mut sentence = String::new();
    for cause in error.chain() {
        let text = cause.to_string();
        if sentence.is_empty() {
            sentence = text;
        } else if !sentence.contains(&text) {
            sentence = format!("{sentence}: {text}");
        }
    }
    sentence
}

/// A recipe that cannot run is a matter of usage, everything else is a failure.
fn status(error: &anyhow::Error) -> u8 {
    let usage = error.chain().any(|cause| {
        cause.is::<RecipeError>()
            || cause.is::<commands::UnreadRecipe>()
            || cause.is::<commands::Usage>()
            || matches!(
                cause.downcast_ref(),
                Some(pipeline::Error::Recipe(_) | pipeline::Error::Effort { .. })
            )
    });
    if usage { 2 } else { 1 }
}

fn start(cli: Cli) -> anyhow::Result<Answer> {
    listen();
    log(&cli.command);
    let threads = usize::from(cli.threads.unwrap_or(0));
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .context("could not start the compute threads")?;
    let screen = Screen::default();
    let watch = Watch { report: &|progress| screen.show(progress), cancelled: &STOP };
    let answer = run(cli.command, &watch);
    screen.release();
    answer
}

fn run(command: Command, watch: &Watch) -> anyhow::Result<Answer> {
    match command {
        Command::Sample(args) => commands::sample(&args),
        Command::Inspect(args) => commands::inspect(&args),
        Command::Bake(args) => commands::bake(&args, watch),
        Command::Fit(args) => commands::fit(&args, watch),
        Command::Measure(args) => commands::measure(&args, watch),
        Command::Tradeoff(args) => commands::tradeoff(&args, watch),
        Command::Evaluate(args) => commands::evaluate(&args),
        Command::Run(args) => commands::run(&args, watch),
        Command::Check(args) => commands::check(&args, watch),
        Command::Apply(args) => commands::apply(&args),
        Command::Rebind(args) => commands::rebind(&args),
        Command::Brdf(args) => commands::brdf(&args),
        Command::Light(args) => commands::light(&args),
        Command::Still(args) => commands::still(&args),
        Command::Crowd(args) => commands::crowd(&args),
        Command::Heights(args) => commands::heights(&args),
        Command::Subdivide(args) => commands::subdivide(&args, watch),
        Command::Schema => commands::schema(),
        #[cfg(feature = "serve")]
        Command::Serve(args) => commands::serve(&args, &STOP),
        #[cfg(feature = "serve")]
        Command::Token(args) => commands::token(&args),
    }
}

/// The first Ctrl-C or SIGTERM stops at the next block, the second at once.
fn listen() {
    let handler = || {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        let _ = writeln!(std::io::stderr(), "\nstopping; a second Ctrl-C or SIGTERM stops at once");
    };
    // Without a handler Ctrl-C still ends the process, and what is committed stays sound.
    let _ = ctrlc::set_handler(handler);
}

/// Warnings of the stages go to stderr; a service writes one line for everything it does.
fn log(command: &Command) {
    let quiet = tracing_subscriber::fmt().with_writer(std::io::stderr).with_target(false);
    // A log that cannot be written, as on a full disk, is no reason to stop: to complain of it there
    // would panic.
    let quiet = quiet.log_internal_errors(false);
    // A second subscriber can only be one that a caller of the library has set.
    let _ = match command {
        #[cfg(feature = "serve")]
        Command::Serve(_) => quiet.with_max_level(tracing::Level::INFO).with_ansi(false).try_init(),
        _ => quiet.with_max_level(tracing::Level::WARN).without_time().try_init(),
    };
}

/// A reader that closed the pipe has heard enough.
fn say(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// A cause that the outer error already tells is told once; one that it keeps back is added.
    #[test]
    fn no_cause_is_told_twice() {
        let missing = Path::new("nothere.glb");
        let error: anyhow::Error =
            pipeline::files::read(missing, 1).expect_err("there is no such file").into();
        let told = sentence(&error.context("scene"));
        assert_eq!(told.matches("No such file").count(), 1, "{told}");
        assert!(told.starts_with("scene: "), "{told}");
    }

    /// Numbers below zero reach the check of what they are for, whose sentence names the range.
    #[test]
    fn negative_numbers_are_values() {
        command().debug_assert();
        let words = ["poselight", "bake", "a.glb", "-o", "b", "--fps", "-3"];
        let matches = command().try_get_matches_from(words).expect("parsed");
        let Command::Bake(args) = Cli::from_arg_matches(&matches).expect("read").command else {
            panic!("another command");
        };
        let mut recipe = pipeline::recipe::Recipe::default();
        args.poses.edit(&mut recipe);
        let error = pipeline::Checked::new(&recipe).expect_err("must be refused").to_string();
        assert!(error.contains("is -3; it must be 0.1 to 1000"), "{error}");
    }

    /// Only what the user wrote is a matter of usage: damaged JSON of ours is a failure.
    #[test]
    fn damage_is_not_usage() {
        let json = || serde_json::from_str::<u8>("{").expect_err("no number");
        assert_eq!(status(&json().into()), 1);
        let path = "recipe.json".into();
        assert_eq!(status(&commands::UnreadRecipe { path, source: json() }.into()), 2);
    }
}
