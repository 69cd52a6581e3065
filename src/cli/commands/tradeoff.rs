//! `poselight tradeoff`: every family and size over one bake, measured.

use std::fmt::Write as _;

use serde_json::json;

use crate::choose::Point;
use crate::cli::args::TradeoffArgs;
use crate::cli::{Answer, units};
use crate::dataset::Dataset;
use crate::pipeline::{self, Checked, Range, Tradeoff, Watch, files};

pub(in crate::cli) fn tradeoff(args: &TradeoffArgs, watch: &Watch) -> anyhow::Result<Answer> {
    let dataset = Dataset::open(&args.dataset)?;
    let mut recipe = pipeline::recipe_of(&dataset)?;
    args.measure.edit(&mut recipe);
    let checked = Checked::new(&recipe)?;
    pipeline::bake_reference(&dataset, checked.reference, watch)?;
    let range = if args.full { Range::Full } else { Range::Quick };
    let points = dataset.header().layout.points;
    let mut candidates = pipeline::candidates(&recipe, points, range);
    if !args.only.is_empty() {
        candidates.retain(|c| args.only.iter().any(|part| c.name.contains(part.as_str())));
    }
    let tradeoff = pipeline::tradeoff(&dataset, &candidates, watch)?;
    let json = serde_json::to_vec_pretty(&tradeoff)?;
    files::publish(&args.output.join("tradeoff.json"), &json)?;
    let table = table(&tradeoff);
    files::publish(&args.output.join("tradeoff.txt"), table.as_bytes())?;
    for (name, svg) in tradeoff.plots() {
        files::publish(&args.output.join(name), svg.as_bytes())?;
    }
    files::publish(&args.output.join("report.html"), page(&tradeoff, &table).as_bytes())?;
    let text = format!("{table}\n{}", args.output.join("report.html").display());
    Ok(Answer::new(text, json!({ "output": args.output, "tradeoff": tradeoff })))
}

/// Every point, those of the front marked.
fn table(tradeoff: &Tradeoff) -> String {
    let mut text = format!(
        "{}: {} points; * is on the front of bytes and {} error; reference noise {:.5}\n  {:<44} {:>10} {:>8} {:>9} {:>8}   RMSE of a coefficient (ao error)",
        tradeoff.scene,
        tradeoff.points.len(),
        tradeoff.split,
        tradeoff.reference_noise_rms,
        "model",
        "bytes",
        "% mesh",
        "µs/frame",
        "fit s",
    );
    for split in splits(tradeoff) {
        let _ = write!(text, "  {split:>20}");
    }
    for point in &tradeoff.points {
        let _ = write!(text, "\n{}", row(tradeoff, point));
    }
    for (name, reason) in &tradeoff.skipped {
        let _ = write!(text, "\n  left out: {name}: {reason}");
    }
    text
}

fn splits(tradeoff: &Tradeoff) -> Vec<&String> {
    tradeoff.points.first().map(|point| point.errors.keys().collect()).unwrap_or_default()
}

fn row(tradeoff: &Tradeoff, point: &Point) -> String {
    let mark = if tradeoff.front.contains(&point.name) { '*' } else { ' ' };
    let mut text = format!(
        "{mark} {:<44} {:>10} {:>8.1} {:>9.0} {:>8.2}",
        point.name,
        units::bytes(point.bytes),
        point.mesh_percent,
        point.evaluate_us,
        point.fit_s,
    );
    for split in splits(tradeoff) {
        let error = point.errors.get(split).copied().unwrap_or_default();
        let _ = write!(text, "  {:>11.5} ({:.4})", error.rms, error.ao_mae);
    }
    text
}

/// One file with the pictures and the table.
fn page(tradeoff: &Tradeoff, table: &str) -> String {
    let escape = |text: &str| text.replace('&', "&amp;").replace('<', "&lt;");
    let plots: String = tradeoff.plots().into_iter().map(|(_, svg)| svg).collect();
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Trade-off of {0}</title>\
         <style>:root{{color-scheme:light dark}}body{{font-family:sans-serif;max-width:1100px;\
         margin:2em auto;padding:0 1em}}pre{{overflow-x:auto}}svg{{width:100%}}</style>\
         <h1>Trade-off of {0}</h1>{plots}<pre>{1}</pre></html>",
        escape(&tradeoff.scene),
        escape(table),
    )
}
