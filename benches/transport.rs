//! `cargo bench --bench transport [-- bounces|rays]`: what light between surfaces costs, and what rays buy.
//!
//! Bounces: wall time of a bake of one to three bounces over the direct one's, same poses, taken
//! in turns. Rays: the error of ambient occlusion against a bake of 32,768 rays over the number of
//! rays, beside plain random rays (whose error follows from the share p that is blocked: p(1−p)/n)
//! and beside rays that adapt to a stated noise, at equal RMSE and at an equal error of the worst points; and the slopes of all signals, as `convergence.svg` in the
//! folder that POSELIGHT_PLOTS names (`target` without). MH_Male_CMU02 or the character that
//! POSELIGHT_CHARACTER names in the asset folder's `rigged`; where there is none, the bundled figure.

#![expect(clippy::print_stdout, reason = "a benchmark prints its tables")]
#![expect(clippy::unwrap_used, reason = "a benchmark ends where something fails")]

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use poselight::bake::{
    BakedPose, Baker, Noise, NoiseGoal, PosedMesh, Reflectance, Settings, Signal,
};
use poselight::measure::report::{Lines, Series, slopes};
use poselight::pose::{self, PoseSet};
use poselight::rig::{self, Deformed};
use poselight::scene::{self, Limits, Scene, Surface, figure};
use poselight::sh::Order;

/// Poses of each measurement.
const POSES: usize = 4;

/// Times that times are taken.
const ROUNDS: usize = 5;

fn main() {
    let (name, scene) = character();
    let set = pose::sample(&scene, &pose::Settings::default()).unwrap();
    let all = set.samples.len();
    let posed: Vec<Deformed> =
        (0..POSES).map(|i| deformed(&scene, &set, i * all / POSES)).collect();
    println!(
        "{name}: {} points, {} triangles, {POSES} poses, {} threads\n",
        set.points.count(),
        scene.mesh.triangles.len(),
        rayon::current_num_threads()
    );
    let stage = Stage { scene: &scene, set: &set, posed: &posed };
    let asked = |part: &str| {
        let parts = ["bounces", "rays"];
        let mut named = std::env::args().filter(|arg| parts.contains(&arg.as_str())).peekable();
        named.peek().is_none() || named.any(|arg| arg == part)
    };
    if asked("bounces") {
        stage.bounces();
    }
    if asked("rays") {
        stage.rays();
    }
}

struct Stage<'a> {
    scene: &'a Scene,
    set: &'a PoseSet,
    posed: &'a [Deformed],
}

