//! Poses in, coefficients out, with all cores busy.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use crate::rig::Points;
use crate::trace::Device;

use super::adaptive::{Adaptive, Before};
use super::borders::Borders;
use super::bounce::{Bounces, MOST_ROW_BYTES};
use super::kernel::{Scratch, bake_point};
use super::least_squares::LeastSquares;
use super::plan::Plan;
use super::posed::{Posed, Stage};
use super::sites;
use super::skin::Skin;
use super::surroundings::{NO_POINT, Surroundings, Trees};
use super::{
    BakedPose, Error, MOST_SITES, Noise, Openings, PosedMesh, Reflectance, Settings, Signal,
};

/// Rays per task: a few milliseconds, so that cores end together and cancelling is prompt.
const RAYS_PER_TASK: usize = 1 << 14;

/// Poses are prepared in waves of at least one per thread, and of so many points in all that the
/// ends of waves do not show.
const POINTS_PER_WAVE: usize = 1 << 14;

/// Bakes poses of one mesh.
#[derive(Debug)]
pub struct Baker {
    pub(super) stage: Stage,
    pub(super) plan: Plan,
    pub(super) reflectance: Option<Reflectance>,
    pub(super) adaptive: Option<Adaptive>,
    pub(super) skin: Option<Skin>,
    /// What a pose's hits may take before each bounce traces anew.
    pub(super) most_row_bytes: u64,
}

/// The points of one pose that one task bakes.
struct Task<'a> {
    posed: &'a Posed,
    first_point: usize,
    coefficients: &'a mut [f32],
    noise: &'a mut [f32],
}

impl Baker {
    /// Checks the mesh and the settings and computes the tables.
    ///
    /// # Errors
    /// Rays or maximum distance out of range, a triangle or a point that names a vertex that does
    /// not exist, a vertex without a point, or a tracer that does not start.
    pub fn new(
        triangles: &[[u32; 3]],
        points: &Points,
        settings: &Settings,
    ) -> Result<Self, Error> {
        check(triangles, points)?;
        let plan = Plan::new(settings)?;
        let device = Device::new().map_err(|source| Error::Tracer { source })?;
        let stage = Stage {
            device,
            triangles: triangles.to_vec(),
            points: points.clone(),
            borders: Borders::of(triangles, points),
            trees: Trees::one(triangles),
            surroundings: Surroundings::default(),
            openings: None,
            fit: None,
            max_distance_m: plan.max_distance_m,
        };
        Ok(Self {
            stage,
            plan,
            reflectance: None,
            adaptive: None,
            skin: None,
            most_row_bytes: MOST_ROW_BYTES,
        })
    }

    /// The same within surroundings.
    ///
    /// # Errors
    /// Lengths out of range, a fall-off of another signal or without a maximum distance, a view
    /// of points that do not exist.
    pub fn within(mut self, surroundings: Surroundings) -> Result<Self, Error> {
        surroundings.check(self.plan.max_distance_m, self.plan.signal == Signal::Ao)?;
        let Stage { triangles, points, .. } = &self.stage;
        self.stage.trees = Trees::new(triangles, points, &surroundings.views)?;
        self.plan.falloff = surroundings.falloff;
        self.stage.surroundings = surroundings;
        Ok(self)
    }

    /// The same with surfaces that do not block every ray.
    #[must_use]
    pub fn through(mut self, openings: Openings) -> Self {
        self.stage.openings = Some(Arc::new(openings));
        self
    }

    /// The same with light that comes by way of other surfaces.
    ///
    /// # Errors
    /// Bounces or channels out of range, or a signal other than transfer.
    pub fn reflecting(mut self, reflectance: Reflectance) -> Result<Self, Error> {
        reflectance.check(self.plan.signal)?;
        self.reflectance = Some(reflectance);
        Ok(self)
    }

    /// The same for vertices fitted to samples all over the surface: `per_point` places for each
    /// point in the mean, by the areas of the mesh at `positions`, each with the settings' rays.
    /// Call it after [`Self::within`].
    ///
    /// # Errors
    /// Samples out of range, no surface, or a baker of bounces or of a target noise.
    pub fn fitted(mut self, positions: &[Vec3], per_point: u32) -> Result<Self, Error> {
        if self.reflectance.is_some() || self.adaptive.is_some() {
            return Err(Error::FitOf);
        }
        if !(1..=MOST_SITES).contains(&per_point) {
            return Err(Error::Sites { found: per_point });
        }
        let sites = sites::spread(&self.stage, positions, per_point);
        self.stage.fit = Some(LeastSquares::new(&self.stage, positions, sites)?);
        Ok(self)
    }

