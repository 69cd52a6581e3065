//! What each family computes, by properties.

use rayon::ThreadPoolBuilder;

use super::*;
use crate::fit::Kept;
use crate::fit::design::{Design, Filter};
use crate::num::linalg::thin_svd;

const SMALL: Sizes = Sizes { poses: 30, parameters: 6, points: 11, coefficients: 4 };

/// Y as (pose, coefficient) × point.
fn rows(parts: &TrainingParts) -> Mat<f64> {
    let (v, c) = (parts.points, parts.channels * parts.coefficients);
    Mat::from_fn(parts.clips.len() * c, v, |row, point| {
        f64::from(parts.values[((row / c) * v + point) * c + row % c])
    })
}

/// Proves that the mean is the mean, in every frame of a scalar signal.
#[test]
fn mean_is_the_mean() {
    let parts = synthetic(Sizes { coefficients: 1, ..SMALL }, 1.0, 1);
    for frame in [Frame::Root, Frame::Bone] {
        let fitted = run(&parts, &Settings { frame, ..settings(Family::Mean) });
        let Decoder::Mean { mean } = &fitted.decoder else { panic!("not a mean") };
        let p = parts.clips.len();
        for (point, &mean) in mean.iter().enumerate() {
            let sum: f64 = (0..p).map(|i| truth(&parts, i)[point]).sum();
            assert!((f64::from(mean) - sum / p as f64).abs() < 1e-6);
        }
        let spread: f64 = (0..p)
            .flat_map(|i| truth(&parts, i).into_iter().zip(mean))
            .map(|(y, &m)| (y - f64::from(m)).powi(2))
            .sum();
        let rms = (spread / (p * mean.len()) as f64).sqrt();
        assert!((fitted.report.spread_rms - rms).abs() < 1e-6);
        assert_eq!(fitted.report.alpha, None);
    }
}

/// Proves that ridge solutions equal those of the normal equations in f64, for several α, and that
/// the reported error on the training poses is theirs.
#[test]
fn ridge_solves_the_normal_equations() {
    let parts = synthetic(SMALL, 0.5, 2);
    let all: Vec<usize> = (0..SMALL.poses).collect();
    for alpha in [0.0, 0.1, 3.0, 1e3] {
        let ridge = Ridge::Fixed(alpha);
        let fitted = run(&parts, &Settings { ridge, ..settings(Family::Linear) });
        let oracle = Oracle::fit(&parts, &all, alpha, usize::MAX);
        let x = |pose: usize| &parts.parameters[pose * 6..(pose + 1) * 6];
        let difference = worst(&parts, &fitted, |pose| oracle.predict(x(pose)));
        assert!(difference < 2e-5, "alpha {alpha}: {difference}");
        let square = |pose: usize| -> f64 {
            let pairs = oracle.predict(x(pose)).into_iter().zip(truth(&parts, pose));
            pairs.map(|(p, y)| (p - y).powi(2)).sum()
        };
        let rmse = (all.iter().map(|&i| square(i)).sum::<f64>() / parts.values.len() as f64).sqrt();
        assert!((fitted.report.training_rmse - rmse).abs() < 1e-6 * rmse);
    }
}

/// Proves the filter factors: gain s/(s²+α²), share left α²/(s²+α²), their sum rule, and the
/// degrees of freedom between 1 (α → ∞) and rank + 1 (α = 0).
#[test]
fn filters_are_those_of_tikhonov() {
    let parts = synthetic(SMALL, 0.5, 3);
    let design = Design::new(&parts.parameters, &parts.parameter_names, SMALL.poses).unwrap();
    for alpha in [0.0, 0.5, 20.0] {
        let filter = Filter { alpha, inputs: 4 };
        let (gains, left) = (filter.gains(&design.s), filter.left(&design.s));
        for (j, s) in design.s.iter().enumerate() {
            assert!((gains[j] * s + left[j] - 1.0).abs() < 1e-14);
            assert_eq!(gains[j] == 0.0, j >= 4);
        }
    }
    let degrees = |alpha, inputs| Filter { alpha, inputs }.degrees_of_freedom(&design.s);
    assert_eq!(degrees(0.0, 6), 7.0);
    assert_eq!(degrees(0.0, 4), 5.0);
    assert!(degrees(1e9, 6) - 1.0 < 1e-12);
    assert!(degrees(1.0, 6) > degrees(2.0, 6));
}

