//! The fixed set of environment lights under which shading errors are measured.
//!
//! Every light is a sum of functions that are symmetric about an axis, in closed form, so its SH
//! coefficients are one-dimensional integrals. All are achromatic and fixed in the root frame
//! (+Y up, the character looks along +Z). Each is scaled so that the brightest white surface that
//! nothing shades has radiance 1: errors are fractions of that, and the peak of the PSNR is 1.

use std::f64::consts::PI;
use std::sync::LazyLock;

use glam::Vec3;

use crate::sh::{MAX_BANDS, Order, evaluate_f64, gauss_legendre, zonal};

/// The highest order: lights are scaled by it, so that they are the same for every model.
const FULL: Order = match Order::new(MAX_BANDS as u8) {
    Ok(order) => order,
    Err(_) => panic!("the largest order is an order"),
};

/// Radiance along t = cos θ from an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Profile {
    /// 1 everywhere.
    Constant,
    /// e^{κ(t−1)}, 1 on the axis: a soft lamp for κ ≈ 5, a sun for κ ≈ 100.
    Lobe(f64),
    /// (1 + 2t)/3 above the horizon of the axis (the CIE's overcast sky), 0 below.
    Overcast,
    /// (1−|t|)³: a band of light along the horizon of the axis.
    Horizon,
}

impl Profile {
    fn at(self, t: f64) -> f64 {
        match self {
            Self::Constant => 1.0,
            Self::Lobe(sharpness) => (sharpness * (t - 1.0)).exp(),
            Self::Overcast if t < 0.0 => 0.0,
            Self::Overcast => (1.0 + 2.0 * t) / 3.0,
            Self::Horizon => (1.0 - t.abs()).powi(3),
        }
    }

    /// z_l = 2π ∫ f(t) y_l0(t) dt for every band.
    fn zonal(self) -> [f64; MAX_BANDS] {
        let mut out = [0.0; MAX_BANDS];
        let mut y = [0.0; MAX_BANDS * MAX_BANDS];
        // 96 nodes to either side of t = 0, the only kink: round-off for every profile here.
        for (x, weight) in gauss_legendre(96) {
            for t in [(x - 1.0) / 2.0, (x + 1.0) / 2.0] {
                evaluate_f64(FULL, [(1.0 - t * t).max(0.0).sqrt(), 0.0, t], &mut y);
                for (l, z) in out.iter_mut().enumerate() {
                    *z += PI * weight * self.at(t) * y[l * (l + 1)];
                }
            }
        }
        out
    }
}

/// An environment light of the fixed set.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Short name, such as `sunset`.
    pub name: &'static str,
    /// One line for a reader.
    pub description: &'static str,
    /// Strength, axis and profile of each term.
    terms: Vec<(f64, Vec3, Profile)>,
    scale: f64,
}

impl Light {
    fn new(
        name: &'static str,
        description: &'static str,
        terms: &[(f64, [f32; 3], Profile)],
    ) -> Self {
        let terms = terms
            .iter()
            .map(|&(strength, axis, profile)| (strength, Vec3::from(axis).normalize(), profile))
            .collect();
        let mut light = Self { name, description, terms, scale: 1.0 };
        light.scale = 1.0 / light.brightest();
        light
    }

    /// Radiance from a unit direction of the root frame.
    #[must_use]
    pub fn radiance(&self, direction: Vec3) -> f64 {
        let radiance = |&(strength, axis, profile): &(f64, Vec3, Profile)| {
            strength * profile.at(f64::from(axis.dot(direction)).clamp(-1.0, 1.0))
        };
        self.scale * self.terms.iter().map(radiance).sum::<f64>()
    }

    /// l_i = ∫ L y_i dω: the sum over terms of √(4π/(2l+1)) z_l y_lm(axis).
    #[must_use]
    pub fn coefficients(&self, order: Order) -> Vec<f64> {
        let mut out = vec![0.0; order.coefficients()];
        let mut y = vec![0.0; order.coefficients()];
        for &(strength, axis, profile) in &self.terms {
            evaluate_f64(order, axis.as_dvec3().to_array(), &mut y);
            let zonal = profile.zonal();
            for (l, z) in zonal.iter().enumerate().take(order.bands()) {
                let factor = self.scale * strength * (4.0 * PI / (2 * l + 1) as f64).sqrt() * z;
                let band = l * l..(l + 1) * (l + 1);
                out[band.clone()].iter_mut().zip(&y[band]).for_each(|(o, y)| *o += factor * y);
            }
        }
        out
    }

