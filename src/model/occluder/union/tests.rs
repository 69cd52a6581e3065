//! Models with ellipsoids against the documented formulas in f64, and hostile blobs.

use glam::{DMat3, DVec3, Quat};

use super::super::ANCHORS;
use super::*;
use crate::model::{Family, Frame, Model, PosedInput, Precision, Signal, Surface, synthetic};
use crate::sh::evaluate_f64;

fn united(family: Family, signal: Signal) -> Model {
    let plain = synthetic::model(family, signal, Frame::Bone, 1);
    plain.with_occluders(synthetic::united()).unwrap()
}

fn turns() -> Vec<Quat> {
    [0.3, -0.9, 2.0].map(|angle| Quat::from_rotation_y(angle) * Quat::from_rotation_x(0.4)).to_vec()
}

/// What is taken of every direction at a point, by weight, in the frame of its bone: directions and
/// numbers, as the format's document has it.
fn taken(occluders: &Occluders, point: usize, bones: &[u16]) -> Vec<(DVec3, f64)> {
    let (positions, normals) = synthetic::surface();
    let turns: Vec<DMat3> = turns().iter().map(|q| DMat3::from_quat(q.as_dquat())).collect();
    let n = occluders.directions;
    let bone = usize::from(bones[point]);
    let into = turns[bone].transpose();
    let normal = into * normals[point].as_dvec3();
    let soft = 6.4 / n as f64;
    let mut out = Vec::new();
    for i in 0..n {
        let z = 1.0 - (2 * i + 1) as f64 / n as f64;
        let azimuth = std::f64::consts::PI * (1.0 + 5.0_f64.sqrt()) * (i as f64 + 0.5);
        let r = (1.0 - z * z).sqrt();
        let direction = DVec3::new(r * azimuth.cos(), r * azimuth.sin(), z);
        let (mut through, mut sum) = (1.0, 0.0);
        for q in 0..occluders.spheres() {
            let anchors = &occluders.anchors[q * ANCHORS..(q + 1) * ANCHORS];
            let of = usize::from(bones[anchors[0] as usize]);
            let mean: DVec3 =
                anchors.iter().map(|&a| positions[a as usize].as_dvec3()).sum::<DVec3>() / 8.0;
            let offset =
                DVec3::from_array([0, 1, 2].map(|k| f64::from(occluders.offsets[q * 3 + k])));
            let away = into * (mean + turns[of] * offset - positions[point].as_dvec3());
            if away.dot(normal) <= -f64::from(occluders.radii[q]) {
                continue;
            }
            let [xx, yy, zz, yz, xz, xy] =
                std::array::from_fn(|k| f64::from(occluders.shapes[q * 6 + k]));
            let rest = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
            let turn = into * turns[of];
            let shape = turn * rest * turn.transpose();
            let p = shape * away;
            let (u, sine) = ((shape * direction).normalize(), (1.0 / p.length()).min(1.0));
            let cosine = (1.0 - sine * sine).sqrt();
            let (e, h) = (cosine.min(1.0 - soft / 2.0), (2.0 * (1.0 - cosine) / soft).min(1.0));
            let slope = (p.normalize().dot(u) - e) / soft + 0.5;
            let covered = through * h * slope.clamp(0.0, 1.0);
            through -= covered;
            let group = usize::from(occluders.group_of[bone * occluders.spheres() + q]);
            sum += covered * f64::from(occluders.weights[point * 3 + group]);
        }
        out.push((direction, sum));
    }
    out
}

