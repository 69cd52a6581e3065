//! Only what the scene requires: the pose parameters and the bands of harmonics that a chosen model
//! can do without, found by trying it without them on what was left out of its fit.

use std::collections::BTreeMap;

use serde::Serialize;

use super::candidates::CandidateRecipe;
use super::recipe::{FamilyName, Recipe};
use super::search::{Searched, VALIDATION, folds, leaves_poses};
use super::workbench::{Bench, Workbench};
use super::{Error, Watch};
use crate::choose::{Target, errors};
use crate::dataset::Dataset;
use crate::model::{ColumnHeader, Precision, SourceHeader};

/// What the mean square error may grow by where no largest error is stated: half a hundredth of
/// the error itself.
const GROWTH: f64 = 1.01;

/// What of a stated largest mean square error is used up, since the trials see some points only.
const CAUTION: f64 = 0.9;

/// What a model does without.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trimmed {
    /// Names of the pose parameters.
    pub without: Vec<String>,
    /// Bands that it keeps, where that is fewer than the data have.
    pub bands: Option<u8>,
    /// Bytes of the whole and of the trimmed model, by validation.
    pub bytes: [u64; 2],
    /// Their errors, by validation: root mean square of a coefficient.
    pub errors: [f64; 2],
}

impl Trimmed {
    /// In a sentence.
    #[must_use]
    pub fn story(&self) -> String {
        let parameters = match self.without.len() {
            0 => String::new(),
            count => format!("{count} pose parameters that hardly matter"),
        };
        let bands = self
            .bands
            .map_or(String::new(), |bands| format!("all bands of harmonics but the first {bands}"));
        let both = if parameters.is_empty() || bands.is_empty() { "" } else { ", and " };
        let ([before, after], [whole, trimmed]) = (self.bytes, self.errors);
        // The trials see some points only: of their errors only the ratio compares with others.
        format!(
            "left out: {parameters}{both}{bands}; {} bytes less, validation error {:+.1} %",
            before.saturating_sub(after),
            100.0 * (trimmed / whole.max(f64::MIN_POSITIVE) - 1.0)
        )
    }
}

/// One trial over all folds.
#[derive(Clone, Copy)]
struct Trial {
    square: f64,
    bytes: u64,
}

/// Leaves out of a search's choice what it can do without: whole nodes, least important first, as
/// many as can go; then bands from the highest. `None` where everything matters.
///
/// The mean square error may grow to the target's, or by [`GROWTH`] where there is no largest error
/// or it is missed already.
///
/// # Errors
/// [`Error::Stopped`]; what the stages object to.
pub(super) fn trim(
    dataset: &Dataset,
    found: &Searched,
    target: &Target,
    watch: &Watch,
) -> Result<Option<Trimmed>, Error> {
    let candidate =
        CandidateRecipe { name: "choice".to_owned(), recipe: found.recipe.clone(), poses: None };
    let all = [candidate];
    let bench = Workbench::new(dataset, &all)?;
    let (folds, _) = folds(bench.clips(), leaves_poses(&all));
    let benches: Vec<Bench<'_>> = folds.iter().map(|fold| bench.without(fold)).collect();
    let trimmer = Trimmer { benches, precision: found.precision, watch };
    let whole = trimmer.trial(&found.recipe)?;
    let (largest, _) = errors(&found.points[found.chosen], VALIDATION).unwrap_or_default();
    let room = target.max_error.map_or(0.0, |most| CAUTION * (most / largest).powi(2));
    let limit = whole.square.max(0.0) * room.max(GROWTH);
    let mut recipe = found.recipe.clone();
    if !tells_distance_alone(&recipe) {
        trimmer.parameters(&mut recipe, whole, limit)?;
    }
    trimmer.bands(&mut recipe, dataset.header().attributes.order, limit)?;
    if recipe == found.recipe {
        return Ok(None);
    }
    let trimmed = trimmer.trial(&recipe)?;
    let errors = [whole, trimmed].map(|trial| trial.square.max(0.0).sqrt());
    let bytes = [whole.bytes, trimmed.bytes];
    Ok(Some(Trimmed { without: recipe.fit.without, bands: recipe.fit.bands, bytes, errors }))
}

