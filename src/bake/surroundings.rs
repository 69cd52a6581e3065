//! What blocks beside the mesh itself, and what of the mesh does not.

use std::ops::Range;
use std::sync::Arc;

use super::Error;
use crate::rig::Points;

/// In [`Points::of_vertex`]: the vertex is no point. Its triangles block, and nothing is baked
/// there.
pub const NO_POINT: u32 = u32::MAX;

/// What stands around the points. The default is nothing, and costs nothing.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surroundings {
    /// Metres along +Y: everything at or below is solid. A ray is blocked where any place of it
    /// between the nearest and the furthest distance that count is in there. The ground lies
    /// through the vertices themselves, not the ray's offset origin: what stands on it sees
    /// nothing below and everything above.
    pub ground_m: Option<f32>,
    /// Metres below which nothing blocks.
    pub min_distance_m: f32,
    /// For ambient occlusion with a maximum distance D: what is hit at the distance d takes away
    /// (1 − d/D)^falloff of its direction instead of all of it. `None`: all of it.
    pub falloff: Option<f32>,
    /// Facets are meant as they are: between vertices rays start on them. Else they start on the smooth
    /// surface that the vertices' normals mean. At vertices the two are one.
    pub faceted: bool,
    /// Points that do not see everything. A point may be in one view; others see everything.
    pub views: Vec<View>,
}

/// Points and the triangles that do not block for them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct View {
    /// Which points.
    pub points: Vec<u32>,
    /// Ranges of triangles that they do not see.
    pub hidden: Vec<Range<usize>>,
}

/// The triangles of each tree, and which tree each point looks at.
#[derive(Debug, Clone)]
pub(super) struct Trees {
    /// Never empty.
    pub(super) triangles: Vec<Vec<[u32; 3]>>,
    /// For each tree but the first, the mesh's number of each triangle.
    numbers: Vec<Vec<u32>>,
    /// Point → tree; empty where there is only one.
    pub(super) of_point: Arc<[u8]>,
}

impl Trees {
    /// One tree for everything.
    pub(super) fn one(triangles: &[[u32; 3]]) -> Self {
        let numbers = Vec::new();
        Self { triangles: vec![triangles.to_vec()], numbers, of_point: Arc::new([]) }
    }

    /// A tree for every view, after the one that holds everything.
    pub(super) fn new(
        triangles: &[[u32; 3]],
        points: &Points,
        views: &[View],
    ) -> Result<Self, Error> {
        if views.is_empty() {
            return Ok(Self::one(triangles));
        }
        if views.len() > usize::from(u8::MAX) {
            return Err(Error::Views { found: views.len() });
        }
        let mut of_point = vec![0; points.vertex.len()];
        let (mut trees, mut numbers) = (vec![triangles.to_vec()], Vec::new());
        for (index, view) in views.iter().enumerate() {
            for &point in &view.points {
                let limit = of_point.len();
                let Some(tree) = of_point.get_mut(point as usize) else {
                    let map = "point of view";
                    return Err(Error::Points { map, key: index, value: point, limit });
                };
                *tree = index as u8 + 1;
            }
            let hidden = |index: usize| view.hidden.iter().any(|range| range.contains(&index));
            let seen: Vec<u32> =
                (0..triangles.len()).filter(|&i| !hidden(i)).map(|i| i as u32).collect();
            trees.push(seen.iter().map(|&i| triangles[i as usize]).collect());
            numbers.push(seen);
        }
        Ok(Self { triangles: trees, numbers, of_point: of_point.into() })
    }

    /// The mesh's number of a tree's triangle.
    pub(super) fn original(&self, tree: usize, triangle: u32) -> u32 {
        match tree.checked_sub(1) {
            Some(view) => self.numbers[view][triangle as usize],
            None => triangle,
        }
    }

    /// Of all trees together.
    pub(super) fn count(&self) -> usize {
        self.triangles.iter().map(Vec::len).sum()
    }
}

impl Surroundings {
    /// Whether every number can be traced with; `max_distance_m` is infinite where there is none.
    pub(super) fn check(&self, max_distance_m: f32, is_ao: bool) -> Result<(), Error> {
        let near = self.min_distance_m;
        if !(near >= 0.0 && near < max_distance_m) {
            return Err(Error::MinDistance { found: near, most: max_distance_m });
        }
        if let Some(found) = self.ground_m.filter(|height| !height.is_finite()) {
            return Err(Error::Ground { found });
        }
        match self.falloff {
            Some(found) if !(found.is_finite() && found > 0.0) => Err(Error::Falloff { found }),
            Some(_) if !is_ao || max_distance_m.is_infinite() => Err(Error::FalloffOf),
            _ => Ok(()),
        }
    }
}
