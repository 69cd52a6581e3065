//! A clip at one instant, as glTF 2.0 (appendix C) defines interpolation, computed in f64.

use glam::{DQuat, Quat, Vec3};

use crate::rig::Pose;
use crate::scene::{Channel, Clip, Interpolation, Target};

/// The pose of a clip at `time_s`: `rest` where no channel says otherwise.
///
/// Before its first and after its last key a channel stands still. Rotations come out normalised.
///
/// # Panics
/// If a channel names a node or a weight slot that `rest` does not have, or has no key.
#[must_use]
pub fn evaluate(clip: &Clip, time_s: f32, rest: &Pose) -> Pose {
    let mut pose = rest.clone();
    for channel in &clip.channels {
        apply(channel, time_s, &mut pose);
    }
    pose
}

fn apply(channel: &Channel, time_s: f32, pose: &mut Pose) {
    let at = locate(&channel.times_s, time_s);
    match &channel.target {
        Target::Translation(node) => pose.local[*node].translation = vector(channel, at),
        Target::Scale(node) => pose.local[*node].scale = vector(channel, at),
        Target::Rotation(node) => pose.local[*node].rotation = rotation(channel, at),
        Target::Weights(slots) => {
            for (i, weight) in pose.weights[slots.clone()].iter_mut().enumerate() {
                *weight = component(channel, at, i) as f32;
            }
        }
    }
}

/// A time between the keys `key` and `key + 1`, or exactly on `key`.
#[derive(Debug, Clone, Copy)]
struct Place {
    key: usize,
    /// From 0 at `key` to 1 at the next one; 0 where there is no next one to look at.
    fraction: f64,
    /// Seconds between the two keys.
    interval_s: f64,
}

fn locate(times_s: &[f32], time_s: f32) -> Place {
    // How many keys are not later; those before the first key stand on it.
    let passed = times_s.partition_point(|&key_s| key_s <= time_s);
    let key = passed.saturating_sub(1);
    let inside = passed > 0 && passed < times_s.len();
    if !inside {
        return Place { key, fraction: 0.0, interval_s: 0.0 };
    }
    let start = f64::from(times_s[key]);
    let interval_s = f64::from(times_s[passed]) - start;
    Place { key, fraction: (f64::from(time_s) - start) / interval_s, interval_s }
}

fn vector(channel: &Channel, at: Place) -> Vec3 {
    Vec3::from_array([0, 1, 2].map(|i| component(channel, at, i) as f32))
}

/// One component, interpolated by itself.
fn component(channel: &Channel, at: Place, i: usize) -> f64 {
    if at.fraction == 0.0 {
        return value(channel, at.key, i);
    }
    let t = at.fraction;
    match channel.interpolation {
        Interpolation::Step => value(channel, at.key, i),
        Interpolation::Linear => {
            (1.0 - t) * value(channel, at.key, i) + t * value(channel, at.key + 1, i)
        }
        Interpolation::CubicSpline => {
            let (t2, t3) = (t * t, t * t * t);
            let leaving = at.interval_s * number(channel, at.key, 2, i);
            let entering = at.interval_s * number(channel, at.key + 1, 0, i);
            (2.0 * t3 - 3.0 * t2 + 1.0) * value(channel, at.key, i)
                + (t3 - 2.0 * t2 + t) * leaving
                + (3.0 * t2 - 2.0 * t3) * value(channel, at.key + 1, i)
                + (t3 - t2) * entering
        }
    }
}

fn rotation(channel: &Channel, at: Place) -> Quat {
    let key = |key: usize| DQuat::from_array([0, 1, 2, 3].map(|i| value(channel, key, i)));
    let found = if channel.interpolation == Interpolation::Linear && at.fraction > 0.0 {
        slerp(key(at.key), key(at.key + 1), at.fraction)
    } else {
        DQuat::from_array([0, 1, 2, 3].map(|i| component(channel, at, i)))
    };
    // A spline between opposite keys can pass through zero, which has no direction.
    [found, key(at.key)]
        .into_iter()
        .map(|q| q.normalize().as_quat())
        .find(|q| q.is_finite())
        .unwrap_or(Quat::IDENTITY)
}

/// The rotation that turns evenly along the shorter arc. glam's own works with an approximate arc
/// cosine, wrong in the fifth digit; atan2 of chord lengths is exact for every angle.
fn slerp(from: DQuat, to: DQuat, t: f64) -> DQuat {
    let (from, to) = (from.normalize(), to.normalize());
    let to = if from.dot(to) < 0.0 { -to } else { to };
    let angle = 2.0 * (to - from).length().atan2((to + from).length());
    let sine = angle.sin();
    if sine < 1e-9 {
        return from * (1.0 - t) + to * t;
    }
    from * (((1.0 - t) * angle).sin() / sine) + to * ((t * angle).sin() / sine)
}

/// The value at a key.
fn value(channel: &Channel, key: usize, i: usize) -> f64 {
    let row = if channel.interpolation == Interpolation::CubicSpline { 1 } else { 0 };
    number(channel, key, row, i)
}