    /// The same with as many rays at each point as a noise takes, at most `settings.rays`, to which
    /// a pilot of 16 adds at some. With bounces the target is that of the direct part, whose rays the
    /// bounces share.
    /// `settings` are those of [`Self::new`]; call this last.
    ///
    /// # Errors
    /// A target that is not positive, or a fit of vertices.
    pub fn to_noise(self, noise: Noise, settings: &Settings) -> Result<Self, Error> {
        self.to_noise_beside(noise, settings, &[])
    }

    /// The same for what is merged with earlier rounds of so many rays each, weighed by their rays: the target
    /// is that of all together. What the earlier rays found has no say in it; what so many rays leave of an
    /// outline has. A point that has enough gets none, and counts for nothing in this bake, but for bounces
    /// and light below the surface, which gather from everywhere.
    ///
    /// # Errors
    /// As [`Self::to_noise`].
    pub fn to_noise_beside(
        mut self,
        noise: Noise,
        settings: &Settings,
        rounds: &[u32],
    ) -> Result<Self, Error> {
        if self.stage.fit.is_some() {
            return Err(Error::FitOf);
        }
        let gathers = self.reflectance.is_some() || self.skin.is_some();
        let before = Before { rounds, everywhere: gathers };
        let falloff = self.plan.falloff;
        self.adaptive = Some(Adaptive::new(noise, settings, falloff, &self.stage, &before)?);
        Ok(self)
    }

    /// Colour channels of the coefficients: 1 where nothing has a colour, else 3.
    #[must_use]
    pub fn channels(&self) -> usize {
        let surface = self.reflectance.as_ref().map_or(1, |reflectance| reflectance.channels);
        self.skin.as_ref().map_or(surface, |skin| skin.channels(surface))
    }

    /// How many points each pose has.
    #[must_use]
    pub fn points(&self) -> usize {
        self.stage.points.vertex.len()
    }

    /// How many rays each point of each pose gets; the most, where that is a matter of noise.
    #[must_use]
    pub fn rays_per_point(&self) -> usize {
        self.plan.rays()
    }

    /// How many poses are worked on together; calls of so many, or of a multiple, waste nothing.
    #[must_use]
    pub fn wave(&self) -> usize {
        self.poses_per_wave(rayon::current_num_threads())
    }

    /// Bakes poses with all threads of the current rayon pool. What a pose gets does not depend on
    /// the others, nor on the number of threads.
    ///
    /// # Errors
    /// A pose of another shape or with a vertex that is not finite, a tracer that fails, or
    /// [`Error::Cancelled`] soon after `cancelled` becomes true.
    pub fn bake(
        &self,
        poses: &[PosedMesh<'_>],
        cancelled: &AtomicBool,
    ) -> Result<Vec<BakedPose>, Error> {
        let wave = self.wave();
        let mut baked = Vec::with_capacity(poses.len());
        for (index, wave_poses) in poses.chunks(wave).enumerate() {
            let posed = self.prepare(wave_poses, index * wave, cancelled)?;
            let traced = self.traced(&posed, wave_poses, cancelled)?;
            for (pose, mesh) in traced.into_iter().zip(wave_poses) {
                baked.push(self.diffused(pose, mesh, cancelled)?);
            }
        }
        Ok(baked)
    }

    /// What rays say of a wave of poses.
    fn traced(
        &self,
        posed: &[Posed],
        meshes: &[PosedMesh<'_>],
        cancelled: &AtomicBool,
    ) -> Result<Vec<BakedPose>, Error> {
        match (&self.adaptive, &self.reflectance) {
            (None, None) => {
                let traced = self.trace(posed, cancelled)?;
                Ok(traced.into_iter().map(|pose| self.at_points(pose)).collect())
            }
            (Some(adaptive), None) => {
                posed.iter().map(|posed| adaptive.bake(posed, cancelled)).collect()
            }
            (_, Some(reflectance)) => {
                let one = |(posed, mesh): (&Posed, &PosedMesh<'_>)| {
                    self.bounces(reflectance, (posed, mesh.normals), cancelled).bake()
                };
                posed.iter().zip(meshes).map(one).collect()
            }
        }
    }

    /// A pose whose surfaces pass light on.
    pub(super) fn bounces<'a>(
        &'a self,
        reflectance: &'a Reflectance,
        (posed, normals): (&'a Posed, &'a [Vec3]),
        cancelled: &'a AtomicBool,
    ) -> Bounces<'a> {
        Bounces {
            plan: &self.plan,
            stage: &self.stage,
            posed,
            normals,
            reflectance,
            adaptive: self.adaptive.as_ref(),
            most_row_bytes: self.most_row_bytes,
            cancelled,
        }
    }

