//! The cases of what is done with a fitted model: storage, turning, poses far outside.

use super::fixture::{PLAIN, Sizes, data, fitted, model, settings, trained};
use super::suite::{F32, Row, deviation, families, own, row};
use poselight::dataset::TrainingParts;
use poselight::fit::{Family, Fitted, Settings};
use poselight::model::{Frame, Model, PosedInput, Precision};

fn stored(model: &Model, precision: Precision) -> Option<Model> {
    let bytes = model.to_bytes(precision).ok()?;
    Model::from_bytes(&bytes).ok()
}

/// Largest difference of a stored model from the exact one at the training poses, over `of`.
fn stored_error(parts: &TrainingParts, fitted: &Fitted, precision: Precision, of: f64) -> f64 {
    let exact = model(parts, fitted, Frame::Root);
    let Some(rounded) = stored(&exact, precision) else { return f64::INFINITY };
    let mut both = [vec![0.0; parts.points], vec![0.0; parts.points]];
    let mut worst = 0.0_f64;
    for pose in parts.parameters.chunks_exact(parts.parameter_names.len()) {
        for (model, out) in [&exact, &rounded].into_iter().zip(&mut both) {
            model.evaluate(pose, None, out).expect("evaluates");
        }
        let pairs = both[0].iter().zip(&both[1]);
        worst = pairs.map(|(a, b)| f64::from((a - b).abs())).fold(worst, f64::max);
    }
    worst / of
}

pub(crate) fn storage() -> Vec<Row> {
    let mut rows = Vec::new();
    let scaled = |scale: f32| {
        let mut parts = data(PLAIN, 19);
        parts.values.iter_mut().for_each(|y| *y *= scale);
        parts.noise_variance = 0.0;
        parts
    };
    let large = scaled(1e6);
    let fitted_large = fitted(&large, &trained(Family::Linear));
    let refused = model(&large, &fitted_large, Frame::Root).to_bytes(Precision::F16).is_err();
    let failed = f64::from(u8::from(!refused));
    rows.push(row("f16, values of 1e6", "refused: they overflow (0 is yes)", failed, 0.0));
    let small = scaled(1e-6);
    let fitted_small = fitted(&small, &trained(Family::Linear));
    let of = 1e-6;
    for (precision, bound) in [(Precision::F16, 0.2), (Precision::I8, 0.02)] {
        let error = stored_error(&small, &fitted_small, precision, of);
        let case = format!("{precision}, values of 1e-6 (f16's subnormals are 6e-8 apart)");
        rows.push(row(case, "largest error over a value's size", error, bound));
    }
    let mut outlier = data(PLAIN, 20);
    for pose in outlier.values.chunks_exact_mut(PLAIN.points) {
        pose[4] *= 1000.0;
    }
    let fitted_outlier = fitted(&outlier, &trained(Family::Linear));
    // Half a step of 254 of the largest number, in each of five columns, of which few add up.
    let bound = 5.0 / 254.0 / 2.0;
    let error = stored_error(&outlier, &fitted_outlier, Precision::I8, 1000.0);
    let case = "i8, a point 1000 times the others";
    rows.push(row(case, "largest error over that point's size", error, bound));
    rows
}

pub(crate) fn orders() -> Vec<Row> {
    let mut rows = Vec::new();
    for (order, coefficients) in [(1, 1), (10, 100)] {
        let parts = data(Sizes { points: 3, coefficients, ..PLAIN }, 21);
        for (name, family) in families() {
            let fitted = fitted(&parts, &trained(family));
            rows.push(row(format!("order {order}, {name}"), F32, own(&parts, &fitted), 2e-5));
        }
    }
    rows.push(turned());
    rows
}

/// A model in the bone frame whose bone has turned: rotation keeps every band's length.
fn turned() -> Row {
    let parts = data(Sizes { points: 3, coefficients: 100, ..PLAIN }, 22);
    let family = Family::Linear;
    let fitted = fitted(&parts, &Settings { frame: Frame::Bone, ..trained(family) });
    let model = model(&parts, &fitted, Frame::Bone);
    let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.7, -1.9, 2.6);
    let (pose, mut before) = (&parts.parameters[..4], vec![0.0; 300]);
    model.evaluate(pose, None, &mut before).expect("evaluates");
    let mut after = before.clone();
    model.to_root_frame(&[turn], None, &mut after).expect("turns");
    let band = |values: &[f32], l: usize| -> f64 {
        values[l * l..(l + 1) * (l + 1)].iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt()
    };
    let mut worst = 0.0_f64;
    for (a, b) in before.chunks_exact(100).zip(after.chunks_exact(100)) {
        for l in 0..10 {
            worst = worst.max((band(a, l) / band(b, l) - 1.0).abs());
        }
    }
    row("order 10, a bone that has turned", "change of a band's length", worst, 1e-5)
}

pub(crate) fn far_poses() -> Vec<Row> {
    let parts = data(PLAIN, 23);
    let mut rows = Vec::new();
    for scale in [10.0_f32, 1e3, 1e6] {
        let far: Vec<f32> = parts.parameters[..40].iter().map(|x| x * scale).collect();
        for (name, family) in families() {
            let fitted = fitted(&parts, &settings(family));
            let model = model(&parts, &fitted, Frame::Root);
            let case = format!("{name}, {scale:e} times the training poses");
            rows.push(row(case.clone(), F32, deviation(&parts, &fitted, &far), 2e-5));
            let mut outside = 0.0_f64;
            let mut near = f64::INFINITY;
            for pose in far.chunks_exact(4) {
                let input = PosedInput {
                    parameters: pose,
                    bone_rotations: &[glam::Quat::IDENTITY],
                    surface: None,
                };
                let mut out = vec![f32::NAN; parts.points];
                model.evaluate_posed(&input, &mut out).expect("evaluates");
                for &y in &out {
                    let beyond = if (0.0..=1.0).contains(&y) { 0.0 } else { 1.0 };
                    outside = outside.max(beyond);
                }
                near = near.min(f64::from(model.distance(pose).expect("a distance").mahalanobis));
            }
            rows.push(row(case.clone(), "values outside [0, 1] (0 is none)", outside, 0.0));
            // Poses of ten times the spread lie some ten deviations away.
            rows.push(row(
                case,
                "the pose's scale over its told distance",
                f64::from(scale) / near,
                20.0,
            ));
        }
    }
    rows
}