/// Row 0, 1, 2 of a cubic key is its in-tangent, value and out-tangent; others have row 0 only.
fn number(channel: &Channel, key: usize, row: usize, i: usize) -> f64 {
    let rows = if channel.interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    f64::from(channel.values[(key * rows + row) * channel.components() + i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Transform;

    fn rest() -> Pose {
        Pose { local: vec![Transform::IDENTITY; 2], weights: vec![0.0, 0.5] }
    }

    fn at(target: Target, kind: Interpolation, times: &[f32], values: &[f32], time: f32) -> Pose {
        let channel = Channel {
            target,
            interpolation: kind,
            times_s: times.to_vec(),
            values: values.to_vec(),
        };
        let clip = Clip { name: "c".into(), duration_s: 1.0, channels: vec![channel] };
        evaluate(&clip, time, &rest())
    }

    /// Proves stepping, the straight line, clamping outside of the keys, and single keys.
    #[test]
    fn step_and_linear() {
        let values = [0.0, 0.0, 0.0, 2.0, 4.0, 6.0];
        let translation = |kind, time| {
            at(Target::Translation(1), kind, &[1.0, 2.0], &values, time).local[1].translation
        };
        let (first, last) = (Vec3::ZERO, Vec3::new(2.0, 4.0, 6.0));
        for kind in [Interpolation::Step, Interpolation::Linear] {
            for (time, expected) in [(0.0, first), (1.0, first), (2.0, last), (9.0, last)] {
                assert_eq!(translation(kind, time), expected);
            }
        }
        assert_eq!(translation(Interpolation::Step, 1.999), first);
        assert_eq!(translation(Interpolation::Linear, 1.25), last * 0.25);
        let single = at(Target::Scale(0), Interpolation::Linear, &[0.5], &[3.0; 3], 7.0);
        assert_eq!(single.local[0].scale, Vec3::splat(3.0));
        assert_eq!(single.local[1], Transform::IDENTITY);
    }

    /// Proves that a cubic spline reproduces a cubic polynomial exactly from its values and slopes,
    /// over an interval that is not 1 s long, for weights too.
    #[test]
    fn cubic_spline_reproduces_a_cubic() {
        let f = |t: f32| 2.0 * t * t * t - 3.0 * t + 0.5;
        let slope = |t: f32| 6.0 * t * t - 3.0;
        let (a, b) = (0.5, 2.5);
        // Two slots, the second constant: [in | value | out] per key.
        let key = |t: f32| [slope(t), 0.0, f(t), 7.0, slope(t), 0.0];
        let values = [key(a), key(b)].concat();
        for time in [0.5, 0.7, 1.3, 2.0, 2.499] {
            let kind = Interpolation::CubicSpline;
            let pose = at(Target::Weights(0..2), kind, &[a, b], &values, time);
            assert!((pose.weights[0] - f(time)).abs() < 1e-5, "at {time}: {}", pose.weights[0]);
            assert_eq!(pose.weights[1], 7.0);
        }
    }

    /// Proves that a linear rotation turns evenly along the shorter arc, whatever the signs of the
    /// keys, from angles that vanish to half a turn.
    #[test]
    fn linear_rotation_turns_evenly() {
        for angle in [0.0_f32, 1e-6, 0.02, 1.0, 3.0, 3.1414] {
            for sign in [1.0, -1.0] {
                let start = Quat::from_rotation_y(0.4);
                let end = start * Quat::from_rotation_x(angle) * sign;
                let values = [start.to_array(), end.to_array()].concat();
                for t in [0.0, 0.25, 0.5, 0.9] {
                    let kind = Interpolation::Linear;
                    let pose = at(Target::Rotation(0), kind, &[0.0, 1.0], &values, t);
                    let found = pose.local[0].rotation;
                    let expected = start * Quat::from_rotation_x(angle * t);
                    let error = crate::rig::rotation_vector(expected, found).length();
                    assert!(error < 2e-6, "{angle} at {t}: {error}");
                    assert!((found.length() - 1.0).abs() < 1e-6);
                }
            }
        }
    }

    /// Proves that a cubic rotation is normalised and that one through zero stays finite.
    #[test]
    fn cubic_rotation_is_normalised() {
        let zero = [0.0; 4];
        let key = |q: Quat| [zero, q.to_array(), zero].concat();
        let turn = |to: Quat, t| {
            let values = [key(Quat::IDENTITY), key(to)].concat();
            let kind = Interpolation::CubicSpline;
            at(Target::Rotation(0), kind, &[0.0, 1.0], &values, t).local[0].rotation
        };
        let half = turn(Quat::from_rotation_z(1.0), 0.5);
        assert!(half.angle_between(Quat::from_rotation_z(0.5)) < 1e-3);
        assert!((half.length() - 1.0).abs() < 1e-6);
        assert!(turn(-Quat::IDENTITY, 0.5).is_finite());
    }
}
