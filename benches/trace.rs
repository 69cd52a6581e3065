//! Is the bake as fast as the tracer allows? `cargo bench --bench trace`
//!
//! Traces one and the same kind of rays (sorted cosine-weighted sets, 500 per point, every point
//! of a posed character) in a bare loop over prepared rays and by the baker (`transfer`, order 6),
//! in turns, and prints ratios: for two characters, a scan and a level where the assets are at hand
//! (environment variable POSELIGHT_ASSETS, or a folder `shared/assets` beside the repository), else
//! for the bundled figure.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a program that prints a table")]

use std::fs;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use glam::{Quat, Vec3};
use poselight::bake::{Baker, PosedMesh, Settings, Signal};
use poselight::num::directions::{Density, Directions};
use poselight::num::random::{hash, unit};
use poselight::pose::{self, PoseSet};
use poselight::rig::{Deformed, deform};
use poselight::scene::{self, Limits};
use poselight::sh::Order;
use poselight::trace::{Device, Rays, Scene, Width, words_of};
use rayon::prelude::*;

const RAYS: usize = 500;
const ROUNDS: usize = 3;

/// What is traced where the assets are at hand: two characters, a scan, a level.
const ASSETS: [&str; 4] = [
    "rigged/MH_Male_CMU02.glb",
    "rigged/KayKit_Knight.glb",
    "static/nefertiti_lowres.obj",
    "scene/zdm2.glb",
];

fn main() {
    let all = scenes();
    println!("{RAYS} rays per point, {} threads\n", rayon::current_num_threads());
    for (index, (name, scene)) in all.iter().enumerate() {
        let set = pose::sample(scene, &pose::Settings::default()).unwrap();
        let count = set.samples.len().min(if index == 0 { 32 } else { 1 });
        let posed: Vec<Deformed> =
            (0..count).map(|i| posed(scene, &set, i * set.samples.len() / count)).collect();
        let (points, triangles) = (set.points.count(), scene.mesh.triangles.len());
        println!("**{name}**: {points} points, {triangles} triangles\n");
        let settings = Settings {
            signal: Signal::Transfer,
            order: Order::new(6).unwrap(),
            rays: RAYS as u32,
            max_distance_m: None,
            seed: 1,
        };
        let baker = Baker::new(&scene.mesh.triangles, &set.points, &settings).unwrap();
        let bare = Bare::new(&scene.mesh.triangles, &set, &posed[count / 2]);
        let width = if index == 0 { widths(&bare) } else { bare.device.width() };
        compare(&baker, &bare, (&posed, &scene.mesh.triangles), width);
        if index == 0 {
            scaling(&baker, &posed);
        }
    }
}

/// The assets that are there; the bundled figure where none is.
fn scenes() -> Vec<(&'static str, scene::Scene)> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/assets");
    let assets = std::env::var_os("POSELIGHT_ASSETS").map_or(PathBuf::from(beside), PathBuf::from);
    let there = ASSETS.iter().filter(|name| assets.join(name).exists());
    let import = |name: &&'static str| {
        (*name, scene::import(&assets.join(name), &Limits::default()).unwrap())
    };
    let found: Vec<_> = there.map(import).collect();
    if !found.is_empty() {
        return found;
    }
    let source = scene::Source { name: "figure.glb".into(), bytes: scene::figure::figure() };
    let figure = scene::import_sources(vec![source], &Limits::default()).unwrap();
    vec![("bundled figure", figure)]
}

fn posed(scene: &scene::Scene, set: &PoseSet, index: usize) -> Deformed {
    let sample = &set.samples[index];
    let globals = scene.skeleton.globals(&sample.pose.local);
    let mut out = Deformed::default();
    deform(&scene.mesh, &globals, &sample.pose.weights, sample.root, &mut out);
    out
}

fn mesh(posed: &Deformed, index: usize) -> PosedMesh<'_> {
    let (positions, normals) = (&posed.positions, &posed.normals);
    PosedMesh { positions, normals, clip_key: 1, time_s: index as f32 }
}

/// Rays that are ready to be traced, and what they are traced against.
struct Bare {
    device: Device,
    scene: Scene,
    /// Blocks nothing: what a query costs outside the library, and its entry.
    empty: Scene,
    points: Vec<Point>,
}

struct Point {
    origin: Vec3,
    directions: [Vec<f32>; 3],
}

impl Bare {
    fn new(triangles: &[[u32; 3]], set: &PoseSet, posed: &Deformed) -> Self {
        let device = Device::new().unwrap();
        let scene = Scene::build(&device, &posed.positions, triangles).unwrap();
        let empty = Scene::build(&device, &[], &[]).unwrap();
        let table = Directions::new(Density::Cosine, 64, RAYS / 2, 1);
        let offset = 1e-5 * set.size_m;
        let point = |&vertex: &u32| {
            let normal = posed.normals[vertex as usize];
            let bits = hash(&[u64::from(vertex)]);
            let set = table.set((bits >> 58) as usize);
            let azimuth = Quat::from_rotation_z((unit(bits << 6) * std::f64::consts::TAU) as f32);
            let frame = Quat::from_rotation_arc(Vec3::Z, normal) * azimuth;
            let turned: Vec<Vec3> =
                (0..RAYS).map(|i| frame * Vec3::new(set.x[i], set.y[i], set.z[i])).collect();
            Point {
                origin: posed.positions[vertex as usize] + normal * offset,
                directions: [0, 1, 2].map(|axis| turned.iter().map(|d| d[axis]).collect()),
            }
        };
        Self { scene, empty, device, points: set.points.vertex.iter().map(point).collect() }
    }

