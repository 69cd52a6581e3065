//! From what an animator thinks in (where the hips and feet are, how an arm is held) to the local
//! rotations of all joints. Legs by two-bone inverse kinematics, so feet stay where they stand.
//!
//! Angles are radians. Sides are 0 (left) and 1 (right) and mirror each other: `out` is away from
//! the body on both.

use glam::{DMat3, DQuat, DVec3, EulerRot, dvec3};

use super::body::{
    CHEST, FOOT, HAND, HEAD, HIPS, JOINTS, Joint, LOWER_ARM, LOWER_LEG, NECK, RIGHT, SHOULDER,
    SPINE, UPPER_ARM, UPPER_LEG,
};

/// An arm in the frame of the chest.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Arm {
    /// From hanging down sideways to horizontal (π/2).
    pub(super) out: f64,
    /// From there swung to the front.
    pub(super) forward: f64,
    /// The elbow.
    pub(super) flex: f64,
    /// Turned about itself, thumbs to the body; 0 bends the elbow to the front.
    pub(super) turn: f64,
    /// The collar bone lifted.
    pub(super) shrug: f64,
    /// The hand bent towards its palm.
    pub(super) wrist: f64,
}

/// A foot on or above the ground.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Foot {
    /// Metres further out than at rest.
    pub(super) out: f64,
    /// Metres forward of rest, of the flat sole.
    pub(super) forward: f64,
    /// Metres above the ground.
    pub(super) lift: f64,
    /// Rolled over the toes, heel up, or (negative) over the heel.
    pub(super) pitch: f64,
    /// Toes outwards.
    pub(super) yaw: f64,
}

/// The whole figure. Turns are (pitch to the front, yaw to the left, roll to the right) and come in
/// the order roll, pitch, yaw.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stance {
    /// Metres from rest.
    pub(super) hips: DVec3,
    pub(super) hips_turn: DVec3,
    /// Shared evenly by spine and chest.
    pub(super) spine_turn: DVec3,
    /// Shared by neck and head.
    pub(super) head_turn: DVec3,
    pub(super) arms: [Arm; 2],
    pub(super) feet: [Foot; 2],
}

/// What a key of a clip holds.
#[derive(Debug, Clone)]
pub(super) struct Key {
    /// Of the hips, metres.
    pub(super) translation: DVec3,
    /// Local, per joint.
    pub(super) rotations: [DQuat; JOINTS],
}

/// From the ankle at rest to where the toes and the heel touch the ground last and first. There is
/// no toe joint, so a foot rolls off further ahead than the ball.
const TOES: DVec3 = dvec3(0.0, -0.085, 0.178);
const HEEL: DVec3 = dvec3(0.0, -0.085, -0.058);
/// Legs are never stretched further than this share of their length.
const LONGEST: f64 = 0.9985;

/// Solves for the local rotations.
pub(super) fn solve(stance: &Stance, joints: &[Joint]) -> Key {
    // Nothing is turned at rest, so a joint's rotation in the scene is its rotation since rest.
    let mut turned = [DQuat::IDENTITY; JOINTS];
    let translation = joints[HIPS].at + stance.hips;
    turned[HIPS] = turn(stance.hips_turn);
    turned[SPINE] = turned[HIPS] * turn(stance.spine_turn * 0.5);
    turned[CHEST] = turned[SPINE] * turn(stance.spine_turn * 0.5);
    turned[NECK] = turned[CHEST] * turn(stance.head_turn * 0.4);
    turned[HEAD] = turned[NECK] * turn(stance.head_turn * 0.6);
    for side in 0..2 {
        pose_arm(&stance.arms[side], side, joints, &mut turned);
        pose_leg(&stance.feet[side], side, translation, joints, &mut turned);
    }
    let local = |joint: usize| match joints[joint].parent {
        Some(parent) => (turned[parent].inverse() * turned[joint]).normalize(),
        None => turned[joint],
    };
    Key { translation, rotations: std::array::from_fn(local) }
}

fn turn(angles: DVec3) -> DQuat {
    DQuat::from_euler(EulerRot::YXZ, angles.y, angles.x, angles.z)
}

