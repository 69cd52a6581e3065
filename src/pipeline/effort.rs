//! What a bake's effort buys: one model's error over rays per point, training poses and order.
//!
//! Fewer poses are those that a bake of so few would take ([`poses.most`](super::recipe::PosesRecipe::most)),
//! fewer bands are left out by the fit, and fewer rays are baked anew, which costs less than the data set did.
//! All are measured on the data set's own references, in all of their bands.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::imported::Imported;
use super::measure::measure_any;
use super::progress::{Progress, Stage, Watch};
use super::recipe::{PrecisionName, Recipe, SignalName};
use super::reference::{job_for, rays_per_point};
use super::tradeoff::errors;
use super::{Error, FittedModel, Part, RecipeError, bake, fit_part};
use crate::choose::{SplitError, front};
use crate::dataset::Dataset;
use crate::fit::Shared;
use crate::measure::report::{Place, Scatter, scatter};
use crate::model::{Model, Precision};
use crate::pose::Split;

/// What to try; an empty list stands for what the data set has alone.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Efforts {
    /// Rays per point, each below the data set's.
    pub rays: Vec<u32>,
    /// Training poses, each at most the data set's.
    pub poses: Vec<u32>,
    /// Bands of spherical harmonics, each at most the data set's.
    pub orders: Vec<u8>,
}

/// One effort, and what it bought.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffortPoint {
    /// Rays of a point in a pose.
    pub rays_per_point: u32,
    /// Training poses.
    pub poses: usize,
    /// Bands of spherical harmonics.
    pub order: u8,
    /// Rays that its training poses take.
    pub rays: u64,
    /// Of the model.
    pub bytes: u64,
    /// Wall time of the fit, seconds.
    pub fit_s: f64,
    /// By split.
    pub errors: BTreeMap<String, SplitError>,
}

/// All efforts over one data set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Effort {
    /// The scene's file.
    pub scene: String,
    /// The `fit` of the model.
    pub fit: Value,
    /// The split that counts: the most demanding one that was measured.
    pub split: String,
    /// RMS noise of the references on that split.
    pub reference_noise_rms: f64,
    /// By ascending rays, poses and order.
    pub points: Vec<EffortPoint>,
    /// Indices of those that no other beats in rays and in error on that split.
    pub front: Vec<usize>,
}

impl Efforts {
    /// Whether anything is asked for.
    #[must_use]
    pub fn is_any(&self) -> bool {
        !(self.rays.is_empty() && self.poses.is_empty() && self.orders.is_empty())
    }

    /// In order, without repeats, with what the data set itself has.
    ///
    /// # Errors
    /// [`Error::Effort`]; a data set whose rays follow a target noise or come in rounds, where fewer are asked for.
    pub fn within(&self, dataset: &Dataset) -> Result<Self, Error> {
        let stored = super::recipe_of(dataset)?;
        let efforts = self.complete(own(dataset, &stored))?;
        if efforts.rays.len() > 1 {
            has_stated_rays(&stored)?;
        }
        Ok(efforts)
    }

    /// In order, without repeats, with what the data set itself has.
    fn complete(&self, own: (u32, u32, u8)) -> Result<Self, Error> {
        let list = |asked: &[u32], own: u32, what: &'static str| {
            let mut all = asked.to_vec();
            all.push(own);
            all.sort_unstable();
            all.dedup();
            match all.iter().find(|&&value| value == 0 || value > own) {
                None => Ok(all),
                Some(&wrong) => Err(Error::Effort { what, wrong, own }),
            }
        };
        let orders: Vec<u32> = self.orders.iter().copied().map(u32::from).collect();
        Ok(Self {
            rays: list(&self.rays, own.0, "rays per point")?,
            poses: list(&self.poses, own.1, "training poses")?,
            orders: list(&orders, own.2.into(), "bands")?.into_iter().map(|n| n as u8).collect(),
        })
    }
}

