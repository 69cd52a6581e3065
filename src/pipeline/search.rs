//! The choice by target: candidates are judged on training clips that their fit did not see, the
//! simplest that meets the target is fitted again to all of them.
//!
//! Two rounds: all candidates at some of the points, where fits share what they have in common
//! ([`super::workbench`]), then, where the first leaves a doubt whether the target is met, the best of them at
//! all points, one after another until one meets it. [`exhaustive`] is the second round for all, which the
//! first is measured against.
//!
//! *Invariant:* held-out clips have no say; they only confirm what was chosen.

mod dropping;

use std::time::Instant;

use super::candidates::CandidateRecipe;
use super::imported::Imported;
use super::progress::{Progress, Stage, Watch};
use super::recipe::{PrecisionName, Recipe, RidgeName};
use super::validation::Validation;
use super::workbench::{Tried, Workbench, reaches};
use super::{Error, FittedModel, fit, timing};
use crate::choose::{Choice, Point, Shares, SplitError, Target, decide, is_doubtful};
use crate::dataset::Dataset;
use crate::model::Precision;
use dropping::drop_hopeless;

/// The split of the points of a search.
pub const VALIDATION: &str = "validation";

/// Groups of clips that are left out in turn, at most.
const MOST_FOLDS: usize = 3;

/// Candidates of the second round, at most.
const FINALISTS: usize = 4;

/// What a search found.
#[derive(Debug)]
pub struct Searched {
    /// The candidates of the second round in every precision, their error under [`VALIDATION`]; the
    /// first round's choice where that left no doubt, its errors by some of the points.
    pub points: Vec<Point>,
    /// The other candidates that were looked at to the end, their sizes, times and errors
    /// estimated from some of the points.
    pub estimates: Vec<Point>,
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

/// A candidate under way.
struct Entry<'a> {
    candidate: &'a CandidateRecipe,
    points: Vec<Point>,
    /// Mean square error of each point in each fold.
    squares: Vec<Vec<f64>>,
    /// The first point's with each reach, in each fold; empty where none was tried.
    held: Vec<Vec<f64>>,
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
    let mut count = Count::new(start, (entries.len() * folds.len()) as u64);
    for (index, fold) in folds.iter().enumerate() {
        let without = bench.without(fold);
        for entry in &mut entries {
            entry.take(without.try_out(entry.candidate), watch, &mut count)?;
        }
        entries.retain(|entry| entry.squares.len() == index + 1);
        if index + 1 < folds.len() {
            drop_hopeless(&mut entries, target, folds.len());
        }
    }
    drop(bench);
    entries.iter_mut().for_each(Entry::hold);
    let best = best(&entries, target, FINALISTS);
    let Some((first, top)) = best.first() else { return Err(Error::NothingToChoose) };
    let finalists: Vec<CandidateRecipe> =
        best.iter().map(|&(entry, _)| entries[entry].reaching()).collect();
    let mut exact = Vec::new();
    if is_doubtful(top, VALIDATION, target) {
        for finalist in &finalists {
            exact.extend(exactly(dataset, std::slice::from_ref(finalist), watch, start)?);
            let points: Vec<Point> = exact.iter().flat_map(Entry::finished).collect();
            if let Some(Choice::Met(_)) = decide(&points, VALIDATION, target) {
                break;
            }
        }
    } else {
        let only = Entry { candidate: &finalists[0], ..entries.swap_remove(*first) };
        exact.push(only);
    }
    let is_exact = |name: &str| exact.iter().any(|entry| entry.candidate.name == name);
    let others = entries.iter().filter(|entry| !is_exact(&entry.candidate.name));
    let estimates = others.flat_map(Entry::finished).collect();
    conclude((dataset, target, start), &exact, estimates, left_out)
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
    let entries = exactly(dataset, candidates, watch, start)?;
    let points = entries.iter().flat_map(Entry::finished).collect();
    Ok((points, start.elapsed().as_secs_f64()))
}

