//! `cargo bench --bench light`: what light and reflection cost, on one core unless it says otherwise.
//! A word after `--` picks the parts that have it in their names.
//!
//! Products of spherical harmonics by the sparse tensor beside the dense one; rotation, product and
//! projection beside slow integration; zonal lobes of the environment maps of the asset folder where
//! there is one; operators of reflectances and how many points they shade; shadows of spheres beside
//! sequential products and beside looking; horizons of a height field beside traced ones. Every round
//! of a comparison runs all contestants in turn, and the best round counts.

#![expect(clippy::print_stdout, reason = "a benchmark prints its tables")]
#![expect(clippy::unwrap_used, reason = "a benchmark ends where something fails")]

use std::f64::consts::PI;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

use glam::{Mat3, Quat, Vec3};
use poselight::num::cpu::Isa;
use poselight::num::random::Stream;
use poselight::rig::{Deformed, Pose, RigidFrame, Tangents, coherence, deform, smoothness};
use poselight::scene;
use poselight::sh::{Order, Rotation, TripleProduct, evaluate_f64, gauss_legendre};
use poselight::shade::{
    Brdf, EnvironmentMap, GlobalReflector, HeightField, HorizonShadows, Reflectance, Reflector,
    ShLight, ShadedPoints, Sphere, SphereShadows, ZonalLight, factor,
};
use rayon::prelude::*;

const ROUNDS: usize = 60;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|w| !w.starts_with('-')).collect();
    let parts: [(&str, fn()); 8] = [
        ("products", products),
        ("agreement", agreement),
        ("lobes", lobes),
        ("reflection", reflection),
        ("points", shading),
        ("spheres", shadows),
        ("heights", heights),
        ("tangents", tangents),
    ];
    for (name, part) in parts {
        if words.is_empty() || words.iter().any(|word| name.contains(word.as_str())) {
            part();
        }
    }
}

fn order(bands: u8) -> Order {
    Order::new(bands).unwrap()
}

/// Microseconds of one call in the best of many rounds, for each contestant.
fn best<const N: usize>(repeats: usize, mut contestants: [&mut dyn FnMut(); N]) -> [f64; N] {
    let mut best = [f64::INFINITY; N];
    for _ in 0..ROUNDS {
        for (run, best) in contestants.iter_mut().zip(&mut best) {
            let start = Instant::now();
            (0..repeats).for_each(|_| run());
            *best = best.min(start.elapsed().as_secs_f64() * 1e6 / repeats as f64);
        }
    }
    best
}

fn numbers(count: usize) -> Vec<f32> {
    let mut stream = Stream::new(1);
    (0..count).map(|_| stream.normal() as f32).collect()
}

