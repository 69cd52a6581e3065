//! Family `pca-linear`: a ridge between the principal components of poses and of outputs
//! (PRT07 §5).

use std::sync::Arc;

use super::moments::{Moments, Scratch};
use super::output_basis::{OutputBasis, Outputs};
use super::report::Clock;
use super::ridge::{Choice, Regression, Unseen};
use super::shared::{self, Basis, Shared};
use super::source::Source;
use super::{Error, Fitted, Kept, Settings};
use crate::model::Decoder;
use crate::num::linalg::rows_of_mut;

/// The outputs in the basis, regressed on the poses.
struct Regressed {
    /// T̄, `[coefficient, output]`.
    mean: Vec<f64>,
    /// UᵀT, `[direction, coefficient, output]`.
    c: Vec<f64>,
    moments: Moments,
}

/// Pose components and outputs' basis first, then X^c by ridge between the two.
///
/// The basis is that of Y itself, not of Y about its mean, since the model stores no other mean:
/// each coefficient's mean lies in the basis as the intercept of X^c.
pub(super) fn fit(
    source: &Source<'_>,
    regression: &Regression<'_>,
    sizes: (Kept, Kept),
    (settings, shared): (&Settings, &Shared),
    clock: &mut Clock,
) -> Result<Fitted, Error> {
    let (inputs, wanted) = dimensions(regression, sizes)?;
    let groups = regression.coarse_groups();
    let find = |wanted| -> Result<Basis, Error> {
        let basis = OutputBasis::find(source, wanted, &groups, settings.seed)?;
        let projected = basis.project(source, &groups)?;
        Ok(Basis { basis, projected })
    };
    let found = match (wanted, shared.largest()) {
        (Outputs::Exactly(asked), Some(largest)) if asked <= largest.outputs => {
            let most = Outputs::AtMost(largest.outputs);
            shared.basis(shared::Outputs::of(settings), || find(most))?
        }
        _ => Arc::new(find(wanted)?),
    };
    let Basis { basis, projected } = &*found;
    let outputs = match wanted {
        Outputs::Exactly(asked) => asked,
        Outputs::AtMost(_) | Outputs::Retaining(_) => basis.outputs,
    };
    if !(1..=basis.outputs).contains(&outputs) {
        return Err(Error::Outputs { asked: outputs, available: basis.outputs });
    }
    clock.lap("output_pca_s");
    let regressed = regress(projected.t(outputs), regression);
    let choice = regression.choose(&regressed.moments, inputs)?;
    clock.lap("ridge_s");
    let columns = source.points() * source.width();
    let unseen =
        Unseen { outside: projected.outside(outputs), optimism: projected.optimism(outputs) };
    let mut report = regression.report(&choice, &regressed.moments, columns, unseen);
    report.spread_rms = (basis.spread / (source.poses() * columns) as f64).sqrt();
    if basis.spread > 0.0 {
        report.output_variance_retained = regressed.moments.total / basis.spread;
    }
    report.outputs = outputs;
    report.output_energy = basis.energy;
    report.output_spectrum.clone_from(&basis.spectrum);
    report.passes = basis.passes + 1;
    let (projection, coefficients) = decoder(regression, &choice, &regressed, outputs);
    let decoder = Decoder::PcaLinear { projection, coefficients, basis: basis.vectors(outputs) };
    Ok(Fitted { decoder, occluders: None, training: regression.summary(inputs, false), report })
}

/// d_in, checked, and what to ask of the basis.
fn dimensions(
    regression: &Regression<'_>,
    (inputs, outputs): (Kept, Kept),
) -> Result<(usize, Outputs), Error> {
    let design = regression.design;
    let (available, poses) = (design.rank(), design.poses());
    let asked = match inputs {
        Kept::Count(count) => count,
        Kept::Share(share) => design.retaining(share).max(1),
    };
    let outputs = match outputs {
        Kept::Count(count) => Outputs::Exactly(count),
        Kept::Share(share) => Outputs::Retaining(share),
    };
    if !(1..=available).contains(&asked) {
        return Err(Error::Inputs { asked, poses, available });
    }
    Ok((asked, outputs))
}

/// Centres T (p rows) and takes its moments with the poses.
fn regress(mut t: Vec<f64>, regression: &Regression<'_>) -> Regressed {
    let (poses, r) = (regression.design.poses(), regression.design.rank());
    let columns = t.len() / poses;
    let mut mean = vec![0.0; columns];
    for row in t.chunks_exact(columns) {
        mean.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
    }
    mean.iter_mut().for_each(|sum| *sum /= poses as f64);
    for row in t.chunks_exact_mut(columns) {
        row.iter_mut().zip(&mean).for_each(|(x, mean)| *x -= mean);
    }
    let absorber = regression.absorber();
    let mut moments = regression.moments();
    let mut scratch = Scratch::default();
    let mut c = vec![0.0; r * columns];
    let step = regression.columns();
    let mut b = Vec::new();
    for first in (0..columns).step_by(step) {
        let n = step.min(columns - first);
        b.clear();
        let row = |pose: usize| &t[pose * columns + first..][..n];
        (0..poses).for_each(|i| b.extend_from_slice(row(absorber.pose(i))));
        let c = rows_of_mut(&mut c, r, columns).subcols_mut(first, n);
        absorber.absorb(rows_of_mut(&mut b, poses, n), c, &mut moments, &mut scratch);
    }
    Regressed { mean, c, moments }
}

/// The projection `[parameter, d_in]` and X `[coefficient, d_in + 1, d_out]`.
fn decoder(
    regression: &Regression<'_>,
    choice: &Choice,
    regressed: &Regressed,
    outputs: usize,
) -> (Vec<f32>, Vec<f32>) {
    let (design, inputs) = (regression.design, choice.filter.inputs);
    let gains = choice.filter.gains(&design.s);
    let directions = design.directions(inputs);
    let projection: Vec<f32> =
        directions.row_iter().flat_map(|row| row.iter().map(|&x| x as f32)).collect();
    // The centre goes through the projection as it is stored, so that rounding it costs nothing.
    let mut centre = vec![0.0; inputs];
    for (row, x) in projection.chunks_exact(inputs).zip(&design.centre) {
        centre.iter_mut().zip(row).for_each(|(sum, &v)| *sum += x * f64::from(v));
    }
    let columns = regressed.mean.len();
    let mut coefficients = Vec::with_capacity(columns * (inputs + 1));
    for first in (0..columns).step_by(outputs) {
        let mut intercept = regressed.mean[first..first + outputs].to_vec();
        for k in 0..inputs {
            let c = &regressed.c[k * columns + first..][..outputs];
            for (intercept, c) in intercept.iter_mut().zip(c) {
                coefficients.push((gains[k] * c) as f32);
                *intercept -= centre[k] * gains[k] * c;
            }
        }
        coefficients.extend(intercept.iter().map(|&x| x as f32));
    }
    (projection, coefficients)
}
