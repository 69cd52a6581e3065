//! What an earlier bake of the same scene has already: poses, and rounds of rays at them.
//!
//! What a pose gets depends on its clip's name and time, never on its index, and rounds are merged
//! one after the other. So a data set that takes over what is there has the bytes of one that was
//! baked at once.

use std::collections::HashMap;
use std::path::Path;

use super::recipe::surroundings::GroundRecipe;
use super::recipe::{
    BakeRecipe, MOST_RAYS_TO_NOISE, ParametrisationName, PoseChoiceName, PosesRecipe, Recipe,
};
use super::rounds::{self, Weights};
use super::{Error, Job, difference, job_of, recipe_of};
use crate::bake::BakedPose;
use crate::dataset::Dataset;

/// An earlier data set.
#[derive(Debug)]
pub(super) struct Earlier {
    dataset: Dataset,
    /// Clip's name and bits of the time → pose.
    poses: HashMap<(String, u32), usize>,
    /// Rounds that its poses have, the first included.
    pub(super) rounds: usize,
    /// Whether its mixed poses are the job's.
    mixes_alike: bool,
}

impl Earlier {
    /// Opens a data set and says whether the job may take from it.
    pub(super) fn open(path: &Path, job: &Job) -> Result<Self, Error> {
        let dataset = Dataset::open(path)?;
        let recipe = recipe_of(&dataset)?;
        let refuse = |what: String| Error::Earlier { path: path.to_path_buf(), what };
        if let Some(what) = difference(&recipe, &job.recipe) {
            return Err(refuse(what));
        }
        if let Some(what) = other_ground(&dataset, &recipe, job)? {
            return Err(refuse(what));
        }
        let scene = &dataset.header().attributes.hashes.get("scene").cloned().unwrap_or_default();
        if *scene != job.hashes.scene {
            return Err(refuse("it is of another scene".into()));
        }
        let names = &dataset.header().attributes.clip_names;
        let name = |clip: i32| {
            let clip = usize::try_from(clip).ok().and_then(|clip| names.get(clip));
            clip.cloned().unwrap_or_default()
        };
        let poses = dataset.clips().iter().zip(dataset.times_s()).enumerate();
        let poses = poses.map(|(pose, (&clip, time))| ((name(clip), time.to_bits()), pose));
        let rounds = 1 + recipe.bake.more_rays.len() + recipe.bake.more_noise.len();
        let poses = poses.collect();
        if !dataset.is_complete() {
            return Err(refuse("it is not complete; continue it first".into()));
        }
        let mixes_alike = mixes_alike(&recipe.poses, &job.recipe.poses);
        Ok(Self { dataset, poses, rounds, mixes_alike })
    }

    /// The pose's number in the earlier data set.
    pub(super) fn find(&self, job: &Job, pose: usize) -> Option<usize> {
        let sample = &job.poses.samples[pose];
        if sample.mixed && !self.mixes_alike {
            return None;
        }
        let name = job.poses.clip_names.get(sample.clip).cloned().unwrap_or_default();
        self.poses.get(&(name, sample.time_s.to_bits())).copied()
    }

    /// What a pose has.
    pub(super) fn read(&self, pose: usize) -> Result<BakedPose, Error> {
        let layout = &self.dataset.header().layout;
        let points = layout.points;
        let mut baked = BakedPose {
            coefficients: vec![0.0; points * layout.row()],
            noise: vec![0.0; points],
            rays: vec![0; points],
        };
        self.dataset.read_points(&[pose], 0..points, &mut baked.coefficients)?;
        self.dataset.read_noise(&[pose], 0..points, &mut baked.noise)?;
        self.dataset.read_rays(pose, &mut baked.rays)?;
        Ok(baked)
    }

    /// What the new data set says of where it comes from.
    pub(super) fn lineage(&self, job: &Job) -> serde_json::Value {
        let taken = (0..job.poses.samples.len()).filter(|&p| self.find(job, p).is_some()).count();
        serde_json::json!({
            "from": self.dataset.header().attributes.hashes.get("bake"),
            "poses_taken": taken,
            "rounds_taken": self.rounds,
        })
    }
}

/// Whether mixed poses of the same date are the same poses: they depend on all frames that there are.
fn mixes_alike(earlier: &PosesRecipe, now: &PosesRecipe) -> bool {
    // How many of them are baked, and what numbers they become, are no matter.
    let of = |poses: &PosesRecipe| PosesRecipe {
        most: None,
        choice: PoseChoiceName::Distance,
        parametrisation: ParametrisationName::JointAngles,
        ..poses.clone()
    };
    of(earlier) == of(now)
}

/// Turns a recipe that states a noise into one that goes on from an earlier data set: its first round
/// and what it has had since, and a round to that noise where it is lower.
///
/// # Errors
/// [`Error::Earlier`] where the data set is cleaner already; what reading it objects to.
pub fn go_on(path: &Path, recipe: &mut Recipe) -> Result<(), Error> {
    let Some(noise) = recipe.bake.noise.filter(|_| recipe.bake.more_noise.is_empty()) else {
        return Ok(());
    };
    let earlier = recipe_of(&Dataset::open(path)?)?.bake;
    let bake = &mut recipe.bake;
    let reached = earlier.more_noise.last().copied().or(earlier.noise);
    if let Some(reached) = reached.filter(|&reached| reached < noise) {
        let what = format!("its noise is {reached} already, lower than {noise}");
        return Err(Error::Earlier { path: path.to_path_buf(), what });
    }
    let goes_on = reached != Some(noise);
    let refuse = |what| Error::Earlier { path: path.to_path_buf(), what };
    (bake.rays, bake.most_rays) = rays_of_rounds(bake.rays, &earlier, goes_on).map_err(refuse)?;
    (bake.noise, bake.more_noise) = (earlier.noise, earlier.more_noise);
    bake.noise_goal = bake.noise_goal.or(earlier.noise_goal);
    if bake.more_rays.is_empty() {
        bake.more_rays = earlier.more_rays;
    }
    if goes_on {
        bake.more_noise.push(noise);
    }
    Ok(())
}

