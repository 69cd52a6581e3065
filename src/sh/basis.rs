//! The basis functions y_i(ω), evaluated without trigonometry.

use std::sync::LazyLock;

use glam::Vec3;

use super::{MAX_BANDS, Order};

/// Constants of the normalised Legendre recurrence, in the order in which it consumes them.
///
/// With Q_l^m = √2·K_lm·P_l^m / sin^m θ (√2 only for m > 0):
/// Q_m^m is constant (`diagonal`), and Q_l^m = `up` · z · Q_{l-1}^m − `down` · Q_{l-2}^m.
struct Recurrence<T> {
    diagonal: [T; MAX_BANDS],
    /// `[m][l]`, for l > m.
    up: [[T; MAX_BANDS]; MAX_BANDS],
    /// `[m][l]`, for l > m + 1; zero at l = m + 1.
    down: [[T; MAX_BANDS]; MAX_BANDS],
}

static RECURRENCE_F64: LazyLock<Recurrence<f64>> = LazyLock::new(|| {
    let mut table = Recurrence {
        diagonal: [0.0; MAX_BANDS],
        up: [[0.0; MAX_BANDS]; MAX_BANDS],
        down: [[0.0; MAX_BANDS]; MAX_BANDS],
    };
    let mut diagonal = (0.25 / std::f64::consts::PI).sqrt();
    for m in 0..MAX_BANDS {
        let mf = m as f64;
        if m > 0 {
            diagonal *= ((2.0 * mf + 1.0) / (2.0 * mf)).sqrt();
        }
        table.diagonal[m] = if m == 0 { diagonal } else { diagonal * std::f64::consts::SQRT_2 };
        for l in m + 1..MAX_BANDS {
            let lf = l as f64;
            let up = ((4.0 * lf * lf - 1.0) / (lf * lf - mf * mf)).sqrt();
            let before = (lf - 1.0) * (lf - 1.0);
            table.up[m][l] = up;
            table.down[m][l] = up * ((before - mf * mf) / (4.0 * before - 1.0)).max(0.0).sqrt();
        }
    }
    table
});

static RECURRENCE_F32: LazyLock<Recurrence<f32>> = LazyLock::new(|| {
    let exact = &*RECURRENCE_F64;
    Recurrence {
        diagonal: exact.diagonal.map(|x| x as f32),
        up: exact.up.map(|row| row.map(|x| x as f32)),
        down: exact.down.map(|row| row.map(|x| x as f32)),
    }
});

/// One evaluator per precision: the number of bands is a constant of each instance, so that the
/// compiler unrolls the loops over l and m.
macro_rules! evaluator {
    ($name:ident, $float:ty) => {
        #[inline]
        fn $name<const N: usize>(
            table: &Recurrence<$float>,
            [x, y, z]: [$float; 3],
            out: &mut [$float],
        ) {
            let out = &mut out[..N * N];
            // cos(mφ)·sin^m θ and sin(mφ)·sin^m θ, by multiplying with x + iy.
            let (mut cos, mut sin) = (1.0, 0.0);
            for m in 0..N {
                let (mut before, mut legendre) = (0.0, table.diagonal[m]);
                for l in m..N {
                    if l > m {
                        let next = table.up[m][l] * z * legendre - table.down[m][l] * before;
                        (before, legendre) = (legendre, next);
                    }
                    let centre = l * (l + 1);
                    out[centre + m] = legendre * cos;
                    if m > 0 {
                        out[centre - m] = legendre * sin;
                    }
                }
                (cos, sin) = (x * cos - y * sin, x * sin + y * cos);
            }
        }
    };
}

evaluator!(bands_f32, f32);
evaluator!(bands_f64, f64);

/// Calls the evaluator that is compiled for this order.
macro_rules! dispatch {
    ($order:expr, $call:ident, $($argument:expr),*) => {
        match $order.bands() {
            1 => $call::<1>($($argument),*),
            2 => $call::<2>($($argument),*),
            3 => $call::<3>($($argument),*),
            4 => $call::<4>($($argument),*),
            5 => $call::<5>($($argument),*),
            6 => $call::<6>($($argument),*),
            7 => $call::<7>($($argument),*),
            8 => $call::<8>($($argument),*),
            9 => $call::<9>($($argument),*),
            _ => $call::<10>($($argument),*),
        }
    };
}

/// Writes y_0(ω) … y_{n²-1}(ω) of the unit vector `direction` to the first n² numbers of `out`.
///
/// Accurate to about 1e-6; [`evaluate_f64`] is its twin for tables and proofs.
///
/// # Panics
/// If `out` is shorter than n².
pub fn evaluate(order: Order, direction: Vec3, out: &mut [f32]) {
    let table = &*RECURRENCE_F32;
    dispatch!(order, bands_f32, table, direction.to_array(), out);
}

