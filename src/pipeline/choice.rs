//! The model that a recipe's target asks for: chosen by validation on training clips, confirmed on
//! the motion that was held out.

use super::figures::ChoiceFigures;
use super::recipe::{Recipe, TargetRecipe};
use super::report::page;
use super::run::examined;
use super::trim::trim;
use super::{
    CandidateRecipe, Checked, Error, Figures, Hashes, Searched, Trimmed, VALIDATION, Watch, fit,
    job_of, meets_target, recipe_of, search,
};
use crate::choose::{Point, Remedy, Shares, Target, errors};
use crate::dataset::Dataset;
use crate::model::Model;

/// What was chosen, with its proof.
#[derive(Debug)]
pub struct Confirmed {
    /// The search, and the model that it ended with.
    pub found: Searched,
    /// What the model does without, where it can.
    pub trimmed: Option<Trimmed>,
    /// The model's file; the errors that were measured stand in its header.
    pub blob: Vec<u8>,
    /// What was measured on it.
    pub figures: Figures,
    /// The report page.
    pub page: String,
    /// Whether the target is met, by validation and on the motion that was held out.
    pub met: bool,
}

impl Confirmed {
    /// The point of choice, its error by validation.
    #[must_use]
    pub fn point(&self) -> &Point {
        &self.found.points[self.found.chosen]
    }
}

/// Whether a recipe's target leaves the choice of the model to the system.
#[must_use]
pub fn has_target(recipe: &Recipe) -> bool {
    target(recipe).is_any()
}

fn target(recipe: &Recipe) -> Target {
    let TargetRecipe { max_error, max_bytes, max_us, max_fit_s, .. } = recipe.target;
    Target { max_error: max_error.map(f64::from), max_bytes, max_us, max_fit_s }
}

/// Chooses the simplest of some candidates that meets the recipe's target, and measures it.
///
/// # Errors
/// As [`search`] and [`super::examine`].
pub fn choose(
    dataset: &Dataset,
    recipe: &Recipe,
    candidates: &[CandidateRecipe],
    watch: &Watch,
) -> Result<Confirmed, Error> {
    let mut found = search(dataset, candidates, &target(recipe), watch)?;
    let trimmed = trim(dataset, &found, &target(recipe), watch)?;
    if let Some(trimmed) = &trimmed {
        found.recipe.fit.without.clone_from(&trimmed.without);
        found.recipe.fit.bands = trimmed.bands;
        found.fitted = fit(dataset, &found.recipe)?;
        // The trials see some points only: of their errors the ratio counts.
        let [whole, trimmed] = trimmed.errors;
        found.worsen(trimmed / whole.max(f64::MIN_POSITIVE));
        found.reconsider(dataset, &target(recipe))?;
    }
    // The judge sees what is stored, not what was fitted.
    let mut model = Model::from_bytes(&found.fitted.model.to_bytes(found.precision)?)?;
    let note = trimmed.as_ref().map(Trimmed::story);
    let (mut figures, report) =
        examined(&mut model, dataset, (&found.recipe, recipe.target.on, note), watch)?;
    let confirmed = meets_target(&figures.measured, Checked::new(&found.recipe)?.reference);
    let blob = model.to_bytes(found.precision)?;
    let met = found.met && confirmed;
    figures.choice = Some(story(dataset, recipe, (&found, trimmed.as_ref()), met));
    let settings = Checked::new(&found.recipe)?.reference;
    let page = page(&job_of(dataset)?, dataset, &model, &figures, &report, settings);
    Ok(Confirmed { found, trimmed, blob, figures, page, met })
}

