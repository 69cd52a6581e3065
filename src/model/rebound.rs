//! A model attached to another mesh of the same surface.

use super::{Error, Header, MeshIdentity, Model, RigHeader, SourceHeader};
use crate::rig::Mesh;

impl Model {
    /// The same model for a mesh whose vertices take their values from these points; `mesh.points`
    /// is not looked at. Nodes of the rig that `keep` does not keep must carry nothing.
    ///
    /// # Errors
    /// A map that does not fit the mesh, a node that is needed.
    ///
    /// # Panics
    /// If `keep` has not one entry for every node of the rig.
    pub fn rebound(
        &self,
        mesh: MeshIdentity,
        point_of_vertex: Vec<u32>,
        keep: &[bool],
    ) -> Result<Self, Error> {
        assert_eq!(keep.len(), self.header.rig.nodes.len(), "one for every node");
        let mut next = 0;
        let place: Vec<Option<u32>> = keep
            .iter()
            .map(|&keep| {
                next += u32::from(keep);
                keep.then(|| next - 1)
            })
            .collect();
        let header = Header {
            mesh: MeshIdentity { points: self.header.mesh.points, ..mesh },
            rig: self.header.rig.with_nodes(&place)?,
            ..self.header.clone()
        };
        let bones = self.bone_of_point.clone();
        let mut model = Self::new(header, self.decoder(), point_of_vertex, bones)?;
        if let Some(occluders) = self.occluders() {
            model = model.with_occluders(occluders.clone())?;
        }
        if self.turns_with_tangents() {
            model = model.with_tangents(self.tangents().to_vec())?;
        }
        if let Some(rest) = self.rest() {
            let mut deformers = rest.deformers.clone();
            for deformer in &mut deformers {
                deformer.node = moved(&place, deformer.node as u32)? as usize;
            }
            model = model.with_rest(Mesh { deformers, ..rest.clone() })?;
        }
        Ok(model)
    }
}

/// The new place of a node that is needed.
fn moved(place: &[Option<u32>], node: u32) -> Result<u32, Error> {
    place[node as usize].ok_or_else(|| Error::OutOfRange {
        what: "a needed node of the rig".to_owned(),
        found: u64::from(node),
        count: place.iter().flatten().count() as u64,
    })
}

impl RigHeader {
    /// The rig with its nodes at these places; those without one are left out.
    fn with_nodes(&self, place: &[Option<u32>]) -> Result<Self, Error> {
        let mut rig = self.clone();
        rig.nodes.clear();
        for (node, _) in self.nodes.iter().zip(place).filter(|(_, place)| place.is_some()) {
            let mut node = node.clone();
            node.parent = node.parent.map(|parent| moved(place, parent)).transpose()?;
            rig.nodes.push(node);
        }
        for bone in &mut rig.bones {
            *bone = moved(place, *bone)?;
        }
        rig.root_node = rig.root_node.map(|node| moved(place, node)).transpose()?;
        for column in &mut rig.columns {
            match &mut column.source {
                SourceHeader::Rotation { node, .. }
                | SourceHeader::Translation { node, .. }
                | SourceHeader::Scale { node, .. }
                | SourceHeader::Point { node, .. }
                | SourceHeader::Tilt { node, .. }
                | SourceHeader::Height { node, .. } => *node = moved(place, *node)?,
                SourceHeader::Weight { .. } | SourceHeader::Dihedral { .. } => {}
            }
        }
        Ok(rig)
    }
}
