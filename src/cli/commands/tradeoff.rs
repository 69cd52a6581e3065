//! `poselight tradeoff`: every family and size over one bake, measured.

use serde_json::json;

use super::Usage;
use crate::cli::Answer;
use crate::cli::args::TradeoffArgs;
use crate::dataset::Dataset;
use crate::pipeline::recipe::{ChooseName, Recipe};
use crate::pipeline::{
    self, CandidateRecipe, Checked, Effort, Efforts, Range, Tradeoff, Watch, files,
};

pub(in crate::cli) fn tradeoff(args: &TradeoffArgs, watch: &Watch) -> anyhow::Result<Answer> {
    let dataset = Dataset::open(&args.dataset)?;
    let mut recipe = pipeline::recipe_of(&dataset)?;
    args.measure.edit(&mut recipe);
    // Here nothing is chosen, whatever the run that baked the data set left to its target.
    recipe.target.choose = ChooseName::Nothing;
    let checked = Checked::new(&recipe)?;
    // All that can be refused is refused before the work, which takes minutes.
    let candidates = candidates(args, &dataset, &recipe)?;
    let less = less(args, &dataset, recipe, watch)?;
    files::prepare_folder(&args.output)?;
    pipeline::bake_reference(&dataset, checked.reference, watch)?;
    let tradeoff = pipeline::tradeoff(&dataset, &candidates, watch)?;
    publish(args, &tradeoff)?;
    let effort = less.map(|less| effort(args, &dataset, &less, watch)).transpose()?;
    let page = tradeoff.page(effort.as_ref());
    files::publish(&args.output.join("report.html"), page.as_bytes())?;
    let most = checked.reference.max_error.filter(|_| args.measure.states_target());
    let verdict = most.map(|most| verdict(&tradeoff, most));
    let efforts = effort.as_ref().map_or(String::new(), |effort| format!("\n{}", effort.table()));
    let told = verdict.as_ref().map_or(String::new(), |(told, _)| format!("\n{told}"));
    let place = args.output.join("report.html");
    let text = format!("{}{efforts}{told}\n{}", tradeoff.table(), place.display());
    let met = verdict.is_none_or(|(_, met)| met);
    let json = json!({
        "output": args.output,
        "tradeoff": tradeoff,
        "effort": effort,
        "target_met": met,
    });
    let mut answer = Answer::new(text, json);
    answer.met = met;
    Ok(answer)
}

/// What is measured, of which each `--only` must name some.
fn candidates(
    args: &TradeoffArgs,
    dataset: &Dataset,
    recipe: &Recipe,
) -> Result<Vec<CandidateRecipe>, Usage> {
    let range = if args.full { Range::Full } else { Range::Quick };
    let mut all = pipeline::candidates(recipe, dataset.header().layout.points, range);
    let names = |part: &String, c: &CandidateRecipe| c.name.contains(part.as_str());
    if let Some(part) = args.only.iter().find(|part| !all.iter().any(|c| names(part, c))) {
        let mut kinds: Vec<&str> =
            all.iter().filter_map(|c| c.name.split([' ', ',']).next()).collect();
        kinds.sort_unstable();
        kinds.dedup();
        let told = format!(
            "no candidate has `{part}` in its name: names begin with {}, and tradeoff.txt of a run \
             without --only lists them all",
            kinds.join(", ")
        );
        return Err(Usage(told));
    }
    if !args.only.is_empty() {
        all.retain(|c| args.only.iter().any(|part| names(part, c)));
    }
    Ok(all)
}

/// What is to be tried with less than the data set has, and the recipe of the model that it is tried with.
fn less(
    args: &TradeoffArgs,
    dataset: &Dataset,
    mut recipe: Recipe,
    watch: &Watch,
) -> anyhow::Result<Option<(Efforts, Recipe)>> {
    let efforts = args.effort.edit(&mut recipe);
    if !efforts.is_any() {
        return match args.effort.family_flag() {
            None => Ok(None),
            Some(flag) => {
                let told = format!(
                    "{flag} names the model that --rays, --poses and --orders try less with: give one of \
                     those, or choose among candidates by --only"
                );
                Err(Usage(told).into())
            }
        };
    }
    pipeline::effective_fit(&recipe)?;
    pipeline::check_effort(dataset, &recipe, &efforts, watch)?;
    Ok(Some((efforts, recipe)))
}

/// The trade-off's own files; what less would do adds to the page.
fn publish(args: &TradeoffArgs, tradeoff: &Tradeoff) -> anyhow::Result<()> {
    let json = serde_json::to_vec_pretty(tradeoff)?;
    files::publish(&args.output.join("tradeoff.json"), &json)?;
    files::publish(&args.output.join("tradeoff.txt"), tradeoff.table().as_bytes())?;
    for (name, svg) in tradeoff.plots() {
        files::publish(&args.output.join(name), svg.as_bytes())?;
    }
    Ok(files::publish(&args.output.join("report.html"), tradeoff.page(None).as_bytes())?)
}

/// What less than the data set has would do.
fn effort(
    args: &TradeoffArgs,
    dataset: &Dataset,
    (efforts, recipe): &(Efforts, Recipe),
    watch: &Watch,
) -> anyhow::Result<Effort> {
    let effort = pipeline::effort(dataset, recipe, efforts, &args.output, watch)?;
    files::publish(&args.output.join("effort.json"), &serde_json::to_vec_pretty(&effort)?)?;
    files::publish(&args.output.join("effort.txt"), effort.table().as_bytes())?;
    files::publish(&args.output.join("effort.svg"), effort.plot().as_bytes())?;
    Ok(effort)
}

/// Whether any point meets a largest error, in words; the smallest that does, or the most accurate of all.
fn verdict(tradeoff: &Tradeoff, most: f32) -> (String, bool) {
    let split = tradeoff.split.as_str();
    let errors = tradeoff.points.iter().filter_map(|p| Some((p, p.errors.get(split)?.rms)));
    let errors: Vec<_> = errors.collect();
    let target = format!("target of at most {most} on {split} motion (coefficient RMSE)");
    let meeting = errors.iter().filter(|(_, rms)| *rms <= f64::from(most));
    if let Some((point, rms)) = meeting.min_by_key(|(point, _)| point.bytes) {
        let told = format!("{target}: {} is the smallest that meets it, with {rms:.5}", point.name);
        return (told, true);
    }
    let best = errors.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let best = best.map_or(String::new(), |(point, rms)| {
        format!("; {} has the least error, {rms:.5}", point.name)
    });
    (format!("{target}: MISSED by all{best}"), false)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::choose::{Point, SplitError};

    /// The smallest point within the target is named; where there is none the most accurate is, and the target
    /// is not met.
    #[test]
    fn a_stated_error_is_judged() {
        let point = |name: &str, bytes, rms| {
            let error = SplitError { rms, ..SplitError::default() };
            let errors = BTreeMap::from([("novel".to_owned(), error)]);
            Point { name: name.to_owned(), bytes, errors, ..Point::default() }
        };
        let tradeoff = Tradeoff {
            scene: String::new(),
            bake: String::new(),
            split: "novel".to_owned(),
            reference_noise_rms: 0.0,
            points: vec![point("large", 9, 0.1), point("small", 5, 0.2), point("tiny", 1, 0.4)],
            front: Vec::new(),
            skipped: BTreeMap::new(),
        };
        let (told, met) = verdict(&tradeoff, 0.25);
        assert!(met && told.contains("0.25 on novel motion") && told.contains("small"), "{told}");
        let (told, met) = verdict(&tradeoff, 1e-9);
        assert!(!met && told.contains("MISSED by all; large has the least"), "{told}");
    }
}