    /// Seconds for all points on all threads.
    fn trace(&self, scene: &Scene, width: Width) -> f64 {
        let start = Instant::now();
        let blocked: u64 = self
            .points
            .par_chunks(32)
            .map(|chunk| {
                let mut bits = vec![0; words_of(RAYS)];
                let mut blocked = 0;
                for Point { origin, directions: [x, y, z] } in chunk {
                    let rays = Rays { origin: *origin, x, y, z, near: 0.0, far: f32::INFINITY };
                    scene.occluded_by(width, &rays, &mut bits);
                    blocked += u64::from(bits[0].count_ones());
                }
                blocked
            })
            .sum();
        std::hint::black_box(blocked);
        start.elapsed().as_secs_f64()
    }

    fn rays(&self) -> f64 {
        (self.points.len() * RAYS) as f64
    }
}

/// The widths in turns; the fastest.
fn widths(bare: &Bare) -> Width {
    println!("| packet | Mray/s | of which outside the library |\n|---|---|---|");
    let mut best = (f64::INFINITY, Width::One);
    for &width in bare.device.widths() {
        let seconds = median((0..ROUNDS).map(|_| bare.trace(&bare.scene, width)).collect());
        let empty = median((0..ROUNDS).map(|_| bare.trace(&bare.empty, width)).collect());
        println!(
            "| {} | {:.2} | {:.1} % |",
            width.rays(),
            bare.rays() / seconds / 1e6,
            100.0 * empty / seconds
        );
        if seconds < best.0 {
            best = (seconds, width);
        }
    }
    println!("chosen: packets of {}\n", bare.device.width().rays());
    best.1
}

/// The bare loop and the baker in turns, over one pose and the same number of rays.
fn compare(
    baker: &Baker,
    bare: &Bare,
    (posed, triangles): (&[Deformed], &[[u32; 3]]),
    width: Width,
) {
    let go = AtomicBool::new(false);
    let middle = posed.len() / 2;
    let mut ratios = [const { Vec::new() }; 4];
    for round in 0..2 * ROUNDS {
        let bare_s = bare.trace(&bare.scene, width);
        let outside_s = bare.trace(&bare.empty, width);
        let start = Instant::now();
        std::hint::black_box(
            Scene::build(&bare.device, &posed[middle].positions, triangles).unwrap(),
        );
        let tree_s = start.elapsed().as_secs_f64();
        let (start, before) = (Instant::now(), runnable_s());
        baker.bake(&[mesh(&posed[middle], round), mesh(&posed[middle], round)], &go).unwrap();
        let baked_s = start.elapsed().as_secs_f64() / 2.0;
        ratios[0].push(bare_s / baked_s);
        ratios[1].push((bare_s - outside_s) / baked_s);
        let busy = (runnable_s() - before) / (2.0 * baked_s * rayon::current_num_threads() as f64);
        ratios[2].push(busy);
        ratios[3].push(tree_s / (baked_s * rayon::current_num_threads() as f64));
    }
    let [speed, inside, busy, tree] = ratios.map(|r| 100.0 * median(r));
    println!("| baker against the bare loop | median of {} |\n|---|---|", 2 * ROUNDS);
    println!("| rays per second of the best bare loop's | {speed:.1} % |");
    println!(
        "| of its wall time inside the library (the time that the bare loop is inside) | {inside:.1} % |"
    );
    println!("| threads running or ready to run | {busy:.1} % |");
    println!("| building the tree, of all threads' time for a pose | {tree:.1} % |\n");
}

/// Rays per second and memory over the number of poses, in blocks of 8 as a data set is baked.
fn scaling(baker: &Baker, posed: &[Deformed]) {
    let go = AtomicBool::new(false);
    println!(
        "| poses | Mray/s | peak memory added, MiB | said beforehand, MiB |\n|---|---|---|---|"
    );
    for poses in [1, 2, 4, 8, 16, 32] {
        fs::write("/proc/self/clear_refs", "5").unwrap_or_default();
        let (before, start) = (status_kib("VmRSS:"), Instant::now());
        let meshes: Vec<PosedMesh<'_>> =
            (0..poses).map(|i| mesh(&posed[i % posed.len()], i)).collect();
        for block in meshes.chunks(8) {
            std::hint::black_box(baker.bake(block, &go).unwrap());
        }
        let rays = (poses * baker.points() * baker.rays_per_point()) as f64;
        println!(
            "| {poses} | {:.2} | {:.0} | {:.0} |",
            rays / start.elapsed().as_secs_f64() / 1e6,
            (status_kib("VmHWM:") - before) / 1024.0,
            baker.memory_bytes(poses.min(8), rayon::current_num_threads()) as f64 / 1048576.0
        );
    }
}

/// Seconds that this process's threads have run or waited for a core, so that other work on the
/// machine does not count as idleness. (Linux; 0 elsewhere.)
fn runnable_s() -> f64 {
    let Ok(threads) = fs::read_dir("/proc/self/task") else { return 0.0 };
    let of_thread = |path: PathBuf| {
        let text = fs::read_to_string(path.join("schedstat")).unwrap_or_default();
        text.split_whitespace().take(2).filter_map(|n| n.parse::<f64>().ok()).sum::<f64>()
    };
    threads.flatten().map(|thread| of_thread(thread.path())).sum::<f64>() * 1e-9
}

/// A line of the process's status, KiB. (Linux; 0 elsewhere.)
fn status_kib(key: &str) -> f64 {
    let text = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_default();
    line.split_whitespace().next().and_then(|n| n.parse().ok()).unwrap_or_default()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}
