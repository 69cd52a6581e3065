//! Which nodes of a model's rig a new scene must have, and which it may have lost.

use super::RebindError;
use crate::model::{Model, SourceHeader};
use crate::scene::Scene;

/// The nodes of the rig that stay.
#[derive(Debug)]
pub(super) struct Kept<'a> {
    model: &'a Model,
    /// Node → whether it stays.
    pub(super) keep: Vec<bool>,
}

impl Kept<'_> {
    /// Names of the nodes that stay.
    pub(super) fn names(&self) -> Vec<&str> {
        let nodes = self.model.header().rig.nodes.iter().zip(&self.keep);
        nodes.filter(|(_, keep)| **keep).map(|(node, _)| node.name.as_str()).collect()
    }
}

/// Nodes that the scene has stay; those that carry nothing may be gone (exporters drop them).
pub(super) fn kept<'a>(model: &'a Model, scene: &Scene) -> Result<Kept<'a>, RebindError> {
    let rig = &model.header().rig;
    let mut needed = vec![false; rig.nodes.len()];
    rig.bones.iter().chain(&rig.root_node).for_each(|&node| needed[node as usize] = true);
    for column in &rig.columns {
        match column.source {
            SourceHeader::Rotation { node, .. }
            | SourceHeader::Translation { node, .. }
            | SourceHeader::Scale { node, .. }
            | SourceHeader::Point { node, .. }
            | SourceHeader::Tilt { node, .. }
            | SourceHeader::Height { node, .. } => needed[node as usize] = true,
            SourceHeader::Weight { .. } | SourceHeader::Dihedral { .. } => {}
        }
    }
    for deformer in model.rest().iter().flat_map(|mesh| &mesh.deformers) {
        needed[deformer.node] = true;
    }
    // What carries a needed node is needed: parents come first, so children are seen before them.
    for node in (0..rig.nodes.len()).rev() {
        if let Some(parent) = rig.nodes[node].parent {
            needed[parent as usize] |= needed[node];
        }
    }
    let has: Vec<bool> =
        rig.nodes.iter().map(|node| scene.skeleton.find(&node.name).is_some()).collect();
    let pairs = rig.nodes.iter().zip(needed.iter().zip(&has));
    let missing = pairs.filter(|(_, (needed, has))| **needed && !**has);
    let missing: Vec<String> = missing.map(|(node, _)| format!("`{}`", node.name)).collect();
    if !missing.is_empty() {
        return Err(RebindError::Nodes(missing));
    }
    // A node stays only with all that is above it.
    let mut keep = has;
    for node in 0..keep.len() {
        keep[node] &= rig.nodes[node].parent.is_none_or(|parent| keep[parent as usize]);
    }
    Ok(Kept { model, keep })
}
