//! The Pareto front.

/// Indices of the points that no other beats in one number without losing in another: none has
/// less or equal of both and less of one. In the order of the first number; of equal points the
/// first counts. What is not a number is never on the front.
#[must_use]
pub fn front(points: &[(f64, f64)]) -> Vec<usize> {
    let finite = |&i: &usize| points[i].0.is_finite() && points[i].1.is_finite();
    let mut order: Vec<usize> = (0..points.len()).filter(finite).collect();
    order.sort_by(|&a, &b| {
        let (a_point, b_point) = (points[a], points[b]);
        a_point.0.total_cmp(&b_point.0).then(a_point.1.total_cmp(&b_point.1)).then(a.cmp(&b))
    });
    let mut least = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < least;
        least = least.min(points[i].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::random::Stream;

    /// By its definition, on random points with ties: no point of the front is dominated, and
    /// every other point is, or equals an earlier one.
    #[test]
    fn the_front_is_what_it_says() {
        let mut stream = Stream::new(5);
        let mut draw = || (stream.uniform() * 8.0).floor();
        let points: Vec<(f64, f64)> = (0..60).map(|_| (draw(), draw())).collect();
        let dominates = |a: (f64, f64), b: (f64, f64)| a.0 <= b.0 && a.1 <= b.1 && a != b;
        let front = front(&points);
        for (i, &point) in points.iter().enumerate() {
            let beaten = points.iter().any(|&other| dominates(other, point));
            let repeated = points[..i].contains(&point);
            assert_eq!(front.contains(&i), !beaten && !repeated, "{i}: {point:?}");
        }
    }

    /// What is not a number has no place.
    #[test]
    fn numbers_only() {
        assert_eq!(front(&[(f64::NAN, 0.0), (1.0, f64::INFINITY), (2.0, 3.0)]), [2]);
        assert_eq!(front(&[]), [0; 0]);
    }
}
