//! Family `mean`: the baseline that every table shows.

use super::design::Design;
use super::report::Clock;
use super::source::{Block, Source};
use super::{Error, FitReport, Fitted, ridge};
use crate::model::Decoder;

/// ȳ = (1/p) Σ_i y_i for every point and coefficient.
pub(super) fn fit(
    source: &Source<'_>,
    design: &Design,
    clock: &mut Clock,
) -> Result<Fitted, Error> {
    let poses = source.poses();
    let (mut mean, mut spread) = (Vec::new(), 0.0);
    source.map_fold(
        |block| Ok(moments(block, poses)),
        |_, (means, deviations)| {
            mean.extend(means.iter().map(|&x| x as f32));
            spread += deviations;
        },
    )?;
    clock.lap("pass_s");
    let numbers = (poses * mean.len()) as f64;
    let rmse = (spread / numbers).sqrt();
    let report = FitReport {
        training_rmse: rmse,
        spread_rms: rmse,
        degrees_of_freedom: 1.0,
        pose_spectrum: design.variances(),
        output_variance_retained: 1.0,
        passes: 1,
        ..FitReport::default()
    };
    let training = ridge::summary(design, design.rank(), true);
    Ok(Fitted { decoder: Decoder::Mean { mean }, occluders: None, training, report })
}

/// Mean of every column of a block, and the sum of squared deviations from them.
pub(super) fn moments(block: &Block, poses: usize) -> (Vec<f64>, f64) {
    let mut mean = vec![0.0f64; block.values.len() / poses];
    for pose in 0..poses {
        mean.iter_mut().zip(block.pose(pose, poses)).for_each(|(sum, &x)| *sum += f64::from(x));
    }
    mean.iter_mut().for_each(|sum| *sum /= poses as f64);
    let mut squares = vec![0.0f64; mean.len()];
    for pose in 0..poses {
        let deviations = mean.iter().zip(block.pose(pose, poses));
        for (square, (mean, &x)) in squares.iter_mut().zip(deviations) {
            let deviation = f64::from(x) - mean;
            *square += deviation * deviation;
        }
    }
    (mean, squares.iter().sum())
}
