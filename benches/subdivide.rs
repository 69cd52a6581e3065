//! `cargo bench --bench subdivide [-- RAYS] [SCENE]`: what adaptive subdivision saves, for all scenes or
//! those with SCENE in their names.
//!
//! For each scene and number of triangles: the L² interpolation error (transfer of order 6, against
//! 12,000 places between the vertices baked with 4 times the rays, the noise of both taken off) of no
//! subdivision, of uniform subdivision, and of each measure over that of the uniform one. "(4) √A" is
//! equation (4) times the root of the triangle's area. Then how the error falls as the budget grows, and
//! what refining from 5,000 to 50,000 triangles costs over baking the final vertices. The column on a
//! plane is made here, after SUB04 figure 1: its 246 triangles, and 198 vertices of the published 200;
//! the other scenes come from the folder that POSELIGHT_ASSETS names.

#![expect(clippy::print_stdout, reason = "a benchmark prints its tables")]
#![expect(clippy::unwrap_used, reason = "a benchmark ends where something fails")]

use std::f32::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use poselight::bake::subdivide::{ErrorMeasure, Goal, Probes};
use poselight::pipeline::recipe::Recipe;
use poselight::pipeline::recipe::surroundings::GroundRecipe;
use poselight::pipeline::{Job, Refinement, Subdivided, interpolation_probes, subdivide};
use serde_json::json;

const CURVATURE: ErrorMeasure = ErrorMeasure::Curvature { a: 1.0, printed: false, by_area: false };
const BY_AREA: ErrorMeasure = ErrorMeasure::Curvature { a: 1.0, printed: false, by_area: true };

const MEASURES: [(&str, ErrorMeasure); 7] = [
    ("uniform", ErrorMeasure::Uniform),
    ("(2)", ErrorMeasure::Contrast),
    ("(3)", ErrorMeasure::Distance),
    ("(4)", CURVATURE),
    ("(4) √A", BY_AREA),
    ("surplus", ErrorMeasure::Surplus),
    ("midpoint", ErrorMeasure::Midpoint),
];

/// Places between vertices: most of the error is in few of them.
const PROBES: usize = 16_000;

/// Poses of a character that are looked at.
const KEY_POSES: usize = 4;

/// A scene, the rays of its vertices, and the budgets of its tables, in triangles of the scene.
struct Case {
    path: PathBuf,
    rays: u32,
    compared: &'static [f64],
    grown: &'static [usize],
}

fn main() {
    let rays = std::env::args().find_map(|arg| arg.parse().ok()).unwrap_or(1024);
    let folder = tempfile::tempdir().unwrap();
    let column = folder.path().join("column.glb");
    std::fs::write(&column, column_on_a_plane()).unwrap();
    println!("transfer of order 6, {rays} rays, {} threads\n", rayon::current_num_threads());
    // 2,828 is the published budget.
    let compared = &[4.0, 2828.0 / 246.0, 16.0, 64.0][..];
    let mut cases = vec![Case { path: column, rays, compared, grown: &[2, 4, 8, 16, 32] }];
    if let Some(assets) = std::env::var_os("POSELIGHT_ASSETS").map(PathBuf::from) {
        let mut add = |name, rays, compared, grown| {
            cases.push(Case { path: assets.join(name), rays, compared, grown });
        };
        add("scene/living_room.glb", rays, &[4.0, 16.0], &[2, 4, 8, 16]);
        add("scene/zdm2.glb", rays / 4, &[4.0], &[2, 4]);
        add("rigged/MH_Male_CMU02.glb", rays / 2, &[4.0], &[2, 4, 8]);
    } else {
        println!("skipped: POSELIGHT_ASSETS names no folder of scenes");
    }
    let asked =
        std::env::args().skip(1).find(|arg| !arg.starts_with('-') && arg.parse::<u32>().is_err());
    let named =
        |path: &Path| asked.as_ref().is_none_or(|part| path.to_string_lossy().contains(part));
    cases.retain(|case| named(&case.path));
    let names: Vec<&str> = MEASURES.iter().map(|(name, _)| *name).collect();
    println!("| scene | triangles | none | {} | noise |", names.join(" | "));
    println!("|---|---|---|{}---|", "---|".repeat(MEASURES.len()));
    let jobs: Vec<(Job, Probes)> = cases
        .iter()
        .map(|case| {
            let job = job(&case.path, case.rays);
            let probes = probes(&job);
            compare(case, &job, &probes);
            (job, probes)
        })
        .collect();
    for (case, (job, probes)) in cases.iter().zip(&jobs) {
        grow(case, job, probes);
    }
    if let Some(case) = cases.iter().find(|case| case.path.ends_with("living_room.glb")) {
        cost(&case.path, case.rays);
    }
}

fn name(case: &Case) -> String {
    case.path.file_stem().unwrap().to_string_lossy().into_owned()
}

fn job(path: &Path, rays: u32) -> Job {
    let mut recipe = Recipe::default();
    recipe.bake.rays = rays;
    recipe.poses.rate_hz = 4.0;
    let is_character = path.to_string_lossy().contains("rigged");
    if is_character {
        recipe.bake.surroundings.ground = Some(GroundRecipe::Lowest);
    }
    Job::open(path, recipe).unwrap()
}

fn probes(job: &Job) -> Probes {
    interpolation_probes(job, KEY_POSES, PROBES, &AtomicBool::new(false)).unwrap()
}

