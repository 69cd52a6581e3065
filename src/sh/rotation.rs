//! Rotation of coefficient vectors.
//!
//! Every rotation is Z(α)·Y(β)·Z(γ), and Y(β) = J·Z(−β)·J with J the exchange of the y and z axes
//! (Pinchon and Hoggan 2007). Z turns each pair (m, −m) by mα, J is a constant matrix of which a
//! quarter is non-zero: cheaper to apply than the block-diagonal matrices of Ivanic and Ruedenberg
//! are to build, and without their recurrence over bands there is nothing to accumulate error.

use std::sync::LazyLock;

use glam::Quat;

use super::quadrature::zone;
use super::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate_f64};

/// The non-zero entries of J, row by row over all bands.
struct Exchange {
    /// `ends[i]..ends[i + 1]` are the entries of row i.
    ends: [u16; MAX_COEFFICIENTS + 1],
    columns: Vec<u8>,
    values_f64: Vec<f64>,
    values_f32: Vec<f32>,
}

/// J_ij = ∫ y_i(x, y, z) y_j(x, z, y) dω, by quadrature that is exact for these polynomials.
static EXCHANGE: LazyLock<Exchange> = LazyLock::new(|| {
    let order = Order::new(MAX_BANDS as u8).expect("the largest order is an order");
    let mut dense = vec![0.0_f64; MAX_COEFFICIENTS * MAX_COEFFICIENTS];
    let (mut plain, mut swapped) = ([0.0; MAX_COEFFICIENTS], [0.0; MAX_COEFFICIENTS]);
    for ([x, y, z], weight) in zone(MAX_BANDS, -1.0, 1.0) {
        evaluate_f64(order, [x, y, z], &mut plain);
        evaluate_f64(order, [x, z, y], &mut swapped);
        for i in 0..MAX_COEFFICIENTS {
            for j in band_of(i) {
                dense[i * MAX_COEFFICIENTS + j] += weight * plain[i] * swapped[j];
            }
        }
    }
    let mut table = Exchange {
        ends: [0; MAX_COEFFICIENTS + 1],
        columns: Vec::new(),
        values_f64: Vec::new(),
        values_f32: Vec::new(),
    };
    for i in 0..MAX_COEFFICIENTS {
        for j in band_of(i) {
            let value = dense[i * MAX_COEFFICIENTS + j];
            // True entries are at least 1e-3; what symmetry forbids is round-off.
            if value.abs() > 1e-9 {
                table.columns.push(j as u8);
                table.values_f64.push(value);
                table.values_f32.push(value as f32);
            }
        }
        table.ends[i + 1] = table.columns.len() as u16;
    }
    table
});

/// The coefficients that share a band with coefficient `i`.
fn band_of(i: usize) -> std::ops::Range<usize> {
    let l = i.isqrt();
    l * l..(l + 1) * (l + 1)
}

/// cos(mα) and sin(mα) for m = 0..n-1, in both precisions.
#[derive(Debug, Clone, Copy)]
struct Turn {
    f64: [[f64; 2]; MAX_BANDS],
    f32: [[f32; 2]; MAX_BANDS],
}

impl Turn {
    const NONE: Self = Self { f64: [[1.0, 0.0]; MAX_BANDS], f32: [[1.0, 0.0]; MAX_BANDS] };

    fn set(&mut self, bands: usize, [cos, sin]: [f64; 2]) {
        for m in 1..bands {
            let [c, s] = self.f64[m - 1];
            self.f64[m] = [c * cos - s * sin, s * cos + c * sin];
            self.f32[m] = self.f64[m].map(|x| x as f32);
        }
    }
}

/// The rotation of functions on the sphere, f'(ω) = f(R⁻¹ω), acting on their coefficients.
///
/// Fixed size, no allocation: keep one and [`set`](Self::set) it anew for every rotation.
/// Exact up to round-off (about 5e-7 of the vector's norm in f32).
#[derive(Debug, Clone)]
pub struct Rotation {
    order: Order,
    /// Z(γ), Z(−β), Z(α), in the order in which they act.
    turns: [Turn; 3],
}