    /// The largest radiance of a white Lambertian surface that nothing shades, to about 0.1 %:
    /// the best of 4,096 directions spread by the golden angle.
    fn brightest(&self) -> f64 {
        let order = FULL;
        let cosine = zonal::clamped_cosine(order);
        let mut reflected = self.coefficients(order);
        for (l, c) in cosine.iter().enumerate() {
            let factor = (4.0 * PI / (2 * l + 1) as f64).sqrt() * c / PI;
            reflected[l * l..(l + 1) * (l + 1)].iter_mut().for_each(|x| *x *= factor);
        }
        let mut y = vec![0.0; order.coefficients()];
        let golden = PI * (3.0 - 5f64.sqrt());
        let shaded = |i: u32| {
            let z = 1.0 - (f64::from(i) + 0.5) / 2048.0;
            let (r, angle) = ((1.0 - z * z).sqrt(), golden * f64::from(i));
            evaluate_f64(order, [r * angle.cos(), r * angle.sin(), z], &mut y);
            reflected.iter().zip(&y).map(|(a, b)| a * b).sum::<f64>()
        };
        (0..4096).map(shaded).fold(0.0, f64::max)
    }
}

/// The fixed set: a constant sky, an overcast sky, a noon sun, a sunset, a studio, a side light.
#[must_use]
pub fn lights() -> &'static [Light] {
    static LIGHTS: LazyLock<Vec<Light>> = LazyLock::new(set);
    &LIGHTS
}

fn set() -> Vec<Light> {
    use Profile::{Constant, Horizon, Lobe, Overcast};
    const UP: [f32; 3] = [0.0, 1.0, 0.0];
    const LOW_SUN: [f32; 3] = [0.85, 0.12, 0.5];
    vec![
        Light::new("constant", "the same radiance from everywhere", &[(1.0, UP, Constant)]),
        Light::new(
            "overcast",
            "the CIE's overcast sky over a dark ground",
            &[(1.0, UP, Overcast), (0.1, [0.0, -1.0, 0.0], Overcast)],
        ),
        Light::new(
            "noon",
            "a high sun (lobe of sharpness 100, 60° up) in an overcast-like sky",
            &[(12.0, [0.4, 1.732, 0.917], Lobe(100.0)), (0.6, UP, Overcast), (0.05, UP, Constant)],
        ),
        Light::new(
            "sunset",
            "a low sun, the glow around it, a bright horizon, a dim zenith",
            &[
                (6.0, LOW_SUN, Lobe(60.0)),
                (1.2, LOW_SUN, Lobe(4.0)),
                (0.4, UP, Horizon),
                (0.15, UP, Overcast),
            ],
        ),
        Light::new(
            "studio",
            "key, fill and rim lamps (sharpness 12, 6, 20) in a dim room",
            &[
                (1.0, [0.7, 0.6, 0.9], Lobe(12.0)),
                (0.35, [-0.9, 0.2, 0.7], Lobe(6.0)),
                (0.9, [-0.3, 0.7, -1.0], Lobe(20.0)),
                (0.03, UP, Constant),
            ],
        ),
        Light::new(
            "side",
            "one narrow lamp at the character's left, nothing else: the hardest shadows",
            &[(1.0, [1.0, 0.05, 0.0], Lobe(40.0))],
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The constant light of radiance 1 has the single coefficient √4π.
    #[test]
    fn constant_light_is_one_coefficient() {
        let l = lights()[0].coefficients(Order::new(6).unwrap());
        assert!((l[0] - (4.0 * PI).sqrt()).abs() < 1e-9, "{}", l[0]);
        assert!(l[1..].iter().all(|x| x.abs() < 1e-12));
    }

    /// The coefficients of every light agree with a plain product quadrature of its radiance over
    /// the sphere, which knows nothing of zonal functions.
    #[test]
    fn coefficients_agree_with_integration_over_the_sphere() {
        let order = Order::new(6).unwrap();
        for light in lights() {
            let mut sum = vec![0.0; 36];
            let mut y = vec![0.0; 36];
            let (rows, columns) = (160, 96);
            for (z, weight) in gauss_legendre(rows) {
                for k in 0..columns {
                    let angle = 2.0 * PI * (f64::from(k) + 0.5) / f64::from(columns);
                    let r = (1.0 - z * z).sqrt();
                    let d = [r * angle.cos(), r * angle.sin(), z];
                    evaluate_f64(order, d, &mut y);
                    let radiance = light.radiance(Vec3::from(d.map(|x| x as f32)));
                    let area = weight * 2.0 * PI / f64::from(columns);
                    sum.iter_mut().zip(&y).for_each(|(s, y)| *s += area * radiance * y);
                }
            }
            for (i, (a, b)) in light.coefficients(order).iter().zip(&sum).enumerate() {
                assert!((a - b).abs() < 2e-3, "{} coefficient {i}: {a} {b}", light.name);
            }
        }
    }

    /// Every light shades its best-lit open surface with radiance 1, and is nowhere negative.
    #[test]
    fn lights_are_normalised_and_positive() {
        for light in lights() {
            assert!((light.brightest() - 1.0).abs() < 1e-12, "{}", light.name);
            for d in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z] {
                assert!(light.radiance(d) >= 0.0, "{}", light.name);
            }
        }
    }
}
