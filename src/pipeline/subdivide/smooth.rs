//! New vertices on the smooth surface that the normals mean: curved PN triangles (Vlachos, Peters, Boyd
//! and Mitchell 2001).
//!
//! A cubic in the corners' weights, whose control points lie a third along each side, moved into the
//! tangent plane of the nearer corner. A side whose triangles have other normals at its ends, or that
//! has not two triangles, stays straight: seams of normals and boundaries are kept, and nothing
//! opens between triangles.

use std::collections::HashMap;

use glam::Vec3;

use super::source::Surface;
use crate::bake::Place;
use crate::rig::{Mesh, Mix};

/// Normals that differ by less are the same.
const SAME_NORMAL: f32 = 1e-4;

/// Where new vertices lie over their triangles: in them, or on the curved ones.
#[derive(Debug)]
pub(super) struct Shape {
    /// Of each new vertex the sides of its triangle that stay straight; `None` where all is flat.
    straight: Option<Vec<[bool; 3]>>,
}

impl Shape {
    /// In the triangles.
    pub(super) fn flat() -> Self {
        Self { straight: None }
    }

    /// On the curved ones.
    pub(super) fn smooth(mesh: &Mesh, surface: &Surface, places: &[Place]) -> Self {
        let sides = sides(mesh, surface);
        let of = |place: &Place| {
            let corners = surface.triangles[place.triangle as usize];
            [0, 1, 2].map(|i| !sides[&key(surface, [corners[i], corners[(i + 1) % 3]])].is_smooth())
        };
        Self { straight: Some(places.iter().map(of).collect()) }
    }

    /// That of some of the new vertices.
    pub(super) fn of(&self, some: &[usize]) -> Self {
        let straight = self.straight.as_ref();
        Self { straight: straight.map(|all| some.iter().map(|&index| all[index]).collect()) }
    }

    /// The place of new vertex `index` where the mesh has these positions and normals.
    pub(super) fn place(
        &self,
        index: usize,
        mix: &Mix,
        positions: &[Vec3],
        normals: &[Vec3],
    ) -> Vec3 {
        let Some(straight) = &self.straight else { return mix.of(positions) };
        let corners = mix.vertices.map(|vertex| positions[vertex as usize]);
        let normals = mix.vertices.map(|vertex| normals[vertex as usize].normalize_or_zero());
        curved(corners, normals, straight[index], mix.weights)
    }

    /// How far new vertices lie from their triangles at rest; empty where all are in them.
    pub(super) fn moved(&self, mesh: &Mesh, mixes: &[Mix]) -> Vec<Vec3> {
        let rest = (&mesh.positions[..], &mesh.normals[..]);
        let one =
            |(index, mix): (usize, &Mix)| self.place(index, mix, rest.0, rest.1) - mix.of(rest.0);
        match self.straight {
            None => Vec::new(),
            Some(_) => mixes.iter().enumerate().map(one).collect(),
        }
    }
}

/// The cubic at weights λ of the corners; sides as corner 0 to 1, 1 to 2, 2 to 0.
fn curved(corners: [Vec3; 3], normals: [Vec3; 3], straight: [bool; 3], weights: [f32; 3]) -> Vec3 {
    // A third of the way from one corner to another, in the tangent plane of the first.
    let control = |from: usize, to: usize, straight: bool| {
        let way = corners[to] - corners[from];
        let lift = if straight { 0.0 } else { way.dot(normals[from]) };
        corners[from] + (way - lift * normals[from]) / 3.0
    };
    let mut sum: Vec3 = (0..3).map(|i| weights[i].powi(3) * corners[i]).sum();
    let mut mean = Vec3::ZERO;
    for (a, straight) in straight.into_iter().enumerate() {
        let b = (a + 1) % 3;
        let (near, far) = (control(a, b, straight), control(b, a, straight));
        let (wa, wb) = (weights[a], weights[b]);
        sum += 3.0 * wa * wb * (wa * near + wb * far);
        mean += (near + far) / 6.0;
    }
    let middle: Vec3 = corners.iter().sum::<Vec3>() / 3.0;
    sum + 6.0 * weights.iter().product::<f32>() * (mean + (mean - middle) / 2.0)
}

/// What is known of a side of triangles.
#[derive(Debug)]
struct Side {
    triangles: u32,
    /// At its ends, in the order of their places.
    normals: [Vec3; 2],
    agree: bool,
}

impl Side {
    fn is_smooth(&self) -> bool {
        self.triangles == 2 && self.agree
    }
}

fn key(surface: &Surface, side: [u32; 2]) -> [u32; 2] {
    let mut places = side.map(|vertex| surface.weld[vertex as usize]);
    places.sort_unstable();
    places
}

/// Every side by its places.
fn sides(mesh: &Mesh, surface: &Surface) -> HashMap<[u32; 2], Side> {
    let mut sides: HashMap<[u32; 2], Side> = HashMap::new();
    for (triangle, corners) in (0_u32..).zip(&surface.triangles) {
        let primitive = &surface.primitives[surface.primitive_of(triangle)];
        let first = mesh.parts[primitive.parts[0]].vertices.start;
        let normal = |vertex: u32| mesh.normals[vertex as usize - primitive.first_vertex + first];
        for i in 0..3 {
            let mut ends = [corners[i], corners[(i + 1) % 3]];
            ends.sort_unstable_by_key(|&vertex| surface.weld[vertex as usize]);
            let normals = ends.map(normal);
            let side = sides.entry(key(surface, ends)).or_insert(Side {
                triangles: 0,
                normals,
                agree: true,
            });
            side.triangles += 1;
            let same = |(a, b): (&Vec3, &Vec3)| (*a - *b).length() < SAME_NORMAL;
            side.agree &= side.normals.iter().zip(&normals).all(same);
        }
    }
    sides
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An octant of the unit sphere by hand: control points (1, ⅓, 0) bring a side's middle to (⅝, ⅝, 0) and
    /// the triangle's to (4/9, 4/9, 4/9), where the flat one has ½ and ⅓; corners stay; straight sides
    /// stay straight, and where normals are the triangle's own everything does.
    #[test]
    fn an_octant_is_a_cubic() {
        let corners = [Vec3::X, Vec3::Y, Vec3::Z];
        let at = |straight, weights| curved(corners, corners, straight, weights);
        for (i, corner) in corners.into_iter().enumerate() {
            let weights = std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
            assert_eq!(at([false; 3], weights), corner);
        }
        let middle = at([false; 3], [0.5, 0.5, 0.0]);
        assert!((middle - Vec3::new(0.625, 0.625, 0.0)).length() < 1e-6, "{middle}");
        let middle = at([false; 3], [1.0 / 3.0; 3]);
        assert!((middle - Vec3::splat(4.0 / 9.0)).length() < 1e-6, "{middle}");
        let side = at([true, false, false], [0.75, 0.25, 0.0]);
        assert!((side - Vec3::new(0.75, 0.25, 0.0)).length() < 1e-6, "{side}");
        let flat = curved(corners, [Vec3::ONE.normalize(); 3], [false; 3], [0.2, 0.3, 0.5]);
        assert!((flat - Vec3::new(0.2, 0.3, 0.5)).length() < 1e-6, "{flat}");
    }
}