/// The rays of the first round, which are the earlier ones, and the most of further rounds. Beside a noise
/// `asked` is the most of the round that is to come, but for rays that were stated before and are again.
fn rays_of_rounds(
    asked: u32,
    earlier: &BakeRecipe,
    goes_on: bool,
) -> Result<(u32, Option<u32>), String> {
    let most = rounds::most_rays(earlier);
    let restated = earlier.noise.is_none() && asked == earlier.rays;
    if !earlier.more_noise.is_empty() {
        if restated || [MOST_RAYS_TO_NOISE, most].contains(&asked) {
            return Ok((earlier.rays, earlier.most_rays));
        }
        return Err(format!(
            "its rounds to a noise had at most {most} rays, and so has this: leave out other rays"
        ));
    }
    if goes_on {
        return Ok((earlier.rays, (!restated && asked != most).then_some(asked)));
    }
    // The same noise at more poses.
    Ok((if asked == MOST_RAYS_TO_NOISE { earlier.rays } else { asked }, None))
}

/// Why values of one recipe's bake are not those of the other's.
fn difference(earlier: &Recipe, now: &Recipe) -> Option<String> {
    // A goal is of no account to rays that were stated.
    let stated = earlier.bake.noise.is_none() && earlier.bake.more_noise.is_empty();
    let first = |bake: &BakeRecipe| BakeRecipe {
        more_rays: Vec::new(),
        more_noise: Vec::new(),
        most_rays: None,
        noise_goal: bake.noise_goal.filter(|_| !stated),
        ..bake.clone()
    };
    let (there, mut here) = (first(&earlier.bake), first(&now.bake));
    if let (Some(there), Some(here)) = (there.surroundings.ground, &mut here.surroundings.ground) {
        // Two ways to say how high it is may say the same: see `other_ground`.
        *here = there;
    }
    if let Some(fields) = difference::of_bakes(&there, &here) {
        return Some(fields);
    }
    let BakeRecipe { more_rays, more_noise, .. } = &earlier.bake;
    if !now.bake.more_rays.starts_with(more_rays) {
        return Some(format!("it has had more rays already: {more_rays:?}; state them first"));
    }
    if !more_noise.is_empty() && now.bake.more_rays != *more_rays {
        return Some("it was taken to a lower noise; it can be taken to a still lower one".into());
    }
    if !now.bake.more_noise.starts_with(more_noise) {
        return Some(format!("it was taken to the noises {more_noise:?}; state them first"));
    }
    let most = [&earlier.bake, &now.bake].map(rounds::most_rays);
    (!more_noise.is_empty() && most[0] != most[1])
        .then(|| format!("its rounds to a noise had at most {} rays, not {}", most[0], most[1]))
}

/// Why the ground of a job is not that of an earlier bake, where it is not: what counts is its height, which
/// at the lowest point may be another with other poses.
fn other_ground(dataset: &Dataset, earlier: &Recipe, now: &Job) -> Result<Option<String>, Error> {
    let [there, here] = [earlier, &now.recipe].map(|recipe| recipe.bake.surroundings.ground);
    let (Some(there), Some(here)) = (there, here) else { return Ok(None) };
    let stated = there == here && there != GroundRecipe::Lowest;
    if stated || (there == here && earlier.poses == now.recipe.poses) {
        return Ok(None);
    }
    let height = match there {
        GroundRecipe::HeightM(height) => Some(height),
        GroundRecipe::Lowest => job_of(dataset)?.surroundings.ground_m,
    };
    let now = now.surroundings.ground_m;
    let told = |(height, now): (f32, f32)| {
        format!(
            "its ground is at {height} m, and here it is at {now} m: go on with --ground {height}"
        )
    };
    Ok((height != now).then_some(()).and(height.zip(now)).map(told))
}

/// Takes a round into what there is.
///
/// Weights are functions of numbers of rays, which no estimate has a say in; so the mean has no bias.
pub(super) fn merge(into: &mut BakedPose, round: &BakedPose, weights: Weights) {
    let points = into.rays.len();
    let row = into.coefficients.len() / points.max(1);
    for point in 0..points {
        let take = weights.of_new(into.rays[point], round.rays[point]);
        let keep = 1.0 - take;
        let range = point * row..(point + 1) * row;
        let values = into.coefficients[range.clone()].iter_mut().zip(&round.coefficients[range]);
        for (value, new) in values {
            *value = (keep * f64::from(*value) + take * f64::from(*new)) as f32;
        }
        let noise =
            f64::hypot(keep * f64::from(into.noise[point]), take * f64::from(round.noise[point]));
        into.noise[point] = noise as f32;
        into.rays[point] += round.rays[point];
    }
}

#[cfg(test)]
#[path = "earlier_tests.rs"]
mod tests;
