//! The cases of the data themselves: constant, broken, of many magnitudes.

use super::fixture::{PLAIN, Sizes, changed, data, fitted, reference, settings, trained};
use super::suite::{F32, KEPT, Row, families, kept, own, row};
use poselight::dataset::Training;
use poselight::fit::{Family, fit};
use poselight::num::random::Stream;

pub(crate) fn outputs() -> Vec<Row> {
    let mut rows = Vec::new();
    for value in [0.0_f32, 1.0] {
        let mut parts = data(PLAIN, 10);
        parts.values.fill(value);
        for (name, family) in families() {
            if value == 0.0 && name == "pca-linear" {
                let refused = fit(&Training::in_memory(parts.clone()), &settings(family)).is_err();
                let failed = f64::from(u8::from(!refused));
                let what = "refused: no direction (0 is yes)";
                rows.push(row(format!("{name}, all {value}"), what, failed, 0.0));
                continue;
            }
            let fitted = fitted(&parts, &settings(family));
            let found = reference(&parts, &fitted, &parts.parameters[..4]);
            let off = found.iter().map(|y| (y - f64::from(value)).abs()).fold(0.0, f64::max);
            rows.push(row(format!("{name}, all {value}"), "largest error", off, 1e-6));
        }
    }
    let mut broken = data(PLAIN, 11);
    broken.values[PLAIN.points + 3] = f32::NAN;
    for (name, family) in families() {
        let error = fit(&Training::in_memory(broken.clone()), &settings(family));
        let named =
            error.is_err_and(|e| e.to_string().contains("point 3 is NaN at training pose 1"));
        let failed = f64::from(u8::from(!named));
        rows.push(row(
            format!("{name}, one NaN"),
            "refused with its place (0 is yes)",
            failed,
            0.0,
        ));
    }
    rows
}

/// Σ_i 10^−i u_i v_iᵀ of random directions.
fn decades(poses: usize, points: usize, count: i32) -> Vec<f32> {
    let mut stream = Stream::new(12);
    let mut values = vec![0.0_f64; poses * points];
    for i in 0..count {
        let u: Vec<f64> = (0..poses).map(|_| stream.normal()).collect();
        let v: Vec<f64> = (0..points).map(|_| stream.normal()).collect();
        for (row, u) in values.chunks_exact_mut(points).zip(&u) {
            row.iter_mut().zip(&v).for_each(|(y, v)| *y += 10_f64.powi(-i) * u * v);
        }
    }
    values.into_iter().map(|y| y as f32).collect()
}

pub(crate) fn spectra() -> Vec<Row> {
    let mut rows = Vec::new();
    let sizes = Sizes { poses: 40, parameters: 17, points: 60, coefficients: 1 };
    let mut parts = data(sizes, 13);
    parts.noise_variance = 0.0;
    parts.values = decades(sizes.poses, sizes.points, 17);
    for outputs in [2, 4, 6] {
        let fitted = fitted(&parts, &trained(Family::PcaLinear { inputs: 1, outputs }));
        let spectrum = &fitted.report.output_spectrum;
        let beyond: f64 = spectrum[outputs..].iter().sum();
        // Each direction's energy falls by 1e-2, to what f32 data and products resolve.
        let expected = spectrum[0] * 10_f64.powi(-2 * outputs as i32);
        let floor = 1e-12 * spectrum[0];
        let off = (beyond.log10() - expected.log10()).abs();
        let near = if beyond <= floor { 0.0 } else { off };
        let case = format!("outputs over 16 decades, rank {outputs}");
        rows.push(row(case.clone(), "decades off in the energy beyond it", near, 1.0));
        rows.push(row(case, F32, own(&parts, &fitted), 2e-5));
    }
    let steep = changed(data(sizes, 14), |j, x| x * 10_f32.powi(-(j as i32)));
    for (name, family) in families() {
        let fitted = fitted(&steep, &trained(family));
        rows.push(row(
            format!("parameters over 16 decades, {name}"),
            F32,
            own(&steep, &fitted),
            2e-5,
        ));
        // One vector of outputs cannot even hold the mean of all points.
        if name != "pca-linear" {
            let case = format!("parameters over 16 decades, {name}");
            rows.push(row(case, KEPT, kept(&fitted), 1.0001));
        }
    }
    rows
}
