//! The families of pose clusters and point clusters where data and sizes are extreme: what they
//! give stays finite, and what has a known answer gives it.

use super::local::{clustered_family, multilinear_family, rmse};
use super::*;
use crate::fit::{Error, MultilinearSizes, PointClusters};
use crate::model::Form;

const SIZES: Sizes = Sizes { poses: 24, parameters: 4, points: 7, coefficients: 1 };

fn families() -> Vec<Family> {
    let none = PointClusters::None;
    vec![
        multilinear_family(1, 1, none),
        multilinear_family(3, 2, PointClusters::Count(3)),
        clustered_family(Form::Linear, 1),
        clustered_family(Form::Quadratic, 1),
        clustered_family(Form::Tanh, 1),
    ]
}

/// Whatever is said at a pose, as f64, must be finite.
fn finite(parts: &TrainingParts, fitted: &Fitted, pose: &[f32]) -> bool {
    let numbers = predict(fitted, pose, parts.channels * parts.coefficients);
    numbers.iter().all(|y| y.is_finite()) && fitted.report.training_rmse.is_finite()
}

fn changed(change: impl Fn(usize, f32) -> f32) -> TrainingParts {
    let mut parts = synthetic(SIZES, 0.1, 11);
    for (i, x) in parts.parameters.iter_mut().enumerate() {
        *x = change(i % SIZES.parameters, *x);
    }
    parts
}

/// Parameters scaled by 1e±8 give the same errors: a model of joint angles in degrees, or of
/// micrometres, is the same model. Shifted by 1e4 they lose what f32 loses, no more.
#[test]
fn units_do_not_matter() {
    for family in families() {
        let error = |parts: &TrainingParts| rmse(parts, &run(parts, &trained(family)));
        let plain = error(&changed(|_, x| x));
        for scale in [1e8, 1e-8] {
            let scaled = error(&changed(|_, x| x * scale));
            assert!((scaled - plain).abs() < 0.02 * (plain + 0.05), "{family:?}: {scaled} {plain}");
        }
        let shifted = error(&changed(|_, x| x + 1e4));
        assert!((shifted - plain).abs() < 0.05 * (plain + 0.05), "{family:?}: {shifted} {plain}");
    }
}

/// Duplicated poses, duplicated and constant parameters: finite, and no worse than the mean.
#[test]
fn redundant_data_stay_finite() {
    let mut twins = synthetic(SIZES, 0.1, 12);
    let (a, y) = (SIZES.parameters, SIZES.points);
    for pose in (1..SIZES.poses).step_by(2) {
        twins.parameters.copy_within((pose - 1) * a..pose * a, pose * a);
        twins.values.copy_within((pose - 1) * y..pose * y, pose * y);
    }
    let first = changed(|_, x| x).parameters;
    let mut copies = synthetic(SIZES, 0.1, 13);
    for (i, x) in copies.parameters.iter_mut().enumerate() {
        let (pose, column) = (i / a, i % a);
        *x = [first[pose * a], first[pose * a], 3.0, first[pose * a + 1]][column];
    }
    for parts in [&twins, &copies] {
        for family in families() {
            for settings in [trained(family), settings(family)] {
                let fitted = run(parts, &settings);
                assert!(finite(parts, &fitted, &parts.parameters[..a]), "{family:?}");
                assert!(fitted.report.training_rmse <= fitted.report.spread_rms * 1.0001);
            }
        }
    }
}

/// Outputs all zero and all one are given back; a NaN is refused with its place.
#[test]
fn constant_outputs_are_exact() {
    for value in [0.0, 1.0] {
        let mut parts = synthetic(SIZES, 0.1, 14);
        parts.values.fill(value);
        for family in families() {
            let fitted = run(&parts, &settings(family));
            let found = predict(&fitted, &parts.parameters[..SIZES.parameters], 1);
            let off = found.iter().map(|y| (y - f64::from(value)).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6, "{family:?}: {off}");
        }
    }
    let mut parts = synthetic(SIZES, 0.1, 15);
    parts.values[SIZES.points + 3] = f32::NAN;
    for family in families() {
        let error = fit(&Training::in_memory(parts.clone()), &settings(family)).unwrap_err();
        assert!(matches!(error, Error::Value { pose: 1, point: 3, .. }), "{error}");
    }
}

/// Every exponent of the blend from 0 to 100 is finite, at the centres, between them, and far
/// outside all poses; one beyond is refused.
#[test]
fn every_blend_is_finite() {
    let parts = synthetic(SIZES, 0.1, 16);
    for blend_exponent in [0.0, 0.5, 1.0, 10.0, 100.0] {
        let sizes = MultilinearSizes {
            clusters: SIZES.poses,
            inputs: 1,
            points: PointClusters::None,
            published: false,
            blend_exponent,
        };
        let fitted = run(&parts, &trained(Family::Multilinear(sizes)));
        let a = SIZES.parameters;
        for pose in parts.parameters.chunks_exact(a) {
            assert!(finite(&parts, &fitted, pose));
        }
        assert!(finite(&parts, &fitted, &[1e6; 4]));
    }
    let mut family = multilinear_family(2, 1, PointClusters::None);
    if let Family::Multilinear(sizes) = &mut family {
        sizes.blend_exponent = 101.0;
    }
    let error = fit(&Training::in_memory(parts), &settings(family)).unwrap_err();
    assert!(matches!(error, Error::Number { .. }), "{error}");
}

/// Two poses have one direction, one pose has none: the first fits, the second is refused with a
/// hint, and nothing panics with a single point.
#[test]
fn few_poses_and_points() {
    for points in [1, 7] {
        let two = synthetic(Sizes { poses: 2, points, ..SIZES }, 0.1, 17);
        for family in
            [multilinear_family(2, 1, PointClusters::None), clustered_family(Form::Tanh, 1)]
        {
            let fitted = run(&two, &trained(family));
            assert!(finite(&two, &fitted, &two.parameters[..4]), "{family:?}");
        }
    }
    let one = synthetic(Sizes { poses: 1, ..SIZES }, 0.1, 18);
    for family in families() {
        let error = fit(&Training::in_memory(one.clone()), &settings(family)).unwrap_err();
        assert!(matches!(error, Error::Inputs { available: 0, .. }), "{error}");
    }
}
