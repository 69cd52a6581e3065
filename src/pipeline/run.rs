//! All stages in one: a scene in, a measured model and its report out.

use std::path::Path;

use super::candidates::left_open;
use super::figures::{Figures, ModelFigures, Spectra, Story, Times};
use super::imported::Imported;
use super::measure::belongs;
use super::recipe::{ChooseName, OnName, Recipe};
use super::{
    Baked, Checked, Confirmed, Error, FittedModel, Job, ReferenceSettings, Trimmed, Watch, bake,
    bake_reference, choose, files, fit_watched, job_of, measure, report, timing,
};
use crate::dataset::Dataset;
use crate::fit::FitReport;
use crate::measure::{Measured, Split};
use crate::model::Model;

/// Name of the data set in the output folder.
pub const DATASET: &str = "dataset.zarr";
/// Name of the model's blob in the output folder.
pub const MODEL: &str = "model.safetensors";
/// Name of the figures in the output folder.
pub const FIGURES: &str = "figures.json";
/// Name of the report page in the output folder.
pub const REPORT: &str = "report.html";
/// Name of the resolved recipe in the output folder.
pub const RECIPE: &str = "recipe.json";

/// Bounds what is read back.
const MOST_FIGURES_BYTES: u64 = 256 << 20;

/// What a run came to.
#[derive(Debug)]
pub struct Outcome {
    /// What the bake did.
    pub baked: Baked,
    /// Everything that was measured.
    pub figures: Figures,
    /// Whether the stated target is met; true where none is stated.
    pub met: bool,
    /// Whether model and figures were made now, or were there under the same hash.
    pub made: bool,
}

/// Runs a job into a folder; what is there under the right hash is kept.
///
/// # Errors
/// [`Error::Cancelled`] and [`Error::Stopped`] when the caller asked to stop (the next run goes on
/// from what is baked), and what the stages object to.
pub fn run(job: &Job, folder: &Path, watch: &Watch) -> Result<Outcome, Error> {
    let settings = job.checked.reference;
    let baked = bake(job, &folder.join(DATASET), watch)?;
    let dataset = Dataset::open(&folder.join(DATASET))?;
    let earlier = earlier(folder);
    if let Some(figures) = earlier.clone().filter(|figures| is_finished(figures, job, folder)) {
        let met = is_met(&figures, settings);
        return Ok(Outcome { baked, figures, met, made: false });
    }
    if job.recipe.target.choose != ChooseName::Nothing {
        let Confirmed { found, trimmed, mut figures, blob, .. } = chosen(job, &dataset, watch)?;
        figures.times.tell_bake(&baked);
        let mut report = found.fitted.report;
        report.notices.extend(trimmed.as_ref().map(Trimmed::story));
        let model = (&Model::from_bytes(&blob)?, &report);
        return publish((job, &dataset), folder, (baked, figures, earlier), model);
    }
    let referenced = bake_reference(&dataset, settings, watch)?;
    let FittedModel { model: exact, report, fit_s } = fit_watched(&dataset, &job.recipe, watch)?;
    // What is measured is what ships: the model as its file gives it.
    let precision = job.checked.precision;
    let mut model = Model::from_bytes(&exact.to_bytes(precision)?)?;
    let story = Story { baked: Some(&baked), referenced: &referenced, report: &report, fit_s };
    let figures = assess((&mut model, &exact), &dataset, &job.recipe, &story, watch)?;
    publish((job, &dataset), folder, (baked, figures, earlier), (&model, &report))
}

/// The model that the recipe leaves open.
fn chosen(job: &Job, dataset: &Dataset, watch: &Watch) -> Result<Confirmed, Error> {
    let candidates = left_open(&job.recipe, dataset.header().layout.points);
    choose(dataset, &job.recipe, &candidates, watch)
}

/// Puts the results of a run into its folder.
fn publish(
    (job, dataset): (&Job, &Dataset),
    folder: &Path,
    (baked, mut figures, earlier): (Baked, Figures, Option<Figures>),
    (model, report): (&Model, &FitReport),
) -> Result<Outcome, Error> {
    if let Some(earlier) = &earlier {
        figures.take_times(earlier);
    }
    let blob = model.to_bytes(model.header().precision)?;
    let page = report::page(job, dataset, model, &figures, report, job.checked.reference);
    files::publish(&folder.join(RECIPE), &json("the recipe", &whole_recipe(job))?)?;
    files::publish(&folder.join(MODEL), &blob)?;
    files::publish(&folder.join(REPORT), page.as_bytes())?;
    files::publish(&folder.join(FIGURES), &json("the figures", &figures)?)?;
    let met = is_met(&figures, job.checked.reference);
    Ok(Outcome { baked, figures, met, made: true })
}

/// The recipe with the light that the pictures have, which no stage before them reads.
fn whole_recipe(job: &Job) -> Recipe {
    let light = job.lit.as_ref().map(|lit| lit.recipe.clone());
    Recipe { light, ..job.recipe.clone() }
}

