//! The shape of the figure: joints, and a distance field of rounded limbs that blend smoothly.
//!
//! 1.75 m tall, facing +Z, its left side at +X, arms half lowered so that nothing touches. Only the
//! middle and the left side are written down; the right side is their mirror image.

use glam::{DVec3, dvec3};

pub(super) const HIPS: usize = 0;
pub(super) const SPINE: usize = 1;
pub(super) const CHEST: usize = 2;
pub(super) const NECK: usize = 3;
pub(super) const HEAD: usize = 4;
pub(super) const SHOULDER: usize = 5;
pub(super) const UPPER_ARM: usize = 6;
pub(super) const LOWER_ARM: usize = 7;
pub(super) const HAND: usize = 8;
pub(super) const UPPER_LEG: usize = 9;
pub(super) const LOWER_LEG: usize = 10;
pub(super) const FOOT: usize = 11;
/// From a joint of the left side to the same of the right.
pub(super) const RIGHT: usize = 7;
/// Middle, left and right.
pub(super) const JOINTS: usize = FOOT + 1 + RIGHT;

/// Name, parent, rest position (metres) of the middle and the left side.
const TABLE: [(&str, Option<usize>, DVec3); FOOT + 1] = [
    ("Hips", None, dvec3(0.0, 0.95, 0.0)),
    ("Spine", Some(HIPS), dvec3(0.0, 1.06, -0.005)),
    ("Chest", Some(SPINE), dvec3(0.0, 1.20, -0.01)),
    ("Neck", Some(CHEST), dvec3(0.0, 1.46, -0.015)),
    ("Head", Some(NECK), dvec3(0.0, 1.555, 0.0)),
    ("Shoulder", Some(CHEST), dvec3(0.035, 1.40, -0.005)),
    ("UpperArm", Some(SHOULDER), dvec3(0.178, 1.385, -0.012)),
    ("LowerArm", Some(UPPER_ARM), dvec3(0.383, 1.185, -0.025)),
    ("Hand", Some(LOWER_ARM), dvec3(0.556, 1.012, -0.005)),
    ("UpperLeg", Some(HIPS), dvec3(0.092, 0.905, 0.0)),
    ("LowerLeg", Some(UPPER_LEG), dvec3(0.102, 0.495, 0.004)),
    ("Foot", Some(LOWER_LEG), dvec3(0.108, 0.085, -0.022)),
];

/// A joint of the skeleton; at rest none is turned or scaled.
#[derive(Debug, Clone)]
pub(super) struct Joint {
    pub(super) name: String,
    pub(super) parent: Option<usize>,
    /// Metres, in the scene.
    pub(super) at: DVec3,
}

/// All joints, parents first.
pub(super) fn joints() -> Vec<Joint> {
    let middle = TABLE[..SHOULDER].iter().map(|&(name, parent, at)| Joint {
        name: name.to_owned(),
        parent,
        at,
    });
    let side = |side: &'static str, offset: usize, mirror: f64| {
        TABLE[SHOULDER..].iter().map(move |&(name, parent, at)| Joint {
            name: format!("{side}{name}"),
            parent: parent.map(|p| if p < SHOULDER { p } else { p + offset }),
            at: dvec3(at.x * mirror, at.y, at.z),
        })
    };
    middle.chain(side("Left", 0, 1.0)).chain(side("Right", RIGHT, -1.0)).collect()
}

/// A round cone from `a` to `b`, squeezed by `thin` along `axis` about the line between them.
#[derive(Debug, Clone, Copy)]
struct Limb {
    joint: usize,
    a: DVec3,
    radius_a: f64,
    b: DVec3,
    radius_b: f64,
    axis: DVec3,
    thin: f64,
    /// How far it blends into what came before it, metres.
    blend: f64,
}

impl Limb {
    /// The distance to the surface, exact on it and to first order near it.
    fn distance(&self, p: DVec3) -> f64 {
        let stretch = |v: DVec3| v + self.axis * (self.axis.dot(v) * (1.0 / self.thin - 1.0));
        let (line, offset) = (stretch(self.b - self.a), stretch(p - self.a));
        let length = line.length_squared();
        let t = if length > 0.0 { (offset.dot(line) / length).clamp(0.0, 1.0) } else { 0.0 };
        let away = offset - line * t;
        let radius = self.radius_a + t * (self.radius_b - self.radius_a);
        let distance = away.length();
        if distance < 1e-9 {
            return -radius * self.thin;
        }
        // The stretched distance over the length of its gradient.
        (distance - radius) / stretch(away / distance).length()
    }
}

