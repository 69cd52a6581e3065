//! Data at the edge of what a fit can use, and beyond it.

use super::*;
use crate::fit::{Error, Kept};

const SMALL: Sizes = Sizes { poses: 12, parameters: 4, points: 5, coefficients: 4 };
const PCA: Family = Family::PcaLinear { inputs: 2, outputs: 2 };

fn refusal(parts: &TrainingParts, settings: &Settings) -> Error {
    fit(&Training::in_memory(parts.clone()), settings).unwrap_err()
}

/// Proves that poses that do not vary, one or several, give the mean with a notice where a family
/// can express it, and a sentence that names the remedy where it cannot.
#[test]
fn poses_without_variation_give_the_mean() {
    let mut one = synthetic(Sizes { poses: 1, ..SMALL }, 0.5, 1);
    let mut two = synthetic(Sizes { poses: 2, ..SMALL }, 0.5, 2);
    two.parameters.copy_within(0..4, 4);
    let half = two.values.len() / 2;
    two.values.copy_within(0..half, half);
    let mut none = one.clone();
    (none.parameters, none.parameter_names) = (Vec::new(), Vec::new());
    for parts in [&mut one, &mut two, &mut none] {
        for ridge in [Ridge::LeaveOneOut, Ridge::LeaveOneClipOut, Ridge::Fixed(1.0)] {
            let fitted = run(parts, &Settings { ridge, ..settings(Family::Linear) });
            assert!(worst(parts, &fitted, |pose| truth(parts, pose)) < 1e-6);
            let Decoder::Linear { weights, .. } = &fitted.decoder else { panic!("not linear") };
            assert!(weights.iter().all(|w| *w == 0.0));
            assert_eq!(fitted.report.notices.len(), 1);
            assert_eq!(fitted.report.degrees_of_freedom, 1.0);
            assert!(fitted.training.deviations.is_empty());
        }
        run(parts, &settings(Family::Mean));
        let error = refusal(parts, &settings(PCA));
        assert!(matches!(error, Error::Inputs { asked: 2, available: 0, .. }));
        assert!(error.to_string().ends_with("vary in 0; use the family `mean`"), "{error}");
    }
}

/// Proves that two different poses span one direction, and only one.
#[test]
fn two_poses_have_one_direction() {
    let parts = synthetic(Sizes { poses: 2, ..SMALL }, 0.0, 3);
    let fitted = run(&parts, &trained(Family::Linear));
    assert!(worst(&parts, &fitted, |pose| truth(&parts, pose)) < 1e-5);
    assert_eq!(fitted.report.inputs, 1);
    assert!(matches!(refusal(&parts, &settings(PCA)), Error::Inputs { available: 1, .. }));
}

/// Proves that with fewer poses than parameters the data are met exactly without regularisation,
/// and that leaving out still chooses an α.
#[test]
fn fewer_poses_than_parameters_work() {
    let parts = synthetic(Sizes { poses: 6, parameters: 20, ..SMALL }, 0.2, 4);
    let exact = run(&parts, &trained(Family::Linear));
    assert!(worst(&parts, &exact, |pose| truth(&parts, pose)) < 1e-4);
    assert_eq!(exact.report.degrees_of_freedom, 6.0);
    let chosen = run(&parts, &settings(Family::Linear));
    assert!(chosen.report.alphas.iter().all(|(_, error)| error.is_finite()));
}

/// Proves that constant, duplicated and collinear parameters do not blow up `trained`: they add no
/// direction, and predictions are those without them.
#[test]
fn redundant_parameters_add_nothing() {
    let plain = synthetic(SMALL, 0.3, 5);
    let mut redundant = plain.clone();
    redundant.parameters = (plain.parameters.chunks_exact(4))
        .flat_map(|x| [x[0], x[1], x[2], x[3], 7.25, x[0], x[1] + 0.3 * x[2]])
        .collect();
    redundant.parameter_names = (0..7).map(|j| format!("p{j}")).collect();
    let [a, b] = [&plain, &redundant].map(|parts| run(parts, &trained(Family::Linear)));
    assert_eq!((a.report.inputs, b.report.inputs), (4, 4));
    let of = |pose: usize| predict(&a, &plain.parameters[pose * 4..][..4], 4);
    assert!(worst(&redundant, &b, of) < 2e-5);
}

/// Proves that outputs which are all zero give zero with the strongest regularisation, and that a
/// basis of nothing is refused.
#[test]
fn zero_outputs_give_zero() {
    let mut parts = synthetic(SMALL, 0.0, 6);
    parts.values.fill(0.0);
    let fitted = run(&parts, &settings(Family::Linear));
    assert_eq!(worst(&parts, &fitted, |pose| truth(&parts, pose)), 0.0);
    assert_eq!(fitted.report.alpha, fitted.report.alphas.last().map(|(alpha, _)| *alpha));
    let error = refusal(&parts, &settings(PCA));
    assert!(matches!(error, Error::Outputs { asked: 2, available: 0 }), "{error}");
}

