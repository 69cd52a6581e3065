//! Error over the frames of a held-out clip, over the references' noise.

use super::svg::{Axis, Plot};
use super::text::{escape, number};
use crate::measure::{CandidateMeasured, Kind, Measured, SplitMeasured};

/// Most clips that are drawn; the JSON document holds all.
const MOST_CLIPS: usize = 6;
/// Up to so many frames each gets a dot.
const DOTTED: usize = 80;

/// One figure per clip of the headline split.
pub(super) fn figures(measured: &Measured) -> String {
    let Some(split) = measured.headline.and_then(|s| measured.split(s)) else {
        return String::new();
    };
    let clips = split.clips.len();
    let mut out: String =
        (0..clips.min(MOST_CLIPS)).map(|c| figure(split, c, measured.frame_s)).collect();
    if clips > MOST_CLIPS {
        out.push_str(&format!(
            "<p class=\"note\">{} more clips are in the measurement's JSON.</p>",
            clips - MOST_CLIPS
        ));
    }
    out
}

/// The step in time beyond which a line is broken: frames that were not measured are not drawn
/// over, unless most were not, when a line is all that joins the dots.
fn gap(points: &[(f64, f64)], frame_s: f64) -> f64 {
    let close = 1.5 * frame_s;
    let steps = points.windows(2).map(|w| w[1].0 - w[0].0);
    let neighbours = steps.filter(|&step| step <= close).count();
    if 2 * neighbours >= points.len().saturating_sub(1) { close } else { f64::INFINITY }
}

/// Identifiers of the figures' titles.
const IDS: [&str; MOST_CLIPS] = ["curve0", "curve1", "curve2", "curve3", "curve4", "curve5"];

fn figure(split: &SplitMeasured, clip: usize, frame_s: f64) -> String {
    let frames = &split.frames;
    let at: Vec<usize> = (0..frames.clip.len()).filter(|&i| frames.clip[i] == clip).collect();
    let series = |values: &[f64]| -> Vec<(f64, f64)> {
        at.iter().map(|&i| (frames.time_s[i], values[i])).collect()
    };
    let drawn: Vec<(&CandidateMeasured, Vec<(f64, f64)>)> = split
        .candidates
        .iter()
        .filter(|c| matches!(c.kind, Kind::Model | Kind::Baseline))
        .map(|c| (c, series(&c.frame_ao_mae)))
        .collect();
    let noise = series(&frames.ao_noise_mae);
    let (Some(first), Some(last)) = (noise.first(), noise.last()) else { return String::new() };
    let top = drawn.iter().flat_map(|d| &d.1).chain(&noise).map(|p| p.1).fold(0.0, f64::max);
    let axes = (Axis::linear(first.0, last.0), Axis::from_zero(top * 1.04));
    let mut plot = Plot::new(IDS[clip], (960.0, 300.0), axes);
    plot.grid("seconds into the clip", "mean |error| of ambient occlusion");
    let gap = gap(&noise, frame_s);
    let stretches = |points: &[(f64, f64)]| -> Vec<Vec<(f64, f64)>> {
        points.chunk_by(|a, b| b.0 - a.0 <= gap).map(<[_]>::to_vec).collect()
    };
    for stretch in stretches(&noise) {
        plot.area("noise", &stretch);
    }
    for (candidate, points) in &drawn {
        let class = class(candidate.kind);
        for stretch in stretches(points) {
            plot.line(class, stretch.iter().copied());
        }
        if points.len() <= DOTTED {
            for &(t, e) in points {
                let hint = format!("{}: {} at {} s", candidate.name, number(e, 3), number(t, 3));
                plot.dot(class, (t, e), &hint);
            }
        }
    }
    if let Some((model, points)) = drawn.iter().find(|d| d.0.kind == Kind::Model) {
        let lines: Vec<&[(f64, f64)]> = drawn.iter().map(|d| &d.1[..]).collect();
        mark_worst(&mut plot, points, &lines, &model.name);
    }
    let caption = caption(split, clip, at.len());
    let legend: String = drawn
        .iter()
        .map(|(c, _)| legend(class(c.kind), &c.name))
        .chain([legend("noise", "noise of the reference")])
        .collect();
    let svg = plot.finish(&format!("Error over {}", split.clips[clip]), &caption);
    format!(
        "<figure class=\"wide\"><p class=\"legend\">{legend}</p><div class=\"scroll\" tabindex=\"0\">{svg}</div><figcaption>{}</figcaption></figure>",
        escape(&caption)
    )
}

