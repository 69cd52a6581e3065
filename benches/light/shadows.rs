//! Shadows of spheres and of heights, and tangents that they meet.

use std::f64::consts::PI;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

use glam::Vec3;
use poselight::num::random::Stream;
use poselight::rig::{Deformed, Pose, RigidFrame, Tangents, coherence, deform, smoothness};
use poselight::scene;
use poselight::sh::{Order, TripleProduct, evaluate_f64, gauss_legendre};
use poselight::shade::{HeightField, HorizonShadows, Sphere, SphereShadows};
use rayon::prelude::*;

use crate::{best, order};

/// Exponentiated sums of logarithms beside the sequential product of visibilities, each the exponential
/// of one sphere's own logarithm, and beside looking: distances in units of open sky, root mean squares
/// over random places of the spheres.
pub(crate) fn shadows() {
    let n = order(4);
    let shadows = SphereShadows::new(n);
    let gamma = TripleProduct::new(n, n, n);
    let open = (4.0 * PI).sqrt();
    println!(
        "\n| spheres, order 4 | exponential to looking, RMS | product of single exponentials to looking, RMS | exponential to product, RMS | exponential | product |\n|---|---|---|---|---|---|"
    );
    let mut stream = Stream::new(7);
    for count in [1, 2, 5, 10, 20, 50, 100, 200] {
        let mut sums = [0.0; 3];
        let mut times = [0.0; 2];
        const PLACES: usize = 12;
        for _ in 0..PLACES {
            let spheres: Vec<Sphere> = (0..count)
                .map(|_| {
                    let at =
                        Vec3::from([0; 3].map(|_| stream.normal() as f32)).normalize_or(Vec3::Y);
                    let far = 1.5 + 3.0 * stream.uniform() as f32;
                    Sphere { centre: at * far, radius: 1.2 * far / (3.0 + f32::sqrt(count as f32)) }
                })
                .collect();
            let mut exponential = [0.0; 16];
            let singles: Vec<[f32; 16]> = spheres
                .iter()
                .map(|sphere| {
                    let mut one = [0.0; 16];
                    shadows.visibility(Vec3::ZERO, std::slice::from_ref(sphere), &mut one);
                    one
                })
                .collect();
            let mut product = [0.0; 16];
            let mut next = [0.0; 16];
            let [a, b] = best(
                20,
                [
                    &mut || shadows.visibility(Vec3::ZERO, black_box(&spheres), &mut exponential),
                    &mut || {
                        product = [0.0; 16];
                        product[0] = open as f32;
                        for single in black_box(&singles) {
                            gamma.product(&product, single, &mut next);
                            product = next;
                        }
                    },
                ],
            );
            let looked = look(n, &spheres);
            let apart = |a: &[f32], b: &[f64]| {
                a.iter().zip(b).map(|(a, b)| (f64::from(*a) - b).powi(2)).sum::<f64>()
            };
            let exact: Vec<f64> = product.iter().map(|&x| f64::from(x)).collect();
            sums[0] += apart(&exponential, &looked);
            sums[1] += apart(&product, &looked);
            sums[2] += apart(&exponential, &exact);
            times[0] += a / PLACES as f64;
            times[1] += b / PLACES as f64;
        }
        let [a, b, c] = sums.map(|sum| (sum / PLACES as f64).sqrt() / open);
        println!(
            "| {count} | {a:.4} | {b:.4} | {c:.4} | {:.2} µs | {:.2} µs |",
            times[0], times[1]
        );
    }
}

/// Visibility among spheres by 96 · 192 directions.
pub(crate) fn look(order: Order, spheres: &[Sphere]) -> Vec<f64> {
    let mut out = vec![0.0; order.coefficients()];
    let mut y = vec![0.0; order.coefficients()];
    for (z, weight) in gauss_legendre(96) {
        for k in 0..192 {
            let (sin, cos) = (2.0 * PI * (f64::from(k) + 0.5) / 192.0).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let direction = [r * cos, r * sin, z];
            let d = Vec3::from(direction.map(|x| x as f32));
            let blocked = spheres.iter().any(|sphere| {
                let along = sphere.centre.dot(d);
                let aside = sphere.centre.length_squared() - along * along;
                along > 0.0 && aside < sphere.radius * sphere.radius
            });
            if !blocked {
                evaluate_f64(order, direction, &mut y);
                let area = weight * 2.0 * PI / 192.0;
                out.iter_mut().zip(&y).for_each(|(out, y)| *out += area * y);
            }
        }
    }
    out
}

