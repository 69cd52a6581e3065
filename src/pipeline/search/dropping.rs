//! Candidates that a search needs not look at to the end.

use super::Entry;
use crate::choose::{Point, Target, front};

/// After the first group, a candidate is dropped where its error is this many times that of a
/// candidate of no more bytes.
const HOPELESS: f64 = 1.25;

/// Of the second round, where error alone counts: a candidate is dropped where its error on the clips so far is
/// this many times that of the best.
const BEHIND: f64 = 1.03;

/// Keeps the candidates with a point that is close to the front of bytes and error.
pub(super) fn drop_hopeless(entries: &mut Vec<Entry<'_>>) {
    let place = |entry: &Entry<'_>, i: usize| {
        let squares = entry.squares.last().map_or(f64::NAN, |squares| squares[i]);
        (entry.points[i].bytes as f64, squares.max(0.0).sqrt())
    };
    let all = |entry: &Entry<'_>| -> Vec<(f64, f64)> {
        (0..entry.points.len()).map(|i| place(entry, i)).collect()
    };
    let places: Vec<(f64, f64)> = entries.iter().flat_map(&all).collect();
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
        let allowed = |point: &Point| target.max_bytes.is_none_or(|most| point.bytes <= most);
        let places = (0..entry.points.len()).filter(|&i| allowed(&entry.points[i]));
        let sum = |i: usize| entry.squares.iter().map(|fold| fold[i].max(0.0)).sum::<f64>();
        places.map(sum).fold(f64::INFINITY, f64::min)
    };
    let best = entries.iter().map(least).fold(f64::INFINITY, f64::min);
    if best.is_finite() {
        entries.retain(|entry| least(entry) <= BEHIND * BEHIND * best);
    }
}
