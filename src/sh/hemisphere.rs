//! Products over a hemisphere, where the harmonics are not orthonormal: with weight 1 and with the
//! cosine.

use glam::Vec3;

use super::quadrature::zone;
use super::{MAX_BANDS, MAX_COEFFICIENTS, Order, Rotation, evaluate_f64};

/// G(+Z)_ij = ∫_{z ≥ 0} y_i y_j dω, an n² × n² symmetric matrix in row order.
///
/// Exact to f64 round-off: the integrand is a polynomial, the quadrature is exact for it. For many
/// normals it is cheaper to rotate the error vector into the pole's frame than to rotate G.
#[must_use]
pub fn hemisphere_gram_pole(order: Order) -> Vec<f64> {
    weighted(order, |_| 1.0)
}

/// G(n)_ij = ∫_{n·ω ≥ 0} y_i y_j dω, an n² × n² symmetric matrix in row order.
///
/// G(n) = D G(+Z) Dᵀ with D the rotation that takes +Z to `normal`.
///
/// # Panics
/// If `normal` is zero or not finite.
#[must_use]
pub fn hemisphere_gram(order: Order, normal: Vec3) -> Vec<f64> {
    let mut gram = hemisphere_gram_pole(order);
    from_pole(order, normal).turn_matrix(&mut gram);
    gram
}

/// C(+Z)_ij = ∫ y_i y_j (z)₊ dω (RPO09 eq. 14), an n² × n² symmetric matrix in row order: the
/// operator that multiplies functions of order n by the clamped cosine and keeps n bands.
///
/// Exact to f64 round-off. It is Γ contracted with the cosine's zonal coefficients, of which bands up
/// to 2n − 2 count; this way needs no more of them than there are.
#[must_use]
pub fn cosine_product_pole(order: Order) -> Vec<f64> {
    weighted(order, |z| z)
}

/// C(n)_ij = ∫ y_i y_j (n·ω)₊ dω: [`cosine_product_pole`] turned to a normal.
///
/// # Panics
/// If `normal` is zero or not finite.
#[must_use]
pub fn cosine_product(order: Order, normal: Vec3) -> Vec<f64> {
    let mut matrix = cosine_product_pole(order);
    from_pole(order, normal).turn_matrix(&mut matrix);
    matrix
}

/// ∫_{z ≥ 0} y_i y_j w(z) dω, for weights of degree 1 and less.
fn weighted(order: Order, weight: impl Fn(f64) -> f64) -> Vec<f64> {
    let count = order.coefficients();
    let mut matrix = vec![0.0; count * count];
    let mut y = [0.0; MAX_COEFFICIENTS];
    for (direction, area) in zone(MAX_BANDS + 1, 0.0, 1.0) {
        evaluate_f64(order, direction, &mut y);
        let share = area * weight(direction[2]);
        for (row, y_i) in matrix.chunks_exact_mut(count).zip(&y) {
            for (entry, y_j) in row.iter_mut().zip(&y) {
                *entry += share * y_i * y_j;
            }
        }
    }
    matrix
}

impl Rotation {
    /// D M Dᵀ in place: an operator on functions, n² × n² in row order, as the rotated frame has it.
    ///
    /// # Panics
    /// If the matrix has not that size.
    pub fn turn_matrix(&self, matrix: &mut [f64]) {
        let count = self.order().coefficients();
        assert_eq!(matrix.len(), count * count, "entries of an operator");
        let mut rotated = [0.0; MAX_COEFFICIENTS];
        // Rotating the rows gives M Dᵀ; after transposing, rotating the rows again gives D Mᵀ Dᵀ.
        for _ in 0..2 {
            for row in matrix.chunks_exact_mut(count) {
                self.apply_f64(row, &mut rotated);
                row.copy_from_slice(&rotated[..count]);
            }
            transpose(matrix, count);
        }
    }
}

fn transpose(matrix: &mut [f64], count: usize) {
    for i in 0..count {
        for j in 0..i {
            matrix.swap(i * count + j, j * count + i);
        }
    }
}

/// The shortest rotation that takes +Z to `normal`.
fn from_pole(order: Order, normal: Vec3) -> Rotation {
    let n = normal.as_dvec3();
    let length = n.length();
    assert!(length.is_finite() && length > 0.0, "normal {normal} has no direction");
    let [x, y, z] = (n / length).to_array();
    let mut rotation = Rotation::identity(order);
    if x == 0.0 && y == 0.0 && z < 0.0 {
        rotation.set_f64([1.0, 0.0, 0.0, 0.0]);
    } else {
        // (−y, x, 0, 1 + z), with 1 + z = (x² + y²)/(1 − z) where the sum would cancel.
        let w = if z < 0.0 { (x * x + y * y) / (1.0 - z) } else { 1.0 + z };
        rotation.set_f64([-y, x, 0.0, w]);
    }
    rotation
}