/// Fits to all points, each by itself.
fn exactly<'a>(
    dataset: &Dataset,
    candidates: &'a [CandidateRecipe],
    watch: &Watch,
    start: Instant,
) -> Result<Vec<Entry<'a>>, Error> {
    let bench = Validation::new(dataset)?;
    let (folds, _) = folds(&bench.clips, leaves_poses(candidates));
    let mut entries = entries(candidates);
    let mut count = Count::new(start, (entries.len() * folds.len()) as u64);
    for (index, fold) in folds.iter().enumerate() {
        for entry in &mut entries {
            let time = entry.points.first().map(|point| point.evaluate_us);
            entry.take(bench.try_out(entry.candidate, fold, time), watch, &mut count)?;
        }
        entries.retain(|entry| entry.squares.len() == index + 1);
    }
    Ok(entries)
}

fn entries(candidates: &[CandidateRecipe]) -> Vec<Entry<'_>> {
    let entry =
        |candidate| Entry { candidate, points: Vec::new(), squares: Vec::new(), held: Vec::new() };
    candidates.iter().map(entry).collect()
}

/// What is done of a round.
struct Count {
    start: Instant,
    done: u64,
    total: u64,
}

impl Count {
    fn new(start: Instant, total: u64) -> Self {
        Self { start, done: 0, total }
    }

    fn step(&mut self, watch: &Watch) -> Result<(), Error> {
        let (done, total) = (self.done, self.total);
        if watch.is_cancelled() {
            let when = format!("after {done} of {total} trials");
            return Err(Error::Stopped { when });
        }
        self.done += 1;
        let elapsed_s = self.start.elapsed().as_secs_f64();
        let done = self.done;
        (watch.report)(Progress { stage: Stage::Measure, done, total, rays: 0, elapsed_s });
        Ok(())
    }
}

