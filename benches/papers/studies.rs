//! The papers' studies as plots.

use poselight::dataset::Dataset;
use poselight::measure::report::{Lines, Series};
use poselight::pipeline::CandidateRecipe;
use poselight::pipeline::recipe::{FamilyName, FitRecipe, FrameName, OnName, ParametrisationName};

use crate::settings::{Bakes, Page, Result, ao, candidate, measured, point, rms, series, unseen};

pub(crate) fn all(bakes: &Bakes, page: &mut Page) -> Result<()> {
    page.head("Studies", "Every dot is a model in f32.");
    ridge(bakes, page)?;
    frame(bakes, page)?;
    clusters(bakes, page)?;
    variance(bakes, page)?;
    cosine(bakes, page)?;
    third(bakes, page)
}

fn list(
    dataset: &Dataset,
    sizes: &[u32],
    name: &str,
    on: OnName,
    edit: impl Fn(&mut FitRecipe, u32),
) -> Result<Vec<CandidateRecipe>> {
    sizes.iter().map(|&n| candidate(dataset, format!("{name} {n}"), on, |f| edit(f, n))).collect()
}

fn picture(page: &mut Page, (bakes, file): (&Bakes, &str), title: &str, x: &str, all: &[Series]) {
    let title = format!("{}: {title}", bakes.name);
    let file = format!("{}-{file}", bakes.name);
    let (y_name, log_x) = ("RMSE of a coefficient", true);
    page.plot(&file, &Lines { title: &title, x_name: x, y_name, log_x, series: all });
}

/// PRT07 figure 3.
fn ridge(bakes: &Bakes, page: &mut Page) -> Result<()> {
    const INPUTS: [u32; 5] = [2, 4, 8, 15, 30];
    let dataset = &bakes.transfer;
    let edit = |fit: &mut FitRecipe, n| (fit.inputs, fit.outputs) = (Some(n), Some(50));
    let mut all = list(dataset, &INPUTS, "ridge", OnName::Novel, edit)?;
    all.extend(list(dataset, &INPUTS, "none", OnName::Trained, edit)?);
    let found = measured(dataset, &all)?;
    let mut lines = Vec::new();
    for (kind, words) in [("ridge", "with ridge"), ("none", "without")] {
        for split in ["training", unseen(&found)] {
            let points =
                INPUTS.map(|n| (f64::from(n), point(&found, &format!("{kind} {n}"), "f32")));
            lines.push(series(format!("{words}, {split}"), points, |p| rms(p, split)));
        }
    }
    let title = "P(d, 50) with and without regularisation (PRT07 figure 3)";
    picture(page, (bakes, "ridge"), title, "pose dimensions d", &lines);
    Ok(())
}

/// RPO09 figures 8 and 9: local or root frame.
fn frame(bakes: &Bakes, page: &mut Page) -> Result<()> {
    const OUTPUTS: [u32; 5] = [4, 8, 22, 50, 100];
    let dataset = &bakes.transfer;
    let mut all = Vec::new();
    for (name, frame) in [("bone", FrameName::Bone), ("root", FrameName::Root)] {
        all.extend(list(dataset, &OUTPUTS, name, OnName::Novel, |fit, n| {
            (fit.inputs, fit.outputs, fit.frame) = (Some(8), Some(n), frame);
        })?);
    }
    let found = measured(dataset, &all)?;
    let mut lines = Vec::new();
    for kind in ["bone", "root"] {
        for split in ["interpolated", unseen(&found)] {
            let points =
                OUTPUTS.map(|n| (f64::from(n), point(&found, &format!("{kind} {n}"), "f32")));
            lines.push(series(format!("{kind} frame, {split}"), points, |p| rms(p, split)));
        }
    }
    let title = "P(8, d) in each point's bone frame and in the root frame (RPO09 figure 9)";
    picture(page, (bakes, "frame"), title, "output dimensions d", &lines);
    Ok(())
}

/// RPO09 figure 4.
fn clusters(bakes: &Bakes, page: &mut Page) -> Result<()> {
    const CLUSTERS: [u32; 6] = [1, 2, 4, 8, 16, 32];
    let dataset = &bakes.visibility;
    let mut all = Vec::new();
    for (name, family) in
        [("linear", FamilyName::ClusteredLinear), ("quadratic", FamilyName::ClusteredQuadratic)]
    {
        all.extend(list(dataset, &CLUSTERS, name, OnName::Novel, |fit, n| {
            (fit.family, fit.clusters, fit.outputs) = (family, Some(n), Some(8));
        })?);
    }
    let found = measured(dataset, &all)?;
    let mut lines = Vec::new();
    for kind in ["linear", "quadratic"] {
        for split in ["training", unseen(&found)] {
            let points =
                CLUSTERS.map(|n| (f64::from(n), point(&found, &format!("{kind} {n}"), "f32")));
            lines.push(series(format!("{kind}, {split}"), points, |p| rms(p, split)));
        }
    }
    let title = "clusters of vertices with eight outputs each (RPO09 figure 4)";
    picture(page, (bakes, "clusters"), title, "clusters", &lines);
    Ok(())
}