/// The five factors in one pass each, in one precision.
macro_rules! apply {
    ($name:ident, $float:ty, $turn:ident, $values:ident, $exchange:ident, $turned:ident) => {
        fn $turned(turn: &[[$float; 2]; MAX_BANDS], bands: usize, data: &mut [$float]) {
            for l in 1..bands {
                let (negative, rest) = data[l * l..(l + 1) * (l + 1)].split_at_mut(l);
                let positive = &mut rest[1..];
                let turns = &turn[1..=l];
                for ((s, c), [cos, sin]) in negative.iter_mut().rev().zip(positive).zip(turns) {
                    (*c, *s) = (*c * cos - *s * sin, *c * sin + *s * cos);
                }
            }
        }

        fn $exchange(bands: usize, input: &[$float], output: &mut [$float]) {
            let table = &*EXCHANGE;
            let mut start = 0;
            for (i, out) in output[..bands * bands].iter_mut().enumerate() {
                let end = usize::from(table.ends[i + 1]);
                let mut sum = 0.0;
                for (column, value) in
                    table.columns[start..end].iter().zip(&table.$values[start..end])
                {
                    sum += value * input[usize::from(*column)];
                }
                *out = sum;
                start = end;
            }
        }

        /// The coefficients of the rotated function: n² numbers in, n² numbers out.
        ///
        /// # Panics
        /// If a slice is shorter than n².
        pub fn $name(&self, input: &[$float], output: &mut [$float]) {
            let bands = self.order.bands();
            let count = self.order.coefficients();
            let mut a = [0.0; MAX_COEFFICIENTS];
            let mut b = [0.0; MAX_COEFFICIENTS];
            a[..count].copy_from_slice(&input[..count]);
            Self::$turned(&self.turns[0].$turn, bands, &mut a);
            Self::$exchange(bands, &a, &mut b);
            Self::$turned(&self.turns[1].$turn, bands, &mut b);
            let output = &mut output[..count];
            Self::$exchange(bands, &b, output);
            Self::$turned(&self.turns[2].$turn, bands, output);
        }
    };
}

impl Rotation {
    /// The rotation that changes nothing.
    #[must_use]
    pub fn identity(order: Order) -> Self {
        Self { order, turns: [Turn::NONE; 3] }
    }

    /// The rotation by `rotation`, which need not be normalised.
    ///
    /// # Panics
    /// If the quaternion is zero or not finite.
    #[must_use]
    pub fn new(order: Order, rotation: Quat) -> Self {
        let mut this = Self::identity(order);
        this.set(rotation);
        this
    }

    /// Becomes the rotation by `rotation`, which need not be normalised.
    ///
    /// # Panics
    /// If the quaternion is zero or not finite.
    pub fn set(&mut self, rotation: Quat) {
        self.set_f64(rotation.to_array().map(f64::from));
    }

    /// [`set`](Self::set) from (x, y, z, w) in f64.
    ///
    /// # Panics
    /// If the quaternion is zero or not finite.
    pub fn set_f64(&mut self, [x, y, z, w]: [f64; 4]) {
        // With R = Z(α)Y(β)Z(γ): w + iz = cos(β/2)·e^{i(α+γ)/2}, y − ix = sin(β/2)·e^{i(α−γ)/2}.
        let (along, across) = (w * w + z * z, x * x + y * y);
        let norm = along + across;
        assert!(norm.is_finite() && norm > 0.0, "quaternion ({x}, {y}, {z}, {w}) rotates nothing");
        let unit = |re: f64, im: f64, square: f64| {
            if square > 0.0 {
                let length = square.sqrt();
                [re / length, im / length]
            } else {
                // At a pole only the sum (or the difference) of α and γ counts.
                [1.0, 0.0]
            }
        };
        let [pc, ps] = unit(w, z, along);
        let [dc, ds] = unit(y, -x, across);
        let alpha = [pc * dc - ps * ds, ps * dc + pc * ds];
        let gamma = [pc * dc + ps * ds, ps * dc - pc * ds];
        let beta = [(along - across) / norm, -2.0 * (along * across).sqrt() / norm];
        let bands = self.order.bands();
        self.turns[0].set(bands, gamma);
        self.turns[1].set(bands, beta);
        self.turns[2].set(bands, alpha);
    }

    /// The order that it was made for.
    #[must_use]
    pub fn order(&self) -> Order {
        self.order
    }

    apply!(apply, f32, f32, values_f32, exchange_f32, turn_f32);
    apply!(apply_f64, f64, f64, values_f64, exchange_f64, turn_f64);
}

#[cfg(test)]
mod tests;
