//! Poses that nearly repeat an earlier one of the same split.

use std::collections::BTreeMap;

use super::Split;

/// Marks the poses to keep: in order, each that differs from every kept pose of its split by more
/// than `threshold` in at least one parameter. `rows` is `[pose, parameter]` with `width`
/// parameters. A threshold of 0 keeps all.
pub(super) fn distinct(rows: &[f32], width: usize, splits: &[Split], threshold: f32) -> Vec<bool> {
    assert_eq!(rows.len(), width * splits.len(), "one row per pose");
    if threshold == 0.0 {
        return vec![true; splits.len()];
    }
    let row = |pose: usize| &rows[pose * width..(pose + 1) * width];
    // Poses in reach lie in the same or a neighbouring bucket of the widest parameter.
    let axis = widest(rows, width);
    let bucket = |value: f32| (f64::from(value) / f64::from(threshold)).floor() as i64;
    let bucket_of = |pose: usize| axis.map_or(0, |axis| bucket(row(pose)[axis]));
    let mut buckets: BTreeMap<(Split, i64), Vec<usize>> = BTreeMap::new();
    (0..splits.len())
        .map(|pose| {
            let (split, bucket) = (splits[pose], bucket_of(pose));
            let repeats = (-1..=1)
                .filter_map(|step| buckets.get(&(split, bucket.saturating_add(step))))
                .flatten()
                .any(|&kept| near(row(kept), row(pose), threshold));
            if !repeats {
                buckets.entry((split, bucket)).or_default().push(pose);
            }
            !repeats
        })
        .collect()
}

fn near(a: &[f32], b: &[f32], threshold: f32) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= threshold)
}

/// The parameter with the largest range.
fn widest(rows: &[f32], width: usize) -> Option<usize> {
    let range = |axis: usize| {
        let column = || rows.iter().skip(axis).step_by(width).copied();
        column().fold(f32::MIN, f32::max) - column().fold(f32::MAX, f32::min)
    };
    (0..width).max_by(|&a, &b| range(a).total_cmp(&range(b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::random::Stream;

    /// Proves the result against the plain quadratic definition on random poses in two splits.
    #[test]
    fn agrees_with_the_definition() {
        let (width, count, threshold) = (3, 400, 0.05);
        let mut random = Stream::new(1);
        let rows: Vec<f32> = (0..width * count)
            .map(|i| random.uniform() as f32 * if i % width == 1 { 2.0 } else { 0.15 } - 0.07)
            .collect();
        let splits: Vec<Split> =
            (0..count).map(|i| if i % 3 == 0 { Split::Novel } else { Split::Training }).collect();
        let found = distinct(&rows, width, &splits, threshold);
        let mut kept: Vec<usize> = Vec::new();
        for pose in 0..count {
            let repeats = kept.iter().any(|&other| {
                let distance = (0..width)
                    .map(|k| (rows[pose * width + k] - rows[other * width + k]).abs())
                    .fold(0.0, f32::max);
                splits[pose] == splits[other] && distance <= threshold
            });
            assert_eq!(found[pose], !repeats, "pose {pose}");
            if !repeats {
                kept.push(pose);
            }
        }
        assert!(kept.len() < count * 9 / 10, "the test has repeats: {} kept", kept.len());
    }

    /// Proves the edge cases: no parameters make every pose a repeat, a threshold of 0 none.
    #[test]
    fn no_parameters_and_no_threshold() {
        let splits = [Split::Training; 3];
        assert_eq!(distinct(&[], 0, &splits, 0.1), [true, false, false]);
        assert_eq!(distinct(&[1.0; 3], 1, &splits, 0.0), [true; 3]);
        assert_eq!(distinct(&[1e30, -1e30, 1e30], 1, &splits, 1e-9), [true, true, false]);
    }
}
