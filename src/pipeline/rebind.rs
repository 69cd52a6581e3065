//! A model attached to a re-exported mesh: vertices re-ordered, split or merged.
//!
//! A model belongs to points, and its map says which point each vertex takes its values from. A
//! tool that writes the scene anew changes vertices, not the surface: the map is made again, from
//! where the vertices are at rest, how they face, what moves them, and which are joined by edges.

mod nodes;
mod shape;

use std::collections::HashSet;

use glam::Vec3;

use super::{Error, hash, import};
use crate::model::{MeshIdentity, Model, PartRange};
use crate::scene::Scene;
use shape::{Grid, Shape};

/// The cosine between normals beyond which a vertex is of another surface: 60°.
const FACING: f32 = 0.5;
/// The distance between skin weights (Σ |a − b| over the nodes) beyond which a vertex moves
/// otherwise; weights in 8 bits differ by less than a fifth of it.
const MOVING: f32 = 0.1;
/// Candidates whose scores are as near to the best one's are told apart by edges.
const AMBIGUOUS: f32 = 0.02;

/// How much a new mesh may differ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RebindSettings {
    /// Distance of a vertex from its point at rest, over the model's size; 0.001 by default.
    pub tolerance: f32,
    /// Share of the vertices that may match no point, 0 to 1; they take their nearest one's values.
    /// None by default.
    pub unmatched: f32,
}

impl Default for RebindSettings {
    fn default() -> Self {
        Self { tolerance: 1e-3, unmatched: 0.0 }
    }
}

/// A vertex that no point matches.
#[derive(Debug, Clone, PartialEq)]
pub struct Unmatched {
    /// In the new scene's order.
    pub vertex: usize,
    /// Its mesh.
    pub part: String,
    /// At rest, metres.
    pub position: Vec3,
    /// Distance of the nearest point, metres.
    pub nearest_m: f32,
}

/// A model with its new mesh, and how well they fit.
#[derive(Debug)]
pub struct Rebound {
    /// The model.
    pub model: Model,
    /// Vertices of the new mesh.
    pub vertices: usize,
    /// Those that match no point, by their index.
    pub unmatched: Vec<Unmatched>,
    /// The farthest that a matched vertex is from its point, metres.
    pub farthest_m: f32,
    /// Points that no vertex takes its values from any more.
    pub unused_points: usize,
    /// Share of the new mesh's edges that join points which an edge joined before; nothing where
    /// the old edges are not known.
    pub edges_kept: Option<f64>,
}

/// Why a model cannot be attached.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RebindError {
    /// Nothing says where the points are.
    #[error(
        "the model does not carry its mesh at rest: name the scene that it was baked from with \
         --original (only models that look at the posed mesh can carry it, by --include-rest)"
    )]
    NeedsOriginal,
    /// The original is another scene.
    #[error("{file} is not the scene that the model was baked from: its hash is another one")]
    OtherScene {
        /// The named original.
        file: String,
    },
    /// Bones or joints are missing.
    #[error(
        "the scene has no node {}, which the model's rig needs: export it with its names (gltfpack -kn)",
        .0.join(", ")
    )]
    Nodes(Vec<String>),
    /// Too much of the mesh is another.
    #[error(
        "{found} of {vertices} vertices match no point of the model within {tolerance_m:.2e} m, \
         facing and skin weights alike; the first are {first}; --unmatched says how many may"
    )]
    Unmatched {
        /// How many.
        found: usize,
        /// Of how many.
        vertices: usize,
        /// In metres.
        tolerance_m: f32,
        /// A few of them.
        first: String,
    },
    /// Fewer vertices than a model may have for its points.
    #[error(
        "the scene has {vertices} vertices for {points} points of the model: a mesh that was \
         simplified needs a bake of its own"
    )]
    Fewer {
        /// In the scene.
        vertices: usize,
        /// In the model.
        points: usize,
    },
    /// The spheres of a model are carried by points that are gone.
    #[error(
        "{unused} points have no vertex any more, and the model looks at all of them in the posed \
         mesh: fit it with --include-rest, so that it poses them itself"
    )]
    Unseen {
        /// How many.
        unused: usize,
    },
    /// Import, or the model's own objection.
    #[error(transparent)]
    Other(#[from] Error),
}

impl From<crate::model::Error> for RebindError {
    fn from(error: crate::model::Error) -> Self {
        Self::Other(error.into())
    }
}