fn story(
    dataset: &Dataset,
    asked: &Recipe,
    (found, trimmed): (&Searched, Option<&Trimmed>),
    met: bool,
) -> ChoiceFigures {
    let scene = dataset.header().attributes.hashes.get("scene").cloned().unwrap_or_default();
    let point = &found.points[found.chosen];
    let (validation_largest, validation_rms) = errors(point, VALIDATION).unwrap_or_default();
    ChoiceFigures {
        asked: Hashes::of(&scene, asked).fit,
        name: point.name.clone(),
        candidates: found.tried,
        search_s: found.search_s,
        left_out: found.left_out.clone(),
        validation_rms,
        validation_largest,
        met: found.met,
        remedy: (!met).then(|| {
            let left_out = recipe_of(dataset).is_ok_and(|recipe| recipe.poses.most.is_some());
            advice(&target(asked), point, (&found.shares, left_out))
        }),
        trimmed: trimmed.map(Trimmed::story),
    }
}

/// What would help most where a target is missed: room for the cheapest that there is, or a better model.
fn advice(target: &Target, point: &Point, (shares, left_out): (&Shares, bool)) -> String {
    let bytes = target.max_bytes.filter(|&most| point.bytes > most);
    let us = target.max_us.filter(|&most| point.evaluate_us > most);
    let fit_s = target.max_fit_s.filter(|&most| point.fit_s > most);
    if let Some(most) = bytes {
        return format!("to allow {} bytes instead of {most}", point.bytes);
    }
    if let Some(most) = us {
        return format!("to allow {:.0} µs a pose instead of {most}", point.evaluate_us.ceil());
    }
    if let Some(most) = fit_s {
        let ms = [point.fit_s, most].map(|s| 1e3 * s);
        return format!("to allow {:.1} ms for the fit instead of {}", ms[0].max(0.1), ms[1]);
    }
    if let (Some(most), Some((largest, rms))) = (target.max_error, errors(point, VALIDATION))
        && rms <= most
        && most < largest
    {
        return format!(
            "more clips to train on: {rms:.5} is within the target, but the clips differ so much that \
             it may be up to {largest:.5}"
        );
    }
    let advice = shares.remedy().advice();
    match shares.remedy() {
        Remedy::MorePoses if left_out => {
            format!(
                "{advice}: first of all the training poses that a pilot or `poses.most` left out"
            )
        }
        _ => advice.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choose::SplitError;

    /// Where the error itself is within the target and only its uncertainty is not, more clips help; the largest
    /// error that it may be is told.
    #[test]
    fn an_uncertain_error_asks_for_clips() {
        let error = SplitError { rms: 0.05, mean_square_error: Some(0.01), ..Default::default() };
        let point = Point { errors: [(VALIDATION.to_owned(), error)].into(), ..Point::default() };
        let shares = Shares { noise: 1.0, bias: 0.0, coverage: 0.0 };
        let told = |most| {
            let target = Target { max_error: Some(most), ..Target::default() };
            advice(&target, &point, (&shares, false))
        };
        assert!(told(0.06).contains("more clips") && told(0.06).contains("up to 0.13766"));
        assert_eq!(told(0.04), shares.remedy().advice());
    }

    /// Where a cost is what is missed, more rays or richer models are no advice.
    #[test]
    fn a_missed_cost_asks_for_room() {
        let point = Point { bytes: 900, evaluate_us: 12.3, ..Point::default() };
        let shares = Shares { noise: 0.0, bias: 1.0, coverage: 0.0 };
        let told = |target: &Target| advice(target, &point, (&shares, true));
        let bytes = Target { max_bytes: Some(10), ..Target::default() };
        assert_eq!(told(&bytes), "to allow 900 bytes instead of 10");
        let us = Target { max_us: Some(1.0), max_bytes: Some(900), ..Target::default() };
        assert_eq!(told(&us), "to allow 13 µs a pose instead of 1");
        let error = Target { max_error: Some(0.1), ..Target::default() };
        assert_eq!(told(&error), shares.remedy().advice());
        let unseen = Shares { noise: 0.0, bias: 0.0, coverage: 1.0 };
        let of = |left_out| advice(&error, &point, (&unseen, left_out));
        assert_eq!(of(false), unseen.remedy().advice());
        assert!(of(true).starts_with(&of(false)) && of(true).contains("a pilot or `poses.most`"));
    }
}
