//! The papers' tables for our own characters, each after what its paper says must hold.

use poselight::choose::Point;
use poselight::dataset::Dataset;
use poselight::pipeline::recipe::{FamilyName, OnName, ParametrisationName};
use poselight::pipeline::{CandidateRecipe, Tradeoff};

use crate::settings::{Bakes, Page, Result, ao, candidate, measured, point, rms, unseen};

/// Sizes of AO07's table 1, both of the numbers of clusters and of dimensions.
pub(crate) const SIZES: [u32; 3] = [5, 10, 15];
/// AO07's clusters of vertices, in per mille of them: all, and its 10,000, 5,000 and 1,000.
pub(crate) const SHARES: [Option<u32>; 4] = [None, Some(266), Some(133), Some(27)];

pub(crate) fn all(bakes: &Bakes, page: &mut Page) -> Result<()> {
    prt07(bakes, page)?;
    ao07(bakes, page)?;
    rpo09(bakes, page)
}

fn holds(page: &mut Page, what: &str, holds: bool) {
    page.line(&format!("- {what}: {}", if holds { "holds" } else { "**does not hold**" }));
}

/// PRT07's three models: P(8,22), P(15,500), L, on the training poses as published.
pub(crate) fn prt07_models(dataset: &Dataset) -> Result<Vec<CandidateRecipe>> {
    let training = dataset.splits().iter().filter(|split| **split == 0).count();
    let most = (training * dataset.header().layout.row()).min(dataset.header().layout.points);
    let mut models = Vec::new();
    for (inputs, outputs) in [(8, 22), (15, 500)] {
        let outputs = outputs.min(most as u32);
        models.push(candidate(dataset, format!("P({inputs},{outputs})"), OnName::Novel, |fit| {
            (fit.inputs, fit.outputs) = (Some(inputs), Some(outputs));
        })?);
    }
    models.push(candidate(dataset, "L", OnName::Novel, |fit| fit.family = FamilyName::Linear)?);
    Ok(models)
}

fn prt07(bakes: &Bakes, page: &mut Page) -> Result<()> {
    let dataset = &bakes.transfer;
    let models = prt07_models(dataset)?;
    let found = measured(dataset, &models)?;
    page.head(
        "PRT07, tables 1 and 2",
        "Transfer. Operations count an addition as 1 and a multiplication as 2, for one coefficient \
         as the paper does; percentages are of one mesh's coefficients. The paper: 105, 34 and 65 Hz; \
         0.76, 17.3 and 1.88 million operations; 62.9, 1457 and 5400 %.",
    );
    page.header(&[
        "model",
        "fit s",
        "Hz, all coefficients",
        "Mops a coefficient",
        "MB (f32)",
        "% of a mesh",
        "RMSE training",
        "interpolated",
        "unseen",
    ]);
    let layout = dataset.header().layout;
    for model in &models {
        let Some(p) = point(&found, &model.name, "f32") else { continue };
        page.row(&[
            model.name.clone(),
            format!("{:.2}", p.fit_s),
            format!("{:.0}", 1e6 / p.evaluate_us),
            format!("{:.2}", 3.0 * p.multiply_adds as f64 / layout.row() as f64 / 1e6),
            format!("{:.2}", p.tensor_bytes as f64 / 1e6),
            format!("{:.1}", p.mesh_percent),
            format!("{:.5}", rms(p, "training")),
            format!("{:.5}", rms(p, "interpolated")),
            format!("{:.5}", rms(p, unseen(&found))),
        ]);
    }
    page.line("");
    let of = |i: usize| models.get(i).and_then(|model| point(&found, &model.name, "f32"));
    if let (Some(small), Some(large), Some(linear)) = (of(0), of(1), of(2)) {
        let training = |p: &Point| rms(p, "training");
        holds(page, "error falls with dimensions", training(large) < training(small));
        holds(page, "P(8,22) is the smallest, L the largest", {
            small.bytes < large.bytes && large.bytes < linear.bytes
        });
        let numbers = layout.points * 22 + layout.row() * 9 * 22 + layout.parameters * 8;
        let percent = 100.0 * numbers as f64 / (layout.points * layout.row()) as f64;
        holds(page, "the size is the paper's formula", (percent - small.mesh_percent).abs() < 1e-6);
    }
    Ok(())
}

/// AO07's rows by clusters of vertices, and Kontkanen and Aila's model, unregularised.
pub(crate) fn ao07_models(dataset: &Dataset) -> Result<Vec<CandidateRecipe>> {
    let points = dataset.header().layout.points as u64;
    let mut models = Vec::new();
    for share in SHARES {
        for (clusters, inputs) in SIZES.into_iter().flat_map(|c| SIZES.map(|d| (c, d))) {
            let name = ao07_name(clusters, inputs, share);
            models.push(candidate(dataset, name, OnName::Trained, |fit| {
                fit.family = FamilyName::Multilinear;
                fit.parametrisation = Some(ParametrisationName::Handles);
                (fit.clusters, fit.inputs) = (Some(clusters), Some(inputs));
                fit.point_clusters =
                    share.map(|share| (points * u64::from(share) / 1000).max(1) as u32);
            })?);
        }
    }
    models.push(candidate(dataset, "Kontkanen & Aila", OnName::Trained, |fit| {
        fit.family = FamilyName::Linear;
    })?);
    Ok(models)
}

fn ao07_name(clusters: u32, inputs: u32, share: Option<u32>) -> String {
    let vertices =
        share.map_or("all".to_owned(), |share| format!("{:.1} %", f64::from(share) / 10.0));
    format!("{clusters} clusters, {inputs} dims, {vertices}")
}

