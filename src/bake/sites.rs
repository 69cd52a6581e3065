//! Places spread evenly over the surface, where a bake for a least-squares vertex fit looks.

use glam::Vec3;

use super::posed::Stage;
use super::surroundings::NO_POINT;
use crate::num::random::{hash, unit};

/// A fixed place of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Site {
    pub(super) triangle: u32,
    /// Weights of the corners, which sum to 1.
    pub(super) weights: [f32; 3],
    /// The area that it stands for, over the mean of all.
    pub(super) area: f32,
}

impl Site {
    /// A value between those of the corners.
    pub(super) fn mix(&self, corners: [Vec3; 3]) -> Vec3 {
        let [a, b, c] = corners;
        self.weights[0] * a + self.weights[1] * b + self.weights[2] * c
    }
}

/// At least one site on each triangle with points and area, `per_point` for each point in the mean,
/// by area, evenly within each triangle; the same for the same mesh.
pub(super) fn spread(stage: &Stage, positions: &[Vec3], per_point: u32) -> Vec<Site> {
    let area = |triangle: &[u32; 3]| {
        let lit =
            triangle.iter().all(|&corner| stage.points.of_vertex[corner as usize] != NO_POINT);
        let [a, b, c] = triangle.map(|corner| positions[corner as usize].as_dvec3());
        if lit { (b - a).cross(c - a).length() / 2.0 } else { 0.0 }
    };
    let areas: Vec<f64> = stage.triangles.iter().map(area).collect();
    let whole: f64 = areas.iter().sum();
    let wanted = stage.points.vertex.len() as f64 * f64::from(per_point);
    let mut sites = Vec::new();
    for (triangle, &area) in areas.iter().enumerate().filter(|(_, area)| **area > 0.0) {
        let count = (area / whole * wanted).round().max(1.0) as u32;
        for index in 0..count {
            sites.push(Site {
                triangle: triangle as u32,
                weights: place(triangle as u64, index),
                area: (area / f64::from(count)) as f32,
            });
        }
    }
    let mean = (whole / sites.len().max(1) as f64) as f32;
    sites.iter_mut().for_each(|site| site.area /= mean);
    sites
}

/// The `index`-th place of a triangle: a lattice of the plastic number (Roberts' R₂), shifted at
/// random and folded into the triangle.
fn place(triangle: u64, index: u32) -> [f32; 3] {
    const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    let [u, v] = [0, 1].map(|axis| {
        let start = unit(hash(&[triangle, axis]));
        (start + f64::from(index) * STEPS[axis as usize]).fract()
    });
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    [(1.0 - u - v) as f32, u as f32, v as f32]
}