/// Proves that a point whose signal never varies keeps its value.
#[test]
fn constant_outputs_stay_constant() {
    let mut parts = synthetic(SMALL, 0.3, 7);
    parts.values.chunks_exact_mut(20).for_each(|pose| pose[4..8].fill(0.25));
    let fitted = run(&parts, &settings(Family::Linear));
    for x in [[0.0; 4], [5.0, -3.0, 2.0, 8.0]] {
        assert!(predict(&fitted, &x, 4)[4..8].iter().all(|y| (y - 0.25).abs() < 1e-9));
    }
}

/// Proves that a number which is not finite is refused and named, in parameters, outputs and
/// rotations.
#[test]
fn what_is_not_finite_is_named() {
    let parts = synthetic(SMALL, 0.3, 8);
    let mut broken = parts.clone();
    broken.parameters[2 * 4 + 3] = f32::NAN;
    let error = refusal(&broken, &settings(Family::Linear));
    assert!(
        error.to_string().starts_with("pose parameter `joint3.x` is NaN at training pose 2"),
        "{error}"
    );
    let mut broken = parts.clone();
    broken.values[(3 * 5 + 2) * 4 + 1] = f32::INFINITY;
    for family in [Family::Mean, Family::Linear, PCA] {
        let error = refusal(&broken, &settings(family));
        let expected = "coefficient 1 of point 2 is inf at training pose 3";
        assert!(error.to_string().starts_with(expected), "{error}");
    }
    let mut broken = parts;
    broken.bone_rotations[5] = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    let error = refusal(&broken, &Settings { frame: Frame::Bone, ..settings(Family::Mean) });
    assert!(matches!(error, Error::Rotation { bone: 0, pose: 5, .. }), "{error}");
}

/// Proves that sizes and numbers out of range are refused with the range.
#[test]
fn settings_out_of_range_are_refused() {
    let parts = synthetic(SMALL, 0.3, 9);
    let pca = |inputs, outputs| refusal(&parts, &settings(Family::PcaLinear { inputs, outputs }));
    assert!(matches!(pca(5, 2), Error::Inputs { asked: 5, available: 4, poses: 12 }));
    assert!(matches!(pca(0, 2), Error::Inputs { asked: 0, .. }));
    assert!(matches!(pca(2, 6), Error::Outputs { asked: 6, available: 5 }));
    assert!(matches!(pca(2, 0), Error::Outputs { asked: 0, .. }));
    for alpha in [-1.0, f64::NAN, f64::INFINITY] {
        let ridge = Ridge::Fixed(alpha);
        let error = refusal(&parts, &Settings { ridge, ..settings(Family::Linear) });
        assert!(matches!(error, Error::Alpha { .. }));
    }
    for (inputs, outputs) in [(0.0, 0.5), (0.5, 1.5), (f64::NAN, 0.5)] {
        let (inputs, outputs) = (Kept::Share(inputs), Kept::Share(outputs));
        let error = refusal(&parts, &settings(Family::PcaRetaining { inputs, outputs }));
        assert!(matches!(error, Error::Share { .. }));
    }
}

/// Proves that outputs of a lower rank than the basis asked for are noticed, to f32 precision.
#[test]
fn rank_of_outputs_is_found() {
    let mut parts = synthetic(Sizes { points: 40, ..SMALL }, 0.3, 10);
    for row in parts.values.chunks_exact_mut(40 * 4) {
        for i in 3 * 4..row.len() {
            row[i] = row[i % 12] * ((i / 12) as f32 + 1.0);
        }
    }
    run(&parts, &settings(Family::PcaLinear { inputs: 2, outputs: 3 }));
    let error = refusal(&parts, &settings(Family::PcaLinear { inputs: 2, outputs: 4 }));
    assert!(matches!(error, Error::Outputs { asked: 4, available: 3 }), "{error}");
}

/// Proves that an empty training set is refused by name.
#[test]
fn nothing_is_refused() {
    let parts = synthetic(Sizes { points: 0, ..SMALL }, 0.3, 11);
    assert!(matches!(refusal(&parts, &settings(Family::Mean)), Error::Empty { what: "points" }));
    let parts = synthetic(Sizes { poses: 0, ..SMALL }, 0.3, 11);
    assert!(matches!(refusal(&parts, &settings(Family::Mean)), Error::Empty { what: "poses" }));
}
