//! `cargo bench --bench light`: products of spherical harmonics by the sparse tensor beside the
//! dense one, on one core. Every round runs all contestants in turn; the best round counts.

#![expect(clippy::print_stdout, reason = "a benchmark prints its tables")]
#![expect(clippy::unwrap_used, reason = "a benchmark ends where something fails")]

use std::hint::black_box;
use std::time::Instant;

use poselight::num::random::Stream;
use poselight::sh::{Order, TripleProduct};

const ROUNDS: usize = 60;

fn main() {
    products();
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
        let order = Order::new(bands).unwrap();
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
