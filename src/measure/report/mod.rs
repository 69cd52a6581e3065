//! The report: one HTML file that needs nothing else. Pictures are inline SVG, there is no script
//! and no reference to the outside, so it opens from a disk, an e-mail or a printer alike.

mod body;
mod costs;
mod curve;
mod facts;
mod figures;
mod head;
mod input;
mod lines;
mod residuals;
mod scatter;
mod spectrum;
mod stills;
mod svg;
#[cfg(test)]
mod tests;
mod text;

pub use input::{
    Character, ClipFacts, LeftOut, ModelFacts, Phase, ReportInput, RestMesh, Spectrum, Target,
    Times,
};
pub use lines::{Lines, Series, lines, slopes};
pub use scatter::{Place, Scatter, scatter};
pub use stills::ReportStill;

use super::Split;
use text::escape;

/// The page, UTF-8. All text from the input is escaped; sections whose figures are missing are
/// left out.
#[must_use]
pub fn html(input: &ReportInput<'_>) -> String {
    let sections = [
        section("Where it errs", "", &facts::worst(input)),
        section(
            "Beside the truth",
            "The model, the same pose by rays at every pixel, and how far they are apart, in the frames of \
             the split above where its ambient occlusion is worst, middling and best.",
            &stills::figures(&input.stills),
        ),
        section(curves_heading(input), curves_lead(input), &curve::figures(input.measured)),
        section(
            "Every figure",
            "The model beside the baseline that it must beat: the mean over the training poses, \
             which knows nothing of the pose.",
            &figures::splits(input.measured),
        ),
        section("Under six lights", "", &figures::lights(input.measured)),
        section("Residuals", "", &residuals::figures(input.measured)),
        section("How many dimensions", "", &spectra(input)),
        section("Precision", "", &figures::precisions(input)),
        section("Time and size", "", &costs(input)),
        section("The character and its motion", "", &facts::character(input)),
        section("What was left out", "", &facts::left_out(input)),
        section("How it was measured", "", &facts::method(input)),
        section("Recipe", "", &facts::recipe(input)),
    ];
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; img-src data:\"/>\
         <title>{} – Poselight report</title><style>{}</style></head><body><main>{}{}</main></body></html>\n",
        escape(input.title),
        include_str!("style.css"),
        head::head(input),
        sections.concat(),
    )
}

/// A section under its heading; nothing where there is nothing to show.
fn section(heading: &str, lead: &str, body: &str) -> String {
    if body.is_empty() {
        return String::new();
    }
    let lead = if lead.is_empty() { String::new() } else { format!("<p>{lead}</p>") };
    format!("<section><h2>{heading}</h2>{lead}{body}</section>")
}

fn curves_heading(input: &ReportInput<'_>) -> &'static str {
    match input.measured.headline {
        Some(Split::Novel | Split::WithinClip) => "Motion it has not seen",
        Some(Split::Interpolated) => "Between the frames it has seen",
        Some(Split::Training) | None => "Poses it has seen",
    }
}

fn curves_lead(input: &ReportInput<'_>) -> &'static str {
    match input.measured.headline {
        Some(Split::Novel) => "Clips that were held out whole, frame by frame.",
        Some(Split::WithinClip) => {
            "The last quarter of the only clip, which was held out. That is a weaker proof than a \
             clip of its own."
        }
        Some(Split::Interpolated) => {
            "Frames held out between training frames: they say little about other motion."
        }
        Some(Split::Training) | None => {
            "Nothing was held out: these are poses that the fit has seen."
        }
    }
}

fn spectra(input: &ReportInput<'_>) -> String {
    let pose = spectrum::figure(
        "pose-spectrum",
        ("variance", "the pose parameters"),
        &input.pose_spectrum,
    );
    let output = spectrum::figure(
        "output-spectrum",
        ("energy", "the outputs (Σ y², their mean included)"),
        &input.output_spectrum,
    );
    match (pose, output) {
        (None, None) => String::new(),
        (pose, output) => {
            format!(
                "<div class=\"pair\">{}{}</div>",
                pose.unwrap_or_default(),
                output.unwrap_or_default()
            )
        }
    }
}

fn costs(input: &ReportInput<'_>) -> String {
    format!(
        "{}<h3>Beside radiance transfer of 2007</h3>{}<h3>Beside the others</h3>{}",
        costs::spent(input),
        costs::beside_prt(input),
        costs::beside_others(input)
    )
}
