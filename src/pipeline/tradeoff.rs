//! The trade-off, measured: every candidate as a point of bytes, microseconds, fit seconds and
//! errors, from one bake.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::candidates::CandidateRecipe;
use super::imported::Imported;
use super::measure::measure_many;
use super::progress::{Progress, Stage, Watch};
use super::{Error, FittedModel, Part, fit_part, timing};
use crate::choose::{Point, SplitError, front};
use crate::dataset::Dataset;
use crate::fit::Shared;
use crate::measure::report::{Place, Scatter, scatter};
use crate::measure::{CandidateMeasured, Measured};
use crate::model::{Model, Precision};

/// Numbers of one batch of models at one pose, at most: what is measured at once.
const BATCH_NUMBERS: usize = 1 << 24;

/// Models of a batch, at most.
const BATCH_MODELS: usize = 24;

/// All points over one data set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tradeoff {
    /// The scene's file.
    pub scene: String,
    /// Hash of the bake.
    pub bake: String,
    /// The split that counts: the most demanding one that was measured.
    pub split: String,
    /// RMS noise of the references on that split; errors near it are not told apart.
    pub reference_noise_rms: f64,
    /// Every candidate in every precision.
    pub points: Vec<Point>,
    /// Names of the points that no other beats in bytes and in error on that split.
    pub front: Vec<String>,
    /// Candidates that the data do not have the sizes for, with the reason.
    pub skipped: BTreeMap<String, String>,
}

/// Measures candidates against the references of a data set, which must be there.
///
/// # Errors
/// [`Error::Stopped`]; what the stages object to, but sizes that the data do not have.
pub fn tradeoff(
    dataset: &Dataset,
    candidates: &[CandidateRecipe],
    watch: &Watch,
) -> Result<Tradeoff, Error> {
    let dataset = &Imported::new(dataset);
    let attributes = &dataset.header().attributes;
    let scene = super::recipe_of(dataset)?.scene.file;
    let bake = attributes.hashes.get("bake").cloned().unwrap_or_default();
    let mut this = Tradeoff {
        scene,
        bake,
        split: String::new(),
        reference_noise_rms: 0.0,
        points: Vec::new(),
        front: Vec::new(),
        skipped: BTreeMap::new(),
    };
    let layout = &dataset.header().layout;
    let most = (BATCH_NUMBERS / (layout.points * layout.row()).max(1)).clamp(3, BATCH_MODELS);
    let mut batch: Vec<(String, Model)> = Vec::new();
    let start = Instant::now();
    for (done, candidate) in candidates.iter().enumerate() {
        if watch.is_cancelled() {
            let when = format!("after {done} of {} candidates", candidates.len());
            return Err(Error::Stopped { when });
        }
        let (keep, stop) = (candidate.poses.as_deref(), Some(watch.cancelled));
        let data = Part { keep, stop, ..Part::default() };
        match fit_part(dataset, &candidate.recipe, &data, &Shared::default()) {
            Ok(fitted) => this.add(dataset, candidate, &fitted, &mut batch)?,
            Err(Error::Fit(reason)) => {
                this.skipped.insert(candidate.name.clone(), reason.to_string());
            }
            Err(other) => return Err(other),
        }
        if batch.len() + 3 > most || done + 1 == candidates.len() {
            this.measure(&batch, dataset, watch)?;
            batch.clear();
        }
        (watch.report)(Progress {
            stage: Stage::Measure,
            done: done as u64 + 1,
            total: candidates.len() as u64,
            rays: 0,
            elapsed_s: start.elapsed().as_secs_f64(),
        });
    }
    this.find_front();
    Ok(this)
}

/// The names of a candidate's points.
pub(super) fn point_name(candidate: &str, precision: Precision) -> String {
    format!("{candidate} · {}", precision.name())
}

/// A point that is not measured yet, and the model that its blob holds.
pub(super) fn point(
    candidate: &CandidateRecipe,
    fitted: &FittedModel,
    precision: Precision,
    evaluate_us: f64,
) -> Result<(Point, Model), Error> {
    let blob = fitted.model.to_bytes(precision)?;
    let model = Model::from_bytes(&blob)?;
    let header = model.header();
    let tensor_bytes = model.sizes(precision).decoder;
    let numbers = header.mesh.points as usize * header.width();
    let recipe = &candidate.recipe;
    let point = Point {
        name: point_name(&candidate.name, precision),
        family: family(recipe),
        precision: precision.name().to_owned(),
        fit: serde_json::to_value(&recipe.fit).unwrap_or(Value::Null),
        on: serde_json::to_value(recipe.target.on)
            .ok()
            .and_then(|on| on.as_str().map(str::to_owned))
            .unwrap_or_default(),
        bytes: blob.len() as u64,
        tensor_bytes,
        mesh_percent: mesh_percent(tensor_bytes, numbers),
        evaluate_us,
        multiply_adds: model.multiply_adds(),
        fit_s: fitted.fit_s,
        errors: BTreeMap::new(),
    };
    Ok((point, model))
}

