use glam::{DQuat, DVec3};

use super::*;
use crate::sh::gauss_legendre;

fn order(bands: u8) -> Order {
    Order::new(bands).unwrap()
}

/// ∫ L y_i dω slowly, by Gauss–Legendre over rings about an axis with breaks where L has edges.
fn integrate(
    order: Order,
    axis: DVec3,
    edges: &[f64],
    radiance: impl Fn(DVec3) -> f64,
) -> Vec<f64> {
    let turn = DQuat::from_rotation_arc(DVec3::Z, axis);
    let mut sum = vec![0.0; order.coefficients()];
    let mut y = vec![0.0; order.coefficients()];
    for pair in edges.windows(2) {
        for (x, weight) in gauss_legendre(24) {
            let z = f64::midpoint(pair[0], pair[1]) + (pair[1] - pair[0]) / 2.0 * x;
            let r = (1.0 - z * z).max(0.0).sqrt();
            for k in 0..32 {
                let (sin, cos) = (2.0 * PI * f64::from(k) / 32.0).sin_cos();
                let w = turn * DVec3::new(r * cos, r * sin, z);
                evaluate_f64(order, w.to_array(), &mut y);
                let area = weight * (pair[1] - pair[0]) / 2.0 * 2.0 * PI / 32.0;
                let value = area * radiance(w);
                sum.iter_mut().zip(&y).for_each(|(s, y)| *s += value * y);
            }
        }
    }
    sum
}

fn close(found: &[f64], expected: &[f64], scale: f64) {
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - scale * b).abs() < 1e-11, "coefficient {i}: {a} {}", scale * b);
    }
}

/// Cones of all widths, in directions with and without a name, are what integration over the
/// sphere gives; each colour has its own strength; a sphere is the cone that it is seen as.
#[test]
fn cones_and_spheres_agree_with_integration() {
    let order = order(10);
    for axis in [DVec3::Z, DVec3::NEG_Y, DVec3::new(0.36, -0.48, 0.8)] {
        for degrees in [0.5_f64, 12.0, 60.0, 90.0, 150.0] {
            let edge = degrees.to_radians().cos();
            let expected = integrate(order, axis, &[edge, 1.0], |_| 1.0);
            let axis = axis.to_array();
            let cone = ShLight::cone(order, axis, degrees.to_radians(), [1.0, 2.0, 0.5]).unwrap();
            for (colour, scale) in cone.colours().iter().zip([1.0, 2.0, 0.5]) {
                close(colour, &expected, scale);
            }
            if degrees < 90.0 {
                let centre = axis.map(|x| 3.0 * x);
                let radius = 3.0 * degrees.to_radians().sin();
                let sphere = ShLight::sphere(order, centre, radius, [1.0, 2.0, 0.5]).unwrap();
                close(&sphere.colours()[0], &expected, 1.0);
            }
        }
    }
}

/// The whole sphere as a cone is the constant light, and a narrow cone of irradiance 1 tends to
/// the directional light.
#[test]
fn limits_of_cones_are_the_other_lights() {
    let order = order(10);
    let whole = ShLight::cone(order, [1.0, 1.0, 0.0], PI, [1.0; 3]).unwrap();
    let constant = ShLight::constant(order, [1.0; 3]).unwrap();
    close(&whole.colours()[1], &constant.colours()[1], 1.0);
    let angle: f64 = 1e-4;
    let solid_angle = 2.0 * PI * (2.0 * (angle / 2.0).sin().powi(2));
    let narrow = ShLight::cone(order, [0.0, 5.0, 0.0], angle, [1.0 / solid_angle; 3]).unwrap();
    let sun = ShLight::directional(order, [0.0, 0.1, 0.0], [1.0; 3]).unwrap();
    for (a, b) in narrow.colours()[2].iter().zip(&sun.colours()[2]) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
}

