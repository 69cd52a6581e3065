//! `poselight run`: bake, fit, measure and report in one.

use serde_json::json;

use crate::cli::args::RunArgs;
use crate::cli::{Answer, units};
use crate::pipeline::{self, Job, Watch};

pub(in crate::cli) fn run(args: &RunArgs, watch: &Watch) -> anyhow::Result<Answer> {
    let mut recipe = super::start(&args.recipe)?;
    args.poses.edit(&mut recipe);
    args.bake.edit(&mut recipe)?;
    args.fit.edit(&mut recipe);
    args.measure.edit(&mut recipe);
    let places = (args.scene.as_path(), args.output.as_path());
    let chosen = super::bake::choose_rays(args.bake.choose_rays, places, &mut recipe, watch)?;
    let mut job = Job::open(&args.scene, recipe)?;
    job.scene.notices.extend(chosen);
    if args.dry_run {
        pipeline::check_place(&job, &args.output.join(pipeline::DATASET))?;
        return Ok(super::bake::planned(&job, &pipeline::plan(&job)?, true));
    }
    let outcome = pipeline::run(&job, &args.output, watch)?;
    let figures = &outcome.figures;
    let mut text = super::bake::summary(&job, &outcome.baked);
    text += &format!(
        "\n  {} in the {} frame, {} ({}), fitted in {}; {:.0} µs a pose on one core",
        figures.model.family,
        figures.model.frame,
        units::bytes(figures.model.bytes),
        figures.model.precision,
        units::seconds(figures.times.fit_s),
        figures.times.evaluate_us,
    );
    let short = pipeline::reference_notice(&job.recipe.bake, job.checked.reference);
    for notice in figures.model.notices.iter().chain(&short) {
        text += &format!("\n  note: {notice}");
    }
    if !outcome.made {
        text += "\n  model and figures were there already";
    }
    text += &format!("\n{}", super::measure::table(&figures.measured));
    text += &super::measure::verdict(outcome.met, job.checked.reference.max_error);
    text += &format!("\n{}", args.output.join("report.html").display());
    let notices: Vec<String> = pipeline::notices(&job).into_iter().chain(short).collect();
    let json = json!({
        "output": args.output,
        "bake": super::bake::figures(&job, &outcome.baked),
        "figures": serde_json::to_value(figures)?,
        "notices": notices,
        "target_met": outcome.met,
    });
    let mut answer = Answer::new(text, json);
    answer.met = outcome.met;
    Ok(answer)
}
