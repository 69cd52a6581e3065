//! `poselight run`: bake, fit, measure and report in one.

use serde_json::json;

use super::Usage;
use crate::cli::args::RunArgs;
use crate::cli::{Answer, units};
use crate::pipeline::recipe::{ChooseName, FitRecipe, Recipe};
use crate::pipeline::{self, Dataset, Job, Watch};

pub(in crate::cli) fn run(args: &RunArgs, watch: &Watch) -> anyhow::Result<Answer> {
    let mut recipe = super::start(&args.recipe)?;
    args.poses.edit(&mut recipe);
    args.bake.edit(&mut recipe)?;
    args.fit.edit(&mut recipe);
    args.measure.edit(&mut recipe);
    args.limits.edit(&mut recipe);
    args.pictures.edit(&mut recipe);
    args.refine.edit(&mut recipe);
    leave_open(args, &mut recipe)?;
    let places = (args.scene.as_path(), args.output.as_path());
    let chosen = super::bake::choose_rays(args.bake.choose_rays, places, &mut recipe, watch)?;
    let job = Job::open(&args.scene, recipe)?;
    pipeline::effective_parametrisation(args.poses.parametrisation(), job.scene.is_sequence)?;
    let place = args.output.join(pipeline::REFINED);
    if args.dry_run {
        let mut job = super::bake::as_refined(job, &place)?;
        job.scene.notices.extend(chosen);
        super::bake::check_place(&job, &args.output.join(pipeline::DATASET))?;
        return Ok(super::bake::planned(&job, &pipeline::plan(&job)?, true));
    }
    let mut job = pipeline::refined(job, &place, watch)?;
    job.scene.notices.extend(chosen);
    let outcome = pipeline::run(&job, &args.output, watch)?;
    let spent = pipeline::spent(&Dataset::open(&args.output.join(pipeline::DATASET))?)?;
    let missed = spent.and_then(|spent| spent.missed);
    job.scene.notices.extend(missed.map(|missed| missed.story()));
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
    if let Some(choice) = &figures.choice {
        text += &format!("\n{}", super::fit::story(choice, figures, outcome.met));
    }
    if !outcome.made {
        text += "\n  model and figures were there already";
    }
    text += &format!("\n{}", super::measure::table(figures));
    let reached = pipeline::meets_target(&figures.measured, job.checked.reference);
    text += &super::measure::verdict(outcome.met, reached, job.checked.reference.max_error);
    if let Some(remedy) = figures.choice.as_ref().and_then(|choice| choice.remedy.as_ref()) {
        text += &format!("\n  the target is not met; what would help most: {remedy}");
    }
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

/// A target that is stated here chooses the model, where nothing but its family is said.
fn leave_open(args: &RunArgs, recipe: &mut Recipe) -> anyhow::Result<()> {
    let limit = args.limits.given();
    if limit.is_none() && !args.measure.states_target() {
        return Ok(());
    }
    let said = args.fit.chosen_flag().map(|flag| format!("{flag} says"));
    let said = said.or_else(|| {
        let family = match args.fit.names_family() {
            true => recipe.fit.family,
            false => FitRecipe::default().family,
        };
        let FitRecipe { seed, include_rest, .. } = recipe.fit;
        let open = FitRecipe { family, seed, include_rest, ..FitRecipe::default() };
        (recipe.fit != open).then(|| "the recipe's `fit` says".to_owned())
    });
    recipe.target.choose = match (said, limit) {
        (Some(said), Some(limit)) => {
            let told = format!("{limit} chooses the model, but {said} which it is: leave one out");
            return Err(Usage(told).into());
        }
        // A model that is said is judged.
        (Some(_), None) => ChooseName::Nothing,
        (None, _) if args.fit.names_family() => ChooseName::Sizes,
        (None, _) => ChooseName::Any,
    };
    Ok(())
}
