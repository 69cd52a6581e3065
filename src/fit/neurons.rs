//! A layer of tanh neurons between reduced poses and reduced outputs (RPO09 eq. 12 and 13).

use rayon::prelude::*;

use crate::num::lbfgs::minimise;
use crate::num::random::{Stream, hash};

/// Steps of the optimiser in cross-validation, at most, where only the better of several has to be
/// told.
const TRIED_STEPS: usize = 150;

/// How hard to try.
#[derive(Debug, Clone, Copy)]
pub(super) struct Budget {
    /// Steps of the optimiser for the final fit, at most (RPO09 has 5000 of BFGS).
    pub(super) steps: usize,
    pub(super) seed: u64,
}

/// Folds of the cross-validation.
const FOLDS: usize = 4;

/// α to choose from, over the energy of the outputs: eq. 13's sum is over poses, so that is what
/// it is weighed against.
const ALPHAS: [f64; 4] = [1e-4, 1e-3, 1e-2, 1e-1];

/// Inputs and outputs of p poses, row by row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Data<'a> {
    /// `[pose, d]`.
    pub(super) x: &'a [f64],
    /// `[pose, k]`.
    pub(super) y: &'a [f64],
    pub(super) inputs: usize,
    pub(super) outputs: usize,
}

/// Inputs and outputs of some poses.
type Rows = (Vec<f64>, Vec<f64>);

/// A layer: Y ≈ C tanh(D·(x, 1)) + c0.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Neurons {
    /// `[neuron, d + 1]`, bias last.
    pub(super) hidden: Vec<f64>,
    /// `[k, neuron + 1]`, bias last.
    pub(super) weights: Vec<f64>,
    /// Σ‖Ỹ − Y‖² on what it was fitted to.
    pub(super) energy: f64,
    /// The α used.
    pub(super) alpha: f64,
}

impl Data<'_> {
    pub(super) fn poses(&self) -> usize {
        self.x.len() / self.inputs.max(1)
    }

    /// Other poses of the same widths.
    fn with<'r>(&self, (x, y): &'r Rows) -> Data<'r> {
        Data { x, y, inputs: self.inputs, outputs: self.outputs }
    }

    fn only(&self, keep: impl Fn(usize) -> bool) -> Rows {
        let (mut x, mut y) = (Vec::new(), Vec::new());
        for pose in (0..self.poses()).filter(|&pose| keep(pose)) {
            x.extend_from_slice(&self.x[pose * self.inputs..][..self.inputs]);
            y.extend_from_slice(&self.y[pose * self.outputs..][..self.outputs]);
        }
        (x, y)
    }
}

/// Which N and which α, by the least error on four folds in turn; with one candidate that one.
/// `fold` gives each pose one of `FOLDS` folds.
pub(super) fn choose(
    data: Data<'_>,
    fold: &[usize],
    neurons: &[usize],
    regularised: bool,
    budget: Budget,
) -> (usize, f64) {
    let tried = Budget { steps: budget.steps.min(TRIED_STEPS), ..budget };
    let energy: f64 = data.y.iter().map(|y| y * y).sum();
    let largest = neurons.iter().copied().max().unwrap_or(1);
    if !regularised {
        return (largest, 0.0);
    }
    let parts: Vec<_> = (0..FOLDS)
        .map(|left_out| {
            (data.only(|pose| fold[pose] != left_out), data.only(|pose| fold[pose] == left_out))
        })
        .filter(|(kept, tested)| !kept.0.is_empty() && !tested.0.is_empty())
        .collect();
    let error = |&(count, alpha): &(usize, f64)| -> f64 {
        let of = |(kept, tested): &(Rows, Rows)| {
            let layer = fit_fully(data.with(kept), count, alpha, tried);
            layer.error(data.with(tested))
        };
        parts.iter().map(of).sum()
    };
    let alphas = ALPHAS.map(|alpha| alpha * energy / data.poses() as f64);
    let tries: Vec<(usize, f64)> =
        neurons.iter().flat_map(|&count| alphas.map(|alpha| (count, alpha))).collect();
    let errors: Vec<f64> = tries.par_iter().map(error).collect();
    let mut best = (f64::INFINITY, (largest, ALPHAS[1] * energy));
    for (error, tried) in errors.into_iter().zip(tries) {
        if error < best.0 {
            best = (error, tried);
        }
    }
    best.1
}

