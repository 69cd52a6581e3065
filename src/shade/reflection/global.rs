//! Operators in one frame for all points: a reflectance turned to each of a set of normals, so that
//! neither light nor visibility has to be (RPO09 §4.2).

use glam::{DQuat, DVec3, Vec3};

use super::{ReflectionOperator, Reflector};
use crate::sh::{Order, Rotation};

/// The most normals of a set.
const MOST_NORMALS: usize = 4096;

/// An isotropic reflectance ready to shade in the frame of the visibility, such as a model's root
/// frame: an operator for each of a set of normals, of which a point takes the nearest.
///
/// Beside the tangent frame it saves the rotation of visibility and the evaluation of the light's
/// lobes at every point; it costs the operator's bytes for every normal, and an angle that falls as
/// the square root of their number: 2 √(2/N) radians at most, about.
#[derive(Debug, Clone)]
pub struct GlobalReflector {
    normals: Vec<Vec3>,
    reflectors: Vec<Reflector>,
}

impl GlobalReflector {
    /// The operators of red, green and blue for `normals` normals (clamped to 6..=4096), evenly over
    /// the sphere.
    ///
    /// # Panics
    /// If the operators differ in order or number of terms.
    #[must_use]
    pub fn new(name: &str, operators: &[ReflectionOperator; 3], normals: usize) -> Self {
        let normals = spread(normals.clamp(6, MOST_NORMALS));
        let order = operators[0].order();
        let reflector = |normal: &Vec3| {
            let rotation = from_pole(order, *normal);
            let turned = operators.each_ref().map(|operator| operator.turned(&rotation));
            Reflector::new(name, &turned, [0.0; 3])
        };
        let reflectors = normals.iter().map(reflector).collect();
        Self { normals, reflectors }
    }

    /// The normals.
    #[must_use]
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// Bytes of the numbers of all operators.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.reflectors.iter().map(Reflector::bytes).sum()
    }

    /// Which normal is nearest to a unit vector.
    #[must_use]
    pub fn nearest(&self, normal: Vec3) -> usize {
        let mut best = (f32::NEG_INFINITY, 0);
        for (i, candidate) in self.normals.iter().enumerate() {
            let along = candidate.dot(normal);
            if along > best.0 {
                best = (along, i);
            }
        }
        best.1
    }

    /// Radiance towards a unit direction by the operator of one of the normals: visibility, light and
    /// direction in the common frame. Towards below that normal's plane nothing is reflected.
    ///
    /// # Panics
    /// If there is no such normal, or a slice is shorter than n².
    #[must_use]
    pub fn shade(
        &self,
        normal: usize,
        visibility: &[f32],
        light: [&[f32]; 3],
        outgoing: Vec3,
    ) -> [f32; 3] {
        if outgoing.dot(self.normals[normal]) <= 0.0 {
            return [0.0; 3];
        }
        self.reflectors[normal].shade_any(visibility, light, outgoing)
    }
}

/// Directions evenly over the sphere, on a spiral.
fn spread(count: usize) -> Vec<Vec3> {
    let golden = std::f64::consts::PI * (3.0 - 5_f64.sqrt());
    let direction = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (r, angle) = ((1.0 - z * z).sqrt(), golden * i as f64);
        DVec3::new(r * angle.cos(), r * angle.sin(), z).as_vec3().normalize()
    };
    (0..count).map(direction).collect()
}

/// The shortest rotation that takes +Z to a normal.
fn from_pole(order: Order, normal: Vec3) -> Rotation {
    let mut rotation = Rotation::identity(order);
    let turn = DQuat::from_rotation_arc(DVec3::Z, normal.as_dvec3().normalize());
    rotation.set_f64(turn.to_array());
    rotation
}

#[cfg(all(test, feature = "bake"))]
mod tests {
    use glam::Quat;

    use super::super::factor;
    use super::*;
    use crate::shade::Brdf;

    /// At the normals of the set a point is shaded as in its tangent frame, whatever that frame's
    /// tangent; the set is even, so the nearest normal is near.
    #[test]
    fn the_common_frame_shades_as_the_tangent_frame() {
        let n = Order::new(4).unwrap();
        let brdf = Brdf::Ggx { normal_reflectance: [0.9, 0.5, 0.1], alpha: [0.5; 2] };
        let operators = factor(&brdf, n, 24).unwrap().map(|colour| colour.operator(8));
        let local = Reflector::new("ggx", &operators, [0.0; 3]);
        let global = GlobalReflector::new("ggx", &operators, 64);
        assert_eq!(global.bytes(), 64 * local.bytes());
        let numbers =
            |phase: f32| -> Vec<f32> { (0..16).map(|i| (i as f32 * 1.3 + phase).sin()).collect() };
        let (v, lights) = (numbers(0.2), [0.5, 1.0, 2.0].map(numbers));
        for i in [0, 17, 40, 63] {
            let normal = global.normals()[i];
            assert_eq!(global.nearest(normal), i);
            let turn = Quat::from_rotation_z(0.7) * Quat::from_rotation_arc(normal, Vec3::Z);
            let rotation = Rotation::new(n, turn);
            let rotated = |values: &[f32]| {
                let mut out = [0.0; 16];
                rotation.apply(values, &mut out);
                out
            };
            let [r, g, b] = lights.each_ref().map(|light| rotated(light));
            let outgoing = (normal + 0.4 * normal.any_orthonormal_vector()).normalize();
            let expected = local.shade(&rotated(&v), [&r, &g, &b], turn * outgoing);
            let found = global.shade(i, &v, [&lights[0], &lights[1], &lights[2]], outgoing);
            for (a, b) in found.iter().zip(expected) {
                assert!((a - b).abs() < 2e-4, "{i}: {found:?} {expected:?}");
            }
            assert_eq!(global.shade(i, &v, [&r, &g, &b], -outgoing), [0.0; 3]);
        }
        let farthest = (0..500).map(|k| {
            let direction =
                Vec3::new((k as f32).sin(), (k as f32 * 1.7).cos(), (k as f32 * 0.3).sin());
            let direction = direction.normalize();
            direction.dot(global.normals()[global.nearest(direction)]).acos()
        });
        assert!(farthest.fold(0.0, f32::max) < 2.0 * (2.0_f32 / 64.0).sqrt());
    }
}