    /// At least one pose per thread: scenes are built one per thread at a time.
    pub(super) fn poses_per_wave(&self, threads: usize) -> usize {
        let for_points = POINTS_PER_WAVE / self.points().max(1);
        for_points.clamp(1, 64).next_multiple_of(threads.max(1))
    }

    pub(super) fn prepare(
        &self,
        poses: &[PosedMesh<'_>],
        first: usize,
        cancelled: &AtomicBool,
    ) -> Result<Vec<Posed>, Error> {
        let one = |(index, mesh): (usize, &PosedMesh<'_>)| {
            let pose = first + index;
            if cancelled.load(Ordering::Relaxed) {
                return Err(Error::Cancelled);
            }
            Posed::new(&self.stage, pose, mesh)
        };
        let posed: Vec<Result<Posed, Error>> =
            poses.par_iter().with_max_len(1).enumerate().map(one).collect();
        // The first error by index, whatever the threads did.
        posed.into_iter().collect()
    }

    /// Rays from every origin of some poses.
    pub(super) fn trace(
        &self,
        posed: &[Posed],
        cancelled: &AtomicBool,
    ) -> Result<Vec<BakedPose>, Error> {
        let count = self.plan.coefficients;
        let empty = |posed: &Posed| {
            let points = posed.origins.len();
            BakedPose {
                coefficients: vec![0.0; points * count],
                noise: vec![0.0; points],
                rays: vec![self.plan.rays() as u32; points],
            }
        };
        let mut baked: Vec<BakedPose> = posed.iter().map(empty).collect();
        let chunk = (RAYS_PER_TASK / self.plan.rays()).max(1);
        let tasks: Vec<Task<'_>> = posed
            .iter()
            .zip(&mut baked)
            .flat_map(|(posed, baked)| {
                let coefficients = baked.coefficients.chunks_mut(chunk * count);
                let chunks = coefficients.zip(baked.noise.chunks_mut(chunk)).enumerate();
                chunks.map(move |(index, (coefficients, noise))| Task {
                    posed,
                    first_point: index * chunk,
                    coefficients,
                    noise,
                })
            })
            .collect();
        tasks.into_par_iter().with_max_len(1).try_for_each_init(
            || Scratch::new(&self.plan),
            |scratch, task| self.run(task, scratch, cancelled),
        )?;
        Ok(baked)
    }

    /// Fits points to sites, where those were traced.
    pub(super) fn at_points(&self, pose: BakedPose) -> BakedPose {
        let Some(fit) = &self.stage.fit else { return pose };
        let mean = (pose.rays.len() as f64 / fit.points() as f64 * self.plan.rays() as f64).round();
        let bounds = (self.plan.signal == Signal::Ao).then_some([0.0, 1.0]);
        BakedPose {
            coefficients: fit.solve(&pose.coefficients, self.plan.coefficients, bounds),
            noise: fit.noise(&pose.noise),
            rays: vec![mean as u32; fit.points()],
        }
    }

    fn run(
        &self,
        task: Task<'_>,
        scratch: &mut Scratch,
        cancelled: &AtomicBool,
    ) -> Result<(), Error> {
        if cancelled.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        let outputs = task.coefficients.chunks_exact_mut(self.plan.coefficients).zip(task.noise);
        for (point, (out, noise)) in (task.first_point..).zip(outputs) {
            *noise = bake_point(&self.plan, task.posed, point, scratch, None, out);
        }
        Ok(())
    }
}

fn check(triangles: &[[u32; 3]], points: &Points) -> Result<(), Error> {
    let vertices = points.of_vertex.len();
    for (triangle, corners) in triangles.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&corner| corner as usize >= vertices) {
            return Err(Error::Triangle { triangle, vertex, vertices });
        }
    }
    let maps = [
        ("vertex of point", &points.vertex, vertices),
        ("point of vertex", &points.of_vertex, points.vertex.len()),
    ];
    for (map, values, limit) in maps {
        // Occluders are vertices without a point.
        let none = |value: u32| map == "point of vertex" && value == NO_POINT;
        let wrong = |&value: &u32| value as usize >= limit && !none(value);
        if let Some(key) = values.iter().position(wrong) {
            return Err(Error::Points { map, key, value: values[key], limit });
        }
    }
    Ok(())
}
