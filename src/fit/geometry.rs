//! The posed mesh of every training pose, for what a model learns from it.

use std::ops::Range;

use glam::{Affine3A, Quat, Vec3};

use crate::model::Signal;
use crate::rig::{Bones, Deformed, Mesh, Points, Pose, RigidFrame, Skeleton, Tangents, deform};
use crate::sh::Order;

/// The rigged mesh and the training poses, in the order of [`crate::dataset::Training`].
#[derive(Debug)]
pub struct Geometry<'a> {
    /// The node hierarchy.
    pub skeleton: &'a Skeleton,
    /// The mesh at rest.
    pub mesh: &'a Mesh,
    /// Which vertices are one point.
    pub points: &'a Points,
    /// Which bone each point sits on.
    pub bones: &'a Bones,
    /// What the training data are.
    pub signal: Signal,
    /// Bands of the data; not looked at for `ao`.
    pub order: Order,
    /// The joint that each pose parameter belongs to; `None` of those that belong to none.
    pub columns: Vec<Option<usize>>,
    /// Tangents of the mesh's vertices, which a fit in the tangent frame needs.
    pub tangents: Option<&'a Tangents>,
    /// Every training pose with its root frame.
    pub poses: Vec<(&'a Pose, RigidFrame)>,
}

/// Some points at every training pose, `[pose, point]`, root frame.
#[derive(Debug, Default)]
pub(super) struct Moved {
    /// The first of a range of points.
    pub(super) first: usize,
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    /// Empty where the geometry has none.
    pub(super) tangents: Vec<Vec3>,
}

impl Geometry<'_> {
    /// The points at rest: positions and normals.
    pub(super) fn rest(&self) -> Deformed {
        let rest = Pose::rest(self.skeleton, &self.mesh.default_weights);
        let globals = self.skeleton.globals(&rest.local);
        let mut out = Deformed::default();
        let mesh = self.mesh.subset(&self.points.vertex);
        deform(&mesh, &globals, &rest.weights, RigidFrame::IDENTITY, &mut out);
        out
    }

    /// A range of points at every pose.
    pub(super) fn moved_range(&self, points: Range<usize>) -> Moved {
        Moved { first: points.start, ..self.moved_vertices(&self.points.vertex[points]) }
    }

    /// The listed points at every pose.
    pub(super) fn moved_points(&self, points: &[u32]) -> Moved {
        let vertex = |&point: &u32| self.points.vertex[point as usize];
        self.moved_vertices(&points.iter().map(vertex).collect::<Vec<_>>())
    }

    fn moved_vertices(&self, vertices: &[u32]) -> Moved {
        let mesh = self.mesh.subset(vertices);
        let tangents = self.tangents.map(|tangents| tangents.subset(vertices));
        let (mut moved, mut out) = (Moved::default(), Deformed::default());
        let mut turned = Vec::new();
        for (pose, root) in &self.poses {
            let globals: Vec<Affine3A> = self.skeleton.globals(&pose.local);
            deform(&mesh, &globals, &pose.weights, *root, &mut out);
            moved.positions.extend_from_slice(&out.positions);
            moved.normals.extend_from_slice(&out.normals);
            if let Some(tangents) = &tangents {
                tangents.pose(&mesh, &globals, *root, &out.normals, &mut turned);
                moved.tangents.extend_from_slice(&turned);
            }
        }
        moved
    }

    /// The area of each point: a third of every triangle around it, square metres.
    pub(super) fn areas(&self, positions: &[Vec3]) -> Vec<f32> {
        let mut areas = vec![0.0; positions.len()];
        for triangle in &self.mesh.triangles {
            let corners = triangle.map(|vertex| self.points.of_vertex[vertex as usize] as usize);
            let [a, b, c] = corners.map(|point| positions[point]);
            let third = (b - a).cross(c - a).length() / 6.0;
            corners.iter().for_each(|&point| areas[point] += third);
        }
        areas
    }

    /// For each bone the nearest one above it in the hierarchy.
    pub(super) fn parents(&self) -> Vec<Option<usize>> {
        let of_node = |node: usize| self.bones.nodes.iter().position(|&other| other == node);
        let above = |&node: &usize| {
            let mut next = self.skeleton.nodes[node].parent;
            while let Some(node) = next {
                if let Some(bone) = of_node(node) {
                    return Some(bone);
                }
                next = self.skeleton.nodes[node].parent;
            }
            None
        };
        self.bones.nodes.iter().map(above).collect()
    }
}

/// Rotates into the frame of a bone that has turned by `rotation`.
pub(super) fn into_bone(rotation: Quat, vector: Vec3) -> Vec3 {
    rotation.conjugate() * vector
}
