//! `poselight fit`: a model from a data set.

use serde_json::json;

use super::Usage;
use crate::cli::args::FitCommandArgs;
use crate::cli::{Answer, units};
use crate::dataset::Dataset;
use crate::model::Model;
use crate::pipeline::recipe::{FitRecipe, Recipe};
use crate::pipeline::{
    self, Checked, ChoiceFigures, Confirmed, Figures, FittedModel, Range, Watch, files,
};

pub(in crate::cli) fn fit(args: &FitCommandArgs, watch: &Watch) -> anyhow::Result<Answer> {
    super::named(&args.output, "safetensors")?;
    super::keep_apart(&[("data set", &args.dataset)], &[("the output", &args.output)])?;
    let dataset = Dataset::open(&args.dataset)?;
    let mut recipe = pipeline::recipe_of(&dataset)?;
    args.edit(&mut recipe);
    if let Some(stated) = args.parametrisation() {
        let is_sequence = pipeline::job_of(&dataset)?.scene.is_sequence;
        pipeline::effective_parametrisation(Some(stated), is_sequence)?;
    }
    let checked = Checked::new(&recipe)?;
    if chooses(args, &recipe)? {
        return choose(args, &dataset, &recipe, watch);
    }
    let fitted = pipeline::fit_watched(&dataset, &recipe, watch)?;
    let blob = fitted.model.to_bytes(checked.precision)?;
    files::publish(&args.output, &blob)?;
    let mut text = format!(
        "{}\n{}",
        args.output.display(),
        describe(&fitted.model, blob.len() as u64, fitted.fit_s)
    );
    for notice in &fitted.report.notices {
        text += &format!("\n  note: {notice}");
    }
    let json = json!({ "model": args.output, "fit": figures(&fitted, blob.len() as u64) });
    Ok(Answer::new(text, json))
}

/// Whether the target chooses the model; refuses flags that then, or else, change nothing.
///
/// A target that only the data set's recipe states gives way to a model that the command line names.
fn chooses(args: &FitCommandArgs, recipe: &Recipe) -> anyhow::Result<bool> {
    if let Some(flag) = args.chosen_flag().filter(|_| args.states_target()) {
        let told = format!(
            "{flag} changes nothing where a target chooses the model; of the model only --family \
             and --include-rest can be said then"
        );
        return Err(Usage(told).into());
    }
    if pipeline::has_target(recipe) && !args.names_model() {
        refuse_rest_in_vain(args, recipe)?;
        return Ok(true);
    }
    pipeline::effective_fit(recipe).map_err(pipeline::Error::from)?;
    if let Some(flag) = args.measures_in_vain() {
        let told = format!(
            "{flag} says how a model is measured, and without a target (--max-error, --max-bytes, \
             --max-us, --max-fit-s) this fit measures none; `poselight measure` takes it"
        );
        return Err(Usage(told).into());
    }
    Ok(false)
}

/// A family of which no candidate looks at the mesh carries none.
fn refuse_rest_in_vain(args: &FitCommandArgs, recipe: &Recipe) -> Result<(), pipeline::Error> {
    if !args.names_family() {
        return Ok(());
    }
    let FitRecipe { family, include_rest, .. } = recipe.fit;
    let fit = FitRecipe { family, include_rest, ..FitRecipe::default() };
    Ok(pipeline::effective_fit(&Recipe { fit, ..recipe.clone() })?)
}

/// The simplest model that meets the target by validation on training clips, confirmed on the
/// motion that was held out.
fn choose(
    args: &FitCommandArgs,
    dataset: &Dataset,
    recipe: &Recipe,
    watch: &Watch,
) -> anyhow::Result<Answer> {
    let points = dataset.header().layout.points;
    let mut candidates = pipeline::candidates(recipe, points, Range::Quick);
    if args.names_family() {
        candidates.retain(|c| c.recipe.fit.family == recipe.fit.family);
    }
    let chosen = pipeline::choose(dataset, recipe, &candidates, watch)?;
    files::publish(&args.output, &chosen.blob)?;
    let Confirmed { found, figures, met, .. } = &chosen;
    let remedy = figures.choice.as_ref().and_then(|choice| choice.remedy.as_ref());
    let mut text = args.output.display().to_string();
    if let Some(choice) = &figures.choice {
        text += &format!("\n{}", story(choice, figures, *met));
        if let Some(trimmed) = &choice.trimmed {
            text += &format!("\n  {trimmed}");
        }
    }
    text += &format!("\n{}", super::measure::table(figures));
    if let Some(remedy) = remedy {
        text += &format!("\n  the target is not met; what would help most: {remedy}");
    }
    let json = json!({
        "model": args.output,
        "chosen": chosen.point(),
        "met_in_validation": found.met,
        "met": met,
        "left_out": found.left_out,
        "shares": found.shares,
        "remedy": remedy,
        "trimmed": chosen.trimmed,
        "search_s": found.search_s,
        "points": found.points,
        "estimates": found.estimates,
        "figures": figures,
    });
    let mut answer = Answer::new(text, json);
    answer.met = *met;
    Ok(answer)
}

/// What was looked at, and what was taken of it.
pub(super) fn story(choice: &ChoiceFigures, figures: &Figures, met: bool) -> String {
    format!(
        "  {} of {} candidates in {}: {}, {} µs a pose; RMSE {:.5} (up to {:.5} in truth) leaving out {}",
        if met { "the simplest that meets the target" } else { "the best that was reached" },
        choice.candidates,
        units::seconds(choice.search_s),
        choice.name,
        figures.times.evaluate_us.round(),
        choice.validation_rms,
        choice.validation_largest,
        choice.left_out,
    )
}

/// A fitted model in a line.
pub(super) fn describe(model: &Model, bytes: u64, fit_s: f64) -> String {
    let header = model.header();
    format!(
        "  {} in the {} frame, {} ({}), fitted in {}",
        model.kind(),
        header.frame,
        units::bytes(bytes),
        header.precision,
        units::seconds(fit_s)
    )
}

/// A fit, for programs.
pub(super) fn figures(fitted: &FittedModel, bytes: u64) -> serde_json::Value {
    let header = fitted.model.header();
    json!({
        "family": fitted.model.kind(),
        "notices": fitted.report.notices,
        "frame": header.frame.name(),
        "bytes": bytes,
        "parameters": header.parameters(),
        "alpha": fitted.report.alpha,
        "fit_s": fitted.fit_s,
    })
}
