//! Logarithms and exponentials of zonal functions, by their product matrices.

use crate::sh::{MAX_BANDS, Order, TripleProduct, index};

/// Visibilities below this have the logarithm of this: what keeps logarithms of what cannot be
/// seen at all finite. Two such spheres leave a ten-thousandth.
pub(super) const DARKEST: f64 = 0.01;

/// A symmetric matrix of at most [`MAX_BANDS`] rows as Q diag(d) Qᵀ.
pub(super) struct Spectrum {
    size: usize,
    values: [f64; MAX_BANDS],
    /// `[row][column]`, eigenvectors in columns.
    vectors: [[f64; MAX_BANDS]; MAX_BANDS],
}

impl Spectrum {
    /// Jacobi's rotations until nothing is left beside the diagonal.
    fn new(mut a: [[f64; MAX_BANDS]; MAX_BANDS], size: usize) -> Self {
        let mut vectors = [[0.0; MAX_BANDS]; MAX_BANDS];
        (0..size).for_each(|i| vectors[i][i] = 1.0);
        for _ in 0..60 {
            let pairs = || (0..size).flat_map(|p| (p + 1..size).map(move |q| (p, q)));
            if pairs().all(|(p, q)| a[p][q].abs() < 1e-15) {
                break;
            }
            for (p, q) in pairs() {
                rotate(&mut a, &mut vectors, size, (p, q));
            }
        }
        Self { size, values: std::array::from_fn(|i| a[i][i]), vectors }
    }

    /// Q diag(f(d)) Qᵀ x.
    pub(super) fn apply(&self, f: impl Fn(f64) -> f64, x: &[f64; MAX_BANDS]) -> [f64; MAX_BANDS] {
        let mut out = [0.0; MAX_BANDS];
        for k in 0..self.size {
            let along: f64 = (0..self.size).map(|i| self.vectors[i][k] * x[i]).sum();
            let scaled = f(self.values[k]) * along;
            (0..self.size).for_each(|i| out[i] += scaled * self.vectors[i][k]);
        }
        out
    }
}

/// One rotation that makes a[p][q] zero.
fn rotate(
    a: &mut [[f64; MAX_BANDS]; MAX_BANDS],
    vectors: &mut [[f64; MAX_BANDS]; MAX_BANDS],
    size: usize,
    (p, q): (usize, usize),
) {
    if a[p][q] == 0.0 {
        return;
    }
    let ratio = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let tan = ratio.signum() / (ratio.abs() + (ratio * ratio + 1.0).sqrt());
    let cos = 1.0 / (tan * tan + 1.0).sqrt();
    let sin = tan * cos;
    for row in a.iter_mut().take(size) {
        let (x, y) = (row[p], row[q]);
        (row[p], row[q]) = (cos * x - sin * y, sin * x + cos * y);
    }
    let (above, below) = (a[p], a[q]);
    for (k, (x, y)) in above.iter().zip(below).enumerate().take(size) {
        (a[p][k], a[q][k]) = (cos * x - sin * y, sin * x + cos * y);
    }
    for row in vectors.iter_mut().take(size) {
        let (x, y) = (row[p], row[q]);
        (row[p], row[q]) = (cos * x - sin * y, sin * x + cos * y);
    }
}

/// The function 1.
pub(super) fn one() -> [f64; MAX_BANDS] {
    let mut out = [0.0; MAX_BANDS];
    out[0] = (4.0 * std::f64::consts::PI).sqrt();
    out
}

/// Products of zonal functions of an order.
#[derive(Debug, Clone)]
pub(super) struct Zonal {
    size: usize,
    /// Γ among the harmonics of degree 0: row, factor, column, value.
    products: Vec<(usize, usize, usize, f64)>,
}

impl Zonal {
    pub(super) fn new(order: Order) -> Self {
        let gamma = TripleProduct::new(order, order, order);
        let band = |i: usize| (i == index(i.isqrt(), 0)).then(|| i.isqrt());
        let zonal = |(i, j, k, value)| Some((band(i)?, band(j)?, band(k)?, value));
        Self { size: order.bands(), products: gamma.iter().filter_map(zonal).collect() }
    }

    /// The product matrix of a zonal function among zonal functions.
    fn spectrum(&self, function: &[f64; MAX_BANDS]) -> Spectrum {
        let mut matrix = [[0.0; MAX_BANDS]; MAX_BANDS];
        for &(i, j, k, value) in &self.products {
            matrix[i][k] += value * function[j];
        }
        Spectrum::new(matrix, self.size)
    }

    /// log(M_v)(M_v − 1)⁻¹(v − 1), eigenvalues below [`DARKEST`] taken as that.
    pub(super) fn log(&self, visibility: &[f64; MAX_BANDS]) -> [f64; MAX_BANDS] {
        let mut less = *visibility;
        less[0] -= one()[0];
        let slope = |d: f64| {
            let less = d.max(DARKEST) - 1.0;
            if less == 0.0 { 1.0 } else { less.ln_1p() / less }
        };
        self.spectrum(visibility).apply(slope, &less)
    }

    /// exp(M_g) 1.
    pub(super) fn exp(&self, log: &[f64; MAX_BANDS]) -> [f64; MAX_BANDS] {
        self.spectrum(log).apply(f64::exp, &one())
    }
}