/// Fits the recipe's model to less than the data set has, and measures it on the data set's references,
/// which must be there. Bakes of fewer rays are made in temporary folders below `beside`, which is made where it
/// is not there; each is deleted when it has been measured, and nothing else is.
///
/// # Errors
/// [`Error::Effort`], [`Error::Stopped`], [`Error::File`]; a data set whose rays follow a target noise or come in
/// rounds, where fewer are asked for; what the stages object to.
pub fn effort(
    dataset: &Dataset,
    recipe: &Recipe,
    efforts: &Efforts,
    beside: &Path,
    watch: &Watch,
) -> Result<Effort, Error> {
    let layout = &dataset.header().layout;
    let stored = super::recipe_of(dataset)?;
    let own = own(dataset, &stored);
    let order = own.2;
    let efforts = efforts.within(dataset)?;
    let kept = kept(dataset, &stored, &efforts.poses)?;
    let mut this = Effort {
        scene: stored.scene.file.clone(),
        fit: serde_json::to_value(&recipe.fit).unwrap_or(Value::Null),
        split: String::new(),
        reference_noise_rms: 0.0,
        points: Vec::new(),
        front: Vec::new(),
    };
    let start = Instant::now();
    for &rays in &efforts.rays {
        let fewer = (rays < own.0).then(|| baked(dataset, &stored, rays, beside, watch));
        let fewer = fewer.transpose()?;
        let trained = Imported::new(fewer.as_ref().map_or(dataset, |fewer| &fewer.dataset));
        for (count, keep) in &kept {
            for &bands in &efforts.orders {
                let mut recipe = recipe.clone();
                recipe.fit.bands = (bands < order).then_some(bands);
                let part = Part { keep: Some(keep), stop: Some(watch.cancelled), left_out: &[] };
                let fitted = fit_part(&trained, &recipe, &part, &Shared::default())?;
                let cast = u64::from(rays) * u64::from(*count) * layout.points as u64;
                this.add(dataset, (rays, *count, bands, cast), &recipe, &fitted, watch)?;
                let total = efforts.rays.len() * kept.len() * efforts.orders.len();
                (watch.report)(Progress {
                    stage: Stage::Measure,
                    done: this.points.len() as u64,
                    total: total as u64,
                    rays: 0,
                    elapsed_s: start.elapsed().as_secs_f64(),
                });
            }
        }
    }
    this.find_front();
    Ok(this)
}

/// Whether [`effort`] can begin: one fit of the fewest poses and bands finds out whether those have the sizes
/// that the recipe's model asks for.
///
/// # Errors
/// As [`effort`].
pub fn check_effort(
    dataset: &Dataset,
    recipe: &Recipe,
    efforts: &Efforts,
    watch: &Watch,
) -> Result<(), Error> {
    let stored = super::recipe_of(dataset)?;
    let efforts = efforts.within(dataset)?;
    let fewest = kept(dataset, &stored, &efforts.poses[..1])?;
    let keep = fewest.first().map(|(_, keep)| keep.as_slice());
    let mut recipe = recipe.clone();
    let order = own(dataset, &stored).2;
    recipe.fit.bands = efforts.orders.first().copied().filter(|&bands| bands < order);
    let part = Part { keep, stop: Some(watch.cancelled), left_out: &[] };
    fit_part(&Imported::new(dataset), &recipe, &part, &Shared::default()).map(drop)
}

/// Rays per point, training poses and bands of a data set.
fn own(dataset: &Dataset, stored: &Recipe) -> (u32, u32, u8) {
    let training = dataset.splits().iter().filter(|&&split| split == 0).count();
    let order = if stored.bake.signal == SignalName::Ao { 1 } else { stored.bake.order };
    (rays_per_point(&stored.bake), training as u32, order)
}

/// Fewer rays than a target noise asks for, or than rounds add up to, are no bake of the recipe.
fn has_stated_rays(recipe: &Recipe) -> Result<(), Error> {
    let bake = &recipe.bake;
    let rounds = !bake.more_rays.is_empty() || !bake.more_noise.is_empty();
    if bake.noise.is_none() && !rounds {
        return Ok(());
    }
    Err(Error::Recipe(RecipeError {
        field: if rounds { "bake.more_rays" } else { "bake.noise" },
        found: "given".into(),
        expected: "fewer rays are tried on a bake that states them in one number",
    }))
}

/// For each number of training poses those that a bake of so many takes, as indices among all.
fn kept(
    dataset: &Dataset,
    stored: &Recipe,
    counts: &[u32],
) -> Result<Vec<(u32, Vec<usize>)>, Error> {
    let poses = dataset.poses();
    let training = (0..poses.splits.len()).filter(|&pose| poses.splits[pose] == 0);
    let known: Vec<(i32, u32)> =
        training.map(|pose| (poses.clips[pose], poses.times_s[pose].to_bits())).collect();
    let of = |&count: &u32| {
        if count as usize == known.len() {
            return Ok((count, (0..known.len()).collect()));
        }
        let mut recipe = stored.clone();
        recipe.poses.most = Some(count);
        let samples = job_for(dataset, recipe)?.poses.samples;
        let taken = samples.iter().filter(|sample| sample.split == Split::Training);
        let places: Vec<(i32, u32)> =
            taken.map(|sample| (sample.clip as i32, sample.time_s.to_bits())).collect();
        let keep = (0..known.len()).filter(|&i| places.contains(&known[i])).collect();
        Ok((count, keep))
    };
    counts.iter().map(of).collect()
}

/// A data set that goes with the folder it is in.
struct Passing {
    dataset: Dataset,
    /// Deletes itself, after an error too.
    _folder: tempfile::TempDir,
}

