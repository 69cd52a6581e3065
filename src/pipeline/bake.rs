//! The bake of a job into its data set, block after block.

use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Instant;

use rayon::prelude::*;

use super::earlier::{self, Earlier};
use super::progress::{Progress, Stage, Watch};
use super::rounds::Weights;
use super::{Error, Job, RecipeError, describe, difference, rounds};
use crate::bake::{self, BakedPose, Baker, PosedMesh};
use crate::dataset::{self, Layout, PoseData, Writer};
use crate::rig::Deformed;

/// What a bake did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Baked {
    /// Poses of the data set.
    pub poses: usize,
    /// Poses that this run baked; the others were there.
    pub poses_now: usize,
    /// Rays that this run cast.
    pub rays: u64,
    /// Wall time of this run's baking, seconds.
    pub bake_s: f64,
}

/// Bakes what the data set at `path` lacks, and creates it where there is none.
///
/// A block is computed while the one before is written; a block that is not committed when the
/// process dies is baked again.
///
/// # Errors
/// [`Error::Cancelled`] when the caller asked to stop, and what the stages object to.
pub fn bake(job: &Job, path: &Path, watch: &Watch) -> Result<Baked, Error> {
    bake_from(job, path, None, watch)
}

/// Whether the data set at `path`, if there is one, is of this job; nothing is touched.
///
/// # Errors
/// [`Error::OtherBake`] with the fields that differ.
pub fn check_place(job: &Job, path: &Path) -> Result<(), Error> {
    let header = describe::header(job)?;
    Writer::check(path, &header).map_err(|error| difference::explain(error, path, job))
}

/// As [`bake()`], taking over what the data set at `from` has of the same poses: the bytes are those
/// of a bake from nothing.
///
/// # Errors
/// As [`bake()`]; [`Error::Earlier`] where nothing can be taken.
pub fn bake_from(
    job: &Job,
    path: &Path,
    from: Option<&Path>,
    watch: &Watch,
) -> Result<Baked, Error> {
    is_refined(job)?;
    let earlier = from.map(|from| Earlier::open(from, job)).transpose()?;
    let mut header = describe::header(job)?;
    header.attributes.lineage.extend(earlier.as_ref().map(|earlier| earlier.lineage(job)));
    let mut writer = Writer::open(path, &header, &describe::tables(job))
        .map_err(|error| difference::explain(error, path, job))?;
    let missing = writer.missing_blocks();
    let layout = *writer.layout();
    let rounds = Rounds::new(job, earlier)?;
    let mut tally = Tally::new(&layout, &missing);
    tally.tell(Inside::default(), watch);

    let (send, receive) = sync_channel::<(usize, Vec<BakedPose>)>(1);
    std::thread::scope(|scope| {
        let committer = scope.spawn(move || commit(&mut writer, receive));
        let baked = bake_blocks(job, &rounds, &layout, &missing, &send, &mut tally, watch);
        drop(send);
        let committed = committer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        // A failed write makes the next send fail; the write's own error is the one to tell.
        committed.map_err(Error::from).and(baked)
    })?;
    Ok(tally.baked)
}

/// The name of a bake is of the refined mesh, and so must its values be.
fn is_refined(job: &Job) -> Result<(), RecipeError> {
    let (field, found) = ("subdivide", "asked for and not done".to_owned());
    let expected = "refine the mesh first, and bake that";
    if job.is_to_be_refined() { Err(RecipeError { field, found, expected }) } else { Ok(()) }
}

fn commit(
    writer: &mut Writer,
    blocks: Receiver<(usize, Vec<BakedPose>)>,
) -> Result<(), dataset::Error> {
    for (block, baked) in blocks {
        let poses: Vec<PoseData> = baked.iter().map(pose_data).collect();
        writer.commit(block, &poses)?;
    }
    Ok(())
}

/// A posed mesh with what names its random numbers.
pub(super) fn posed<'a>(job: &Job, pose: usize, mesh: &'a Deformed) -> PosedMesh<'a> {
    PosedMesh {
        positions: &mesh.positions,
        normals: &mesh.normals,
        clip_key: job.clip_key(pose),
        time_s: job.poses.samples[pose].time_s,
    }
}

fn pose_data(pose: &BakedPose) -> PoseData<'_> {
    PoseData { coefficients: &pose.coefficients, noise: &pose.noise, rays: &pose.rays }
}

fn bake_blocks(
    job: &Job,
    rounds: &Rounds,
    layout: &Layout,
    missing: &[usize],
    committer: &SyncSender<(usize, Vec<BakedPose>)>,
    tally: &mut Tally,
    watch: &Watch,
) -> Result<(), Error> {
    for &block in missing {
        let poses: Vec<usize> = layout.poses_of(block).collect();
        let mut inside = Inside::default();
        let mut told = |poses, rays| {
            inside = Inside { poses: inside.poses + poses, rays: inside.rays + rays };
            tally.tell(inside, watch);
        };
        let baked =
            rounds.bake(job, &poses, watch, &mut told).map_err(|error| tally.name(error))?;
        tally.count(baked.len(), inside.rays);
        if committer.send((block, baked)).is_err() {
            return Ok(());
        }
        tally.tell(Inside::default(), watch);
    }
    Ok(())
}

