//! Closed forms. Statistical comparisons bake the same geometry at many times, which differ in
//! nothing but their random numbers.

use std::f32::consts::PI;

use super::*;
use crate::sh::{self, zonal};

/// Checks a body that blocks none of its own points: ambient occlusion is 1, visibility is exactly
/// (√4π, 0, …), transfer is the clamped cosine about the normal.
fn assert_unoccluded(body: &Body, what: &str) {
    for signal in SIGNALS {
        let settings = settings(signal, 64);
        let baked = &body.bake(&settings, &[0.0])[0];
        assert!(baked.noise.iter().all(|&noise| noise == 0.0), "{what}: {signal:?} has noise");
        let count = signal.coefficients(settings.order);
        for (values, &normal) in baked.coefficients.chunks(count).zip(&body.normals) {
            let mut expected = vec![0.0; count];
            match signal {
                Signal::Ao => expected[0] = 1.0,
                Signal::Visibility => expected[0] = (4.0 * PI).sqrt(),
                Signal::Transfer => {
                    let unshadowed = zonal::unshadowed(settings.order);
                    zonal::rotate(settings.order, &unshadowed, normal, &mut expected);
                }
            }
            for (value, expected) in values.iter().zip(&expected) {
                assert!((value - expected).abs() < 2e-6, "{what}: {signal:?} {values:?}");
            }
        }
    }
}

/// Convex bodies are unoccluded at every scale from a micrometre to a thousand kilometres.
#[test]
fn convex_bodies_are_unoccluded_at_every_scale() {
    for exponent in (-6..=6).step_by(3) {
        let scale = 10.0f32.powi(exponent);
        assert_unoccluded(&Body::sphere(3).mapped(|p| p * scale), &format!("sphere at {scale}"));
        assert_unoccluded(&Body::cube().mapped(|p| p * scale), &format!("cube at {scale}"));
        let slab = Vec3::new(1.0, 1e-3, 1.0) * scale;
        assert_unoccluded(&Body::cube().mapped(|p| p * slab), &format!("slab at {scale}"));
    }
}

/// A cube of 2 m, and one of 2 mm, are unoccluded a kilometre and more from the origin, where
/// neighbouring numbers are 0.06 mm and more apart.
#[test]
fn convex_bodies_are_unoccluded_far_from_the_origin() {
    for (size, distance) in [(1.0, 1e3), (1.0, 1e6), (1e-3, 1e3)] {
        let far = Vec3::new(1.0, -0.7, 0.3) * distance;
        let body = Body::cube().mapped(|p| p * size + far);
        assert_unoccluded(&body, &format!("cube of {size} at {distance}"));
    }
}

/// Estimates of one value, compared with the truth in units of the standard error that they
/// themselves claim.
fn deviation(estimates: &[f64], noises: &[f64], truth: f64) -> f64 {
    let count = estimates.len() as f64;
    let mean = estimates.iter().sum::<f64>() / count;
    let error = noises.iter().map(|n| n * n).sum::<f64>().sqrt() / count;
    (mean - truth) / error
}

/// Small level triangles at the given places of the plane y = 0; point 3i is at place i.
fn sensors(places: &[Vec3]) -> Body {
    let mut body = Body { sensors: 3 * places.len(), ..Body::nothing() };
    for &place in places {
        let first = body.positions.len() as u32;
        body.positions.extend([place, place + Vec3::Z * 1e-3, place + Vec3::X * 1e-3]);
        body.normals.extend([Vec3::Y; 3]);
        body.triangles.push([first, first + 1, first + 2]);
    }
    body
}

const REPEATS: usize = 64;

/// Ambient occlusion of every sensor, with the noise it claims, over the repeats.
fn ambient(body: &Body, settings: &Settings, sensor: usize) -> (Vec<f64>, Vec<f64>) {
    let times: Vec<f32> = (0..REPEATS).map(|i| i as f32).collect();
    let baked = body.bake(settings, &times);
    let value = |pose: &BakedPose| f64::from(pose.coefficients[3 * sensor]);
    let noise = |pose: &BakedPose| f64::from(pose.noise[3 * sensor]);
    (baked.iter().map(value).collect(), baked.iter().map(noise).collect())
}

/// Before an endless wall of height h at distance d, level ground has
/// ao = 1 − (1 − d/√(d² + h²))/2. H₀ is rejected for none of 5 distances at |z| > 4.4
/// (significance 1e-5 each), 64 repeats of 512 rays, seed 1.
#[test]
fn wall_at_a_distance() {
    let height = 2.0;
    let distances = [0.25, 0.5, 1.0, 2.0, 8.0f32];
    let mut body = sensors(&distances.map(|d| Vec3::X * -d));
    let (low, high) = (Vec3::Z * -4e4, Vec3::Z * 4e4);
    body.quad([low, high, high + Vec3::Y * height, low + Vec3::Y * height]);
    for (sensor, distance) in distances.into_iter().enumerate() {
        let (values, noises) = ambient(&body, &settings(Signal::Ao, 512), sensor);
        let cosine = f64::from(distance / distance.hypot(height));
        let z = deviation(&values, &noises, 1.0 - (1.0 - cosine) / 2.0);
        assert!(z.abs() < 4.4, "distance {distance}: z = {z}");
        let noise = noises.iter().sum::<f64>() / REPEATS as f64;
        assert!(noise > 1e-4 && noise < 0.01, "distance {distance}: noise {noise}");
    }
}

