//! The automatic choice beside the best published method of no more bytes.

use std::sync::atomic::AtomicBool;

use poselight::choose::{Point, Target};
use poselight::dataset::Dataset;
use poselight::pipeline::recipe::OnName;
use poselight::pipeline::{self, CandidateRecipe, Range};

use crate::settings::{Bakes, Page, Result, measured, rms, unseen, watch};
use crate::tables::{ao07_models, prt07_models, rpo09_models};

/// Bytes that are allowed.
const BUDGETS: [u64; 3] = [100_000, 300_000, 1_000_000];

pub(crate) fn table(bakes: &Bakes, page: &mut Page) -> Result<()> {
    page.head(
        "The automatic choice at equal bytes",
        "The published method of least error among those of no more bytes in any precision (ambient \
         occlusion: all of AO07's rows, Kontkanen & Aila, PRT07's and RPO09's; transfer: PRT07's and \
         RPO09's), known from the measurement itself, beside what the choice by bytes takes from \
         validation on training poses alone: for interpolated poses with single poses left out \
         (`--on trained`), for unseen ones with clips left out.",
    );
    page.header(&[
        "signal",
        "poses",
        "kB",
        "best published",
        "RMSE",
        "automatic",
        "RMSE",
        "of it",
        "reference noise",
    ]);
    signal("ao", &bakes.ao, page)?;
    signal("transfer", &bakes.transfer, page)
}

fn signal(word: &str, dataset: &Dataset, page: &mut Page) -> Result<()> {
    let mut published = prt07_models(dataset)?;
    published.extend(rpo09_models(dataset)?);
    if word == "ao" {
        published.extend(ao07_models(dataset)?);
    }
    let best = measured(dataset, &published)?;
    for (split, on) in [("interpolated", OnName::Trained), (unseen(&best), OnName::Novel)] {
        for budget in BUDGETS {
            let error = |point: &&Point| rms(point, split);
            let within = best.points.iter().filter(|point| point.bytes <= budget);
            let Some(rival) = within.min_by(|a, b| error(a).total_cmp(&error(b))) else { continue };
            let (name, own) = chosen(dataset, on, budget, split)?;
            page.row(&[
                word.to_owned(),
                split.to_owned(),
                format!("{}", budget / 1000),
                rival.name.clone(),
                format!("{:.5}", rms(rival, split)),
                name,
                format!("{own:.5}"),
                format!("{:.2}", own / rms(rival, split)),
                format!("{:.5}", best.reference_noise_rms),
            ]);
        }
    }
    Ok(())
}

/// What the choice by bytes takes, and its measured error.
fn chosen(dataset: &Dataset, on: OnName, bytes: u64, split: &str) -> Result<(String, f64)> {
    let mut base = pipeline::recipe_of(dataset)?;
    base.target.on = on;
    let candidates = pipeline::candidates(&base, dataset.header().layout.points, Range::Quick);
    let cancelled = AtomicBool::new(false);
    let target = Target { max_bytes: Some(bytes), ..Target::default() };
    let found = pipeline::search(dataset, &candidates, &target, &watch(&cancelled))?;
    let name = found.points[found.chosen].name.clone();
    let candidate =
        CandidateRecipe { name: "chosen".to_owned(), recipe: found.recipe, poses: None };
    let measured = measured(dataset, &[candidate])?;
    let precision = found.precision.name();
    let point = measured.points.iter().find(|point| point.precision == precision);
    Ok((name, point.map_or(f64::NAN, |point| rms(point, split))))
}