/// out_i = Σ_j a_j Σ_k Γ_ijk b_k over all entries, the inner sum along memory in eight parts.
fn dense_product(gamma: &[f32], a: &[f32], b: &[f32], out: &mut [f32]) {
    for (out, slab) in out.iter_mut().zip(gamma.chunks_exact(a.len() * b.len())) {
        *out = a.iter().zip(slab.chunks_exact(b.len())).map(|(a, row)| a * dot(row, b)).sum();
    }
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0; 8];
    let (a_blocks, a_rest) = a.as_chunks::<8>();
    let (b_blocks, b_rest) = b.as_chunks::<8>();
    for (a, b) in a_blocks.iter().zip(b_blocks) {
        for i in 0..8 {
            lanes[i] += a[i] * b[i];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    lanes.iter().sum::<f32>() + rest
}

fn products() {
    println!(
        "| order | entries of Γ | of | sparse product | dense product | times faster | product matrix |\n|---|---|---|---|---|---|---|"
    );
    for bands in [2, 3, 4, 6, 8, 10] {
        let order = order(bands);
        let count = order.coefficients();
        let gamma = TripleProduct::new(order, order, order);
        let mut full = vec![0.0_f32; count * count * count];
        for (i, j, k, value) in gamma.iter() {
            full[(i * count + j) * count + k] = value as f32;
        }
        let both = numbers(2 * count);
        let (a, b) = both.split_at(count);
        let [mut by_entries, mut by_all] = [vec![0.0; count], vec![0.0; count]];
        let mut matrix = vec![0.0; count * count];
        let repeats = (400_000 / full.len()).clamp(1, 2000);
        let [sparse, dense, product_matrix] = best(
            repeats,
            [
                &mut || gamma.product(black_box(a), black_box(b), black_box(&mut by_entries)),
                &mut || dense_product(&full, black_box(a), black_box(b), black_box(&mut by_all)),
                &mut || gamma.matrix(black_box(a), black_box(&mut matrix)),
            ],
        );
        let scale = by_all.iter().fold(0.0_f32, |m, x| m.max(x.abs()));
        let agree = by_entries.iter().zip(&by_all).all(|(a, b)| (a - b).abs() < 1e-5 * scale);
        assert!(agree, "the two products of order {bands} differ");
        println!(
            "| {bands} | {} | {} | {sparse:.2} µs | {dense:.2} µs | {:.1} | {product_matrix:.2} µs |",
            gamma.entries(),
            full.len(),
            dense / sparse
        );
    }
}

/// Directions over the sphere with their solid angles, exact for polynomials of degree 2 · nodes − 1.
fn sphere(nodes: usize) -> Vec<([f64; 3], f64)> {
    let ring = |(z, weight): (f64, f64)| {
        let r = (1.0 - z * z).sqrt();
        (0..2 * nodes).map(move |k| {
            let (sin, cos) = (PI * k as f64 / nodes as f64).sin_cos();
            ([r * cos, r * sin, z], weight * PI / nodes as f64)
        })
    };
    gauss_legendre(nodes).into_iter().flat_map(ring).collect()
}

/// The largest difference at order 10 from integration over directions, of coefficients about 1.
fn agreement() {
    let n = order(10);
    let directions = sphere(24);
    let both: Vec<f64> = numbers(200).iter().map(|&x| f64::from(x)).collect();
    let (a, b) = both.split_at(100);
    let project = |f: &dyn Fn([f64; 3]) -> f64| -> Vec<f64> {
        let (mut out, mut y) = (vec![0.0; 100], vec![0.0; 100]);
        for (direction, area) in &directions {
            evaluate_f64(n, *direction, &mut y);
            let value = area * f(*direction);
            out.iter_mut().zip(&y).for_each(|(out, y)| *out += value * y);
        }
        out
    };
    let at = |c: &[f64], direction: [f64; 3]| -> f64 {
        let mut y = [0.0; 100];
        evaluate_f64(n, direction, &mut y);
        c.iter().zip(&y).map(|(c, y)| c * y).sum()
    };
    let apart = |a: &[f64], b: &[f64]| -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let q = glam::DQuat::from_xyzw(0.2, -0.5, 0.3, 0.7).normalize();
    let back = q.inverse();
    let turned = project(&|d| at(a, (back * glam::DVec3::from(d)).to_array()));
    let mut rotation = Rotation::identity(n);
    rotation.set_f64(q.to_array());
    let mut found = vec![0.0; 100];
    rotation.apply_f64(a, &mut found);
    let rotated = apart(&found, &turned);
    let gamma = TripleProduct::new(n, n, n);
    gamma.product_f64(a, b, &mut found);
    let multiplied = apart(&found, &project(&|d| at(a, d) * at(b, d)));
    let mut worst = 0.0_f64;
    let unit = |i: usize| -> Vec<f64> { (0..100).map(|k| f64::from(u8::from(i == k))).collect() };
    for j in [0, 7, 30, 64, 99] {
        let (e, mut matrix) = (unit(j), vec![0.0; 10_000]);
        gamma.matrix_f64(&e, &mut matrix);
        for k in [1, 20, 55, 90] {
            let slow = project(&|d| at(&e, d) * at(&unit(k), d));
            let column: Vec<f64> = (0..100).map(|i| matrix[i * 100 + k]).collect();
            worst = worst.max(apart(&column, &slow));
        }
    }
    let texels: Vec<[f32; 3]> = numbers(8 * 4).iter().map(|x| [x.abs(); 3]).collect();
    let map = EnvironmentMap { width: 8, height: 4, texels: &texels };
    let (light, _) = map.project(n).unwrap();
    let slow = texels_by_hand(&texels, n);
    let projected = apart(&light.colours()[0], &slow);
    println!(
        "\n| order 10, f64 | rotation | product | Γ | projection of 8 × 4 texels |\n|---|---|---|---|---|\n| largest difference from integration | {rotated:.1e} | {multiplied:.1e} | {worst:.1e} | {projected:.1e} |"
    );
}

/// A map of 8 × 4 texels integrated by 32 · 32 nodes a texel.
fn texels_by_hand(texels: &[[f32; 3]], n: Order) -> Vec<f64> {
    let (mut out, mut y) = (vec![0.0; n.coefficients()], vec![0.0; n.coefficients()]);
    let nodes = gauss_legendre(32);
    for (i, texel) in texels.iter().enumerate() {
        for (a, wa) in &nodes {
            for (b, wb) in &nodes {
                let u = ((i % 8) as f64 + 0.5 + 0.5 * a) / 8.0;
                let v = ((i / 8) as f64 + 0.5 + 0.5 * b) / 4.0;
                let (azimuth, polar) = (2.0 * PI * (u - 0.5), PI * v);
                let r = polar.sin();
                evaluate_f64(n, [r * azimuth.cos(), polar.cos(), r * azimuth.sin()], &mut y);
                let share = wa * wb * 0.25 * 2.0 * PI * PI / 32.0 * r * f64::from(texel[0]);
                out.iter_mut().zip(&y).for_each(|(out, y)| *out += share * y);
            }
        }
    }
    out
}

/// Every map of the asset folder at order 4.
fn lobes() {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/assets");
    let assets = std::env::var_os("POSELIGHT_ASSETS").map_or(PathBuf::from(beside), PathBuf::from);
    let Ok(entries) = std::fs::read_dir(assets.join("env")) else { return };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    println!(
        "\n| map, order 4 | projection | residual of 1 lobe | 2 | 3 | 4 | 5 | 6 | 7 | 8 | fit of 3 | of 8 |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    for path in paths {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let Ok(picture) = scene::environment(&std::fs::read(&path).unwrap(), &name) else {
            continue;
        };
        let (width, height) = (picture.width, picture.height);
        let map = EnvironmentMap { width, height, texels: &picture.texels };
        let start = Instant::now();
        let (light, _) = map.project(order(4)).unwrap();
        let projection = start.elapsed().as_secs_f64() * 1e3;
        let timed = |lobes| {
            let start = Instant::now();
            let fit = ZonalLight::fit(&light, lobes);
            (fit, start.elapsed().as_secs_f64() * 1e3)
        };
        let ((_, three), (fit, eight)) = (timed(3), timed(8));
        let residuals: Vec<String> =
            fit.residuals().iter().map(|r| format!("{:.2} %", 100.0 * r)).collect();
        println!(
            "| {name} {width} × {height} | {projection:.0} ms | {} | {three:.0} ms | {eight:.0} ms |",
            residuals.join(" | ")
        );
    }
}