/// Beyond the maximum distance the wall blocks nothing, just within it something.
#[test]
fn maximum_distance_is_kept() {
    let mut body = sensors(&[Vec3::X * -3.0]);
    let (low, high) = (Vec3::Z * -50.0, Vec3::Z * 50.0);
    body.quad([low, high, high + Vec3::Y * 50.0, low + Vec3::Y * 50.0]);
    for (max_distance_m, blocked) in [(2.99, false), (3.3, true)] {
        let max_distance_m = Some(max_distance_m);
        let limited = Settings { max_distance_m, ..settings(Signal::Ao, 512) };
        let (values, _) = ambient(&body, &limited, 0);
        assert_eq!(values.iter().any(|&v| v < 1.0), blocked, "{max_distance_m:?}");
        assert!(values.iter().all(|&v| v > 0.9));
    }
}

/// Under a sphere of radius r whose centre is D away at the angle θ from the normal, wholly above
/// the horizon, ao = 1 − (r/D)² cos θ; its visibility is √4π minus the zonal coefficients of a cap
/// turned there, band for band. |z| < 4.4 for ambient occlusion and (with a Bonferroni correction
/// for 36) 5.1 for the coefficients, and the facets' 4e-4 of the sphere's area are allowed for.
#[test]
fn sphere_over_plane() {
    let place = Vec3::ZERO;
    let (centre, radius) = (Vec3::new(0.9, 1.8, -0.6), 0.7);
    let mut body = sensors(&[place]);
    body.append(&Body::sphere(6).mapped(|p| p * radius + centre));
    let (distance, direction) = (centre.length(), centre.normalize());
    let lost = f64::from((radius / distance).powi(2) * direction.y);
    let (values, noises) = ambient(&body, &settings(Signal::Ao, 512), 0);
    let slack = 4e-4 * lost;
    let z = [1.0 - lost, 1.0 - lost + slack].map(|truth| deviation(&values, &noises, truth));
    assert!(z[0] > -4.4 && z[1] < 4.4, "ambient occlusion: z = {z:?}");

    let order = Order::new(6).unwrap();
    let mut truth = [0.0f32; 36];
    zonal::rotate(
        order,
        &cap(order, (1.0 - (radius / distance).powi(2)).sqrt()),
        direction,
        &mut truth,
    );
    truth.iter_mut().for_each(|t| *t = -*t);
    truth[0] += (4.0 * PI).sqrt();
    let times: Vec<f32> = (0..REPEATS).map(|i| i as f32).collect();
    let baked = body.bake(&settings(Signal::Visibility, 512), &times);
    for (i, &truth) in truth.iter().enumerate() {
        let values: Vec<f64> = baked.iter().map(|b| f64::from(b.coefficients[i])).collect();
        let mean = values.iter().sum::<f64>() / REPEATS as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        let error = (variance / (REPEATS * (REPEATS - 1)) as f64).sqrt();
        let slack = 4e-4 * 4.0 * PI * radius.powi(2) / (4.0 * distance.powi(2));
        let off = (mean - f64::from(truth)).abs() - f64::from(slack);
        assert!(off < 5.1 * error, "coefficient {i}: {mean} for {truth}, error {error}");
    }
}

/// ∫ over a cap about +Z of y_l0: √(π/(2l+1)) (P_{l−1}(c) − P_{l+1}(c)), c the cosine of the cap's
/// angular radius.
fn cap(order: Order, cosine: f32) -> Vec<f32> {
    let c = f64::from(cosine);
    let mut legendre = vec![1.0, c];
    for l in 1..=order.bands() {
        let (lf, n) = (l as f64, legendre.len());
        legendre.push(((2.0 * lf + 1.0) * c * legendre[n - 1] - lf * legendre[n - 2]) / (lf + 1.0));
    }
    let band = |l: usize| {
        let before = if l == 0 { 1.0 } else { legendre[l - 1] };
        let scale = (std::f64::consts::PI / (2 * l + 1) as f64).sqrt();
        let drop = if l == 0 { 1.0 - c } else { before - legendre[l + 1] };
        (scale * drop) as f32
    };
    (0..order.bands()).map(band).collect()
}

/// Transfer and ambient occlusion of the same rays are the same number: t₀·2√π = ao at every
/// point of a concave body.
#[test]
fn first_coefficient_is_ambient_occlusion() {
    let mut body = Body::sphere(3);
    body.append(&Body::sphere(3).mapped(|p| p * 0.5 + Vec3::X));
    let ao = &body.bake(&settings(Signal::Ao, 200), &[0.5])[0];
    let transfer = &body.bake(&settings(Signal::Transfer, 200), &[0.5])[0];
    let mut occluded = 0;
    for (ao, t) in ao.coefficients.iter().zip(transfer.coefficients.chunks(36)) {
        assert!((ao - t[0] * 2.0 * PI.sqrt()).abs() < 2e-6, "{ao} {}", t[0]);
        occluded += usize::from(*ao < 0.99);
    }
    assert!(occluded > 20, "only {occluded} points are occluded");
    assert_eq!(sh::index(0, 0), 0);
}
