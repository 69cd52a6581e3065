//! The poses at which a model of those chosen before is predicted to be most wrong, one after another.
//!
//! As a Gaussian process over where the joints are, a signal that is known at some poses has a posterior
//! variance at the others, whatever its values are: k(x,x) − kᵀK⁻¹k. Taking the largest each time is the pivoted
//! Cholesky factorisation of the kernel's matrix, greedily maximising its determinant.

use super::spread::{farthest, spread, square};

/// Variance, of 1 before anything is known, below which round-off has the say.
const NOTHING: f64 = 1e-9;

/// The first `most` rows of the greedy order under the kernel exp(−d²/2ℓ²), where ℓ is the root mean square
/// distance between two rows; a larger `most` takes the same rows and more. Once everything is predicted, the
/// rest is what lies farthest apart. `rows` is `[pose, parameter]`; the answer is ascending.
///
/// The work is poses × `most` × (parameters + `most`).
pub(super) fn uncertain(rows: &[f32], width: usize, most: usize) -> Vec<usize> {
    let count = rows.len().checked_div(width).unwrap_or(0);
    if count <= most || most == 0 {
        return spread(rows, width, most);
    }
    let row = |i: usize| &rows[i * width..(i + 1) * width];
    let scale = -0.5 / mean_square_distance(rows, width).max(f64::MIN_POSITIVE);
    let mut variance = vec![1.0_f64; count];
    // [pose][pivot] of the factor.
    let mut factor = vec![0.0_f64; count * most];
    let mut taken = Vec::with_capacity(most);
    let mut next = spread(rows, width, 1)[0];
    while taken.len() < most && variance[next] > NOTHING {
        let (k, root) = (taken.len(), variance[next].sqrt());
        let pivot = factor[next * most..next * most + k].to_vec();
        for (i, factor) in factor.chunks_exact_mut(most).enumerate() {
            let known: f64 = factor[..k].iter().zip(&pivot).map(|(a, b)| a * b).sum();
            factor[k] = ((scale * square(row(i), row(next))).exp() - known) / root;
            variance[i] -= factor[k] * factor[k];
        }
        taken.push(next);
        variance[next] = -1.0;
        next = farthest(&variance);
    }
    let others = spread(rows, width, most).into_iter().filter(|i| !taken.contains(i));
    let others: Vec<usize> = others.take(most - taken.len()).collect();
    taken.extend(others);
    taken.sort_unstable();
    taken
}

/// Of two rows: twice the sum of the columns' variances.
fn mean_square_distance(rows: &[f32], width: usize) -> f64 {
    let count = (rows.len() / width) as f64;
    let column = |k: usize| rows.iter().skip(k).step_by(width).map(|&x| f64::from(x));
    let variance = |k: usize| {
        let mean = column(k).sum::<f64>() / count;
        column(k).map(|x| (x - mean).powi(2)).sum::<f64>() / count
    };
    2.0 * (0..width).map(variance).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::linalg::Mat;
    use crate::num::random::Stream;

    fn cloud(count: usize) -> Vec<f32> {
        let mut random = Stream::new(5);
        (0..3 * count).map(|_| random.uniform() as f32).collect()
    }

    /// log det of the kernel's matrix of some rows, by elimination.
    fn information(rows: &[f32], some: &[usize]) -> f64 {
        let scale = -0.5 / mean_square_distance(rows, 3);
        let row = |i: usize| &rows[3 * i..3 * i + 3];
        let kernel = |i: usize, j: usize| (scale * square(row(some[i]), row(some[j]))).exp();
        let mut k = Mat::from_fn(some.len(), some.len(), kernel);
        let mut sum = 0.0;
        for p in 0..some.len() {
            sum += k[(p, p)].ln();
            for i in p + 1..some.len() {
                let share = k[(i, p)] / k[(p, p)];
                (p..some.len()).for_each(|j| k[(i, j)] -= share * k[(p, j)]);
            }
        }
        sum
    }

    /// Choices are nested, and each step takes the row that adds most information of all that are left, as
    /// elimination without a factorisation finds it; so they tell more than every n-th row does.
    #[test]
    fn the_order_is_greedy_in_information() {
        let rows = cloud(60);
        let orders: Vec<Vec<usize>> = (1..7).map(|most| uncertain(&rows, 3, most)).collect();
        for pair in orders.windows(2) {
            assert!(pair[0].iter().all(|i| pair[1].contains(i)) && pair[1].is_sorted());
            let with = |i: usize| {
                let mut some = pair[0].clone();
                some.push(i);
                information(&rows, &some)
            };
            let left = (0..60).filter(|i| !pair[0].contains(i));
            let best = left.max_by(|&a, &b| with(a).total_cmp(&with(b))).unwrap();
            assert!(pair[1].contains(&best), "{pair:?}: {best}");
        }
        let evenly: Vec<usize> = (0..60).step_by(10).collect();
        assert!(information(&rows, &orders[5]) > information(&rows, &evenly));
    }

    /// Equal rows are predicted at once: the rest are those farthest apart; few rows are all taken.
    #[test]
    fn edges() {
        assert_eq!(uncertain(&[1.0, 1.0, 1.0, 9.0], 1, 2), [0, 3]);
        assert_eq!(uncertain(&[1.0; 4], 1, 3).len(), 3);
        assert_eq!(uncertain(&[1.0, 2.0], 1, 5), [0, 1]);
        assert_eq!(uncertain(&[], 0, 3), [0]);
    }
}
