//! Making operators of a reflectance.
//!
//! The cosine-weighted reflectance is projected on both sides first and factored then, the other way
//! round than the published order (table, factors, projection): what is projected is all that an
//! operator can hold, so the k factors kept are the best k there are (Eckart and Young), all n² of
//! them are exact, and the matrix to be decomposed has n² columns instead of thousands.

use std::f64::consts::{PI, TAU};

use faer::Mat;

use super::ReflectionOperator;
use crate::num::linalg::{NoConvergence, product, rows_of, symmetric_eigen, thin_svd};
use crate::sh::{
    MAX_BANDS, MAX_COEFFICIENTS, Order, cosine_product_pole, evaluate_f64, gauss_legendre,
    hemisphere_gram_pole,
};
use crate::shade::brdf::Reflectance;

/// Functions of the view that are smaller than this over the upper hemisphere, squared and beside
/// their size over the sphere, are left to the lower one.
const LEAST: f64 = 1e-7;

/// Terms that are weaker than this share of the strongest are rounding.
const NOTHING: f64 = 1e-10;

/// A reflectance of one colour, projected and factored.
#[derive(Debug, Clone, PartialEq)]
pub struct Factored {
    order: Order,
    light_order: Order,
    /// `[b][i]`, all of them, strongest first; view factors have norm 1 over the hemisphere.
    light: Vec<f64>,
    view: Vec<f64>,
    /// Singular values.
    strengths: Vec<f64>,
    /// ∫∫ (f cos θ_i)² dω_i dω_o.
    energy: f64,
    /// The part of it that the light's bands hold.
    lit: f64,
    cosine: Cosine,
    /// Of all colours, so that their operators have the same number of terms.
    rank: usize,
}

/// Where the cosine of the incoming direction goes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Cosine {
    /// Into the table that is factored: f cos θ_i.
    #[default]
    Inside,
    /// f alone is factored, continued below the surface as its mirror image so that it has no edge
    /// there, and visibility meets the cosine's own product matrix first (eq. 14): L = l · (M_b C v).
    /// What is lost is that C v has n bands only.
    Matrix,
}

impl Factored {
    /// ‖f cos − Σ_{b<k} U_b W_b‖ / ‖f cos‖ over all pairs of directions: what the bands of this
    /// order cannot hold and what the terms after k would have added. (Without the cosine where that
    /// is a matrix of its own.)
    #[must_use]
    pub fn error(&self, terms: usize) -> f64 {
        share(self.energy - self.kept(terms), self.energy)
    }

    /// The error that is left with all terms: what the bands cannot hold. A narrow lobe has more of
    /// it, and only a higher order has less.
    #[must_use]
    pub fn band_limit(&self) -> f64 {
        self.error(usize::MAX)
    }

    /// The error of `terms` terms as a light of these bands can show it: over the part of f cos that
    /// the light's bands hold, since finer detail of the incoming side reflects nothing of such a
    /// light.
    #[must_use]
    pub fn lit_error(&self, terms: usize) -> f64 {
        share(self.lit - self.kept(terms), self.lit)
    }

    fn kept(&self, terms: usize) -> f64 {
        self.strengths.iter().take(terms).map(|s| s * s).sum()
    }

    /// The most terms that there can be: n².
    #[must_use]
    pub fn most_terms(&self) -> usize {
        self.strengths.len()
    }

    /// The terms of which any colour has more than rounding: 1 for Lambert.
    #[must_use]
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// The operator of the strongest `terms` terms, or of as many as the reflectance has.
    #[must_use]
    pub fn operator(&self, terms: usize) -> ReflectionOperator {
        let terms = terms.clamp(1, self.rank);
        let light = &self.light[..terms * self.light_order.coefficients()];
        let view = &self.view[..terms * self.order.coefficients()];
        let operator = ReflectionOperator::new(self.order, self.light_order, light, view);
        match self.cosine {
            Cosine::Inside => operator,
            Cosine::Matrix => operator.after(&cosine_product_pole(self.order)),
        }
    }
}

/// √(part/whole), 0 of nothing.
fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { (part.max(0.0) / whole).sqrt() } else { 0.0 }
}

