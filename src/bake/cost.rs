//! What a bake will take: memory by counting, time by a short trial.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::adaptive::Adaptive;
use super::kernel::{Scratch, bake_point};
use super::posed::Posed;
use super::{BakedPose, Baker, Error, PosedMesh};

/// Bytes that the tracer needs per triangle and per vertex, measured with margin.
const SCENE_BYTES_PER_TRIANGLE: u64 = 400;

/// A point that takes this many times the median was waited for, not cast: other work had the processor.
const WAITED: f64 = 4.0;

/// How often a pose is made ready, at most, to see how long that takes.
const TRIES: u32 = 5;

/// What a short trial says of a machine and a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// All threads together; what gathers along the rays of bounces is in it.
    pub rays_per_s: f64,
    /// The mean over the points of the trial.
    pub rays_per_point: f64,
    /// One thread, one pose: check, scale and build, and what follows the rays, seconds.
    pub prepare_s: f64,
}

impl Baker {
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
        let channels = self.channels() as u64;
        let bounces = reflectance.map_or(0, |r| r.memory_bytes(&self.plan, points));
        let result = poses as u64 * points * 4 * (coefficients * channels + 2) + bounces;
        let scratch = threads as u64
            * 4
            * (4 * self.plan.directions.directions() as u64
                + self.plan.blocks as u64 * coefficients);
        // A tree has a node for about every other point, its sums in double precision.
        let tree = self.skin.as_ref().map_or(0, |_| points * (4 * coefficients * channels + 120));
        self.table_bytes() + tree + in_flight * per_pose + result + scratch
    }

    /// Of the tables, which are there as long as the baker is, bytes.
    #[must_use]
    pub fn table_bytes(&self) -> u64 {
        self.plan.memory_bytes() + self.adaptive.as_ref().map_or(0, Adaptive::memory_bytes)
    }

    /// Bakes as many points of a pose as fit in `budget_s` seconds or so, evenly spread, and says
    /// how fast that went: on threads of its own, and without the times during which other work had
    /// the processor.
    ///
    /// # Errors
    /// As [`Self::bake`].
    pub fn calibrate(&self, pose: &PosedMesh<'_>, budget_s: f64) -> Result<Calibration, Error> {
        let threads = rayon::current_num_threads();
        // Those of the pool may be at work for somebody else, and to wait for them is not to cast.
        match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            Ok(own) => own.install(|| self.trial(pose, budget_s)),
            Err(_) => self.trial(pose, budget_s),
        }
    }

    /// The trial on the threads of the pool that it runs in.
    fn trial(&self, pose: &PosedMesh<'_>, budget_s: f64) -> Result<Calibration, Error> {
        let (mut posed, prepare_s) = self.prepared(pose, budget_s)?;
        let Some(posed) = posed.pop().filter(|_| self.points() > 0) else {
            let rays_per_point = self.plan.rays() as f64;
            return Ok(Calibration { rays_per_s: f64::INFINITY, rays_per_point, prepare_s });
        };
        let threads = rayon::current_num_threads();
        let prepare_s = prepare_s + self.follow_s(pose)? * threads as f64;
        let times = rayon::broadcast(|context| {
            self.point_times(pose, &posed, (context.index(), threads), budget_s)
        });
        let processors = std::thread::available_parallelism().map_or(threads, usize::from);
        let at_once = threads.min(processors) as f64;
        let rays_per_s = at_once * self.plan.rays() as f64 / typical(times.concat());
        let rays_per_point = match &self.adaptive {
            Some(adaptive) => adaptive.rays_per_point(&posed)?,
            None => {
                let sites = self.stage.fit.as_ref().map_or(self.points(), |fit| fit.sites.len());
                self.plan.rays() as f64 * sites as f64 / self.points() as f64
            }
        };
        Ok(Calibration { rays_per_s, rays_per_point, prepare_s })
    }

    /// A pose that is ready to be traced, and what that takes: the least time of a few tries, if there
    /// is time for them, since other work can only lengthen it.
    fn prepared(&self, pose: &PosedMesh<'_>, budget_s: f64) -> Result<(Vec<Posed>, f64), Error> {
        let (begin, mut least_s, mut tries) = (Instant::now(), f64::INFINITY, 0);
        loop {
            let start = Instant::now();
            let posed = self.prepare(std::slice::from_ref(pose), 0, &AtomicBool::new(false))?;
            least_s = start.elapsed().as_secs_f64().min(least_s);
            tries += 1;
            if tries == TRIES || begin.elapsed().as_secs_f64() > budget_s / 2.0 {
                return Ok((posed, least_s));
            }
        }
    }

    /// Seconds of each point that one of `threads` threads bakes within its time, at least one.
    fn point_times(
        &self,
        pose: &PosedMesh<'_>,
        posed: &Posed,
        (thread, threads): (usize, usize),
        budget_s: f64,
    ) -> Vec<f64> {
        let mut scratch = Scratch::new(&self.plan);
        let mut out = vec![0.0; self.plan.coefficients];
        let never = AtomicBool::new(false);
        let bounces = self.reflectance.as_ref();
        let bounces = bounces.map(|r| self.bounces(r, (posed, pose.normals), &never));
        let mut passes = bounces.as_ref().map(|bounces| {
            let width = self.plan.coefficients * bounces.reflectance.channels;
            let from = vec![1.0; self.points() * width];
            (bounces, bounces.sink(&self.plan), from, vec![0.0; 3 * width])
        });
        let mut times = Vec::new();
        // Of this thread: it may have begun later than others.
        let begin = Instant::now();
        let mut last_s = 0.0;
        while times.is_empty() || last_s < budget_s {
            // An odd multiplier of the golden ratio visits the mesh evenly.
            let step = (times.len() * threads + thread) as u64 * 0x9e37_79b9;
            let point = ((step & 0xffff_ffff) * self.points() as u64) >> 32;
            match &mut passes {
                Some((bounces, sink, from, sums)) => {
                    bounces.rehearse(point as usize, (&mut scratch, sink), from, sums);
                }
                None => {
                    bake_point(&self.plan, posed, point as usize, &mut scratch, None, &mut out);
                }
            }
            let now_s = begin.elapsed().as_secs_f64();
            times.push(now_s - last_s);
            last_s = now_s;
        }
        times
    }

    /// How long all threads take for what follows a pose's rays, to fit its vertices and to diffuse it,
    /// seconds.
    fn follow_s(&self, pose: &PosedMesh<'_>) -> Result<f64, Error> {
        let sites = self.stage.fit.as_ref().map(|fit| {
            let (sites, count) = (fit.sites.len(), self.plan.coefficients);
            // Of values that differ from site to site, as a solver stops at once where there is nothing to find.
            let value = |i: usize| (i as f32 * 0.618).fract();
            let coefficients = (0..sites * count).map(value).collect();
            BakedPose { coefficients, noise: vec![0.0; sites], rays: vec![0; sites] }
        });
        let start = Instant::now();
        sites.map(|sites| self.at_points(sites));
        let (points, count) = (self.points(), self.plan.coefficients);
        let channels = self.reflectance.as_ref().map_or(1, |reflectance| reflectance.channels);
        if self.skin.is_some() {
            let coefficients = vec![0.0; points * channels * count];
            let empty = BakedPose { coefficients, noise: vec![0.0; points], rays: vec![0; points] };
            self.diffused(empty, pose, &AtomicBool::new(false))?;
        }
        Ok(start.elapsed().as_secs_f64())
    }
}

/// The mean of some times, at least one, without those that were waited for.
fn typical(mut times: Vec<f64>) -> f64 {
    times.sort_unstable_by(f64::total_cmp);
    // A clock that does not tell two moments apart must not make a point take no time.
    let most = (WAITED * times[times.len() / 2]).max(times[0]);
    let usual = &times[..times.partition_point(|&time| time <= most).max(1)];
    (usual.iter().sum::<f64>() / usual.len() as f64).max(f64::EPSILON)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A few points that were waited for, however long, change nothing; those that differ as points do
    /// all count.
    #[test]
    fn waiting_is_not_casting() {
        assert_eq!(typical(vec![3.0]), 3.0);
        assert_eq!(typical(vec![1.0, 2.0, 3.0, 2.0]), 2.0);
        assert_eq!(typical(vec![1.0, 2.0, 3e7, 3.0, 2.0]), 2.0);
        assert!(typical(vec![0.0; 5]) > 0.0);
    }
}
