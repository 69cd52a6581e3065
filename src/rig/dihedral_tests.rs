use glam::{Quat, Vec3};
use std::f64::consts::PI;

use super::*;
use crate::rig::Pose;

/// Two unit triangles over the edge from the origin along z, the second turned about it.
fn folded(by: f32) -> Vec<Vec3> {
    vec![Vec3::ZERO, Vec3::Z, Vec3::X, Quat::from_rotation_z(by) * -Vec3::X]
}

/// The angle is that of the fold over all of the circle, whichever way the whole is turned, moved
/// and scaled; a triangle without area has none.
#[test]
fn a_fold_has_its_angle() {
    for by in [-3.1, -1.0, -1e-4, 0.0, 0.5, 2.0, 3.1_f32] {
        let flat = folded(by);
        let expected = angle(&flat, [0, 1, 2, 3]);
        assert!((expected.abs() - f64::from(by.abs())).abs() < 1e-6, "{by}: {expected}");
        let turned = |&p: &Vec3| 3.0 * (Quat::from_rotation_x(1.0) * p) + Vec3::new(4.0, -2.0, 1.0);
        let moved: Vec<Vec3> = flat.iter().map(turned).collect();
        assert!(turn(expected, angle(&moved, [0, 1, 2, 3])).abs() < 2e-6);
        // Seen from the other triangle it is the same fold.
        assert!(turn(expected, angle(&flat, [1, 0, 3, 2])).abs() < 1e-12);
    }
    let [up, down] = [0.5, -0.5].map(|by| angle(&folded(by), [0, 1, 2, 3]));
    assert!((up + down).abs() < 1e-7 && up != 0.0);
    assert_eq!(angle(&[Vec3::ZERO; 4], [0, 1, 2, 3]), 0.0);
    assert_eq!(angle(&[Vec3::ZERO, Vec3::Z, Vec3::Z, Vec3::X], [0, 1, 2, 3]), 0.0);
}

/// Past half a turn angles go on from the other end: the way between two is the short one.
#[test]
fn turns_are_short() {
    assert!((turn(PI - 0.1, -PI + 0.1) - 0.2).abs() < 1e-12);
    assert!((mean([PI - 0.1, -PI + 0.3].into_iter()) - (-PI + 0.1)).abs() < 1e-12);
}

/// A strip of `count` squares along x, each of two triangles, the seam between them doubled.
fn strip(count: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..count {
        let (x, at) = (i as f32, positions.len() as u32);
        positions.extend(
            [(x, 0.0), (x, 1.0), (x + 1.0, 0.0), (x + 1.0, 1.0)].map(|(x, z)| Vec3::new(x, 0.0, z)),
        );
        triangles.extend([[at, at + 1, at + 2], [at + 2, at + 1, at + 3]]);
    }
    (positions, triangles)
}

/// Only edges between two triangles are hinges, seams of doubled vertices too; a fin on an edge makes
/// it none.
#[test]
fn hinges_are_between_two_triangles() {
    let (mut positions, mut triangles) = strip(3);
    let points = |count: usize| Points {
        vertex: (0..count as u32).collect(),
        of_vertex: (0..count as u32).collect(),
    };
    // Three diagonals and two seams.
    let found = hinges(&positions, &triangles, &points(positions.len()));
    assert_eq!(found.len(), 5);
    let flat: Vec<f64> = found.iter().map(|&hinge| angle(&positions, hinge)).collect();
    assert!(flat.iter().all(|angle| angle.abs() < 1e-12), "{flat:?}");
    positions.push(Vec3::Y);
    triangles.push([0, 1, 12]);
    triangles.push([1, 2, 12]);
    let found = hinges(&positions, &triangles, &points(positions.len()));
    assert!(!found.iter().any(|&[a, b, ..]| [a, b] == [1, 2]), "{found:?}");
}

/// Of folds that go together one is a parameter, of independent ones each; what stands still is
/// none. The parameters are the turns from the mean.
#[test]
fn only_what_says_something_new_is_a_parameter() {
    let hinges: Vec<Hinge> = (0..5).map(|i| [i, i + 1, i + 2, i + 3]).collect();
    // Around half a turn, where angles wrap.
    let pose = |i: usize| {
        let (a, b) = ((i as f64 * 1.7).sin(), (i as f64 * 2.9).cos());
        let wrapped = turn(0.0, PI + 0.3 * a);
        vec![0.2 * a, wrapped, 0.1 * a - 0.4 * b, 0.7, 0.5 * b]
    };
    let training: Vec<Vec<f64>> = (0..9).map(pose).collect();
    let found = Parametrisation::of_hinges(&hinges, &training, 1.0);
    assert_eq!(found.columns.len(), 2, "{:?}", found.columns);
    assert!(found.needs_positions() && !found.needs_globals());
    let still = Parametrisation::of_hinges(&hinges, &vec![vec![0.3; 5]; 4], 1.0);
    assert!(still.columns.is_empty());
    assert!(Parametrisation::of_hinges(&[], &[], 1.0).columns.is_empty());

    let source = Source::Dihedral { corners: [0, 1, 2, 3], mean: 3.0 };
    let columns = vec![Column { source, name: "fold".to_owned() }];
    let one = Parametrisation { columns, size_m: 1.0, dropped: Vec::new() };
    let nothing = Pose { local: Vec::new(), weights: Vec::new() };
    let at = |by: f32| one.encode_posed(&nothing, &[], &folded(by))[0];
    let sign = angle(&folded(1.0), [0, 1, 2, 3]).signum() as f32;
    assert!((at(sign * 3.1) - 0.1).abs() < 1e-5 && (at(-sign * 3.1) - 0.183_185).abs() < 1e-5);
}
