//! The four clips: stances over time, keyed at 30 Hz.

use std::f64::consts::TAU;

use glam::dvec3;

use super::body::Joint;
use super::stance::{Arm, Foot, Key, Stance, solve};

/// Keys per second.
pub(super) const RATE_HZ: f64 = 30.0;

/// A name, and a key for every frame.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    pub(super) name: &'static str,
    pub(super) keys: Vec<Key>,
}

/// All clips.
pub(super) fn motions(joints: &[Joint]) -> Vec<Motion> {
    type Clip = (&'static str, usize, fn(f64) -> Stance);
    let clips: [Clip; 4] = [
        ("walk", WALK_FRAMES, walk),
        ("wave", 60, wave),
        ("crouch", 54, crouch),
        ("jump", 51, jump),
    ];
    clips
        .iter()
        .map(|&(name, frames, stance)| {
            let key = |frame: usize| solve(&stance(frame as f64 / RATE_HZ), joints);
            Motion { name, keys: (0..=frames).map(key).collect() }
        })
        .collect()
}

fn degrees(angle: f64) -> f64 {
    angle.to_radians()
}

/// At ease: arms beside the body, feet a little apart.
fn standing() -> Stance {
    let arm =
        Arm { out: degrees(13.0), flex: degrees(14.0), turn: degrees(15.0), ..Arm::default() };
    let foot = Foot { yaw: degrees(7.0), ..Foot::default() };
    Stance { hips: dvec3(0.0, -0.003, 0.0), arms: [arm; 2], feet: [foot; 2], ..Stance::default() }
}

const WALK_FRAMES: usize = 33;
/// Two steps, metres.
const STRIDE_M: f64 = 1.30;
/// The sole's way relative to the hips over a cycle that begins where the heel strikes; on the
/// ground (the first six tenths) it goes back as fast as the hips go forward.
const WALK_FORWARD: [f64; 10] = [0.32, 0.19, 0.06, -0.07, -0.20, -0.33, -0.46, -0.36, -0.08, 0.21];
const WALK_LIFT: [f64; 10] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.004, 0.06, 0.055, 0.03];
const WALK_PITCH: [f64; 10] = [-17.0, -2.0, 0.0, 0.0, 1.0, 10.0, 30.0, 38.0, 14.0, -13.0];

fn walk(time_s: f64) -> Stance {
    let cycle = time_s * RATE_HZ / WALK_FRAMES as f64;
    let wave = |turns: f64, phase: f64| (TAU * turns * (cycle - phase)).cos();
    let mut stance = standing();
    for side in 0..2 {
        let phase = cycle + 0.5 * side as f64;
        stance.feet[side] = Foot {
            out: -0.03,
            forward: STRIDE_M * cycle + cyclic(&WALK_FORWARD, phase),
            lift: cyclic(&WALK_LIFT, phase).max(0.0),
            pitch: degrees(cyclic(&WALK_PITCH, phase)),
            yaw: degrees(5.0),
        };
        // Each arm swings with the leg of the other side, a little late.
        let swing = -(TAU * (phase - 0.04)).cos();
        stance.arms[side].forward = degrees(4.0 + 24.0 * swing);
        stance.arms[side].flex = degrees(24.0 + 14.0 * swing);
        stance.arms[side].out = degrees(12.0);
    }
    stance.hips = dvec3(0.018 * wave(1.0, 0.3), -0.026 - 0.012 * wave(2.0, 0.06), STRIDE_M * cycle);
    stance.hips_turn =
        dvec3(degrees(2.0), degrees(-6.0) * wave(1.0, 0.0), degrees(3.0) * wave(1.0, 0.3));
    stance.spine_turn =
        dvec3(degrees(3.0), degrees(13.0) * wave(1.0, 0.02), degrees(-4.0) * wave(1.0, 0.3));
    stance.head_turn =
        dvec3(degrees(-3.0), degrees(-7.0) * wave(1.0, 0.02), degrees(1.0) * wave(1.0, 0.3));
    stance
}

fn wave(time_s: f64) -> Stance {
    let raised = curve(&[(0.0, 0.0), (0.5, 1.0), (1.5, 1.0), (2.0, 0.0)], time_s);
    let sway = raised * (TAU * 2.0 * (time_s - 0.5)).sin();
    let mut stance = standing();
    let rest = stance.arms[1];
    let up = Arm {
        out: degrees(82.0 + 6.0 * sway),
        forward: degrees(8.0),
        flex: degrees(78.0 + 27.0 * sway),
        turn: degrees(-74.0),
        shrug: degrees(16.0),
        wrist: degrees(14.0 * sway),
    };
    stance.arms[1] = mix(&rest, &up, raised);
    stance.arms[0].flex += degrees(6.0) * raised;
    stance.arms[0].forward = degrees(-4.0) * raised;
    stance.hips += dvec3(0.022, -0.002, 0.0) * raised;
    stance.hips_turn = dvec3(0.0, 0.0, degrees(1.5)) * raised;
    stance.spine_turn = dvec3(degrees(-3.0), degrees(-6.0), degrees(3.0 + sway)) * raised;
    stance.head_turn = dvec3(degrees(3.0), degrees(-8.0), degrees(-8.0 + 2.0 * sway)) * raised;
    stance
}

