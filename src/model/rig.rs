//! The rig of a model at work: from the header's wire form to the types of `rig/` and back.

use glam::{Affine3A, Quat, Vec3};

use super::{ColumnHeader, NodeHeader, RigHeader, RootMotionHeader, SourceHeader, WeightHeader};
use crate::rig::{Bones, Column, Node, Parametrisation, RootMotion, Skeleton, Source, Transform};

/// What turns a pose into parameters, bone rotations and the root frame.
#[derive(Debug, Clone)]
pub(super) struct Rig {
    pub(super) skeleton: Skeleton,
    pub(super) rest_globals: Vec<Affine3A>,
    pub(super) root_node: Option<usize>,
    pub(super) root_motion: RootMotion,
    /// Only the nodes; the points' bones are the model's.
    pub(super) bones: Bones,
    pub(super) angles: Parametrisation,
    pub(super) default_weights: Vec<f32>,
}

impl Rig {
    /// From a header that has been checked.
    pub(super) fn new(header: &RigHeader) -> Self {
        let nodes = header.nodes.iter().map(|node| Node {
            name: node.name.clone(),
            parent: node.parent.map(|parent| parent as usize),
            rest: Transform {
                translation: Vec3::from_array(node.translation),
                rotation: Quat::from_array(node.rotation),
                scale: Vec3::from_array(node.scale),
            },
        });
        let skeleton = Skeleton { nodes: nodes.collect() };
        let rest: Vec<Transform> = skeleton.nodes.iter().map(|node| node.rest).collect();
        let columns = header
            .columns
            .iter()
            .map(|column| Column { source: source(&column.source), name: column.name.clone() });
        Self {
            rest_globals: skeleton.globals(&rest),
            skeleton,
            root_node: header.root_node.map(|node| node as usize),
            root_motion: match header.root_motion {
                RootMotionHeader::Rigid => RootMotion::Rigid,
                RootMotionHeader::Upright => RootMotion::Upright,
            },
            bones: Bones {
                nodes: header.bones.iter().map(|&node| node as usize).collect(),
                of_point: Vec::new(),
            },
            angles: Parametrisation {
                columns: columns.collect(),
                size_m: header.size_m,
                dropped: header.dropped.clone(),
            },
            default_weights: header.weights.iter().map(|weight| weight.default).collect(),
        }
    }
}

impl RigHeader {
    /// The wire form of a rig and its parametrisation. `weight_names` and `default_weights` are
    /// the mesh's, one per slot.
    #[must_use]
    pub fn new(
        skeleton: &Skeleton,
        (root_node, root_motion): (Option<usize>, RootMotion),
        bones: &Bones,
        angles: &Parametrisation,
        weight_names: &[String],
        default_weights: &[f32],
    ) -> Self {
        let nodes = skeleton.nodes.iter().map(|node| NodeHeader {
            name: node.name.clone(),
            parent: node.parent.map(index),
            translation: node.rest.translation.to_array(),
            rotation: node.rest.rotation.to_array(),
            scale: node.rest.scale.to_array(),
        });
        let columns = angles.columns.iter().map(|column| ColumnHeader {
            name: column.name.clone(),
            source: source_header(column.source),
        });
        let weights = weight_names
            .iter()
            .zip(default_weights)
            .map(|(name, &default)| WeightHeader { name: name.clone(), default });
        Self {
            nodes: nodes.collect(),
            root_node: root_node.map(index),
            bones: bones.nodes.iter().map(|&node| index(node)).collect(),
            weights: weights.collect(),
            columns: columns.collect(),
            size_m: angles.size_m,
            dropped: angles.dropped.clone(),
            root_motion: match root_motion {
                // Fixed is to have no root node.
                RootMotion::Rigid | RootMotion::Fixed => RootMotionHeader::Rigid,
                RootMotion::Upright => RootMotionHeader::Upright,
            },
        }
    }
}

fn source(header: &SourceHeader) -> Source {
    match *header {
        SourceHeader::Rotation { node, axis, mean } => {
            Source::Rotation { node: node as usize, axis, mean: Quat::from_array(mean) }
        }
        SourceHeader::Translation { node, axis, rest } => {
            Source::Translation { node: node as usize, axis, rest }
        }
        SourceHeader::Scale { node, axis, rest } => {
            Source::Scale { node: node as usize, axis, rest }
        }
        SourceHeader::Point { node, axis, offset } => {
            Source::Point { node: node as usize, axis, offset: Vec3::from_array(offset) }
        }
        SourceHeader::Tilt { node, axis, rest } => {
            Source::Tilt { node: node as usize, axis, rest: Quat::from_array(rest) }
        }
        SourceHeader::Height { node, rest } => Source::Height { node: node as usize, rest },
        SourceHeader::Weight { slot } => Source::Weight { slot: slot as usize },
        SourceHeader::Dihedral { points, mean } => Source::Dihedral { corners: points, mean },
    }
}

fn source_header(source: Source) -> SourceHeader {
    match source {
        Source::Rotation { node, axis, mean } => {
            SourceHeader::Rotation { node: index(node), axis, mean: mean.to_array() }
        }
        Source::Translation { node, axis, rest } => {
            SourceHeader::Translation { node: index(node), axis, rest }
        }
        Source::Scale { node, axis, rest } => SourceHeader::Scale { node: index(node), axis, rest },
        Source::Point { node, axis, offset } => {
            SourceHeader::Point { node: index(node), axis, offset: offset.to_array() }
        }
        Source::Tilt { node, axis, rest } => {
            SourceHeader::Tilt { node: index(node), axis, rest: rest.to_array() }
        }
        Source::Height { node, rest } => SourceHeader::Height { node: index(node), rest },
        Source::Weight { slot } => SourceHeader::Weight { slot: index(slot) },
        Source::Dihedral { corners, mean } => SourceHeader::Dihedral { points: corners, mean },
    }
}

fn index(count: usize) -> u32 {
    u32::try_from(count).expect("a rig has fewer than 2^32 nodes and weights")
}