fn brdfs() -> Vec<(&'static str, Brdf)> {
    let half = [0.5; 3];
    let ggx = |alpha: [f64; 2]| Brdf::Ggx { normal_reflectance: half, alpha };
    vec![
        ("Lambert", Brdf::Lambert { albedo: half }),
        ("Phong, exponent 10", Brdf::Phong { diffuse: [0.3; 3], specular: half, exponent: 10.0 }),
        ("GGX, α 0.5", ggx([0.5; 2])),
        ("GGX, α 0.2", ggx([0.2; 2])),
        ("GGX, α 0.2 and 0.5", ggx([0.2, 0.5])),
        (
            "Ashikhmin–Shirley, 10 and 100",
            Brdf::AshikhminShirley { diffuse: [0.3; 3], specular: half, exponents: [10.0, 100.0] },
        ),
    ]
}

/// Operators: the time of one, and the errors of the factored reflectance over terms and orders.
fn reflection() {
    println!(
        "\n| operator of 8 terms, order 4 | time | bytes a colour | error | of it detail finer than the bands | of what a light of these bands shows |\n|---|---|---|---|---|---|"
    );
    let percent = |error: f64| format!("{:.1} %", 100.0 * error);
    let nodes = |brdf: &Brdf| if brdf.is_isotropic() { 96 } else { 32 };
    for (name, brdf) in brdfs() {
        let start = Instant::now();
        let factored = factor(&brdf, order(4), nodes(&brdf)).unwrap();
        let operators = factored.each_ref().map(|colour| colour.operator(8));
        let reflector = black_box(Reflector::new(name, &operators, [0.0; 3]));
        let seconds = start.elapsed().as_secs_f64();
        let worst = &factored[0];
        println!(
            "| {name} | {seconds:.2} s | {} | {} | {} | {} |",
            reflector.bytes() / reflector.header().channels,
            percent(worst.error(8)),
            percent(worst.band_limit()),
            percent(worst.lit_error(8))
        );
    }
    println!(
        "\n| error by terms | order | 1 | 2 | 4 | 8 | 16 | all, the bands' own | of what the light shows: 8 | all |\n|---|---|---|---|---|---|---|---|---|---|"
    );
    for (name, brdf) in brdfs() {
        for n in [2, 3, 4, 5, 6, 8] {
            let factored = &factor(&brdf, order(n), nodes(&brdf)).unwrap()[0];
            let by_terms = [1, 2, 4, 8, 16].map(|k| percent(factored.error(k)));
            println!(
                "| {name} | {n} | {} | {} | {} | {} |",
                by_terms.join(" | "),
                percent(factored.band_limit()),
                percent(factored.lit_error(8)),
                percent(factored.lit_error(usize::MAX))
            );
        }
    }
}

