//! Products of functions on the sphere, by the sparse tensor Γ_ijk = ∫ y_i y_j y_k dω.
//!
//! A harmonic is a function of z times cos mφ or sin |m|φ, so Γ is a product of two integrals. The
//! one over φ is ±π/2 times a count, and mostly zero; the one over z is of a polynomial, because
//! where the other is not zero the three |m| add up to an even number. Zeros are known from whole
//! numbers alone (the azimuth's selection rule, parity, the triangle of the bands), not from a
//! threshold on rounded sums.

use std::f64::consts::PI;

use super::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate_f64, gauss_legendre};

/// Nodes that integrate polynomials of degree 3 · 9 exactly.
const NODES: usize = 3 * (MAX_BANDS - 1) / 2 + 1;

/// Room for every coefficient, a power of two so that a masked index needs no check.
const ROOM: usize = MAX_COEFFICIENTS.next_power_of_two();

/// The tensor Γ_ijk for i below n_out², j below n_a² and k below n_b²: products a · b of functions
/// of two orders, projected to a third.
///
/// The product of orders n_a and n_b has order n_a + n_b − 1; what `out` has fewer is cut off, and
/// that is the only approximation. Values are exact to f64 round-off (RPO09 §3; Ren et al. 2006).
#[derive(Debug, Clone)]
pub struct TripleProduct {
    a: Order,
    b: Order,
    out: Order,
    /// `ends[i]` is where the entries of output i end.
    ends: Vec<u32>,
    /// j and k of each entry.
    pairs: Vec<[u8; 2]>,
    values_f64: Vec<f64>,
    values_f32: Vec<f32>,
}

/// Band and degree of a flat index.
fn band_and_degree(i: usize) -> (usize, isize) {
    let l = i.isqrt();
    (l, i as isize - (l * (l + 1)) as isize)
}

/// ∫₀^{2π} t_a t_b t_c dφ in units of π/2, where t_m is cos mφ for m ≥ 0 and sin |m|φ below.
fn azimuth(degrees: [isize; 3]) -> i32 {
    let mut sorted = degrees;
    sorted.sort_unstable();
    let [first, second, third] = sorted.map(|m| m.unsigned_abs() as isize);
    let is_zero = |sum: isize| i32::from(sum == 0);
    let (all, odd_first, odd_second, odd_third) = (
        is_zero(first + second + third),
        is_zero(second + third - first),
        is_zero(first + third - second),
        is_zero(first + second - third),
    );
    match sorted.iter().filter(|m| **m < 0).count() {
        0 => all + odd_first + odd_second + odd_third,
        // sin · sin · cos, the two sines first.
        2 => odd_first + odd_second - odd_third - all,
        _ => 0,
    }
}

/// The parts of the harmonics that depend on z, at the nodes, with their weights.
struct Meridian {
    weights: [f64; NODES],
    /// `[l(l+1)+m][node]`, for m ≥ 0.
    values: Vec<[f64; NODES]>,
}

impl Meridian {
    fn new() -> Self {
        let order = Order::new(MAX_BANDS as u8).expect("the largest order is an order");
        let mut this = Self { weights: [0.0; NODES], values: vec![[0.0; NODES]; MAX_COEFFICIENTS] };
        let mut y = [0.0; MAX_COEFFICIENTS];
        for (node, (z, weight)) in gauss_legendre(NODES).into_iter().enumerate() {
            this.weights[node] = weight;
            // On the meridian φ = 0 every cosine is 1.
            evaluate_f64(order, [(1.0 - z * z).max(0.0).sqrt(), 0.0, z], &mut y);
            for (row, y) in this.values.iter_mut().zip(&y) {
                row[node] = *y;
            }
        }
        this
    }

    /// ∫ over z of three of them, by band and degree; the degree's sign is not looked at.
    fn integral(&self, harmonics: [(usize, isize); 3]) -> f64 {
        let [a, b, c] = harmonics.map(|(l, m)| &self.values[l * (l + 1) + m.unsigned_abs()]);
        (0..NODES).map(|node| self.weights[node] * a[node] * b[node] * c[node]).sum()
    }
}