impl Stage<'_> {
    fn baker(&self, signal: Signal, rays: u32, seed: u64) -> Baker {
        let settings = settings(signal, rays, seed);
        Baker::new(&self.scene.mesh.triangles, &self.set.points, &settings).unwrap()
    }

    fn bake(&self, baker: &Baker) -> Vec<BakedPose> {
        let meshes: Vec<PosedMesh<'_>> = (0..self.posed.len()).map(|i| self.mesh(i)).collect();
        baker.bake(&meshes, &AtomicBool::new(false)).unwrap()
    }

    fn mesh(&self, index: usize) -> PosedMesh<'_> {
        let Deformed { positions, normals } = &self.posed[index];
        PosedMesh { positions, normals, clip_key: 1, time_s: index as f32 }
    }

    fn bounces(&self) {
        let triangles = self.scene.mesh.triangles.len();
        let reflecting = |bounces, albedo: [f32; 3], channels| {
            let surface = Arc::new(Surface::plain(albedo, triangles));
            let reflectance = Reflectance { bounces, channels, surface };
            self.baker(Signal::Transfer, 500, 1).reflecting(reflectance).unwrap()
        };
        let direct = self.baker(Signal::Transfer, 500, 1);
        println!(
            "| bounces, 500 rays, order 6 | channels | time over the direct bake's |\n|---|---|---|"
        );
        for (bounces, albedo, channels) in
            [(1, [0.5; 3], 1), (3, [0.5; 3], 1), (3, [0.7, 0.5, 0.3], 3)]
        {
            let bounced = reflecting(bounces, albedo, channels);
            let ratio = || {
                let times = [&direct, &bounced].map(|baker| {
                    let start = Instant::now();
                    std::hint::black_box(self.bake(baker));
                    start.elapsed().as_secs_f64()
                });
                times[1] / times[0]
            };
            let ratios = (0..ROUNDS).map(|_| ratio()).collect();
            println!("| {bounces} | {channels} | {:.2} |", median(ratios));
        }
        println!();
    }

    fn rays(&self) {
        let truth = self.bake(&self.baker(Signal::Ao, 32_768, 99));
        let random = |rays: f64| {
            let variance = |ao: f32| f64::from(ao) * f64::from(1.0 - ao) / rays;
            let all = truth.iter().flat_map(|pose| &pose.coefficients);
            (all.clone().map(|&ao| variance(ao)).sum::<f64>() / all.count() as f64).sqrt()
        };
        println!(
            "| rays per point | RMSE of ambient occlusion | claimed | random rays' RMSE | random rays for the same |\n|---|---|---|---|---|"
        );
        let (mut table, mut worst) = (Vec::new(), Vec::new());
        for rays in [32, 64, 128, 256, 512, 1024, 2048, 4096] {
            let baked = self.bake(&self.baker(Signal::Ao, rays, 1));
            let (error, claimed) = (rmse(&baked, &truth), claimed(&baked));
            worst.push((f64::from(rays), worst_error(&baked, &truth)));
            let rays = f64::from(rays);
            let same = rays * (random(rays) / error).powi(2);
            println!("| {rays} | {error:.5} | {claimed:.5} | {:.5} | {same:.0} |", random(rays));
            table.push((rays, error));
        }
        println!("\nThe error falls as rays to the power of {:.2}.", slope(&table));
        let needed = interpolate(&table, random(512.0));
        println!("The RMSE of 512 random rays takes {needed:.0} rays, {:.0} %.\n", needed / 5.12);
        println!(
            "| stated noise | goal | RMSE | claimed | rays per point, pilot included | uniform rays for the same RMSE | share | error of the worst hundredth of points, at least | uniform rays for the same | share |\n|---|---|---|---|---|---|---|---|---|---|"
        );
        for goal in [NoiseGoal::Each, NoiseGoal::Mean] {
            for target in [0.02, 0.01, 0.005, 0.0025] {
                self.to_noise(Noise { target, goal }, (&table, &worst), &truth);
            }
        }
        let random = table.iter().map(|&(rays, _)| (rays, random(rays))).collect();
        self.plot(vec![("ao".into(), table), ("ao by random rays".into(), random)]);
    }

    /// Errors of the other signals too, with their slopes, as a picture.
    fn plot(&self, mut series: Vec<Series>) {
        println!("\n| signal | the error falls as rays to the power of |\n|---|---|");
        for signal in [Signal::Visibility, Signal::Transfer] {
            let truth = self.bake(&self.baker(signal, 32_768, 99));
            let error = |rays: u32| {
                (f64::from(rays), rmse(&self.bake(&self.baker(signal, rays, 1)), &truth))
            };
            let table: Vec<(f64, f64)> = [32, 64, 128, 256, 512, 1024, 2048].map(error).into();
            println!("| {}, order 6 | {:.2} |", signal.name(), slope(&table));
            series.push((format!("{}, order 6", signal.name()), table));
        }
        for (name, table) in &mut series {
            *name += &format!(": rays^{:.2}", slope(table));
        }
        let (title, x_name) = ("Error of a bake", "rays per point");
        let lines = Lines { title, x_name, y_name: "RMSE", log_x: true, series: &series };
        let folder = std::env::var_os("POSELIGHT_PLOTS").map_or("target".into(), PathBuf::from);
        let file = folder.join("convergence.svg");
        std::fs::write(&file, slopes(&lines)).unwrap();
        println!("\n{}", file.display());
    }

    fn to_noise(&self, noise: Noise, (table, worst): (&Table, &Table), truth: &[BakedPose]) {
        let settings = settings(Signal::Ao, 16_384, 1);
        let baker = self.baker(Signal::Ao, 16_384, 1).to_noise(noise, &settings).unwrap();
        let baked = self.bake(&baker);
        let counts = baked.iter().flat_map(|pose| &pose.rays);
        let spent = counts.clone().map(|&n| f64::from(n)).sum::<f64>() / counts.count() as f64;
        let error = rmse(&baked, truth);
        let (uniform, tail) = (interpolate(table, error), worst_error(&baked, truth));
        let as_sure = interpolate(worst, tail);
        println!(
            "| {} | {:?} | {error:.5} | {:.5} | {spent:.0} | {uniform:.0} | {:.0} % | {tail:.4} | {as_sure:.0} | {:.0} % |",
            noise.target,
            noise.goal,
            claimed(&baked),
            100.0 * spent / uniform,
            100.0 * spent / as_sure
        );
    }
}