pub(super) fn class(kind: Kind) -> &'static str {
    match kind {
        Kind::Model => "model",
        Kind::Baseline => "mean",
        Kind::Precision | Kind::Other => "other",
    }
}

/// One entry of a legend: a swatch and a name.
pub(super) fn legend(class: &str, name: &str) -> String {
    format!("<span class=\"key {class}\"><i></i>{}</span>", escape(name))
}

/// Width of the label of the worst frame, about, in the plot's units.
const LABEL_WIDTH: f64 = 170.0;

/// Marks the worst frame; its label stands above every line that passes under it.
fn mark_worst(plot: &mut Plot, points: &[(f64, f64)], lines: &[&[(f64, f64)]], name: &str) {
    let Some(&worst) = points.iter().max_by(|a, b| a.1.total_cmp(&b.1)) else { return };
    plot.dot("worst", worst, &format!("worst frame of {name}"));
    let left = plot.px(worst.0) > 800.0;
    let (dx, anchor) = if left { (-8.0, "end") } else { (8.0, "start") };
    let text = format!("worst: {} at {} s", number(worst.1, 3), number(worst.0, 3));
    let (at, from) = (plot.px(worst.0), if left { -LABEL_WIDTH } else { 0.0 });
    let under = at + from - 4.0..=at + from + LABEL_WIDTH;
    let beneath = lines.iter().flat_map(|line| line.iter());
    let beneath = beneath.filter(|point| under.contains(&plot.px(point.0)));
    let highest = beneath.map(|point| plot.py(point.1)).fold(plot.py(worst.1), f64::min);
    plot.label("", worst, (dx, highest - plot.py(worst.1) - 9.0), (anchor, &text));
}

fn caption(split: &SplitMeasured, clip: usize, frames: usize) -> String {
    let name = match split.clips[clip].as_str() {
        "" => "the static pose",
        name => name,
    };
    format!(
        "Clip “{name}” ({}), {frames} measured frames: mean over the mesh of the absolute error of \
         ambient occlusion. Inside the grey area an error cannot be told from the reference’s noise.",
        split.split.name()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The label of the worst frame stands above another line that passes under it, left or right.
    #[test]
    fn the_worst_frame_is_named_above_all_lines() {
        let others = [(1.0, 0.1), (2.0, 0.8), (8.0, 0.9), (9.0, 0.1)];
        for worst in [1.0, 9.0] {
            let model = [(0.0, 0.1), (worst, 0.5)];
            let axes = (Axis::linear(0.0, 10.0), Axis::from_zero(1.0));
            let mut plot = Plot::new("x", (960.0, 300.0), axes);
            mark_worst(&mut plot, &model, &[&model, &others], "m");
            let highest = plot.py(if worst < 5.0 { 0.8 } else { 0.9 });
            let svg = plot.finish("", "");
            let label = svg.split("class=\"label").nth(1).expect("a label");
            let y = label.split(" y=\"").nth(1).and_then(|rest| rest.split('"').next());
            let y: f64 = y.expect("a place").parse().expect("a number");
            assert!(y < highest, "{y} is under {highest}");
        }
    }

    /// Runs of neighbouring frames are told apart where frames between them were not measured;
    /// frames that are all far apart stay joined.
    #[test]
    fn lines_break_at_gaps() {
        let at = |times: &[f64]| times.iter().map(|&t| (t, 0.0)).collect::<Vec<_>>();
        let runs = at(&[0.0, 0.1, 0.2, 0.9, 1.0, 1.1]);
        assert!(gap(&runs, 0.1) < 0.7);
        assert_eq!(gap(&at(&[0.0, 0.5, 1.0]), 0.1), f64::INFINITY);
        assert!(gap(&at(&[0.0]), 0.1) < 0.7);
    }
}