/// Whether the bands allow a product: a triangle with an even sum.
fn bands_allow([a, b, c]: [usize; 3]) -> bool {
    (a + b + c).is_multiple_of(2) && a.abs_diff(b) <= c && c <= a + b
}

/// The operations in one precision.
macro_rules! operations {
    ($float:ty, $values:ident, $product:ident, $integral:ident, $matrix:ident) => {
        /// The product's coefficients (a·b)_i = Σ_jk Γ_ijk a_j b_k: n_out² numbers.
        ///
        /// # Panics
        /// If a slice is shorter than its order asks for.
        pub fn $product(&self, a: &[$float], b: &[$float], out: &mut [$float]) {
            let (mut left, mut right) = ([0.0; ROOM], [0.0; ROOM]);
            left[..self.a.coefficients()].copy_from_slice(&a[..self.a.coefficients()]);
            right[..self.b.coefficients()].copy_from_slice(&b[..self.b.coefficients()]);
            let mut start = 0;
            for (out, &end) in out[..self.out.coefficients()].iter_mut().zip(&self.ends) {
                let range = start..end as usize;
                let entries = self.pairs[range.clone()].iter().zip(&self.$values[range]);
                *out = entries.fold(0.0, |sum, ([j, k], value)| {
                    let (j, k) = (usize::from(*j) % ROOM, usize::from(*k) % ROOM);
                    sum + value * left[j] * right[k]
                });
                start = end as usize;
            }
        }

        /// ∫ a b c dω = Σ_ijk Γ_ijk c_i a_j b_k, with c of the order of the output.
        ///
        /// # Panics
        /// If a slice is shorter than its order asks for.
        #[must_use]
        pub fn $integral(&self, a: &[$float], b: &[$float], c: &[$float]) -> $float {
            let mut product = [0.0; MAX_COEFFICIENTS];
            self.$product(a, b, &mut product);
            let count = self.out.coefficients();
            product[..count].iter().zip(&c[..count]).map(|(p, c)| p * c).sum()
        }

        /// The matrix that multiplies functions by a, M_ik = Σ_j Γ_ijk a_j: n_out² rows of n_b².
        /// Symmetric where those orders agree.
        ///
        /// # Panics
        /// If a slice is shorter than that.
        pub fn $matrix(&self, a: &[$float], out: &mut [$float]) {
            let columns = self.b.coefficients();
            let out = &mut out[..self.out.coefficients() * columns];
            out.fill(0.0);
            let mut start = 0;
            for (row, &end) in out.chunks_exact_mut(columns).zip(&self.ends) {
                let range = start..end as usize;
                for ([j, k], value) in self.pairs[range.clone()].iter().zip(&self.$values[range]) {
                    row[usize::from(*k)] += value * a[usize::from(*j)];
                }
                start = end as usize;
            }
        }
    };
}

impl TripleProduct {
    /// The tensor for factors of orders `a` and `b` and a product of order `out`; some
    /// milliseconds at the largest orders.
    #[must_use]
    pub fn new(a: Order, b: Order, out: Order) -> Self {
        let meridian = Meridian::new();
        let mut this = Self {
            a,
            b,
            out,
            ends: Vec::with_capacity(out.coefficients()),
            pairs: Vec::new(),
            values_f64: Vec::new(),
            values_f32: Vec::new(),
        };
        for i in 0..out.coefficients() {
            for j in 0..a.coefficients() {
                for k in 0..b.coefficients() {
                    let harmonics = [i, j, k].map(band_and_degree);
                    let turns = azimuth(harmonics.map(|(_, m)| m));
                    if turns == 0 || !bands_allow(harmonics.map(|(l, _)| l)) {
                        continue;
                    }
                    let value = PI / 2.0 * f64::from(turns) * meridian.integral(harmonics);
                    this.pairs.push([j as u8, k as u8]);
                    this.values_f64.push(value);
                    this.values_f32.push(value as f32);
                }
            }
            this.ends.push(this.pairs.len() as u32);
        }
        this
    }

