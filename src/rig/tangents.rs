//! Tangents of a mesh that need neither texture coordinates nor tangents of the file: smooth over the
//! surface, and carried by the skin so that they are coherent in time (RPO09 §5.2).
//!
//! Every node that carries vertices has the longest principal direction of those that it carries the
//! most; a vertex mixes its nodes' directions by its weights and projects the result into its tangent
//! plane. What is left of jumps, and what no direction says (tips of limbs, where it is normal to the
//! surface), is taken from the neighbours.

mod figures;
mod principal;

use std::collections::BTreeMap;

use glam::{Affine3A, Mat3A, Quat, Vec3, Vec3A};

use super::{Deformed, Mesh, Points, Pose, RigidFrame, Skeleton, deform};
pub use figures::{TangentFigures, coherence, smoothness};
use principal::longest;

/// Rounds of smoothing over neighbours.
const ROUNDS: usize = 100;

/// Tangents at rest, in each vertex's own space before deformation.
#[derive(Debug, Clone, PartialEq)]
pub struct Tangents {
    rest: Vec<Vec3>,
}

/// Numbers of a tangent's component in a byte: 1 is 127.
const STEPS: f32 = 127.0;

/// The unit tangents of a mesh in its rest pose, in the scene's frame.
#[must_use]
pub fn tangents_at_rest(skeleton: &Skeleton, mesh: &Mesh) -> Vec<Vec3> {
    let pose = Pose::rest(skeleton, &mesh.default_weights);
    let globals = skeleton.globals(&pose.local);
    let mut rest = Deformed::default();
    deform(mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut rest);
    let guess = mixed_directions(mesh, &rest);
    smoothed(mesh, &rest, &guess)
}

/// Tangents in three bytes each: what is fitted and what is evaluated must be the very same frames.
#[must_use]
pub fn tangents_to_bytes(tangents: &[Vec3]) -> Vec<[i8; 3]> {
    let byte = |x: f32| (x * STEPS).round() as i8;
    tangents.iter().map(|tangent| tangent.to_array().map(byte)).collect()
}

/// What [`tangents_to_bytes`] made, of about unit length.
#[must_use]
pub fn tangents_from_bytes(bytes: &[[i8; 3]]) -> Vec<Vec3> {
    bytes.iter().map(|bytes| Vec3::from(bytes.map(|x| f32::from(x) / STEPS))).collect()
}

impl Tangents {
    /// The tangents of a mesh, by its rest pose.
    #[must_use]
    pub fn new(skeleton: &Skeleton, mesh: &Mesh) -> Self {
        Self::of(skeleton, mesh, &tangents_at_rest(skeleton, mesh))
    }

    /// Tangents that a mesh, of which only the skin is looked at, carries from its rest pose, where they
    /// are `at_rest`, in the scene's frame; their length does not matter.
    #[must_use]
    pub fn of(skeleton: &Skeleton, mesh: &Mesh, at_rest: &[Vec3]) -> Self {
        let globals = skeleton.globals(&Pose::rest(skeleton, &mesh.default_weights).local);
        let matrices = matrices(mesh, &globals, RigidFrame::IDENTITY);
        let back = |(vertex, tangent): (usize, &Vec3)| {
            let inverse = blended(mesh, &matrices, vertex).inverse();
            let own = Vec3::from(inverse * Vec3A::from(*tangent));
            if own.is_finite() { own.normalize_or(Vec3::X) } else { Vec3::X }
        };
        Self { rest: at_rest.iter().enumerate().map(back).collect() }
    }

    /// The tangents of some of the vertices.
    ///
    /// # Panics
    /// If there is no such vertex.
    #[must_use]
    pub fn subset(&self, vertices: &[u32]) -> Self {
        Self { rest: vertices.iter().map(|&vertex| self.rest[vertex as usize]).collect() }
    }

    /// The unit tangents of a pose, at right angles to the posed normals, seen from `root`.
    ///
    /// # Panics
    /// If the mesh is another, or `globals` are shorter than what it refers to.
    pub fn pose(
        &self,
        mesh: &Mesh,
        globals: &[Affine3A],
        root: RigidFrame,
        normals: &[Vec3],
        out: &mut Vec<Vec3>,
    ) {
        let matrices = matrices(mesh, globals, root);
        let posed = |(vertex, (own, &normal)): (usize, (&Vec3, &Vec3))| {
            let moved = Vec3::from(blended(mesh, &matrices, vertex) * Vec3A::from(*own));
            in_plane(moved, normal).unwrap_or_else(|| normal.any_orthonormal_vector())
        };
        out.clear();
        out.extend(self.rest.iter().zip(normals).enumerate().map(posed));
    }
}

/// The rotation that takes a normal to +Z and a tangent to +X, both unit and at right angles.
#[must_use]
pub fn to_tangent_frame(normal: Vec3, tangent: Vec3) -> Quat {
    let rows = glam::Mat3::from_cols(tangent, normal.cross(tangent), normal).transpose();
    Quat::from_mat3(&rows).normalize()
}

/// Node → scene of every deformer, seen from `root`.
fn matrices(mesh: &Mesh, globals: &[Affine3A], root: RigidFrame) -> Vec<Mat3A> {
    let to_root = root.inverse();
    let matrix = |deformer: &super::Deformer| {
        (to_root * globals[deformer.node] * deformer.inverse_bind).matrix3
    };
    mesh.deformers.iter().map(matrix).collect()
}

