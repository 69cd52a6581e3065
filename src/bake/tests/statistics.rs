//! What the estimator claims of itself: no bias against an oracle, honest noise, convergence.

use super::*;
use crate::num::random::Stream;
use crate::sh;
use crate::trace::{Device, Rays, Scene};

/// Two spheres that shade one another, few points.
fn pair() -> Body {
    let mut body = Body::sphere(1);
    body.append(&Body::sphere(1).mapped(|p| p * 0.6 + Vec3::new(1.3, 0.4, 0.2)));
    body
}

/// The signal by the book: independent uniform directions of the whole hemisphere in the root
/// frame, each weighted by its integrand. Returns mean and variance of the mean per coefficient.
fn oracle(body: &Body, signal: Signal, point: usize, rays: usize) -> Vec<[f64; 2]> {
    let order = Order::new(6).unwrap();
    let scene = Scene::build(&Device::new().unwrap(), &body.positions, &body.triangles).unwrap();
    let normal = body.normals[point].normalize();
    let origin = body.positions[point] + normal * 1e-4;
    let mut stream = Stream::new(point as u64);
    let mut sums = vec![[0.0; 2]; 36];
    for _ in 0..rays {
        let mut direction = Vec3::from_array([(); 3].map(|()| stream.normal() as f32)).normalize();
        if direction.dot(normal) < 0.0 {
            direction = -direction;
        }
        let [x, y, z] = direction.to_array();
        let (x, y, z) = ([x], [y], [z]);
        let mut blocked = [0];
        let ray = Rays { origin, x: &x, y: &y, z: &z, near: 0.0, far: f32::INFINITY };
        scene.occluded(&ray, &mut blocked);
        let open = f64::from(1 - blocked[0] as u32);
        let mut basis = [0.0; 36];
        sh::evaluate_f64(order, direction.to_array().map(f64::from), &mut basis);
        let cosine = f64::from(direction.dot(normal));
        for (i, (sum, y)) in sums.iter_mut().zip(basis).enumerate() {
            // Times 2π, the hemisphere's solid angle.
            let value = std::f64::consts::TAU
                * match signal {
                    Signal::Ao => open * cosine / std::f64::consts::PI,
                    Signal::Transfer => open * cosine * y / std::f64::consts::PI,
                    Signal::Visibility => (open - 1.0) * y,
                };
            let whole = f64::from(u8::from(signal == Signal::Visibility && i == 0));
            let value = value + whole * (2.0 * std::f64::consts::TAU).sqrt();
            *sum = [sum[0] + value, sum[1] + value * value];
        }
    }
    let n = rays as f64;
    let mean = |[sum, squares]: [f64; 2]| {
        let mean = sum / n;
        [mean, (squares / n - mean * mean) / n]
    };
    sums.into_iter().map(mean).collect()
}

/// No bias: the mean of 200 bakes of 64 rays agrees with the oracle (40,000 independent rays) for
/// every signal, coefficient and five points: no |z| above 5.2 (365 comparisons of significance
/// 2e-7 each; Bonferroni keeps the family below 1e-4), seed 1.
#[test]
fn estimates_agree_with_the_oracle() {
    let body = pair();
    let times: Vec<f32> = (0..200).map(|i| i as f32 * 0.1).collect();
    for signal in SIGNALS {
        let baked = body.bake(&settings(signal, 64), &times);
        let count = signal.coefficients(Order::new(6).unwrap());
        for point in noisiest(&baked[0], 5) {
            let expected = oracle(&body, signal, point, 40_000);
            for (i, [truth, variance]) in expected.into_iter().take(count).enumerate() {
                let value = |pose: &BakedPose| f64::from(pose.coefficients[point * count + i]);
                let n = baked.len() as f64;
                let mean = baked.iter().map(value).sum::<f64>() / n;
                let spread = baked.iter().map(|b| (value(b) - mean).powi(2)).sum::<f64>();
                let error = (variance + spread / (n * (n - 1.0)) + 1e-12).sqrt();
                let z = (mean - truth) / error;
                assert!(z.abs() < 5.2, "{signal:?} point {point} coefficient {i}: z = {z}");
            }
        }
    }
}

/// The points of most noise, which are partly occluded.
fn noisiest(baked: &BakedPose, count: usize) -> Vec<usize> {
    let mut points: Vec<usize> = (0..baked.noise.len()).collect();
    points.sort_by(|&a, &b| baked.noise[b].total_cmp(&baked.noise[a]));
    points.truncate(count);
    assert!(points.iter().all(|&p| baked.noise[p] > 0.0), "too few points are occluded");
    points
}

/// Honest noise: over 400 bakes the mean square of what is claimed agrees with the variance that
/// is seen within 15 per cent (about four standard errors of that ratio), with one block of two
/// batches and with three blocks of six.
#[test]
fn claimed_noise_is_the_noise_that_is_seen() {
    let body = pair();
    let times: Vec<f32> = (0..400).map(|i| i as f32 * 0.3).collect();
    for (signal, rays) in [(Signal::Ao, 100), (Signal::Transfer, 100), (Signal::Transfer, 6000)] {
        let times = if rays > 1000 { &times[..60] } else { &times };
        let baked = body.bake(&settings(signal, rays), times);
        let count = signal.coefficients(Order::new(6).unwrap());
        let (n, points) = (baked.len() as f64, body.positions.len());
        let claimed = baked.iter().flat_map(|b| &b.noise).map(|s| f64::from(*s).powi(2));
        let claimed = claimed.sum::<f64>() / n;
        let mut seen = 0.0;
        for i in 0..points * count {
            let mean = baked.iter().map(|b| f64::from(b.coefficients[i])).sum::<f64>() / n;
            let square = |b: &BakedPose| (f64::from(b.coefficients[i]) - mean).powi(2);
            seen += baked.iter().map(square).sum::<f64>() / (n - 1.0) / count as f64;
        }
        let ratio = claimed / seen;
        assert!((ratio - 1.0).abs() < 0.15, "{signal:?}, {rays} rays: claimed/seen = {ratio}");
    }
}

/// Error falls faster than by independent rays: from 32 to 512 rays, 16 times as many, the
/// root-mean-square noise falls by more than the 4 of independent rays, about the 16^0.75 = 8 of
/// low-discrepancy sets on discontinuous functions.
#[test]
fn noise_converges_like_low_discrepancy() {
    let body = pair();
    let times: Vec<f32> = (0..40).map(|i| i as f32).collect();
    let noise = |rays| {
        let baked = body.bake(&settings(Signal::Transfer, rays), &times);
        let squares = baked.iter().flat_map(|b| &b.noise).map(|n| f64::from(*n).powi(2));
        squares.sum::<f64>().sqrt()
    };
    let factor = noise(32) / noise(512);
    assert!(factor > 5.5, "16 times the rays reduce the noise by {factor} only");
}
