//! Ridge with an unpenalised intercept by the normal equations in f64, refitted without each pose:
//! the slow way to leave one out.

use poselight::dataset::TrainingParts;

/// Root mean square over all poses and points of the error of fits that have not seen the pose.
pub(crate) fn left_out_rmse(parts: &TrainingParts, alpha: f64) -> f64 {
    let (poses, a) = (parts.clips.len(), parts.parameter_names.len());
    let points = parts.values.len() / poses;
    let mut sum = 0.0;
    for out in 0..poses {
        let rest: Vec<usize> = (0..poses).filter(|&pose| pose != out).collect();
        let (x_mean, x) = centred(&parts.parameters, a, &rest);
        let (y_mean, y) = centred(&parts.values, points, &rest);
        let mut gram = products(&x, a, &x, a);
        (0..a).for_each(|i| gram[i * a + i] += alpha * alpha);
        let solution = solve(gram, products(&x, a, &y, points), a);
        for (j, y_mean) in y_mean.iter().enumerate() {
            let along: f64 = (0..a)
                .map(|i| {
                    (f64::from(parts.parameters[out * a + i]) - x_mean[i])
                        * solution[i * points + j]
                })
                .sum();
            sum += (y_mean + along - f64::from(parts.values[out * points + j])).powi(2);
        }
    }
    (sum / parts.values.len() as f64).sqrt()
}

/// The mean of the rows, and the rows without it.
fn centred(values: &[f32], width: usize, rows: &[usize]) -> (Vec<f64>, Vec<f64>) {
    let at = |row: usize, j: usize| f64::from(values[row * width + j]);
    let mean: Vec<f64> = (0..width)
        .map(|j| rows.iter().map(|&row| at(row, j)).sum::<f64>() / rows.len() as f64)
        .collect();
    let all = rows.iter().flat_map(|&row| (0..width).map(move |j| (row, j)));
    let centred = all.map(|(row, j)| at(row, j) - mean[j]).collect();
    (mean, centred)
}

/// AᵀB of row-major matrices.
fn products(a: &[f64], a_width: usize, b: &[f64], b_width: usize) -> Vec<f64> {
    let mut out = vec![0.0; a_width * b_width];
    for (a, b) in a.chunks_exact(a_width).zip(b.chunks_exact(b_width)) {
        for (out, a) in out.chunks_exact_mut(b_width).zip(a) {
            out.iter_mut().zip(b).for_each(|(out, b)| *out += a * b);
        }
    }
    out
}

/// Gaussian elimination with pivots.
fn solve(mut matrix: Vec<f64>, mut right: Vec<f64>, n: usize) -> Vec<f64> {
    let width = right.len() / n;
    for k in 0..n {
        let pivot =
            (k..n).max_by(|&i, &j| matrix[i * n + k].abs().total_cmp(&matrix[j * n + k].abs()));
        let pivot = pivot.expect("a row is left");
        for j in 0..n {
            matrix.swap(k * n + j, pivot * n + j);
        }
        for j in 0..width {
            right.swap(k * width + j, pivot * width + j);
        }
        for i in (0..n).filter(|&i| i != k) {
            let factor = matrix[i * n + k] / matrix[k * n + k];
            for j in k..n {
                matrix[i * n + j] -= factor * matrix[k * n + j];
            }
            for j in 0..width {
                right[i * width + j] -= factor * right[k * width + j];
            }
        }
    }
    (0..n * width).map(|at| right[at] / matrix[at / width * n + at / width]).collect()
}
