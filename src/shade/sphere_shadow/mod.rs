//! Shadows of spheres: visibilities multiplied as sums of logarithms (Ren et al. 2006; RPO09 eq. 3).
//!
//! The product of functions a ∗ b, cut off at order n, is M_a b with M_a the product matrix of a. So
//! 1 + g + g∗g/2 + … is exp(M_g) 1, and a visibility v has the logarithm log(M_v)(M_v − 1)⁻¹(v − 1).
//! For one sphere all of this is zonal: matrices of n × n, tabulated over the angle that the sphere
//! fills. Sums of such logarithms cost one turned zonal vector a sphere; one exponential at the end
//! makes them a visibility again.

mod carried;
mod exponential;
mod logarithm;
mod overlap;

use glam::Vec3;

use crate::sh::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate, zonal};

pub use carried::SphereSet;
pub use exponential::Exponential;
use logarithm::Zonal;

/// Steps of the table over the half angle from 0 to a right angle.
const STEPS: usize = 256;

/// A blocker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Metres.
    pub centre: Vec3,
    /// Metres, positive.
    pub radius: f32,
}

/// Tables for one order.
#[derive(Debug, Clone)]
pub struct SphereShadows {
    order: Order,
    /// `[step][band]`: √(4π/(2l+1)) times the zonal logarithm, ready to be turned.
    logs: Vec<[f32; MAX_BANDS]>,
    /// Of a point inside a sphere, which sees nothing.
    inside: f32,
    exponential: Exponential,
}

impl SphereShadows {
    /// Tables for an order; some milliseconds.
    #[must_use]
    pub fn new(order: Order) -> Self {
        let turnable = |log: [f64; MAX_BANDS]| -> [f32; MAX_BANDS] {
            std::array::from_fn(|l| {
                (log[l] * (4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt()) as f32
            })
        };
        let products = Zonal::new(order);
        let angle = |step: usize| std::f64::consts::FRAC_PI_2 * step as f64 / STEPS as f64;
        let log = |half_angle: f64| {
            let mut visible = zonal::cap(order, half_angle).map(|c| -c);
            visible[0] += (4.0 * std::f64::consts::PI).sqrt();
            products.log(&visible)
        };
        Self {
            order,
            logs: (0..=STEPS).map(|step| turnable(log(angle(step)))).collect(),
            inside: log(std::f64::consts::PI)[0] as f32,
            exponential: Exponential::new(order),
        }
    }

    /// The order.
    #[must_use]
    pub fn order(&self) -> Order {
        self.order
    }

    /// Adds the logarithm of a sphere's visibility at a point to n² coefficients: nothing where the
    /// sphere has no radius, and a large finite darkness where the point is inside of it.
    ///
    /// # Panics
    /// If `log` is shorter than n².
    pub fn add(&self, receiver: Vec3, sphere: &Sphere, log: &mut [f32]) {
        let log = &mut log[..self.order.coefficients()];
        let towards = sphere.centre - receiver;
        if holds(sphere, receiver) {
            log[0] += self.inside;
            return;
        }
        let distance = towards.length();
        let place = (sphere.radius / distance).clamp(0.0, 1.0).asin()
            * (STEPS as f32 / std::f32::consts::FRAC_PI_2);
        let low = (place as usize).min(STEPS - 1);
        let mix = place - low as f32;
        let mut y = [0.0; MAX_COEFFICIENTS];
        evaluate(self.order, towards / distance, &mut y);
        for l in 0..self.order.bands() {
            let [a, b] = [self.logs[low][l], self.logs[low + 1][l]];
            let value = a + mix * (b - a);
            for i in l * l..(l + 1) * (l + 1) {
                log[i] += value * y[i];
            }
        }
    }

    /// The visibility of a point among bodies, each with the [`SphereShadows::overlap`] of its spheres,
    /// which says what of them hide one another from outside; a point inside of a sphere sees nothing,
    /// whatever that is.
    ///
    /// # Panics
    /// If `out` is shorter than n².
    pub fn among_bodies<'a>(
        &self,
        receiver: Vec3,
        bodies: impl Iterator<Item = (&'a [Sphere], f32)>,
        out: &mut [f32],
    ) {
        let mut log = [0.0; MAX_COEFFICIENTS];
        for (spheres, overlap) in bodies {
            let mut own = [0.0; MAX_COEFFICIENTS];
            for sphere in spheres {
                let into = if holds(sphere, receiver) { &mut log } else { &mut own };
                self.add(receiver, sphere, into);
            }
            log.iter_mut().zip(own).for_each(|(log, own)| *log += overlap * own);
        }
        self.exponential.apply(&log, out);
    }

    /// The visibility of a point among spheres: n² coefficients, 1 where nothing blocks.
    ///
    /// # Panics
    /// If `out` is shorter than n².
    pub fn visibility(&self, receiver: Vec3, spheres: &[Sphere], out: &mut [f32]) {
        let mut log = [0.0; MAX_COEFFICIENTS];
        for sphere in spheres {
            self.add(receiver, sphere, &mut log);
        }
        self.exponential.apply(&log, out);
    }
}

fn holds(sphere: &Sphere, point: Vec3) -> bool {
    sphere.centre.distance(point) <= sphere.radius
}

#[cfg(test)]
mod tests;
