//! The references that a model is measured against: two bakes of many rays and different seeds,
//! over poses that were chosen before anything was fitted.

use std::path::Path;
use std::time::Instant;

use super::bake::{bake_poses, rays_of};
use super::progress::{Progress, Stage, Watch};
use super::recipe::{BakeRecipe, Recipe};
use super::{
    Around, Error, Job, ReferenceSettings, hash, job, recipe_of, rounds, subset, surroundings,
};
use crate::bake::{self, Baker, Noise};
use crate::dataset::{Dataset, Reference, ReferenceHeader, ReferencePose};
use crate::num::random;
use crate::rig::Deformed;
use crate::scene::{self, Limits, Source};

/// What baking the references did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceBaked {
    /// Poses that the references cover.
    pub poses: usize,
    /// Rays per point and pose of each reference.
    pub rays_per_point: u32,
    /// Bakes of a pose that this run did, of twice `poses`.
    pub baked_now: u64,
    /// Rays that this run cast.
    pub rays: u64,
    /// Wall time of this run's baking, seconds.
    pub bake_s: f64,
}

/// Bakes what the references of a complete data set lack.
///
/// The scene is taken from the data set itself.
///
/// # Errors
/// [`Error::Cancelled`] when the caller asked to stop, and what the stages object to.
pub fn bake_reference(
    dataset: &Dataset,
    settings: ReferenceSettings,
    watch: &Watch,
) -> Result<ReferenceBaked, Error> {
    let header = header(dataset, settings)?;
    let poses = header.poses.len();
    let rays_per_point = header.rays;
    let mut reference = Reference::open_or_create(dataset, &header)?;
    let missing = reference.missing();
    let start = Instant::now();
    let mut rays = 0;
    if !missing.is_empty() {
        let job = job_of(dataset)?;
        let bakers = header.seeds.map(|seed| baker(&job, rays_per_point, settings.factor, seed));
        let [first, second] = bakers;
        let bakers = [first?, second?];
        let total = 2 * poses as u64;
        let there = total - missing.len() as u64;
        let tell = |done, rays| {
            let elapsed_s = start.elapsed().as_secs_f64();
            (watch.report)(Progress { stage: Stage::Reference, done, total, rays, elapsed_s });
        };
        tell(there, 0);
        for (done, &(seed, index)) in missing.iter().enumerate() {
            rays += bake_one(&job, &bakers[seed], &mut reference, (seed, index), watch)
                .map_err(|error| named(error, there + done as u64, total))?;
            tell(there + done as u64 + 1, rays);
        }
    }
    let baked_now = missing.len() as u64;
    Ok(ReferenceBaked {
        poses,
        rays_per_point,
        baked_now,
        rays,
        bake_s: start.elapsed().as_secs_f64(),
    })
}

/// The job that a data set was baked from.
///
/// # Errors
/// If its scene or recipe no longer reads.
pub fn job_of(dataset: &Dataset) -> Result<Job, Error> {
    job_for(dataset, recipe_of(dataset)?)
}

/// Another job over the scene of a data set.
pub(super) fn job_for(dataset: &Dataset, recipe: Recipe) -> Result<Job, Error> {
    job_of_sources(dataset.sources()?, recipe, &dataset.path().join("source"))
}

/// The job of files as a data set has them; `place` is what a message calls them.
pub(super) fn job_of_sources(
    sources: Vec<Source>,
    recipe: Recipe,
    place: &Path,
) -> Result<Job, Error> {
    let import = |sources, content| {
        scene::import_sources_content(sources, &Limits::default(), content)
            .map_err(|source| Error::Scene { file: place.display().to_string(), source })
    };
    let [own, occluders, receivers] = surroundings::part(sources);
    let around = job::content_around(&recipe);
    let other = |sources: Vec<_>| {
        if sources.is_empty() { Ok(None) } else { import(sources, around).map(Some) }
    };
    let around = Around { occluders: other(occluders)?, receivers: other(receivers)? };
    let content = job::content(&recipe);
    let scene = import(own, content)?;
    let mut recipe = recipe;
    // A refined scene's recipe is of the files that import draws on.
    if recipe.subdivide.as_ref().is_some_and(|subdivide| subdivide.of.is_some()) {
        recipe.scene.sha256.get_or_insert_with(|| hash::scene(&scene.sources));
    }
    Job::among(scene, around, recipe)
}

fn header(dataset: &Dataset, settings: ReferenceSettings) -> Result<ReferenceHeader, Error> {
    let recipe = recipe_of(dataset)?;
    let rays = reference_rays(&recipe.bake, settings.factor);
    let seed = recipe.bake.seed;
    // Seeds that no bake of this recipe uses.
    let seeds = [1, 2].map(|which| random::hash(&[seed, 0x7265_6665_7265_6e63, which]));
    let chosen = subset::choose(dataset.splits(), dataset.clips(), settings.poses, seed);
    let bake = dataset.header().attributes.hashes.get("bake").cloned().unwrap_or_default();
    let hash = hash::reference(&bake, rays, seeds, &chosen);
    Ok(ReferenceHeader { poses: chosen, rays, seeds, hash })
}

/// Rays of each point and pose that a bake casts: what is asked for, rounded up to equal halves, over
/// all rounds. With a target noise the most, with a fit of vertices those of each sample.
#[must_use]
pub fn rays_per_point(bake: &BakeRecipe) -> u32 {
    let to_noise = bake.more_noise.iter().map(|_| rounds::most_rays(bake));
    let rounds = std::iter::once(bake.rays).chain(bake.more_rays.iter().copied()).chain(to_noise);
    rounds.fold(0, |sum, rays| sum.saturating_add(bake::rays_cast(rays)))
}

/// Rays of each reference: so many times the bake's, but no more than a point can get.
pub(super) fn reference_rays(bake: &BakeRecipe, factor: u32) -> u32 {
    rays_per_point(bake).saturating_mul(factor).min(bake::MOST_RAYS)
}

/// Where the bake has a target noise, the reference's is what so many times the rays give.
fn baker(job: &Job, rays: u32, factor: u32, seed: u64) -> Result<Baker, Error> {
    let settings = bake::Settings { rays, seed, ..job.checked.bake };
    let to = |noise: Noise| Noise { target: noise.target / bake::gain(factor), ..noise };
    let noise = job.checked.noises.last().map(to);
    job.baker(&settings, noise)
}

fn bake_one(
    job: &Job,
    baker: &Baker,
    reference: &mut Reference,
    (seed, index): (usize, usize),
    watch: &Watch,
) -> Result<u64, Error> {
    let pose = reference.header().poses[index];
    let mut baked = bake_poses(job, baker, &[pose], watch, |_, _| ())?;
    let baked = baked.swap_remove(0);
    let Deformed { normals, .. } = job.deformed(pose);
    let normals: Vec<_> =
        job.poses.points.vertex.iter().map(|&vertex| normals[vertex as usize]).collect();
    let data =
        ReferencePose { coefficients: &baked.coefficients, noise: &baked.noise, normals: &normals };
    reference.commit(seed, index, &data)?;
    Ok(rays_of(&baked))
}

fn named(error: Error, done: u64, total: u64) -> Error {
    match error {
        Error::Bake(bake::Error::Cancelled) => Error::Cancelled { done, total },
        other => other,
    }
}
