//! Rays and poses of a bake together, by what their noise does to the fitted model.
//!
//! Noise that is independent between poses is averaged away by the fit, so rays are a knob of the
//! model's error, not of the bake's alone. A pilot bakes some training poses twice, with few rays and
//! other seeds, and fits the recipe's model to each: what the two models a and b differ by is noise
//! alone, so ½ mean (a − b)² is what noise adds to the model's mean square error, without bias and
//! without a reference. It falls with the number of poses, and with rays as [`crate::bake::gain`] has it.
//! What fewer poses do beside that is measured on clips that a fit leaves out, as mean (m − a)(m − b),
//! where m is fitted to other poses of a: noise of the data cancels.
//!
//! *Invariant:* nothing of the pilot goes into the bake that it plans.

use std::ops::Range;
use std::path::Path;

use super::imported::Imported;
use super::measure::predict;
use super::recipe::{ChooseName, OnName, PoseChoiceName, Recipe};
use super::{Error, Job, Part, RecipeError, Watch, bake, encoding, fit_part};
use crate::bake::gain;
use crate::dataset::Dataset;
use crate::fit::{self, Shared};
use crate::model::Model;
use crate::num::random::hash;
use crate::pose::{Sample, Split};

/// Rays of the pilot.
const PILOT_RAYS: u32 = 16;

/// Training poses of the pilot, about.
const PILOT_POSES: u32 = 64;

/// Fewer poses do for no choice among models: each family has sizes for so many, also where a clip is left out.
const LEAST_TO_CHOOSE: usize = 32;

/// The share of the model's mean square error that noise may add.
const SHARE: f64 = 0.05;

/// By how much fewer poses may raise the error, the root of the mean square.
const TOLERANCE: f64 = 1.02;

/// Rays to choose from.
const RAYS: Range<u32> = 8..4097;

/// Where even all poses of a pilot have no model.
const NO_SIZES: &str =
    "its training poses do not vary: state the noise of the bake instead (--noise)";

/// Clips that are left out in turn, at most.
const MOST_FOLDS: usize = 3;

/// Tells the pilot's random numbers from the bake's.
const PILOT_KEY: u64 = 0x706c_616e;

/// So many poses, what they leave of error, and the rays that they then take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Planned {
    /// Training poses.
    pub poses: usize,
    /// RMSE of a coefficient on clips that the fit left out, without the noise's part; that of the
    /// largest pilot where there are more poses.
    pub error: f64,
    /// RMSE that the noise of these rays adds to a model of these poses.
    pub noise: f64,
    /// Rays per point and pose.
    pub rays: u32,
}

/// What a pilot came to.
#[derive(Debug, Clone, PartialEq)]
pub struct RaysPlan {
    /// What was weighed, by ascending poses.
    pub choices: Vec<Planned>,
    /// Which of them takes the least rays of those that are good enough.
    pub chosen: usize,
    /// Whether that is fewer poses than there are.
    pub fewer: bool,
    /// Rays that the pilot cast.
    pub pilot_rays: u64,
}

impl RaysPlan {
    /// Writes the choice into a recipe.
    pub fn edit(&self, recipe: &mut Recipe) {
        let Planned { poses, rays, .. } = self.choices[self.chosen];
        recipe.bake.rays = rays;
        if self.fewer {
            recipe.poses.most = Some(poses as u32);
        } else if recipe.poses.most.is_none() {
            // All are baked, so that none are chosen.
            recipe.poses.choice = PoseChoiceName::Distance;
        }
    }
}

/// Plans a bake by a pilot in the folder `scratch`, which is deleted afterwards. With a target error
/// noise may add its share of that, else of the error that the pilot's model has.
///
/// # Errors
/// A recipe that states its noise, more rounds or a fit of vertices; a scene without poses to leave
/// out; what the stages object to.
pub fn plan_rays(
    open: impl Fn(Recipe) -> Result<Job, Error>,
    recipe: &Recipe,
    scratch: &Path,
    watch: &Watch,
) -> Result<RaysPlan, Error> {
    check(recipe)?;
    let all = {
        let job = open(recipe.clone())?;
        let of_training = |s: &&Sample| s.split == Split::Training;
        let moves = !job.poses.parametrisation.columns.is_empty();
        job.poses.samples.iter().filter(of_training).count() * usize::from(moves)
    };
    if all < 2 {
        let fault = "nothing moves in the training poses, so that one pose is its own model: state its noise \
                     instead (--noise)";
        return Err(Error::Pilot(fault.to_owned()));
    }
    let pilot = Pilot::bake(&open, recipe, scratch, watch);
    let planned = pilot.and_then(|pilot| pilot.plan(recipe, all));
    // What the pilot leaves is of no use to anybody; the error that matters is the plan's.
    let _ = std::fs::remove_dir_all(scratch);
    planned
}

