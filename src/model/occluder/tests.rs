//! Caps against quadrature, whole models against plain f64 arithmetic, and hostile blobs.

use std::f64::consts::PI;

use glam::{DVec3, Quat, Vec3};

use super::caps::{LANES, View};
use super::*;
use crate::model::{
    Family, Frame, Model, PosedInput, Precision, Signal, Surface, synthetic, unshadowed,
};
use crate::sh::{MAX_BANDS, Order, evaluate_f64};

/// How a sphere at unit distance along `direction` looks to a point with this normal.
fn view(direction: Vec3, normal: Vec3, radius: f32) -> View {
    let lanes = |v: Vec3| [0, 1, 2].map(|axis| [v[axis]; LANES]);
    View::new(&lanes(Vec3::ZERO), &lanes(normal), direction.to_array(), radius).unwrap()
}

/// Σ over a fine grid of directions of f(ω) dω.
fn over_sphere(mut f: impl FnMut(DVec3) -> f64) -> f64 {
    const STEPS: usize = 400;
    let mut sum = 0.0;
    for i in 0..STEPS {
        let z = (i as f64 + 0.5) / STEPS as f64 * 2.0 - 1.0;
        for j in 0..2 * STEPS {
            let (sin, cos) = (PI * (j as f64 + 0.5) / STEPS as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            sum += f(DVec3::new(r * cos, r * sin, z));
        }
    }
    sum * 4.0 * PI / (2 * STEPS * STEPS) as f64
}

/// Proves by summing over directions that a cap above the horizon blocks s²c of the sky, that the
/// soft horizon is within 0.02 of the truth, and that nothing is blocked from below it.
#[test]
fn caps_block_their_share_of_the_sky() {
    let normal = Vec3::new(0.36, -0.48, 0.8);
    let side = normal.any_orthonormal_vector();
    for (degrees, sine, bound) in
        [(0.0_f32, 0.5_f32, 1e-3), (40.0, 0.6, 1e-3), (90.0, 0.4, 0.02), (80.0, 0.9, 0.05)]
    {
        let (s, c) = degrees.to_radians().sin_cos();
        let direction = normal * c + side * s;
        let found = view(direction, normal, sine).occlusion()[0];
        let edge = f64::from(1.0 - sine * sine).sqrt();
        let expected = over_sphere(|w| {
            let inside = w.dot(direction.as_dvec3()) > edge;
            if inside { w.dot(normal.as_dvec3()).max(0.0) / PI } else { 0.0 }
        });
        assert!((f64::from(found) - expected).abs() < bound, "{degrees} {found} {expected}");
    }
    let lanes = |v: Vec3| [0, 1, 2].map(|axis| [v[axis]; LANES]);
    let below = View::new(&lanes(Vec3::ZERO), &lanes(normal), (-normal).to_array(), 0.9);
    assert!(below.is_none(), "nothing of the sphere is above the horizon");
    assert!((view(side, normal, 0.4).above()[0] - 0.5).abs() < 1e-6);
}

/// Proves by summing over directions that a band's factor times y_lm of the direction is the
/// integral of y_lm over the cap.
#[test]
fn bands_are_integrals_over_the_cap() {
    let order = Order::new(6).unwrap();
    let direction = Vec3::new(-0.6, 0.64, 0.48);
    let view = view(direction, Vec3::Z, 0.7);
    let mut bands = [[0.0; LANES]; MAX_BANDS];
    view.bands(order, &mut bands);
    let mut at = [0.0; 36];
    evaluate_f64(order, direction.as_dvec3().to_array(), &mut at);
    let edge = (1.0_f64 - 0.49).sqrt();
    for c in [0, 2, 5, 11, 17, 24, 35] {
        let mut y = [0.0; 36];
        let expected = over_sphere(|w| {
            if w.dot(direction.as_dvec3()) <= edge {
                return 0.0;
            }
            evaluate_f64(order, w.to_array(), &mut y);
            y[c]
        });
        let found = f64::from(bands[usize::isqrt(c)][0]) * at[c];
        assert!((found - expected).abs() < 3e-3, "{c}: {found} {expected}");
    }
}

fn rotations() -> Vec<Quat> {
    [0.3, -0.9, 2.0].map(Quat::from_rotation_y).to_vec()
}

fn posed(model: &Model, surface: Surface<'_>, turns: &[Quat]) -> Vec<f32> {
    let parameters = synthetic::numbers(21, synthetic::PARAMETERS);
    let mut out = vec![f32::NAN; model.shape().points * model.shape().width];
    let input =
        PosedInput { parameters: &parameters, bone_rotations: turns, surface: Some(surface) };
    model.evaluate_posed(&input, &mut out).unwrap();
    out
}

/// Proves that a model with occluders is its decoder's part in the root frame, and the unshadowed
/// signal, less what each sphere blocks by its point's weight of its group.
#[test]
fn evaluation_is_the_definition() {
    let (positions, normals) = synthetic::surface();
    let surface = Surface { positions: &positions, normals: &normals, tangents: &[] };
    for signal in [Signal::Transfer, Signal::Visibility] {
        let model = synthetic::occluded(Family::PcaLinear, signal);
        let kind = (signal, model.header().sh_order());
        let found = posed(&model, surface, &rotations());
        let parameters = synthetic::numbers(21, synthetic::PARAMETERS);
        let width = model.shape().width;
        let mut expected = vec![0.0; found.len()];
        model.evaluate(&parameters, None, &mut expected).unwrap();
        model.to_root_frame(&rotations(), None, &mut expected).unwrap();
        let occluders = synthetic::occluders();
        let bones = model.bone_of_point();
        let centres = occluders.centres(&positions, bones, &rotations());
        for (point, row) in expected.chunks_exact_mut(width).enumerate() {
            let mut free = vec![0.0; width];
            unshadowed(kind, normals[point], &mut free);
            row.iter_mut().zip(&free).for_each(|(x, free)| *x += free);
            for (sphere, &centre) in centres.iter().enumerate() {
                let lanes = |v: Vec3| [0, 1, 2].map(|axis| [v[axis]; LANES]);
                let (position, normal) = (lanes(positions[point]), lanes(normals[point]));
                let radius = occluders.radii[sphere];
                let view = View::new(&position, &normal, centre.to_array(), radius);
                let Some(view) = view else { continue };
                let mut sums = vec![[0.0; LANES]; width];
                add(&view, kind, &[1.0; LANES], &mut sums);
                let group = occluders.group_of[usize::from(bones[point]) * centres.len() + sphere];
                let weight = occluders.weights[point * 3 + usize::from(group)];
                row.iter_mut().zip(&sums).for_each(|(x, sum)| *x -= weight * sum[0]);
            }
        }
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }
    }
}

