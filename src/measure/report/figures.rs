//! Tables of measured figures: splits × metrics, lights, precisions.

use super::curve::class;
use super::input::ReportInput;
use super::text::{escape, number, percent, plural, size};
use crate::measure::{CandidateMeasured, Estimate, Kind, Measured, SplitMeasured, Squared};

/// One column of the large table.
#[derive(Debug)]
struct Column {
    head: &'static str,
    /// One line under the table.
    meaning: &'static str,
    cell: fn(&CandidateMeasured) -> Option<String>,
}

const COLUMNS: [Column; 9] = [
    Column {
        head: "AO mean |e|",
        meaning: "mean absolute error of ambient occlusion, against the average of both \
                  references: contains their noise",
        cell: |c| Some(estimate(c.ao.mean_absolute)),
    },
    Column {
        head: "AO p99",
        meaning: "its 99th percentile over vertices and poses",
        cell: |c| Some(number(c.ao.p99, 3)),
    },
    Column {
        head: "AO RMS",
        meaning: "root mean square error of ambient occlusion, free of the references' noise",
        cell: |c| Some(squared(&c.ao.squared)),
    },
    Column {
        head: "Coefficient RMS",
        meaning: "root mean square error of all coefficients, free of noise",
        cell: |c| Some(squared(&c.coefficients)),
    },
    Column {
        head: "E / signal",
        meaning: "root of E = ∫(T_g − T_s)² dω over the normal's hemisphere, relative to the \
                  signal's own",
        cell: |c| c.function.and_then(|f| f.hemisphere_relative).map(percent),
    },
    Column {
        head: "‖Δ‖",
        meaning: "root of ‖Δ‖² over the whole sphere",
        cell: |c| c.function.map(|f| squared(&f.sphere)),
    },
    Column {
        head: "Shading",
        meaning: "relative RMS error of shading, mean over the lights below",
        cell: |c| lights_mean(c, |s| s.relative_rms).map(percent),
    },
    Column {
        head: "PSNR",
        meaning: "of shading, mean over the lights; peak: the brightest unshaded white surface",
        cell: |c| lights_mean(c, |s| s.psnr_db).map(|x| format!("{x:.1}\u{a0}dB")),
    },
    Column {
        head: "Flicker",
        meaning: "RMS change of the error of ambient occlusion from one frame to the next",
        cell: |c| c.flicker.map(|f| squared(&f.ao)),
    },
];

fn lights_mean(
    c: &CandidateMeasured,
    of: fn(&crate::measure::ShadingError) -> Option<f64>,
) -> Option<f64> {
    let known: Vec<f64> = c.shading.iter().filter_map(of).collect();
    crate::num::stats::mean(&known)
}

/// A mean with its standard error.
pub(super) fn estimate(e: Estimate) -> String {
    let error = e.standard_error.map(|s| format!(" <small>±\u{a0}{}</small>", number(s, 1)));
    number(e.value, 3) + &error.unwrap_or_default()
}

/// A root mean square, starred where the references' noise is larger.
fn squared(s: &Squared) -> String {
    let star = if s.below_noise { "<span class=\"star\">*</span>" } else { "" };
    match s.rms {
        Some(rms) => number(rms, 3) + star,
        None => format!("≈\u{a0}0{star}"),
    }
}

/// Every split and candidate against every metric.
pub(super) fn splits(measured: &Measured) -> String {
    let candidates = || measured.splits.iter().flat_map(|s| &s.candidates);
    let columns: Vec<&Column> =
        COLUMNS.iter().filter(|c| candidates().any(|m| (c.cell)(m).is_some())).collect();
    let heads: String =
        columns.iter().map(|c| format!("<th scope=\"col\">{}</th>", c.head)).collect();
    let bodies: String = measured.splits.iter().rev().map(|s| split_rows(s, &columns)).collect();
    let meanings: String = columns
        .iter()
        .map(|c| format!("<dt>{}</dt><dd>{}</dd>", c.head, escape(c.meaning)))
        .collect();
    format!(
        "<div class=\"scroll\" tabindex=\"0\"><table class=\"figures\"><thead><tr><th scope=\"col\"></th>{heads}</tr></thead>{bodies}</table></div>\
         <p class=\"note\"><span class=\"star\">*</span> below the noise of the reference: not claimed. ≈ 0: lost in the noise altogether.</p>\
         <details><summary>What the columns mean</summary><dl class=\"meanings\">{meanings}</dl></details>"
    )
}