#[cfg(test)]
mod tests {
    use super::super::{TripleProduct, zonal};
    use super::*;

    /// Opposite hemispheres add up to the sphere, so G(n) + G(−n) = 1, for normals in all places,
    /// the poles and their neighbourhood included.
    #[test]
    fn opposite_hemispheres_make_the_sphere() {
        let order = Order::new(6).unwrap();
        for n in [
            Vec3::Z,
            Vec3::X,
            Vec3::NEG_Y,
            Vec3::new(0.36, -0.48, 0.8),
            Vec3::new(1e-6, -2e-7, -1.0),
        ] {
            let (up, down) = (hemisphere_gram(order, n), hemisphere_gram(order, -n));
            for i in 0..36 {
                for j in 0..36 {
                    let sum = up[i * 36 + j] + down[i * 36 + j];
                    let expected = f64::from(u8::from(i == j));
                    assert!((sum - expected).abs() < 1e-12, "{n}: {i} {j} {sum}");
                }
            }
        }
    }

    /// The squared norm over a hemisphere agrees with a plain sum over many directions.
    #[test]
    fn norm_agrees_with_direct_integration() {
        let order = Order::new(4).unwrap();
        let normal = Vec3::new(0.6, 0.0, -0.8);
        let gram = hemisphere_gram(order, normal);
        let f: Vec<f64> = (0..16).map(|i| (f64::from(i) * 1.3).cos()).collect();
        let quadratic: f64 = (0..16)
            .flat_map(|i| (0..16).map(move |j| (i, j)))
            .map(|(i, j)| f[i] * gram[i * 16 + j] * f[j])
            .sum();
        let mut sum = 0.0;
        let mut y = [0.0; 16];
        for (direction, weight) in zone(400, -1.0, 1.0) {
            evaluate_f64(order, direction, &mut y);
            let n = normal.as_dvec3().normalize();
            if n.dot(glam::DVec3::from_array(direction)) >= 0.0 {
                let value: f64 = f.iter().zip(&y).map(|(a, b)| a * b).sum();
                sum += weight * value * value;
            }
        }
        assert!((sum - quadratic).abs() < 2e-3 * quadratic, "{sum} {quadratic}");
    }

    /// The constant's entry is half the sphere's: 1/2.
    #[test]
    fn constant_entry_is_one_half() {
        let gram = hemisphere_gram(Order::new(1).unwrap(), Vec3::new(0.0, 3.0, 4.0));
        assert!((gram[0] - 0.5).abs() < 1e-14);
    }

    /// The cosine's product matrix is the projection of the pointwise product for any normal, and its
    /// zonal form, Γ with the clamped cosine's coefficients, agrees as far as there are bands of those;
    /// an operator without symmetry turns as its own image does.
    #[test]
    fn the_cosine_multiplies_as_it_does_pointwise() {
        let order = Order::new(5).unwrap();
        let gamma = TripleProduct::new(Order::new(9).unwrap(), order, order);
        let normal = Vec3::new(0.36, -0.48, 0.8);
        let mut cosine = [0.0; 81];
        let zonal = zonal::clamped_cosine(Order::new(9).unwrap());
        let axis = normal.as_dvec3().normalize().to_array();
        zonal::rotate_f64(Order::new(9).unwrap(), &zonal, axis, &mut cosine);
        let mut expected = vec![0.0; 625];
        gamma.matrix_f64(&cosine, &mut expected);
        for (a, b) in cosine_product(order, normal).iter().zip(&expected) {
            assert!((a - b).abs() < 1e-7, "{a} {b}");
        }
        let q = glam::Quat::from_xyzw(0.2, -0.5, 0.3, 0.7).normalize();
        let rotation = Rotation::new(order, q);
        let mut matrix: Vec<f64> = (0..625).map(|i| (f64::from(i) * 0.7).sin()).collect();
        let f: Vec<f64> = (0..25).map(|i| (f64::from(i) * 1.3).cos()).collect();
        let times = |matrix: &[f64], f: &[f64]| -> Vec<f64> {
            let dot = |row: &[f64]| row.iter().zip(f).map(|(m, f)| m * f).sum();
            matrix.chunks_exact(25).map(dot).collect()
        };
        let (mut image, mut turned) = ([0.0; 25], [0.0; 25]);
        rotation.apply_f64(&times(&matrix, &f), &mut image);
        rotation.apply_f64(&f, &mut turned);
        rotation.turn_matrix(&mut matrix);
        for (a, b) in times(&matrix, &turned).iter().zip(&image) {
            assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
    }
}
