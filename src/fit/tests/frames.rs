//! The bone frame, and the stream of blocks.

use super::*;
use crate::fit::Error;
use crate::fit::source::Source;
use crate::sh::{Order, Rotation};

/// Turns a set's outputs by each (pose, point)'s bone: what a signal that is constant in the bone
/// frame looks like in the root frame.
fn carried(parts: &TrainingParts) -> TrainingParts {
    let n = parts.coefficients;
    let order = Order::new(n.isqrt() as u8).unwrap();
    let per_pose = parts.values.len() / parts.clips.len();
    let mut turned = parts.clone();
    for (i, out) in turned.values.chunks_exact_mut(n).enumerate() {
        let (pose, point) = (i * n / per_pose, i * n % per_pose / (n * parts.channels));
        let bone = usize::from(parts.point_bones[point]);
        let q = parts.bone_rotations[pose * parts.bones + bone];
        Rotation::new(order, q).apply(&parts.values[i * n..(i + 1) * n], out);
    }
    turned
}

fn with_bones(coefficients: usize, channels: usize, bones: usize) -> TrainingParts {
    let sizes =
        Sizes { poses: 9, parameters: 3, points: 50, coefficients: coefficients * channels };
    let mut parts = synthetic(sizes, 0.2, 1);
    (parts.coefficients, parts.channels, parts.bones) = (coefficients, channels, bones);
    let mut stream = Stream::new(2);
    let mut number = || stream.normal() as f32;
    parts.bone_rotations = (0..9 * bones)
        .map(|_| Quat::from_xyzw(number(), number(), number(), number()).normalize())
        .collect();
    parts.point_bones = (0..50).map(|i| (i * 7 % bones) as u16).collect();
    parts
}

/// Proves that a fit in the bone frame is the fit of what the bones carry, for every order and for
/// three channels: data turned by the bones and fitted in the bone frame equal the data that were
/// not turned, fitted in the root frame.
#[test]
fn bone_frame_undoes_the_bones() {
    for (order, channels) in [(1, 1), (2, 1), (3, 3), (6, 1), (10, 1)] {
        let parts = with_bones(order * order, channels, 4);
        let reference = run(&parts, &trained(Family::Linear));
        let settings = Settings { frame: Frame::Bone, ..trained(Family::Linear) };
        let fitted = run(&carried(&parts), &settings);
        let width = channels * order * order;
        let of = |pose: usize| predict(&reference, &parts.parameters[pose * 3..][..3], width);
        assert!(worst(&parts, &fitted, of) < 1e-4);
    }
}

/// Proves that coefficients which are no harmonics are refused in the bone frame only.
#[test]
fn only_harmonics_can_be_turned() {
    let mut parts = with_bones(4, 1, 2);
    (parts.coefficients, parts.channels) = (2, 2);
    run(&parts, &settings(Family::Mean));
    let bone = Settings { frame: Frame::Bone, ..settings(Family::Mean) };
    let error = fit(&Training::in_memory(parts), &bone).unwrap_err();
    assert!(matches!(error, Error::Harmonics { found: 2 }), "{error}");
}

/// Proves that how many blocks are in memory at once changes neither their values nor their order,
/// and that they cover every point once.
#[test]
fn stream_does_not_depend_on_what_is_in_flight() {
    let sizes = Sizes { poses: 40, parameters: 2, points: 900, coefficients: 4 };
    let training = Training::in_memory(synthetic(sizes, 0.2, 3));
    let read = |in_flight: usize| {
        let source = Source::new(&training, Frame::Bone, None).unwrap().with_in_flight(in_flight);
        let (mut values, mut points) = (Vec::new(), 0);
        source
            .map_fold(
                |block| Ok(block.values.clone()),
                |block, part| {
                    assert_eq!(block.points.start, points);
                    points = block.points.end;
                    values.push(part);
                },
            )
            .unwrap();
        assert_eq!(points, 900);
        values
    };
    let reference = read(1);
    assert!(reference.len() > 2);
    for in_flight in [2, 3, 100] {
        assert!(reference == read(in_flight));
    }
}
