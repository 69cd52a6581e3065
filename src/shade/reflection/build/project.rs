//! Projecting the cosine-weighted reflectance on both sides.

use std::f64::consts::{PI, TAU};

use super::Cosine;
use crate::sh::{MAX_COEFFICIENTS, Order, evaluate_f64, gauss_legendre};
use crate::shade::brdf::{Reflectance, Rule};

/// F_ij = ∫∫ f cos θ_i y_i(ω_i) y_j(ω_o), `[i][j]`, and the energies before projection and after that
/// of the incoming side alone.
pub(super) struct Projected {
    pub(super) matrix: Vec<f64>,
    pub(super) energy: f64,
    pub(super) lit: f64,
}

impl Cosine {
    /// What f is multiplied with before it is projected.
    fn weight(self, cosine: f64) -> f64 {
        match self {
            Self::Inside => cosine,
            Self::Matrix => 1.0,
        }
    }

    /// What a coefficient over the upper hemisphere becomes with what lies below: twice itself or
    /// nothing by mirroring in the plane z = 0, where y_lm is even for even l + m.
    pub(super) fn continued(self, i: usize) -> f64 {
        let l = i.isqrt();
        match self {
            Self::Inside => 1.0,
            Self::Matrix if (i - l * l).is_multiple_of(2) => 2.0,
            Self::Matrix => 0.0,
        }
    }

    /// Σ of squares of coefficients over the upper hemisphere, continued.
    fn energy_of(self, coefficients: &[f64]) -> f64 {
        let value = |(i, x): (usize, &f64)| (self.continued(i) * x).powi(2);
        coefficients.iter().enumerate().map(value).sum()
    }
}

fn empty(order: Order, light_order: Order) -> [Projected; 3] {
    std::array::from_fn(|_| Projected {
        matrix: vec![0.0; light_order.coefficients() * order.coefficients()],
        energy: 0.0,
        lit: 0.0,
    })
}

/// Elevations over the hemisphere as (sine, cosine, weight in cosine).
pub(super) fn elevations(nodes: usize) -> Vec<[f64; 3]> {
    let all = gauss_legendre(nodes).into_iter();
    all.map(|(x, weight)| {
        let z = 0.5 + 0.5 * x;
        [(1.0 - z * z).sqrt(), z, 0.5 * weight]
    })
    .collect()
}

/// What is seen from one direction: ∫ f cos θ_i y_i(ω_i) dω_i and ∫ (f cos θ_i)² dω_i by colour.
struct Seen {
    sums: [[f64; MAX_COEFFICIENTS]; 3],
    squares: [f64; 3],
}

impl Seen {
    fn from(
        outgoing: [f64; 3],
        reflectance: &impl Reflectance,
        rule: &Rule,
        (light_order, cosine): (Order, Cosine),
    ) -> Self {
        let mut this = Self { sums: [[0.0; MAX_COEFFICIENTS]; 3], squares: [0.0; 3] };
        let mut y = [0.0; MAX_COEFFICIENTS];
        let y = &mut y[..light_order.coefficients()];
        rule.each(reflectance.sampling(), outgoing, |incoming, weight| {
            let scale = cosine.weight(incoming[2]);
            let f = reflectance.reflect(incoming, outgoing).map(|f| f * scale);
            evaluate_f64(light_order, incoming, y);
            for ((sums, squares), f) in this.sums.iter_mut().zip(&mut this.squares).zip(f) {
                *squares += weight * f * f;
                let share = weight * f;
                sums.iter_mut().zip(&*y).for_each(|(sum, y)| *sum += share * y);
            }
        });
        this
    }
}

/// With f a function of the azimuths' difference Δ alone, and even in it, what is seen from azimuth φ is
/// what is seen from over +X, turned: cos mφ and sin mφ times its harmonics of degree m ≥ 0, those of
/// negative degree being 0. So the integral over φ is (1 + δ_m0) π where both harmonics have the same
/// degree m (of either sign), and 0 elsewhere.
pub(super) fn isotropic(
    reflectance: &impl Reflectance,
    [order, light_order]: [Order; 2],
    nodes: usize,
    cosine: Cosine,
) -> [Projected; 3] {
    let mut out = empty(order, light_order);
    let rule = Rule::new(nodes, true);
    let mut y = [0.0; MAX_COEFFICIENTS];
    for [sin, cos, weight] in elevations(nodes) {
        let outgoing = [sin, 0.0, cos];
        let seen = Seen::from(outgoing, reflectance, &rule, (light_order, cosine));
        evaluate_f64(order, outgoing, &mut y);
        for (c, out) in out.iter_mut().enumerate() {
            let mut sums = seen.sums[c];
            for (i, sum) in sums.iter_mut().enumerate() {
                let l = i.isqrt();
                if i < l * (l + 1) {
                    *sum = 0.0;
                }
            }
            out.energy += TAU * weight * seen.squares[c];
            out.lit += TAU * weight * cosine.energy_of(&sums);
            spread(&mut out.matrix, [light_order, order], &sums, &y, |m| {
                weight * if m == 0 { TAU } else { PI }
            });
        }
    }
    out
}

/// Adds the share of one elevation to all entries of equal degree.
fn spread(
    matrix: &mut [f64],
    [rows, columns]: [Order; 2],
    y_row: &[f64],
    y_column: &[f64],
    azimuth: impl Fn(usize) -> f64,
) {
    let width = columns.coefficients();
    for m in 0..columns.bands().min(rows.bands()) {
        let azimuth = azimuth(m);
        for l in m..rows.bands() {
            for k in m..columns.bands() {
                let (i, j) = (l * (l + 1), k * (k + 1));
                let value = azimuth * y_row[i + m] * y_column[j + m];
                matrix[(i + m) * width + j + m] += value;
                if m > 0 {
                    matrix[(i - m) * width + j - m] += value;
                }
            }
        }
    }
}

/// Without symmetry: for outgoing directions all around.
pub(super) fn anisotropic(
    reflectance: &impl Reflectance,
    [order, light_order]: [Order; 2],
    nodes: usize,
    cosine: Cosine,
) -> [Projected; 3] {
    let mut out = empty(order, light_order);
    let columns = order.coefficients();
    let rule = Rule::new(nodes, false);
    let step = PI / nodes as f64;
    let mut y = vec![0.0; columns];
    for [r, z, weight] in elevations(nodes) {
        for k in 0..2 * nodes {
            let (sin, cos) = (step * (k as f64 + 0.5)).sin_cos();
            let (outgoing, weight) = ([r * cos, r * sin, z], weight * step);
            let seen = Seen::from(outgoing, reflectance, &rule, (light_order, cosine));
            evaluate_f64(order, outgoing, &mut y);
            for (c, out) in out.iter_mut().enumerate() {
                out.energy += weight * seen.squares[c];
                out.lit += weight * cosine.energy_of(&seen.sums[c]);
                for (row, sum) in out.matrix.chunks_exact_mut(columns).zip(&seen.sums[c]) {
                    row.iter_mut().zip(&y).for_each(|(entry, y)| *entry += weight * sum * y);
                }
            }
        }
    }
    out
}