/// Proves that α → ∞ ends in the mean and α → 0 in `trained`, without a jump anywhere.
#[test]
fn alpha_has_sane_limits() {
    let parts = synthetic(SMALL, 0.5, 4);
    let at =
        |alpha| run(&parts, &Settings { ridge: Ridge::Fixed(alpha), ..settings(Family::Linear) });
    let mean = run(&parts, &settings(Family::Mean));
    let mean = predict(&mean, &[0.0; 6], 4);
    assert!(worst(&parts, &at(1e6), |_| mean.clone()) < 1e-4);
    let exact = run(&parts, &trained(Family::Linear));
    let of = |fitted: &Fitted, pose: usize| predict(fitted, &parts.parameters[pose * 6..][..6], 4);
    assert!(worst(&parts, &at(1e-6), |pose| of(&exact, pose)) < 1e-5);
    assert!(exact.report.alphas.is_empty() && exact.report.alpha == Some(0.0));
    let errors: Vec<f64> =
        [0.0, 0.1, 1.0, 10.0, 100.0].map(|alpha| at(alpha).report.training_rmse).into();
    assert!(errors.windows(2).all(|pair| pair[0] < pair[1]), "{errors:?}");
}

/// Proves that `trained` reproduces data that are linear, to f32 round-off.
#[test]
fn trained_compresses_linear_data_without_loss() {
    let parts = synthetic(SMALL, 0.0, 5);
    for family in [Family::Linear, Family::PcaLinear { inputs: 6, outputs: 11 }] {
        let fitted = run(&parts, &trained(family));
        assert!(worst(&parts, &fitted, |pose| truth(&parts, pose)) < 3e-5);
    }
}

/// Proves that with all pose and output dimensions `pca-linear` is `linear`, for an α that both
/// choose.
#[test]
fn full_pca_is_linear() {
    let parts = synthetic(SMALL, 0.5, 6);
    for ridge in [Ridge::LeaveOneOut, Ridge::LeaveOneClipOut, Ridge::Fixed(2.0)] {
        let with = |family| run(&parts, &Settings { ridge, ..settings(family) });
        let linear = with(Family::Linear);
        let pca = with(Family::PcaLinear { inputs: 6, outputs: 11 });
        assert_eq!(linear.report.alpha, pca.report.alpha);
        for (a, b) in linear.report.alphas.iter().zip(&pca.report.alphas) {
            assert!((a.1 - b.1).abs() < 1e-5 * a.1, "{a:?} {b:?}");
        }
        let of = |pose: usize| predict(&linear, &parts.parameters[pose * 6..][..6], 4);
        assert!(worst(&parts, &pca, of) < 3e-5);
    }
}

/// Proves that the basis is orthonormal, that its residual is that of the exact decomposition of
/// the same rows, and that the reported spectrum is the exact one.
#[test]
fn basis_is_the_exact_one() {
    let sizes = Sizes { poses: 40, parameters: 6, points: 150, coefficients: 4 };
    let parts = synthetic(sizes, 0.3, 7);
    let exact = thin_svd(rows(&parts).as_ref()).unwrap();
    for outputs in [1, 3, 20] {
        let fitted = run(&parts, &trained(Family::PcaLinear { inputs: 6, outputs }));
        let Decoder::PcaLinear { basis, .. } = &fitted.decoder else { panic!("not a basis") };
        let basis = Mat::from_fn(150, outputs, |i, j| f64::from(basis[i * outputs + j]));
        let defect = basis.transpose() * &basis - Mat::<f64>::identity(outputs, outputs);
        assert!(defect.norm_max() < 1e-6, "{}", defect.norm_max());
        let residual = rows(&parts) - rows(&parts) * &basis * basis.transpose();
        let least: f64 = exact.s[outputs..].iter().map(|s| s * s).sum();
        let found = residual.squared_norm_l2();
        assert!(found < 1.01 * least, "{outputs} outputs leave {found}, could leave {least}");
        let energy: f64 = exact.s.iter().map(|s| s * s).sum();
        assert!((fitted.report.output_energy - energy).abs() < 1e-6 * energy);
        assert!(fitted.report.output_spectrum.len() >= 100);
        let mean = run(&parts, &settings(Family::Mean)).report;
        assert!((fitted.report.spread_rms - mean.spread_rms).abs() < 1e-9 * mean.spread_rms);
        let retained = fitted.report.output_variance_retained;
        assert!(retained > 0.0 && retained < 1.0, "{retained}");
        for (found, s) in fitted.report.output_spectrum.iter().zip(&exact.s).take(outputs) {
            assert!((found - s * s).abs() < 1e-2 * s * s + 1e-6 * energy);
        }
    }
}

