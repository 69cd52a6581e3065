//! Candidates under way.

use std::time::Instant;

use super::VALIDATION;
use crate::choose::{Choice, Point, SplitError, Target, decide};
use crate::pipeline::validation::Validation;
use crate::pipeline::workbench::{Tried, reaches};
use crate::pipeline::{CandidateRecipe, Error, Progress, Stage, Watch};

/// A candidate under way.
pub(super) struct Entry<'a> {
    pub(super) candidate: &'a CandidateRecipe,
    pub(super) points: Vec<Point>,
    /// Mean square error of each point in each fold.
    pub(super) squares: Vec<Vec<f64>>,
    /// The first point's with each reach, in each fold; empty where none was tried.
    pub(super) held: Vec<Vec<f64>>,
}

impl<'a> Entry<'a> {
    fn new(candidate: &'a CandidateRecipe) -> Self {
        Self { candidate, points: Vec::new(), squares: Vec::new(), held: Vec::new() }
    }

    /// The same of the candidate as the second round has it.
    pub(super) fn of<'b>(&self, candidate: &'b CandidateRecipe) -> Entry<'b> {
        let Self { points, squares, held, .. } = self;
        let (points, squares, held) = (points.clone(), squares.clone(), held.clone());
        Entry { candidate, points, squares, held }
    }

    /// Adds what was found in a fold, of bytes the most. Sizes that the data do not have leave it without.
    pub(super) fn take(
        &mut self,
        tried: Result<Tried, Error>,
        watch: &Watch,
        count: &mut Count,
    ) -> Result<(), Error> {
        match tried {
            Ok(Tried { mut points, squares, held }) => {
                for (point, before) in points.iter_mut().zip(&self.points) {
                    point.bytes = point.bytes.max(before.bytes);
                }
                self.points = points;
                self.squares.push(squares);
                self.held.push(held);
            }
            Err(reason @ (Error::Fit(_) | Error::Model(_))) => {
                count.refused.get_or_insert_with(|| reason.to_string());
            }
            Err(other) => return Err(other),
        }
        count.step(watch)
    }

    /// Takes what one group of what is left out, that with the largest error, says at all points: costs, and how
    /// far off errors are by some of the points. Whether it can be fitted there.
    pub(super) fn correct(
        &mut self,
        validation: &Validation<'_>,
        folds: &[Vec<usize>],
        watch: &Watch,
        count: &mut Count,
    ) -> Result<bool, Error> {
        let first = |fold: &usize| self.squares[*fold][0];
        let worst = (0..folds.len()).max_by(|a, b| first(a).total_cmp(&first(b)));
        let Some(worst) = worst else { return Ok(false) };
        let mut whole = Self::new(self.candidate);
        whole.take(validation.try_out(self.candidate, &folds[worst], None), watch, count)?;
        let Some(squares) = whole.squares.first() else { return Ok(false) };
        for (i, exact) in squares.iter().enumerate() {
            let estimate = self.squares[worst][i];
            let ratio = if estimate > 0.0 { exact.max(0.0) / estimate } else { 1.0 };
            self.squares.iter_mut().for_each(|fold| fold[i] *= ratio);
            self.squares[worst][i] = *exact;
            self.points[i].take_costs(&whole.points[i]);
        }
        Ok(true)
    }

    /// Takes the reach into account that does best over all folds.
    pub(super) fn hold(&mut self) {
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
    pub(super) fn reaching(&self) -> CandidateRecipe {
        let mut candidate = self.candidate.clone();
        if let Some((reach, _)) = self.reach() {
            candidate.recipe.fit.reach = Some(reach);
        }
        candidate
    }

    pub(super) fn finished(&self) -> Vec<Point> {
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

pub(super) fn entries(candidates: &[CandidateRecipe]) -> Vec<Entry<'_>> {
    candidates.iter().map(Entry::new).collect()
}

/// What is done of a round.
pub(super) struct Count {
    start: Instant,
    done: u64,
    total: u64,
    /// Why the first candidate that could not be fitted could not.
    refused: Option<String>,
}

impl Count {
    pub(super) fn new(start: Instant, total: u64) -> Self {
        Self { start, done: 0, total, refused: None }
    }

    /// What is wrong where no candidate is left.
    pub(super) fn nothing(self) -> Error {
        let why = self.refused.unwrap_or_else(|| "there is none".to_owned());
        Error::NothingToChoose { why }
    }

    fn step(&mut self, watch: &Watch) -> Result<(), Error> {
        let (done, total) = (self.done, self.total);
        if watch.is_cancelled() {
            let when = format!("after {done} of {total} trials");
            return Err(Error::Stopped { when });
        }
        self.done += 1;
        // How many will be looked at twice is not known beforehand.
        let total = total.max(self.done);
        let elapsed_s = self.start.elapsed().as_secs_f64();
        let done = self.done;
        (watch.report)(Progress { stage: Stage::Measure, done, total, rays: 0, elapsed_s });
        Ok(())
    }
}

/// The entries that the target would choose, one after another, each without those before it, with
/// the point that it would take.
pub(super) fn best(entries: &[Entry<'_>], target: &Target, count: usize) -> Vec<(usize, Point)> {
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