fn refined(
    job: &Job,
    measure: ErrorMeasure,
    triangles: usize,
    probes: Option<&Probes>,
) -> Subdivided {
    let goal = Goal { triangles, vertices: usize::MAX, error: 0.0, depth: 12, area: 0.0 };
    let (key_poses, bound, keep_bound, smooth) = (KEY_POSES, 5e-4, false, false);
    let refinement = Refinement { goal, measure, key_poses, bound, keep_bound, smooth };
    subdivide(job, &refinement, probes, &AtomicBool::new(false), &mut |_| ()).unwrap()
}

fn compare(case: &Case, job: &Job, probes: &Probes) {
    let given = job.scene.mesh.triangles.len();
    for factor in case.compared {
        let triangles = (given as f64 * factor).round() as usize;
        let mut cells = Vec::new();
        let mut uniform = 0.0;
        for (name, measure) in MEASURES {
            let done = refined(job, measure, triangles, Some(probes));
            let [before, after] = done.fidelity.unwrap();
            if name == "uniform" {
                uniform = after.rms;
                cells.push(format!("{:.4} | {uniform:.4}", before.rms));
            } else {
                cells.push(format!("{:.0} %", 100.0 * after.rms / uniform));
            }
        }
        let noise = probes.noise();
        println!("| {} | {triangles} | {} | {noise:.4} |", name(case), cells.join(" | "));
    }
}

/// The error that is left at growing budgets.
fn grow(case: &Case, job: &Job, probes: &Probes) {
    let given = job.scene.mesh.triangles.len();
    for (name_of, measure) in [("surplus", ErrorMeasure::Surplus), ("(4) √A", BY_AREA)] {
        let mut errors = Vec::new();
        for factor in case.grown {
            let done = refined(job, measure, given * factor, Some(probes));
            let [before, after] = done.fidelity.unwrap();
            if errors.is_empty() {
                errors.push(before.rms);
            }
            errors.push(after.rms);
        }
        let all: Vec<String> = errors.iter().map(|error| format!("{error:.5}")).collect();
        let falls = errors.windows(2).all(|pair| pair[1] < pair[0]);
        println!(
            "\n{} by {name_of} at 1 and {:?} times {given} triangles: {}; {}",
            name(case),
            case.grown,
            all.join(", "),
            if falls { "each budget leaves less than the one before" } else { "NOT MONOTONE" }
        );
    }
}

/// Wall time of a refinement over that of one bake of all the vertices that it ends with.
fn cost(path: &Path, rays: u32) {
    let coarse = job(path, rays);
    for (name, measure) in &MEASURES[1..] {
        let start = Instant::now();
        let done = refined(&coarse, *measure, 50_000, None);
        let refine_s = start.elapsed().as_secs_f64();
        let folder = tempfile::tempdir().unwrap();
        let fine = folder.path().join("fine.glb");
        std::fs::write(&fine, &done.glb).unwrap();
        let fine = job(&fine, rays);
        let baker = fine.baker(&fine.checked.bake, None).unwrap();
        let posed = fine.traced(0);
        let mesh = poselight::bake::PosedMesh {
            positions: &posed.positions,
            normals: &posed.normals,
            clip_key: 0,
            time_s: 0.0,
        };
        let start = Instant::now();
        baker.bake(&[mesh], &AtomicBool::new(false)).unwrap();
        let bake_s = start.elapsed().as_secs_f64();
        println!(
            "\n{name}: {} to {} triangles in {refine_s:.2} s, {:.2} times a bake of the {} points that it ends with ({bake_s:.2} s); {} vertices in vain",
            done.triangles[0],
            done.triangles[1],
            refine_s / bake_s,
            fine.poses.points.count(),
            done.in_vain,
        );
    }
}

/// A plane of 9 by 9 quads and a column of 6 storeys, its 7 sides with vertices and normals of their own.
fn column_on_a_plane() -> Vec<u8> {
    let mut positions: Vec<[f32; 3]> = Vec::new();
    let mut indices: Vec<u32> = Vec::new();
    let mut grid = |width: u32, height: u32, place: &dyn Fn(u32, u32) -> [f32; 3]| {
        let first = positions.len() as u32;
        for row in 0..=height {
            positions.extend((0..=width).map(|column| place(column, row)));
        }
        for (row, column) in (0..height).flat_map(|r| (0..width).map(move |c| (r, c))) {
            let at = first + row * (width + 1) + column;
            indices.extend([at, at + 1, at + width + 2, at, at + width + 2, at + width + 1]);
        }
    };
    grid(9, 9, &|x, z| [x as f32 * 2.0 - 9.0, 0.0, 9.0 - z as f32 * 2.0]);
    for side in 0..7 {
        grid(1, 6, &|end, storey| {
            let angle = (side + end) as f32 / -7.0 * TAU;
            [angle.cos(), storey as f32, angle.sin()]
        });
    }
    let bytes: Vec<u8> = (positions.iter().flatten().flat_map(|x| x.to_le_bytes()))
        .chain(indices.iter().flat_map(|i| i.to_le_bytes()))
        .collect();
    let split = positions.len() * 12;
    let document = json!({
        "asset": {"version": "2.0"}, "buffers": [{"byteLength": bytes.len()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": split},
            {"buffer": 0, "byteOffset": split, "byteLength": bytes.len() - split},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": positions.len(), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": indices.len(), "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}],
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = (28 + text.len() + bytes.len()) as u32;
    let mut glb = [b"glTF\x02\0\0\0".as_slice(), &length.to_le_bytes()].concat();
    for (kind, body) in [(b"JSON", text), (b"BIN\0", bytes)] {
        glb.extend((body.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(body);
    }
    glb
}