/// Projects and factors the three colours of a reflectance for visibility and light of an order.
/// Integrals are products of `nodes` Gauss–Legendre elevations on each side; azimuths take twice as
/// many. Light factors get order 2n − 1, at most 10, which is what a product of two functions of
/// order n can see of them.
///
/// # Errors
/// [`NoConvergence`] of the decomposition, which finite numbers are not known to cause.
pub fn factor(
    reflectance: &impl Reflectance,
    order: Order,
    nodes: usize,
) -> Result<[Factored; 3], NoConvergence> {
    factor_by(reflectance, order, nodes, Cosine::Inside)
}

/// [`factor`] with the cosine where it is wanted.
///
/// # Errors
/// As [`factor`].
pub fn factor_by(
    reflectance: &impl Reflectance,
    order: Order,
    nodes: usize,
    cosine: Cosine,
) -> Result<[Factored; 3], NoConvergence> {
    let most = Order::new(MAX_BANDS as u8).unwrap_or(order);
    let light_order = Order::new(2 * order.get() - 1).unwrap_or(most);
    let projected = if reflectance.is_isotropic() {
        isotropic(reflectance, [order, light_order], nodes, cosine)
    } else {
        anisotropic(reflectance, [order, light_order], nodes, cosine)
    };
    let mut out = Vec::with_capacity(3);
    for mut projected in projected {
        projected.energy *= cosine.continued(0);
        let rows = projected.matrix.chunks_exact_mut(order.coefficients());
        for (i, row) in rows.enumerate() {
            row.iter_mut().for_each(|entry| *entry *= cosine.continued(i));
        }
        out.push(Factored { cosine, ..decompose(projected, order, light_order)? });
    }
    let rank = out.iter().map(|factored| factored.rank).max().unwrap_or(1);
    out.iter_mut().for_each(|factored| factored.rank = rank);
    Ok(<[Factored; 3]>::try_from(out).expect("three colours went in"))
}

/// F_ij = ∫∫ f cos θ_i y_i(ω_i) y_j(ω_o), `[i][j]`, and the energies before projection and after that
/// of the incoming side alone.
struct Projected {
    matrix: Vec<f64>,
    energy: f64,
    lit: f64,
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
    fn continued(self, i: usize) -> f64 {
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
fn elevations(nodes: usize) -> Vec<[f64; 3]> {
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
fn isotropic(
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
fn anisotropic(
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

/// The best factors: of the light's side over the sphere, where a reflectance is 0 below the
/// surface; of the view's side over the hemisphere alone, since nothing is seen from below. There
/// the harmonics are not orthonormal; a basis that is comes from their Gram matrix.
fn decompose(
    Projected { matrix, energy, lit }: Projected,
    order: Order,
    light_order: Order,
) -> Result<Factored, NoConvergence> {
    let (rows, columns) = (light_order.coefficients(), order.coefficients());
    let gram = hemisphere_gram_pole(order);
    let (values, vectors) = symmetric_eigen(rows_of(&gram, columns, columns))?;
    let kept: Vec<usize> = (0..columns).filter(|&k| values[k] > LEAST).collect();
    let basis =
        Mat::from_fn(columns, kept.len(), |j, k| vectors[(j, kept[k])] / values[kept[k]].sqrt());
    let seen = product(rows_of(&matrix, rows, columns), basis.as_ref());
    let svd = thin_svd(seen.as_ref())?;
    let harmonics = product(basis.as_ref(), svd.v.as_ref());
    let (mut light, mut view) = (Vec::new(), Vec::new());
    for (b, strength) in svd.s.iter().enumerate() {
        light.extend((0..rows).map(|i| strength * svd.u[(i, b)]));
        view.extend((0..columns).map(|j| harmonics[(j, b)]));
    }
    let first = svd.s.first().copied().unwrap_or(0.0);
    let rank = svd.s.iter().filter(|s| **s > NOTHING * first).count().max(1);
    let (cosine, strengths) = (Cosine::Inside, svd.s);
    Ok(Factored { order, light_order, light, view, strengths, energy, lit, cosine, rank })
}

#[cfg(test)]
mod tests;
