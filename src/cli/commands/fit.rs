//! `poselight fit`: a model from a data set.

use serde_json::json;

use crate::cli::args::FitCommandArgs;
use crate::cli::{Answer, units};
use crate::dataset::Dataset;
use crate::model::Model;
use crate::pipeline::{self, Checked, FittedModel, Watch, files};

pub(in crate::cli) fn fit(args: &FitCommandArgs, _watch: &Watch) -> anyhow::Result<Answer> {
    let dataset = Dataset::open(&args.dataset)?;
    let mut recipe = pipeline::recipe_of(&dataset)?;
    args.edit(&mut recipe);
    let checked = Checked::new(&recipe)?;
    let fitted = pipeline::fit(&dataset, &recipe)?;
    let blob = fitted.model.to_bytes(checked.precision)?;
    files::publish(&args.output, &blob)?;
    let text = format!(
        "{}\n{}",
        args.output.display(),
        describe(&fitted.model, blob.len() as u64, fitted.fit_s)
    );
    let json = json!({ "model": args.output, "fit": figures(&fitted, blob.len() as u64) });
    Ok(Answer::new(text, json))
}

/// A fitted model in a line.
pub(super) fn describe(model: &Model, bytes: u64, fit_s: f64) -> String {
    let header = model.header();
    format!(
        "  {} in the {} frame, {} ({}), fitted in {}",
        header.family,
        header.frame,
        units::bytes(bytes),
        header.precision,
        units::seconds(fit_s)
    )
}

/// A fit, for programs.
pub(super) fn figures(fitted: &FittedModel, bytes: u64) -> serde_json::Value {
    let header = fitted.model.header();
    json!({
        "family": header.family.name(),
        "frame": header.frame.name(),
        "bytes": bytes,
        "parameters": header.parameters(),
        "alpha": fitted.report.alpha,
        "fit_s": fitted.fit_s,
    })
}
