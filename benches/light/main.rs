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

mod harmonics;
mod lights;
mod shading;
mod shadows;

use std::time::Instant;

use poselight::num::random::Stream;
use poselight::sh::Order;

const ROUNDS: usize = 60;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|w| !w.starts_with('-')).collect();
    let parts: [(&str, fn()); 8] = [
        ("products", harmonics::products),
        ("agreement", harmonics::agreement),
        ("lobes", lights::lobes),
        ("reflection", lights::reflection),
        ("points", shading::shading),
        ("spheres", shadows::shadows),
        ("heights", shadows::heights),
        ("tangents", shadows::tangents),
    ];
    for (name, part) in parts {
        if words.is_empty() || words.iter().any(|word| name.contains(word.as_str())) {
            part();
        }
    }
}

pub(crate) fn order(bands: u8) -> Order {
    Order::new(bands).unwrap()
}

/// Microseconds of one call in the best of many rounds, for each contestant.
pub(crate) fn best<const N: usize>(
    repeats: usize,
    mut contestants: [&mut dyn FnMut(); N],
) -> [f64; N] {
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

pub(crate) fn numbers(count: usize) -> Vec<f32> {
    let mut stream = Stream::new(1);
    (0..count).map(|_| stream.normal() as f32).collect()
}
