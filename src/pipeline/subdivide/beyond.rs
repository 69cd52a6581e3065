//! The edges of the input whose new vertices skinning takes farther off than the bound.

use std::collections::{BTreeMap, BTreeSet};

use super::skin::Off;
use super::source::Surface;
use crate::bake::Place;
use crate::bake::subdivide::Tessellation;
use crate::pipeline::Job;

/// An edge, or the inside of a triangle, with vertices that cannot be kept on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Beyond {
    /// Name of the mesh.
    pub mesh: String,
    /// The primitive's index within it.
    pub primitive: usize,
    /// Its ends, or corners, vertices of the primitive as the file numbers them.
    pub vertices: Vec<usize>,
    /// New vertices on it that are beyond the bound.
    pub count: usize,
    /// The farthest, metres.
    pub most_m: f32,
    /// In which pose that is, index into the job's.
    pub pose: usize,
}

/// What of the input is not split, so that the bound is kept.
#[derive(Debug, Default)]
pub(super) struct Stiff {
    edges: BTreeSet<[u32; 2]>,
    triangles: BTreeSet<u32>,
}

impl Stiff {
    /// Adds where new vertices are beyond the bound; whether there was anything.
    pub(super) fn add(&mut self, surface: &Surface, places: &[Place], off: (&[Off], f32)) -> bool {
        let before = self.count();
        for (place, _) in far(places, off) {
            let corners = surface.triangles[place.triangle as usize].into_iter().zip(place.weights);
            let ends: Vec<u32> = corners.filter(|(_, w)| *w > 0.0).map(|(v, _)| v).collect();
            match ends[..] {
                [a, b] => self.edges.insert([a.min(b), a.max(b)]),
                _ => self.triangles.insert(place.triangle),
            };
        }
        self.count() > before
    }

    /// How many edges and triangles.
    pub(super) fn count(&self) -> usize {
        self.edges.len() + self.triangles.len()
    }

    /// Keeps them whole.
    pub(super) fn stiffen(&self, tessellation: &mut Tessellation) {
        let edges: Vec<[u32; 2]> = self.edges.iter().copied().collect();
        let triangles: Vec<u32> = self.triangles.iter().copied().collect();
        tessellation.stiffen(&edges, &triangles);
    }
}

/// The new vertices beyond the bound.
fn far<'a>(
    places: &'a [Place],
    (deviations, bound_m): (&'a [Off], f32),
) -> impl Iterator<Item = (&'a Place, &'a Off)> {
    places.iter().zip(deviations).filter(move |(_, off)| off.most_m > bound_m)
}

/// Every edge with new vertices beyond the bound, the farthest first.
pub(super) fn beyond(
    job: &Job,
    surface: &Surface,
    places: &[Place],
    off: (&[Off], f32),
) -> Vec<Beyond> {
    let mut edges: BTreeMap<(usize, Vec<usize>), Beyond> = BTreeMap::new();
    for (place, off) in far(places, off) {
        let primitive = surface.primitive_of(place.triangle);
        let first = surface.primitives[primitive].first_vertex;
        let part = &job.scene.mesh.parts[surface.primitives[primitive].parts[0]];
        let corners = surface.triangles[place.triangle as usize].into_iter().zip(place.weights);
        let counts = corners.filter(|(_, weight)| *weight > 0.0);
        let mut vertices: Vec<usize> = counts.map(|(v, _)| v as usize - first).collect();
        vertices.sort_unstable();
        let edge = edges.entry((primitive, vertices.clone())).or_insert_with(|| Beyond {
            mesh: part.name.clone(),
            primitive: part.primitive,
            vertices,
            count: 0,
            most_m: 0.0,
            pose: off.pose,
        });
        edge.count += 1;
        if off.most_m > edge.most_m {
            (edge.most_m, edge.pose) = (off.most_m, off.pose);
        }
    }
    let mut edges: Vec<Beyond> = edges.into_values().collect();
    edges.sort_by(|a, b| b.most_m.total_cmp(&a.most_m));
    edges
}
