//! The borders of a surface: where the triangles around a point do not close.
//!
//! Another surface may begin exactly there, as a wall on the edge of a floor. A ray from the point
//! itself starts in the plane of that surface, which then blocks or does not by rounding. So the
//! origins of border points lie a little inwards, where the point's own surface is.

use std::collections::HashMap;

use glam::Vec3;

use super::surroundings::NO_POINT;
use crate::rig::Points;

/// The miter of a corner sharper than this many times its offset is cut off.
const LONGEST_MITER: f32 = 4.0;

/// Edges with a triangle on one side only, by points: vertices of their ends and of the corner beside
/// them, counter-clockwise.
#[derive(Debug, Clone, Default)]
pub(super) struct Borders(Vec<[u32; 3]>);

impl Borders {
    pub(super) fn of(triangles: &[[u32; 3]], points: &Points) -> Self {
        let mut sides: HashMap<[u32; 2], u32> = HashMap::with_capacity(3 * triangles.len() / 2);
        let key = |a: u32, b: u32| {
            let [p, q] = [a, b].map(|vertex| points.of_vertex[vertex as usize]);
            (p != q && p != NO_POINT && q != NO_POINT).then_some([p.min(q), p.max(q)])
        };
        for edge in triangles.iter().flat_map(|&triangle| edges(triangle)) {
            if let Some(key) = key(edge[0], edge[1]) {
                *sides.entry(key).or_default() += 1;
            }
        }
        let all = triangles.iter().flat_map(|&triangle| edges(triangle));
        let single = |edge: &[u32; 3]| key(edge[0], edge[1]).is_some_and(|key| sides[&key] == 1);
        Self(all.filter(single).collect())
    }

    /// Point → how far inwards to go from it to be at distance 1 from its border; zero within the
    /// surface, and where the borders leave no inside.
    pub(super) fn inwards(&self, points: &Points, positions: &[Vec3]) -> Vec<Vec3> {
        let mut sums = vec![(Vec3::ZERO, 0_u32); points.vertex.len()];
        for &[a, b, c] in &self.0 {
            let [from, to, apex] = [a, b, c].map(|vertex| positions[vertex as usize]);
            let along = (to - from).normalize_or_zero();
            let inwards = (apex - from).reject_from_normalized(along).normalize_or_zero();
            for end in [a, b] {
                let (sum, count) = &mut sums[points.of_vertex[end as usize] as usize];
                *sum += inwards;
                *count += 1;
            }
        }
        let miter = |(sum, count): (Vec3, u32)| match count {
            0 => Vec3::ZERO,
            // Of two unit normals k the miter is (k₁ + k₂) / (1 + k₁·k₂).
            2 => sum / (sum.length_squared() / 2.0).max(2.0 / LONGEST_MITER / LONGEST_MITER),
            _ => sum.normalize_or_zero(),
        };
        sums.into_iter().map(miter).collect()
    }
}

fn edges([a, b, c]: [u32; 3]) -> [[u32; 3]; 3] {
    [[a, b, c], [b, c, a], [c, a, b]]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of two triangles goes inwards at its four corners, to distance 1 from both sides; a point
    /// in the middle of a fan nowhere.
    #[test]
    fn corners_are_mitred() {
        let positions = [(0., 0.), (4., 0.), (4., 4.), (0., 4.), (2., 2.)];
        let positions = positions.map(|(x, z)| Vec3::new(x, 0.0, z));
        let triangles = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        let points = Points { vertex: (0..5).collect(), of_vertex: (0..5).collect() };
        let inwards = Borders::of(&triangles, &points).inwards(&points, &positions);
        let expected = [(1., 1.), (-1., 1.), (-1., -1.), (1., -1.), (0., 0.)];
        for (found, (x, z)) in inwards.iter().zip(expected) {
            assert!(found.distance(Vec3::new(x, 0.0, z)) < 1e-6, "{inwards:?}");
        }
        // Halves that meet in points are whole again; apart each has its own border.
        let whole = Points { vertex: vec![0, 1, 2], of_vertex: vec![0, 1, 2, 1, 0, 2] };
        assert!(Borders::of(&[[0, 1, 2], [3, 4, 5]], &whole).0.is_empty());
        let apart = Points { vertex: (0..6).collect(), of_vertex: (0..6).collect() };
        assert_eq!(Borders::of(&[[0, 1, 2], [3, 4, 5]], &apart).0.len(), 6);
    }

    /// Slivers, triangles without area and points of nobody give finite numbers.
    #[test]
    fn degenerate_borders_are_finite() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::X * 0.5, Vec3::new(0.5, 1e-30, 0.0), Vec3::Y];
        let points = Points { vertex: (0..4).collect(), of_vertex: vec![0, 1, 2, 3, NO_POINT] };
        let triangles = [[0, 1, 2], [0, 1, 3], [1, 1, 0], [0, 1, 4]];
        let inwards = Borders::of(&triangles, &points).inwards(&points, &positions);
        assert!(inwards.iter().all(|v| v.is_finite() && v.length() <= LONGEST_MITER));
    }
}