/// Points to be shaded.
const POINTS: usize = 14_500;

/// A point: the way into its tangent frame, and where it is seen from there.
type Point = (Mat3, Vec3);

fn points() -> Vec<Point> {
    let mut stream = Stream::new(3);
    let mut direction = || {
        let v = Vec3::from([0; 3].map(|_| stream.normal() as f32));
        v.normalize_or(Vec3::Z)
    };
    let point = |_| {
        let turn = Quat::from_rotation_arc(direction(), Vec3::Z);
        (Mat3::from_quat(turn), (direction() + 1.5 * Vec3::Z).normalize())
    };
    (0..POINTS).map(point).collect()
}

/// Points shaded by an operator of 8 terms and order 4 under three lobes, each in its own frame.
fn shading() {
    let n = order(4);
    let mut light = ShLight::cone(n, [0.3, 1.0, 0.2], 0.4, [3.0, 2.5, 2.0]).unwrap();
    light.add(&ShLight::cone(n, [-0.7, 0.2, 0.4], 0.8, [0.3, 0.4, 0.9]).unwrap());
    light.add(&ShLight::constant(n, [0.1; 3]).unwrap());
    let lobes = ZonalLight::fit(&light, 3);
    let points = points();
    let visibility = numbers(16 * POINTS);
    let frames: Vec<Mat3> = points.iter().map(|(frame, _)| *frame).collect();
    let views: Vec<Vec3> = points.iter().map(|(_, view)| *view).collect();
    println!(
        "\n| 14,500 points, 3 lobes, RGB light | threads | ms | frames per second |\n|---|---|---|---|"
    );
    let colours = [0.9, 0.6, 0.3];
    let gold = Brdf::Ggx { normal_reflectance: colours, alpha: [0.5; 2] };
    let lambert = Brdf::Lambert { albedo: colours };
    let all = [brdfs()[2], ("GGX in three colours", gold), ("Lambert in three colours", lambert)];
    for (name, brdf) in all {
        let operators = factor(&brdf, n, 48).unwrap().map(|colour| colour.operator(8));
        let reflector = Reflector::new(name, &operators, [0.0; 3]);
        let shade = |((to_local, view), v): (&Point, &[f32])| {
            let mut light = [[0.0; 16]; 3];
            let [r, g, b] = &mut light;
            lobes.in_frame(*to_local, [r, g, b]);
            reflector.shade(v, [&light[0], &light[1], &light[2]], *view)
        };
        let many = |first: usize, out: &mut [[f32; 3]]| {
            let range = first..first + out.len();
            let shaded = ShadedPoints {
                to_local: &frames[range.clone()],
                outgoing: &views[range],
                visibility: &visibility[16 * first..16 * (first + out.len())],
            };
            reflector.shade_points(Isa::best(), &lobes, shaded, out);
        };
        let common = GlobalReflector::new(name, &operators, 256);
        let expanded = lobes.expand();
        let single = |colour: &Vec<f64>| -> Vec<f32> { colour.iter().map(|&x| x as f32).collect() };
        let [r, g, b] = expanded.colours().each_ref().map(single);
        let in_common = |((to_local, view), v): (&Point, &[f32])| {
            let (normal, outgoing) = (to_local.row(2), to_local.transpose() * *view);
            common.shade(common.nearest(normal), v, [&r, &g, &b], outgoing)
        };
        let [one, two] = frame_us(&by_blocks(&many));
        let [one_single, two_single] = frame_us(&by_points(&points, &visibility, &shade));
        let [one_common, two_common] = frame_us(&by_points(&points, &visibility, &in_common));
        let kilobytes = common.bytes() / 1000;
        let other = format!("{name}, one frame for all, 256 normals, {kilobytes} kB");
        let threads = rayon::current_num_threads();
        let single = format!("{name}, point by point");
        let name = format!("{name}, {} terms", reflector.header().terms);
        for (name, threads, time) in [
            (&name, 1, one),
            (&name, threads, two),
            (&single, 1, one_single),
            (&single, threads, two_single),
            (&other, 1, one_common),
            (&other, threads, two_common),
        ] {
            println!("| {name} | {threads} | {:.2} | {:.0} |", time / 1e3, 1e6 / time);
        }
    }
}