fn split_rows(split: &SplitMeasured, columns: &[&Column]) -> String {
    let clips = match split.clips.len() {
        1 if split.clips[0].is_empty() => "static".to_owned(),
        1..=3 => split.clips.iter().map(|c| escape(c)).collect::<Vec<_>>().join(", "),
        n => plural(n, "clip"),
    };
    let noise = format!(
        "{}, {clips}; reference noise: AO mean {}, coefficient RMS {}",
        plural(split.poses, "pose"),
        number(split.reference.ao_noise_mae, 2),
        number(split.reference.coefficient_noise_rms, 2),
    );
    let rows: String = split
        .candidates
        .iter()
        .filter(|c| c.kind != Kind::Precision)
        .map(|c| {
            let cells: String = columns
                .iter()
                .map(|column| format!("<td>{}</td>", (column.cell)(c).unwrap_or("–".to_owned())))
                .collect();
            let (class, name) = (class(c.kind), escape(&c.name));
            format!("<tr class=\"{class}\"><th scope=\"row\"><span class=\"key {class}\"><i></i>{name}</span></th>{cells}</tr>")
        })
        .collect();
    format!(
        "<tbody><tr class=\"group\"><th scope=\"rowgroup\" colspan=\"{}\">{} <small>{noise}</small></th></tr>{rows}</tbody>",
        columns.len() + 1,
        split.split.name(),
    )
}

/// Shading errors by light over the headline split, with bars.
pub(super) fn lights(measured: &Measured) -> String {
    let Some(split) = measured.headline.and_then(|s| measured.split(s)) else {
        return String::new();
    };
    let shown: Vec<&CandidateMeasured> = split
        .candidates
        .iter()
        .filter(|c| matches!(c.kind, Kind::Model | Kind::Baseline) && !c.shading.is_empty())
        .collect();
    if shown.is_empty() {
        return String::new();
    }
    let most = shown.iter().flat_map(|c| &c.shading).filter_map(|s| s.relative_rms);
    let most = most.fold(1e-12, f64::max);
    let rows: String = measured
        .lights
        .iter()
        .enumerate()
        .map(|(k, light)| {
            let bars: String = shown.iter().map(|c| light_bar(c, k, most)).collect();
            format!(
                "<tr><th scope=\"row\">{}<small>{}</small></th><td>{bars}</td></tr>",
                escape(&light.name),
                escape(&light.description),
            )
        })
        .collect();
    format!(
        "<table class=\"lights\"><thead><tr><th scope=\"col\">Light</th><th scope=\"col\">Relative RMS error of shading, PSNR ({})</th></tr></thead><tbody>{rows}</tbody></table>",
        split.split.name()
    )
}

fn light_bar(c: &CandidateMeasured, light: usize, most: f64) -> String {
    let s = &c.shading[light];
    let relative = s.relative_rms.unwrap_or(0.0);
    let star = if s.squared.below_noise { "*" } else { "" };
    let words = match (s.relative_rms, s.psnr_db) {
        (Some(r), Some(db)) => format!("{}{star}, {db:.1}\u{a0}dB", percent(r)),
        (Some(r), None) => format!("{}{star}", percent(r)),
        _ => "≈\u{a0}0*".to_owned(),
    };
    format!(
        "<div class=\"bar {}\"><i style=\"width:{:.1}%\"></i><span>{words} <small>{}</small></span></div>",
        class(c.kind),
        55.0 * relative / most,
        escape(&c.name),
    )
}

/// Bytes and error of each precision, and how far it is from the most precise; empty where there is one only.
pub(super) fn precisions(input: &ReportInput<'_>) -> String {
    let measured = input.measured;
    let split = measured.headline.and_then(|s| measured.split(s));
    let candidates = split.map_or(&[][..], |s| &s.candidates);
    let row = |c: &CandidateMeasured| {
        let bytes = input.model.sizes.iter().find(|s| s.0 == c.name);
        let bytes = bytes.map_or("–".to_owned(), |s| size(s.1));
        let added = c.added.map_or_else(
            || "<td>–</td>".repeat(4),
            |a| {
                let growth = a.mean_square_growth.map_or("–".to_owned(), growth);
                let cells = [a.coefficient_rms, a.ao_mae, a.ao_max].map(|x| number(x, 2));
                let cells = cells.iter().chain([&growth]);
                cells.map(|x| format!("<td>{x}</td>")).collect()
            },
        );
        let stored = match c.kind {
            Kind::Model => format!(" ({})", escape(&input.model.precision)),
            _ => String::new(),
        };
        format!(
            "<tr><th scope=\"row\">{}{stored}</th><td>{bytes}</td>{added}<td>{}</td></tr>",
            escape(&c.name),
            estimate(c.ao.mean_absolute)
        )
    };
    if !candidates.iter().any(|c| c.kind == Kind::Precision) {
        return String::new();
    }
    let kinds = [Kind::Model, Kind::Precision];
    let rows: String = candidates.iter().filter(|c| kinds.contains(&c.kind)).map(row).collect();
    format!(
        "<div class=\"scroll\" tabindex=\"0\"><table class=\"figures\"><thead><tr><th scope=\"col\">Stored as</th><th scope=\"col\">File</th><th scope=\"col\">Added coefficient RMS</th><th scope=\"col\">Added AO mean</th><th scope=\"col\">Added AO max</th><th scope=\"col\">Mean square grows by</th><th scope=\"col\">AO mean |e|</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )
}

/// A relative change with its sign; below 0.01 % only that.
fn growth(change: f64) -> String {
    match change {
        x if x.abs() < 1e-4 => "&lt;\u{a0}0.01\u{a0}%".to_owned(),
        x if x > 0.0 => format!("+{}", percent(x)),
        x => percent(x),
    }
}
