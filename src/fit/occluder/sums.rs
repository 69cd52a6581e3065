//! What the regression on point features needs to know of one point: sums over the poses of each
//! fold, none of which grows with the number of poses or coefficients.

/// Rows of the symmetric matrix of all groups below or on the diagonal.
pub(super) fn packed(groups: usize) -> usize {
    groups * (groups + 1) / 2
}

/// Second moments of features ψ and outputs y, summed over poses and coefficients, about the mean
/// of each coefficient.
#[derive(Debug, Clone, Default)]
pub(super) struct Moments {
    /// Σ ψ ψᵀ, packed by rows.
    pub(super) gram: Vec<f64>,
    /// Σ ψ y.
    pub(super) cross: Vec<f64>,
    /// Σ y².
    pub(super) square: f64,
}

/// Plain sums over some poses.
#[derive(Debug, Clone)]
pub(super) struct Sums {
    poses: f64,
    /// `[group, coefficient]`.
    features: Vec<f64>,
    /// `[coefficient]`.
    outputs: Vec<f64>,
    raw: Moments,
}

impl Sums {
    pub(super) fn new(groups: usize, coefficients: usize) -> Self {
        Self {
            poses: 0.0,
            features: vec![0.0; groups * coefficients],
            outputs: vec![0.0; coefficients],
            raw: Moments::zero(groups),
        }
    }

    /// Adds a pose: `features` `[group, coefficient]`, `outputs` `[coefficient]`.
    pub(super) fn add(&mut self, features: &[f32], outputs: &[f32]) {
        let n = outputs.len();
        let dot = |a: &[f32], b: &[f32]| -> f64 {
            f64::from(a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>())
        };
        self.poses += 1.0;
        let mut at = 0;
        for (g, row) in features.chunks_exact(n).enumerate() {
            for other in features.chunks_exact(n).take(g + 1) {
                self.raw.gram[at] += dot(row, other);
                at += 1;
            }
            self.raw.cross[g] += dot(row, outputs);
        }
        self.raw.square += dot(outputs, outputs);
        self.features.iter_mut().zip(features).for_each(|(sum, &x)| *sum += f64::from(x));
        self.outputs.iter_mut().zip(outputs).for_each(|(sum, &x)| *sum += f64::from(x));
    }

    pub(super) fn merge(&mut self, other: &Self) {
        self.poses += other.poses;
        let pairs = self.features.iter_mut().zip(&other.features);
        pairs.chain(self.outputs.iter_mut().zip(&other.outputs)).for_each(|(a, b)| *a += b);
        self.raw.merge(&other.raw);
    }

    /// The moments about the means of `centre`: of these poses themselves, or of those that a
    /// model which is tried on these poses has seen.
    pub(super) fn about(&self, centre: &Self) -> Moments {
        let (n, p, of) = (self.outputs.len(), self.poses, centre.poses.max(1.0));
        // Σ (a − ā)(b − b̄) = Σ ab − ā Σb − b̄ Σa + p ā b̄.
        let shift = |a: &[f64], a0: &[f64], b: &[f64], b0: &[f64]| -> f64 {
            let terms = a.iter().zip(a0).zip(b.iter().zip(b0));
            terms
                .map(|((a, a0), (b, b0))| {
                    let (a0, b0) = (a0 / of, b0 / of);
                    p * a0 * b0 - a0 * b - b0 * a
                })
                .sum()
        };
        let row = |sums: &'_ Self, g: usize| sums.features[g * n..(g + 1) * n].to_vec();
        let mut out = self.raw.clone();
        let mut at = 0;
        for g in 0..out.cross.len() {
            let (a, a0) = (row(self, g), row(centre, g));
            for h in 0..=g {
                out.gram[at] += shift(&a, &a0, &row(self, h), &row(centre, h));
                at += 1;
            }
            out.cross[g] += shift(&a, &a0, &self.outputs, &centre.outputs);
        }
        out.square += shift(&self.outputs, &centre.outputs, &self.outputs, &centre.outputs);
        out
    }
}

impl Moments {
    pub(super) fn zero(groups: usize) -> Self {
        Self { gram: vec![0.0; packed(groups)], cross: vec![0.0; groups], square: 0.0 }
    }

    pub(super) fn merge(&mut self, other: &Self) {
        let pairs = self.gram.iter_mut().zip(&other.gram);
        pairs.chain(self.cross.iter_mut().zip(&other.cross)).for_each(|(a, b)| *a += b);
        self.square += other.square;
    }

    /// The moments of so many sets of groups, each the sum of its groups.
    pub(super) fn joined(&self, set_of: &[usize], sets: usize) -> Self {
        let mut out = Self { square: self.square, ..Self::zero(sets) };
        for (g, &i) in set_of.iter().enumerate().take(self.cross.len()) {
            out.cross[i] += self.cross[g];
            for (h, &j) in set_of.iter().enumerate().take(g + 1) {
                // Off the diagonal each pair stands once for two.
                let times = if g != h && i == j { 2.0 } else { 1.0 };
                out.gram[packed(i.max(j)) + i.min(j)] += times * self.gram[packed(g) + h];
            }
        }
        out
    }

    /// The diagonal of Σ ψ ψᵀ.
    pub(super) fn diagonal(&self) -> Vec<f64> {
        (0..self.cross.len()).map(|g| self.gram[packed(g + 1) - 1]).collect()
    }

