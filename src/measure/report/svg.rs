//! The little of a plot that every chart of the page shares: axes, grid, lines, labels. Colours
//! are left to classes of the style sheet, so charts follow light, dark and print.

use std::fmt::Write as _;

use super::text::{escape, number, superscript};

/// A range of data and how it is spread.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    low: f64,
    high: f64,
    log: bool,
}

impl Axis {
    /// Equal steps. A range of nothing is widened.
    pub(super) fn linear(low: f64, high: f64) -> Self {
        let high = if high > low { high } else { low + 1.0 };
        Self { low, high, log: false }
    }

    /// Equal ratios; both ends positive.
    pub(super) fn log(low: f64, high: f64) -> Self {
        let low = low.max(1e-300);
        let high = if high > low { high } else { low * 10.0 };
        Self { low, high, log: true }
    }

    /// From zero to a round number at or above `high`.
    pub(super) fn from_zero(high: f64) -> Self {
        let axis = Self::linear(0.0, if high > 0.0 { high } else { 1.0 });
        let step = axis.step(6);
        Self { high: (axis.high / step).ceil() * step, ..axis }
    }

    /// 0 at the low end, 1 at the high end, clamped.
    fn place(self, x: f64) -> f64 {
        let place = if self.log {
            (x.max(1e-300) / self.low).ln() / (self.high / self.low).ln()
        } else {
            (x - self.low) / (self.high - self.low)
        };
        place.clamp(0.0, 1.0)
    }

    /// A round step (1, 2 or 5 times a power of ten) that makes about `count` of the range.
    fn step(self, count: usize) -> f64 {
        let raw = (self.high - self.low) / count as f64;
        let power = 10f64.powf(raw.log10().floor());
        let best = [1.0, 2.0, 5.0].into_iter().find(|m| m * power >= raw * 0.999);
        best.unwrap_or(10.0) * power
    }

    /// Round places and their labels.
    pub(super) fn ticks(self, count: usize) -> Vec<(f64, String)> {
        // Within less than a decade equal steps are as good as equal ratios.
        if self.log && self.high / self.low > 8.0 {
            return self.log_ticks();
        }
        let step = self.step(count);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let first = (self.low / step - 1e-9).ceil() as i64;
        let last = (self.high / step + 1e-9).floor() as i64;
        (first..=last)
            .map(|i| {
                let x = i as f64 * step;
                let label = format!("{x:.decimals$}").replacen('-', "−", 1);
                (x, if i == 0 { "0".to_owned() } else { label })
            })
            .collect()
    }

    fn log_ticks(self) -> Vec<(f64, String)> {
        let decades =
            (self.low.log10() - 1e-9).ceil() as i32..=(self.high.log10() + 1e-9).floor() as i32;
        let count = decades.clone().count();
        if count <= 2 {
            let (first, last) = (*decades.start() - 1, *decades.end() + 1);
            let all = (first..=last).flat_map(|d| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(d)));
            let inside = |x: &f64| (self.low * 0.999..self.high * 1.001).contains(x);
            return all.filter(inside).map(|x| (x, number(x, 1))).collect();
        }
        let skip = (count / 7 + 1) as i32;
        let label = |d: i32| match d {
            -3..5 => number(10f64.powi(d), 1),
            _ => format!("10{}", superscript(d)),
        };
        let whole = decades.filter(|d| d.rem_euclid(skip) == 0);
        whole.map(|d| (10f64.powi(d), label(d))).collect()
    }
}

/// A plot under way.
#[derive(Debug)]
pub(super) struct Plot {
    id: &'static str,
    width: f64,
    height: f64,
    x: Axis,
    y: Axis,
    body: String,
}

const LEFT: f64 = 52.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 26.0;
const BOTTOM: f64 = 42.0;

impl Plot {
    /// A plot whose grid and labels are drawn first. `id` is unique on the page.
    pub(super) fn new(id: &'static str, size: (f64, f64), axes: (Axis, Axis)) -> Self {
        let ((width, height), (x, y)) = (size, axes);
        Self { id, width, height, x, y, body: String::new() }
    }

    pub(super) fn px(&self, x: f64) -> f64 {
        LEFT + self.x.place(x) * (self.width - LEFT - RIGHT)
    }

    pub(super) fn py(&self, y: f64) -> f64 {
        self.height - BOTTOM - self.y.place(y) * (self.height - TOP - BOTTOM)
    }

    /// Grid, tick labels and the axes' names; the y axis's name stands above the axis.
    pub(super) fn grid(&mut self, x_name: &str, y_name: &str) {
        let (right, bottom) = (self.width - RIGHT, self.height - BOTTOM);
        for (y, label) in self.y.ticks(4) {
            let at = self.py(y);
            let _ = write!(
                self.body,
                r#"<path class="grid" d="M{LEFT} {at:.1}H{right}"/><text class="tick" x="{:.1}" y="{:.1}" text-anchor="end">{label}</text>"#,
                LEFT - 8.0,
                at + 4.0,
            );
        }
        for (x, label) in self.x.ticks(6) {
            let at = self.px(x);
            let _ = write!(
                self.body,
                r#"<path class="axis" d="M{at:.1} {bottom}v5"/><text class="tick" x="{at:.1}" y="{:.1}" text-anchor="middle">{label}</text>"#,
                bottom + 18.0,
            );
        }
        let _ = write!(
            self.body,
            r#"<path class="axis" d="M{LEFT} {bottom}H{right}"/><text class="name" x="{right}" y="{:.1}" text-anchor="end">{}</text><text class="name" x="4" y="13">{}</text>"#,
            self.height - 6.0,
            escape(x_name),
            escape(y_name),
        );
    }

