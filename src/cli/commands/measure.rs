//! `poselight measure`: a model against references.

use serde_json::json;

use crate::cli::Answer;
use crate::cli::args::MeasureArgs;
use crate::dataset::Dataset;
use crate::pipeline::{self, Checked, Figures, Watch, files};

pub(in crate::cli) fn measure(args: &MeasureArgs, watch: &Watch) -> anyhow::Result<Answer> {
    let mut model = super::read_model(&args.model)?.0;
    let dataset = Dataset::open(&args.dataset)?;
    let mut recipe = pipeline::recipe_of_model(&model)?;
    args.measure.edit(&mut recipe);
    let checked = Checked::new(&recipe)?;
    let (figures, page) = pipeline::examine(&mut model, &dataset, &recipe, watch)?;
    if let Some(path) = &args.report {
        files::publish(path, page.as_bytes())?;
    }
    let met = pipeline::meets_target(&figures.measured, checked.reference);
    let mut text = table(&figures) + &verdict(met, met, checked.reference.max_error);
    if let Some(path) = &args.report {
        text += &format!("\nreport: {}", path.display());
    }
    let mut answer = Answer::new(text, json!({ "figures": figures, "target_met": met }));
    answer.met = met;
    Ok(answer)
}

/// A line on the target, where one was stated.
pub(super) fn verdict(met: bool, reached: bool, most: Option<f32>) -> String {
    let Some(most) = most else { return String::new() };
    let verdict = match (met, reached) {
        (true, _) => "met",
        (false, false) => "MISSED",
        (false, true) => "met here, but MISSED by what training clips say of one another",
    };
    format!("\ntarget of at most {most} on unseen motion (coefficient RMSE): {verdict}")
}

/// The headline figures, a line per split.
pub(super) fn table(figures: &Figures) -> String {
    let measured = &figures.measured;
    let mut text = String::from(
        "split         poses   coefficient RMSE   ao error    ao p99   (mean alone: RMSE, ao error)",
    );
    for split in &measured.splits {
        let of = |name: &str| split.candidates.iter().find(|c| c.name == name);
        let (Some(model), Some(mean)) = (of(&measured.model), of("mean")) else { continue };
        text += &format!(
            "\n{:<12} {:>6}   {:>16}   {:>8.4}  {:>8.4}   {:>12}, {:.4}",
            split.split.name(),
            split.poses,
            rms(model.coefficients.rms),
            model.ao.mean_absolute.value,
            model.ao.p99,
            rms(mean.coefficients.rms),
            mean.ao.mean_absolute.value,
        );
        if let Some(worst) = &model.worst {
            text += &format!(
                "\n    worst frame: clip {} at {:.2} s ({:.4}); worst vertex: {} of {} ({:.4})",
                worst.pose.clip,
                worst.pose.time_s,
                worst.pose.ao_mae,
                worst.vertex.place.vertex_in_part,
                worst.vertex.place.part,
                worst.vertex.ao_mae,
            );
        }
    }
    text + &remark(figures)
}

/// A sentence where the model is no better than the mean on the split that counts.
fn remark(figures: &Figures) -> String {
    let measured = &figures.measured;
    let found = measured.splits.iter().find(|split| Some(split.split) == measured.headline);
    // Of a scene that stands still there is nothing to learn but its mean.
    let Some(split) = found.filter(|split| split.frames.time_s.len() > 1) else {
        return String::new();
    };
    let of = |name: &str| split.candidates.iter().find(|c| c.name == name)?.coefficients.rms;
    match (of(&measured.model), of("mean")) {
        (Some(model), Some(mean)) if figures.model.family != "mean" && model >= mean => format!(
            "\non {} motion this model is no better than the mean alone: {}",
            split.split.name(),
            advice(&figures.model.family, figures.choice.is_some()),
        ),
        _ => String::new(),
    }
}

/// What would help a model that has learnt nothing. A target that chose it has weighed occluders already.
fn advice(family: &str, is_chosen: bool) -> &'static str {
    match is_chosen || family.starts_with("occluder") {
        true => "it takes more motion to train on",
        false => "it takes more motion to train on, or `--family occluder`",
    }
}

/// A root that noise swallowed has no number.
fn rms(value: Option<f64>) -> String {
    value.map_or_else(|| "below noise".to_owned(), |value| format!("{value:.5}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Occluders are no advice for a model of them, nor where a target chose another.
    #[test]
    fn advice_is_what_was_not_tried() {
        assert!(advice("linear", false).contains("occluder"));
        assert!(!advice("occluder with pca-linear", false).contains("occluder"));
        assert!(!advice("linear", true).contains("occluder"));
    }
}