/// The data set with fewer rays.
fn baked(
    dataset: &Dataset,
    stored: &Recipe,
    rays: u32,
    beside: &Path,
    watch: &Watch,
) -> Result<Passing, Error> {
    let mut recipe = stored.clone();
    recipe.bake.rays = rays;
    let folder = std::fs::create_dir_all(beside)
        .and_then(|()| tempfile::Builder::new().prefix(".fewer-rays-").tempdir_in(beside))
        // Said of the folder that was named, not of the temporary one.
        .map_err(|error| std::io::Error::from(error.kind()))
        .map_err(|source| Error::File { action: "write", path: beside.to_owned(), source })?;
    let path = folder.path().join("fewer.zarr");
    bake(&job_for(dataset, recipe)?, &path, watch).map_err(|error| match error {
        // Nothing of it stays to be continued.
        Error::Bake(crate::bake::Error::Cancelled) | Error::Cancelled { .. } => {
            Error::Stopped { when: format!("during the bake of {rays} rays") }
        }
        other => other,
    })?;
    Ok(Passing { dataset: Dataset::open(&path)?, _folder: folder })
}

impl Effort {
    fn add(
        &mut self,
        dataset: &Dataset,
        (rays_per_point, poses, order, rays): (u32, u32, u8, u64),
        recipe: &Recipe,
        fitted: &FittedModel,
        watch: &Watch,
    ) -> Result<(), Error> {
        let precision = match recipe.output.precision {
            PrecisionName::F32 => Precision::F32,
            PrecisionName::F16 => Precision::F16,
            PrecisionName::I8 => Precision::I8,
        };
        let blob = fitted.model.to_bytes(precision)?;
        let quiet = Watch { report: &|_| {}, cancelled: watch.cancelled };
        let named = [("model".to_owned(), Model::from_bytes(&blob)?)];
        let measured = measure_any(&named, &Imported::new(dataset), &quiet)?;
        if let Some(split) = measured.headline.and_then(|split| measured.split(split)) {
            self.split = split.split.name().to_owned();
            self.reference_noise_rms = split.reference.coefficient_noise_rms;
        }
        self.points.push(EffortPoint {
            rays_per_point,
            poses: poses as usize,
            order,
            rays,
            bytes: blob.len() as u64,
            fit_s: fitted.fit_s,
            errors: errors(&measured, "model"),
        });
        Ok(())
    }

    /// The error on the split that counts.
    #[must_use]
    pub fn error(&self, point: &EffortPoint) -> f64 {
        point.errors.get(&self.split).map_or(f64::NAN, |error| error.rms)
    }

    fn find_front(&mut self) {
        let place = |point: &EffortPoint| (point.rays as f64, self.error(point));
        let places: Vec<(f64, f64)> = self.points.iter().map(place).collect();
        self.front = front(&places);
    }

    /// Error over rays, coloured by order where several were tried, else by poses, as an SVG file.
    #[must_use]
    pub fn plot(&self) -> String {
        let has_orders = self.points.windows(2).any(|pair| pair[0].order != pair[1].order);
        let group = |point: &EffortPoint| match has_orders {
            true => format!("order {}", point.order),
            false => format!("{} poses", point.poses),
        };
        let mut groups: Vec<String> = Vec::new();
        for point in &self.points {
            if !groups.contains(&group(point)) {
                groups.push(group(point));
            }
        }
        let place = |point: &EffortPoint| {
            let of = groups.iter().position(|name| *name == group(point)).unwrap_or(0);
            let EffortPoint { rays_per_point, poses, order, .. } = point;
            let hint = format!("{rays_per_point} rays a point, {poses} poses, order {order}");
            (point.rays as f64, self.error(point), of, hint)
        };
        let points: Vec<Place> = self.points.iter().map(place).collect();
        scatter(&Scatter {
            title: &format!("{}: error on {} poses by what was baked", self.scene, self.split),
            x_name: "rays of the training poses",
            y_name: "RMS error of a coefficient",
            groups: &groups,
            points: &points,
            front: &self.front,
        })
    }

    /// A line for each point, those of the front marked.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = format!(
            "{}: what a bake's effort buys; * is on the front of rays and {} error; reference noise {:.5}\n  \
             rays a point   poses  order  million rays      bytes     fit s   {}",
            self.scene,
            self.split,
            self.reference_noise_rms,
            super::tradeoff_page::ERRORS
        );
        for (i, point) in self.points.iter().enumerate() {
            let mark = if self.front.contains(&i) { '*' } else { ' ' };
            text += &format!(
                "\n{mark} {:>12} {:>7} {:>6} {:>13.2} {:>10} {:>9.2}",
                point.rays_per_point,
                point.poses,
                point.order,
                point.rays as f64 / 1e6,
                point.bytes,
                point.fit_s
            );
            for (split, error) in &point.errors {
                text += &format!("   {split} {}", super::tradeoff_page::told(error).trim_start());
            }
        }
        text
    }
}

#[cfg(test)]
#[path = "effort_tests.rs"]
mod tests;
