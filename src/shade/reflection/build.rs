//! Making operators of a reflectance.
//!
//! The cosine-weighted reflectance is projected on both sides first and factored then, the other way
//! round than the published order (table, factors, projection): what is projected is all that an
//! operator can hold, so the k factors kept are the best k there are (Eckart and Young), all n² of
//! them are exact, and the matrix to be decomposed has n² columns instead of thousands.

mod project;

use faer::Mat;

use super::ReflectionOperator;
use crate::num::linalg::{NoConvergence, product, rows_of, symmetric_eigen, thin_svd};
use crate::sh::{MAX_BANDS, Order, cosine_product_pole, hemisphere_gram_pole};
use crate::shade::brdf::Reflectance;
use project::{Projected, anisotropic, isotropic};

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
    /// `[b][i]`, all of them, strongest first.
    light: Vec<f64>,
    view: Vec<f64>,
    /// ‖U_b W_b‖ of each term, which are orthogonal.
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

/// Whose light factors the colours are given.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Colours {
    /// The same for all, so that they share their matrices: a third of the bytes and of the time of
    /// shading. The best such factors, every colour counting by its shares alone.
    #[default]
    Together,
    /// Each its own, the best for as many terms.
    Apart,
}

/// How a reflectance is factored.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Factoring {
    /// Where the cosine goes.
    pub cosine: Cosine,
    /// Whose light factors they are.
    pub colours: Colours,
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

    /// The most terms that an operator takes: n². Colours of which each has all of its own are exact
    /// with them, to [`Factored::band_limit`]; colours that share theirs are not quite.
    #[must_use]
    pub fn most_terms(&self) -> usize {
        self.strengths.len().min(self.order.coefficients())
    }

    /// The terms of which any colour has more than rounding, at most [`Factored::most_terms`]: 1 for
    /// Lambert.
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
/// Integrals are products of `nodes` Gauss–Legendre nodes on each side and twice as many azimuths,
/// those of the incoming side gathered in the lobe ([`Reflectance::sampling`]). Light factors get order 2n − 1, at most 10, which is what a product of two functions of
/// order n can see of them.
///
/// # Errors
/// [`NoConvergence`] of the decomposition, which finite numbers are not known to cause.
pub fn factor(
    reflectance: &impl Reflectance,
    order: Order,
    nodes: usize,
) -> Result<[Factored; 3], NoConvergence> {
    factor_by(reflectance, order, nodes, Factoring::default())
}

/// [`factor`] in another way.
///
/// # Errors
/// As [`factor`].
pub fn factor_by(
    reflectance: &impl Reflectance,
    order: Order,
    nodes: usize,
    Factoring { cosine, colours }: Factoring,
) -> Result<[Factored; 3], NoConvergence> {
    let most = Order::new(MAX_BANDS as u8).unwrap_or(order);
    let light_order = Order::new(2 * order.get() - 1).unwrap_or(most);
    let mut projected = if reflectance.is_isotropic() {
        isotropic(reflectance, [order, light_order], nodes, cosine)
    } else {
        anisotropic(reflectance, [order, light_order], nodes, cosine)
    };
    for projected in &mut projected {
        projected.energy *= cosine.continued(0);
        let rows = projected.matrix.chunks_exact_mut(order.coefficients());
        for (i, row) in rows.enumerate() {
            row.iter_mut().for_each(|entry| *entry *= cosine.continued(i));
        }
    }
    let [red, green, blue] = &projected;
    let is_grey = red.matrix == green.matrix && red.matrix == blue.matrix;
    let orders = [order, light_order];
    let mut out = Vec::with_capacity(3);
    match colours {
        _ if is_grey => {
            let factored = decompose(&projected[..1], orders, cosine)?;
            out.extend([0; 3].map(|colour| factored[colour].clone()));
        }
        Colours::Together => out = decompose(&projected, orders, cosine)?,
        Colours::Apart => {
            for projected in projected.chunks(1) {
                out.extend(decompose(projected, orders, cosine)?);
            }
        }
    }
    let rank = out.iter().map(|factored| factored.rank).max().unwrap_or(1);
    out.iter_mut().for_each(|factored| factored.rank = rank);
    Ok(<[Factored; 3]>::try_from(out).expect("three colours went in"))
}

/// The best factors: of the light's side over the sphere, where a reflectance is 0 below the
/// surface; of the view's side over the hemisphere alone, since nothing is seen from below. There
/// the harmonics are not orthonormal; a basis that is comes from their Gram matrix.
///
/// Several colours get light factors together: those of their matrices side by side, each scaled to
/// norm 1.
fn decompose(
    colours: &[Projected],
    [order, light_order]: [Order; 2],
    cosine: Cosine,
) -> Result<Vec<Factored>, NoConvergence> {
    let (rows, columns) = (light_order.coefficients(), order.coefficients());
    let gram = hemisphere_gram_pole(order);
    let (values, vectors) = symmetric_eigen(rows_of(&gram, columns, columns))?;
    let kept: Vec<usize> = (0..columns).filter(|&k| values[k] > LEAST).collect();
    let basis =
        Mat::from_fn(columns, kept.len(), |j, k| vectors[(j, kept[k])] / values[kept[k]].sqrt());
    let seen: Vec<Mat<f64>> = colours
        .iter()
        .map(|c| product(rows_of(&c.matrix, rows, columns), basis.as_ref()))
        .collect();
    let scale: Vec<f64> = seen.iter().map(|seen| seen.norm_l2()).collect();
    let scale: Vec<f64> = scale.iter().map(|s| if *s > 0.0 { 1.0 / s } else { 0.0 }).collect();
    let wide = Mat::from_fn(rows, colours.len() * kept.len(), |i, k| {
        let colour = k / kept.len();
        scale[colour] * seen[colour][(i, k % kept.len())]
    });
    let svd = thin_svd(wide.as_ref())?;
    let first = svd.s.first().copied().unwrap_or(0.0);
    let rank = svd.s.iter().filter(|s| **s > NOTHING * first).count().max(1).min(columns);
    let light: Vec<f64> =
        (0..svd.s.len()).flat_map(|b| (0..rows).map(move |i| (i, b))).map(|at| svd.u[at]).collect();
    let one = |(colour, seen): (&Projected, &Mat<f64>)| {
        // W_b = uᵀ_b F: in the basis, whose norm is that over the hemisphere.
        let own = product(svd.u.transpose(), seen.as_ref());
        let squares = |b: usize| (0..kept.len()).map(|k| own[(b, k)].powi(2)).sum::<f64>();
        let harmonics = product(own.as_ref(), basis.transpose());
        let view = (0..svd.s.len()).flat_map(|b| (0..columns).map(move |j| (b, j)));
        Factored {
            order,
            light_order,
            light: light.clone(),
            view: view.map(|at| harmonics[at]).collect(),
            strengths: (0..svd.s.len()).map(|b| squares(b).sqrt()).collect(),
            energy: colour.energy,
            lit: colour.lit,
            cosine,
            rank,
        }
    };
    Ok(colours.iter().zip(&seen).map(one).collect())
}

#[cfg(test)]
mod tests;
