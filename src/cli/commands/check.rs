//! `poselight check`: a scene's figures beside approved ones.

use anyhow::Context;
use serde_json::json;

use crate::cli::Answer;
use crate::cli::check_args::CheckArgs;
use crate::pipeline::{self, Baseline, Job, Line, Watch, files};

/// A baseline is a recipe and some dozens of numbers.
const MOST_BASELINE_BYTES: u64 = 1 << 20;

pub(in crate::cli) fn check(args: &CheckArgs, watch: &Watch) -> anyhow::Result<Answer> {
    if args.approve {
        return approve(args, watch);
    }
    let bytes = files::read(&args.baseline, MOST_BASELINE_BYTES)?;
    let baseline = Baseline::read(&bytes).with_context(|| args.baseline.display().to_string())?;
    let job = Job::open(&args.scene, baseline.recipe.clone())?;
    let (job, outcome) = run(args, job, watch)?;
    let lines = baseline.compare(&outcome.figures, f64::from(args.tolerance) / 100.0);
    let name = &job.recipe.scene.file;
    if let Some(path) = &args.junit {
        files::publish(path, pipeline::junit(name, &lines).as_bytes())?;
    }
    if let Some(path) = &args.page {
        files::publish(path, pipeline::page(name, &lines).as_bytes())?;
    }
    let met = lines.iter().all(|line| line.passes);
    let changed = baseline.recipe.scene.sha256 != job.recipe.scene.sha256;
    let mut answer = Answer::new(
        text(&lines, changed),
        json!({ "passes": met, "scene_changed": changed, "figures": lines }),
    );
    answer.met = met;
    Ok(answer)
}

/// Runs the scene and writes down what it came to as what is approved.
fn approve(args: &CheckArgs, watch: &Watch) -> anyhow::Result<Answer> {
    let job = Job::open(&args.scene, super::start(&args.recipe)?)?;
    let (job, outcome) = run(args, job, watch)?;
    let baseline = Baseline::of(&job.recipe, &outcome.figures);
    files::publish(&args.baseline, &serde_json::to_vec_pretty(&baseline)?)?;
    let text = format!("{}: {} figures", args.baseline.display(), baseline.figures.len());
    Ok(Answer::new(text, json!({ "baseline": args.baseline, "figures": baseline.figures })))
}

fn run(args: &CheckArgs, job: Job, watch: &Watch) -> anyhow::Result<(Job, pipeline::Outcome)> {
    let folder = tempfile::tempdir().context("no temporary folder")?;
    let output = args.output.as_deref().unwrap_or(folder.path());
    let job = pipeline::refined(job, &output.join(pipeline::REFINED), watch)?;
    let outcome = pipeline::run(&job, output, watch)?;
    Ok((job, outcome))
}

fn text(lines: &[Line], changed: bool) -> String {
    let number = |value: Option<f64>| match value {
        None => "-".to_owned(),
        Some(whole) if whole.abs() >= 100.0 => format!("{whole:.0}"),
        Some(value) => format!("{value:.5}"),
    };
    let mut text =
        String::from("figure                                        approved           now");
    for line in lines {
        text += &format!(
            "\n{:<40} {:>13} {:>13}   {}",
            line.name,
            number(line.approved),
            number(line.found),
            if line.passes { "" } else { "WORSE" }
        );
    }
    if changed {
        text += "\nthe scene has changed since";
    }
    let worse = lines.iter().filter(|line| !line.passes).count();
    match worse {
        0 => text + "\nnothing is worse than what was approved",
        _ => format!("{text}\n{worse} of {} figures are worse than what was approved", lines.len()),
    }
}