/// Proves that a model with ellipsoids is its decoder's part less, in the frame of each bone, what
/// they take of the directions one after another: for every signal.
#[test]
fn evaluation_is_the_definition() {
    let (positions, normals) = synthetic::surface();
    let surface = Surface { positions: &positions, normals: &normals, tangents: &[] };
    let occluders = synthetic::united();
    for signal in Signal::ALL.iter().copied() {
        let model = united(Family::Mean, signal);
        let (order, width) = (model.header().sh_order(), model.shape().width);
        let bones = model.bone_of_point();
        let parameters = synthetic::numbers(21, synthetic::PARAMETERS);
        let mut expected = vec![0.0; model.shape().points * width];
        model.evaluate(&parameters, None, &mut expected).unwrap();
        for (point, row) in expected.chunks_exact_mut(width).enumerate() {
            let normal = turns()[usize::from(bones[point])].inverse() * normals[point];
            let mut y = [0.0; 100];
            for (direction, sum) in taken(&occluders, point, bones) {
                let cosine = direction.dot(normal.as_dvec3()).max(0.0);
                let share = 4.0 / occluders.directions as f64
                    * match signal {
                        Signal::Visibility => std::f64::consts::PI * (cosine / 0.1).min(1.0),
                        Signal::Ao | Signal::Transfer => cosine,
                    };
                y[0] = 1.0;
                if signal != Signal::Ao {
                    evaluate_f64(order, direction.to_array(), &mut y[..order.coefficients()]);
                }
                row.iter_mut().zip(&y).for_each(|(x, y)| *x -= (share * sum * y) as f32);
            }
        }
        model.to_root_frame(&turns(), None, &mut expected).unwrap();
        model.bound(&mut expected);
        let turns = turns();
        let mut found = vec![f32::NAN; expected.len()];
        let input =
            PosedInput { parameters: &parameters, bone_rotations: &turns, surface: Some(surface) };
        model.evaluate_posed(&input, &mut found).unwrap();
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-4, "{signal}: {found} {expected}");
        }
    }
}

/// Proves that ellipsoids come back from their blob, which is as large as it says, and that an older
/// blob has none.
#[test]
fn blobs_round_trip() {
    for precision in [Precision::F32, Precision::F16, Precision::I8] {
        let model = united(Family::PcaLinear, Signal::Transfer);
        let bytes = model.to_bytes(precision).unwrap();
        let read = Model::from_bytes(&bytes).unwrap();
        assert_eq!(read.to_bytes(precision).unwrap(), bytes);
        assert_eq!(read.occluders().unwrap().shapes, synthetic::united().shapes);
        let header = 8 + u64::from_le_bytes(*bytes.first_chunk().unwrap());
        assert_eq!(model.sizes(precision).total(), bytes.len() as u64 - header);
        for length in (0..bytes.len()).step_by(97) {
            assert!(Model::from_bytes(&bytes[..length]).is_err());
        }
    }
    let spheres = synthetic::occluded(Family::Mean, Signal::Ao);
    let bytes = spheres.to_bytes(Precision::F32).unwrap();
    assert!(!String::from_utf8_lossy(&bytes).contains("directions\":"), "as it was before");
}

/// Proves that shapes which are none, and directions that cannot be bundled, are refused by name.
#[test]
fn bad_ellipsoids_are_errors() {
    let plain = synthetic::model(Family::Mean, Signal::Ao, Frame::Bone, 1);
    let fault = |change: &dyn Fn(&mut Occluders)| {
        let mut occluders = synthetic::united();
        change(&mut occluders);
        plain.clone().with_occluders(occluders).expect_err("must be refused").to_string()
    };
    assert!(fault(&|o| o.shapes[1] = -1.0).contains("not positive definite"));
    assert!(fault(&|o| o.shapes[5] = 1e9).contains("not positive definite"));
    assert!(fault(&|o| o.shapes[2] = f32::NAN).contains("not finite"));
    assert!(fault(&|o| o.shapes.truncate(29)).contains("shapes"));
    assert!(fault(&|o| o.shapes.clear()).contains("shapes"));
    assert!(fault(&|o| o.directions = 0).contains("shapes"));
    assert!(fault(&|o| o.directions = 72).contains("multiple"));
    assert!(fault(&|o| o.directions = 1 << 20).contains("directions"));
}
