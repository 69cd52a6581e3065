//! Poses in, coefficients out, with all cores busy.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;

use crate::rig::Points;
use crate::trace::Device;

use super::adaptive::Adaptive;
use super::bounce::{Bounces, MOST_ROW_BYTES};
use super::kernel::{Scratch, bake_point};
use super::least_squares::LeastSquares;
use super::plan::Plan;
use super::posed::{Posed, Stage};
use super::seen::Sink;
use super::surroundings::{NO_POINT, Surroundings, Trees};
use super::{BakedPose, Error, MOST_SITES, PosedMesh, Reflectance, Settings, Signal, sites};

/// Rays per task: a few milliseconds, so that cores end together and cancelling is prompt.
const RAYS_PER_TASK: usize = 1 << 14;

/// Poses are prepared in waves of at least one per thread, and of so many points in all that the
/// ends of waves do not show.
const POINTS_PER_WAVE: usize = 1 << 14;

/// Bytes that the tracer needs per triangle and per vertex, measured with margin.
const SCENE_BYTES_PER_TRIANGLE: u64 = 400;

/// Points of a trial of how many rays a stated noise takes.
const TRIAL_POINTS: usize = 512;

/// Bakes poses of one mesh.
#[derive(Debug)]
pub struct Baker {
    stage: Stage,
    plan: Plan,
    reflectance: Option<Reflectance>,
    adaptive: Option<Adaptive>,
    /// What a pose's hits may take before each bounce traces anew.
    pub(super) most_row_bytes: u64,
}

