//! How much of a spectrum is signal, where the data say how noisy they are.
//!
//! Independent noise of variance σ² in an m × n matrix raises every squared singular value and
//! hides the small ones: those of the noise alone reach up to σ²(√m + √n)², and a direction of the
//! signal with squared singular value θ² shows as (θ² + σ²m)(θ² + σ²n)/θ² (Benaych-Georges and
//! Nadakuditi 2012, for large m and n). Directions below the edge tell nothing about the signal,
//! so a model that keeps them pays bytes for noise.

/// The noise of an m × n matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Noise {
    /// σ² of one number; 0 where nothing is known.
    pub(super) variance: f64,
    /// m, rows that vary (poses less the mean that was taken out).
    pub(super) rows: usize,
    /// n.
    pub(super) columns: usize,
}

impl Noise {
    /// The signal's share θ² of a squared singular value of the data; 0 below the edge.
    pub(super) fn signal(&self, value: f64) -> f64 {
        let [m, n] = [self.rows, self.columns].map(|count| self.variance * count as f64);
        let half = 0.5 * (value - m - n);
        // λ = (θ² + m)(θ² + n)/θ², solved for θ²; real above the edge (√m + √n)².
        let square = half * half - m * n;
        if half > 0.0 && square >= 0.0 { half + square.sqrt() } else { 0.0 }
    }

    /// Σ θ² that is to be expected of data whose Σ y² is `energy`.
    pub(super) fn signal_energy(&self, energy: f64) -> f64 {
        (energy - self.variance * self.rows as f64 * self.columns as f64).max(0.0)
    }

    /// The fewest leading `values` (squared singular values, descending) whose signal holds
    /// `share` of that in `energy`, and whether they do. Only values above the edge count.
    pub(super) fn fewest(&self, values: &[f64], energy: f64, share: f64) -> (usize, bool) {
        self.fewest_of(values, share * self.signal_energy(energy))
    }

    /// The same for a stated Σ θ².
    pub(super) fn fewest_of(&self, values: &[f64], needed: f64) -> (usize, bool) {
        let needed = needed * (1.0 - ROUND_OFF);
        let mut sum = 0.0;
        for (i, &value) in values.iter().enumerate() {
            if sum >= needed {
                return (i, true);
            }
            let signal = self.signal(value);
            if signal <= 0.0 {
                // All that follow are noise, too: there is no more to be had.
                return (i, true);
            }
            sum += signal;
        }
        (values.len(), sum >= needed)
    }
}

/// Shares are of sums that f32 products gave.
const ROUND_OFF: f64 = 1e-7;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::linalg::{Mat, thin_svd};
    use crate::num::random::Stream;

    /// A matrix of three directions with these squared singular values, and noise.
    fn noisy(rows: usize, columns: usize, squares: [f64; 3], deviation: f64) -> Mat<f64> {
        let mut stream = Stream::new(8);
        let mut random =
            |rows: usize, columns: usize| Mat::from_fn(rows, columns, |_, _| stream.normal());
        let orthonormal = |m: Mat<f64>| crate::num::linalg::Qr::new(m.as_ref()).q();
        let (u, v) = (orthonormal(random(rows, 3)), orthonormal(random(columns, 3)));
        let s = Mat::from_fn(3, columns, |i, j| squares[i].sqrt() * v[(j, i)]);
        let scaled = random(rows, columns);
        u * s + Mat::from_fn(rows, columns, |i, j| deviation * scaled[(i, j)])
    }

    /// Proves on random matrices that the values of signals are found within a few per cent of
    /// what they were before the noise, and that a signal below the edge and the noise itself
    /// count nothing.
    #[test]
    fn signals_are_told_from_noise() {
        let (rows, columns, deviation) = (60, 400, 0.5);
        let edge = deviation * deviation * (60_f64.sqrt() + 20.0).powi(2);
        let squares = [20.0 * edge, 3.0 * edge, 0.05 * edge];
        let noise = Noise { variance: deviation * deviation, rows, columns };
        let data = noisy(rows, columns, squares, deviation);
        let values: Vec<f64> = thin_svd(data.as_ref()).unwrap().s.iter().map(|s| s * s).collect();
        for i in 0..2 {
            let found = noise.signal(values[i]);
            assert!((found / squares[i] - 1.0).abs() < 0.1, "{i}: {found} {}", squares[i]);
        }
        // The largest value of pure noise strays above the edge by a few per cent at most.
        assert!(values[2..].iter().all(|&value| noise.signal(value / 1.05) == 0.0));
        let energy: f64 = values.iter().sum();
        assert_eq!(noise.fewest(&values[..2], energy, 0.8), (1, true));
        assert!(noise.fewest(&values, energy, 0.95).0 <= 3);
    }

    /// Without noise everything is signal.
    #[test]
    fn without_noise_all_counts() {
        let none = Noise { variance: 0.0, rows: 10, columns: 10 };
        assert_eq!(none.signal(0.25), 0.25);
        assert_eq!(none.fewest(&[4.0, 2.0, 1.0, 1.0], 8.0, 0.75), (2, true));
        assert_eq!(none.fewest(&[4.0, 2.0], 8.0, 0.9), (2, false));
        assert_eq!(none.fewest(&[0.0, 0.0], 0.0, 0.9), (0, true));
    }
}
