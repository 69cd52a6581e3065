//! Products of harmonics, and what agrees with slow integration.

use std::f64::consts::PI;
use std::hint::black_box;

use poselight::sh::{Order, Rotation, TripleProduct, evaluate_f64, gauss_legendre};
use poselight::shade::EnvironmentMap;

use crate::{best, numbers, order};

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

pub(crate) fn products() {
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
pub(crate) fn agreement() {
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