/// What a short trial says of a machine and a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// All threads together.
    pub rays_per_s: f64,
    /// The mean over the points of the trial.
    pub rays_per_point: f64,
    /// One thread, one pose: check, scale and build, seconds.
    pub prepare_s: f64,
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
            trees: Trees::one(triangles),
            surroundings: Surroundings::default(),
            fit: None,
            max_distance_m: plan.max_distance_m,
        };
        let (reflectance, adaptive) = (None, None);
        Ok(Self { stage, plan, reflectance, adaptive, most_row_bytes: MOST_ROW_BYTES })
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

    /// The same with as many rays at each point as it takes for a standard error of `target`, in the
    /// unit of [`BakedPose::noise`], and at most `settings.rays`, to which a pilot of 48 adds.
    /// `settings` are those of [`Self::new`]; call this last.
    ///
    /// # Errors
    /// A target that is not positive, or bounces.
    pub fn to_noise(mut self, target: f32, settings: &Settings) -> Result<Self, Error> {
        if self.stage.fit.is_some() {
            return Err(Error::FitOf);
        }
        if self.reflectance.is_some() {
            return Err(Error::NoiseOfBounces);
        }
        let falloff = self.plan.falloff;
        self.adaptive = Some(Adaptive::new(target, settings, falloff, &self.stage)?);
        Ok(self)
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
            match (&self.adaptive, &self.reflectance) {
                (None, None) => {
                    let traced = self.trace(&posed, cancelled)?;
                    baked.extend(traced.into_iter().map(|pose| self.at_points(pose)));
                }
                (Some(adaptive), _) => {
                    for posed in &posed {
                        baked.push(adaptive.bake(posed, cancelled)?);
                    }
                }
                (None, Some(reflectance)) => {
                    for (posed, mesh) in posed.iter().zip(wave_poses) {
                        let (plan, stage, normals) = (&self.plan, &self.stage, mesh.normals);
                        let most_row_bytes = self.most_row_bytes;
                        let bounces = Bounces {
                            plan,
                            stage,
                            posed,
                            normals,
                            reflectance,
                            most_row_bytes,
                            cancelled,
                        };
                        baked.push(bounces.bake()?);
                    }
                }
            }
        }
        Ok(baked)
    }

    /// The most memory that [`Self::bake`] adds for so many poses in one call on so many threads,
    /// result and tables included, in bytes; an upper estimate.
    #[must_use]
    pub fn memory_bytes(&self, poses: usize, threads: usize) -> u64 {
        let points = self.stage.fit.as_ref().map_or(self.points(), |fit| fit.sites.len()) as u64;
        let vertices = self.stage.points.of_vertex.len() as u64;
        let coefficients = self.plan.coefficients as u64;
        let triangles = self.stage.trees.count() as u64;
        let in_flight = poses.min(self.poses_per_wave(threads)) as u64;
        let per_pose = triangles * SCENE_BYTES_PER_TRIANGLE + 24 * vertices + 44 * points;
        let reflectance = self.reflectance.as_ref();
        let channels = reflectance.map_or(1, |r| r.channels as u64);
        let bounces = reflectance.map_or(0, |r| r.memory_bytes(&self.plan, points));
        let result = poses as u64 * points * 4 * (coefficients * channels + 2) + bounces;
        let scratch = threads as u64
            * 4
            * (4 * self.plan.directions.directions() as u64
                + self.plan.blocks as u64 * coefficients);
        let ladder = self.adaptive.as_ref().map_or(0, Adaptive::memory_bytes);
        self.plan.memory_bytes() + ladder + in_flight * per_pose + result + scratch
    }

    /// Bakes as many points of a pose as fit in `budget_s` seconds or so, evenly spread, and says
    /// how fast that went.
    ///
    /// # Errors
    /// As [`Self::bake`].
    pub fn calibrate(&self, pose: &PosedMesh<'_>, budget_s: f64) -> Result<Calibration, Error> {
        let start = Instant::now();
        let mut posed = self.prepare(std::slice::from_ref(pose), 0, &AtomicBool::new(false))?;
        let prepare_s = start.elapsed().as_secs_f64();
        let Some(posed) = posed.pop().filter(|_| self.points() > 0) else {
            let rays_per_point = self.plan.rays() as f64;
            return Ok(Calibration { rays_per_s: f64::INFINITY, rays_per_point, prepare_s });
        };
        let threads = rayon::current_num_threads();
        let start = Instant::now();
        let baked: usize = rayon::broadcast(|context| {
            let mut scratch = Scratch::new(&self.plan);
            let mut out = vec![0.0; self.plan.coefficients];
            let rays = self.plan.directions.directions();
            let sink = |_: &_| Sink::new(&self.stage, pose.normals, usize::MAX, rays);
            let mut sink = self.reflectance.as_ref().map(sink);
            let mut baked = 0;
            // At least one, however late the thread wakes up.
            while baked == 0 || start.elapsed().as_secs_f64() < budget_s {
                // An odd multiplier of the golden ratio visits the mesh evenly.
                let step = (baked * threads + context.index()) as u64 * 0x9e37_79b9;
                let point = ((step & 0xffff_ffff) * self.points() as u64) >> 32;
                let seen = sink.as_mut();
                bake_point(&self.plan, &posed, point as usize, &mut scratch, seen, &mut out);
                sink.as_mut().map(Sink::take);
                baked += 1;
            }
            baked
        })
        .into_iter()
        .sum();
        let rays_per_s = (baked * self.plan.rays()) as f64 / start.elapsed().as_secs_f64();
        let rays_per_point = match &self.adaptive {
            Some(adaptive) => adaptive.rays_per_point(&posed, TRIAL_POINTS),
            None => {
                let sites = self.stage.fit.as_ref().map_or(self.points(), |fit| fit.sites.len());
                self.plan.rays() as f64 * sites as f64 / self.points() as f64
            }
        };
        Ok(Calibration { rays_per_s, rays_per_point, prepare_s })
    }

    /// At least one pose per thread: scenes are built one per thread at a time.
    fn poses_per_wave(&self, threads: usize) -> usize {
        let for_points = POINTS_PER_WAVE / self.points().max(1);
        for_points.clamp(1, 64).next_multiple_of(threads.max(1))
    }

    fn prepare(
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

    fn trace(&self, posed: &[Posed], cancelled: &AtomicBool) -> Result<Vec<BakedPose>, Error> {
        let points = self.stage.fit.as_ref().map_or(self.points(), |fit| fit.sites.len());
        let count = self.plan.coefficients;
        let rays = vec![self.plan.rays() as u32; points];
        let empty = || BakedPose {
            coefficients: vec![0.0; points * count],
            noise: vec![0.0; points],
            rays: rays.clone(),
        };
        let mut baked: Vec<BakedPose> = posed.iter().map(|_| empty()).collect();
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
    fn at_points(&self, pose: BakedPose) -> BakedPose {
        let Some(fit) = &self.stage.fit else { return pose };
        let mean = (pose.rays.len() as f64 / fit.points() as f64 * self.plan.rays() as f64).round();
        BakedPose {
            coefficients: fit.solve(&pose.coefficients, self.plan.coefficients),
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
