//! What a bake has cast, how noisy it still is, and whether that is what was asked for.

use serde::Serialize;

use super::recipe::{BakeRecipe, NoiseGoalName};
use super::{Error, recipe_of, rounds};
use crate::bake;
use crate::dataset::Dataset;

/// Poses that are looked at, at most: a data set may be far larger than is worth reading for it.
const MOST_POSES: usize = 64;

/// Means over points and some poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spent {
    /// Poses that were looked at, evenly spread over those that are baked.
    pub poses: usize,
    /// Rays of a point, pilots and all rounds included.
    pub rays_per_point: f64,
    /// The root mean square of the standard error of a coefficient.
    pub noise: f64,
    /// How the noise that was asked for was missed, where it was.
    pub missed: Option<Missed>,
}

/// A noise that the most rays did not reach.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Missed {
    /// What was asked for.
    pub asked: f32,
    /// Whether at each point; else as a root mean square.
    pub at_each: bool,
    /// The root mean square over points and poses.
    pub rms: f64,
    /// The same over those points that the most rays stopped.
    pub stopped_rms: f64,
    /// The share of these.
    pub share: f64,
    /// The most rays, all rounds together.
    pub most_rays: u32,
}

impl Missed {
    /// A sentence for the user.
    #[must_use]
    pub fn story(&self) -> String {
        let Self { asked, at_each, rms, stopped_rms, share, most_rays } = self;
        let (rms, stopped, share) =
            (format!("{rms:.5}"), format!("{stopped_rms:.5}"), 100.0 * share);
        let rest = format!(
            "{share:.2} % of the vertices have had the most rays, {most_rays}, which leave them {stopped} (RMS): \
             --rays allows more"
        );
        if *at_each {
            format!(
                "the noise {asked} is not reached at every vertex: {rest} (over all, RMS {rms})"
            )
        } else {
            format!("the noise {asked} is not reached: RMS {rms}; {rest}")
        }
    }
}

/// What was asked for, and the rays from which a point has had all that it may have.
struct Asked {
    noise: f32,
    at_each: bool,
    most_rays: u32,
}

impl Asked {
    fn of(bake: &BakeRecipe) -> Option<Self> {
        let noise = bake.more_noise.last().copied().or(bake.noise)?;
        let stated: u32 = rounds::stated_rays(bake).iter().sum();
        let most = if bake.more_noise.is_empty() { bake.rays } else { rounds::most_rays(bake) };
        let most_rays = stated.saturating_add(bake::most_to_noise(most));
        let at_each = bake.noise_goal != Some(NoiseGoalName::Mean);
        Some(Self { noise, at_each, most_rays })
    }
}

/// Points that have had the most rays.
#[derive(Default)]
struct Stopped {
    count: f64,
    squares: f64,
}

impl Stopped {
    fn add(&mut self, noise: f32) {
        (self.count, self.squares) = (self.count + 1.0, self.squares + f64::from(noise).powi(2));
    }

    fn rms(&self) -> f64 {
        (self.squares / self.count.max(1.0)).sqrt()
    }

    /// Whether they are noisier together than asked for. What is stored of one point is an estimate from as
    /// little as two batches, which scatters widely about a noise that is reached; its square, whose
    /// deviation is at most √2 of it, has no bias: their mean tells beyond two deviations of its own.
    fn are_beyond(&self, asked: f32) -> bool {
        let margin = 1.0 + 2.0 * (2.0 / self.count.max(1.0)).sqrt();
        self.rms().powi(2) > margin * f64::from(asked).powi(2)
    }
}

/// Reads what is stored of rays and noise; nothing where no pose is baked yet.
///
/// # Errors
/// Blocks that cannot be read.
pub fn spent(dataset: &Dataset) -> Result<Option<Spent>, Error> {
    let layout = &dataset.header().layout;
    let missing = dataset.missing_blocks();
    let baked: Vec<usize> = (0..layout.blocks())
        .filter(|block| !missing.contains(block))
        .flat_map(|block| layout.poses_of(block))
        .collect();
    let poses = baked.len().min(MOST_POSES);
    if poses == 0 || layout.points == 0 {
        return Ok(None);
    }
    let asked = recipe_of(dataset).ok().and_then(|recipe| Asked::of(&recipe.bake));
    let (mut rays, mut noise) = (vec![0; layout.points], vec![0.0; layout.points]);
    let (mut sum, mut squares) = (0.0, 0.0);
    let mut stopped = Stopped::default();
    for step in 0..poses {
        let pose = baked[step * baked.len() / poses];
        dataset.read_rays(pose, &mut rays)?;
        dataset.read_noise(&[pose], 0..layout.points, &mut noise)?;
        sum += rays.iter().map(|&rays| f64::from(rays)).sum::<f64>();
        squares += noise.iter().map(|&noise| f64::from(noise).powi(2)).sum::<f64>();
        if let Some(asked) = &asked {
            let pairs = rays.iter().zip(&noise);
            // What nothing blocks is exact, however many rays there were.
            let noisy = pairs.filter(|(rays, noise)| **rays >= asked.most_rays && **noise > 0.0);
            noisy.for_each(|(_, &noise)| stopped.add(noise));
        }
    }
    let count = (poses * layout.points) as f64;
    let (rays_per_point, noise) = (sum / count, (squares / count).sqrt());
    let missed = asked.filter(|asked| {
        stopped.are_beyond(asked.noise) && (asked.at_each || noise > asked.noise.into())
    });
    let missed = missed.map(|Asked { noise: asked, at_each, most_rays }| Missed {
        asked,
        at_each,
        rms: noise,
        stopped_rms: stopped.rms(),
        share: stopped.count / count,
        most_rays,
    });
    Ok(Some(Spent { poses, rays_per_point, noise, missed }))
}

#[cfg(test)]
#[path = "spent_tests.rs"]
mod tests;