/// Proves against every pair of point and sphere on its own, in f64 and with nothing passed over,
/// that what is passed over blocks nothing: for scalars and harmonics, points near, far and inside,
/// and whichever pose the points were ordered in.
#[test]
fn passing_over_changes_nothing() {
    let (points, spheres) = (203, 53);
    let mut stream = crate::num::random::Stream::new(31);
    let mut vector =
        |scale: f64| Vec3::from_array([(); 3].map(|()| (scale * stream.normal()) as f32));
    let positions: Vec<Vec3> = (0..points).map(|_| vector(0.4)).collect();
    let normals: Vec<Vec3> = (0..points).map(|_| vector(1.0).normalize()).collect();
    let centres: Vec<Vec3> = (0..spheres).map(|_| vector(0.5)).collect();
    let bones: Vec<u16> = (0..points).map(|point| (point % 3) as u16).collect();
    let occluders = Occluders {
        radii: (0..spheres).map(|q| 0.02 + 0.005 * q as f32).collect(),
        group_of: (0..3 * spheres).map(|i| (i % 4) as u8).collect(),
        weights: (0..points * 4).map(|i| 0.5 + (i % 7) as f32 * 0.1).collect(),
        ..Occluders::default()
    };
    let seen = Seen::new(&occluders, &bones);
    let surface = Surface { positions: &positions, normals: &normals, tangents: &[] };
    let elsewhere: Vec<Vec3> = positions.iter().rev().copied().collect();
    let warm = Surface { positions: &elsewhere, normals: &normals, tangents: &[] };
    let scalar = (Signal::Ao, Order::new(1).unwrap());
    seen.subtract(&occluders, &centres, warm, scalar, &mut vec![0.0; points]);
    for signal in [Signal::Ao, Signal::Transfer, Signal::Visibility] {
        let kind = (signal, Order::new(3).unwrap());
        let width = signal.coefficients(kind.1);
        let mut out = vec![0.0; points * width];
        seen.subtract(&occluders, &centres, surface, kind, &mut out);
        for (point, row) in out.chunks_exact(width).enumerate() {
            let mut expected = vec![0.0_f64; width];
            for (sphere, &centre) in centres.iter().enumerate() {
                let group = usize::from(occluders.group_of[(point % 3) * spheres + sphere]);
                let weight = occluders.weights[point * 4 + group];
                let offset = (centre - positions[point]).as_dvec3();
                let (radius, normal) = (f64::from(occluders.radii[sphere]), normals[point]);
                if signal == Signal::Ao {
                    let distance = offset.length();
                    let s = (radius / distance).min(1.0);
                    let c = offset.dot(normal.as_dvec3()) / distance;
                    let soft = (c + s).clamp(0.0, 2.0 * s);
                    let blocked = s * (0.25 * soft * soft + s * (c - s).max(0.0));
                    expected[0] += f64::from(weight) * blocked;
                    continue;
                }
                let lanes = |v: Vec3| [0, 1, 2].map(|axis| [v[axis]; LANES]);
                let (x, n) = (lanes(positions[point]), lanes(normal));
                let view = View::new(&x, &n, centre.to_array(), radius as f32);
                let Some(view) = view else { continue };
                let mut sums = vec![[0.0; LANES]; width];
                add(&view, kind, &[weight; LANES], &mut sums);
                expected.iter_mut().zip(&sums).for_each(|(x, sum)| *x += f64::from(sum[0]));
            }
            for (found, expected) in row.iter().zip(&expected) {
                assert!(
                    (f64::from(-found) - expected).abs() < 2e-5,
                    "{signal}: {found} {expected}"
                );
            }
        }
    }
}