    /// The order of the product in full, where it is one of ours: n_a + n_b − 1, at most 10.
    #[must_use]
    pub fn full_order(a: Order, b: Order) -> Option<Order> {
        Order::new(a.get() + b.get() - 1).ok()
    }

    /// Orders of the two factors and of the product.
    #[must_use]
    pub fn orders(&self) -> [Order; 3] {
        [self.a, self.b, self.out]
    }

    /// How many entries are kept.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.pairs.len()
    }

    /// Every entry as (i, j, k, Γ_ijk), i of the product, j and k of the factors.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize, usize, f64)> {
        let rows = self.ends.iter().enumerate().flat_map(|(i, &end)| {
            let start = if i == 0 { 0 } else { self.ends[i - 1] };
            std::iter::repeat_n(i, (end - start) as usize)
        });
        let entries = self.pairs.iter().zip(&self.values_f64);
        rows.zip(entries).map(|(i, ([j, k], value))| (i, usize::from(*j), usize::from(*k), *value))
    }

    operations!(f32, values_f32, product, integral, matrix);
    operations!(f64, values_f64, product_f64, integral_f64, matrix_f64);
}

#[cfg(test)]
mod tests {
    use super::super::quadrature::zone;
    use super::*;

    fn order(bands: u8) -> Order {
        Order::new(bands).unwrap()
    }

    fn coefficients(bands: u8, phase: f64) -> Vec<f64> {
        (0..usize::from(bands).pow(2)).map(|i| (i as f64 * 1.7 + phase).sin()).collect()
    }

    /// ∫ f y_i dω of the pointwise product f = a·b, by quadrature that is exact up to its degree.
    fn product_by_integration(a: &[f64], b: &[f64], out: Order) -> Vec<f64> {
        let mut sum = vec![0.0; out.coefficients()];
        let mut y = [0.0; MAX_COEFFICIENTS];
        for (direction, weight) in zone(16, -1.0, 1.0) {
            evaluate_f64(order(10), direction, &mut y);
            let value = |c: &[f64]| c.iter().zip(&y).map(|(c, y)| c * y).sum::<f64>();
            let f = weight * value(a) * value(b);
            sum.iter_mut().zip(&y).for_each(|(s, y)| *s += f * y);
        }
        sum
    }

    /// Products of every mix of orders, the largest included, are the projection of the pointwise
    /// product over the whole sphere; so are the integral of three and the matrix's rows.
    #[test]
    fn products_agree_with_integration() {
        for (na, nb, no) in [(1, 1, 1), (2, 3, 4), (4, 4, 4), (6, 2, 7), (3, 10, 5), (10, 10, 10)] {
            let gamma = TripleProduct::new(order(na), order(nb), order(no));
            let (a, b) = (coefficients(na, 0.3), coefficients(nb, 1.1));
            let expected = product_by_integration(&a, &b, order(no));
            let mut found = vec![0.0; expected.len()];
            gamma.product_f64(&a, &b, &mut found);
            let mut matrix = vec![0.0; expected.len() * b.len()];
            gamma.matrix_f64(&a, &mut matrix);
            for (i, row) in matrix.chunks_exact(b.len()).enumerate() {
                assert!((found[i] - expected[i]).abs() < 1e-12, "{na} {nb} {no}: {i}");
                let by_matrix: f64 = row.iter().zip(&b).map(|(m, b)| m * b).sum();
                assert!((by_matrix - expected[i]).abs() < 1e-12, "{na} {nb} {no}: row {i}");
            }
            let c = coefficients(no, 2.9);
            let integral: f64 = expected.iter().zip(&c).map(|(e, c)| e * c).sum();
            assert!((gamma.integral_f64(&a, &b, &c) - integral).abs() < 1e-11, "{na} {nb} {no}");
        }
    }

