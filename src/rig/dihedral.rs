//! The parametrisation `dihedral` of a pose (RPO09 §5.1): how far the mesh folds at its edges, for
//! cloth and whatever else has no skeleton.
//!
//! Neighbouring folds say much the same, and a pose has fewer degrees of freedom than a mesh has
//! edges. So of all interior edges only those are parameters that say something new over the
//! training poses: each next one is the edge whose angle is least explained, linearly, by those
//! before it (Gram–Schmidt with pivoting).

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::parametrisation::{LEAST_DEVIATION, Source};
use super::{Column, Parametrisation, Points};

/// Edges that are parameters, at most.
const MOST_PARAMETERS: usize = 64;

/// Edges that are looked at, at most: of a finer mesh every second, third, …
const MOST_EDGES: usize = 1 << 13;

/// What may remain unexplained of all edges' variance.
const UNEXPLAINED: f64 = 1e-3;

/// The ends of an interior edge, then what its two triangles have beside it; indices of points.
pub(super) type Hinge = [u32; 4];

/// The edges that exactly two triangles share. Vertices at one place at rest are one, so that seams of
/// normals and texture coordinates are no borders.
#[must_use]
pub(super) fn hinges(rest: &[Vec3], triangles: &[[u32; 3]], points: &Points) -> Vec<Hinge> {
    let bits = |v: Vec3| v.to_array().map(|x| (x + 0.0).to_bits());
    let mut first: HashMap<[u32; 3], u32> = HashMap::with_capacity(rest.len());
    let places: Vec<u32> = rest
        .iter()
        .zip(&points.of_vertex)
        .map(|(&at, &point)| *first.entry(bits(at)).or_insert(point))
        .collect();
    // In the order of the triangles, so that the choice among equals does not depend on hashing.
    let mut sides: HashMap<[u32; 2], usize> = HashMap::with_capacity(3 * triangles.len() / 2);
    let mut edges: Vec<([u32; 2], Vec<u32>)> = Vec::new();
    for triangle in triangles {
        let at = triangle.map(|corner| places[corner as usize]);
        for [a, b, apex] in [[0, 1, 2], [1, 2, 0], [2, 0, 1]].map(|order| order.map(|i| at[i])) {
            if a == b || b == apex || apex == a {
                continue;
            }
            let edge = [a.min(b), a.max(b)];
            let at = *sides.entry(edge).or_insert_with(|| {
                edges.push((edge, Vec::new()));
                edges.len() - 1
            });
            edges[at].1.push(apex);
        }
    }
    let shared = edges.into_iter().filter_map(|([a, b], apexes)| match apexes[..] {
        [c, d] if c != d => Some([a, b, c, d]),
        _ => None,
    });
    let all: Vec<Hinge> = shared.collect();
    let step = all.len().div_ceil(MOST_EDGES).max(1);
    all.into_iter().step_by(step).collect()
}

/// How far two triangles (a, b, c) and (b, a, d) over the edge from a to b are from flat, radians in
/// (−π, π]; the sign tells the side to which they fold. 0 where a triangle has no area.
#[must_use]
pub(super) fn angle(positions: &[Vec3], [a, b, c, d]: Hinge) -> f64 {
    let at = |point: u32| positions[point as usize].as_dvec3();
    let (origin, edge) = (at(a), at(b) - at(a));
    let [c, d] = [c, d].map(|apex| at(apex) - origin);
    let (one, other): (DVec3, DVec3) = (edge.cross(c), d.cross(edge));
    let sine = one.cross(other).dot(edge) / edge.length().max(f64::MIN_POSITIVE);
    sine.atan2(one.dot(other))
}

/// The turn from one angle to another, in (−π, π].
pub(super) fn turn(from: f64, to: f64) -> f64 {
    let (sine, cosine) = (to - from).sin_cos();
    sine.atan2(cosine)
}

/// The mean direction of some angles.
fn mean(angles: impl Iterator<Item = f64>) -> f64 {
    let [sine, cosine] = angles.fold([0.0, 0.0], |[s, c], x| [s + x.sin(), c + x.cos()]);
    sine.atan2(cosine)
}

/// The interior edges of a mesh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hinges(Vec<Hinge>);

impl Hinges {
    /// The edges that exactly two triangles share; of a very fine mesh every second, third, …
    ///
    /// `rest` has a position per vertex.
    ///
    /// # Panics
    /// If a triangle or `points` are of another mesh.
    #[must_use]
    pub fn new(rest: &[Vec3], triangles: &[[u32; 3]], points: &Points) -> Self {
        Self(hinges(rest, triangles, points))
    }

    /// The angle at each, radians from flat, of positions by point.
    ///
    /// # Panics
    /// If there are fewer positions than points.
    #[must_use]
    pub fn angles(&self, positions: &[Vec3]) -> Vec<f64> {
        self.0.iter().map(|&hinge| angle(positions, hinge)).collect()
    }
}

impl Parametrisation {
    /// The folds that tell the training poses apart, each with the [`Hinges::angles`] of a pose:
    /// angles less their mean, radians, in the order of what they explain.
    #[must_use]
    pub fn dihedral(hinges: &Hinges, training: &[Vec<f64>], size_m: f32) -> Self {
        Self::of_hinges(&hinges.0, training, size_m)
    }

    fn of_hinges(hinges: &[Hinge], training: &[Vec<f64>], size_m: f32) -> Self {
        let poses = training.len();
        let means: Vec<f64> =
            (0..hinges.len()).map(|i| mean(training.iter().map(|row| row[i]))).collect();
        let mut rest: Vec<Vec<f64>> = (0..hinges.len())
            .map(|i| training.iter().map(|row| turn(means[i], row[i])).collect())
            .collect();
        let square = |column: &[f64]| column.iter().map(|x| x * x).sum::<f64>();
        // The mean direction is not the arithmetic mean; a constant is none of the variance.
        for column in &mut rest {
            let mean = column.iter().sum::<f64>() / poses.max(1) as f64;
            column.iter_mut().for_each(|x| *x -= mean);
        }
        let mut squares: Vec<f64> = rest.iter().map(|column| square(column)).collect();
        let enough = UNEXPLAINED * squares.iter().sum::<f64>();
        let least = poses as f64 * LEAST_DEVIATION * LEAST_DEVIATION;
        let mut chosen: Vec<usize> = Vec::new();
        while chosen.len() < MOST_PARAMETERS && squares.iter().sum::<f64>() > enough {
            let largest = (0..squares.len()).max_by(|&i, &j| squares[i].total_cmp(&squares[j]));
            let Some(next) = largest.filter(|&i| squares[i] > least) else { break };
            let length = squares[next].sqrt();
            let unit: Vec<f64> = rest[next].iter().map(|x| x / length).collect();
            for (column, left) in rest.iter_mut().zip(&mut squares) {
                let along: f64 = column.iter().zip(&unit).map(|(x, u)| x * u).sum();
                column.iter_mut().zip(&unit).for_each(|(x, u)| *x -= along * u);
                *left = square(column);
            }
            squares[next] = 0.0;
            chosen.push(next);
        }
        let column = |&i: &usize| {
            let corners = hinges[i];
            Column {
                source: Source::Dihedral { corners, mean: means[i] as f32 },
                name: format!("fold at {}-{}", corners[0], corners[1]),
            }
        };
        let columns = chosen.iter().map(column).collect();
        Self { columns, size_m, dropped: Vec::new() }
    }
}

#[cfg(test)]
#[path = "dihedral_tests.rs"]
mod tests;