    /// min over w of Σ (y − wψ)² + Σ_g penalty_g (w_g − prior_g)², by Cholesky. A pivot that
    /// vanishes (a group that nothing tells from others) leaves its weight at the prior.
    pub(super) fn solve(&self, prior: &[f64], penalty: &[f64]) -> Vec<f64> {
        let n = self.cross.len();
        let row = |i: usize| packed(i)..packed(i + 1);
        let mut x = self.cross.clone();
        for i in 0..n {
            let own = &self.gram[row(i)];
            for (j, g) in own.iter().enumerate() {
                x[i] -= g * prior[j];
                if j < i {
                    x[j] -= g * prior[i];
                }
            }
        }
        let largest = self.diagonal().iter().chain(penalty).fold(0.0, |a: f64, &b| a.max(b));
        let mut factor = self.gram.clone();
        for i in 0..n {
            let (done, rest) = factor.split_at_mut(packed(i));
            let own = &mut rest[..i + 1];
            for j in 0..i {
                let other = &done[row(j)];
                own[j] = (own[j] - dot(&own[..j], &other[..j])) / other[j];
            }
            let left = own[i] + penalty[i] - dot(&own[..i], &own[..i]);
            own[i] = if left > 1e-12 * largest { left.sqrt() } else { f64::INFINITY };
        }
        for i in 0..n {
            let own = &factor[row(i)];
            x[i] = (x[i] - dot(&own[..i], &x[..i])) / own[i];
        }
        for i in (0..n).rev() {
            let own = &factor[row(i)];
            x[i] /= own[i];
            let solved = x[i];
            x[..i].iter_mut().zip(own).for_each(|(x, l)| *x -= l * solved);
        }
        x.iter().zip(prior).map(|(x, prior)| x + prior).collect()
    }

    /// Σ (y − wψ)².
    pub(super) fn residual(&self, weights: &[f64]) -> f64 {
        let mut sum = self.square;
        let mut at = 0;
        for (g, w) in weights.iter().enumerate() {
            sum -= 2.0 * w * self.cross[g];
            for (h, v) in weights.iter().enumerate().take(g + 1) {
                let twice = if h == g { 1.0 } else { 2.0 };
                sum += twice * w * v * self.gram[at];
                at += 1;
            }
        }
        sum.max(0.0)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::random::Stream;

    /// Features `[group, coefficient]` and outputs of one point in one pose.
    type Seen = (Vec<f32>, Vec<f32>);

    fn poses(count: usize, groups: usize, n: usize) -> Vec<Seen> {
        let mut stream = Stream::new(5);
        let mut numbers =
            |count: usize| (0..count).map(|_| stream.normal() as f32 + 0.5).collect::<Vec<_>>();
        (0..count).map(|_| (numbers(groups * n), numbers(n))).collect()
    }

    fn sums(poses: &[Seen], groups: usize, n: usize) -> Sums {
        let mut sums = Sums::new(groups, n);
        poses.iter().for_each(|(features, outputs)| sums.add(features, outputs));
        sums
    }

    /// Proves against plain centred arithmetic that moments about other poses' means give the
    /// energy of what a model that saw those poses leaves of these.
    #[test]
    fn residuals_are_those_of_centred_data() {
        let (groups, n) = (3, 4);
        let all = poses(12, groups, n);
        let (tried, seen) = all.split_at(5);
        let moments = sums(tried, groups, n).about(&sums(seen, groups, n));
        let w = [0.3, -0.7, 1.1];
        let mean = |at: &dyn Fn(&Seen) -> f32| -> f64 {
            seen.iter().map(|pose| f64::from(at(pose))).sum::<f64>() / seen.len() as f64
        };
        let mut expected = 0.0;
        for pose in tried {
            for c in 0..n {
                let mut left = f64::from(pose.1[c]) - mean(&|pose| pose.1[c]);
                for (g, w) in w.iter().enumerate() {
                    let i = g * n + c;
                    left -= w * (f64::from(pose.0[i]) - mean(&|pose| pose.0[i]));
                }
                expected += left * left;
            }
        }
        let found = moments.residual(&w);
        assert!((found - expected).abs() < 1e-4 * expected, "{found} {expected}");
    }

    /// Proves that the solution has a vanishing gradient, that an endless penalty gives the prior,
    /// and that a group which is no different from another stays finite without any penalty.
    #[test]
    fn solutions_are_minima() {
        let (groups, n) = (3, 4);
        let own = sums(&poses(12, groups, n), groups, n);
        let moments = own.about(&own);
        let (prior, penalty) = ([0.5, 0.4, -0.2], [2.0, 0.1, 7.0]);
        let cost = |w: &[f64]| {
            let far: f64 = (0..3).map(|g| penalty[g] * (w[g] - prior[g]).powi(2)).sum();
            moments.residual(w) + far
        };
        let best = moments.solve(&prior, &penalty);
        for g in 0..groups {
            for step in [-1e-3, 1e-3] {
                let mut other = best.clone();
                other[g] += step;
                assert!(cost(&other) > cost(&best), "{g} {step}");
            }
        }
        let held = moments.solve(&prior, &[1e15; 3]);
        assert!(held.iter().zip(&prior).all(|(a, b)| (a - b).abs() < 1e-9), "{held:?}");

        let twins: Vec<_> = poses(9, 1, n)
            .into_iter()
            .map(|(features, outputs)| ([features.clone(), features].concat(), outputs))
            .collect();
        let own = sums(&twins, 2, n);
        let weights = own.about(&own).solve(&[0.0, 0.0], &[0.0, 0.0]);
        assert!(weights.iter().all(|w| w.is_finite()), "{weights:?}");
    }
}
