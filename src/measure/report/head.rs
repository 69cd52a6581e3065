//! The top of the page: what it is about, warnings, and the numbers that matter most.

use super::figures::estimate;
use super::input::{ReportInput, Target};
use super::text::{bytes, count, duration, escape, many, number, percent, plural, size, time};
use crate::measure::{CandidateMeasured, Kind, Signal, Split, SplitMeasured};

/// The headline split with its model and its baseline.
struct Headline<'a> {
    split: &'a SplitMeasured,
    model: &'a CandidateMeasured,
    baseline: Option<&'a CandidateMeasured>,
}

fn headline<'a>(input: &ReportInput<'a>) -> Option<Headline<'a>> {
    let split = input.measured.split(input.measured.headline?)?;
    let of = |kind| split.candidates.iter().find(|c| c.kind == kind);
    Some(Headline { split, model: of(Kind::Model)?, baseline: of(Kind::Baseline) })
}

pub(super) fn head(input: &ReportInput<'_>) -> String {
    let measured = input.measured;
    let signal = match measured.signal {
        Signal::Ao => "ambient occlusion".to_owned(),
        Signal::Visibility => format!("visibility, order {}", measured.order),
        Signal::Transfer => format!("radiance transfer, order {}", measured.order),
    };
    let family = match (input.model.family.as_str(), input.model.frame.as_str()) {
        (family, "") => escape(family),
        (family, frame) => format!("{} in the {} frame", escape(family), escape(frame)),
    };
    let eyebrow = format!("Poselight report · {signal} · {family}");
    let headline = headline(input);
    let lede =
        headline.as_ref().map_or_else(|| "Nothing was measured.".to_owned(), |h| lede(input, h));
    format!(
        "<header><p class=\"eyebrow\">{eyebrow}</p><h1>{}</h1><p class=\"lede\">{lede}</p></header>{}{}",
        escape(input.title),
        warnings(&all_warnings(input)),
        tiles(input, headline.as_ref()),
    )
}

/// What the model is and how well it does, in two or three honest sentences.
fn lede(input: &ReportInput<'_>, h: &Headline<'_>) -> String {
    let what = match input.measured.signal {
        Signal::Ao => "the ambient occlusion",
        Signal::Visibility => "the visibility",
        Signal::Transfer => "the radiance transfer",
    };
    let bytes = input.model.sizes.first();
    let model = bytes.map_or_else(|| "The model".to_owned(), |s| format!("A {} model", size(s.1)));
    let vertices = input.character.vertices.max(input.measured.points);
    let vertices =
        format!("{} {}", count(vertices as u64), if vertices == 1 { "vertex" } else { "vertices" });
    let seen = match h.split.split {
        Split::Novel => "In clips that it has not seen",
        Split::WithinClip => "In the held-out end of its only clip",
        Split::Interpolated => "Between the frames that it has seen",
        Split::Training => "In the poses that it was fitted to",
    };
    let error = h.model.ao.mean_absolute.value;
    let any = if input.character.parameters > 0 { " for any pose" } else { "" };
    let mut text = format!(
        "{model} gives {what} at {vertices}{any}. {seen}, its ambient occlusion is off by {} on average",
        number(error, 2)
    );
    if let Some(baseline) = h.baseline {
        text.push_str(&against(error, baseline.ao.mean_absolute.value));
    }
    text.push('.');
    if h.model.ao.squared.below_noise {
        text.push_str(" That is no more than the noise of the reference that it is measured by.");
    }
    text
}

/// How the error compares to the baseline's; differences below 0.5 % are none.
fn against(error: f64, baseline: f64) -> String {
    let (shown, less) = (number(baseline, 2), 1.0 - error / baseline.max(1e-300));
    if error == baseline || less.abs() < 0.005 {
        return ", the same as a model that ignores the pose".to_owned();
    }
    if less < 0.0 {
        return format!(
            ", which is <strong>worse</strong> than the {shown} of a model that ignores the pose"
        );
    }
    let part = (less * 100.0).round();
    format!(", where a model that ignores the pose is off by {shown}: {part}\u{a0}% less")
}

fn missed_target(target: &Target) -> String {
    if let Some(validated) = target.validated.filter(|_| target.is_reached()) {
        return format!(
            "The target is missed: here coefficients are off by no more than the {} (RMS) that was asked for, but by what the training clips say of one another they may be off by {}.",
            number(target.most, 3),
            number(validated, 3)
        );
    }
    format!(
        "The target is missed: coefficients were to be off by at most {} (RMS), and are by {}.",
        number(target.most, 3),
        number(target.reached.unwrap_or_default(), 3)
    )
}

/// The caller's warnings, and those that the figures themselves call for.
fn all_warnings(input: &ReportInput<'_>) -> Vec<String> {
    let missed = input.target.filter(|target| !target.is_met());
    let mut all: Vec<String> = missed.iter().map(missed_target).collect();
    all.extend(input.warnings.iter().cloned());
    if input.character.parameters == 0 {
        all.push(
            "Nothing that the model could follow moves in the training poses: the model is their mean."
                .to_owned(),
        );
    }
    if input.measured.headline == Some(Split::Training) && input.character.parameters > 0 {
        all.push(
            "No motion was held out: the errors are of poses that the fit has seen.".to_owned(),
        );
    }
    let (rays, wanted) = (input.measured.reference_rays, 8 * u64::from(input.character.rays));
    if let Some(rays) = rays.filter(|&r| u64::from(r) < wanted) {
        all.push(format!(
            "The references have {} rays per point; {} (8 times the bake's) are asked for.",
            count(u64::from(rays)),
            count(wanted)
        ));
    }
    all
}