/// Tangents of the bundled character and of the characters of the asset folder: how much they turn from
/// neighbour to neighbour, and against the surface from frame to frame at 30 Hz.
pub(crate) fn tangents() {
    println!(
        "\n| tangents | vertices | neighbours, mean | 99 % | frame to frame, mean | 99 % | time |\n|---|---|---|---|---|---|---|"
    );
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/assets");
    let assets = std::env::var_os("POSELIGHT_ASSETS").map_or(PathBuf::from(beside), PathBuf::from);
    let limits = scene::Limits::default();
    let figure = scene::Source { name: "figure.glb".into(), bytes: scene::figure::figure() };
    let mut scenes = vec![("figure", scene::import_sources(vec![figure], &limits).unwrap())];
    for name in ["CesiumMan.glb", "Fox.glb", "MH_Male_CMU02.glb", "KayKit_Knight.glb"] {
        if let Ok(read) = scene::import(&assets.join("rigged").join(name), &limits) {
            scenes.push((name, read));
        }
    }
    for (name, scene) in &scenes {
        let start = Instant::now();
        let tangents = Tangents::new(&scene.skeleton, &scene.mesh);
        let seconds = start.elapsed().as_secs_f64();
        let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
        let posed = |time_s: f32| {
            let pose = poselight::pose::evaluate(&scene.clips[0], time_s, &rest);
            let globals = scene.skeleton.globals(&pose.local);
            let (mut mesh, mut along) = (Deformed::default(), Vec::new());
            deform(&scene.mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut mesh);
            let here = RigidFrame::IDENTITY;
            tangents.pose(&scene.mesh, &globals, here, &mesh.normals, &mut along);
            (mesh, along)
        };
        let triangles = &scene.mesh.triangles;
        let (mut smooth, mut steady, frames) = ([0.0_f32; 2], [0.0_f32; 2], 20);
        for k in 0..frames {
            let time_s = scene.clips[0].duration_s * k as f32 / frames as f32;
            let ((mesh, along), (next, after)) = (posed(time_s), posed(time_s + 1.0 / 30.0));
            let here = smoothness(triangles, &mesh.normals, &along);
            let there = coherence(triangles, [(&mesh, &along), (&next, &after)]);
            for (sum, found) in [(&mut smooth, here), (&mut steady, there)] {
                sum[0] += found.mean_degrees / frames as f32;
                sum[1] = sum[1].max(found.p99_degrees);
            }
        }
        println!(
            "| {name} | {} | {:.1}° | {:.0}° | {:.2}° | {:.1}° | {:.0} ms |",
            scene.mesh.positions.len(),
            smooth[0],
            smooth[1],
            steady[0],
            steady[1],
            seconds * 1e3
        );
    }
}

/// A field of 512 × 512 at order 4: the time of all points on all threads, and the distance from
/// visibilities by horizons that are looked for at every half sample, in units of open sky.
pub(crate) fn heights() {
    const SIZE: usize = 512;
    let bump = |i: usize| {
        let (x, y) = ((i % SIZE) as f32, (i / SIZE) as f32);
        12.0 * (x * 0.041).sin() * (y * 0.033).cos() + 3.0 * (x * 0.21 + y * 0.17).sin()
    };
    let heights: Vec<f32> = (0..SIZE * SIZE).map(bump).collect();
    println!(
        "\n| height field of 512 × 512, order 4 | pyramid, of another frame | all points, {} threads | mean distance from traced horizons | largest | of flat ground's |\n|---|---|---|---|---|---|",
        rayon::current_num_threads()
    );
    let looked = HorizonShadows::new(order(4), 256);
    for azimuths in [16, 32] {
        let shadows = HorizonShadows::new(order(4), azimuths);
        let mut field = HeightField::new(SIZE, SIZE, 1.0, &heights).unwrap();
        let start = Instant::now();
        field.set_heights(&heights).unwrap();
        let pyramid = start.elapsed().as_secs_f64();
        let mut out = vec![0.0; 16 * SIZE * SIZE];
        let start = Instant::now();
        out.par_chunks_mut(16 * SIZE).enumerate().for_each(|(row, out)| {
            shadows.visibility_row(&field, row, out);
        });
        black_box(&out);
        let all = start.elapsed().as_secs_f64();
        let (mut mean, mut largest, mut flat, places) = (0.0, 0.0_f32, 0.0, 64);
        for k in 0..places {
            let (column, row) = (37 + 53 * k % 431, 41 + 97 * k % 419);
            let mut slow = [0.0; 16];
            looked.visibility_traced(&field, column, row, 0.5, &mut slow);
            let found = &out[16 * (row * SIZE + column)..][..16];
            let apart = |a: &[f32], b: &[f32]| -> f32 {
                a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt()
            };
            let open = (4.0 * PI).sqrt() as f32;
            let off = apart(found, &slow) / open;
            mean += off / places as f32;
            largest = largest.max(off);
            let mut level = [0.0; 16];
            level[0] = open;
            flat += apart(&level, &slow) / open / places as f32;
        }
        println!(
            "| {azimuths} azimuths | {:.1} ms | {all:.2} s | {mean:.4} | {largest:.4} | {flat:.4} |",
            pyramid * 1e3
        );
    }
}
