//! How long a model takes to evaluate, on one core.

use std::hint::black_box;
use std::time::Instant;

use super::imported::Imported;
use super::{Error, encoding};
use crate::dataset::Dataset;
use crate::model::{Model, PosedInput, Signal};

/// Microseconds of one evaluation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EvaluationTimes {
    /// All coefficients of all points, the model's frame; the root frame where the model looks at
    /// the posed mesh.
    pub(super) all_us: f64,
    /// One number per point under one light; absent where the signal does not fold.
    pub(super) folded_us: Option<f64>,
}

/// Repetitions, of which the median counts.
const REPETITIONS: usize = 21;

/// Times evaluation at the data set's first pose.
pub(super) fn evaluate(model: &Model, dataset: &Imported<'_>) -> Result<EvaluationTimes, Error> {
    let layout = &dataset.header().layout;
    let parameters = encoding::parameters(model, dataset)?;
    let parameters = &parameters[..model.header().parameters()];
    let mut out = vec![0.0; layout.points * model.header().width()];
    let all_us = if model.needs_surface() {
        let surface = dataset.job()?.surface(0, model.turns_with_tangents());
        let input = PosedInput {
            parameters,
            bone_rotations: &dataset.bone_rotations()[..layout.bones],
            surface: Some(surface.as_surface()),
        };
        median_us(|| Ok(model.evaluate_posed(black_box(&input), &mut out)?))?
    } else {
        median_us(|| Ok(model.evaluate(black_box(parameters), None, &mut out)?))?
    };
    Ok(EvaluationTimes { all_us, folded_us: folded(model, dataset, parameters)? })
}

fn folded(model: &Model, dataset: &Dataset, parameters: &[f32]) -> Result<Option<f64>, Error> {
    if model.needs_surface()
        || model.header().signal == Signal::Visibility
        || model.header().channels != 1
    {
        return Ok(None);
    }
    let light = vec![1.0; model.header().coefficients()];
    let bones = dataset.header().layout.bones;
    let fold = model.fold(&light, &dataset.bone_rotations()[..bones])?;
    let mut out = vec![0.0; dataset.header().layout.points];
    median_us(|| Ok(fold.evaluate(black_box(parameters), &mut out)?)).map(Some)
}

fn median_us(mut work: impl FnMut() -> Result<(), Error>) -> Result<f64, Error> {
    work()?;
    let mut times = Vec::with_capacity(REPETITIONS);
    for _ in 0..REPETITIONS {
        let start = Instant::now();
        work()?;
        times.push(start.elapsed().as_secs_f64() * 1e6);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[REPETITIONS / 2])
}