fn check(recipe: &Recipe) -> Result<(), Error> {
    let bake = &recipe.bake;
    let stated = [
        ("bake.noise", bake.noise.is_some()),
        ("bake.more_rays", !bake.more_rays.is_empty()),
        ("bake.more_noise", !bake.more_noise.is_empty()),
        ("bake.vertex_fit", bake.vertex_fit.is_some()),
    ];
    match stated.into_iter().find(|(_, stated)| *stated) {
        Some((field, _)) => Err(Error::Recipe(RecipeError {
            field,
            found: "given".into(),
            expected: "rays that a pilot chooses go without it",
        })),
        None => Ok(()),
    }
}

/// The same poses, twice.
struct Pilot {
    halves: [Dataset; 2],
    recipe: Recipe,
    rays: u64,
}

impl Pilot {
    fn bake(
        open: &impl Fn(Recipe) -> Result<Job, Error>,
        recipe: &Recipe,
        scratch: &Path,
        watch: &Watch,
    ) -> Result<Self, Error> {
        let mut pilot = recipe.clone();
        pilot.bake.rays = PILOT_RAYS;
        let most = pilot.poses.most.unwrap_or(u32::MAX);
        pilot.poses.most = Some(most.min(PILOT_POSES));
        let mut rays = 0;
        let mut half = |which: u64| {
            let mut recipe = pilot.clone();
            recipe.bake.seed = hash(&[pilot.bake.seed, PILOT_KEY, which]);
            let path = scratch.join(format!("{which}.zarr"));
            // What another recipe's pilot left here is not this one's.
            let _ = std::fs::remove_dir_all(&path);
            rays += bake(&open(recipe)?, &path, watch)?.rays;
            Dataset::open(&path).map_err(Error::from)
        };
        let halves = [half(1)?, half(2)?];
        Ok(Self { halves, recipe: pilot, rays })
    }

    fn plan(&self, recipe: &Recipe, all: usize) -> Result<RaysPlan, Error> {
        let splits = self.halves[0].splits();
        let training: Vec<usize> = (0..splits.len()).filter(|&pose| splits[pose] == 0).collect();
        let noise = self.noise(&training)?;
        let count = training.len();
        let mut choices = Vec::new();
        let is_open = recipe.target.choose != ChooseName::Nothing;
        // Motion that is trained on is served by every pose of it.
        let shares: &[usize] = match recipe.target.on {
            OnName::Trained => &[1],
            OnName::Novel => &[4, 2, 1],
        };
        for &share in shares {
            let poses = count.div_ceil(share);
            if share > 1 && is_open && poses < LEAST_TO_CHOOSE {
                continue;
            }
            let noise = noise * count as f64 / poses as f64;
            if let Some(square) = self.left_out(&training, share)? {
                // The models that were tried had their own noise.
                choices.push((poses, (square - noise).max(0.0)));
            }
        }
        let Some(&(_, best)) = choices.last() else {
            let fault = "too few training poses are left where some are left out: state the noise of the bake \
                         instead (--noise)";
            return Err(Error::Pilot(fault.to_owned()));
        };
        if all > count {
            choices.push((all, best));
        }
        let target = recipe.target.max_error.map(|error| f64::from(error).powi(2));
        let budget = SHARE * target.unwrap_or(best).max(f64::MIN_POSITIVE);
        let planned = |&(poses, square): &(usize, f64)| {
            let noise = noise * count as f64 / poses as f64;
            let (rays, left) = rays_for(noise, budget);
            Planned { poses, error: square.sqrt(), noise: left.sqrt(), rays }
        };
        let choices: Vec<Planned> = choices.iter().map(planned).collect();
        let chosen = choose(&choices, best.sqrt(), target.map(f64::sqrt));
        let fewer = choices[chosen].poses < all;
        Ok(RaysPlan { choices, chosen, fewer, pilot_rays: self.rays })
    }

    /// What the noise of the pilot's rays adds to the mean square error of a model of all its poses.
    fn noise(&self, training: &[usize]) -> Result<f64, Error> {
        let halves = self.halves.each_ref().map(Imported::new);
        let fit =
            |half| self.fit(half, &Part::default())?.ok_or_else(|| Error::Pilot(NO_SIZES.into()));
        let [a, b] = [fit(&halves[0])?, fit(&halves[1])?];
        let (mut sum, mut count) = (0.0, 0.0);
        for &pose in training {
            let [found, other] =
                [(&a, 0), (&b, 1)].map(|(model, half)| predicted(model, &halves[half], pose));
            let (found, other) = (found?, other?);
            let squares = found.iter().zip(&other).map(|(a, b)| f64::from(a - b).powi(2));
            sum += squares.sum::<f64>();
            count += found.len() as f64;
        }
        Ok(0.5 * sum / f64::max(count, 1.0))
    }