/// Errors over rays.
type Table = [(f64, f64)];

fn settings(signal: Signal, rays: u32, seed: u64) -> Settings {
    Settings { signal, order: Order::new(6).unwrap(), rays, max_distance_m: None, seed }
}

/// The power of rays that the error goes with, from the first to the last.
fn slope(table: &Table) -> f64 {
    let (first, last) = (table[0], table[table.len() - 1]);
    (last.1 / first.1).ln() / (last.0 / first.0).ln()
}

/// Rays at which the table has this error, along straight lines between logarithms.
fn interpolate(table: &Table, error: f64) -> f64 {
    let at = table.iter().position(|&(_, e)| e <= error).unwrap_or(table.len() - 1).max(1);
    let [(r0, e0), (r1, e1)] = [table[at - 1], table[at]].map(|(r, e)| (r.ln(), e.ln()));
    (r0 + (error.ln() - e0) / (e1 - e0) * (r1 - r0)).exp()
}

fn rmse(baked: &[BakedPose], truth: &[BakedPose]) -> f64 {
    let values = |poses: &[BakedPose]| -> Vec<f64> {
        poses.iter().flat_map(|pose| &pose.coefficients).map(|&v| f64::from(v)).collect()
    };
    let (a, b) = (values(baked), values(truth));
    (a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

/// The error that a hundredth of the points exceeds.
fn worst_error(baked: &[BakedPose], truth: &[BakedPose]) -> f64 {
    let values = |poses: &'_ [BakedPose]| -> Vec<f32> {
        poses.iter().flat_map(|pose| &pose.coefficients).copied().collect()
    };
    let mut errors: Vec<f32> =
        values(baked).iter().zip(values(truth)).map(|(a, b)| (a - b).abs()).collect();
    let at = errors.len() - 1 - errors.len() / 100;
    f64::from(*errors.select_nth_unstable_by(at, f32::total_cmp).1)
}

fn claimed(baked: &[BakedPose]) -> f64 {
    let all: Vec<f64> =
        baked.iter().flat_map(|pose| &pose.noise).map(|&n| f64::from(n).powi(2)).collect();
    (all.iter().sum::<f64>() / all.len() as f64).sqrt()
}

fn character() -> (String, Scene) {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/assets");
    let assets = std::env::var_os("POSELIGHT_ASSETS").map_or(PathBuf::from(beside), PathBuf::from);
    let name = std::env::var("POSELIGHT_CHARACTER").unwrap_or("MH_Male_CMU02".into());
    let path = assets.join(format!("rigged/{name}.glb"));
    if path.exists() {
        return (name, scene::import(&path, &Limits::default()).unwrap());
    }
    let source = scene::Source { name: "figure.glb".into(), bytes: figure::figure() };
    let scene = scene::import_sources(vec![source], &Limits::default()).unwrap();
    ("the bundled figure".into(), scene)
}

fn deformed(scene: &Scene, set: &PoseSet, index: usize) -> Deformed {
    let sample = &set.samples[index];
    let globals = scene.skeleton.globals(&sample.pose.local);
    let mut out = Deformed::default();
    rig::deform(&scene.mesh, &globals, &sample.pose.weights, sample.root, &mut out);
    out
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}
