//! Degrees of freedom of the clustered families, beside noise that is drawn again and again.

use super::*;
use crate::fit::{ClusteredSizes, Kept};
use crate::model::Form;

const POSES: usize = 60;
const INPUTS: usize = 3;
const POINTS: usize = 40;

fn family(form: Form, outputs: usize) -> Family {
    let (inputs, outputs) = (Kept::Count(INPUTS), Kept::Count(outputs));
    Family::Clustered(ClusteredSizes { form, clusters: Some(1), inputs, outputs, neurons: Some(2) })
}

/// A set with these outputs, which says nothing about its noise.
fn set(values: &[f64]) -> TrainingParts {
    let sizes = Sizes { poses: POSES, parameters: INPUTS, points: POINTS, coefficients: 1 };
    let values = values.iter().map(|&y| y as f32).collect();
    TrainingParts { values, ..synthetic(sizes, 0.0, 3) }
}

fn noise(stream: &mut Stream, deviation: f64) -> Vec<f64> {
    (0..POSES * POINTS).map(|_| deviation * stream.normal()).collect()
}

/// Proves that a fit to pure noise takes as much of it away as its degrees of freedom say, for both forms that have a
/// closed solution, with all directions kept, for any ridge: the residual of a ridge keeps p − 2 tr H + tr H² of p.
#[test]
fn pure_noise_is_reduced_by_as_much() {
    for (form, features) in [(Form::Linear, 3.0), (Form::Quadratic, 9.0)] {
        let (mut told, mut reduced) = (0.0, 0.0);
        let mut stream = Stream::new(40);
        for _ in 0..12 {
            let values = noise(&mut stream, 0.1);
            let fitted = run(&set(&values), &trained(family(form, POINTS)));
            let energy = values.iter().map(|y| y * y).sum::<f64>() / values.len() as f64;
            told += fitted.report.degrees_of_freedom / 12.0;
            reduced += (1.0 - fitted.report.training_rmse.powi(2) / energy) * POSES as f64 / 12.0;
        }
        assert!((told - 1.0 - features).abs() < 1e-3, "{form:?}: {told}");
        // 12 draws of 40 outputs: a standard deviation of √(2/480/told), 2 to 3 %.
        assert!((reduced / told - 1.0).abs() < 0.08, "{form:?}: {reduced} of {told}");
    }
}

/// What noise of a known variance moves in the model's own poses, per output in units of the noise: Σ of the variance
/// over poses. And what the fits said of it.
fn moved(signal: &[f64], settings: &Settings, (deviation, draws): (f64, usize)) -> (f64, f64) {
    let mut stream = Stream::new(41);
    let (mut sum, mut square, mut told) = (vec![0.0; signal.len()], 0.0, 0.0);
    for _ in 0..draws {
        let drawn = noise(&mut stream, deviation);
        let values: Vec<f64> = signal.iter().zip(&drawn).map(|(y, e)| y + e).collect();
        let parts = set(&values);
        let fitted = run(&parts, settings);
        told += fitted.report.degrees_of_freedom / draws as f64;
        let poses = parts.parameters.chunks_exact(INPUTS);
        let said = poses.flat_map(|x| predict(&fitted, x, 1));
        for (sum, y) in sum.iter_mut().zip(said) {
            *sum += y;
            square += y * y;
        }
    }
    let mean: f64 = sum.iter().map(|y| y * y).sum::<f64>() / draws as f64;
    let variance = (square - mean) / (draws - 1) as f64 / POINTS as f64;
    (variance / deviation.powi(2), told)
}

/// Outputs of two directions, as strong as `along` makes of each pose.
fn two_directions(mut along: impl FnMut(&[f32]) -> [f64; 2]) -> Vec<f64> {
    let mut stream = Stream::new(42);
    let directions: Vec<[f64; 2]> =
        (0..POINTS).map(|_| [stream.normal(), stream.normal()]).collect();
    let parts = set(&[0.0; POSES * POINTS]);
    let poses = parts.parameters.chunks_exact(INPUTS);
    let rows = poses.flat_map(|x| {
        let [a, b] = along(x);
        directions.iter().map(move |d| 0.5 + a * d[0] + b * d[1])
    });
    rows.collect()
}

/// Proves the count where fewer directions are kept than there are outputs: with a signal of two directions, one of
/// which the features hold and one they do not, noise moves the model by as much as its degrees of freedom say, which
/// is neither a plain regression's nor 1.
#[test]
fn directions_take_their_share() {
    let mut stream = Stream::new(43);
    let signal = two_directions(|x| [f64::from(x[0] + 0.5 * x[1]), 0.7 * stream.normal()]);
    for form in [Form::Linear, Form::Quadratic] {
        let (moved, told) = moved(&signal, &trained(family(form, 2)), (0.02, 24));
        assert!((1.5..4.0).contains(&told), "{form:?}: {told}");
        assert!((moved / told - 1.0).abs() < 0.06, "{form:?}: {moved} of {told}");
    }
}

/// Proves that the estimate for neurons is one: within a third of what noise moves, where plain counting of one per
/// output would be less than half.
#[test]
fn neurons_are_counted_by_their_weights() {
    let neuron = |sum: f32| f64::from(sum).tanh();
    let signal = two_directions(|x| [neuron(1.5 * x[0] - x[1] + 0.3), neuron(x[1] + x[2])]);
    let (moved, told) = moved(&signal, &trained(family(Form::Tanh, 2)), (0.01, 6));
    assert!((moved / told - 1.0).abs() < 0.33 && moved > 2.0, "{moved} of {told}");
}