/// The rounds of a bake, and what an earlier one has of them.
struct Rounds {
    bakers: Vec<Baker>,
    /// Of each but the first.
    weights: Vec<Weights>,
    earlier: Option<Earlier>,
}

impl Rounds {
    fn new(job: &Job, earlier: Option<Earlier>) -> Result<Self, Error> {
        Ok(Self { bakers: rounds::bakers(job)?, weights: rounds::weights(job), earlier })
    }

    /// Bakes what is lacking of some poses; tells of poses and rays as they are done.
    fn bake(
        &self,
        job: &Job,
        poses: &[usize],
        watch: &Watch,
        tell: &mut dyn FnMut(usize, u64),
    ) -> Result<Vec<BakedPose>, Error> {
        let found =
            |&pose: &usize| self.earlier.as_ref().and_then(|e| Some((e, e.find(job, pose)?)));
        let mut baked: Vec<Option<BakedPose>> = Vec::with_capacity(poses.len());
        for pose in poses {
            let there = found(pose).map(|(earlier, number)| earlier.read(number)).transpose()?;
            baked.push(there);
        }
        let there: Vec<bool> = baked.iter().map(Option::is_some).collect();
        let taken = self.earlier.as_ref().map_or(0, |earlier| earlier.rounds);
        for (round, baker) in self.bakers.iter().enumerate() {
            let lacks = |&at: &usize| !there[at] || round >= taken;
            let lacking: Vec<usize> = (0..poses.len()).filter(lacks).collect();
            let numbers: Vec<usize> = lacking.iter().map(|&at| poses[at]).collect();
            let last = round + 1 == self.bakers.len();
            let told = |poses, rays| tell(if last { poses } else { 0 }, rays);
            let new = bake_poses(job, baker, &numbers, watch, told)?;
            for (at, new) in lacking.into_iter().zip(new) {
                match &mut baked[at] {
                    Some(pose) => earlier::merge(pose, &new, self.weights[round - 1]),
                    empty => *empty = Some(new),
                }
            }
        }
        Ok(baked.into_iter().flatten().collect())
    }
}

/// Poses and bakes some of a job's poses, as many at a time as the baker works on together; `tell`
/// hears of each time's poses and rays.
pub(super) fn bake_poses(
    job: &Job,
    baker: &Baker,
    poses: &[usize],
    watch: &Watch,
    mut tell: impl FnMut(usize, u64),
) -> Result<Vec<BakedPose>, Error> {
    let mut baked = Vec::with_capacity(poses.len());
    for wave in poses.chunks(baker.wave()) {
        let deformed: Vec<Deformed> = wave.par_iter().map(|&pose| job.traced(pose)).collect();
        let meshes: Vec<PosedMesh> =
            wave.iter().zip(&deformed).map(|(&pose, mesh)| posed(job, pose, mesh)).collect();
        let new = baker
            .bake(&meshes, watch.cancelled)
            .map_err(|error| error.numbered(|index| wave[index]))?;
        tell(wave.len(), new.iter().map(rays_of).sum());
        baked.extend(new);
    }
    Ok(baked)
}

/// Rays over all points of a pose.
pub(super) fn rays_of(pose: &BakedPose) -> u64 {
    pose.rays.iter().map(|&rays| u64::from(rays)).sum()
}

/// What is done of a block.
#[derive(Clone, Copy, Default)]
struct Inside {
    poses: usize,
    rays: u64,
}

/// Work done, for the caller's ear and the summary.
struct Tally {
    baked: Baked,
    there: usize,
    start: Instant,
}

impl Tally {
    fn new(layout: &Layout, missing: &[usize]) -> Self {
        let absent: usize = missing.iter().map(|&block| layout.poses_of(block).len()).sum();
        let baked = Baked { poses: layout.poses, poses_now: 0, rays: 0, bake_s: 0.0 };
        Self { baked, there: layout.poses - absent, start: Instant::now() }
    }

    fn count(&mut self, poses: usize, rays: u64) {
        self.baked.poses_now += poses;
        self.baked.rays += rays;
        self.baked.bake_s = self.start.elapsed().as_secs_f64();
    }

    fn done(&self) -> u64 {
        (self.there + self.baked.poses_now) as u64
    }

    fn tell(&self, inside: Inside, watch: &Watch) {
        (watch.report)(Progress {
            stage: Stage::Bake,
            done: self.done() + inside.poses as u64,
            total: self.baked.poses as u64,
            rays: self.baked.rays + inside.rays,
            elapsed_s: self.start.elapsed().as_secs_f64(),
        });
    }

    /// A cancelled bake says how far it came.
    fn name(&self, error: Error) -> Error {
        match error {
            Error::Bake(bake::Error::Cancelled) => {
                Error::Cancelled { done: self.done(), total: self.baked.poses as u64 }
            }
            other => other,
        }
    }
}