/// The entries that the target would choose, one after another, each without those before it, with
/// the point that it would take.
fn best(entries: &[Entry<'_>], target: &Target, count: usize) -> Vec<(usize, Point)> {
    let mut rest: Vec<(usize, Point)> = (entries.iter().enumerate())
        .flat_map(|(i, entry)| entry.finished().into_iter().map(move |point| (i, point)))
        .collect();
    let mut chosen = Vec::new();
    while chosen.len() < count {
        let points: Vec<Point> = rest.iter().map(|(_, point)| point.clone()).collect();
        let Some(Choice::Met(at) | Choice::Missed(at)) = decide(&points, VALIDATION, target) else {
            break;
        };
        let (entry, point) = rest[at].clone();
        chosen.push((entry, point));
        rest.retain(|(i, _)| *i != entry);
    }
    chosen
}

/// The decision, and the fit to everything.
fn conclude(
    (dataset, target, start): (&Dataset, &Target, Instant),
    entries: &[Entry<'_>],
    estimates: Vec<Point>,
    left_out: String,
) -> Result<Searched, Error> {
    let points: Vec<Point> = entries.iter().flat_map(Entry::finished).collect();
    let of_point = entries.iter().flat_map(|e| e.points.iter().map(move |_| e.candidate));
    let choice = decide(&points, VALIDATION, target).ok_or(Error::NothingToChoose)?;
    let (chosen, met) = match choice {
        Choice::Met(chosen) => (chosen, true),
        Choice::Missed(chosen) => (chosen, false),
    };
    let candidate = of_point.clone().nth(chosen).ok_or(Error::NothingToChoose)?;
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
    let search_s = start.elapsed().as_secs_f64();
    let mut found = Searched {
        points,
        estimates,
        chosen,
        met,
        shares,
        fitted,
        recipe,
        precision,
        left_out,
        search_s,
    };
    found.reconsider(dataset, target)?;
    Ok(found)
}

impl Searched {
    /// Takes it into account that the model of choice errs so many times as much as what was tried.
    pub(super) fn worsen(&mut self, times: f64) {
        if let Some(error) = self.points[self.chosen].errors.get_mut(VALIDATION) {
            error.rms *= times;
            error.mean_square_error = error.mean_square_error.map(|e| e * times * times);
        }
    }

    /// The verdict on the point of choice, with the bytes of its model itself where an estimate stood, and its
    /// times where the target bounds them.
    pub(super) fn reconsider(&mut self, dataset: &Dataset, target: &Target) -> Result<(), Error> {
        let point = &mut self.points[self.chosen];
        let model = &self.fitted.model;
        point.bytes = model.to_bytes(self.precision)?.len() as u64;
        if target.max_us.is_some() {
            point.evaluate_us = timing::evaluate(model, &Imported::new(dataset))?.all_us;
        }
        if target.max_fit_s.is_some() {
            point.fit_s = self.fitted.fit_s;
        }
        let verdict = decide(std::slice::from_ref(point), VALIDATION, target);
        self.met = matches!(verdict, Some(Choice::Met(_)));
        Ok(())
    }
}

/// Whether the candidates are meant for what lies between trained poses.
pub(super) fn leaves_poses(candidates: &[CandidateRecipe]) -> bool {
    candidates.iter().all(|candidate| candidate.recipe.fit.ridge == RidgeName::LeaveOneOut)
}

/// Groups of training poses that are left out in turn: single ones between others where that is
/// what the models are for, else whole clips where there are at least two.
pub(super) fn folds(clips: &[i32], single: bool) -> (Vec<Vec<usize>>, String) {
    if single && clips.len() >= 3 * MOST_FOLDS {
        // No two neighbours, and all of them in only one of three groups.
        let group = |g: usize| (2 * g + 1..clips.len()).step_by(2 * MOST_FOLDS).collect();
        let text = format!("every second training pose, in {MOST_FOLDS} groups in turn");
        return ((0..MOST_FOLDS).map(group).collect(), text);
    }
    let mut names = clips.to_vec();
    names.sort_unstable();
    names.dedup();
    if names.len() < 2 {
        let first = clips.len() - clips.len() / 4;
        return (vec![(first..clips.len()).collect()], "the last quarter of the only clip".into());
    }
    let count = names.len().min(MOST_FOLDS);
    let fold = |clip: &i32| names.partition_point(|name| name < clip) % count;
    let group = |g: usize| (0..clips.len()).filter(|&pose| fold(&clips[pose]) == g).collect();
    let text = format!("{count} groups of the {} training clips in turn", names.len());
    ((0..count).map(group).collect(), text)
}

impl Entry<'_> {
    /// Adds what was found in a fold. Sizes that the data do not have leave it without.
    fn take(
        &mut self,
        tried: Result<Tried, Error>,
        watch: &Watch,
        count: &mut Count,
    ) -> Result<(), Error> {
        match tried {
            Ok(Tried { points, squares, held }) => {
                self.points = points;
                self.squares.push(squares);
                self.held.push(held);
            }
            Err(Error::Fit(_) | Error::Model(_)) => {}
            Err(other) => return Err(other),
        }
        count.step(watch)
    }

    /// Takes the reach into account that does best over all folds.
    fn hold(&mut self) {
        let Some((_, share)) = self.reach() else { return };
        self.squares.iter_mut().flatten().for_each(|square| *square *= share);
    }

    /// The reach of least error over all folds, where one is better than none by a hundredth, and
    /// the share of the mean square error that it leaves.
    fn reach(&self) -> Option<(f32, f64)> {
        let tried = self.held.iter().map(Vec::len).min()?;
        let sum = |i: usize| self.held.iter().map(|fold| fold[i].max(0.0)).sum::<f64>();
        let none = sum(0).max(f64::MIN_POSITIVE);
        let shares = reaches().take(tried).enumerate().skip(1);
        let shares = shares.filter_map(|(i, reach)| Some((reach?, sum(i) / none)));
        shares.filter(|(_, share)| *share < 0.99).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The candidate with its reach.
    fn reaching(&self) -> CandidateRecipe {
        let mut candidate = self.candidate.clone();
        if let Some((reach, _)) = self.reach() {
            candidate.recipe.fit.reach = Some(reach);
        }
        candidate
    }

    fn finished(&self) -> Vec<Point> {
        let folds = self.squares.len() as f64;
        let finish = |(i, point): (usize, &Point)| {
            let of_folds = || self.squares.iter().map(|squares| squares[i]);
            let mean = of_folds().sum::<f64>() / folds;
            let variance = of_folds().map(|s| (s - mean).powi(2)).sum::<f64>() / (folds - 1.0);
            let error = SplitError {
                rms: mean.max(0.0).sqrt(),
                mean_square_error: (folds > 1.0).then(|| (variance / folds).sqrt()),
                ..SplitError::default()
            };
            Point { errors: [(VALIDATION.to_owned(), error)].into(), ..point.clone() }
        };
        self.points.iter().enumerate().map(finish).collect()
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