    /// f32 follows f64 to the rounding of its sums.
    #[test]
    fn f32_follows_f64() {
        let gamma = TripleProduct::new(order(10), order(10), order(10));
        let [a, b, c] = [0.3, 1.1, 2.9].map(|phase| coefficients(10, phase));
        let [af, bf, cf] = [&a, &b, &c].map(|v| v.iter().map(|&x| x as f32).collect::<Vec<f32>>());
        let (mut exact, mut fast) = (vec![0.0; 10_000], vec![0.0; 10_000]);
        gamma.product_f64(&a, &b, &mut exact);
        gamma.product(&af, &bf, &mut fast);
        let scale = exact[..100].iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let close = |a: f64, b: f32, scale: f64| (a - f64::from(b)).abs() < 2e-6 * scale;
        assert!(exact[..100].iter().zip(&fast).all(|(a, b)| close(*a, *b, scale)));
        let integral = gamma.integral_f64(&a, &b, &c);
        assert!(close(integral, gamma.integral(&af, &bf, &cf), 10.0 * scale));
        gamma.matrix_f64(&a, &mut exact);
        gamma.matrix(&af, &mut fast);
        assert!(exact.iter().zip(&fast).all(|(a, b)| close(*a, *b, scale)));
    }

    /// Single entries, kept and left out, are the integrals of three harmonics; the tensor is
    /// symmetric under every exchange of its indices.
    #[test]
    fn entries_are_integrals_of_three_harmonics() {
        let gamma = TripleProduct::new(order(5), order(5), order(5));
        let mut dense = vec![0.0; 25 * 25 * 25];
        for (i, j, k, value) in gamma.iter() {
            dense[(i * 25 + j) * 25 + k] = value;
        }
        let mut exact = vec![0.0; 25 * 25 * 25];
        let mut y = [0.0; 25];
        for (direction, weight) in zone(8, -1.0, 1.0) {
            evaluate_f64(order(5), direction, &mut y);
            for (pair, row) in exact.chunks_exact_mut(25).enumerate() {
                let two = weight * y[pair / 25] * y[pair % 25];
                row.iter_mut().zip(&y).for_each(|(e, y)| *e += two * y);
            }
        }
        for i in 0..25 {
            for j in 0..25 {
                for k in 0..25 {
                    let at = |i: usize, j: usize, k: usize| (i * 25 + j) * 25 + k;
                    let here = dense[at(i, j, k)];
                    assert!((here - exact[at(i, j, k)]).abs() < 1e-14, "{i} {j} {k}");
                    assert!((here - dense[at(k, i, j)]).abs() < 1e-15, "{i} {j} {k}");
                    assert!((here - dense[at(j, i, k)]).abs() < 1e-15, "{i} {j} {k}");
                }
            }
        }
        assert_eq!(gamma.entries(), gamma.iter().count());
        assert!(gamma.entries() * 12 < dense.len(), "{} entries", gamma.entries());
    }

    /// Multiplying by the constant function 1 changes nothing; a full product loses no energy:
    /// its value is the product of the values, everywhere.
    #[test]
    fn full_products_are_pointwise() {
        let full = TripleProduct::full_order(order(4), order(6)).unwrap();
        assert_eq!(full, order(9));
        assert_eq!(TripleProduct::full_order(order(6), order(6)), None);
        let gamma = TripleProduct::new(order(4), order(6), full);
        let (a, b) = (coefficients(4, 0.2), coefficients(6, 0.9));
        let (mut product, mut y) = ([0.0; 81], [0.0; 81]);
        gamma.product_f64(&a, &b, &mut product);
        for direction in [[0.36, -0.48, 0.8], [0.0, 0.0, -1.0], [-0.6, 0.8, 0.0]] {
            evaluate_f64(full, direction, &mut y);
            let value = |c: &[f64]| c.iter().zip(&y).map(|(c, y)| c * y).sum::<f64>();
            assert!((value(&product) - value(&a) * value(&b)).abs() < 1e-12);
        }
        let one = [(4.0 * PI).sqrt()];
        let identity = TripleProduct::new(order(1), order(6), order(6));
        let mut same = [0.0; 36];
        identity.product_f64(&one, &b, &mut same);
        assert!(same.iter().zip(&b).all(|(s, b)| (s - b).abs() < 1e-14));
        assert_eq!(identity.orders(), [order(1), order(6), order(6)]);
    }
}