fn blended(mesh: &Mesh, matrices: &[Mat3A], vertex: usize) -> Mat3A {
    let weighed =
        |influence: &super::Influence| matrices[influence.deformer as usize] * influence.weight;
    mesh.influences_of(vertex).iter().map(weighed).fold(Mat3A::ZERO, |sum, m| sum + m)
}

/// The part of a vector in the plane of a normal, unit; none where nothing is left.
fn in_plane(vector: Vec3, normal: Vec3) -> Option<Vec3> {
    let length = vector.length();
    let part = vector - normal * vector.dot(normal);
    if part.length() > 1e-4 * length { part.try_normalize() } else { None }
}

/// Each vertex's mixture of its nodes' directions, in its tangent plane but not unit: shorter where it
/// says less.
fn mixed_directions(mesh: &Mesh, rest: &Deformed) -> Vec<Vec3> {
    let nodes = |vertex: usize| {
        let influences = mesh.influences_of(vertex).iter();
        influences.map(|one| (mesh.deformers[one.deformer as usize].node, one.weight))
    };
    // Ordered by node, so that sums have one order.
    let mut carried: BTreeMap<usize, Vec<Vec3>> = BTreeMap::new();
    for (vertex, &position) in rest.positions.iter().enumerate() {
        let most = nodes(vertex).reduce(|a, b| if b.1 > a.1 { b } else { a });
        if let Some((node, _)) = most {
            carried.entry(node).or_default().push(position);
        }
    }
    let mut axes: BTreeMap<usize, Vec3> =
        carried.iter().map(|(&node, positions)| (node, longest(positions))).collect();
    let sizes: BTreeMap<usize, usize> = carried.iter().map(|(&n, p)| (n, p.len())).collect();
    let mut shared: BTreeMap<(usize, usize), f32> = BTreeMap::new();
    for vertex in 0..rest.positions.len() {
        for (a, wa) in nodes(vertex) {
            for (b, wb) in nodes(vertex).filter(|(b, _)| *b != a) {
                *shared.entry((a, b)).or_default() += wa * wb;
            }
        }
    }
    align(&mut axes, &sizes, &shared);
    let mix = |vertex: usize| {
        let sum: Vec3 = nodes(vertex).filter_map(|(node, w)| Some(w * *axes.get(&node)?)).sum();
        let normal = rest.normals[vertex];
        sum - normal * sum.dot(normal)
    };
    (0..rest.positions.len()).map(mix).collect()
}

/// Turns axes around so that nodes that share vertices point the same way: from the largest node, always
/// to the one that is most tied to those that are done.
fn align(
    axes: &mut BTreeMap<usize, Vec3>,
    sizes: &BTreeMap<usize, usize>,
    shared: &BTreeMap<(usize, usize), f32>,
) {
    let mut left: Vec<usize> = axes.keys().copied().collect();
    let mut done: Vec<usize> = Vec::new();
    while !left.is_empty() {
        let tie = |node: usize, axes: &BTreeMap<usize, Vec3>| -> f32 {
            let ties = done.iter().filter_map(|other| {
                Some(shared.get(&(node, *other))? * axes[&node].dot(axes[other]))
            });
            ties.sum()
        };
        let rank = |node: usize| (tie(node, axes).abs(), sizes.get(&node).copied().unwrap_or(0));
        let best = (0..left.len()).max_by(|&i, &j| {
            let (a, b) = (rank(left[i]), rank(left[j]));
            a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(left[j].cmp(&left[i]))
        });
        let node = left.swap_remove(best.unwrap_or(0));
        if tie(node, axes) < 0.0
            && let Some(axis) = axes.get_mut(&node)
        {
            *axis = -*axis;
        }
        done.push(node);
    }
}

/// Means over neighbours, brought into each vertex's plane, again and again; vertices at one place are
/// one. What is long at first stays more as it is.
fn smoothed(mesh: &Mesh, rest: &Deformed, guess: &[Vec3]) -> Vec<Vec3> {
    let points = Points::merge(mesh);
    let normal: Vec<Vec3> = points.vertex.iter().map(|&v| rest.normals[v as usize]).collect();
    let first: Vec<Vec3> = points.vertex.iter().map(|&v| guess[v as usize]).collect();
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); points.count()];
    for triangle in &mesh.triangles {
        let corners = triangle.map(|vertex| points.of_vertex[vertex as usize]);
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if a != b {
                neighbours[a as usize].push(b);
                neighbours[b as usize].push(a);
            }
        }
    }
    neighbours.iter_mut().for_each(|list| {
        list.sort_unstable();
        list.dedup();
    });
    let mut tangents = first.clone();
    for _ in 0..ROUNDS {
        let next = |i: usize| {
            let around: Vec3 = neighbours[i]
                .iter()
                .map(|&j| {
                    Quat::from_rotation_arc(normal[j as usize], normal[i]) * tangents[j as usize]
                })
                .sum();
            let mean = around / neighbours[i].len().max(1) as f32;
            // A little of the first guess, so that the field does not drift away from the limbs.
            let sum = 0.4 * tangents[i] + 0.6 * mean + 0.02 * first[i];
            sum - normal[i] * sum.dot(normal[i])
        };
        tangents = (0..tangents.len()).map(next).collect();
    }
    let of_vertex = |(vertex, &point): (usize, &u32)| {
        let normal = rest.normals[vertex];
        in_plane(tangents[point as usize], normal)
            .unwrap_or_else(|| normal.any_orthonormal_vector())
    };
    points.of_vertex.iter().enumerate().map(of_vertex).collect()
}

#[cfg(test)]
mod tests;