/// Whether pose parameters do nothing in a model but tell how far a pose is from its training: there all of them
/// matter, whatever errors say.
fn tells_distance_alone(recipe: &Recipe) -> bool {
    recipe.fit.family == FamilyName::Occluder && recipe.fit.inputs.is_none()
}

struct Trimmer<'a> {
    benches: Vec<Bench<'a>>,
    precision: Precision,
    watch: &'a Watch<'a>,
}

impl Trimmer<'_> {
    /// The recipe without each fold, judged on it.
    fn trial(&self, recipe: &Recipe) -> Result<Trial, Error> {
        if self.watch.is_cancelled() {
            let when = "while the choice was being trimmed".to_owned();
            return Err(Error::Stopped { when });
        }
        let candidate =
            CandidateRecipe { name: "trial".to_owned(), recipe: recipe.clone(), poses: None };
        let (mut square, mut bytes) = (0.0, 0);
        for bench in &self.benches {
            let tried = bench.try_out(&candidate)?;
            let at = tried.points.iter().position(|p| p.precision == self.precision.name());
            let at = at.unwrap_or(0);
            square += tried.squares[at] / self.benches.len() as f64;
            bytes = tried.points[at].bytes;
        }
        Ok(Trial { square, bytes })
    }

    /// As many of the least important nodes as can go, found by halving.
    fn parameters(&self, recipe: &mut Recipe, whole: Trial, limit: f64) -> Result<(), Error> {
        let Some(bench) = self.benches.first() else { return Ok(()) };
        let groups = bench.importance(recipe)?;
        // Something must be left to tell poses by.
        let (mut fits, mut fails) = (0, groups.len());
        while fits + 1 < fails {
            let count = usize::midpoint(fits, fails);
            let mut fewer = recipe.clone();
            fewer.fit.without = names(&groups[..count]);
            match self.trial(&fewer) {
                Ok(trial) if trial.square <= limit && trial.bytes <= whole.bytes => fits = count,
                // Sizes that fewer parameters do not have.
                Ok(_) | Err(Error::Fit(_)) => fails = count,
                Err(other) => return Err(other),
            }
        }
        recipe.fit.without = names(&groups[..fits]);
        Ok(())
    }

    /// The fewest bands that do.
    fn bands(&self, recipe: &mut Recipe, order: u8, limit: f64) -> Result<(), Error> {
        if self.benches.first().is_none_or(|bench| bench.coefficients() == 1) {
            return Ok(());
        }
        for bands in (1..order).rev() {
            let mut fewer = recipe.clone();
            fewer.fit.bands = Some(bands);
            match self.trial(&fewer) {
                Ok(trial) if trial.square <= limit => *recipe = fewer,
                Ok(_) | Err(Error::Fit(_)) => break,
                Err(other) => return Err(other),
            }
        }
        Ok(())
    }
}

fn names(groups: &[Vec<String>]) -> Vec<String> {
    groups.iter().flatten().cloned().collect()
}

/// Indices of parameters that go together: those of one node, or a morph weight.
pub(super) fn groups(columns: &[ColumnHeader]) -> Vec<Vec<usize>> {
    let mut groups: BTreeMap<(u8, u32), Vec<usize>> = BTreeMap::new();
    for (i, column) in columns.iter().enumerate() {
        let key = match column.source {
            SourceHeader::Rotation { node, .. }
            | SourceHeader::Translation { node, .. }
            | SourceHeader::Scale { node, .. }
            | SourceHeader::Point { node, .. }
            | SourceHeader::Tilt { node, .. }
            | SourceHeader::Height { node, .. } => (0, node),
            SourceHeader::Weight { slot } => (1, slot),
            // Each by itself: columns may share any of their points.
            SourceHeader::Dihedral { .. } => (2, i as u32),
        };
        groups.entry(key).or_default().push(i);
    }
    groups.into_values().collect()
}

#[cfg(test)]
#[path = "trim_tests.rs"]
mod tests;
