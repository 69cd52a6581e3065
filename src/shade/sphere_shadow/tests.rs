use std::f64::consts::PI;

use super::logarithm::{Zonal, one};
use super::*;
use crate::sh::{TripleProduct, evaluate_f64, gauss_legendre};

fn order(bands: u8) -> Order {
    Order::new(bands).unwrap()
}

/// Visibility by looking: the share of directions that no sphere covers, projected by a product of
/// elevations and azimuths.
fn looked(order: Order, receiver: Vec3, spheres: &[Sphere]) -> Vec<f64> {
    let mut out = vec![0.0; order.coefficients()];
    let mut y = vec![0.0; order.coefficients()];
    let around = 192;
    for (z, weight) in gauss_legendre(96) {
        for k in 0..around {
            let (sin, cos) = (2.0 * PI * (f64::from(k) + 0.5) / f64::from(around)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let d = [r * cos, r * sin, z];
            let direction = Vec3::from(d.map(|x| x as f32));
            let blocked = spheres.iter().any(|sphere| {
                let to = sphere.centre - receiver;
                let along = to.dot(direction);
                along > 0.0 && to.length_squared() - along * along < sphere.radius * sphere.radius
            });
            if !blocked {
                evaluate_f64(order, d, &mut y);
                let area = weight * 2.0 * PI / f64::from(around);
                out.iter_mut().zip(&y).for_each(|(out, y)| *out += area * y);
            }
        }
    }
    out
}

fn distance(a: &[f32], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - b).powi(2)).sum::<f64>().sqrt()
}

/// The exponential of a visibility's logarithm is nearly that visibility, the nearer the smaller the
/// sphere; not exactly, because products that are cut off are not associative.
#[test]
fn exponentials_undo_logarithms() {
    for bands in [3, 4, 6] {
        for (degrees, most) in [(1.0_f64, 1e-9), (10.0, 1e-4), (25.0, 0.02)] {
            let mut visible = zonal::cap(order(bands), degrees.to_radians()).map(|c| -c);
            visible[0] += one()[0];
            let products = Zonal::new(order(bands));
            let back = products.exp(&products.log(&visible));
            for (l, (a, b)) in back.iter().zip(visible).enumerate() {
                assert!((a - b).abs() < most, "order {bands}, {degrees}°, band {l}: {a} {b}");
            }
        }
    }
}

/// One sphere of any size and in any direction is its cap, as far as the bands tell it; none is
/// open sky.
#[test]
fn one_sphere_is_its_cap() {
    let n = order(4);
    let shadows = SphereShadows::new(n);
    let mut found = [0.0; 16];
    shadows.visibility(Vec3::ZERO, &[], &mut found);
    assert!((f64::from(found[0]) - one()[0]).abs() < 1e-5 && found[1..].iter().all(|x| *x == 0.0));
    for (centre, radius) in
        [([0.0, 0.0, 5.0], 0.5), ([1.0, 2.0, -2.0], 1.0), ([0.0, -1.5, 0.2], 1.2)]
    {
        let sphere = Sphere { centre: Vec3::from(centre), radius };
        shadows.visibility(Vec3::ZERO, &[sphere], &mut found);
        let expected = looked(n, Vec3::ZERO, &[sphere]);
        let off = distance(&found, &expected);
        assert!(off < 0.08 * one()[0], "{centre:?} {radius}: {off}");
    }
}

/// Two spheres side by side: what exponentiation gives is near the product of the two, and near
/// what looking gives.
#[test]
fn sums_of_logarithms_are_products() {
    let n = order(4);
    let shadows = SphereShadows::new(n);
    let spheres = [
        Sphere { centre: Vec3::new(0.0, 3.0, 1.0), radius: 0.9 },
        Sphere { centre: Vec3::new(2.0, 1.5, -1.0), radius: 0.8 },
    ];
    let mut both = [0.0; 16];
    shadows.visibility(Vec3::ZERO, &spheres, &mut both);
    let gamma = TripleProduct::new(n, n, n);
    let [a, b] = spheres.map(|sphere| looked(n, Vec3::ZERO, &[sphere]));
    let mut product = [0.0; 16];
    gamma.product_f64(&a, &b, &mut product);
    let traced = looked(n, Vec3::ZERO, &spheres);
    assert!(distance(&both, &product) < 0.05 * one()[0], "{}", distance(&both, &product));
    assert!(distance(&both, &traced) < 0.05 * one()[0], "{}", distance(&both, &traced));
}