/// RPO09 figure 5.
fn variance(bakes: &Bakes, page: &mut Page) -> Result<()> {
    const PERCENT: [u32; 6] = [50, 70, 80, 90, 95, 99];
    let dataset = &bakes.visibility;
    let edit = |fit: &mut FitRecipe, n| {
        fit.family = FamilyName::ClusteredLinear;
        fit.retain_outputs = Some(f64::from(n) / 100.0);
    };
    let found = measured(dataset, &list(dataset, &PERCENT, "share", OnName::Novel, edit)?)?;
    let mut lines = Vec::new();
    for split in ["training", "interpolated", unseen(&found)] {
        let of = |n| point(&found, &format!("share {n}"), "f32");
        let points = PERCENT.map(|n| (of(n).map_or(0.0, |p| p.bytes as f64 / 1e3), of(n)));
        lines.push(series(split, points, |p| rms(p, split)));
    }
    let title = "output variance kept, 50 to 99 % (RPO09 figure 5)";
    picture(page, (bakes, "variance"), title, "kB", &lines);
    Ok(())
}

/// RPO09 figure 8: the cosine learned with the signal (transfer), or multiplied afterwards
/// (visibility); both judged by ambient occlusion.
fn cosine(bakes: &Bakes, page: &mut Page) -> Result<()> {
    const PERCENT: [u32; 4] = [50, 70, 90, 97];
    let mut lines = Vec::new();
    for (words, dataset) in
        [("inside (transfer)", &bakes.transfer), ("outside (visibility)", &bakes.visibility)]
    {
        let edit = |fit: &mut FitRecipe, n| {
            fit.family = FamilyName::ClusteredLinear;
            fit.retain_outputs = Some(f64::from(n) / 100.0);
        };
        let found = measured(dataset, &list(dataset, &PERCENT, "share", OnName::Novel, edit)?)?;
        for split in ["interpolated", unseen(&found)] {
            let of = |n| point(&found, &format!("share {n}"), "f32");
            let points = PERCENT.map(|n| (of(n).map_or(0.0, |p| p.bytes as f64 / 1e3), of(n)));
            lines.push(series(format!("{words}, {split}"), points, |p| ao(p, split)));
        }
    }
    let title =
        format!("{}: the cosine inside or outside of what is learned (RPO09 figure 8)", bakes.name);
    page.plot(
        &format!("{}-cosine", bakes.name),
        &Lines {
            title: &title,
            x_name: "kB",
            y_name: "mean absolute error of ambient occlusion",
            log_x: true,
            series: &lines,
        },
    );
    Ok(())
}

/// AO07 §5: training on a random third.
fn third(bakes: &Bakes, page: &mut Page) -> Result<()> {
    const CLUSTERS: [u32; 4] = [2, 5, 10, 15];
    let dataset = &bakes.ao;
    let training = dataset.splits().iter().filter(|split| **split == 0).count();
    // A hash of the index: as good as drawn, and the same every time.
    let mut order: Vec<usize> = (0..training).collect();
    order.sort_by_key(|&i| (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    order.truncate((training / 3).max(1));
    order.sort_unstable();
    let edit = |fit: &mut FitRecipe, n| {
        fit.family = FamilyName::Multilinear;
        fit.parametrisation = Some(ParametrisationName::Handles);
        (fit.clusters, fit.inputs) = (Some(n), Some(5));
    };
    let mut all = list(dataset, &CLUSTERS, "all", OnName::Novel, edit)?;
    let mut some = list(dataset, &CLUSTERS, "third", OnName::Novel, edit)?;
    some.iter_mut().for_each(|candidate| candidate.poses = Some(order.clone()));
    all.extend(some);
    let found = measured(dataset, &all)?;
    let mut lines = Vec::new();
    for (kind, words) in [("all", "all poses"), ("third", "a random third")] {
        for split in ["interpolated", unseen(&found)] {
            let points =
                CLUSTERS.map(|n| (f64::from(n), point(&found, &format!("{kind} {n}"), "f32")));
            lines.push(series(format!("{words}, {split}"), points, |p| rms(p, split)));
        }
    }
    let title = "multilinear models of all training poses and of a random third (AO07 §5)";
    picture(page, (bakes, "third"), title, "clusters of poses", &lines);
    Ok(())
}
