//! Reflection product operators (RPO09 §4): from visibility and light to radiance towards a viewer,
//! for any reflectance, which can be exchanged while running.
//!
//! f(ω_i, ω_o) cos θ_i ≈ Σ_b U_b(ω_i) W_b(ω_o), with u_b and w_b their coefficients;
//! L(ω_o) = Σ_b (w_b · y(ω_o)) · l · (M_b v), with M_b the product matrix of u_b. All of it is in the
//! tangent frame: +Z is the normal, +X the tangent.

#[cfg(feature = "bake")]
mod build;
mod file;
mod global;
mod many;
mod reflector;

#[cfg(feature = "bake")]
pub use build::{Colours, Cosine, Factored, Factoring, factor, factor_by};
pub use file::{ReflectorError, ReflectorHeader};
pub use global::GlobalReflector;
pub use many::ShadedPoints;
pub use reflector::Reflector;

use crate::sh::{MAX_COEFFICIENTS, Order, Rotation, TripleProduct, evaluate_f64};

/// The most terms of an operator.
const MOST_TERMS: usize = MAX_COEFFICIENTS;

/// An operator of one colour: k view factors and k product matrices, k·n²(1 + n²) numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct ReflectionOperator {
    order: Order,
    /// `[b][i]`
    view: Vec<f64>,
    /// `[b][i][j]`
    matrices: Vec<f64>,
}

impl ReflectionOperator {
    /// The operator of light factors (`[b][i]`, of order `light_order`) and view factors (`[b][i]`,
    /// of order `order`, as visibility and light are).
    ///
    /// A product of functions of order n has order 2n − 1, so light factors of that order lose
    /// nothing between light and visibility.
    ///
    /// # Panics
    /// If the two do not hold the same number of factors.
    #[must_use]
    pub fn new(order: Order, light_order: Order, light: &[f64], view: &[f64]) -> Self {
        let count = order.coefficients();
        let light = light.chunks_exact(light_order.coefficients());
        assert_eq!(light.len() * count, view.len(), "light and view factors");
        let gamma = TripleProduct::new(light_order, order, order);
        let mut matrices = vec![0.0; light.len() * count * count];
        for (light, matrix) in light.zip(matrices.chunks_exact_mut(count * count)) {
            gamma.matrix_f64(light, matrix);
        }
        Self { order, view: view.to_vec(), matrices }
    }

    /// M_b A in place of M_b: an operator A of n² × n² numbers, row by row, that visibility meets
    /// first.
    ///
    /// # Panics
    /// If A has not that size.
    #[must_use]
    pub fn after(mut self, first: &[f64]) -> Self {
        let count = self.order.coefficients();
        assert_eq!(first.len(), count * count, "entries of an operator");
        let mut product = [0.0; MAX_COEFFICIENTS];
        for row in self.matrices.chunks_exact_mut(count) {
            product.fill(0.0);
            for (m, first) in row.iter().zip(first.chunks_exact(count)) {
                product.iter_mut().zip(first).for_each(|(sum, a)| *sum += m * a);
            }
            row.copy_from_slice(&product[..count]);
        }
        self
    }

    /// The operator in a turned frame: w_b and M_b as that frame has them.
    ///
    /// # Panics
    /// If the rotation is of another order.
    #[must_use]
    pub fn turned(&self, rotation: &Rotation) -> Self {
        assert_eq!(rotation.order(), self.order, "orders of operator and rotation");
        let count = self.order.coefficients();
        let mut this = self.clone();
        for (view, turned) in self.view.chunks_exact(count).zip(this.view.chunks_exact_mut(count)) {
            rotation.apply_f64(view, turned);
        }
        this.matrices.chunks_exact_mut(count * count).for_each(|m| rotation.turn_matrix(m));
        this
    }

    /// The order of visibility and light.
    #[must_use]
    pub fn order(&self) -> Order {
        self.order
    }

    /// k.
    #[must_use]
    pub fn terms(&self) -> usize {
        self.view.len() / self.order.coefficients()
    }

    /// `[b][i]`, k · n² numbers.
    #[must_use]
    pub fn view(&self) -> &[f64] {
        &self.view
    }

    /// `[b][i][j]`, k · n⁴ numbers; each matrix is symmetric where the cosine is inside.
    #[must_use]
    pub fn matrices(&self) -> &[f64] {
        &self.matrices
    }

    /// t with L(ω_o) = l · t: the transfer towards a unit direction of the tangent frame, by
    /// visibility there.
    ///
    /// # Panics
    /// If a slice is shorter than n².
    pub fn transfer(&self, visibility: &[f64], outgoing: [f64; 3], out: &mut [f64]) {
        let count = self.order.coefficients();
        let (visibility, out) = (&visibility[..count], &mut out[..count]);
        let mut y = [0.0; MAX_COEFFICIENTS];
        evaluate_f64(self.order, outgoing, &mut y);
        out.fill(0.0);
        let terms = self.view.chunks_exact(count).zip(self.matrices.chunks_exact(count * count));
        for (view, matrix) in terms {
            let strength: f64 = view.iter().zip(&y).map(|(w, y)| w * y).sum();
            for (out, row) in out.iter_mut().zip(matrix.chunks_exact(count)) {
                let product: f64 = row.iter().zip(visibility).map(|(m, v)| m * v).sum();
                *out += strength * product;
            }
        }
    }
}