    /// A line through points.
    pub(super) fn line(&mut self, class: &str, points: impl IntoIterator<Item = (f64, f64)>) {
        let path = self.path(points);
        let _ = write!(self.body, r#"<path class="line {class}" d="{path}"/>"#);
    }

    /// The area between points and the bottom of the plot.
    pub(super) fn area(&mut self, class: &str, points: &[(f64, f64)]) {
        let (Some(first), Some(last)) = (points.first(), points.last()) else { return };
        let bottom = self.height - BOTTOM;
        let path = self.path(points.iter().copied());
        let (from, to) = (self.px(first.0), self.px(last.0));
        let _ = write!(
            self.body,
            r#"<path class="area {class}" d="{path}L{to:.1} {bottom}L{from:.1} {bottom}Z"/>"#
        );
    }

    fn path(&self, points: impl IntoIterator<Item = (f64, f64)>) -> String {
        let mut path = String::new();
        for (i, (x, y)) in points.into_iter().enumerate() {
            let command = if i == 0 { 'M' } else { 'L' };
            let _ = write!(path, "{command}{:.1} {:.1}", self.px(x), self.py(y));
        }
        path
    }

    /// A dot with a label that a pointer shows.
    pub(super) fn dot(&mut self, class: &str, at: (f64, f64), hint: &str) {
        let _ = write!(
            self.body,
            r#"<circle class="dot {class}" cx="{:.1}" cy="{:.1}" r="4"><title>{}</title></circle>"#,
            self.px(at.0),
            self.py(at.1),
            escape(hint),
        );
    }

    /// A vertical rule over the plot's height, with a label at its top.
    pub(super) fn rule(&mut self, x: f64, label: &str, anchor: &str) {
        let at = self.px(x);
        let shift = match anchor {
            "start" => 5.0,
            "end" => -5.0,
            _ => 0.0,
        };
        let _ = write!(
            self.body,
            r#"<path class="rule" d="M{at:.1} {TOP}V{:.1}"/><text class="label" x="{:.1}" y="{:.1}" text-anchor="{anchor}">{}</text>"#,
            self.height - BOTTOM,
            at + shift,
            TOP + 10.0,
            escape(label),
        );
    }

    /// Text at a place of the data, moved by some pixels.
    pub(super) fn label(
        &mut self,
        class: &str,
        at: (f64, f64),
        by: (f64, f64),
        anchored: (&str, &str),
    ) {
        let (anchor, text) = anchored;
        let _ = write!(
            self.body,
            r#"<text class="label {class}" x="{:.1}" y="{:.1}" text-anchor="{anchor}">{}</text>"#,
            self.px(at.0) + by.0,
            self.py(at.1) + by.1,
            escape(text),
        );
    }

    /// The whole picture; title and description are read to those who cannot see it.
    pub(super) fn finish(self, title: &str, description: &str) -> String {
        picture(self.id, (self.width, self.height), (title, description), &self.body)
    }
}

/// An inline SVG element with its accessible names.
pub(super) fn picture(id: &str, size: (f64, f64), names: (&str, &str), body: &str) -> String {
    let ((width, height), (title, description)) = (size, names);
    format!(
        r#"<svg viewBox="0 0 {width} {height}" role="img" aria-labelledby="{id}-t {id}-d"><title id="{id}-t">{}</title><desc id="{id}-d">{}</desc>{body}</svg>"#,
        escape(title),
        escape(description),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks are round, inside the range, and their labels have the decimals that they need.
    #[test]
    fn ticks_are_round() {
        let labels =
            |axis: Axis, n| axis.ticks(n).into_iter().map(|t| t.1).collect::<Vec<_>>().join(" ");
        assert_eq!(labels(Axis::from_zero(0.0231), 4), "0 0.01 0.02");
        assert_eq!(
            labels(Axis::linear(-0.2, 0.2), 4),
            "−0.1 0 0.1".replace("−0.1", "−0.2 −0.1") + " 0.2"
        );
        assert_eq!(labels(Axis::linear(0.0, 3.3), 6), "0 1 2 3");
        assert_eq!(labels(Axis::log(1.0, 1000.0), 6), "1 10 100 1000");
        assert_eq!(labels(Axis::log(0.4, 26.0), 6), "0.5 1 2 5 10 20");
        assert_eq!(labels(Axis::log(200.0, 900.0), 6), "200 400 600 800");
        assert_eq!(labels(Axis::log(1e-8, 1.0), 6), "10⁻⁸ 10⁻⁶ 10⁻⁴ 0.01 1");
        assert!(!Axis::linear(5.0, 5.0).ticks(4).is_empty(), "a range of nothing still has ticks");
    }
}
