//! `cargo bench --bench subdivide [-- RAYS] [SCENE]`: what adaptive subdivision saves, for all scenes or
//! those with SCENE in their names.
//!
//! For each scene and number of triangles: the L² interpolation error (transfer of order 6, against
//! places between the vertices baked with 4 times the rays, the noise of both taken off) of no
//! subdivision, of uniform subdivision, and of each measure over that of the uniform one. "(4) ends" is
//! (4) with a smallest triangle, an eighth as wide as those of a uniform mesh of the budget; "(4) A" is
//! (4) times the root of the area. Then how the error falls as the budget grows, and what refining from
//! 5,000 to 50,000 triangles costs over baking the final vertices. The column on a plane is made here
//! (246 triangles, after SUB04 figure 1); the other scenes come from the folder that POSELIGHT_ASSETS
//! names.

#![expect(clippy::print_stdout, reason = "a benchmark prints its tables")]
#![expect(clippy::unwrap_used, reason = "a benchmark ends where something fails")]

use std::f32::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use poselight::bake::subdivide::{ErrorMeasure, Goal};
use poselight::pipeline::recipe::Recipe;
use poselight::pipeline::recipe::surroundings::GroundRecipe;
use poselight::pipeline::{Job, Refinement, Subdivided, subdivide};
use serde_json::json;

const PRINTED: ErrorMeasure = ErrorMeasure::Curvature { a: 1.0, printed: false, by_area: false };
const BY_AREA: ErrorMeasure = ErrorMeasure::Curvature { a: 1.0, printed: false, by_area: true };

/// Name, measure, and whether there is a smallest triangle.
const MEASURES: [(&str, ErrorMeasure, bool); 8] = [
    ("uniform", ErrorMeasure::Uniform, false),
    ("(2)", ErrorMeasure::Contrast, false),
    ("(3)", ErrorMeasure::Distance, false),
    ("(4)", PRINTED, false),
    ("(4) ends", PRINTED, true),
    ("(4) A", BY_AREA, false),
    ("surplus", ErrorMeasure::Surplus, false),
    ("midpoint", ErrorMeasure::Midpoint, false),
];

/// Places between vertices: most of the error is in few of them.
const PROBES: usize = 16_000;

fn main() {
    let rays = std::env::args().find_map(|arg| arg.parse().ok()).unwrap_or(1024);
    let folder = tempfile::tempdir().unwrap();
    let column = folder.path().join("column.glb");
    std::fs::write(&column, column_on_a_plane()).unwrap();
    println!("transfer of order 6, {rays} rays, {} threads\n", rayon::current_num_threads());
    let names: Vec<&str> = MEASURES.iter().map(|(name, ..)| *name).collect();
    println!("| scene | triangles | none | {} | noise |", names.join(" | "));
    println!("|---|---|---|{}---|", "---|".repeat(MEASURES.len()));
    let mut scenes = vec![(column, rays, &[4, 16, 64][..], true)];
    if let Some(assets) = std::env::var_os("POSELIGHT_ASSETS").map(PathBuf::from) {
        let living_room = assets.join("scene/living_room.glb");
        scenes.push((living_room, rays, &[4, 16], true));
        scenes.push((assets.join("scene/zdm2.glb"), rays / 4, &[4], false));
        scenes.push((assets.join("rigged/MH_Male_CMU02.glb"), rays / 2, &[4], false));
    } else {
        println!("skipped: POSELIGHT_ASSETS names no folder of scenes");
    }
    let asked =
        std::env::args().skip(1).find(|arg| !arg.starts_with('-') && arg.parse::<u32>().is_err());
    let named =
        |path: &Path| asked.as_ref().is_none_or(|part| path.to_string_lossy().contains(part));
    scenes.retain(|(path, ..)| named(path));
    for (path, rays, factors, _) in &scenes {
        compare(path, *rays, factors);
    }
    for (path, rays, ..) in scenes.iter().filter(|(.., grows)| *grows) {
        grow(path, *rays);
    }
    if let Some((path, rays, ..)) =
        scenes.iter().find(|(path, ..)| path.ends_with("living_room.glb"))
    {
        cost(path, *rays);
    }
}

/// The area of a triangle an eighth as wide as those that a budget makes of the whole surface.
fn smallest(job: &Job, triangles: usize) -> f32 {
    let posed = job.traced(0);
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|vertex| posed.positions[vertex as usize]);
        (b - a).cross(c - a).length() / 2.0
    };
    job.scene.mesh.triangles.iter().map(area).sum::<f32>() / triangles as f32 / 64.0
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

fn refined(
    job: &Job,
    (measure, ends): (ErrorMeasure, bool),
    triangles: usize,
    probes: usize,
) -> Subdivided {
    let area = if ends { smallest(job, triangles) } else { 0.0 };
    let goal = Goal { triangles, vertices: usize::MAX, error: 0.0, depth: 12, area };
    let (key_poses, bound, smooth) = (4, 5e-4, false);
    let refinement = Refinement { goal, measure, key_poses, bound, smooth, probes };
    subdivide(job, &refinement, &AtomicBool::new(false), &mut |_| ()).unwrap()
}

fn compare(path: &Path, rays: u32, factors: &[usize]) {
    let job = job(path, rays);
    let given = job.scene.mesh.triangles.len();
    for factor in factors {
        let mut cells = Vec::new();
        let (mut uniform, mut noise) = (0.0, 0.0);
        for (name, measure, ends) in MEASURES {
            let done = refined(&job, (measure, ends), given * factor, PROBES);
            let [before, after] = done.fidelity.unwrap();
            if name == "uniform" {
                (uniform, noise) = (after.rms, done.probe_noise.unwrap());
                cells.push(format!("{:.4} | {uniform:.4}", before.rms));
            } else {
                cells.push(format!("{:.0} %", 100.0 * after.rms / uniform));
            }
        }
        let name = path.file_stem().unwrap().to_string_lossy();
        println!("| {name} | {} | {} | {noise:.4} |", given * factor, cells.join(" | "));
    }
}

/// The error that is left at growing budgets.
fn grow(path: &Path, rays: u32) {
    let job = job(path, rays);
    let given = job.scene.mesh.triangles.len();
    let name = path.file_stem().unwrap().to_string_lossy();
    let mut errors = Vec::new();
    for factor in [2, 4, 8, 16, 32] {
        let done = refined(&job, (ErrorMeasure::Surplus, false), given * factor, PROBES);
        let [before, after] = done.fidelity.unwrap();
        if errors.is_empty() {
            errors.push(before.rms);
        }
        errors.push(after.rms);
    }
    let all: Vec<String> = errors.iter().map(|error| format!("{error:.5}")).collect();
    let falls = errors.windows(2).all(|pair| pair[1] < pair[0]);
    println!(
        "\n{name} by surplus at 1, 2, 4, 8, 16 and 32 times {given} triangles: {}; {}",
        all.join(", "),
        if falls { "each budget leaves less than the one before" } else { "NOT MONOTONE" }
    );
}

/// Wall time of a refinement over that of one bake of all the vertices that it ends with.
fn cost(path: &Path, rays: u32) {
    let coarse = job(path, rays);
    for (name, measure, ends) in &MEASURES[3..] {
        let start = Instant::now();
        let done = refined(&coarse, (*measure, *ends), 50_000, 0);
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

/// A plane of 9 by 9 quads and a column of 7 sides and 6 storeys.
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
    grid(7, 6, &|side, storey| {
        let angle = (side % 7) as f32 / -7.0 * TAU;
        [angle.cos(), storey as f32, angle.sin()]
    });
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
