//! Projecting the cosine-weighted reflectance on both sides.

use std::f64::consts::{PI, TAU};

use super::Cosine;
use crate::sh::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate_f64, gauss_legendre};
use crate::shade::brdf::Reflectance;

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

/// With f a function of the azimuths' difference Δ alone, and even in it, the integral over both
/// azimuths is (1 + δ_m0) π ∫ f cos mΔ dΔ where both harmonics have the same degree m (of either
/// sign), and 0 elsewhere.
pub(super) fn isotropic(
    reflectance: &impl Reflectance,
    [order, light_order]: [Order; 2],
    nodes: usize,
    cosine: Cosine,
) -> [Projected; 3] {
    let mut out = empty(order, light_order);
    let around = Around::new(2 * nodes, light_order);
    let meridian = |[sin, cos, _]: [f64; 3]| {
        let mut y = [0.0; MAX_COEFFICIENTS];
        evaluate_f64(light_order.max(order), [sin, 0.0, cos], &mut y);
        y
    };
    let elevations = elevations(nodes);
    let meridians: Vec<[f64; MAX_COEFFICIENTS]> = elevations.iter().map(|&e| meridian(e)).collect();
    for (to, y_to) in elevations.iter().zip(&meridians) {
        let outgoing = [to[0], 0.0, to[1]];
        let mut seen = [const { [0.0; MAX_COEFFICIENTS] }; 3];
        for (from, y_from) in elevations.iter().zip(&meridians) {
            let scale = cosine.weight(from[1]);
            let (turned, squares) = around.integrals(|[cos, sin]| {
                let incoming = [from[0] * cos, from[0] * sin, from[1]];
                reflectance.reflect(incoming, outgoing).map(|f| f * scale)
            });
            for (c, out) in out.iter_mut().enumerate() {
                out.energy += TAU * from[2] * to[2] * squares[c];
                spread(&mut out.matrix, [light_order, order], y_from, y_to, |m| {
                    let both = if m == 0 { TAU } else { PI };
                    both * from[2] * to[2] * turned[m][c]
                });
                for (i, sum) in seen[c].iter_mut().enumerate().take(light_order.coefficients()) {
                    let l = i.isqrt();
                    // Only the harmonics of degree m ≥ 0 see a function that is even in Δ.
                    if let Some(m) = i.checked_sub(l * (l + 1)) {
                        *sum += from[2] * turned[m][c] * y_from[i];
                    }
                }
            }
        }
        for (out, seen) in out.iter_mut().zip(&seen) {
            out.lit += TAU * to[2] * cosine.energy_of(seen);
        }
    }
    out
}

/// Azimuths of an isotropic table, with cos mΔ of each.
struct Around {
    directions: Vec<[f64; 2]>,
    waves: Vec<[f64; MAX_BANDS]>,
    bands: usize,
}

impl Around {
    fn new(count: usize, order: Order) -> Self {
        let delta = |k: usize| TAU / count as f64 * (k as f64 + 0.5);
        let direction = |k| [delta(k).cos(), delta(k).sin()];
        let wave = |k| std::array::from_fn(|m| (m as f64 * delta(k)).cos());
        let (directions, waves) = ((0..count).map(direction), (0..count).map(wave));
        Self { directions: directions.collect(), waves: waves.collect(), bands: order.bands() }
    }

    /// ∫ f cos mΔ dΔ by degree and colour, and ∫ f² dΔ.
    fn integrals(&self, f: impl Fn([f64; 2]) -> [f64; 3]) -> ([[f64; 3]; MAX_BANDS], [f64; 3]) {
        let (mut turned, mut squares) = ([[0.0; 3]; MAX_BANDS], [0.0; 3]);
        let step = TAU / self.directions.len() as f64;
        for (direction, waves) in self.directions.iter().zip(&self.waves) {
            let f = f(*direction);
            squares.iter_mut().zip(f).for_each(|(sum, f)| *sum += step * f * f);
            for (sums, wave) in turned.iter_mut().zip(waves).take(self.bands) {
                sums.iter_mut().zip(f).for_each(|(sum, f)| *sum += step * wave * f);
            }
        }
        (turned, squares)
    }
}

/// Adds the share of one pair of elevations to all entries of equal degree.
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

/// Without symmetry: for every outgoing direction the integral over incoming ones.
pub(super) fn anisotropic(
    reflectance: &impl Reflectance,
    [order, light_order]: [Order; 2],
    nodes: usize,
    cosine: Cosine,
) -> [Projected; 3] {
    let mut out = empty(order, light_order);
    let (rows, columns) = (light_order.coefficients(), order.coefficients());
    let around = 2 * nodes;
    let step = TAU / around as f64;
    let directions: Vec<([f64; 3], f64)> = elevations(nodes)
        .into_iter()
        .flat_map(|[sin, cos, weight]| {
            (0..around).map(move |k| {
                let (s, c) = (step * (k as f64 + 0.5)).sin_cos();
                ([sin * c, sin * s, cos], weight * step)
            })
        })
        .collect();
    let mut tables = vec![0.0; directions.len() * rows];
    for ((direction, _), row) in directions.iter().zip(tables.chunks_exact_mut(rows)) {
        evaluate_f64(light_order, *direction, row);
    }
    let mut y = vec![0.0; columns];
    for (outgoing, view_weight) in &directions {
        let mut sums = [const { [0.0; MAX_COEFFICIENTS] }; 3];
        for ((incoming, weight), table) in directions.iter().zip(tables.chunks_exact(rows)) {
            let scale = cosine.weight(incoming[2]);
            let f = reflectance.reflect(*incoming, *outgoing).map(|f| f * scale);
            for (c, sums) in sums.iter_mut().enumerate() {
                out[c].energy += view_weight * weight * f[c] * f[c];
                let share = weight * f[c];
                sums.iter_mut().zip(table).for_each(|(sum, y)| *sum += share * y);
            }
        }
        evaluate_f64(order, *outgoing, &mut y);
        for (out, sums) in out.iter_mut().zip(&sums) {
            out.lit += view_weight * cosine.energy_of(sums);
            for (row, sum) in out.matrix.chunks_exact_mut(columns).zip(sums) {
                row.iter_mut().zip(&y).for_each(|(entry, y)| *entry += view_weight * sum * y);
            }
        }
    }
    out
}