/// Bytes in per cent of one mesh's numbers in f32.
pub(super) fn mesh_percent(tensor_bytes: u64, numbers: usize) -> f64 {
    100.0 * tensor_bytes as f64 / (numbers * size_of::<f32>()) as f64
}

/// The family that the recipe names: what a model is made of may go by another name.
fn family(recipe: &super::recipe::Recipe) -> String {
    let name = serde_json::to_value(recipe.fit.family).ok();
    name.and_then(|name| name.as_str().map(str::to_owned)).unwrap_or_default()
}

impl Tradeoff {
    fn add(
        &mut self,
        dataset: &Imported<'_>,
        candidate: &CandidateRecipe,
        fitted: &FittedModel,
        batch: &mut Vec<(String, Model)>,
    ) -> Result<(), Error> {
        // Every precision evaluates in f32, so one timing serves all.
        let evaluate_us = timing::evaluate(&fitted.model, dataset)?.all_us;
        for &precision in Precision::ALL {
            match point(candidate, fitted, precision, evaluate_us) {
                Ok((point, model)) => {
                    batch.push((point.name.clone(), model));
                    self.points.push(point);
                }
                Err(Error::Model(reason)) => {
                    let name = point_name(&candidate.name, precision);
                    self.skipped.insert(name, reason.to_string());
                }
                Err(other) => return Err(other),
            }
        }
        Ok(())
    }

    fn measure(
        &mut self,
        batch: &[(String, Model)],
        dataset: &Imported<'_>,
        watch: &Watch,
    ) -> Result<(), Error> {
        if batch.is_empty() {
            return Ok(());
        }
        // The batch's own progress would run over that of the whole.
        let quiet = Watch { report: &|_| {}, cancelled: watch.cancelled };
        let measured = measure_many(batch, dataset, &quiet)?;
        for point in self.points.iter_mut().filter(|point| point.errors.is_empty()) {
            point.errors = errors(&measured, &point.name);
        }
        if let Some(split) = measured.headline.and_then(|split| measured.split(split)) {
            self.split = split.split.name().to_owned();
            self.reference_noise_rms = split.reference.coefficient_noise_rms;
        }
        Ok(())
    }

    fn find_front(&mut self) {
        let places: Vec<(f64, f64)> =
            self.points.iter().map(|p| (p.bytes as f64, self.error(p))).collect();
        self.front = front(&places).into_iter().map(|i| self.points[i].name.clone()).collect();
    }

    /// The error on the split that counts.
    fn error(&self, point: &Point) -> f64 {
        point.errors.get(&self.split).map_or(f64::NAN, |error| error.rms)
    }

    /// Error over bytes and error over time, as SVG files.
    #[must_use]
    pub fn plots(&self) -> [(&'static str, String); 2] {
        let bytes = |p: &Point| p.bytes as f64;
        let time = |p: &Point| p.evaluate_us;
        [
            ("bytes.svg", self.plot("bytes", &bytes)),
            ("microseconds.svg", self.plot("µs per frame", &time)),
        ]
    }

    fn plot(&self, x_name: &str, cost: &dyn Fn(&Point) -> f64) -> String {
        let families: BTreeSet<&String> = self.points.iter().map(|p| &p.family).collect();
        let groups: Vec<String> = families.iter().map(|&family| family.clone()).collect();
        let group = |p: &Point| groups.iter().position(|g| *g == p.family).unwrap_or(0);
        let place = |p: &Point| (cost(p), self.error(p), group(p), p.name.clone());
        let points: Vec<Place> = self.points.iter().map(place).collect();
        let places: Vec<(f64, f64)> = points.iter().map(|p| (p.0, p.1)).collect();
        scatter(&Scatter {
            title: &format!("{}: error on {} poses", self.scene, self.split),
            x_name,
            y_name: "RMS error of a coefficient",
            groups: &groups,
            points: &points,
            front: &front(&places),
        })
    }
}

pub(super) fn errors(measured: &Measured, name: &str) -> BTreeMap<String, SplitError> {
    let of = |candidates: &[CandidateMeasured]| {
        let candidate = candidates.iter().find(|candidate| candidate.name == name)?;
        Some(SplitError {
            rms: candidate.coefficients.rms.unwrap_or(0.0),
            mean_square_error: candidate.coefficients.standard_error,
            ao_mae: candidate.ao.mean_absolute.value,
            ao_p99: candidate.ao.p99,
            flicker_rms: candidate.flicker.as_ref().and_then(|flicker| flicker.coefficients.rms),
        })
    };
    let splits = measured.splits.iter();
    splits.filter_map(|s| Some((s.split.name().to_owned(), of(&s.candidates)?))).collect()
}
