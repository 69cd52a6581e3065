//! Directions to integrate a reflectance over, many of them where its lobe is.
//!
//! Two rules of directions share every integral: one even over the hemisphere, one gathered in the
//! lobe by its density. Each takes the share p²/(Σ p²) of the integrand (Veach's power heuristic), so
//! that neither meets a peak that the other resolves; the shares sum to 1 everywhere.

use std::f64::consts::{PI, TAU};

use super::analytic::{dot, half};
use crate::sh::gauss_legendre;

/// Where a reflectance has most of what it sends towards a viewer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sampling {
    /// Nowhere in particular: evenly over the hemisphere.
    Even,
    /// Around the mirror image of the viewer's direction, as a power of the cosine.
    Mirror {
        /// The power.
        exponent: f64,
    },
    /// Where facets mirror that are tilted by about these slopes.
    Facets {
        /// Along the tangent and along the bitangent.
        slopes: [f64; 2],
    },
}

/// The density of the even rule.
const EVEN: f64 = 1.0 / TAU;

/// The rules of one resolution.
pub(in crate::shade) struct Rule {
    /// Directions and solid angles.
    even: Vec<([f64; 3], f64)>,
    /// (v, cos ψ, sin ψ) with weights: v² is what of the lobe's density lies within, ψ its azimuth.
    gathered: Vec<([f64; 3], f64)>,
}

impl Rule {
    /// Products of `nodes` Gauss–Legendre nodes and twice as many azimuths. Where the integrands are
    /// `even` in the azimuth's sign and views lie over +X, half of the azimuths stand for all.
    pub(in crate::shade) fn new(nodes: usize, even: bool) -> Self {
        let azimuths = 2 * nodes;
        let (taken, each) = if even { (nodes, 2.0) } else { (azimuths, 1.0) };
        let share = each / azimuths as f64;
        let around: Vec<[f64; 2]> = (0..taken)
            .map(|k| {
                let (sin, cos) = (TAU * (k as f64 + 0.5) / azimuths as f64).sin_cos();
                [cos, sin]
            })
            .collect();
        let (mut even, mut gathered) = (Vec::new(), Vec::new());
        for (x, weight) in gauss_legendre(nodes) {
            let (v, weight) = (0.5 + 0.5 * x, 0.5 * weight * share);
            let r = (1.0 - v * v).sqrt();
            for [cos, sin] in &around {
                even.push(([r * cos, r * sin, v], TAU * weight));
                gathered.push(([v, *cos, *sin], 2.0 * v * weight));
            }
        }
        Self { even, gathered }
    }

    /// Calls with all incoming directions above the surface, and weights that sum an integral over
    /// solid angle.
    pub(in crate::shade) fn each(
        &self,
        sampling: Sampling,
        outgoing: [f64; 3],
        mut take: impl FnMut([f64; 3], f64),
    ) {
        for &(incoming, area) in &self.even {
            let there = sampling.density(incoming, outgoing);
            take(incoming, area * EVEN * EVEN / (EVEN * EVEN + there * there));
        }
        if sampling == Sampling::Even {
            return;
        }
        for &(node, weight) in &self.gathered {
            let Some(incoming) = sampling.incoming(node, outgoing) else { continue };
            let here = sampling.density(incoming, outgoing);
            if here > 0.0 {
                take(incoming, weight * here / (EVEN * EVEN + here * here));
            }
        }
    }
}

impl Sampling {
    /// Per steradian of incoming directions.
    fn density(self, incoming: [f64; 3], outgoing: [f64; 3]) -> f64 {
        match self {
            Self::Even => 0.0,
            Self::Mirror { exponent } => {
                let along = dot(mirrored(outgoing), incoming).max(0.0);
                (exponent + 1.0) / TAU * along.powf(exponent)
            }
            Self::Facets { slopes: [sx, sy] } => {
                let h = half(incoming, outgoing);
                let stretched = (h[0] / sx).powi(2) + (h[1] / sy).powi(2) + h[2] * h[2];
                let facets = h[2] / (PI * sx * sy * stretched * stretched);
                facets / (4.0 * dot(outgoing, h)).max(f64::MIN_POSITIVE)
            }
        }
    }

    /// The incoming direction of a node, where it is above the surface.
    fn incoming(self, [v, cos, sin]: [f64; 3], outgoing: [f64; 3]) -> Option<[f64; 3]> {
        let found = match self {
            Self::Even => return None,
            Self::Mirror { exponent } => {
                let z = (1.0 - v * v).powf(1.0 / (exponent + 1.0));
                let r = (1.0 - z * z).max(0.0).sqrt();
                let axis = mirrored(outgoing);
                let (x, y) = across(axis);
                std::array::from_fn(|k| r * (cos * x[k] + sin * y[k]) + z * axis[k])
            }
            Self::Facets { slopes: [sx, sy] } => {
                let tilt = v / (1.0 - v * v).sqrt();
                let h = [sx * tilt * cos, sy * tilt * sin, 1.0];
                let scale = 2.0 * dot(outgoing, h) / dot(h, h);
                if scale <= 0.0 {
                    return None;
                }
                std::array::from_fn(|k| scale * h[k] - outgoing[k])
            }
        };
        (found[2] > 0.0).then_some(found)
    }
}

fn mirrored(outgoing: [f64; 3]) -> [f64; 3] {
    [-outgoing[0], -outgoing[1], outgoing[2]]
}

/// Two unit vectors at right angles to one above the surface and to one another, the first in the plane
/// of the normal, so that azimuths about it are even where the reflectance is.
fn across(axis: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let r = axis[0].hypot(axis[1]);
    let (cos, sin) = if r > 0.0 { (axis[0] / r, axis[1] / r) } else { (1.0, 0.0) };
    ([axis[2] * cos, axis[2] * sin, -r], [-sin, cos, 0.0])
}
