//! Eigenvalue spectra: how many dimensions the poses and the outputs have (PRT07 figure 4).

use super::input::Spectrum;
use super::svg::{Axis, Plot};
use super::text::{escape, percent};

/// Fractions of the variance that are marked.
const MARKS: [(f64, &str); 3] = [(0.9, "90 %"), (0.99, "99 %"), (0.999, "99.9 %")];

/// What a spectrum says in numbers.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Summary {
    /// Dimensions that hold each of [`MARKS`]; `None` beyond the known values.
    pub(super) dimensions: [Option<usize>; 3],
    /// Fraction of the variance in the dimensions that are kept.
    pub(super) kept: Option<f64>,
}

/// Cumulative fractions of the variance, one per dimension.
fn cumulative(spectrum: &Spectrum<'_>) -> Vec<f64> {
    let known: f64 = spectrum.values.iter().sum();
    let total = spectrum.total.unwrap_or(known).max(known);
    let mut sum = 0.0;
    let step = |x: &f64| {
        sum += x;
        if total > 0.0 { sum / total } else { 1.0 }
    };
    spectrum.values.iter().map(step).collect()
}

pub(super) fn summary(spectrum: &Spectrum<'_>) -> Summary {
    let cumulative = cumulative(spectrum);
    // Round-off may leave the last sum a hair under 1.
    let reach = |f: f64| cumulative.iter().position(|&c| c >= f - 1e-12).map(|i| i + 1);
    let kept = spectrum.kept.filter(|&k| k > 0).and_then(|k| cumulative.get(k - 1)).copied();
    Summary { dimensions: MARKS.map(|m| reach(m.0)), kept }
}

/// What each number of dimensions leaves out, on logarithmic axes, with the marks; `measure` is
/// what is shared out: variance, or energy with the mean in it. `None` of an
/// empty spectrum.
pub(super) fn figure(
    id: &'static str,
    (measure, name): (&str, &str),
    spectrum: &Spectrum<'_>,
) -> Option<String> {
    let cumulative = cumulative(spectrum);
    let count = cumulative.len();
    if count == 0 {
        return None;
    }
    // What is left after k dimensions; below 1e-6 nothing can be told.
    let left: Vec<(f64, f64)> = std::iter::once((0.0, 1.0))
        .chain(cumulative.iter().enumerate().map(|(i, c)| ((i + 1) as f64, (1.0 - c).max(1e-9))))
        .collect();
    let lowest = left.iter().map(|p| p.1).fold(1.0, f64::min).clamp(1e-5, 1e-3);
    let wide = count > 120;
    let across = if wide { Axis::log(1.0, count as f64) } else { Axis::linear(0.0, count as f64) };
    let mut plot = Plot::new(id, (480.0, 290.0), (across, Axis::log(lowest, 1.0)));
    plot.grid("dimensions", &format!("{measure} left out (1 = all)"));
    let shown: Vec<(f64, f64)> =
        left.into_iter().filter(|p| (!wide || p.0 >= 1.0) && p.1 >= lowest).collect();
    plot.area("model", &shown);
    plot.line("model", shown.iter().copied());
    let summary = summary(spectrum);
    // First, so that it does not cut through the labels.
    if let Some(kept) = spectrum.kept.filter(|&k| k > 0 && k <= count) {
        let anchor = if plot.px(kept as f64) > 360.0 { "end" } else { "start" };
        plot.rule(kept as f64, &format!("kept: {kept}"), anchor);
    }
    for ((_, label), dimensions) in MARKS.iter().zip(summary.dimensions) {
        let Some(k) = dimensions else { continue };
        let at = (k as f64, 1.0 - cumulative[k - 1]);
        plot.dot("model", at, &format!("{k} dimensions hold {label} of the {measure}"));
        let right = plot.px(k as f64) > 330.0;
        let (by, anchor) = if right { ((-8.0, 16.0), "end") } else { ((9.0, -7.0), "start") };
        plot.label("", at, by, (anchor, &format!("{label} in {k}")));
    }
    let caption = caption((measure, name), spectrum, &summary);
    let svg = plot.finish(&format!("Spectrum of {name}"), &caption);
    Some(format!("<figure>{svg}<figcaption>{}</figcaption></figure>", escape(&caption)))
}

/// A share as per cent, in which only a whole is 100.
fn share(fraction: f64) -> String {
    match fraction {
        all if all >= 1.0 - 1e-12 => "all of it".to_owned(),
        most if most > 0.9994 => "more than 99.9\u{a0}%".to_owned(),
        part => percent(part),
    }
}

fn caption((measure, name): (&str, &str), spectrum: &Spectrum<'_>, summary: &Summary) -> String {
    let mut text = format!("Part of the {measure} of {name} that so many dimensions leave out.");
    let held: Vec<String> = MARKS
        .iter()
        .zip(summary.dimensions)
        .filter_map(|((_, label), k)| k.map(|k| format!("{label} in {k}")))
        .collect();
    if !held.is_empty() {
        text.push_str(&format!(" They hold {}.", held.join(", ")));
    }
    if let (Some(kept), Some(fraction)) = (spectrum.kept, summary.kept) {
        text.push_str(&format!(" The model keeps {kept}, which hold {}.", share(fraction)));
    }
    if spectrum.total.is_some() {
        text.push_str(" Only the largest eigenvalues were computed; the total is exact.");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dimensions of a geometric spectrum, counted by hand; a total beyond the known values makes
    /// the last marks unreachable.
    #[test]
    fn dimensions_by_hand() {
        let values = [0.9, 0.09, 0.009, 0.0009, 0.0001];
        let all = Spectrum { values: &values, total: None, kept: Some(2) };
        let found = summary(&all);
        assert_eq!(found.dimensions, [Some(1), Some(2), Some(3)]);
        assert!((found.kept.unwrap() - 0.99).abs() < 1e-12);
        let part = Spectrum { total: Some(1.05), ..all };
        assert_eq!(summary(&part).dimensions, [Some(2), None, None]);
        let none = Spectrum::default();
        assert_eq!(summary(&none).dimensions, [None; 3]);
        assert_eq!(figure("x", ("variance", "poses"), &none), None);
    }

    /// Only a whole is called so; what rounds to it is not.
    #[test]
    fn a_share_is_not_rounded_to_a_whole() {
        let shares = [1.0, 0.99996, 0.9994, 0.9].map(share);
        assert_eq!(shares, ["all of it", "more than 99.9\u{a0}%", "99.9\u{a0}%", "90.0\u{a0}%"]);
    }

    /// A spectrum of zeros, one value, and a thousand all draw.
    #[test]
    fn odd_spectra_draw() {
        let thousand: Vec<f64> = (0..1000).map(|i| 0.9f64.powi(i)).collect();
        for values in [&[0.0, 0.0][..], &[2.0], &thousand] {
            let spectrum = Spectrum { values, total: None, kept: Some(1) };
            let svg = figure("x", ("variance", "poses"), &spectrum).unwrap();
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }
}