const fn limb(joint: usize, a: DVec3, radius_a: f64, b: DVec3, radius_b: f64) -> Limb {
    Limb { joint, a, radius_a, b, radius_b, axis: DVec3::Z, thin: 1.0, blend: 0.03 }
}

const fn ball(joint: usize, centre: DVec3, radius: f64) -> Limb {
    limb(joint, centre, radius, centre, radius)
}

impl Limb {
    const fn thin(self, axis: DVec3, thin: f64) -> Self {
        Self { axis, thin, ..self }
    }

    const fn blend(self, blend: f64) -> Self {
        Self { blend, ..self }
    }
}

/// The blend of limbs that continue each other; more would swell the joint between them.
const JOINED: f64 = 0.004;
/// Half the root of two: the arms hang at 45 degrees.
const D: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Out of the back of the hand.
const BACK_OF_HAND: DVec3 = dvec3(D, D, 0.0);

/// The body, from the middle outwards.
const LIMBS: [Limb; 31] = [
    // Torso.
    limb(HIPS, dvec3(0.0, 0.965, 0.0), 0.118, dvec3(0.056, 0.935, -0.005), 0.110)
        .thin(DVec3::Z, 0.84),
    limb(SPINE, dvec3(0.0, 1.075, 0.004), 0.098, dvec3(0.046, 1.075, 0.002), 0.093)
        .thin(DVec3::Z, 0.84)
        .blend(0.07),
    limb(CHEST, dvec3(0.0, 1.215, 0.0), 0.120, dvec3(0.048, 1.22, 0.0), 0.112)
        .thin(DVec3::Z, 0.86)
        .blend(0.07),
    limb(CHEST, dvec3(0.0, 1.325, -0.006), 0.110, dvec3(0.088, 1.335, -0.010), 0.092)
        .thin(DVec3::Z, 0.86)
        .blend(0.06),
    limb(CHEST, dvec3(0.062, 1.305, 0.058), 0.046, dvec3(0.10, 1.325, 0.048), 0.040).blend(0.045),
    limb(CHEST, dvec3(0.06, 1.33, -0.06), 0.045, dvec3(0.085, 1.27, -0.055), 0.035).blend(0.05),
    limb(SPINE, dvec3(0.03, 1.06, -0.05), 0.030, dvec3(0.03, 1.17, -0.06), 0.030).blend(0.04),
    ball(HIPS, dvec3(0.072, 0.905, -0.052), 0.082).blend(0.05),
    // Neck and head.
    limb(NECK, dvec3(0.0, 1.42, -0.020), 0.064, dvec3(0.0, 1.57, -0.004), 0.054).blend(0.04),
    limb(CHEST, dvec3(0.0, 1.455, -0.03), 0.048, dvec3(0.10, 1.405, -0.022), 0.045).blend(0.04),
    ball(HEAD, dvec3(0.0, 1.658, -0.006), 0.097).thin(DVec3::X, 0.83).blend(0.03),
    limb(HEAD, dvec3(0.0, 1.640, 0.024), 0.076, dvec3(0.0, 1.570, 0.046), 0.050)
        .thin(DVec3::X, 0.90)
        .blend(0.035),
    limb(HEAD, dvec3(0.0, 1.640, 0.094), 0.008, dvec3(0.0, 1.612, 0.106), 0.014).blend(0.022),
    ball(HEAD, dvec3(0.080, 1.630, -0.002), 0.020).thin(DVec3::X, 0.5).blend(0.012),
    // Shoulder and arm.
    limb(SHOULDER, dvec3(0.09, 1.398, -0.012), 0.050, dvec3(0.150, 1.392, -0.012), 0.055)
        .blend(0.04),
    limb(UPPER_ARM, dvec3(0.180, 1.388, -0.012), 0.060, dvec3(0.225, 1.335, -0.012), 0.050)
        .blend(0.035),
    limb(UPPER_ARM, dvec3(0.215, 1.349, -0.014), 0.048, dvec3(0.383, 1.185, -0.025), 0.040)
        .blend(0.03),
    limb(UPPER_ARM, dvec3(0.262, 1.300, 0.000), 0.038, dvec3(0.315, 1.247, 0.000), 0.036)
        .blend(0.03),
    limb(LOWER_ARM, dvec3(0.383, 1.185, -0.025), 0.040, dvec3(0.430, 1.138, -0.016), 0.043)
        .blend(JOINED),
    limb(LOWER_ARM, dvec3(0.430, 1.138, -0.016), 0.043, dvec3(0.556, 1.012, -0.005), 0.028)
        .blend(JOINED),
    limb(HAND, dvec3(0.568, 1.000, -0.003), 0.036, dvec3(0.612, 0.956, 0.004), 0.046)
        .thin(BACK_OF_HAND, 0.6)
        .blend(0.02),
    limb(HAND, dvec3(0.612, 0.956, 0.004), 0.045, dvec3(0.668, 0.900, 0.006), 0.037)
        .thin(BACK_OF_HAND, 0.6)
        .blend(JOINED),
    limb(HAND, dvec3(0.578, 0.988, 0.018), 0.026, dvec3(0.604, 0.958, 0.066), 0.021).blend(0.02),
    // Leg.
    limb(UPPER_LEG, dvec3(0.092, 0.88, 0.0), 0.090, dvec3(0.098, 0.72, 0.006), 0.082).blend(0.04),
    limb(UPPER_LEG, dvec3(0.098, 0.72, 0.006), 0.082, dvec3(0.102, 0.495, 0.004), 0.054)
        .blend(JOINED),
    limb(LOWER_LEG, dvec3(0.102, 0.495, 0.006), 0.054, dvec3(0.105, 0.38, -0.008), 0.052)
        .blend(JOINED),
    limb(LOWER_LEG, dvec3(0.108, 0.40, -0.022), 0.044, dvec3(0.106, 0.30, -0.026), 0.038)
        .blend(0.03),
    limb(LOWER_LEG, dvec3(0.105, 0.38, -0.008), 0.052, dvec3(0.108, 0.09, -0.022), 0.036)
        .blend(JOINED),
    // Foot.
    limb(FOOT, dvec3(0.108, 0.085, -0.022), 0.035, dvec3(0.108, 0.038, -0.042), 0.037)
        .blend(JOINED),
    limb(FOOT, dvec3(0.108, 0.062, -0.005), 0.038, dvec3(0.115, 0.026, 0.105), 0.043).blend(0.03),
    limb(FOOT, dvec3(0.115, 0.026, 0.105), 0.043, dvec3(0.116, 0.018, 0.160), 0.034).blend(JOINED),
];

