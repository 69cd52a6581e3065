//! Normals from the posed triangles themselves, for shapes whose own normals do not follow: morph
//! targets and sequences that move positions only.

use std::collections::HashMap;
use std::ops::Range;

use glam::{DVec3, Vec3};

use super::Deformed;

/// Which vertices share a normal, and on which side of their triangles it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Facets {
    /// Vertex → group: vertices that agree in position and normal at rest are one, so that seams
    /// of texture coordinates do not crease.
    group: Vec<u32>,
    /// Per group, −1 where the triangles run clockwise seen from outside (mirroring nodes).
    side: Vec<f64>,
    /// The vertices whose normals are computed.
    vertices: Vec<Range<usize>>,
}

impl Facets {
    /// The groups of a mesh at rest.
    #[must_use]
    pub fn new(rest: &Deformed, triangles: &[[u32; 3]]) -> Self {
        let mut seen: HashMap<[u32; 6], u32> = HashMap::with_capacity(rest.positions.len());
        let bits = |v: Vec3| v.to_array().map(|x| (x + 0.0).to_bits());
        let mut normals = Vec::new();
        let group: Vec<u32> = rest
            .positions
            .iter()
            .zip(&rest.normals)
            .map(|(&position, &normal)| {
                let ([a, b, c], [d, e, f]) = (bits(position), bits(normal));
                let next = normals.len() as u32;
                let group = *seen.entry([a, b, c, d, e, f]).or_insert(next);
                if group == next {
                    normals.push(normal);
                }
                group
            })
            .collect();
        let vertices = std::iter::once(0..group.len()).collect();
        let this = Self { group, side: vec![1.0; normals.len()], vertices };
        let sums = this.sums(&rest.positions, triangles);
        let side = sums
            .iter()
            .zip(&normals)
            .map(|(sum, normal)| if sum.dot(normal.as_dvec3()) < 0.0 { -1.0 } else { 1.0 });
        Self { side: side.collect(), ..this }
    }

    /// The same for some of the vertices; all others keep what they have.
    #[must_use]
    pub fn only(self, vertices: Vec<Range<usize>>) -> Self {
        Self { vertices, ..self }
    }

    /// Gives every vertex the area-weighted mean of its group's triangles in this pose; one whose
    /// triangles have no area keeps what it has.
    ///
    /// # Panics
    /// If the pose is of another mesh.
    pub fn apply(&self, triangles: &[[u32; 3]], posed: &mut Deformed) {
        let sums = self.sums(&posed.positions, triangles);
        for vertex in self.vertices.iter().cloned().flatten() {
            let group = self.group[vertex] as usize;
            if let Some(unit) = (sums[group] * self.side[group]).try_normalize() {
                posed.normals[vertex] = unit.as_vec3();
            }
        }
    }

    fn sums(&self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
        assert_eq!(positions.len(), self.group.len(), "one position per vertex");
        let mut sums = vec![DVec3::ZERO; self.side.len()];
        for triangle in triangles {
            let [a, b, c] = triangle.map(|corner| positions[corner as usize].as_dvec3());
            let area = (b - a).cross(c - a);
            for &corner in triangle {
                sums[self.group[corner as usize] as usize] += area;
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles over an edge whose vertices are doubled: folding them by a right angle turns
    /// each side's normals, and the doubled edge's as one; the mirrored mesh does the same mirrored.
    #[test]
    fn seams_stay_whole_and_mirrors_keep_their_side() {
        for mirror in [1.0_f32, -1.0] {
            let flat = [
                Vec3::new(0.0, 0.0, 0.0),
                Vec3::new(0.0, 0.0, 1.0),
                Vec3::new(mirror, 0.0, 0.0),
                Vec3::new(0.0, 0.0, 0.0),
                Vec3::new(0.0, 0.0, 1.0),
                Vec3::new(-mirror, 0.0, 0.0),
            ];
            let triangles = [[0, 1, 2], [3, 5, 4]];
            let rest = Deformed { positions: flat.to_vec(), normals: vec![Vec3::Y; 6] };
            let facets = Facets::new(&rest, &triangles);
            let mut posed = rest.clone();
            posed.positions[5] = Vec3::new(0.0, -1.0, 0.0);
            facets.apply(&triangles, &mut posed);
            assert!(posed.normals[2].distance(Vec3::Y) < 1e-6);
            assert!(posed.normals[5].distance(Vec3::new(-mirror, 0.0, 0.0)) < 1e-6);
            let edge = Vec3::new(-mirror, 1.0, 0.0).normalize();
            for vertex in [0, 1, 3, 4] {
                assert!(posed.normals[vertex].distance(edge) < 1e-6, "{:?}", posed.normals);
            }
        }
    }
}