/// Inside a sphere, and inside a hundred, it is dark and nothing is infinite; a sphere without
/// radius blocks nothing.
#[test]
fn points_inside_are_dark_and_finite() {
    let shadows = SphereShadows::new(order(5));
    let mut found = [0.0; 25];
    let inside = Sphere { centre: Vec3::new(0.1, 0.0, 0.0), radius: 1.0 };
    for count in [1, 100] {
        shadows.visibility(Vec3::ZERO, &vec![inside; count], &mut found);
        assert!(found.iter().all(|x| x.is_finite() && x.abs() < 0.05), "{found:?}");
    }
    let around: Vec<Sphere> = (0..200)
        .map(|i| {
            let i = i as f32;
            let at = Vec3::new((i * 1.3).sin(), (i * 0.7).cos(), (i * 2.1).sin());
            Sphere { centre: at.normalize_or(Vec3::X) * 2.0, radius: 1.0 }
        })
        .collect();
    shadows.visibility(Vec3::ZERO, &around, &mut found);
    assert!(found.iter().all(|x| x.is_finite()), "{found:?}");
    assert!(found[0].abs() < 0.1 * one()[0] as f32, "{found:?}");
    let nothing = Sphere { centre: Vec3::ONE, radius: 0.0 };
    shadows.visibility(Vec3::ZERO, &[nothing], &mut found);
    assert!((f64::from(found[0]) - one()[0]).abs() < 1e-5);
}

/// Inside a sphere of a body it is dark, however much its spheres hide one another from outside; outside
/// their overlap lets light past.
#[test]
fn overlap_lights_nothing_inside() {
    let shadows = SphereShadows::new(order(4));
    let at = |x: f32| Sphere { centre: Vec3::new(x, 0.0, 0.0), radius: 1.0 };
    let body = [at(0.1), at(1.8)];
    let mut found = [0.0; 16];
    let mut among = |receiver: Vec3, overlap: f32| {
        shadows.among_bodies(receiver, [(&body[..], overlap)].into_iter(), &mut found);
        found
    };
    for overlap in [1.0, 0.7, 0.35] {
        let dark = among(Vec3::ZERO, overlap);
        assert!(dark.iter().all(|x| x.abs() < 0.01 * one()[0] as f32), "{overlap}: {dark:?}");
    }
    let outside = Vec3::new(0.0, 3.0, 0.0);
    assert!(among(outside, 0.35)[0] > among(outside, 1.0)[0] + 0.01);
}

/// A sphere over a floor: where all of it is above the horizon, ambient occlusion is 1 − (r/d)² cos θ
/// exactly. Ours is within 0.03 at order 4, within a hundredth where the sphere fills less than 20°.
#[test]
fn a_sphere_over_a_floor_has_its_closed_form() {
    let sphere = Sphere { centre: Vec3::new(0.0, 1.0, 0.0), radius: 0.6 };
    let n = order(4);
    let shadows = SphereShadows::new(n);
    let mut upright = [0.0; 16];
    zonal::rotate_f64(n, &zonal::clamped_cosine(n), [0.0, 1.0, 0.0], &mut upright);
    let mut visible = [0.0; 16];
    for step in 0..12 {
        let receiver = Vec3::new(0.25 * step as f32, 0.0, 0.1);
        shadows.visibility(receiver, &[sphere], &mut visible);
        let sum = visible.iter().zip(&upright);
        let ao = sum.map(|(v, c)| f64::from(*v) * c).sum::<f64>() / PI;
        let d = f64::from(sphere.centre.distance(receiver));
        let off = (ao - 1.0 + (0.6 / d).powi(2) / d).abs();
        assert!(off < if 0.6 / d < 0.34 { 0.01 } else { 0.03 }, "{step}: {off}");
    }
}

/// Spheres far apart count in full, many at nearly one place as one; with the factor the exponential of
/// such a cluster is nearer to its union than without.
#[test]
fn overlap_is_counted_once() {
    let n = order(4);
    let shadows = SphereShadows::new(n);
    let sphere = |x: f32, radius: f32| Sphere { centre: Vec3::new(x, 0.0, 0.0), radius };
    assert_eq!(shadows.overlap(&[sphere(0.0, 1.0)]), 1.0);
    let apart = [sphere(-3.0, 0.3), sphere(3.0, 0.3)];
    assert!(shadows.overlap(&apart) > 0.7, "{}", shadows.overlap(&apart));
    let cluster: Vec<Sphere> = (0..6).map(|i| sphere(0.02 * i as f32, 0.5)).collect();
    let weight = shadows.overlap(&cluster);
    assert!((0.1..0.35).contains(&weight), "{weight}");
    let receiver = Vec3::new(0.3, -1.0, 0.4);
    let expected = looked(n, receiver, &cluster);
    let (mut log, mut plain, mut weighed) = ([0.0; 16], [0.0; 16], [0.0; 16]);
    cluster.iter().for_each(|sphere| shadows.add(receiver, sphere, &mut log));
    shadows.exponential.apply(&log, &mut plain);
    shadows.exponential.apply(&log.map(|x| weight * x), &mut weighed);
    let (with, without) = (distance(&weighed, &expected), distance(&plain, &expected));
    assert!(with < 0.5 * without, "{with} {without}");
}
