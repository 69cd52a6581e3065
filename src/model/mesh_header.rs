//! What a model's header says of the mesh that it belongs to.

use serde::{Deserialize, Serialize};

use super::header::{check_index, check_name, field, within};
use super::{Error, Model, limits};

/// The mesh that a model was made for.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshIdentity {
    /// SHA-256 of the scene's bytes, 64 lower-case hexadecimal digits.
    pub scene_sha256: String,
    /// SHA-256 of the vertices and triangles themselves, likewise: other files may hold the same ones.
    /// Absent in models that were fitted before there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape_sha256: Option<String>,
    /// The same of the receivers, where there are any; those are in another file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub receivers_sha256: Option<String>,
    /// Vertices in the scene's own order.
    pub vertices: u32,
    /// Merged vertices, what the model evaluates.
    pub points: u32,
    /// Which vertices belong to which primitive; contiguous, covering all vertices.
    pub parts: Vec<PartRange>,
}

/// The vertices of one primitive of one node.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartRange {
    /// Mesh name.
    pub name: String,
    /// Index into `rig.nodes`.
    pub node: u32,
    /// The primitive's index within the node's mesh.
    pub primitive: u32,
    /// First vertex.
    pub first_vertex: u32,
    /// Number of vertices.
    pub vertices: u32,
}

impl MeshIdentity {
    pub(super) fn check(&self, nodes: usize) -> Result<(), Error> {
        let hashes = [
            ("mesh.scene_sha256", Some(&self.scene_sha256)),
            ("mesh.shape_sha256", self.shape_sha256.as_ref()),
            ("mesh.receivers_sha256", self.receivers_sha256.as_ref()),
        ];
        let is_digit = |c: &u8| matches!(c, b'0'..=b'9' | b'a'..=b'f');
        let is_hash = |hash: &String| hash.len() == 64 && hash.as_bytes().iter().all(is_digit);
        for (place, hash) in hashes {
            if hash.is_some_and(|hash| !is_hash(hash)) {
                return Err(field(place, "it is not 64 lower-case hexadecimal digits"));
            }
        }
        within("vertices", u64::from(self.vertices), limits::POINTS)?;
        within("mesh parts", self.parts.len() as u64, limits::PARTS)?;
        if self.points == 0 || self.points > self.vertices {
            let problem = format!("{} points for {} vertices", self.points, self.vertices);
            return Err(field("mesh.points", problem));
        }
        let mut next = 0_u32;
        for (i, part) in self.parts.iter().enumerate() {
            let place = format!("mesh.parts[{i}]");
            check_name(&place, &part.name)?;
            check_index(&format!("{place}.node"), part.node, nodes)?;
            if part.first_vertex != next {
                return Err(field(
                    place,
                    format!("it starts at {}, not {next}", part.first_vertex),
                ));
            }
            next = next
                .checked_add(part.vertices)
                .filter(|&end| end <= self.vertices)
                .ok_or_else(|| field(place, "it reaches beyond the last vertex"))?;
        }
        if !self.parts.is_empty() && next != self.vertices {
            return Err(field("mesh.parts", format!("they end at {next}, not {}", self.vertices)));
        }
        Ok(())
    }
}

impl Model {
    /// The same model with the SHA-256 of its mesh's vertices and triangles, and of those of its receivers.
    ///
    /// # Errors
    /// What is no such hash.
    pub fn with_shapes(mut self, [shape, receivers]: [Option<String>; 2]) -> Result<Self, Error> {
        let mesh = &mut self.header.mesh;
        (mesh.shape_sha256, mesh.receivers_sha256) = (shape, receivers);
        mesh.check(self.header.rig.nodes.len())?;
        Ok(self)
    }
}
