//! Candidates that a search needs not look at to the end.

use super::Entry;
use crate::choose::{Target, front};

/// A candidate is dropped where its error on what was left out so far is this many times that of a candidate
/// which is as good in all else.
const HOPELESS: f64 = 1.25;

/// Keeps the candidates that may still be the choice, after some of so many groups of what is left out: with a
/// point that is close to the front of bytes and error of those whose times the target allows, as far as these
/// can be told; with one whose error may still be met, or is close to the least of those that it allows.
pub(super) fn drop_hopeless(entries: &mut Vec<Entry<'_>>, target: &Target, groups: usize) {
    drop_beaten(entries, target);
    let least = entries.iter().map(|entry| least(entry, target)).fold(f64::INFINITY, f64::min);
    if !least.is_finite() {
        return;
    }
    let most = target.max_error.map_or(0.0, |most| most * most * groups as f64);
    entries.retain(|entry| self::least(entry, target) <= most.max(HOPELESS * HOPELESS * least));
}

/// The least sum of mean square errors so far of the points that the target allows.
fn least(entry: &Entry<'_>, target: &Target) -> f64 {
    let target = target.roughly();
    let places = (0..entry.points.len()).filter(|&i| target.affords(&entry.points[i]));
    places.map(|i| sum(entry, i)).fold(f64::INFINITY, f64::min)
}

/// Mean square errors of a point so far.
fn sum(entry: &Entry<'_>, point: usize) -> f64 {
    entry.squares.iter().map(|squares| squares[point].max(0.0)).sum()
}

/// Keeps what is close to the front.
fn drop_beaten(entries: &mut Vec<Entry<'_>>, target: &Target) {
    let place = |entry: &Entry<'_>, i: usize| (entry.points[i].bytes as f64, sum(entry, i).sqrt());
    let quick = |entry: &Entry<'_>, i: usize| target.affords_times(&entry.points[i]);
    let mut places = Vec::new();
    for entry in entries.iter() {
        let of_entry = (0..entry.points.len()).filter(|&i| quick(entry, i));
        places.extend(of_entry.map(|i| place(entry, i)));
    }
    if places.is_empty() {
        return;
    }
    let best: Vec<(f64, f64)> = front(&places).into_iter().map(|i| places[i]).collect();
    let near = |&(bytes, error): &(f64, f64)| {
        let rivals = best.iter().filter(|(rival, _)| *rival <= bytes).map(|(_, error)| *error);
        error <= HOPELESS * rivals.fold(f64::INFINITY, f64::min)
    };
    entries.retain(|entry| (0..entry.points.len()).any(|i| near(&place(entry, i))));
}