/// [`choose`]'s folds: whole clips go together; a single clip is cut into contiguous parts.
pub(super) fn folds(clips: &[i32]) -> Vec<usize> {
    let mut names: Vec<i32> = clips.to_vec();
    names.sort_unstable();
    names.dedup();
    if names.len() == 1 {
        return (0..clips.len()).map(|pose| pose * FOLDS / clips.len()).collect();
    }
    clips.iter().map(|clip| names.partition_point(|name| name < clip) % FOLDS).collect()
}

/// The layer of so many neurons.
pub(super) fn fit_fully(data: Data<'_>, neurons: usize, alpha: f64, budget: Budget) -> Neurons {
    let Data { inputs, outputs, .. } = data;
    let mut stream = Stream::new(hash(&[budget.seed, neurons as u64]));
    let scale = 1.0 / (inputs as f64).sqrt();
    let mut start: Vec<f64> =
        (0..neurons * (inputs + 1)).map(|_| stream.normal() * scale).collect();
    start.extend((0..outputs * (neurons + 1)).map(|_| 0.01 * stream.normal()));
    let minimum =
        minimise(start, budget.steps, |x, gradient| objective(data, neurons, alpha, x, gradient));
    let (hidden, weights) = minimum.x.split_at(neurons * (inputs + 1));
    let mut layer =
        Neurons { hidden: hidden.to_vec(), weights: weights.to_vec(), energy: 0.0, alpha };
    layer.energy = layer.error(data);
    layer
}

impl Neurons {
    /// Σ‖Ỹ − Y‖².
    pub(super) fn error(&self, data: Data<'_>) -> f64 {
        let neurons = self.hidden.len() / (data.inputs + 1);
        let parameters: Vec<f64> = self.hidden.iter().chain(&self.weights).copied().collect();
        let mut gradient = vec![0.0; parameters.len()];
        objective(data, neurons, 0.0, &parameters, &mut gradient)
    }
}

/// RPO09 eq. 13, Σ_i ‖Ỹ − Y‖² + α Σ_n (‖c_n‖² + ‖d_n‖²), biases not penalised, and its gradient.
/// Parameters are hidden `[neuron, d + 1]`, then weights `[k, neuron + 1]`.
fn objective(
    data: Data<'_>,
    neurons: usize,
    alpha: f64,
    parameters: &[f64],
    gradient: &mut [f64],
) -> f64 {
    let Data { inputs, outputs, .. } = data;
    let (hidden, weights) = parameters.split_at(neurons * (inputs + 1));
    gradient.fill(0.0);
    let (hidden_gradient, weight_gradient) = gradient.split_at_mut(hidden.len());
    let mut value = 0.0;
    let (mut active, mut back) = (vec![0.0; neurons], vec![0.0; neurons]);
    for (x, y) in data.x.chunks_exact(inputs).zip(data.y.chunks_exact(outputs)) {
        for (active, row) in active.iter_mut().zip(hidden.chunks_exact(inputs + 1)) {
            let sum: f64 = row.iter().zip(x).map(|(d, x)| d * x).sum();
            *active = (sum + row[inputs]).tanh();
        }
        back.fill(0.0);
        let rows =
            weights.chunks_exact(neurons + 1).zip(weight_gradient.chunks_exact_mut(neurons + 1));
        for ((row, gradient), y) in rows.zip(y) {
            let sum: f64 = row.iter().zip(&active).map(|(c, a)| c * a).sum();
            let error = sum + row[neurons] - y;
            value += error * error;
            let twice = 2.0 * error;
            for n in 0..neurons {
                gradient[n] += twice * active[n];
                back[n] += twice * row[n];
            }
            gradient[neurons] += twice;
        }
        let rows = hidden_gradient.chunks_exact_mut(inputs + 1);
        for ((row, active), back) in rows.zip(&active).zip(&back) {
            let slope = back * (1.0 - active * active);
            row.iter_mut().zip(x).for_each(|(g, x)| *g += slope * x);
            row[inputs] += slope;
        }
    }
    value
        + penalise(hidden, inputs, alpha, hidden_gradient)
        + penalise(weights, neurons, alpha, weight_gradient)
}

