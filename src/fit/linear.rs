//! Family `linear`: a ridge from all pose parameters to every output (PRT07 §4).

use rayon::prelude::*;

use super::design::Filter;
use super::moments::{Absorber, Moments, Scratch};
use super::report::Clock;
use super::ridge::{Regression, Unseen};
use super::source::{Block, Source};
use super::{Error, Fitted};
use crate::model::Decoder;
use crate::num::linalg::{Mat, multiply, rows_of, rows_of_mut};

/// Outputs whose weights are made at once.
const ROWS: usize = 1024;

/// What one block of points gives.
struct Part {
    mean: Vec<f64>,
    /// Cᵀ, `[point, coefficient, direction]`.
    c: Vec<f32>,
    moments: Moments,
}

/// min ‖A X − B‖² + α²‖X‖² on centred columns: X = V diag(s/(s²+α²)) UᵀB, in one pass. The pass
/// keeps C = UᵀB where the weights will be, since α is known only at its end.
pub(super) fn fit(
    source: &Source<'_>,
    regression: &Regression<'_>,
    clock: &mut Clock,
) -> Result<Fitted, Error> {
    let design = regression.design;
    let (a, r) = (design.centre.len(), design.rank());
    let outputs = source.points() * source.width();
    let absorber = regression.absorber();
    let mut moments = regression.moments();
    let mut mean = Vec::with_capacity(outputs);
    let mut weights = vec![0.0f32; outputs * a];
    source.map_fold(
        |block| Ok(absorb(block, source.poses(), regression, &absorber)),
        |_, part| {
            let rows = weights[mean.len() * a..].chunks_exact_mut(a.max(1));
            rows.zip(part.c.chunks_exact(r.max(1))).for_each(|(w, c)| w[..r].copy_from_slice(c));
            mean.extend(part.mean.iter().map(|&x| x as f32));
            moments.merge(&part.moments);
        },
    )?;
    clock.lap("pass_s");
    let choice = regression.choose(&moments, r)?;
    clock.lap("leave_out_s");
    solve(&mut weights, &mut mean, regression, &choice.filter);
    clock.lap("solve_s");
    let mut report = regression.report(&choice, &moments, outputs, Unseen::default());
    report.passes = 1;
    let training = regression.summary(r, true);
    Ok(Fitted { decoder: Decoder::Linear { mean, weights }, occluders: None, training, report })
}

fn absorb(
    block: &Block,
    poses: usize,
    regression: &Regression<'_>,
    absorber: &Absorber<'_>,
) -> Part {
    let r = regression.design.rank();
    let columns = block.values.len() / poses;
    let mut part =
        Part { mean: vec![0.0; columns], c: vec![0.0; columns * r], moments: regression.moments() };
    let step = regression.columns();
    let mut scratch = Scratch::default();
    let (mut b, mut c) = (Vec::new(), Vec::new());
    for first in (0..columns).step_by(step) {
        let n = step.min(columns - first);
        let mean = &mut part.mean[first..first + n];
        b.resize(poses * n, 0.0);
        c.resize(r * n, 0.0);
        centre(block, poses, first, mean, absorber, &mut b);
        let c_rows = rows_of_mut(&mut c, r, n);
        absorber.absorb(rows_of_mut(&mut b, poses, n), c_rows, &mut part.moments, &mut scratch);
        for (j, row) in c.chunks_exact(n).enumerate() {
            for (i, &x) in row.iter().enumerate() {
                part.c[(first + i) * r + j] = x as f32;
            }
        }
    }
    part
}

/// Columns of a block in f64 without their means, rows in the absorber's order.
fn centre(
    block: &Block,
    poses: usize,
    first: usize,
    mean: &mut [f64],
    absorber: &Absorber<'_>,
    b: &mut [f64],
) {
    let n = mean.len();
    let row = |pose: usize| &block.pose(pose, poses)[first..first + n];
    for pose in 0..poses {
        mean.iter_mut().zip(row(pose)).for_each(|(sum, &x)| *sum += f64::from(x));
    }
    mean.iter_mut().for_each(|sum| *sum /= poses as f64);
    for (i, b) in b.chunks_exact_mut(n).enumerate() {
        for ((b, mean), &x) in b.iter_mut().zip(&*mean).zip(row(absorber.pose(i))) {
            *b = f64::from(x) - mean;
        }
    }
}

/// Turns each row's C into weights, V diag(f) C, and moves the means to where the rounded centre is.
fn solve(weights: &mut [f32], mean: &mut [f32], regression: &Regression<'_>, filter: &Filter) {
    let design = regression.design;
    let (a, r) = (design.centre.len(), design.rank());
    if r == 0 {
        return;
    }
    let gains = filter.gains(&design.s);
    let solution = Mat::from_fn(r, a, |j, i| gains[j] * design.v[(i, j)]);
    let moved: Vec<f64> = design.rounding(r).iter().zip(&gains).map(|(m, g)| m * g).collect();
    weights.par_chunks_mut(ROWS * a).zip(mean.par_chunks_mut(ROWS)).for_each(|(weights, mean)| {
        let rows = weights.len() / a;
        let c: Vec<f64> =
            weights.chunks_exact(a).flat_map(|row| &row[..r]).map(|&x| f64::from(x)).collect();
        for (mean, c) in mean.iter_mut().zip(c.chunks_exact(r)) {
            let along: f64 = c.iter().zip(&moved).map(|(c, m)| c * m).sum();
            *mean = (f64::from(*mean) + along) as f32;
        }
        let mut out = vec![0.0; rows * a];
        multiply(rows_of_mut(&mut out, rows, a), rows_of(&c, rows, r), solution.as_ref());
        weights.iter_mut().zip(&out).for_each(|(w, &x)| *w = x as f32);
    });
}