/// A vector of the left side on either side.
fn mirror(v: DVec3, side: usize) -> DVec3 {
    if side == 0 { v } else { dvec3(-v.x, v.y, v.z) }
}

fn pose_arm(arm: &Arm, side: usize, joints: &[Joint], turned: &mut [DQuat; JOINTS]) {
    let at = |joint: usize| joints[joint + side * RIGHT].at;
    let set = |joint: usize| joint + side * RIGHT;
    let sign = if side == 0 { 1.0 } else { -1.0 };
    let swing = DQuat::from_rotation_x(-arm.forward);
    let along = swing * dvec3(arm.out.sin(), -arm.out.cos(), 0.0);
    let bend = DQuat::from_axis_angle(along, arm.turn) * (swing * DVec3::Z);
    let (along, bend) = (mirror(along, side), mirror(bend, side));
    let rest_along = at(LOWER_ARM) - at(UPPER_ARM);
    let rest_hinge = rest_along.cross(DVec3::Z);
    let hinge = along.cross(bend);
    let chest = turned[CHEST];
    turned[set(SHOULDER)] = chest * DQuat::from_rotation_z(sign * arm.shrug);
    turned[set(UPPER_ARM)] = chest * carry((rest_along, rest_hinge), (along, hinge));
    let fore = along * arm.flex.cos() + bend * arm.flex.sin();
    let rest_fore = at(HAND) - at(LOWER_ARM);
    turned[set(LOWER_ARM)] = chest * carry((rest_fore, rest_hinge), (fore, hinge));
    // At rest the palm faces the body, so the hand bends about the line to the front.
    turned[set(HAND)] = turned[set(LOWER_ARM)] * DQuat::from_rotation_z(-sign * arm.wrist);
}

fn pose_leg(foot: &Foot, side: usize, hips: DVec3, joints: &[Joint], turned: &mut [DQuat; JOINTS]) {
    let at = |joint: usize| joints[joint + side * RIGHT].at;
    let set = |joint: usize| joint + side * RIGHT;
    let sign = if side == 0 { 1.0 } else { -1.0 };
    let facing = DQuat::from_rotation_y(sign * foot.yaw);
    let sole = facing * DQuat::from_rotation_x(foot.pitch);
    let pivot = if foot.pitch > 0.0 { TOES } else { HEEL };
    let moved = mirror(dvec3(foot.out, foot.lift, foot.forward), side);
    let ankle = at(FOOT) + moved + facing * pivot - sole * pivot;

    let hip = hips + turned[HIPS] * (at(UPPER_LEG) - joints[HIPS].at);
    let (thigh, shin) = (at(LOWER_LEG) - at(UPPER_LEG), at(FOOT) - at(LOWER_LEG));
    let (upper, lower) = (thigh.length(), shin.length());
    let reach = (ankle - hip).length().min(LONGEST * (upper + lower));
    let down = (ankle - hip).normalize();
    let front = facing * DVec3::Z;
    let knee_side = (front - down * front.dot(down)).normalize();
    let cosine = (upper * upper + reach * reach - lower * lower) / (2.0 * upper * reach);
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let along = down * cosine + knee_side * sine;
    let fore = down * reach - along * upper;
    let hinge = down.cross(knee_side);
    let rest_hinge = thigh.cross(DVec3::Z);
    turned[set(UPPER_LEG)] = carry((thigh, rest_hinge), (along, hinge));
    turned[set(LOWER_LEG)] = carry((shin, rest_hinge), (fore, hinge));
    turned[set(FOOT)] = sole;
}

/// The rotation that takes a direction and, as well as that allows, a hinge axis to others.
fn carry(rest: (DVec3, DVec3), now: (DVec3, DVec3)) -> DQuat {
    let frame = |(along, hinge): (DVec3, DVec3)| {
        let along = along.normalize();
        let hinge = (hinge - along * hinge.dot(along)).normalize();
        DMat3::from_cols(along, hinge, along.cross(hinge))
    };
    DQuat::from_mat3(&(frame(now) * frame(rest).transpose()))
}