/// Proves that ambient occlusion stays in [0, 1] and does not change when the posed character
/// turns as a whole: the spheres turn with it.
#[test]
fn occlusion_is_bounded_and_turns_with_the_character() {
    let model = synthetic::occluded(Family::Linear, Signal::Ao);
    let (positions, normals) = synthetic::surface();
    let before = posed(
        &model,
        Surface { positions: &positions, normals: &normals, tangents: &[] },
        &rotations(),
    );
    assert!(before.iter().all(|x| (0.0..=1.0).contains(x)));
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.0, -2.0);
    let turned = |vectors: &[Vec3]| -> Vec<Vec3> { vectors.iter().map(|&v| turn * v).collect() };
    let (positions, normals) = (turned(&positions), turned(&normals));
    let turns: Vec<Quat> = rotations().iter().map(|&bone| turn * bone).collect();
    let after =
        posed(&model, Surface { positions: &positions, normals: &normals, tangents: &[] }, &turns);
    for (a, b) in before.iter().zip(&after) {
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
}

/// Proves that blobs with occluders come back as they were, tell their size, and that no prefix of
/// one is one.
#[test]
fn blobs_round_trip() {
    for family in [Family::Mean, Family::PcaLinear] {
        let model = synthetic::occluded(family, Signal::Transfer);
        for &precision in Precision::ALL {
            let bytes = model.to_bytes(precision).unwrap();
            let read = Model::from_bytes(&bytes).unwrap();
            assert_eq!(read.to_bytes(precision).unwrap(), bytes);
            assert!(read.header().unshadowed);
            let header = 8 + u64::from_le_bytes(*bytes.first_chunk().unwrap());
            assert_eq!(model.sizes(precision).total(), bytes.len() as u64 - header);
            if precision == Precision::F32 {
                assert_eq!(read.occluders(), model.occluders());
                assert_eq!(read.header(), model.header());
            }
            for length in (0..bytes.len()).step_by(97) {
                assert!(Model::from_bytes(&bytes[..length]).is_err());
            }
        }
    }
}

