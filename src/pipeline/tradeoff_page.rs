//! A trade-off for people: as a table, and as a page with its pictures.

use std::fmt::Write as _;

use super::effort::Effort;
use super::tradeoff::Tradeoff;
use crate::choose::{Point, SplitError};

impl Tradeoff {
    /// Every point in a line of its own, those of the front marked.
    #[must_use]
    pub fn table(&self) -> String {
        table(self)
    }

    /// One file with the pictures and the table, readable without a network; below them what a bake's
    /// effort buys, where that was tried.
    #[must_use]
    pub fn page(&self, effort: Option<&Effort>) -> String {
        page(self, &table(self), effort)
    }
}

/// What [`told`] tells.
pub(super) const ERRORS: &str = "RMSE of a coefficient (ao error, flicker of a coefficient)";

/// The errors of a split, 28 letters: RMSE, mean absolute error of ambient occlusion, RMS change of the
/// error from frame to frame where there are such.
pub(super) fn told(error: &SplitError) -> String {
    let flicker = error.flicker_rms.map_or_else(|| "–".to_owned(), |rms| format!("{rms:.4}"));
    format!("{:>11.5} ({:.4}, {flicker:>6})", error.rms, error.ao_mae)
}

fn kilobytes(count: u64) -> String {
    format!("{:.1} kB", count as f64 / 1e3)
}

/// Every point, those of the front marked.
fn table(tradeoff: &Tradeoff) -> String {
    let mut text = format!(
        "{}: {} points; * is on the front of bytes and {} error; reference noise {:.5}\n  {:<44} {:>10} {:>8} {:>9} {:>8}   {ERRORS}",
        tradeoff.scene,
        tradeoff.points.len(),
        tradeoff.split,
        tradeoff.reference_noise_rms,
        "model",
        "bytes",
        "% mesh",
        "µs/frame",
        "fit s",
    );
    for split in splits(tradeoff) {
        let _ = write!(text, "  {split:>28}");
    }
    for point in &tradeoff.points {
        let _ = write!(text, "\n{}", row(tradeoff, point));
    }
    for (name, reason) in &tradeoff.skipped {
        let _ = write!(text, "\n  left out: {name}: {reason}");
    }
    text
}

fn splits(tradeoff: &Tradeoff) -> Vec<&String> {
    tradeoff.points.first().map(|point| point.errors.keys().collect()).unwrap_or_default()
}

fn row(tradeoff: &Tradeoff, point: &Point) -> String {
    let mark = if tradeoff.front.contains(&point.name) { '*' } else { ' ' };
    let mut text = format!(
        "{mark} {:<44} {:>10} {:>8.1} {:>9.0} {:>8.2}",
        point.name,
        kilobytes(point.bytes),
        point.mesh_percent,
        point.evaluate_us,
        point.fit_s,
    );
    for split in splits(tradeoff) {
        let error = point.errors.get(split).copied().unwrap_or_default();
        let _ = write!(text, "  {}", told(&error));
    }
    text
}

/// One file with the pictures and the table.
fn page(tradeoff: &Tradeoff, table: &str, effort: Option<&Effort>) -> String {
    let escape = |text: &str| text.replace('&', "&amp;").replace('<', "&lt;");
    let plots: String = tradeoff.plots().into_iter().map(|(_, svg)| svg).collect();
    let efforts = effort.map_or(String::new(), |effort| {
        let table = escape(&effort.table());
        format!("<h2>Rays, poses and order</h2>{}<pre>{table}</pre>", effort.plot())
    });
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Trade-off of {0}</title>\
         <style>:root{{color-scheme:light dark}}body{{font-family:sans-serif;max-width:1100px;\
         margin:2em auto;padding:0 1em}}pre{{overflow-x:auto}}svg{{width:100%}}</style>\
         <h1>Trade-off of {0}</h1>{plots}<pre>{1}</pre>{efforts}</html>",
        escape(&tradeoff.scene),
        escape(table),
    )
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// Each split has its three errors in the table and on the page, and columns stay in line where frames do not
    /// follow one another, so that there is no flicker.
    #[test]
    fn flicker_is_told_where_there_is_any() {
        let error = SplitError { rms: 0.25, ao_mae: 0.125, ..SplitError::default() };
        let moving = SplitError { flicker_rms: Some(0.0625), ..error };
        let point = |name: &str, error| Point {
            name: name.to_owned(),
            errors: [("novel".to_owned(), error)].into(),
            ..Point::default()
        };
        let tradeoff = Tradeoff {
            scene: "a.glb".into(),
            bake: String::new(),
            split: "novel".into(),
            reference_noise_rms: 0.0,
            points: vec![point("mean", error), point("linear", moving)],
            front: Vec::new(),
            skipped: BTreeMap::new(),
        };
        let table = tradeoff.table();
        assert!(table.contains("0.25000 (0.1250,      –)"), "{table}");
        assert!(table.contains("0.25000 (0.1250, 0.0625)"), "{table}");
        let widths: Vec<usize> = table.lines().skip(2).map(|line| line.chars().count()).collect();
        assert!(widths.len() == 2 && widths[0] == widths[1], "{table}");
        assert!(table.contains("flicker") && tradeoff.page(None).contains("0.0625"));
    }
}
