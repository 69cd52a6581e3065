use glam::{DQuat, DVec3, Quat, Vec3};
use proptest::prelude::*;

use super::*;
use crate::sh::evaluate;

fn order(bands: u8) -> Order {
    Order::new(bands).unwrap()
}

fn quaternion() -> impl Strategy<Value = DQuat> {
    prop::array::uniform4(-1.0..1.0_f64)
        .prop_filter("not too short to normalise", |q| q.iter().map(|x| x * x).sum::<f64>() > 0.01)
        .prop_map(|q| DQuat::from_array(q).normalize())
}

fn direction() -> impl Strategy<Value = DVec3> {
    quaternion().prop_map(|q| q * DVec3::Z)
}

fn coefficients() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-1.0..1.0_f64, MAX_COEFFICIENTS)
}

fn rotate(bands: u8, q: DQuat, input: &[f64]) -> Vec<f64> {
    let mut rotation = Rotation::identity(order(bands));
    rotation.set_f64(q.to_array());
    let mut out = vec![0.0; usize::from(bands).pow(2)];
    rotation.apply_f64(input, &mut out);
    out
}

fn value(bands: u8, coefficients: &[f64], direction: DVec3) -> f64 {
    let mut y = [0.0; MAX_COEFFICIENTS];
    evaluate_f64(order(bands), direction.to_array(), &mut y);
    let count = usize::from(bands).pow(2);
    coefficients[..count].iter().zip(&y[..count]).map(|(a, b)| a * b).sum()
}

proptest! {
    /// The definition itself: the rotated function at ω is the function at R⁻¹ω, by direct
    /// evaluation in f64, for all orders.
    #[test]
    fn rotated_function_is_the_function_of_the_rotated_direction(
        q in quaternion(), w in direction(), f in coefficients(), bands in 1..=10_u8,
    ) {
        let rotated = value(bands, &rotate(bands, q, &f), w);
        let expected = value(bands, &f, q.inverse() * w);
        prop_assert!((rotated - expected).abs() < 1e-12, "{rotated} {expected}");
    }

    /// A rotation keeps every band's norm (so its matrix is orthonormal), and the constant.
    #[test]
    fn band_norms_are_invariant(q in quaternion(), f in coefficients()) {
        let out = rotate(10, q, &f);
        for l in 0..10 {
            let norm = |x: &[f64]| x[l * l..(l + 1) * (l + 1)].iter().map(|x| x * x).sum::<f64>();
            prop_assert!((norm(&out) - norm(&f)).abs() < 1e-12, "band {l}");
        }
    }

    /// Rotating by b and then by a is rotating by a·b.
    #[test]
    fn rotations_compose(a in quaternion(), b in quaternion(), f in coefficients()) {
        let twice = rotate(10, a, &rotate(10, b, &f));
        let once = rotate(10, a * b, &f);
        for (x, y) in twice.iter().zip(&once) {
            prop_assert!((x - y).abs() < 1e-12, "{x} {y}");
        }
    }

    /// f32 follows f64 to a few units in the last place of the vector's norm.
    #[test]
    fn f32_follows_f64(q in quaternion(), f in coefficients(), bands in 1..=10_u8) {
        let q = q.as_quat();
        let exact = rotate(bands, q.as_dquat(), &f);
        let input: Vec<f32> = f.iter().map(|&x| x as f32).collect();
        let mut out = vec![0.0; exact.len()];
        Rotation::new(order(bands), q).apply(&input, &mut out);
        for (x, y) in out.iter().zip(&exact) {
            prop_assert!((f64::from(*x) - y).abs() < 4e-6, "{x} {y}");
        }
    }
}

/// Half turns and the identity, where the Euler angles are not unique, are rotations like others.
#[test]
fn poles_are_not_special() {
    let f: Vec<f64> = (0..100).map(|i| (f64::from(i) * 0.7).sin()).collect();
    let near = 1e-9;
    for q in [
        DQuat::IDENTITY,
        DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0),
        DQuat::from_xyzw(0.0, 1.0, 0.0, 0.0),
        DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0),
        DQuat::from_xyzw(0.6, 0.8, 0.0, 0.0),
        DQuat::from_xyzw(near, -near, 0.6, 0.8).normalize(),
        DQuat::from_xyzw(0.6, 0.8, near, near).normalize(),
        -DQuat::IDENTITY,
    ] {
        let out = rotate(10, q, &f);
        for w in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(0.36, -0.48, 0.8)] {
            let (found, expected) = (value(10, &out, w), value(10, &f, q.inverse() * w));
            assert!((found - expected).abs() < 1e-12, "{q}: {found} {expected}");
        }
    }
}

