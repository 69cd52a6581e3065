//! Candidates that a search needs not look at to the end.

use super::Entry;
use crate::choose::{Target, front};

/// After the first group, a candidate is dropped where its error is this many times that of a
/// candidate of no more bytes.
const HOPELESS: f64 = 1.25;

/// Of the second round, where error alone counts: a candidate is dropped where its error on the first group of
/// clips is so many times that of the best, and on the first two together, which say more.
const BEHIND: [f64; 2] = [1.2, 1.05];

/// Keeps the candidates with a point that is close to the front of bytes and error of those whose times the
/// target allows, as far as these can be told.
pub(super) fn drop_hopeless(entries: &mut Vec<Entry<'_>>, target: &Target) {
    let place = |entry: &Entry<'_>, i: usize| {
        let squares = entry.squares.last().map_or(f64::NAN, |squares| squares[i]);
        (entry.points[i].bytes as f64, squares.max(0.0).sqrt())
    };
    let all = |entry: &Entry<'_>| -> Vec<(f64, f64)> {
        (0..entry.points.len()).map(|i| place(entry, i)).collect()
    };
    let quick = |(entry, i): &(&Entry<'_>, usize)| target.affords_times(&entry.points[*i]);
    let points = |entry| std::iter::repeat(entry).zip(0..);
    let each = entries.iter().flat_map(|entry: &Entry<'_>| points(entry).take(entry.points.len()));
    let places: Vec<(f64, f64)> = each.filter(quick).map(|(entry, i)| place(entry, i)).collect();
    if places.is_empty() {
        return;
    }
    let best: Vec<(f64, f64)> = front(&places).into_iter().map(|i| places[i]).collect();
    let near = |&(bytes, error): &(f64, f64)| {
        let rivals = best.iter().filter(|(rival, _)| *rival <= bytes).map(|(_, error)| *error);
        error <= HOPELESS * rivals.fold(f64::INFINITY, f64::min)
    };
    entries.retain(|entry| all(entry).iter().any(near));
}

/// Keeps the candidates that may still have the least error of those that a target allows, where that is all it
/// asks for.
pub(super) fn drop_behind(entries: &mut Vec<Entry<'_>>, target: &Target) {
    if target.max_error.is_some() {
        return;
    }
    let least = |entry: &Entry<'_>| {
        let places = (0..entry.points.len()).filter(|&i| target.affords(&entry.points[i]));
        let sum = |i: usize| entry.squares.iter().map(|fold| fold[i].max(0.0)).sum::<f64>();
        places.map(sum).fold(f64::INFINITY, f64::min)
    };
    let best = entries.iter().map(least).fold(f64::INFINITY, f64::min);
    let groups = entries.first().map_or(0, |entry| entry.squares.len());
    let behind = BEHIND[groups.clamp(1, BEHIND.len()) - 1];
    if best.is_finite() {
        entries.retain(|entry| least(entry) <= behind * behind * best);
    }
}
