//! The choice by target: candidates are judged on training clips that their fit did not see, the
//! simplest that meets the target is fitted again to all of them.
//!
//! Two rounds: all candidates at some of the points, where fits share what they have in common
//! ([`super::workbench`]), then the best of them, one after another until one meets the target; where the first
//! round leaves a doubt of that, one group of what is left out at all points says how far off its estimates are.
//! [`exhaustive`] fits every candidate to all points and leaves every group out, which a search is measured against.
//!
//! *Invariant:* held-out clips have no say; they only confirm what was chosen.

mod dropping;
mod entry;
mod folds;

use std::time::Instant;

use super::candidates::CandidateRecipe;
use super::figures::longest_errors;
use super::imported::Imported;
use super::progress::Watch;
use super::recipe::{FamilyName, PrecisionName, Recipe};
use super::validation::Validation;
use super::workbench::Workbench;
use super::{Error, FittedModel, fit, timing};
use crate::choose::{Choice, Point, Shares, Target, decide, is_doubtful};
use crate::dataset::Dataset;
use crate::model::Precision;
use dropping::drop_hopeless;
use entry::{Count, Entry, best, entries};
pub(super) use folds::{folds, leaves_poses};

/// The split of the points of a search.
pub const VALIDATION: &str = "validation";

/// Candidates of the second round, at most, ...
const FINALISTS: usize = 4;
/// ... and those before them of which it is not clear whether they meet an error.
const PERHAPS: usize = 2;

/// What a search found.
#[derive(Debug)]
pub struct Searched {
    /// The candidates of the second round in every precision, their error under [`VALIDATION`].
    pub points: Vec<Point>,
    /// The other candidates that were looked at to the end, their sizes, times and errors
    /// estimated from some of the points.
    pub estimates: Vec<Point>,
    /// Candidates that were tried, in every precision; those without hope not to the end.
    pub tried: usize,
    /// Index of the point of choice.
    pub chosen: usize,
    /// Whether it meets the target on the validation poses.
    pub met: bool,
    /// Where its mean square error comes from.
    pub shares: Shares,
    /// The model of choice, fitted to all training poses.
    pub fitted: FittedModel,
    /// The recipe that makes it.
    pub recipe: Recipe,
    /// How it is stored.
    pub precision: Precision,
    /// What was left out in turn, in words.
    pub left_out: String,
    /// Wall time, seconds.
    pub search_s: f64,
}