/// A given model against its data set: figures and report page. References are baked into the data
/// set where it lacks them.
///
/// # Errors
/// As [`run`].
pub fn examine(
    model: &mut Model,
    dataset: &Dataset,
    recipe: &Recipe,
    watch: &Watch,
) -> Result<(Figures, String), Error> {
    let (figures, report) = examined(model, dataset, (recipe, recipe.target.on, None), watch)?;
    let settings = Checked::new(recipe)?.reference;
    let page = report::page(&job_of(dataset)?, dataset, model, &figures, &report, settings);
    Ok((figures, page))
}

/// [`examine`] on the motion that somebody asked for, without a page: what the fit tells of itself, with a
/// sentence more.
pub(super) fn examined(
    model: &mut Model,
    dataset: &Dataset,
    (recipe, on, note): (&Recipe, OnName, Option<String>),
    watch: &Watch,
) -> Result<(Figures, FitReport), Error> {
    let settings = Checked::new(recipe)?.reference;
    belongs(model, dataset)?;
    let referenced = bake_reference(dataset, settings, watch)?;
    // The blob does not carry the spectra and the search for α; the same fit finds them again.
    let FittedModel { model: exact, mut report, fit_s } = fit_watched(dataset, recipe, watch)?;
    report.notices.extend(note);
    let story = Story { baked: None, referenced: &referenced, report: &report, fit_s };
    let mut asked = recipe.clone();
    asked.target.on = on;
    let figures = assess((model, &exact), dataset, &asked, &story, watch)?;
    Ok((figures, report))
}

/// Measures a model, beside the same fit unquantised, and puts the errors into its header.
fn assess(
    (model, exact): (&mut Model, &Model),
    dataset: &Dataset,
    recipe: &Recipe,
    story: &Story,
    watch: &Watch,
) -> Result<Figures, Error> {
    let measured = measure((model, exact), dataset, recipe, watch)?;
    model.set_errors(super::figures::errors(&measured));
    let bytes = model.to_bytes(model.header().precision)?.len() as u64;
    let hashes = &model.header().provenance.hashes;
    let hash = |stage| hashes.get(stage).cloned().unwrap_or_default();
    Ok(Figures {
        fit_hash: hash("fit"),
        bake_hash: hash("bake"),
        model: ModelFigures::of(model, bytes, story.report),
        times: Times::new(story, &timing::evaluate(model, &Imported::new(dataset))?),
        spectra: Spectra::of(story.report),
        measured,
        choice: None,
    })
}

/// The figures of an earlier run into the folder.
fn earlier(folder: &Path) -> Option<Figures> {
    let bytes = files::read(&folder.join(FIGURES), MOST_FIGURES_BYTES).ok()?;
    serde_json::from_slice(&bytes).ok()
}

/// Whether the earlier figures are of the same job, and all its results are there.
fn is_finished(figures: &Figures, job: &Job, folder: &Path) -> bool {
    let model = files::read(&folder.join(MODEL), u64::MAX - 1).ok();
    let model = model.and_then(|bytes| Model::from_bytes(&bytes).ok());
    let own = &figures.fit_hash;
    let named = |model: Model| model.header().provenance.hashes.get("fit") == Some(own);
    // Another light makes other pictures.
    let written = files::read(&folder.join(RECIPE), MOST_FIGURES_BYTES).ok();
    let written = written.and_then(|bytes| Recipe::from_json(&bytes).ok());
    let lit = written.is_some_and(|recipe| recipe.light == whole_recipe(job).light);
    let whole = folder.join(REPORT).is_file() && lit;
    let asked = figures.choice.as_ref().map_or(own, |choice| &choice.asked);
    *asked == job.hashes.fit && whole && model.is_some_and(named)
}

/// Whether a stated target is met: where it chose the model, in validation too.
fn is_met(figures: &Figures, settings: ReferenceSettings) -> bool {
    let in_validation = figures.choice.as_ref().is_none_or(|choice| choice.met);
    in_validation && meets_target(&figures.measured, settings)
}

/// Whether the error on the motion that counts is within the target.
///
/// The split is the measurement's headline: novel clips where there are any, or of a model for the trained clips
/// what was held out between their frames. An error that cannot
/// be told from the references' noise meets every target.
#[must_use]
pub fn meets_target(measured: &Measured, settings: ReferenceSettings) -> bool {
    let Some(most) = settings.max_error else { return true };
    headline_rms(measured).is_none_or(|rms| rms <= f64::from(most))
}

/// The model's coefficient RMSE over the split that counts; `None` where noise swallows it.
pub(super) fn headline_rms(measured: &Measured) -> Option<f64> {
    let split = measured.headline.unwrap_or(Split::Training);
    let model = measured
        .split(split)
        .and_then(|split| split.candidates.iter().find(|c| c.name == measured.model));
    model.and_then(|model| model.coefficients.rms)
}

fn json(what: &str, value: &impl serde::Serialize) -> Result<Vec<u8>, Error> {
    serde_json::to_vec_pretty(value).map_err(|source| Error::Json { what: what.to_owned(), source })
}
