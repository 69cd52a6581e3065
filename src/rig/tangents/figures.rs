//! How smooth tangents are over the surface, and how coherent in time.

use std::collections::BTreeSet;

use glam::{Quat, Vec3};

use crate::rig::Deformed;

/// Angles of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TangentFigures {
    /// Mean, degrees.
    pub mean_degrees: f32,
    /// The angle that 99 of 100 do not exceed, degrees.
    pub p99_degrees: f32,
}

impl TangentFigures {
    fn of(mut radians: Vec<f32>) -> Self {
        if radians.is_empty() {
            return Self::default();
        }
        radians.sort_by(f32::total_cmp);
        let mean = radians.iter().sum::<f32>() / radians.len() as f32;
        let p99 = radians[(radians.len() * 99 / 100).min(radians.len() - 1)];
        Self { mean_degrees: mean.to_degrees(), p99_degrees: p99.to_degrees() }
    }
}

/// Over all edges, the angle between the tangents at both ends, the one brought into the other's plane by
/// the shortest turn.
#[must_use]
pub fn smoothness(triangles: &[[u32; 3]], normals: &[Vec3], tangents: &[Vec3]) -> TangentFigures {
    let sides = triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
    let edges: BTreeSet<[u32; 2]> = sides.map(|[a, b]| [a.min(b), a.max(b)]).collect();
    let angle = |[a, b]: [u32; 2]| {
        let (a, b) = (a as usize, b as usize);
        (Quat::from_rotation_arc(normals[a], normals[b]) * tangents[a]).angle_between(tangents[b])
    };
    TangentFigures::of(edges.into_iter().map(angle).collect())
}

/// Over all vertices, how far the tangent has turned about the normal between two poses against an edge
/// of the mesh there, which moves with the surface: 0 where it is painted on.
#[must_use]
pub fn coherence(
    triangles: &[[u32; 3]],
    [before, after]: [(&Deformed, &[Vec3]); 2],
) -> TangentFigures {
    let mut beside = vec![u32::MAX; before.0.positions.len()];
    for t in triangles {
        for k in 0..3 {
            if beside[t[k] as usize] == u32::MAX {
                beside[t[k] as usize] = t[(k + 1) % 3];
            }
        }
    }
    let against = |(mesh, tangents): (&Deformed, &[Vec3]), vertex: usize, other: usize| {
        let normal = mesh.normals[vertex];
        let edge = mesh.positions[other] - mesh.positions[vertex];
        let flat = (edge - normal * edge.dot(normal)).try_normalize()?;
        let (x, y) = (tangents[vertex].dot(flat), tangents[vertex].dot(normal.cross(flat)));
        Some(y.atan2(x))
    };
    let angles = beside.iter().enumerate().filter(|(_, other)| **other != u32::MAX);
    let turned = angles.filter_map(|(vertex, &other)| {
        let was = against(before, vertex, other as usize)?;
        let is = against(after, vertex, other as usize)?;
        let turn = (is - was).rem_euclid(std::f32::consts::TAU);
        Some(turn.min(std::f32::consts::TAU - turn))
    });
    TangentFigures::of(turned.collect())
}