fn crouch(time_s: f64) -> Stance {
    let low = curve(&[(0.0, 0.0), (0.75, 1.0), (1.0, 1.0), (1.8, 0.0)], time_s);
    // The arms come in a little after the hips go down.
    let folded = curve(&[(0.1, 0.0), (0.85, 1.0), (1.05, 1.0), (1.75, 0.0)], time_s);
    let mut stance = standing();
    for side in 0..2 {
        stance.feet[side].out = 0.03 * low;
        stance.feet[side].yaw += degrees(12.0) * low;
        let rest = stance.arms[side];
        let hug = Arm {
            out: degrees(10.0),
            forward: degrees(72.0),
            flex: degrees(58.0),
            turn: degrees(38.0),
            ..Arm::default()
        };
        stance.arms[side] = mix(&rest, &hug, folded);
    }
    stance.hips += dvec3(0.0, -0.43, -0.13) * low;
    stance.hips_turn = dvec3(degrees(24.0), 0.0, 0.0) * low;
    stance.spine_turn = dvec3(degrees(34.0), 0.0, 0.0) * low;
    stance.head_turn = dvec3(degrees(-24.0), 0.0, 0.0) * low;
    stance
}

/// Standing, lowest, off the ground, at the top, touching down, softest, standing.
const JUMP_S: [f64; 7] = [0.0, 0.42, 0.62, 0.84, 1.06, 1.26, 1.7];

fn jump(time_s: f64) -> Stance {
    let at = |values: [f64; 7]| {
        curve(&std::array::from_fn::<_, 7, _>(|i| (JUMP_S[i], values[i])), time_s)
    };
    let turn = |values: [f64; 7]| degrees(at(values));
    let mut stance = standing();
    let hips_up = at([0.0, -0.27, 0.08, 0.31, -0.01, -0.27, 0.0]);
    // In the air the feet rise with the hips, and the legs are tucked a little on the way.
    let in_the_air = (JUMP_S[2]..JUMP_S[4]).contains(&time_s);
    let tuck = at([0.0, 0.0, -0.08, 0.06, 0.01, 0.0, 0.0]);
    let foot = Foot {
        forward: curve(&[(0.6, 0.0), (0.84, 0.27), (1.06, 0.52)], time_s),
        lift: if in_the_air { (hips_up + tuck).max(0.0) } else { 0.0 },
        pitch: turn([0.0, 0.0, 34.0, 16.0, -8.0, 0.0, 0.0]),
        yaw: degrees(7.0),
        ..Foot::default()
    };
    stance.feet = [foot; 2];
    let rest = stance.arms[0];
    let arm = Arm {
        out: rest.out + turn([0.0, 6.0, 10.0, 14.0, 10.0, 6.0, 0.0]),
        forward: turn([0.0, -40.0, 58.0, 118.0, 66.0, 30.0, 0.0]),
        flex: rest.flex + turn([0.0, 12.0, 22.0, 10.0, 30.0, 34.0, 0.0]),
        turn: rest.turn,
        shrug: turn([0.0, 0.0, 10.0, 12.0, 6.0, 0.0, 0.0]),
        wrist: 0.0,
    };
    stance.arms = [arm; 2];
    stance.hips += dvec3(0.0, hips_up, at([0.0, -0.07, 0.09, 0.27, 0.44, 0.44, 0.52]));
    stance.hips_turn.x = turn([0.0, 28.0, 4.0, 10.0, 8.0, 28.0, 0.0]);
    stance.spine_turn.x = turn([0.0, 26.0, -10.0, 16.0, 12.0, 28.0, 0.0]);
    stance.head_turn.x = turn([0.0, -26.0, 0.0, -10.0, 4.0, -22.0, 0.0]);
    stance
}

/// From one arm to another, every angle alike.
fn mix(a: &Arm, b: &Arm, t: f64) -> Arm {
    let between = |a: f64, b: f64| a + (b - a) * t;
    Arm {
        out: between(a.out, b.out),
        forward: between(a.forward, b.forward),
        flex: between(a.flex, b.flex),
        turn: between(a.turn, b.turn),
        shrug: between(a.shrug, b.shrug),
        wrist: between(a.wrist, b.wrist),
    }
}

/// Through (time, value) keys without overshoot, level before the first and after the last:
/// cubic Hermite with the harmonic mean of the neighbouring slopes (Fritsch and Butland).
fn curve(keys: &[(f64, f64)], time: f64) -> f64 {
    let next = keys.partition_point(|key| key.0 <= time);
    if next == 0 {
        return keys[0].1;
    }
    if next == keys.len() {
        return keys[next - 1].1;
    }
    let slope = |i: usize| (keys[i + 1].1 - keys[i].1) / (keys[i + 1].0 - keys[i].0);
    let tangent = |i: usize| {
        if i == 0 || i + 1 == keys.len() {
            return 0.0;
        }
        let (before, after) = (slope(i - 1), slope(i));
        if before * after <= 0.0 { 0.0 } else { 2.0 * before * after / (before + after) }
    };
    let (a, b) = (keys[next - 1], keys[next]);
    let length = b.0 - a.0;
    let t = (time - a.0) / length;
    hermite([a.1, tangent(next - 1) * length, b.1, tangent(next) * length], t)
}

/// Through values that are evenly spread over a cycle, for any phase in cycles (Catmull and Rom).
fn cyclic(values: &[f64], phase: f64) -> f64 {
    let count = values.len();
    let place = phase.rem_euclid(1.0) * count as f64;
    let first = place.floor() as usize;
    let at = |offset: usize| values[(first + count + offset - 1) % count];
    let tangents = [0.5 * (at(2) - at(0)), 0.5 * (at(3) - at(1))];
    hermite([at(1), tangents[0], at(2), tangents[1]], place - first as f64)
}

/// Value and slope at 0, value and slope at 1.
fn hermite([a, slope_a, b, slope_b]: [f64; 4], t: f64) -> f64 {
    let (t2, t3) = (t * t, t * t * t);
    (2.0 * t3 - 3.0 * t2 + 1.0) * a
        + (t3 - 2.0 * t2 + t) * slope_a
        + (3.0 * t2 - 2.0 * t3) * b
        + (t3 - t2) * slope_b
}