fn warnings(warnings: &[String]) -> String {
    if warnings.is_empty() {
        return String::new();
    }
    let items: String = warnings.iter().map(|w| format!("<li>{}</li>", escape(w))).collect();
    format!(
        "<div class=\"warnings\" role=\"note\"><p>Before you trust this</p><ul>{items}</ul></div>"
    )
}

/// What, value, unit, more.
fn tile(class: &str, what: &str, value: (String, &str), more: &str) -> String {
    let (value, unit) = value;
    format!(
        "<div class=\"tile {class}\"><p class=\"what\">{what}</p><p class=\"value\">{value} <small>{unit}</small></p><p class=\"more\">{more}</p></div>"
    )
}

fn tiles(input: &ReportInput<'_>, headline: Option<&Headline<'_>>) -> String {
    let mut out = String::new();
    if let Some(h) = headline {
        out.push_str(&error_tile(h));
        if let Some(relative) = h.model.function.and_then(|f| f.hemisphere_relative) {
            out.push_str(&transfer_tile(h, relative));
        }
    }
    out.push_str(&size_tile(input));
    if let Some(us) = input.model.evaluate_us {
        let (value, unit) = duration(us * 1e-6);
        let folded = input
            .model
            .folded_us
            .map_or_else(String::new, |f| format!("; folded to one light: {}", time(f * 1e-6)));
        let what = "Evaluation of one pose";
        let more = format!("every coefficient of every vertex, one core{folded}");
        out.push_str(&tile("", what, (value, unit), &more));
    }
    if let Some(target) = input.target.filter(Target::is_met) {
        let reached = target.reached.map_or_else(|| "≈\u{a0}0".to_owned(), |r| number(r, 3));
        let more = format!("coefficient RMS; at most {} was asked for", number(target.most, 3));
        out.push_str(&tile("", "Target met", (reached, ""), &more));
    }
    let part = input.times.bake_rays_per_s.filter(|_| input.times.bake_s.is_none());
    if let Some(rate) = part {
        let rate = (number(rate / 1e6, 3), "million rays/s");
        out.push_str(&tile("", "Bake", rate, "of the part that the last run baked"));
    }
    if let Some(s) = input.times.bake_s.filter(|&s| s > 0.0) {
        let rate = number(input.times.bake_rays as f64 / s / 1e6, 3);
        let poses = plural(input.times.bake_poses, "pose");
        let more = format!("{} rays for {poses} in {}", many(input.times.bake_rays), time(s));
        out.push_str(&tile("", "Bake", (rate, "million rays/s"), &more));
    }
    if !input.times.fit.is_empty() {
        let fit: f64 = input.times.fit.iter().map(|p| p.seconds).sum();
        let part = input.times.bake_s.filter(|&s| s > 0.0).map_or_else(
            || "all phases".to_owned(),
            |s| format!("all phases: {} of the bake’s time", percent(fit / s)),
        );
        let (value, unit) = duration(fit);
        out.push_str(&tile("", "Fit", (value, unit), &part));
    }
    format!("<div class=\"tiles\">{out}</div>")
}

fn error_tile(h: &Headline<'_>) -> String {
    let what = match h.split.split {
        Split::Novel => "Error on unseen clips",
        Split::WithinClip => "Error on the held-out quarter",
        Split::Interpolated => "Error between seen frames",
        Split::Training => "Error on seen poses",
    };
    let baseline = h.baseline.map_or_else(String::new, |b| {
        format!("baseline “{}” {}; ", escape(&b.name), number(b.ao.mean_absolute.value, 3))
    });
    let noise = number(h.split.reference.ao_noise_mae, 2);
    let value = (estimate(h.model.ao.mean_absolute), "");
    let more =
        format!("mean |error| of ambient occlusion (0 to 1); {baseline}reference noise {noise}");
    tile("first", what, value, &more)
}

fn transfer_tile(h: &Headline<'_>, relative: f64) -> String {
    let baseline = h.baseline.and_then(|b| b.function).and_then(|f| f.hemisphere_relative);
    let baseline = baseline.map_or_else(String::new, |b| format!("; baseline {}", percent(b)));
    let star = h.model.function.is_some_and(|f| f.hemisphere.below_noise);
    let star = if star { " (below the reference’s noise)" } else { "" };
    let value = (number(relative * 100.0, 3), "%");
    let more = format!("√E over the upper hemisphere, relative to the signal{star}{baseline}");
    tile("first", "Transfer error", value, &more)
}

fn size_tile(input: &ReportInput<'_>) -> String {
    let model = &input.model;
    let Some((name, n)) = model.sizes.first() else { return String::new() };
    let of = |whole: u64, what: &str| {
        (whole > 0).then(|| format!("{} of {what}", percent(*n as f64 / whole as f64)))
    };
    let parts: Vec<String> = [
        of(model.mesh_bytes, "one pose’s coefficients"),
        of(model.training_bytes, "the training data"),
    ]
    .into_iter()
    .flatten()
    .collect();
    let (value, unit) = bytes(*n);
    let more = format!("{} file; {}", escape(name), parts.join(", "));
    tile("", "Model", (value, unit), more.trim_end_matches("; "))
}