/// A thousand small f32 rotations in a row end where their product ends, up to the rounding of
/// the step itself; and a rotation that is set anew keeps nothing of what it was before.
#[test]
fn repeated_rotation_does_not_drift() {
    let order = order(6);
    let step = Quat::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), std::f32::consts::TAU / 1000.0);
    let rotation = Rotation::new(order, step);
    let mut current = [0.0; 36];
    evaluate(order, Vec3::new(0.36, -0.48, 0.8), &mut current);
    let start = current;
    let mut next = [0.0; 36];
    for _ in 0..1000 {
        rotation.apply(&current, &mut next);
        current = next;
    }
    // f32 rounds the step itself by up to 6e-8, which a thousand steps of band 5 magnify to 3e-4.
    let error = current.iter().zip(&start).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(error < 1e-3, "{error}");
    let norm = |x: &[f32]| x.iter().map(|x| x * x).sum::<f32>();
    // A rounded cosine and sine are 6e-8 off the unit circle at worst, three times per rotation.
    assert!((norm(&current) / norm(&start) - 1.0).abs() < 4e-4);

    let mut reused = Rotation::new(order, Quat::from_xyzw(0.3, 0.1, -0.8, 0.2));
    reused.set(step);
    let mut again = [0.0; 36];
    rotation.apply(&start, &mut next);
    reused.apply(&start, &mut again);
    assert_eq!(next, again);
}

/// A delta function's coefficients follow the direction that they stand for.
#[test]
fn basis_vectors_follow_their_direction() {
    let order = order(6);
    let q = Quat::from_xyzw(0.1, 0.7, -0.3, 0.5).normalize();
    let w = Vec3::new(0.36, -0.48, 0.8);
    let (mut before, mut expected, mut after) = ([0.0; 36], [0.0; 36], [0.0; 36]);
    evaluate(order, w, &mut before);
    evaluate(order, q * w, &mut expected);
    Rotation::new(order, q).apply(&before, &mut after);
    for (a, b) in after.iter().zip(&expected) {
        assert!((a - b).abs() < 3e-6);
    }
}

/// At order 10 the rotated coefficients are those of the rotated function, integrated slowly over
/// the sphere: f64 to round-off, f32 to 1e-6 of the vector's norm.
#[test]
fn rotation_agrees_with_integration_at_order_10() {
    let f: Vec<f64> = (0..100).map(|i| (f64::from(i) * 1.3).cos()).collect();
    let q = Quat::from_xyzw(0.31, -0.52, 0.67, 0.43).normalize();
    let exact = q.as_dquat().normalize();
    let mut integrated = [0.0; 100];
    let mut y = [0.0; 100];
    for (w, weight) in zone(14, -1.0, 1.0) {
        evaluate_f64(order(10), w, &mut y);
        let turned = value(10, &f, exact.inverse() * DVec3::from_array(w));
        integrated.iter_mut().zip(&y).for_each(|(sum, y)| *sum += weight * turned * y);
    }
    let input: Vec<f32> = f.iter().map(|&x| x as f32).collect();
    let mut fast = [0.0; 100];
    Rotation::new(order(10), q).apply(&input, &mut fast);
    let norm = f.iter().map(|x| x * x).sum::<f64>().sqrt();
    for (i, (x, exact)) in rotate(10, exact, &f).iter().zip(&integrated).enumerate() {
        assert!((x - exact).abs() < 1e-12, "{i}: {x} {exact}");
        let error = (f64::from(fast[i]) - exact).abs();
        assert!(error < 1e-6 * norm, "{i}: {error}");
    }
}

/// A thousand full turns in steps of a third of a turn and a bit: coefficients that are turned
/// again and again in f64 come back to 1e-10, and f32 coefficients that are turned each time from
/// where they began stay within 1e-5 of their norm, at order 10.
#[test]
fn a_thousand_turns_do_not_drift() {
    let f: Vec<f64> = (0..100).map(|i| (f64::from(i) * 0.7).sin()).collect();
    let start: Vec<f32> = f.iter().map(|&x| x as f32).collect();
    let norm = f.iter().map(|x| x * x).sum::<f64>().sqrt();
    let axis = DVec3::new(0.48, 0.6, 0.64);
    let (steps, turns) = (2_999, 1_000.0);
    let step = std::f64::consts::TAU * turns / f64::from(steps);
    let mut rotation = Rotation::identity(order(10));
    let (mut current, mut next, mut fast) = (f.clone(), vec![0.0; 100], vec![0.0; 100]);
    for k in 1..=steps {
        rotation.set_f64(DQuat::from_axis_angle(axis, step).to_array());
        rotation.apply_f64(&current, &mut next);
        std::mem::swap(&mut current, &mut next);
        if k % 100 == 0 || k == steps {
            rotation.set(DQuat::from_axis_angle(axis, step * f64::from(k)).as_quat());
            rotation.apply(&start, &mut fast);
            for (x, exact) in fast.iter().zip(&current) {
                let error = (f64::from(*x) - exact).abs();
                assert!(error < 1e-5 * norm, "step {k}: {error}");
            }
        }
    }
    for (x, start) in current.iter().zip(&f) {
        assert!((x - start).abs() < 1e-10, "{x} {start}");
    }
}
