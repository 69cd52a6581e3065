//! Models as points over two of their numbers, both on logarithmic axes: the picture of a
//! trade-off, as a file of its own.

use super::svg::{Axis, Plot};
use super::text::escape;

/// Colours by group, legible on white and on black.
pub(super) const COLOURS: [&str; 8] =
    ["#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#bb7744", "#888888"];

/// Width of the plot in a file of its own, pixels.
pub(super) const WIDTH: f64 = 960.0;

/// A point: across, up, index of its group, and what a pointer shows.
pub type Place = (f64, f64, usize, String);

/// One picture.
#[derive(Debug)]
pub struct Scatter<'a> {
    /// What it shows.
    pub title: &'a str,
    /// Name and unit of the horizontal axis.
    pub x_name: &'a str,
    /// Name and unit of the vertical axis.
    pub y_name: &'a str,
    /// The groups that points are coloured by.
    pub groups: &'a [String],
    /// Those with positive numbers are drawn.
    pub points: &'a [Place],
    /// Indices of points that a line joins, in order.
    pub front: &'a [usize],
}

/// The picture as an SVG file.
#[must_use]
pub fn scatter(scatter: &Scatter<'_>) -> String {
    let drawn = |p: &&Place| p.0 > 0.0 && p.1 > 0.0;
    let points = || scatter.points.iter().filter(drawn);
    let range = |of: fn(&Place) -> f64| {
        let low = points().map(of).fold(f64::INFINITY, f64::min);
        let high = points().map(of).fold(0.0, f64::max);
        if low < high {
            Axis::log(low / 1.2, high * 1.2)
        } else {
            Axis::log(high / 2.0, high * 2.0)
        }
    };
    let axes = (range(|p| p.0), range(|p| p.1));
    let mut plot = Plot::new("tradeoff", (WIDTH, 540.0), axes);
    plot.grid(scatter.x_name, scatter.y_name);
    let front = scatter.front.iter().map(|&i| &scatter.points[i]).filter(drawn);
    plot.line("front", front.map(|p| (p.0, p.1)));
    for (x, y, group, hint) in points() {
        plot.dot(&format!("g{}", group % COLOURS.len()), (*x, *y), hint);
    }
    let picture = plot.finish(scatter.title, "every point is a model; a line joins the best");
    as_file(&picture, scatter.groups)
}

/// A plot as a file of its own, with its colours and a legend of the groups.
pub(super) fn as_file(picture: &str, groups: &[String]) -> String {
    let head =
        "<svg xmlns=\"http://www.w3.org/2000/svg\" font-family=\"sans-serif\" font-size=\"12\" ";
    // The legend stands beside the plot, some seven pixels a letter.
    let letters = groups.iter().map(|name| name.chars().count()).max().unwrap_or(0);
    let narrow = format!("viewBox=\"0 0 {WIDTH} ");
    let wide = format!("viewBox=\"0 0 {} ", WIDTH + 28.0 + 7.0 * letters as f64);
    let picture = picture.replacen("<svg ", head, 1).replacen(&narrow, &wide, 1);
    let Some(end) = picture.find('>') else { return picture };
    format!("{}{}{}{}", &picture[..=end], style(), legend(groups), &picture[end + 1..])
}

fn style() -> String {
    let groups = COLOURS.iter().enumerate();
    let groups = groups.map(|(i, c)| format!(".g{i}{{fill:{c}}}.line.l{i}{{stroke:{c}}}"));
    format!(
        "<style>.grid{{stroke:#8884;fill:none}}.axis{{stroke:#888;fill:none}}text{{fill:#888}}\
         .line{{fill:none;stroke:#888;stroke-width:1.5}}{}</style>",
        groups.collect::<String>()
    )
}

fn legend(groups: &[String]) -> String {
    let entry = |(i, name): (usize, &String)| {
        let y = 40 + 18 * i;
        let class = i % COLOURS.len();
        format!(
            r#"<circle class="g{class}" cx="{}" cy="{y}" r="4"/><text x="{}" y="{}">{}</text>"#,
            WIDTH + 6.0,
            WIDTH + 18.0,
            y + 4,
            escape(name)
        )
    };
    groups.iter().enumerate().map(entry).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every point is drawn once with its hint escaped; what has no logarithm is not.
    #[test]
    fn points_are_drawn() {
        let points = vec![
            (1.0, 0.1, 0, "a<b".to_owned()),
            (10.0, 0.05, 1, "c".to_owned()),
            (0.0, 1.0, 0, "z".to_owned()),
        ];
        let groups = ["x".to_owned(), "y".to_owned()];
        let svg = scatter(&Scatter {
            title: "t",
            x_name: "bytes",
            y_name: "error",
            groups: &groups,
            points: &points,
            front: &[0, 1],
        });
        assert_eq!(svg.matches("class=\"dot").count(), 2);
        assert!(svg.contains("a&lt;b") && !svg.contains(">z<") && svg.starts_with("<svg xmlns"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }
}