/// Shades a frame, on one thread or on all.
type Frame<'a> = Box<dyn Fn(&mut [[f32; 3]], bool) + 'a>;

fn by_points<'a>(
    points: &'a [Point],
    visibility: &'a [f32],
    shade: &'a (impl Fn((&Point, &[f32])) -> [f32; 3] + Sync),
) -> Frame<'a> {
    Box::new(move |out, on_all| {
        let block = |(block, out): (usize, &mut [[f32; 3]])| {
            for (i, out) in out.iter_mut().enumerate() {
                let at = BLOCK * block + i;
                *out = shade((&points[at], &visibility[16 * at..][..16]));
            }
        };
        match on_all {
            true => out.par_chunks_mut(BLOCK).enumerate().for_each(block),
            false => out.chunks_mut(BLOCK).enumerate().for_each(block),
        }
    })
}

fn by_blocks<'a>(many: &'a (impl Fn(usize, &mut [[f32; 3]]) + Sync)) -> Frame<'a> {
    Box::new(move |out, on_all| {
        let block = |(block, out): (usize, &mut [[f32; 3]])| many(BLOCK * block, out);
        match on_all {
            true => out.par_chunks_mut(BLOCK).enumerate().for_each(block),
            false => out.chunks_mut(BLOCK).enumerate().for_each(block),
        }
    })
}

/// Points of one block.
const BLOCK: usize = 512;

/// Microseconds of a frame on one thread and on all.
fn frame_us(frame: &Frame<'_>) -> [f64; 2] {
    let (mut out, mut other) = (vec![[0.0; 3]; POINTS], vec![[0.0; 3]; POINTS]);
    best(1, [&mut || frame(black_box(&mut out), false), &mut || frame(black_box(&mut other), true)])
}

/// Exponentiated sums of logarithms beside the sequential product of the same visibilities and
/// beside looking, as distances in units of open sky, over random places of the spheres.
fn shadows() {
    let n = order(4);
    let shadows = SphereShadows::new(n);
    let gamma = TripleProduct::new(n, n, n);
    let open = (4.0 * PI).sqrt();
    println!(
        "\n| spheres, order 4 | exponential to looking | sequential product to looking | exponential to product | exponential | product |\n|---|---|---|---|---|---|"
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
fn look(order: Order, spheres: &[Sphere]) -> Vec<f64> {
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
fn tangents() {
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
fn heights() {
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