/// α Σ of squares of all but the last of every `count + 1`, and its gradient.
fn penalise(parameters: &[f64], count: usize, alpha: f64, gradient: &mut [f64]) -> f64 {
    let mut sum = 0.0;
    let rows = parameters.chunks_exact(count + 1).zip(gradient.chunks_exact_mut(count + 1));
    for (row, gradient) in rows {
        for (x, g) in row[..count].iter().zip(gradient) {
            sum += x * x;
            *g += 2.0 * alpha * x;
        }
    }
    alpha * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn budget(seed: u64) -> Budget {
        Budget { steps: 1000, seed }
    }

    fn step(poses: usize) -> (Vec<f64>, Vec<f64>) {
        let x: Vec<f64> = (0..poses).map(|i| i as f64 / (poses - 1) as f64 * 4.0 - 2.0).collect();
        let y = x.iter().flat_map(|x| [(3.0 * x).tanh(), 1.0 - (3.0 * x).tanh()]).collect();
        (x, y)
    }

    /// The analytic gradient equals central differences in every parameter.
    #[test]
    fn gradient_equals_differences() {
        let mut stream = Stream::new(4);
        let mut random = |n: usize| -> Vec<f64> { (0..n).map(|_| stream.normal()).collect() };
        let (x, y) = (random(7 * 3), random(7 * 2));
        let data = Data { x: &x, y: &y, inputs: 3, outputs: 2 };
        let parameters = random(4 * 4 + 2 * 5);
        let mut gradient = vec![0.0; parameters.len()];
        objective(data, 4, 0.3, &parameters, &mut gradient);
        let mut unused = gradient.clone();
        for i in 0..parameters.len() {
            let mut at = |offset: f64| {
                let mut moved = parameters.clone();
                moved[i] += offset;
                objective(data, 4, 0.3, &moved, &mut unused)
            };
            let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((difference - gradient[i]).abs() < 1e-6 * (1.0 + gradient[i].abs()), "{i}");
        }
    }

    /// A smoothed step is what one neuron is (RPO09 figure 6): the error all but vanishes, where
    /// a line leaves much of it.
    #[test]
    fn one_neuron_is_a_step() {
        let (x, y) = step(40);
        let data = Data { x: &x, y: &y, inputs: 1, outputs: 2 };
        let layer = fit_fully(data, 1, 0.0, budget(1));
        assert!(layer.energy < 1e-6, "{}", layer.energy);
        assert_eq!(layer, fit_fully(data, 1, 0.0, budget(1)));
    }

    /// Saturated neurons, constant outputs, and one pose stay finite.
    #[test]
    fn extremes_stay_finite() {
        let x = [1e8, -1e8, 3e8];
        for y in [[1.0, 0.0, 1.0], [5.0; 3]] {
            let layer = fit_fully(Data { x: &x, y: &y, inputs: 1, outputs: 1 }, 3, 1e-3, budget(2));
            assert!(layer.hidden.iter().chain(&layer.weights).all(|w| w.is_finite()));
        }
        let one = Data { x: &[0.5], y: &[2.0], inputs: 1, outputs: 1 };
        assert!(fit_fully(one, 2, 1e-6, budget(3)).energy < 1e-2);
    }

    /// Whole clips are left out together; the only clip falls into contiguous parts.
    #[test]
    fn folds_keep_clips_together() {
        assert_eq!(folds(&[7, 7, 2, 2, 9]), [1, 1, 0, 0, 2]);
        assert_eq!(folds(&[3; 8]), [0, 0, 1, 1, 2, 2, 3, 3]);
    }
}
