//! How much the spheres of one body hide one another.

use glam::Vec3;

use super::{Sphere, SphereShadows};
use crate::sh::{MAX_COEFFICIENTS, evaluate_f64, gauss_legendre};

/// Shells about the body's middle on which receivers lie, in its own reach.
const SHELLS: [f32; 3] = [0.5, 0.9, 1.5];

/// Receivers on each.
const RECEIVERS: usize = 16;

/// Elevations of the directions in which the union is looked at; azimuths are twice as many.
const ELEVATIONS: usize = 16;

/// Halvings of the range of weights, times the golden ratio.
const STEPS: usize = 16;

impl SphereShadows {
    /// The factor of the sum of a body's logarithms by which its exponential is nearest to the visibility
    /// of the union of its spheres, over receivers all around it: 1 for spheres that do not hide one
    /// another, less where a product of visibilities would count the same directions again and again.
    #[must_use]
    pub fn overlap(&self, spheres: &[Sphere]) -> f32 {
        if spheres.len() < 2 {
            return 1.0;
        }
        let middle = spheres.iter().map(|s| s.centre).sum::<Vec3>() / spheres.len() as f32;
        let reach = spheres.iter().map(|s| s.centre.distance(middle) + s.radius);
        let reach = reach.fold(0.0, f32::max);
        let looks = self.looks();
        let (mut logs, mut unions) = (Vec::new(), Vec::new());
        for i in 0..RECEIVERS * SHELLS.len() {
            let receiver = middle + reach * SHELLS[i / RECEIVERS] * spread(i % RECEIVERS);
            if spheres.iter().any(|s| s.centre.distance(receiver) <= 1.05 * s.radius) {
                continue;
            }
            let mut log = [0.0; MAX_COEFFICIENTS];
            spheres.iter().for_each(|sphere| self.add(receiver, sphere, &mut log));
            logs.push(log);
            unions.push(self.union(receiver, spheres, &looks));
        }
        let count = self.order.coefficients();
        let off = |weight: f32| -> f32 {
            let one = |(log, union): (&[f32; MAX_COEFFICIENTS], &[f32; MAX_COEFFICIENTS])| -> f32 {
                let mut out = [0.0; MAX_COEFFICIENTS];
                self.exponential.apply(&log.map(|x| weight * x), &mut out);
                out.iter().zip(union).take(count).map(|(a, b)| (a - b).powi(2)).sum()
            };
            logs.iter().zip(&unions).map(one).sum()
        };
        least(off)
    }

    /// Directions with their solid angles times the harmonics there.
    fn looks(&self) -> Vec<(Vec3, [f32; MAX_COEFFICIENTS])> {
        let around = 2 * ELEVATIONS;
        let step = std::f64::consts::TAU / around as f64;
        let ring = |(z, weight): (f64, f64)| {
            let r = (1.0 - z * z).sqrt();
            (0..around).map(move |k| {
                let (sin, cos) = (step * k as f64).sin_cos();
                let direction = [r * cos, r * sin, z];
                let mut y = [0.0; MAX_COEFFICIENTS];
                evaluate_f64(self.order, direction, &mut y);
                let share = y.map(|y| (weight * step * y) as f32);
                (Vec3::from(direction.map(|x| x as f32)), share)
            })
        };
        gauss_legendre(ELEVATIONS).into_iter().flat_map(ring).collect()
    }

    /// The visibility among the union of spheres, by looking.
    fn union(
        &self,
        receiver: Vec3,
        spheres: &[Sphere],
        looks: &[(Vec3, [f32; MAX_COEFFICIENTS])],
    ) -> [f32; MAX_COEFFICIENTS] {
        let mut out = [0.0; MAX_COEFFICIENTS];
        for (direction, share) in looks {
            let is_blocked = spheres.iter().any(|sphere| {
                let to = sphere.centre - receiver;
                let along = to.dot(*direction);
                along > 0.0 && to.length_squared() - along * along < sphere.radius.powi(2)
            });
            if !is_blocked {
                out.iter_mut().zip(share).for_each(|(out, y)| *out += y);
            }
        }
        out
    }
}

/// Directions evenly over the sphere.
fn spread(i: usize) -> Vec3 {
    let z = 1.0 - (2 * i + 1) as f32 / RECEIVERS as f32;
    let (sin, cos) = (2.399_963_2 * i as f32).sin_cos();
    let r = (1.0 - z * z).sqrt();
    Vec3::new(r * cos, z, r * sin)
}

/// Where a function of one weight from 0 to 1 is least, by golden sections.
fn least(f: impl Fn(f32) -> f32) -> f32 {
    const GOLDEN: f32 = 0.618_034;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..STEPS {
        let (a, b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
        if f(a) < f(b) {
            high = b;
        } else {
            low = a;
        }
    }
    0.5 * (low + high)
}