    /// The mean square error of models of every `share`-th of the other poses, on clips left out in
    /// turn (with one clip, its last quarter); nothing where no pose is left.
    fn left_out(&self, training: &[usize], share: usize) -> Result<Option<f64>, Error> {
        let clips: Vec<i32> = training.iter().map(|&pose| self.halves[0].clips()[pose]).collect();
        let half = Imported::new(&self.halves[0]);
        let (mut sum, mut count) = (0.0, 0.0);
        for fold in folds(&clips) {
            let kept: Vec<usize> =
                (0..training.len()).filter(|i| !fold.contains(i)).step_by(share).collect();
            if kept.is_empty() {
                continue;
            }
            let part = Part { keep: Some(&kept), ..Part::default() };
            let Some(model) = self.fit(&half, &part)? else { return Ok(None) };
            for &i in &fold {
                let found = predicted(&model, &half, training[i])?;
                let [a, b] = [0, 1].map(|half| self.baked(half, training[i]));
                let (a, b) = (a?, b?);
                let errors = found.iter().zip(a.iter().zip(&b));
                sum += errors.map(|(m, (a, b))| f64::from(m - a) * f64::from(m - b)).sum::<f64>();
                count += found.len() as f64;
            }
        }
        Ok((count > 0.0).then(|| f64::max(sum / count, 0.0)))
    }

    /// The recipe's model of some poses, of smaller sizes where those are left to us and the poses do not have
    /// them; nothing where they do not vary at all.
    fn fit(&self, half: &Imported<'_>, part: &Part<'_>) -> Result<Option<Model>, Error> {
        let mut recipe = self.recipe.clone();
        loop {
            match fit_part(half, &recipe, part, &Shared::default()) {
                Ok(fitted) => return Ok(Some(fitted.model)),
                Err(Error::Fit(fit::Error::Inputs { available, .. }))
                    if recipe.fit.inputs.is_none() =>
                {
                    recipe.fit.inputs = Some(available as u32);
                }
                Err(Error::Fit(fit::Error::Outputs { available, .. }))
                    if recipe.fit.outputs.is_none() =>
                {
                    recipe.fit.outputs = Some(available as u32);
                }
                Err(other) => return Err(other),
            }
            if recipe.fit.inputs == Some(0) || recipe.fit.outputs == Some(0) {
                return Ok(None);
            }
        }
    }

    fn baked(&self, half: usize, pose: usize) -> Result<Vec<f32>, Error> {
        let layout = &self.halves[half].header().layout;
        let mut values = vec![0.0; layout.points * layout.row()];
        self.halves[half].read_points(&[pose], 0..layout.points, &mut values)?;
        Ok(values)
    }
}

fn predicted(model: &Model, dataset: &Imported<'_>, pose: usize) -> Result<Vec<f32>, Error> {
    let layout = &dataset.header().layout;
    let parameters = encoding::parameters(model, dataset)?;
    let surface = match model.needs_surface() {
        true => Some(dataset.job()?.surface(pose, model.turns_with_tangents())),
        false => None,
    };
    let mut values = vec![0.0; layout.points * layout.row()];
    predict(model, dataset, &parameters, (pose, surface.as_ref()), &mut values)?;
    Ok(values)
}

/// Training poses that are left out together, by their indices.
fn folds(clips: &[i32]) -> Vec<Vec<usize>> {
    let mut names = clips.to_vec();
    names.dedup();
    names.sort_unstable();
    names.dedup();
    if names.len() < 2 {
        return vec![(clips.len() - clips.len() / 4..clips.len()).collect()];
    }
    // Evenly among the clips.
    let count = names.len().min(MOST_FOLDS);
    let of = |fold: usize| names[fold * names.len() / count];
    let fold = |clip: i32| (0..clips.len()).filter(|&i| clips[i] == clip).collect();
    (0..count).map(of).map(fold).collect()
}

/// The fewest rays whose noise is within a budget, where the pilot's is `noise`, and what they leave.
fn rays_for(noise: f64, budget: f64) -> (u32, f64) {
    let left = |rays: u32| {
        // The gain is of whole multiples; a share of the pilot's rays has its inverse.
        let gain = f64::from(gain(rays)) / f64::from(gain(PILOT_RAYS));
        noise / (gain * gain)
    };
    let enough = RAYS.step_by(2).find(|&rays| left(rays) <= budget);
    let rays = enough.unwrap_or(RAYS.end - 1);
    (rays, left(rays))
}

/// The cheapest of those that are as good as the best, or as a target asks for, all but a little.
fn choose(choices: &[Planned], best: f64, target: Option<f64>) -> usize {
    let most = target.map_or(TOLERANCE * best, |target| f64::max(target / TOLERANCE, best));
    let enough = (0..choices.len()).filter(|&i| choices[i].error <= most);
    let cost = |i: &usize| choices[*i].poses as u64 * u64::from(choices[*i].rays);
    // Ties go to fewer poses.
    enough.min_by_key(cost).unwrap_or(choices.len() - 1)
}

#[cfg(test)]
#[path = "plan_rays_tests.rs"]
mod tests;
