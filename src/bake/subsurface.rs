//! Light that travels below the surface: the dipole approximation (Jensen et al. 2001, "A practical
//! model for subsurface light transport").
//!
//! R_d(r) = (α'/4π) Σ_{i ∈ r,v} z_i (σ_tr + 1/d_i) e^{−σ_tr d_i} / d_i², d_i² = r² + z_i², with
//! σ_t' = σ_a + σ_s', σ_tr = √(3 σ_a σ_t'), z_r = 1/σ_t', z_v = z_r (1 + 4A/3) and A from the refractive
//! index. Over a disk of radius s about the point its integral is closed:
//! (α'/2) Σ (e^{−σ_tr z_i} − z_i e^{−σ_tr d_i(s)} / d_i(s)). Weights are normalised by the integral over
//! an infinite plane, so that on a plane a uniform transfer stays what it is: the total reflectance
//! belongs to the albedo that a renderer multiplies with, and the kernel only spreads, colour by
//! colour.

use std::f64::consts::PI;

use super::{Error, Signal};

/// What a material does to light below its surface, by colour (red, green, blue).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Subsurface {
    /// Reduced mean free path 1/(σ_a + σ_s'), metres; positive.
    pub mean_free_path_m: [f32; 3],
    /// Absorption σ_a, 1/metre; from 0 to below 1 / mean free path.
    pub absorption_per_m: [f32; 3],
    /// Of the material over that of air, 1 to 3.
    pub refractive_index: f32,
}

/// Measured materials: name, σ_s' and σ_a in 1/mm, refractive index (Jensen et al. 2001, figure 5).
const MEASURED: [(&str, [f32; 3], [f32; 3], f32); 6] = [
    ("skin", [0.74, 0.88, 1.01], [0.032, 0.17, 0.48], 1.3),
    ("pale-skin", [1.09, 1.59, 1.79], [0.013, 0.070, 0.145], 1.3),
    ("marble", [2.19, 2.62, 3.00], [0.0021, 0.0041, 0.0071], 1.5),
    ("milk", [2.55, 3.21, 3.77], [0.0011, 0.0024, 0.014], 1.3),
    ("potato", [0.68, 0.70, 0.55], [0.0024, 0.0090, 0.12], 1.3),
    ("apple", [2.29, 2.39, 1.97], [0.0030, 0.0034, 0.046], 1.3),
];

impl Subsurface {
    /// Names of the measured materials.
    pub fn names() -> impl Iterator<Item = &'static str> {
        MEASURED.iter().map(|measured| measured.0)
    }

    /// A measured material.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let &(_, scattering, absorption, refractive_index) =
            MEASURED.iter().find(|measured| measured.0 == name)?;
        let path = |i: usize| 1e-3 / (scattering[i] + absorption[i]);
        Some(Self {
            mean_free_path_m: [path(0), path(1), path(2)],
            absorption_per_m: absorption.map(|per_mm| 1e3 * per_mm),
            refractive_index,
        })
    }

    /// The longest of the mean free paths, metres.
    #[must_use]
    pub fn longest_m(&self) -> f32 {
        self.mean_free_path_m.into_iter().fold(0.0, f32::max)
    }

    /// Channels that come out where so many go in: one where all colours spread alike.
    #[must_use]
    pub fn channels(&self, channels: usize) -> usize {
        let alike = |of: [f32; 3]| of[0] == of[1] && of[1] == of[2];
        let grey = alike(self.mean_free_path_m) && alike(self.absorption_per_m);
        if grey { channels } else { 3 }
    }

    pub(super) fn check(&self, signal: Signal) -> Result<(), Error> {
        if signal != Signal::Transfer {
            return Err(Error::SubsurfaceOf { signal: signal.name() });
        }
        for (&path, &absorption) in self.mean_free_path_m.iter().zip(&self.absorption_per_m) {
            if !(path.is_finite() && path > 0.0) {
                return Err(Error::MeanFreePath { found: path });
            }
            if !(absorption >= 0.0 && absorption * path < 1.0) {
                return Err(Error::Absorption { found: absorption, most: 1.0 / path });
            }
        }
        let found = self.refractive_index;
        if (1.0..=3.0).contains(&found) { Ok(()) } else { Err(Error::Refraction { found }) }
    }

    /// The kernels of the colours.
    pub(super) fn dipoles(&self) -> [Dipole; 3] {
        [0, 1, 2].map(|i| {
            let path = f64::from(self.mean_free_path_m[i]);
            Dipole::new(path, f64::from(self.absorption_per_m[i]), f64::from(self.refractive_index))
        })
    }
}

/// R_d over its integral over an infinite plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Dipole {
    /// Depths of the real and the virtual source, metres.
    z: [f64; 2],
    /// σ_tr, 1/metre.
    transport: f64,
    /// 1 / (Σ e^{−σ_tr z_i}), twice the inverse of the integral for α' = 1.
    scale: f64,
}

impl Dipole {
    fn new(path: f64, absorption: f64, index: f64) -> Self {
        // Egan and Hilgeman's fit to the diffuse Fresnel reflectance from inside.
        let inside = -1.440 / (index * index) + 0.710 / index + 0.668 + 0.0636 * index;
        let boundary = (1.0 + inside) / (1.0 - inside);
        let z = [path, path * (1.0 + 4.0 / 3.0 * boundary)];
        let transport = (3.0 * absorption / path).sqrt();
        let scale = 1.0 / z.map(|z| (-transport * z).exp()).iter().sum::<f64>();
        Self { z, transport, scale }
    }

    /// 1/m² at a squared distance of `square` m².
    pub(super) fn at(&self, square: f64) -> f64 {
        let of = |z: f64| {
            let d = (square + z * z).sqrt();
            z * (self.transport + 1.0 / d) * (-self.transport * d).exp() / (d * d)
        };
        self.scale / (2.0 * PI) * self.z.map(of).iter().sum::<f64>()
    }

    /// The integral over a disk of this radius whose centre is the point itself.
    pub(super) fn disk(&self, radius: f64) -> f64 {
        1.0 - self.beyond(radius * radius)
    }

    /// The integral over the plane beyond a circle of this squared radius; also that over a whole
    /// plane at this squared distance.
    pub(super) fn beyond(&self, square: f64) -> f64 {
        let of = |z: f64| {
            let d = (square + z * z).sqrt();
            z / d * (-self.transport * d).exp()
        };
        self.scale * self.z.map(of).iter().sum::<f64>()
    }
}