/// [`evaluate`] of `L` unit directions at once, given by axis; `out[i]` holds y_i of all of them.
/// Plain loops over the lanes, which the compiler turns into vectors.
///
/// # Panics
/// If `out` is shorter than n².
#[inline(always)]
pub fn evaluate_lanes<const L: usize>(order: Order, axes: &[[f32; L]; 3], out: &mut [[f32; L]]) {
    let (table, bands) = (&*RECURRENCE_F32, order.bands());
    let [x, y, z] = axes;
    let (mut cos, mut sin) = ([1.0; L], [0.0; L]);
    for m in 0..bands {
        let (mut before, mut legendre) = ([0.0; L], [table.diagonal[m]; L]);
        for l in m..bands {
            let (up, down, centre) = (table.up[m][l], table.down[m][l], l * (l + 1));
            for i in 0..L {
                if l > m {
                    let next = up * z[i] * legendre[i] - down * before[i];
                    (before[i], legendre[i]) = (legendre[i], next);
                }
                out[centre + m][i] = legendre[i] * cos[i];
            }
            if m > 0 {
                for i in 0..L {
                    out[centre - m][i] = legendre[i] * sin[i];
                }
            }
        }
        for i in 0..L {
            (cos[i], sin[i]) = (x[i] * cos[i] - y[i] * sin[i], x[i] * sin[i] + y[i] * cos[i]);
        }
    }
}

/// [`evaluate`] in f64.
///
/// # Panics
/// If `out` is shorter than n².
pub fn evaluate_f64(order: Order, direction: [f64; 3], out: &mut [f64]) {
    let table = &*RECURRENCE_F64;
    dispatch!(order, bands_f64, table, direction, out);
}

#[cfg(test)]
mod tests {
    use super::super::quadrature::zone;
    use super::*;

    /// By quadrature that is exact for the products: ∫ y_i y_j dω = δ_ij, for all orders.
    #[test]
    fn basis_is_orthonormal() {
        let order = Order::new(10).unwrap();
        let mut gram = vec![0.0; 100 * 100];
        let mut y = [0.0; 100];
        for (direction, weight) in zone(12, -1.0, 1.0) {
            evaluate_f64(order, direction, &mut y);
            for i in 0..100 {
                for j in 0..100 {
                    gram[i * 100 + j] += weight * y[i] * y[j];
                }
            }
        }
        for i in 0..100 {
            for j in 0..100 {
                let expected = f64::from(u8::from(i == j));
                assert!((gram[i * 100 + j] - expected).abs() < 1e-12, "{i} {j}");
            }
        }
    }

    /// Many directions at once are each direction alone, for all orders.
    #[test]
    fn lanes_are_single_directions() {
        let directions = [[0.36, -0.48, 0.8], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [-0.6, 0.8, 0.0]];
        let axes = [0, 1, 2].map(|axis| directions.map(|direction: [f32; 3]| direction[axis]));
        for bands in 1..=10 {
            let order = Order::new(bands).unwrap();
            let (mut all, mut one) = ([[0.0; 4]; 100], [0.0; 100]);
            evaluate_lanes(order, &axes, &mut all);
            for (lane, &direction) in directions.iter().enumerate() {
                evaluate(order, Vec3::from_array(direction), &mut one);
                for i in 0..order.coefficients() {
                    assert!((all[i][lane] - one[i]).abs() < 1e-6, "{bands} {lane} {i}");
                }
            }
        }
    }

    /// The first three bands agree with their closed forms, signs and axes included.
    #[test]
    fn low_bands_have_their_closed_forms() {
        let (x, y, z) = (0.36, -0.48, 0.8);
        let mut out = [0.0; 9];
        evaluate_f64(Order::new(3).unwrap(), [x, y, z], &mut out);
        let expected = [
            0.282_094_791_773_878_14,
            0.488_602_511_902_919_9 * y,
            0.488_602_511_902_919_9 * z,
            0.488_602_511_902_919_9 * x,
            1.092_548_430_592_079_2 * x * y,
            1.092_548_430_592_079_2 * y * z,
            0.315_391_565_252_520_05 * (3.0 * z * z - 1.0),
            1.092_548_430_592_079_2 * x * z,
            0.546_274_215_296_039_6 * (x * x - y * y),
        ];
        for (found, expected) in out.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-14, "{found} {expected}");
        }
    }

    /// f32 follows f64 for every order, and a smaller order is a prefix of a larger one.
    #[test]
    fn f32_follows_f64() {
        for (direction, _) in zone(9, -1.0, 1.0) {
            let mut exact = [0.0; 100];
            evaluate_f64(Order::new(10).unwrap(), direction, &mut exact);
            for bands in 1..=10 {
                let order = Order::new(bands).unwrap();
                let mut fast = [f32::NAN; 100];
                evaluate(order, Vec3::from_array(direction.map(|x| x as f32)), &mut fast);
                for i in 0..order.coefficients() {
                    let error = (f64::from(fast[i]) - exact[i]).abs();
                    assert!(error < 4e-6, "order {bands}, coefficient {i}: {error}");
                }
                assert!(fast[order.coefficients()..].iter().all(|x| x.is_nan()));
            }
        }
    }
}
