//! The regression gate: figures of a run beside those of an approved one, of which none depends on
//! the speed of a machine.

mod documents;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Figures;
use super::recipe::Recipe;
use crate::measure::{CandidateMeasured, SplitMeasured, Squared};

pub use documents::{junit, page};

/// The version of the document.
const VERSION: u32 = 1;

/// An approved run: the recipe that makes it again, and its figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baseline {
    version: u32,
    /// The resolved recipe.
    pub recipe: Recipe,
    /// Figures by name; of all of them less is better.
    pub figures: BTreeMap<String, f64>,
}

/// A document that is no baseline.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BaselineError {
    /// Not the document.
    #[error("it is no baseline that `check --approve` wrote: {0}")]
    Json(#[from] serde_json::Error),
    /// Of another version.
    #[error("it has version {0}; this build reads version {VERSION}")]
    Version(u32),
}

/// One figure beside the approved one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    /// Such as `novel: RMSE of a coefficient`.
    pub name: String,
    /// What was approved; absent for a figure that is new.
    pub approved: Option<f64>,
    /// What it is now; absent for a figure that is gone.
    pub found: Option<f64>,
    /// The most that passes.
    pub most: Option<f64>,
    /// Whether it passes.
    pub passes: bool,
}

impl Baseline {
    /// The baseline that a run gives.
    #[must_use]
    pub fn of(recipe: &Recipe, figures: &Figures) -> Self {
        Self { version: VERSION, recipe: recipe.clone(), figures: numbers(figures) }
    }

    /// Reads a baseline.
    ///
    /// # Errors
    /// [`BaselineError`].
    pub fn read(json: &[u8]) -> Result<Self, BaselineError> {
        #[derive(Deserialize)]
        struct Outer {
            version: u32,
        }
        let outer: Outer = serde_json::from_slice(json)?;
        if outer.version != VERSION {
            return Err(BaselineError::Version(outer.version));
        }
        Ok(serde_json::from_slice(json)?)
    }

    /// Every figure of a run beside the approved one. A figure passes where it is at most the
    /// approved one times 1 + `tolerance`; one that is gone does not, one that is new does.
    #[must_use]
    pub fn compare(&self, figures: &Figures, tolerance: f64) -> Vec<Line> {
        compare(&self.figures, &numbers(figures), tolerance)
    }
}

fn compare(
    approved: &BTreeMap<String, f64>,
    found: &BTreeMap<String, f64>,
    tolerance: f64,
) -> Vec<Line> {
    let line = |name: &String| {
        let (approved, found) = (approved.get(name).copied(), found.get(name).copied());
        let most = approved.map(|approved| approved * (1.0 + tolerance));
        let passes = match (found, most) {
            (Some(found), Some(most)) => found <= most,
            (found, _) => found.is_some(),
        };
        Line { name: name.clone(), approved, found, most, passes }
    };
    let fresh = found.keys().filter(|name| !approved.contains_key(*name));
    approved.keys().chain(fresh).map(line).collect()
}

/// What is compared: sizes, work, and the errors of each split.
fn numbers(figures: &Figures) -> BTreeMap<String, f64> {
    let model = &figures.model;
    let mut numbers = BTreeMap::from([
        ("model: bytes".to_owned(), model.bytes as f64),
        ("model: multiply-adds a pose".to_owned(), model.multiply_adds as f64),
        ("model: pose parameters".to_owned(), model.parameters as f64),
    ]);
    for split in &figures.measured.splits {
        let own = split.candidates.iter().find(|c| c.name == figures.measured.model);
        for (name, value) in own.into_iter().flat_map(|own| errors(split, own)) {
            numbers.insert(format!("{}: {name}", split.split.name()), value);
        }
    }
    numbers
}

/// Errors of a model on a split. One that the references' noise hides counts as that noise: below
/// it nothing is told apart.
fn errors(split: &SplitMeasured, own: &CandidateMeasured) -> Vec<(&'static str, f64)> {
    let noise = split.reference.coefficient_noise_rms;
    let above = |squared: &Squared| squared.rms.unwrap_or(0.0).max(noise);
    let mut errors = vec![
        ("RMSE of a coefficient", above(&own.coefficients)),
        ("mean error of ambient occlusion", own.ao.mean_absolute.value),
        ("99th percentile of it", own.ao.p99),
    ];
    let flicker = own.flicker.as_ref().map(|flicker| above(&flicker.coefficients));
    errors.extend(flicker.map(|flicker| ("flicker of a coefficient a frame", flicker)));
    errors
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(entries: &[(&str, f64)]) -> BTreeMap<String, f64> {
        entries.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
    }

    /// What grows beyond the tolerance or is gone fails; what shrinks, stays or is new passes; a
    /// figure that is no number fails.
    #[test]
    fn only_what_is_worse_fails() {
        let approved = map(&[("bytes", 100.0), ("error", 1.0), ("gone", 1.0), ("odd", 1.0)]);
        let found = map(&[("bytes", 105.0), ("error", 1.06), ("new", 7.0), ("odd", f64::NAN)]);
        let lines = compare(&approved, &found, 0.05);
        let failed: Vec<&str> =
            lines.iter().filter(|line| !line.passes).map(|line| line.name.as_str()).collect();
        assert_eq!(failed, ["error", "gone", "odd"]);
        assert_eq!(lines.len(), 5);
        let better = compare(
            &approved,
            &map(&[("bytes", 1.0), ("error", 0.0), ("gone", 0.0), ("odd", 0.0)]),
            0.0,
        );
        assert!(better.iter().all(|line| line.passes));
    }

    /// A baseline survives being written; another version is named as such.
    #[test]
    fn baselines_are_read() {
        let figures = map(&[("bytes", 100.0)]);
        let baseline = Baseline { version: VERSION, recipe: Recipe::default(), figures };
        let json = serde_json::to_vec(&baseline).expect("written");
        assert_eq!(Baseline::read(&json).expect("read"), baseline);
        let later = Baseline::read(br#"{"version":2,"surprise":1}"#).expect_err("refused");
        assert_eq!(later.to_string(), "it has version 2; this build reads version 1");
        assert!(Baseline::read(b"{}").is_err() && Baseline::read(b"[").is_err());
    }
}
