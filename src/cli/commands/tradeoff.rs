//! `poselight tradeoff`: every family and size over one bake, measured.

use serde_json::json;

use crate::cli::Answer;
use crate::cli::args::TradeoffArgs;
use crate::dataset::Dataset;
use crate::pipeline::{self, Checked, Range, Watch, files};

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
    let table = tradeoff.table();
    files::publish(&args.output.join("tradeoff.txt"), table.as_bytes())?;
    for (name, svg) in tradeoff.plots() {
        files::publish(&args.output.join(name), svg.as_bytes())?;
    }
    files::publish(&args.output.join("report.html"), tradeoff.page().as_bytes())?;
    let text = format!("{table}\n{}", args.output.join("report.html").display());
    Ok(Answer::new(text, json!({ "output": args.output, "tradeoff": tradeoff })))
}
