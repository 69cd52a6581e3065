//! `poselight tradeoff`: every family and size over one bake, measured.

use serde_json::json;

use crate::cli::Answer;
use crate::cli::args::TradeoffArgs;
use crate::dataset::Dataset;
use crate::pipeline::recipe::Recipe;
use crate::pipeline::{self, Checked, Effort, Range, Watch, files};

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
    let effort = effort(args, &dataset, recipe, watch)?;
    let page = tradeoff.page(effort.as_ref());
    files::publish(&args.output.join("report.html"), page.as_bytes())?;
    let efforts = effort.as_ref().map_or(String::new(), |effort| format!("\n{}", effort.table()));
    let text = format!("{table}{efforts}\n{}", args.output.join("report.html").display());
    let json = json!({ "output": args.output, "tradeoff": tradeoff, "effort": effort });
    Ok(Answer::new(text, json))
}

/// What less than the data set has would do, where that is asked for.
fn effort(
    args: &TradeoffArgs,
    dataset: &Dataset,
    mut recipe: Recipe,
    watch: &Watch,
) -> anyhow::Result<Option<Effort>> {
    let efforts = args.effort.edit(&mut recipe);
    if !efforts.is_any() {
        return Ok(None);
    }
    let effort = pipeline::effort(dataset, &recipe, &efforts, &args.output, watch)?;
    files::publish(&args.output.join("effort.json"), &serde_json::to_vec_pretty(&effort)?)?;
    files::publish(&args.output.join("effort.txt"), effort.table().as_bytes())?;
    files::publish(&args.output.join("effort.svg"), effort.plot().as_bytes())?;
    Ok(Some(effort))
}
