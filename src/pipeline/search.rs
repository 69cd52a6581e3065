//! The choice by target: candidates are judged on training clips that their fit did not see, the
//! simplest that meets the target is fitted again to all of them.
//!
//! *Invariant:* held-out clips have no say; they only confirm what was chosen.

use std::time::Instant;

use super::candidates::CandidateRecipe;
use super::measure::predict;
use super::progress::{Progress, Stage, Watch};
use super::recipe::{PrecisionName, Recipe};
use super::tradeoff::point;
use super::{Error, FittedModel, encoding, fit, fit_part, timing};
use crate::choose::{Choice, Point, Shares, SplitError, Target, decide, front};
use crate::dataset::{Dataset, Training};
use crate::model::{Model, Precision};

/// The split of the points of a search.
pub const VALIDATION: &str = "validation";

/// Groups of clips that are left out in turn, at most.
const MOST_FOLDS: usize = 3;

/// After the first group, a candidate is dropped where its error is this many times that of a
/// candidate of no more bytes.
const HOPELESS: f64 = 1.25;

/// What a search found.
#[derive(Debug)]
pub struct Searched {
    /// Every candidate in every precision that was looked at to the end, its error under
    /// [`VALIDATION`].
    pub points: Vec<Point>,
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
    let training = dataset.training()?;
    let (folds, left_out) = folds(training.clips());
    let bench = Bench::new(dataset, &training);
    let mut entries: Vec<Entry<'_>> = candidates
        .iter()
        .map(|candidate| Entry { candidate, points: Vec::new(), squares: Vec::new() })
        .collect();
    let total = (entries.len() * folds.len()) as u64;
    let mut done = 0;
    for (index, fold) in folds.iter().enumerate() {
        for entry in &mut entries {
            if watch.is_cancelled() {
                let when = format!("after {done} of {total} trials");
                return Err(Error::Stopped { when });
            }
            match entry.validate(&bench, fold) {
                // Sizes that the data do not have leave the candidate without points.
                Err(Error::Fit(_) | Error::Model(_)) | Ok(()) => {}
                Err(other) => return Err(other),
            }
            done += 1;
            let elapsed_s = start.elapsed().as_secs_f64();
            (watch.report)(Progress { stage: Stage::Measure, done, total, rays: 0, elapsed_s });
        }
        entries.retain(|entry| entry.squares.len() == index + 1);
        if index == 0 {
            drop_hopeless(&mut entries);
        }
    }
    conclude(dataset, &entries, target, left_out, start)
}

/// The decision, and the fit to everything.
fn conclude(
    dataset: &Dataset,
    entries: &[Entry<'_>],
    target: &Target,
    left_out: String,
    start: Instant,
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
    Ok(Searched { points, chosen, met, shares, fitted, recipe, precision, left_out, search_s })
}

/// Groups of training poses that are left out in turn: whole clips where there are at least two.
fn folds(clips: &[i32]) -> (Vec<Vec<usize>>, String) {
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
    /// Fits without a fold and adds the errors on it.
    fn validate(&mut self, bench: &Bench<'_>, fold: &[usize]) -> Result<(), Error> {
        let keep: Vec<usize> = (0..bench.poses.len()).filter(|pose| !fold.contains(pose)).collect();
        let fitted = fit_part(bench.dataset, &self.candidate.recipe, &[], Some(&keep), None)?;
        let time = self.points.first().map(|point| point.evaluate_us);
        let evaluate_us = match time {
            Some(time) => time,
            None => timing::evaluate(&fitted.model, bench.dataset)?.all_us,
        };
        let mut squares = Vec::new();
        let mut points = Vec::new();
        let mut models = Vec::new();
        for &precision in Precision::ALL {
            let (point, model) = point(self.candidate, &fitted, precision, evaluate_us)?;
            points.push(point);
            models.push(model);
        }
        squares.extend(bench.mean_squares(&models, fold)?);
        self.points = points;
        self.squares.push(squares);
        Ok(())
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

/// Keeps the candidates with a point that is close to the front of bytes and error.
fn drop_hopeless(entries: &mut Vec<Entry<'_>>) {
    let place = |entry: &Entry<'_>, i: usize| {
        let squares = entry.squares.last().map_or(f64::NAN, |squares| squares[i]);
        (entry.points[i].bytes as f64, squares.max(0.0).sqrt())
    };
    let all = |entry: &Entry<'_>| -> Vec<(f64, f64)> {
        (0..entry.points.len()).map(|i| place(entry, i)).collect()
    };
    let places: Vec<(f64, f64)> = entries.iter().flat_map(&all).collect();
    let best: Vec<(f64, f64)> = front(&places).into_iter().map(|i| places[i]).collect();
    let near = |&(bytes, error): &(f64, f64)| {
        let rivals = best.iter().filter(|(rival, _)| *rival <= bytes).map(|(_, error)| *error);
        error <= HOPELESS * rivals.fold(f64::INFINITY, f64::min)
    };
    entries.retain(|entry| all(entry).iter().any(near));
}

/// Training data as validation data.
struct Bench<'a> {
    dataset: &'a Dataset,
    /// Index in the data set of every training pose.
    poses: Vec<usize>,
    noise_variance: f64,
}

impl<'a> Bench<'a> {
    fn new(dataset: &'a Dataset, training: &Training<'_>) -> Self {
        let splits = dataset.splits().iter().enumerate();
        let poses = splits.filter(|(_, split)| **split == 0).map(|(pose, _)| pose).collect();
        Self { dataset, poses, noise_variance: training.noise_variance() }
    }

    /// Mean square error of models of one fit on training poses, less the noise of the data.
    fn mean_squares(&self, models: &[Model], fold: &[usize]) -> Result<Vec<f64>, Error> {
        let Some(first) = models.first() else { return Ok(Vec::new()) };
        let layout = &self.dataset.header().layout;
        let numbers = layout.points * layout.row();
        let parameters = encoding::parameters(first, self.dataset)?;
        let job = first.needs_surface().then(|| super::job_of(self.dataset)).transpose()?;
        let (mut truth, mut found) = (vec![0.0; numbers], vec![0.0; numbers]);
        let mut sums = vec![0.0_f64; models.len()];
        for &pose in fold {
            let pose = self.poses[pose];
            self.dataset.read_points(&[pose], 0..layout.points, &mut truth)?;
            let surface = job.as_ref().map(|job| job.surface(pose));
            for (model, sum) in models.iter().zip(&mut sums) {
                predict(model, self.dataset, &parameters, (pose, surface.as_ref()), &mut found)?;
                let errors = found.iter().zip(&truth).map(|(y, t)| f64::from(y - t).powi(2));
                *sum += errors.sum::<f64>();
            }
        }
        let count = (fold.len() * numbers).max(1) as f64;
        Ok(sums.into_iter().map(|sum| sum / count - self.noise_variance).collect())
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
mod tests {
    use super::*;

    /// Clips are never cut where there are two; a single one loses its end; every pose of several
    /// clips is left out once.
    #[test]
    fn whole_clips_are_left_out() {
        let (groups, _) = folds(&[4, 4, 1, 1, 9, 2]);
        let mut all: Vec<usize> = groups.iter().flatten().copied().collect();
        all.sort_unstable();
        assert_eq!((groups.len(), all), (3, (0..6).collect()));
        assert!(groups.iter().any(|g| g.contains(&0) && g.contains(&1)));
        assert_eq!(folds(&[3; 8]).0, [vec![6, 7]]);
    }
}