fn ao07(bakes: &Bakes, page: &mut Page) -> Result<()> {
    let dataset = &bakes.ao;
    let found = measured(dataset, &ao07_models(dataset)?)?;
    page.head(
        "AO07, table 1",
        "Ambient occlusion; clusters of poses × dimensions down, clusters of vertices (of their number) \
         across: kB in f32, then mean absolute error on training, interpolated and unseen poses. The \
         paper: 1.0 to 34.7 MB, 0.011 to 0.005 on its training poses; Kontkanen & Aila 10.4 MB, 0.006.",
    );
    page.header(&["clusters × dims", "all vertices", "27 %", "13 %", "2.7 %"]);
    let cell = |name: &str| {
        point(&found, name, "f32").map_or("more clusters than poses".to_owned(), |p| {
            let kb = p.bytes as f64 / 1e3;
            let [a, b, c] = ["training", "interpolated", unseen(&found)].map(|split| ao(p, split));
            format!("{kb:.0} kB: {a:.4}, {b:.4}, {c:.4}")
        })
    };
    for (clusters, inputs) in SIZES.into_iter().flat_map(|c| SIZES.map(|d| (c, d))) {
        let mut cells = vec![format!("{clusters} × {inputs}")];
        cells.extend(SHARES.map(|share| cell(&ao07_name(clusters, inputs, share))));
        page.row(&cells);
    }
    page.row(&["Kontkanen & Aila".to_owned(), cell("Kontkanen & Aila")]);
    page.line(&format!("\nReference noise {:.5} (RMS).", found.reference_noise_rms));
    ao07_trends(&found, page);
    Ok(())
}

fn ao07_trends(found: &Tradeoff, page: &mut Page) {
    let error = |clusters, inputs, share| {
        let name = ao07_name(clusters, inputs, share);
        point(found, &name, "f32").map_or(f64::NAN, |p| rms(p, "training"))
    };
    let by_clusters = SIZES.map(|d| falls(&SIZES.map(|c| error(c, d, None))));
    trend(page, "error falls with clusters of poses", &by_clusters);
    let by_inputs = SIZES.map(|c| falls(&SIZES.map(|d| error(c, d, None))));
    trend(page, "error falls with dimensions", &by_inputs);
    let rows = [Some(27), Some(133), Some(266)];
    let sizes = SIZES.into_iter().flat_map(|c| SIZES.map(|d| (c, d)));
    let by_rows: Vec<_> = sizes.map(|(c, d)| falls(&rows.map(|s| error(c, d, s)))).collect();
    trend(page, "error falls with clusters of vertices", &by_rows);
}

/// Whether no error is above the one before by more than round-off; `None` where fewer than two are known.
fn falls(errors: &[f64]) -> Option<bool> {
    let known: Vec<f64> = errors.iter().copied().filter(|error| error.is_finite()).collect();
    (known.len() > 1).then(|| known.windows(2).all(|w| w[1] <= w[0] * (1.0 + 1e-6)))
}

/// In how many of the rows or columns that could be told a trend is seen.
fn trend(page: &mut Page, what: &str, found: &[Option<bool>]) {
    let told = found.iter().flatten().count();
    let seen = found.iter().flatten().filter(|&&holds| holds).count();
    let mark = if told > 0 && seen == told { "" } else { "**" };
    page.line(&format!("- {what}: {mark}holds in {seen} of {told}{mark}"));
}

/// RPO09's three features: least squares for linear and quadratic ones; the network as eq. 13 penalises it,
/// its neurons and its α by four-fold cross-validation in each cluster.
pub(crate) fn rpo09_models(dataset: &Dataset) -> Result<Vec<CandidateRecipe>> {
    [
        ("linear", FamilyName::ClusteredLinear),
        ("quadratic", FamilyName::ClusteredQuadratic),
        ("network", FamilyName::ClusteredTanh),
    ]
    .into_iter()
    .map(|(name, family)| {
        let is_network = family == FamilyName::ClusteredTanh;
        let on = if is_network { OnName::Novel } else { OnName::Trained };
        candidate(dataset, name, on, |fit| fit.family = family)
    })
    .collect()
}

fn rpo09(bakes: &Bakes, page: &mut Page) -> Result<()> {
    let dataset = &bakes.visibility;
    let models = rpo09_models(dataset)?;
    let found = measured(dataset, &models)?;
    page.head(
        "RPO09, table 1",
        "Visibility, clusters by mean shift on skin weights, 90 and 95 % of variance; the \
         network's neurons (3, 6 or 12) and penalty by four-fold cross-validation in each cluster. The paper: 1.4 to 17.9 MB; linear 8 to 62 minutes, quadratic 11 to 98, network 5 to 32 hours; \
         98 to 348 Hz on its graphics processor.",
    );
    page.header(&["model", "MB (f32)", "fit s", "Hz", "RMSE training", "interpolated", "unseen"]);
    for model in &models {
        let Some(p) = point(&found, &model.name, "f32") else { continue };
        page.row(&[
            model.name.clone(),
            format!("{:.2}", p.bytes as f64 / 1e6),
            format!("{:.2}", p.fit_s),
            format!("{:.0}", 1e6 / p.evaluate_us),
            format!("{:.5}", rms(p, "training")),
            format!("{:.5}", rms(p, "interpolated")),
            format!("{:.5}", rms(p, unseen(&found))),
        ]);
    }
    page.line("");
    let of = |name: &str| point(&found, name, "f32").map_or(f64::NAN, |p| rms(p, "training"));
    holds(page, "quadratic features say more than linear ones", of("quadratic") <= of("linear"));
    holds(page, "the network says more than linear features", of("network") <= of("linear"));
    Ok(())
}