/// Proves that weights which were rounded to 8 bits come back from every precision as they were
/// (from f16 to its eleven bits), and that rounding moves none by more than half a step.
#[test]
fn rounded_weights_survive_every_precision() {
    let plain = synthetic::model(Family::Mean, Signal::Ao, Frame::Bone, 1);
    let before = synthetic::occluders();
    let rounded = before.clone().in_eight_bits(synthetic::POINTS);
    for (a, b) in before.weights.iter().zip(&rounded.weights) {
        assert!((a - b).abs() <= 0.5001 / 127.0, "{a} {b}");
    }
    let model = plain.with_occluders(rounded.clone()).unwrap();
    for (precision, bound) in [(Precision::F32, 0.0), (Precision::F16, 5e-4), (Precision::I8, 0.0)]
    {
        let read = Model::from_bytes(&model.to_bytes(precision).unwrap()).unwrap();
        for (a, b) in read.occluders().unwrap().weights.iter().zip(&rounded.weights) {
            assert!((a - b).abs() <= bound, "{precision} {a} {b}");
        }
    }
}

/// Proves that occluders which do not fit their model are refused with what is wrong, and that a
/// model which looks at the mesh says so.
#[test]
fn bad_occluders_and_missing_meshes_are_errors() {
    let plain = synthetic::model(Family::Mean, Signal::Ao, Frame::Bone, 1);
    let fault = |change: &dyn Fn(&mut Occluders)| {
        let mut occluders = synthetic::occluders();
        change(&mut occluders);
        plain.clone().with_occluders(occluders).expect_err("must be refused").to_string()
    };
    assert!(fault(&|o| o.anchors[3] = 37).contains("anchor"));
    assert!(fault(&|o| o.group_of[2] = 3).contains("group"));
    assert!(fault(&|o| o.radii[1] = 0.0).contains("radius"));
    assert!(fault(&|o| o.radii[1] = f32::NAN).contains("not finite"));
    assert!(fault(&|o| o.offsets.truncate(14)).contains("offsets"));
    let root = synthetic::model(Family::Mean, Signal::Ao, Frame::Root, 1);
    assert!(root.with_occluders(synthetic::occluders()).is_err());

    let model = synthetic::occluded(Family::Mean, Signal::Ao);
    let turns = rotations();
    let input = PosedInput { parameters: &[0.0; 6], bone_rotations: &turns, surface: None };
    let mut out = vec![0.0; model.shape().points];
    let error = model.evaluate_posed(&input, &mut out).unwrap_err();
    assert!(matches!(error, Error::NeedsSurface { .. }), "{error}");
    assert!(matches!(model.fold(&[1.0], &turns), Err(Error::NeedsSurface { .. })));
    let far = vec![Vec3::NAN; model.shape().points];
    let surface = Some(Surface { positions: &far, normals: &far, tangents: &[] });
    let error = model.evaluate_posed(&PosedInput { surface, ..input }, &mut out).unwrap_err();
    assert!(matches!(error, Error::NotFinite { .. }), "{error}");
}

/// Proves that a point at a sphere's very centre, and one a million radii away, give finite numbers.
#[test]
fn extremes_stay_finite() {
    let order = Order::new(10).unwrap();
    for (radius, distance) in [(1.0_f32, 0.0_f32), (1e-3, 1e3), (1e3, 1e-3)] {
        let view = view(Vec3::X * distance, Vec3::X, radius);
        for signal in [Signal::Ao, Signal::Transfer, Signal::Visibility] {
            let mut sums = [[0.0; LANES]; 100];
            add(&view, (signal, order), &[1.0; LANES], &mut sums);
            assert!(sums.iter().flatten().all(|x| x.is_finite()), "{signal} {radius} {distance}");
        }
    }
}