/// The soles are cut off at the ground, with an edge of this radius (metres).
const SOLE_EDGE_M: f64 = 0.012;

/// Signed distance to the figure, negative inside, metres.
pub(super) fn distance(p: DVec3) -> f64 {
    let p = dvec3(p.x.abs(), p.y, p.z);
    let body = LIMBS.iter().fold(f64::INFINITY, |sum, limb| {
        if sum.is_infinite() {
            limb.distance(p)
        } else {
            smooth_min(sum, limb.distance(p), limb.blend)
        }
    });
    -smooth_min(-body, p.y, SOLE_EDGE_M)
}

/// The joint whose limb is nearest.
pub(super) fn nearest_joint(p: DVec3) -> usize {
    let mirrored = dvec3(p.x.abs(), p.y, p.z);
    let nearest = LIMBS
        .iter()
        .map(|limb| (limb.distance(mirrored), limb.joint))
        .reduce(|best, next| if next.0 < best.0 { next } else { best })
        .map_or(HIPS, |(_, joint)| joint);
    if p.x < 0.0 && nearest >= SHOULDER { nearest + RIGHT } else { nearest }
}

/// The smaller value, rounded off where both are within `blend` of each other; once differentiable.
fn smooth_min(a: f64, b: f64, blend: f64) -> f64 {
    let overlap = (blend - (a - b).abs()).max(0.0) / blend;
    a.min(b) - overlap * overlap * blend * 0.25
}
