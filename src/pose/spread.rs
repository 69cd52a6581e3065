//! The poses that are farthest apart, one after another.

/// The first `most` rows of the greedy order (Gonzalez 1985): first the row nearest to the mean of
/// all, then each time the one farthest from all that were taken, ties to the earlier. So a larger
/// `most` takes the same rows and more. No row is farther from what was taken than twice the least
/// distance that so many rows can reach. `rows` is `[pose, parameter]`; the answer is ascending.
///
/// The work is poses × `most` × parameters.
pub(super) fn spread(rows: &[f32], width: usize, most: usize) -> Vec<usize> {
    // Poses without parameters are all alike.
    let count = rows.len().checked_div(width).unwrap_or(usize::from(most > 0));
    if count <= most {
        return (0..count).collect();
    }
    let mut nearest = vec![f64::INFINITY; count];
    let mut taken = Vec::with_capacity(most);
    let mut next = central(rows, width);
    while taken.len() < most {
        taken.push(next);
        let new = &rows[next * width..(next + 1) * width];
        let all = nearest.iter_mut().zip(rows.chunks_exact(width));
        all.for_each(|(nearest, row)| *nearest = nearest.min(square(row, new)));
        // What was taken has distance 0 from itself, and equal rows never come before others.
        nearest[next] = -1.0;
        next = farthest(&nearest);
    }
    taken.sort_unstable();
    taken
}

/// The row nearest to the mean of all.
fn central(rows: &[f32], width: usize) -> usize {
    let count = (rows.len() / width) as f64;
    let mean: Vec<f32> = (0..width)
        .map(|k| {
            let sum: f64 = rows.iter().skip(k).step_by(width).map(|&x| f64::from(x)).sum();
            (sum / count) as f32
        })
        .collect();
    let away: Vec<f64> = rows.chunks_exact(width).map(|row| -square(row, &mean)).collect();
    farthest(&away)
}

pub(super) fn square(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

/// Index of the largest; of equal ones the first.
pub(super) fn farthest(distances: &[f64]) -> usize {
    let mut best = 0;
    for (i, distance) in distances.iter().enumerate() {
        if *distance > distances[best] {
            best = i;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::random::Stream;

    /// Proves on random rows that every choice contains the smaller ones, covers better than every
    /// n-th row, and leaves no row farther away than the rows that it takes are from one another,
    /// from which the bound follows: of one row more than were taken, two would share a centre.
    #[test]
    fn the_order_is_nested_and_covers() {
        let (width, count) = (3, 120);
        let mut random = Stream::new(3);
        let rows: Vec<f32> = (0..width * count).map(|_| random.uniform() as f32).collect();
        let row = |i: usize| &rows[i * width..(i + 1) * width];
        let radius = |taken: &[usize]| {
            let near = |i| taken.iter().map(|&j| square(row(i), row(j))).fold(f64::MAX, f64::min);
            (0..count).map(near).fold(0.0, f64::max).sqrt()
        };
        let few = spread(&rows, width, 10);
        let more = spread(&rows, width, 30);
        assert!(few.iter().all(|i| more.contains(i)) && (few.len(), more.len()) == (10, 30));
        let evenly: Vec<usize> = (0..count).step_by(count / 10).collect();
        assert!(radius(&few) < radius(&evenly) && radius(&more) < radius(&few));
        let eleven = spread(&rows, width, 11);
        let apart = |i: usize, j: usize| square(row(i), row(j)).sqrt();
        let pairs = eleven.iter().flat_map(|&i| eleven.iter().map(move |&j| (i, j)));
        let least =
            pairs.filter(|(i, j)| i != j).map(|(i, j)| apart(i, j)).fold(f64::MAX, f64::min);
        assert!(radius(&few) <= least + 1e-9, "{} {least}", radius(&few));
    }

    /// Few rows are all taken; equal rows come last; rows without parameters are one.
    #[test]
    fn edges() {
        assert_eq!(spread(&[1.0, 2.0], 1, 5), [0, 1]);
        assert_eq!(spread(&[1.0, 1.0, 1.0, 9.0], 1, 2), [0, 3]);
        assert_eq!(spread(&[1.0, 1.0, 1.0], 1, 2).len(), 2);
        assert_eq!(spread(&[], 0, 3), [0]);
    }
}
