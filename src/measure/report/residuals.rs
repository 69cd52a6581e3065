//! Distribution of signed residuals (PRT07 figure 2).

use std::f64::consts::PI;

use super::svg::{Axis, Plot};
use super::text::{escape, number};
use crate::measure::{CandidateMeasured, Kind, Measured, Residual, Signal};

/// Histogram and distribution function of the model's residuals over the headline split.
pub(super) fn figures(measured: &Measured) -> String {
    let split = measured.headline.and_then(|s| measured.split(s));
    let model = split.and_then(|s| s.candidates.iter().find(|c| c.kind == Kind::Model));
    let Some(model) = model else { return String::new() };
    format!("<div class=\"pair\">{}{}</div>{}", histogram(model), distribution(model), {
        words(measured.signal, &model.residual)
    })
}

fn right_ends(r: &Residual) -> impl Iterator<Item = f64> {
    let (low, width) = (r.histogram_low, r.histogram_width);
    (1..=r.histogram.len()).map(move |i| low + width * i as f64)
}

fn axis(r: &Residual) -> Axis {
    let high = r.histogram_low + r.histogram_width * r.histogram.len() as f64;
    Axis::linear(r.histogram_low, high)
}

fn histogram(model: &CandidateMeasured) -> String {
    let r = &model.residual;
    let top = r.histogram.iter().copied().fold(0.0, f64::max) * 100.0;
    let mut plot = Plot::new("histogram", (480.0, 290.0), (axis(r), Axis::from_zero(top)));
    plot.grid("residual (model − reference)", "per cent of residuals");
    let mut steps = Vec::with_capacity(2 * r.histogram.len());
    for (right, fraction) in right_ends(r).zip(&r.histogram) {
        steps.push((right - r.histogram_width, fraction * 100.0));
        steps.push((right, fraction * 100.0));
    }
    plot.area("model", &steps);
    plot.line("model", steps.iter().copied());
    let caption = "Histogram of the signed residuals of all coefficients, the central 99 %. It \
                   contains the reference's noise.";
    let svg = plot.finish("Histogram of residuals", caption);
    format!("<figure>{svg}<figcaption>{}</figcaption></figure>", escape(caption))
}

fn distribution(model: &CandidateMeasured) -> String {
    let r = &model.residual;
    let mut plot = Plot::new("distribution", (480.0, 290.0), (axis(r), Axis::linear(0.0, 1.0)));
    plot.grid("residual (model − reference)", "fraction at or below");
    plot.line("model", right_ends(r).zip(r.cumulative.iter().copied()));
    for (fraction, label) in [(0.05, "5 %"), (0.5, "median"), (0.95, "95 %")] {
        let Some(bin) = r.cumulative.iter().position(|&c| c >= fraction) else { continue };
        // Linear inside the bin, as the curve is drawn.
        let right = r.histogram_low + r.histogram_width * (bin + 1) as f64;
        let above = r.cumulative[bin];
        let inside =
            if r.histogram[bin] > 0.0 { (above - fraction) / r.histogram[bin] } else { 0.0 };
        let x = right - r.histogram_width * inside.clamp(0.0, 1.0);
        plot.dot("model", (x, fraction), label);
        // The curve rises: above on the left and below on the right it is out of the way.
        let above = fraction < 0.5 || plot.px(x) > 360.0;
        let (by, anchor) = if above { ((-9.0, -6.0), "end") } else { ((9.0, 15.0), "start") };
        let text = format!("{label}: {}", number(x, 2));
        plot.label("", (x, fraction), by, (anchor, &text));
    }
    let caption = "Empirical distribution function of the same residuals.";
    let svg = plot.finish("Distribution of residuals", caption);
    format!("<figure>{svg}<figcaption>{}</figcaption></figure>", escape(caption))
}

fn words(signal: Signal, r: &Residual) -> String {
    let error = r.mean.standard_error.map_or_else(String::new, |e| format!(" ± {}", number(e, 1)));
    let mut text = format!(
        "Mean {}{error}, variance {} without the reference's noise ({} with it).",
        number(r.mean.value, 2),
        number(r.variance, 3),
        number(r.variance_with_noise, 3),
    );
    if signal == Signal::Transfer {
        text.push_str(&format!(
            " In the units of PRT07, which leaves out the 1/π, that is a mean of {} and a variance \
             of {}; it printed 5.1 × 10⁻⁵ and 3.25 × 10⁻⁴ for its regularised fit (other data).",
            number(r.mean.value * PI, 2),
            number(r.variance * PI * PI, 3),
        ));
    }
    format!("<p>{}</p>", escape(&text))
}