/// Chooses among candidates.
///
/// # Errors
/// [`Error::Stopped`], [`Error::NothingToChoose`] where no candidate can be fitted; what the
/// stages object to.
pub fn search(
    dataset: &Dataset,
    candidates: &[CandidateRecipe],
    target: &Target,
    watch: &Watch,
) -> Result<Searched, Error> {
    let start = Instant::now();
    let bench = Workbench::new(dataset, candidates)?.timing(target.max_fit_s.is_some());
    let (folds, left_out) = folds(bench.clips(), leaves_poses(candidates));
    let mut entries = entries(candidates);
    if folds.iter().all(Vec::is_empty) {
        // Of one pose all models are its values.
        entries.retain(|entry| entry.candidate.recipe.fit.family == FamilyName::Mean);
    }
    let tried = entries.len() * Precision::ALL.len();
    let mut count = Count::new(start, (entries.len() * folds.len()) as u64);
    let room = with_room(target, dataset);
    for (index, fold) in folds.iter().enumerate() {
        let without = bench.without(fold);
        for entry in &mut entries {
            entry.take(without.try_out(entry.candidate), watch, &mut count)?;
        }
        entries.retain(|entry| entry.squares.len() == index + 1);
        if index + 1 < folds.len() {
            drop_hopeless(&mut entries, &room, folds.len());
        }
    }
    drop(bench);
    entries.iter_mut().for_each(Entry::hold);
    let tops = finalists(&entries, &room);
    let finalists: Vec<CandidateRecipe> =
        tops.iter().map(|&(entry, _)| entries[entry].reaching()).collect();
    let validation = Validation::new(dataset)?;
    let (mut found, mut settled): (Option<Searched>, Vec<Entry<'_>>) = (None, Vec::new());
    for (finalist, (at, top)) in finalists.iter().zip(&tops) {
        let mut entry = entries[*at].of(finalist);
        let is_doubtful = is_doubtful(top, VALIDATION, &room);
        if is_doubtful && !entry.correct(&validation, &folds, watch, &mut count)? {
            continue;
        }
        settled.push(entry);
        if let Some(Choice::Met(_)) = decided(&settled, target) {
            found = conclude((dataset, target, start), &mut settled)?;
        }
        // What clearly misses leaves nothing to those behind it.
        let missed = !matches!(decide_one(top, &room), Some(Choice::Met(_)));
        if found.as_ref().is_some_and(|found| found.met) || missed && !is_doubtful {
            break;
        }
    }
    if found.as_ref().is_none_or(|found| !found.met) {
        found = conclude((dataset, target, start), &mut settled)?;
    }
    let found = found.ok_or_else(|| count.nothing())?;
    let is_settled = |name: &str| settled.iter().any(|entry| entry.candidate.name == name);
    let others = entries.iter().filter(|entry| !is_settled(&entry.candidate.name));
    let estimates = others.flat_map(Entry::finished).collect();
    Ok(Searched { estimates, tried, left_out, ..found })
}

/// Those that come into question, one after another, with the point that the target would choose: first what is
/// cheaper and may perhaps meet its error, too.
fn finalists(entries: &[Entry<'_>], target: &Target) -> Vec<(usize, Point)> {
    let mut all = best(entries, &target.perhaps(), PERHAPS);
    for top in best(entries, target, FINALISTS) {
        if all.iter().all(|(entry, _)| *entry != top.0) {
            all.push(top);
        }
    }
    all
}

fn decided(entries: &[Entry<'_>], target: &Target) -> Option<Choice> {
    let points: Vec<Point> = entries.iter().flat_map(Entry::finished).collect();
    decide(&points, VALIDATION, target)
}

fn decide_one(point: &Point, target: &Target) -> Option<Choice> {
    decide(std::slice::from_ref(point), VALIDATION, target)
}

/// A target with room for the errors that are measured on a model, which its file tells.
fn with_room(target: &Target, dataset: &Dataset) -> Target {
    let told = longest_errors(dataset).len() as u64;
    Target { max_bytes: target.max_bytes.map(|most| most.saturating_sub(told)), ..*target }
}

/// Every candidate fitted to all points without each group of clips: the points in every
/// precision, and the wall time, seconds. What [`search`] estimates.
///
/// # Errors
/// As [`search`].
pub fn exhaustive(
    dataset: &Dataset,
    candidates: &[CandidateRecipe],
    watch: &Watch,
) -> Result<(Vec<Point>, f64), Error> {
    let start = Instant::now();
    let validation = Validation::new(dataset)?;
    let (folds, _) = folds(&validation.clips, leaves_poses(candidates));
    let mut entries = entries(candidates);
    let mut count = Count::new(start, (entries.len() * folds.len()) as u64);
    for (index, fold) in folds.iter().enumerate() {
        for entry in &mut entries {
            let time = entry.points.first().map(|point| point.evaluate_us);
            entry.take(validation.try_out(entry.candidate, fold, time), watch, &mut count)?;
        }
        entries.retain(|entry| entry.squares.len() == index + 1);
    }
    let points = entries.iter().flat_map(Entry::finished).collect();
    Ok((points, start.elapsed().as_secs_f64()))
}

/// The decision, and the fit to everything; where that costs more than it seemed to, what is next. `None`
/// where nothing is settled.
fn conclude(
    (dataset, target, start): (&Dataset, &Target, Instant),
    entries: &mut [Entry<'_>],
) -> Result<Option<Searched>, Error> {
    loop {
        let points: Vec<Point> = entries.iter().flat_map(Entry::finished).collect();
        let (chosen, met) = match decide(&points, VALIDATION, target) {
            None => return Ok(None),
            Some(Choice::Met(chosen)) => (chosen, true),
            Some(Choice::Missed(chosen)) => (chosen, false),
        };
        let mut places = (0..).zip(&*entries).flat_map(|(at, entry): (usize, &Entry<'_>)| {
            (0..entry.points.len()).map(move |point| (at, point))
        });
        let (at, point) = places.nth(chosen).expect("a point of an entry");
        let mut found = fitted(dataset, entries[at].candidate, (points, chosen))?;
        found.reconsider(dataset, target)?;
        if found.met || !met {
            found.search_s = start.elapsed().as_secs_f64();
            return Ok(Some(found));
        }
        entries[at].points[point].take_costs(&found.points[chosen]);
    }
}

/// A candidate fitted to everything, as one of its points stores it.
fn fitted(
    dataset: &Dataset,
    candidate: &CandidateRecipe,
    (points, chosen): (Vec<Point>, usize),
) -> Result<Searched, Error> {
    let precision = Precision::from_name(&points[chosen].precision).unwrap_or(Precision::F32);
    let mut recipe = candidate.recipe.clone();
    recipe.output.precision = match precision {
        Precision::F32 => PrecisionName::F32,
        Precision::F16 => PrecisionName::F16,
        Precision::I8 => PrecisionName::I8,
    };
    let fitted = fit(dataset, &recipe)?;
    let square = points[chosen].errors.get(VALIDATION).map_or(0.0, |error| error.rms.powi(2));
    let shares = shares(dataset, &fitted, square)?;
    Ok(Searched {
        points,
        estimates: Vec::new(),
        tried: 0,
        chosen,
        met: false,
        shares,
        fitted,
        recipe,
        precision,
        left_out: String::new(),
        search_s: 0.0,
    })
}

impl Searched {
    /// Takes it into account that the model of choice errs so many times as much as what was tried.
    pub(super) fn worsen(&mut self, times: f64) {
        if let Some(error) = self.points[self.chosen].errors.get_mut(VALIDATION) {
            error.rms *= times;
            error.mean_square_error = error.mean_square_error.map(|e| e * times * times);
        }
    }

    /// The verdict on the point of choice, with the bytes of its model itself and of the errors that will be told in
    /// it where an estimate stood, and its times where the target bounds them.
    pub(super) fn reconsider(&mut self, dataset: &Dataset, target: &Target) -> Result<(), Error> {
        let point = &mut self.points[self.chosen];
        let model = &self.fitted.model;
        let told = longest_errors(dataset).len() as u64;
        point.bytes = model.to_bytes(self.precision)?.len() as u64 + told;
        if target.max_us.is_some() {
            point.evaluate_us = timing::evaluate(model, &Imported::new(dataset))?.all_us;
        }
        if target.max_fit_s.is_some() {
            point.fit_s = self.fitted.fit_s;
        }
        self.met = matches!(decide_one(point, target), Some(Choice::Met(_)));
        Ok(())
    }
}

/// Splits the mean square error: what noise leaves in so many degrees of freedom, what the fit
/// misses on its own poses, and the rest.
fn shares(dataset: &Dataset, fitted: &FittedModel, square: f64) -> Result<Shares, Error> {
    let training = dataset.training()?;
    let noise_variance = training.noise_variance();
    let report = &fitted.report;
    let freedom = (report.degrees_of_freedom.max(1.0) / training.poses() as f64).min(1.0);
    let noise = noise_variance * freedom;
    let bias = (report.training_rmse.powi(2) - noise_variance * (1.0 - freedom)).max(0.0);
    Ok(Shares { noise, bias, coverage: (square - bias - noise).max(0.0) })
}

#[cfg(test)]
#[path = "search_tests.rs"]
mod tests;