/// Proves that the fewest dimensions are found that leave the rest of a share of the variance about the mean
/// outside, where the sketch has to grow for it and the mean has most of the energy; that a share on one side
/// goes with a number on the other.
#[test]
fn retained_shares_are_held() {
    let sizes = Sizes { poses: 60, parameters: 9, points: 300, coefficients: 4 };
    let mut parts = synthetic(sizes, 0.0, 8);
    let mut stream = Stream::new(9);
    let mean: Vec<f32> = (0..300 * 4).map(|_| 5.0 * stream.normal() as f32).collect();
    for pose in parts.values.chunks_exact_mut(mean.len()) {
        pose.iter_mut().zip(&mean).for_each(|(y, mean)| *y = mean + stream.normal() as f32);
    }
    let exact = thin_svd(rows(&parts).as_ref()).unwrap();
    let squares: Vec<f64> = exact.s.iter().map(|s| s * s).collect();
    for share in [0.05, 0.5, 0.9, 1.0] {
        let (inputs, outputs) = (Kept::Share(0.7), Kept::Share(share));
        let fitted = run(&parts, &trained(Family::PcaRetaining { inputs, outputs }));
        let spread = fitted.report.spread_rms.powi(2) * parts.values.len() as f64;
        assert!(spread < 0.1 * squares.iter().sum::<f64>(), "the mean is to have most");
        let held = |count: usize| 1.0 - squares[count..].iter().sum::<f64>() / spread;
        let count = fitted.report.outputs;
        assert!(held(count) >= share - 1e-3, "{count} outputs hold {}", held(count));
        // A flat spectrum is found to a hundredth.
        assert!(held(count - 1) < share + 1e-2, "{count} outputs are too many");
        let variances = &fitted.report.pose_spectrum;
        let total: f64 = variances.iter().sum();
        let inputs = fitted.report.inputs;
        assert!(variances[..inputs].iter().sum::<f64>() >= 0.7 * total);
        assert!(variances[..inputs - 1].iter().sum::<f64>() < 0.7 * total);
    }
    let sizes = |inputs, outputs| {
        let report = run(&parts, &trained(Family::PcaRetaining { inputs, outputs })).report;
        (report.inputs, report.outputs)
    };
    assert_eq!(sizes(Kept::Share(1.0), Kept::Count(7)), (9, 7));
    let (inputs, outputs) = sizes(Kept::Count(2), Kept::Share(0.05));
    assert!(inputs == 2 && outputs > 4, "{outputs}");
}

/// Proves that the distance to the training poses has what it needs: orthonormal directions,
/// deviations that make the training poses' own coordinates have unit variance.
#[test]
fn summary_describes_the_cloud_of_poses() {
    let parts = synthetic(SMALL, 0.5, 10);
    let fitted = run(&parts, &settings(Family::PcaLinear { inputs: 3, outputs: 4 }));
    let Decoder::PcaLinear { projection, .. } = &fitted.decoder else { panic!("not pca") };
    let training = &fitted.training;
    assert!(training.directions.is_empty());
    let linear = run(&parts, &settings(Family::Linear)).training;
    assert_eq!((linear.directions.len(), linear.deviations.len()), (36, 6));
    assert!(linear.residual_rms < 1e-6);
    let mut outside = 0.0;
    for k in 0..3 {
        let along = |x: &[f32]| -> f64 {
            let term =
                |j: usize| f64::from(x[j] - training.centre[j]) * f64::from(projection[j * 3 + k]);
            (0..6).map(term).sum()
        };
        let square: f64 = parts.parameters.chunks_exact(6).map(|x| along(x).powi(2)).sum();
        let deviation = (square / 29.0).sqrt();
        assert!((deviation / f64::from(training.deviations[k]) - 1.0).abs() < 1e-5);
        outside -= square;
    }
    for x in parts.parameters.chunks_exact(6) {
        outside +=
            x.iter().zip(&training.centre).map(|(x, c)| f64::from(x - c).powi(2)).sum::<f64>();
    }
    assert!(((outside / 30.0).sqrt() / f64::from(training.residual_rms) - 1.0).abs() < 1e-4);
}

/// Proves that bytes do not depend on the number of threads, for every family.
#[test]
fn threads_do_not_change_bytes() {
    let sizes = Sizes { poses: 50, parameters: 5, points: 300, coefficients: 9 };
    let mut parts = synthetic(sizes, 0.3, 11);
    parts.clips.iter_mut().enumerate().for_each(|(i, clip)| *clip = (i / 15) as i32);
    for family in [Family::Mean, Family::Linear, Family::PcaLinear { inputs: 3, outputs: 8 }] {
        let settings = Settings { family, ..Settings::default() };
        let fits = [1, 2, 5].map(|threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(&parts, &settings))
        });
        for other in &fits[1..] {
            assert!(fits[0].decoder == other.decoder && fits[0].training == other.training);
            assert_eq!(fits[0].report.alphas, other.report.alphas);
            assert_eq!(fits[0].report.output_spectrum, other.report.output_spectrum);
        }
    }
}
