//! Studies as lines: one quantity over a size, for several models, as a file of its own.

use super::scatter::{COLOURS, WIDTH, as_file};
use super::svg::{Axis, Plot};
use super::text::number;

/// A name and its points, ascending in the first number.
pub type Series = (String, Vec<(f64, f64)>);

/// One picture.
#[derive(Debug)]
pub struct Lines<'a> {
    /// What it shows.
    pub title: &'a str,
    /// Name and unit of the horizontal axis.
    pub x_name: &'a str,
    /// Name and unit of the vertical axis.
    pub y_name: &'a str,
    /// Whether the horizontal axis has equal ratios; then what is not positive is not drawn.
    pub log_x: bool,
    /// The lines; those without points are only named.
    pub series: &'a [Series],
}

/// The picture as an SVG file; the vertical axis starts at 0.
#[must_use]
pub fn lines(lines: &Lines<'_>) -> String {
    drawn(lines, false)
}

/// The same with equal ratios on the vertical axis, for slopes; what is not positive is not drawn.
#[must_use]
pub fn slopes(lines: &Lines<'_>) -> String {
    drawn(lines, true)
}

fn drawn(lines: &Lines<'_>, log_y: bool) -> String {
    let positive = |p: &(f64, f64)| (!lines.log_x || p.0 > 0.0) && (!log_y || p.1 > 0.0);
    let finite = |p: &&(f64, f64)| p.0.is_finite() && p.1.is_finite() && positive(p);
    let all = || lines.series.iter().flat_map(|(_, points)| points.iter().filter(finite));
    let low = all().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let high = all().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
    let top = all().map(|p| p.1).fold(0.0, f64::max);
    let x = match (low.is_finite(), lines.log_x) {
        (false, _) => Axis::linear(0.0, 1.0),
        (true, true) => Axis::log(low / 1.1, high * 1.1),
        (true, false) => Axis::linear(low, high),
    };
    let bottom = all().map(|p| p.1).fold(top, f64::min);
    let y = if log_y { Axis::log(bottom / 1.1, top * 1.1) } else { Axis::from_zero(top * 1.04) };
    let mut plot = Plot::new("study", (WIDTH, 420.0), (x, y));
    plot.grid(lines.x_name, lines.y_name);
    for (i, (name, points)) in lines.series.iter().enumerate() {
        let colour = i % COLOURS.len();
        plot.line(&format!("l{colour}"), points.iter().filter(finite).copied());
        for &(x, y) in points.iter().filter(finite) {
            let hint = format!("{name}: {} at {}", number(y, 3), number(x, 3));
            plot.dot(&format!("g{colour}"), (x, y), &hint);
        }
    }
    let picture = plot.finish(lines.title, "a line is a model, a dot is a measurement");
    let names: Vec<String> = lines.series.iter().map(|(name, _)| name.clone()).collect();
    as_file(&picture, &names)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every point that has a place is drawn, names are escaped, and nothing at all is a picture.
    #[test]
    fn every_series_is_drawn() {
        let series = vec![
            ("a<b".to_owned(), vec![(1.0, 0.5), (10.0, 0.2), (f64::NAN, 1.0)]),
            ("c".to_owned(), vec![(0.0, 0.3), (5.0, 0.1)]),
        ];
        let draw = |log_x, series: &[Series]| {
            lines(&Lines { title: "t", x_name: "x", y_name: "y", log_x, series })
        };
        let circles = |svg: &str| svg.matches("<circle").count();
        // Two of them belong to the legend.
        assert_eq!(circles(&draw(false, &series)), 4 + 2);
        assert_eq!(circles(&draw(true, &series)), 3 + 2);
        assert!(draw(true, &series).contains("a&lt;b") && !draw(true, &series).contains("NaN"));
        assert!(!draw(true, &[]).contains("NaN") && !draw(false, &[]).contains("inf"));
        let with = |series| Lines { title: "t", x_name: "x", y_name: "y", log_x: true, series };
        let zero = [series.clone(), vec![("d".to_owned(), vec![(3.0, 0.0)])]].concat();
        assert_eq!(circles(&slopes(&with(&zero))), 3 + 3, "what has no logarithm is only named");
        assert!(!slopes(&with(&[])).contains("NaN"));
    }
}
