//! Every frame that coefficients can be modelled in, with and without the unshadowed part.

use poselight::choose::Point;
use poselight::dataset::Dataset;
use poselight::pipeline::recipe::{FamilyName, FitRecipe, FrameName, OnName};
use poselight::pipeline::{CandidateRecipe, Tradeoff};

use crate::settings::{Bakes, Page, Result, candidate, measured, point, rms, unseen};

const FRAMES: [(&str, FrameName); 3] =
    [("root", FrameName::Root), ("bone", FrameName::Bone), ("tangent", FrameName::Tangent)];

/// Families without point features, at sizes of a few hundred kilobytes to megabytes.
const FAMILIES: [(&str, FamilyName, Sizes); 6] = [
    ("mean", FamilyName::Mean, |_| ()),
    ("linear", FamilyName::Linear, |_| ()),
    ("P(8,22)", FamilyName::PcaLinear, |fit| (fit.inputs, fit.outputs) = (Some(8), Some(22))),
    ("multilinear 5, 5", FamilyName::Multilinear, |fit| {
        (fit.clusters, fit.inputs) = (Some(5), Some(5));
    }),
    ("clustered-linear 0.8", FamilyName::ClusteredLinear, |fit| fit.retain_outputs = Some(0.8)),
    ("occluder 100", FamilyName::Occluder, |fit| fit.directions = Some(256)),
];

const HEADER: [&str; 9] = [
    "signal",
    "family",
    "kB",
    "root",
    "bone",
    "tangent",
    "root, without",
    "bone, without",
    "tangent, without",
];

type Sizes = fn(&mut FitRecipe);

pub(crate) fn table(bakes: &Bakes, page: &mut Page) -> Result<()> {
    page.head(
        "Frames, with and without the unshadowed part",
        "RMSE on interpolated and on unseen poses, f32, regularised by clips left out. *Without*: the \
         unshadowed signal of the posed normal is left to the evaluation and the model learns what \
         occlusion takes away; such models, those of the tangent frame and `occluder` look at the \
         posed mesh.",
    );
    page.header(&HEADER);
    rows("transfer", &bakes.transfer, page)?;
    page.line("");
    page.line(
        "Unshadowed visibility is the same constant everywhere, so that its two halves agree:\n",
    );
    page.header(&HEADER);
    rows("visibility", &bakes.visibility, page)
}

fn rows(signal: &str, dataset: &Dataset, page: &mut Page) -> Result<()> {
    let found = measured(dataset, &models(dataset)?)?;
    for (family, ..) in FAMILIES {
        let at = |frame: &str, without| point(&found, &name(family, frame, without), "f32");
        let kb = at("bone", true).map_or(f64::NAN, |p| p.bytes as f64 / 1e3);
        let mut cells = vec![signal.to_owned(), family.to_owned(), format!("{kb:.0}")];
        for without in [false, true] {
            cells.extend(FRAMES.map(|(frame, _)| errors(at(frame, without), &found)));
        }
        page.row(&cells);
    }
    Ok(())
}

fn errors(point: Option<&Point>, found: &Tradeoff) -> String {
    point.map_or("none".to_owned(), |p| {
        format!("{:.4}, {:.4}", rms(p, "interpolated"), rms(p, unseen(found)))
    })
}

fn name(family: &str, frame: &str, without: bool) -> String {
    format!("{family}, {frame}{}", if without { ", without" } else { "" })
}

fn models(dataset: &Dataset) -> Result<Vec<CandidateRecipe>> {
    let mut all = Vec::new();
    for (family, of, sizes) in FAMILIES {
        // Occluders stand beside the points' bones.
        let is_free = of != FamilyName::Occluder;
        let frames = FRAMES.into_iter().filter(|(_, frame)| is_free || *frame == FrameName::Bone);
        for ((word, frame), without) in frames.flat_map(|f| [(f, false), (f, true)]) {
            all.push(candidate(dataset, name(family, word, without), OnName::Novel, |fit| {
                (fit.family, fit.frame, fit.unshadowed) = (of, frame, Some(without));
                sizes(fit);
            })?);
        }
    }
    Ok(all)
}