/// A turned light is the light in the turned direction, and lights add up.
#[test]
fn lights_turn_and_add() {
    let order = order(7);
    let q = DQuat::from_xyzw(0.2, -0.5, 0.3, 0.7).normalize();
    let axis = DVec3::new(0.6, 0.0, -0.8);
    let cone = ShLight::cone(order, axis.to_array(), 0.4, [1.0, 0.0, 3.0]).unwrap();
    let there = ShLight::cone(order, (q * axis).to_array(), 0.4, [1.0, 0.0, 3.0]).unwrap();
    close(&cone.rotated(q).colours()[2], &there.colours()[2], 1.0);
    let mut both = cone.clone();
    both.add(&ShLight::constant(order, [2.0; 3]).unwrap());
    let w = [0.0, 0.6, 0.8];
    let expected = cone.radiance(w)[0] + 2.0;
    assert!((both.radiance(w)[0] - expected).abs() < 1e-12);
    assert_eq!(ShLight::black(order).radiance(w), [0.0; 3]);
}

/// The brightest open surface faces the lamp, and reflects its irradiance over π, as far as three
/// bands tell it (the clamped cosine's own three: 1/4 + 1/2 + 5/16 at its peak).
#[test]
fn the_brightest_surface_faces_the_light() {
    let sun = ShLight::directional(order(3), [0.2, 0.5, -0.4], [PI; 3]).unwrap();
    let expected = 0.25 + 0.5 + 5.0 / 16.0;
    assert!((sun.brightest_reflection() - expected).abs() < 2e-3 * expected);
    let sky = ShLight::constant(order(6), [2.0, 1.0, 0.0]).unwrap();
    assert!((sky.brightest_reflection() - (2.0 * 0.2126 + 0.7152)).abs() < 1e-12);
    assert_eq!(ShLight::black(order(4)).brightest_reflection(), 0.0);
}

/// A window keeps the mean radiance; fewer bands are a prefix, more are zeros.
#[test]
fn windows_and_sizes_keep_the_mean() {
    let sun = ShLight::directional(order(6), [1.0, 2.0, 3.0], [1.0, 0.5, 0.0]).unwrap();
    let soft = sun.windowed(Window::Hann { width: 4.0 });
    assert_eq!(soft.coefficient(0), sun.coefficient(0));
    assert!(soft.colours()[0][16..].iter().all(|x| *x == 0.0));
    assert_eq!(sun.resized(order(3)).colours()[0], sun.colours()[0][..9]);
    assert_eq!(sun.resized(order(7)).coefficient(40), [0.0; 3]);
    assert_eq!(sun.coefficient(40), [0.0; 3]);
}

/// What is no light is refused with its numbers.
#[test]
fn nonsense_is_refused() {
    let n = order(3);
    let fails = |result: Result<ShLight, Error>, word: &str| {
        let message = result.unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    };
    fails(ShLight::constant(n, [f64::NAN, 0.0, 0.0]), "NaN");
    fails(ShLight::constant(n, [0.0, -1.0, 0.0]), "-1");
    fails(ShLight::directional(n, [0.0; 3], [1.0; 3]), "no direction");
    fails(ShLight::directional(n, [f64::INFINITY, 0.0, 0.0], [1.0; 3]), "no direction");
    fails(ShLight::cone(n, [1.0, 0.0, 0.0], 0.0, [1.0; 3]), "half angle");
    fails(ShLight::cone(n, [1.0, 0.0, 0.0], 3.2, [1.0; 3]), "half angle");
    fails(ShLight::sphere(n, [0.0, 1.0, 0.0], 1.0, [1.0; 3]), "radius 1 at distance 1");
    fails(ShLight::sphere(n, [0.0, 1.0, 0.0], f64::NAN, [1.0; 3]), "radius");
    let tiny = ShLight::directional(n, [1e-300, 0.0, 0.0], [1.0; 3]).unwrap();
    assert_eq!(tiny, ShLight::directional(n, [1e300, 0.0, 0.0], [1.0; 3]).unwrap());
}