/// Attaches a model to a scene by its mesh at rest, or by that of the scene that it was baked from.
///
/// # Errors
/// See [`RebindError`].
pub fn rebind(
    model: &Model,
    scene: &Scene,
    original: Option<&std::path::Path>,
    settings: &RebindSettings,
) -> Result<Rebound, RebindError> {
    let old = match original {
        Some(file) => {
            let original = import(file)?;
            if hash::scene(&original.sources) != model.header().mesh.scene_sha256 {
                return Err(RebindError::OtherScene { file: file.display().to_string() });
            }
            Shape::of_points(&original, model)
        }
        None => Shape::of_model(model)?.ok_or(RebindError::NeedsOriginal)?,
    };
    let rig = nodes::kept(model, scene)?;
    let new = Shape::of_vertices(scene);
    let points = model.shape().points;
    if new.positions.len() < points {
        let vertices = new.positions.len();
        return Err(RebindError::Fewer { vertices, points });
    }
    let tolerance_m = settings.tolerance * model.header().rig.size_m;
    let matched = matched(&old, &new, tolerance_m);
    let unmatched = unmatched(&old, &new, scene, &matched);
    if unmatched.len() as f64 > f64::from(settings.unmatched) * new.positions.len() as f64 {
        let tell = |one: &Unmatched| {
            let (vertex, part, at, off) = (one.vertex, &one.part, one.position, one.nearest_m);
            format!("{vertex} of {part} at {at} ({off:.2e} m off)")
        };
        let first: Vec<String> = unmatched.iter().take(3).map(tell).collect();
        let (found, vertices) = (unmatched.len(), new.positions.len());
        let first = first.join("; ");
        return Err(RebindError::Unmatched { found, vertices, tolerance_m, first });
    }
    let nearest = |vertex: usize| old.nearest(new.positions[vertex]).0;
    let map: Vec<u32> = matched
        .iter()
        .enumerate()
        .map(|(vertex, point)| point.unwrap_or_else(|| nearest(vertex)))
        .collect();
    let used: HashSet<u32> = map.iter().copied().collect();
    let unused_points = points - used.len();
    if model.occluders().is_some() && model.rest().is_none() && unused_points > 0 {
        return Err(RebindError::Unseen { unused: unused_points });
    }
    let off = |(vertex, point): (usize, &Option<u32>)| {
        point.map(|point| old.positions[point as usize].distance(new.positions[vertex]))
    };
    let farthest_m = matched.iter().enumerate().filter_map(off).fold(0.0, f32::max);
    let edges_kept = edges_kept(&old, &new, &map);
    let identity = identity(scene, &rig.names());
    let model = model.rebound(identity, map, &rig.keep)?;
    let vertices = new.positions.len();
    Ok(Rebound { model, vertices, unmatched, farthest_m, unused_points, edges_kept })
}

fn identity(scene: &Scene, names: &[&str]) -> MeshIdentity {
    let node = |node: usize| {
        let name = scene.skeleton.nodes[node].name.as_str();
        names.iter().position(|&known| known == name).unwrap_or(0) as u32
    };
    let parts = scene.mesh.parts.iter().map(|part| PartRange {
        name: part.name.clone(),
        node: node(part.node),
        primitive: part.primitive as u32,
        first_vertex: part.vertices.start as u32,
        vertices: part.vertices.len() as u32,
    });
    MeshIdentity {
        scene_sha256: hash::scene(&scene.sources),
        shape_sha256: Some(hash::shape(scene, &scene.mesh.parts)),
        receivers_sha256: None,
        vertices: scene.mesh.positions.len() as u32,
        // The model's own; the caller's copy says how many.
        points: 0,
        parts: parts.collect(),
    }
}

/// Vertex → its point: the one within the tolerance that faces and moves alike and is nearest in
/// all three; among nearly equal ones, the one that edges join to the points of its neighbours.
fn matched(old: &Shape, new: &Shape, tolerance_m: f32) -> Vec<Option<u32>> {
    let grid = Grid::new(&old.positions, tolerance_m);
    let candidates: Vec<Vec<(f32, u32)>> = (0..new.positions.len())
        .map(|vertex| {
            let score = |point: u32| score(old, point as usize, new, vertex, tolerance_m);
            let near = grid.near(new.positions[vertex]);
            let mut all: Vec<(f32, u32)> =
                near.filter_map(|point| Some((score(point)?, point))).collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let best = all.first().map_or(0.0, |first| first.0);
            all.retain(|one| one.0 <= best + AMBIGUOUS);
            all
        })
        .collect();
    let first: Vec<Option<u32>> = candidates.iter().map(|c| c.first().map(|one| one.1)).collect();
    let neighbours = new.neighbours();
    let support = |vertex: usize, point: u32| {
        let joined = |&&other: &&u32| {
            first[other as usize].is_some_and(|of_other| old.joins(point, of_other))
        };
        neighbours[vertex].iter().filter(joined).count()
    };
    candidates
        .iter()
        .enumerate()
        .map(|(vertex, all)| match all.as_slice() {
            [] => None,
            [only] => Some(only.1),
            several => {
                let most = several.iter().map(|one| support(vertex, one.1)).max();
                several.iter().find(|one| Some(support(vertex, one.1)) == most).map(|one| one.1)
            }
        })
        .collect()
}

/// Distances in place, facing and motion, each in units of what makes a vertex another one.
fn score(old: &Shape, point: usize, new: &Shape, vertex: usize, tolerance_m: f32) -> Option<f32> {
    let distance_m = old.positions[point].distance(new.positions[vertex]);
    // A tolerance of 0 takes what is at the very place.
    let away = if distance_m > 0.0 { distance_m / tolerance_m } else { 0.0 };
    let facing = old.normals[point].dot(new.normals[vertex]);
    let moving = old.weights[point].distance(&new.weights[vertex]) / MOVING;
    let within = away <= 1.0 && facing >= FACING && moving <= 1.0;
    within.then(|| away + (1.0 - facing) / (1.0 - FACING) + moving)
}

fn unmatched(old: &Shape, new: &Shape, scene: &Scene, matched: &[Option<u32>]) -> Vec<Unmatched> {
    let tell = |vertex: usize| {
        let position = new.positions[vertex];
        let part = scene.mesh.parts.iter().find(|part| part.vertices.contains(&vertex));
        Unmatched {
            vertex,
            part: part.map_or(String::new(), |part| part.name.clone()),
            position,
            nearest_m: old.nearest(position).1,
        }
    };
    (0..matched.len()).filter(|&vertex| matched[vertex].is_none()).map(tell).collect()
}

fn edges_kept(old: &Shape, new: &Shape, map: &[u32]) -> Option<f64> {
    if old.edges.is_empty() || new.edges.is_empty() {
        return None;
    }
    let kept = |&&(a, b): &&(u32, u32)| old.joins(map[a as usize], map[b as usize]);
    Some(new.edges.iter().filter(kept).count() as f64 / new.edges.len() as f64)
}

#[cfg(test)]
mod tests;
