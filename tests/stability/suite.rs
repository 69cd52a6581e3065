//! The cases: data and sizes at their extremes, each with a figure and the bound that it must keep.
//! Every figure that is an error of single precision is against the same numbers in f64.

use super::fixture::{PLAIN, Sizes, changed, data, fitted, model, reference, settings, trained};
use super::occluders;
use super::oracle::left_out_rmse;
use super::proxies;
use super::stored::{far_poses, orders, storage};
use super::values::{outputs, spectra};
use poselight::dataset::{Training, TrainingParts};
use poselight::fit::{
    ClusteredSizes, Family, Fitted, Kept, MultilinearSizes, PointClusters, Ridge, Settings, fit,
};
use poselight::model::{Form, Frame};
use poselight::num::lbfgs;

/// A line of the page.
pub(crate) struct Row {
    pub(crate) case: String,
    /// What the figure is.
    pub(crate) what: &'static str,
    pub(crate) figure: f64,
    /// Above this the case has failed.
    pub(crate) bound: f64,
}

impl Row {
    pub(crate) fn passes(&self) -> bool {
        // A figure that is not a number has failed.
        self.figure <= self.bound
    }
}

/// A heading with its rows.
pub(crate) type Area = (&'static str, Vec<Row>);

pub(crate) fn areas() -> Vec<Area> {
    vec![
        ("Regularisation and degenerate poses", regularisation()),
        ("Few poses", few_poses()),
        ("Units of the parameters", units()),
        ("Numbers of points", points()),
        ("Outputs", outputs()),
        ("Spectra", spectra()),
        ("Clusters and blends", clusters()),
        ("Neurons", neurons()),
        ("Precision of storage", storage()),
        ("Orders of harmonics", orders()),
        ("Poses far outside", far_poses()),
        ("Occluders, evaluated", occluders::evaluated()),
        ("Occluders, fitted", proxies::fitted()),
    ]
}

pub(crate) fn row(case: impl Into<String>, what: &'static str, figure: f64, bound: f64) -> Row {
    Row { case: case.into(), what, figure, bound }
}

pub(crate) const F32: &str = "f32 against f64, of the largest value";
pub(crate) const KEPT: &str = "training error over that of the mean";

pub(crate) fn multilinear(clusters: usize, inputs: usize, points: PointClusters) -> Family {
    let (published, blend_exponent) = (false, 10.0);
    Family::Multilinear(MultilinearSizes { clusters, inputs, points, published, blend_exponent })
}

pub(crate) fn clustered(form: Form, clusters: usize) -> Family {
    let (inputs, outputs) = (Kept::Share(1.0), Kept::Share(1.0));
    let (clusters, neurons) = (Some(clusters), Some(4));
    Family::Clustered(ClusteredSizes { form, clusters, inputs, outputs, neurons })
}

pub(crate) fn families() -> [(&'static str, Family); 6] {
    [
        ("linear", Family::Linear),
        ("pca-linear", Family::PcaLinear { inputs: 1, outputs: 1 }),
        ("multilinear", multilinear(2, 1, PointClusters::None)),
        ("clustered-linear", clustered(Form::Linear, 1)),
        ("clustered-quadratic", clustered(Form::Quadratic, 1)),
        ("clustered-tanh", clustered(Form::Tanh, 1)),
    ]
}

/// Largest difference between the model's f32 evaluation and f64 over some poses, over the largest
/// value that is met.
pub(crate) fn deviation(parts: &TrainingParts, fitted: &Fitted, poses: &[f32]) -> f64 {
    let model = model(parts, fitted, Frame::Root);
    let mut found = vec![f32::NAN; parts.points * parts.coefficients];
    let (mut most, mut worst) = (0.0_f64, 0.0_f64);
    for pose in poses.chunks_exact(parts.parameter_names.len()) {
        model.evaluate(pose, None, &mut found).expect("evaluates");
        for (&y, truth) in found.iter().zip(reference(parts, fitted, pose)) {
            most = most.max(truth.abs());
            let error = (f64::from(y) - truth).abs();
            // A NaN must not be lost in a comparison.
            worst = if error.is_finite() { worst.max(error) } else { f64::INFINITY };
        }
    }
    if worst == 0.0 { 0.0 } else { worst / most }
}

pub(crate) fn own(parts: &TrainingParts, fitted: &Fitted) -> f64 {
    deviation(parts, fitted, &parts.parameters)
}

pub(crate) fn kept(fitted: &Fitted) -> f64 {
    let (error, spread) = (fitted.report.training_rmse, fitted.report.spread_rms);
    if spread == 0.0 { error } else { error / spread }
}

/// Poses in which something is degenerate, and whether leaving one out has a unique answer without
/// regularisation.
fn degenerate() -> Vec<(&'static str, TrainingParts, bool)> {
    let a = PLAIN.parameters;
    let mut twins = data(PLAIN, 2);
    for pose in (1..PLAIN.poses).step_by(2) {
        twins.parameters.copy_within((pose - 1) * a..pose * a, pose * a);
    }
    let mut collinear = data(PLAIN, 3);
    for x in collinear.parameters.chunks_exact_mut(a) {
        (x[1], x[3]) = (x[0], x[0] - 2.0 * x[2]);
    }
    vec![
        ("plain poses", data(PLAIN, 1), true),
        (
            "fewer poses than parameters",
            data(Sizes { poses: 6, parameters: 20, ..PLAIN }, 4),
            false,
        ),
        ("every pose twice", twins, true),
        (
            "a constant parameter",
            changed(data(PLAIN, 5), |j, x| if j == 2 { 3.25 } else { x }),
            false,
        ),
        ("collinear parameters", collinear, false),
    ]
}

fn regularisation() -> Vec<Row> {
    let mut rows = Vec::new();
    for (name, parts, unique) in degenerate() {
        let (mut worst, mut finite) = (0.0_f64, 0.0);
        for alpha in [0.0, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e12] {
            let settings = Settings { ridge: Ridge::Fixed(alpha), ..settings(Family::Linear) };
            let mut own_clips = parts.clone();
            // A fixed α is judged by clips: one for each pose is leave-one-out.
            own_clips.clips = (0..parts.clips.len() as i32).collect();
            let fitted = fitted(&own_clips, &settings);
            for &(alpha, error) in &fitted.report.alphas {
                if !error.is_finite() {
                    finite = f64::INFINITY;
                }
                if alpha > 1e-4 || unique {
                    let expected = left_out_rmse(&parts, alpha);
                    worst = worst.max((error - expected).abs() / expected);
                }
            }
            if !own(&parts, &fitted).is_finite() {
                finite = f64::INFINITY;
            }
        }
        rows.push(row(
            format!("{name}, α 0 to 1e12"),
            "leave-one-out against refits, relative",
            worst + finite,
            1e-6,
        ));
        for (family, kind) in families() {
            let fitted = fitted(&parts, &trained(kind));
            rows.push(row(format!("{name}, {family}, no α"), F32, own(&parts, &fitted), 2e-5));
        }
    }
    rows
}

fn few_poses() -> Vec<Row> {
    let mut rows = Vec::new();
    let one = data(Sizes { poses: 1, ..PLAIN }, 6);
    let two = data(Sizes { poses: 2, ..PLAIN }, 7);
    for (name, parts) in [("p = 1", &one), ("p = 2", &two)] {
        let fitted = fitted(parts, &trained(Family::Linear));
        let truth = |pose: usize| &parts.values[pose * parts.points..(pose + 1) * parts.points];
        let a = parts.parameter_names.len();
        let off = parts.parameters.chunks_exact(a).enumerate().flat_map(|(pose, x)| {
            let found = reference(parts, &fitted, x);
            truth(pose)
                .iter()
                .zip(found)
                .map(|(&t, y)| (f64::from(t) - y).abs())
                .collect::<Vec<_>>()
        });
        rows.push(row(
            format!("{name}, linear"),
            "largest error on its own poses",
            off.fold(0.0, f64::max),
            1e-6,
        ));
    }
    for (name, family) in families().into_iter().skip(1) {
        let refused = fit(&Training::in_memory(one.clone()), &settings(family)).err();
        let hints = refused.is_some_and(|error| error.to_string().contains("pose"));
        let failed = f64::from(u8::from(!hints));
        rows.push(row(format!("p = 1, {name}"), "refused with a hint (0 is yes)", failed, 0.0));
    }
    for (name, family) in families() {
        if name != "multilinear" {
            rows.push(row(
                format!("p = 2, {name}"),
                F32,
                own(&two, &fitted(&two, &trained(family))),
                2e-5,
            ));
        }
    }
    rows
}

fn units() -> Vec<Row> {
    let mut rows = Vec::new();
    for (name, family) in families() {
        let plain = kept(&fitted(&data(PLAIN, 8), &settings(family)));
        for scale in [1e8_f32, 1e-8] {
            let parts = changed(data(PLAIN, 8), |_, x| x * scale);
            let fitted = fitted(&parts, &settings(family));
            let case = format!("{name}, parameters × {scale:e}");
            rows.push(row(case.clone(), F32, own(&parts, &fitted), 2e-5));
            let moved = (kept(&fitted) - plain).abs();
            rows.push(row(case, "change of the share of error that is left", moved, 0.02));
        }
        let parts = changed(data(PLAIN, 8), |_, x| x + 1e6);
        let fitted = fitted(&parts, &settings(family));
        // Its published form has no centre: an intercept that cancels 1e6 times a weight, which f32
        // holds to 0.06 of a weight.
        let (off, more, form) = match name {
            "pca-linear" => (0.1, 0.2, ", the centre in the intercept"),
            _ => (2e-5, 0.05, ""),
        };
        let case = format!("{name}, parameters + 1e6{form}");
        rows.push(row(case.clone(), F32, own(&parts, &fitted), off));
        let what = "share of error that its f32 evaluation leaves";
        rows.push(row(case, what, said(&parts, &fitted), plain + more));
    }
    rows
}

/// Root mean square error of the model's own f32 evaluation on the training poses, over the mean's.
fn said(parts: &TrainingParts, fitted: &Fitted) -> f64 {
    let model = model(parts, fitted, Frame::Root);
    let numbers = parts.points * parts.coefficients;
    let mut found = vec![f32::NAN; numbers];
    let mut sum = 0.0;
    let poses = parts.parameters.chunks_exact(parts.parameter_names.len());
    for (pose, truth) in poses.zip(parts.values.chunks_exact(numbers)) {
        model.evaluate(pose, None, &mut found).expect("evaluates");
        sum += found.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
    }
    (sum / parts.values.len() as f64).sqrt() / fitted.report.spread_rms
}

fn points() -> Vec<Row> {
    let mut rows = Vec::new();
    for count in [1, 200_000] {
        let sizes = Sizes { poses: 4, parameters: 2, points: count, coefficients: 1 };
        let parts = data(sizes, 9);
        for (name, family) in families() {
            // Neurons cost by poses, not by points; pose clusters need more poses than these.
            if count > 1 && !matches!(name, "linear" | "pca-linear" | "clustered-linear") {
                continue;
            }
            let fitted = fitted(&parts, &trained(family));
            let few = &parts.parameters[..2];
            rows.push(row(
                format!("{name}, {count} points"),
                F32,
                deviation(&parts, &fitted, few),
                2e-5,
            ));
        }
    }
    rows
}

fn clusters() -> Vec<Row> {
    let mut rows = Vec::new();
    let parts = data(PLAIN, 15);
    let mut twins = data(PLAIN, 16);
    let a = PLAIN.parameters;
    for pose in 3..PLAIN.poses {
        let from = pose % 3;
        twins.parameters.copy_within(from * a..(from + 1) * a, pose * a);
    }
    for blend_exponent in [0.0, 0.5, 1.0, 10.0, 100.0] {
        for (name, data, count) in
            [("a cluster for each pose", &parts, PLAIN.poses), ("coincident centres", &twins, 5)]
        {
            let family = match multilinear(count, 1, PointClusters::None) {
                Family::Multilinear(sizes) => {
                    Family::Multilinear(MultilinearSizes { blend_exponent, ..sizes })
                }
                other => other,
            };
            let fitted = fitted(data, &trained(family));
            let between: Vec<f32> =
                (0..a).map(|j| 0.5 * (data.parameters[j] + data.parameters[a + j])).collect();
            let poses = [&data.parameters[..], &between, &[1e6; 4]].concat();
            let case = format!("{name}, blend α {blend_exponent}");
            rows.push(row(case, F32, deviation(data, &fitted, &poses), 2e-5));
        }
    }
    let too_many = multilinear(PLAIN.poses + 1, 1, PointClusters::None);
    let refused = fit(&Training::in_memory(parts.clone()), &settings(too_many)).is_err();
    let failed = f64::from(u8::from(!refused));
    rows.push(row("more pose clusters than poses", "refused (0 is yes)", failed, 0.0));
    let each = clustered(Form::Linear, PLAIN.points);
    let fitted = fitted(&parts, &trained(each));
    rows.push(row("a cluster for each point", F32, own(&parts, &fitted), 2e-5));
    rows
}

fn neurons() -> Vec<Row> {
    let mut rows = Vec::new();
    let tanh = clustered(Form::Tanh, 1);
    let saturated = {
        let mut parts = data(PLAIN, 17);
        // A step of the first parameter, whose best neuron is as steep as it may be.
        for (pose, x) in parts.parameters.chunks_exact(PLAIN.parameters).enumerate() {
            let side = if x[0] > 0.0 { 1.0 } else { 0.0 };
            parts.values[pose * PLAIN.points..(pose + 1) * PLAIN.points].fill(side);
        }
        parts
    };
    let steep = fitted(&saturated, &trained(tanh));
    rows.push(row("a step, neurons saturated", F32, own(&saturated, &steep), 2e-5));
    rows.push(row("a step, neurons saturated", KEPT, kept(&steep), 0.05));
    let far = changed(saturated.clone(), |_, x| x * 1e6);
    rows.push(row(
        "the same at poses × 1e6",
        F32,
        deviation(&saturated, &steep, &far.parameters),
        2e-5,
    ));
    let parts = data(PLAIN, 18);
    for steps in [0, 1, 2] {
        let hasty = fitted(&parts, &Settings { steps, ..trained(tanh) });
        let case = format!("a budget of {steps} steps");
        rows.push(row(case.clone(), F32, own(&parts, &hasty), 2e-5));
        rows.push(row(case, KEPT, kept(&hasty), 1.01));
    }
    rows.extend(bad_starts());
    rows
}

/// The optimiser of the neurons by itself, from where nobody would begin.
fn bad_starts() -> Vec<Row> {
    const AWAY: &str = "distance to the minimum";
    let valley = |x: &[f64], gradient: &mut [f64]| {
        let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
        (gradient[0], gradient[1]) = (-2.0 * a - 400.0 * x[0] * b, 200.0 * b);
        a * a + 100.0 * b * b
    };
    let wall = |x: &[f64], gradient: &mut [f64]| {
        gradient[0] = 1.0 - 1.0 / x[0];
        if x[0] > 0.0 { x[0] - x[0].ln() } else { f64::NAN }
    };
    let away = |x: &[f64]| x.iter().map(|x| (x - 1.0).powi(2)).sum::<f64>().sqrt();
    let mut rows = Vec::new();
    for start in [[30.0, -50.0], [1e3, -1e6], [-1e4, 1e-8]] {
        let found = lbfgs::minimise(start.to_vec(), 2000, valley);
        let case = format!("a bent valley from ({:e}, {:e})", start[0], start[1]);
        rows.push(row(case, AWAY, away(&found.x), 1e-6));
    }
    for start in [1e-8, 1e8] {
        let found = lbfgs::minimise(vec![start], 500, wall);
        rows.push(row(format!("NaN behind a wall, from {start:e}"), AWAY, away(&found.x), 1e-6));
    }
    rows
}
