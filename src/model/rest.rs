//! The rest mesh inside a model, for callers who have poses but no posed mesh.
//!
//! Models that look at the posed mesh ([`Model::needs_surface`]) take it from an engine, which has
//! skinned it anyway. A caller who only knows joint rotations, such as one over HTTP, has none: on
//! request the blob carries the points at rest with everything that moves them, and the model
//! skins them itself.

use std::sync::Arc;

use glam::{Affine3A, Vec3};
use serde::{Deserialize, Serialize};

use super::header::{check_finite, check_index, field, within};
use super::{Error, Model, PosedPoints, limits};
use crate::rig::{
    Deformed, Deformer, Influence, Mesh, MorphTarget, Pose, Tangents, deform, tangents_from_bytes,
};

/// How much a rest mesh has of what moves it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RestSizes {
    /// Nodes with their inverse bind matrices.
    pub deformers: u32,
    /// Weights of all points together.
    pub influences: u32,
    /// Morph targets.
    pub morphs: u32,
    /// Displaced points of all morph targets together.
    pub deltas: u32,
}

impl RestSizes {
    /// Of a mesh.
    #[must_use]
    pub fn of(mesh: &Mesh) -> Self {
        Self {
            deformers: mesh.deformers.len() as u32,
            influences: mesh.influences.len() as u32,
            morphs: mesh.morphs.len() as u32,
            deltas: mesh.morphs.iter().map(|target| target.vertices.len() as u32).sum(),
        }
    }

    /// Before anything is read that large.
    pub(super) fn check(self) -> Result<(), Error> {
        within("deformers of the rest mesh", u64::from(self.deformers), limits::NODES)?;
        within("influences of the rest mesh", u64::from(self.influences), limits::POINTS)?;
        within("morph targets of the rest mesh", u64::from(self.morphs), limits::NODES)?;
        within("displacements of the rest mesh", u64::from(self.deltas), limits::POINTS)
    }
}

impl Model {
    /// The same model with its points at rest and what moves them: `mesh` has one vertex per point
    /// in their order, the nodes of the model's rig, and needs no triangles.
    ///
    /// # Errors
    /// Lengths, indices and numbers that do not fit the model.
    pub fn with_rest(mut self, mesh: Mesh) -> Result<Self, Error> {
        let mesh = Mesh { triangles: Vec::new(), parts: Vec::new(), ..mesh };
        let weights = self.rig.default_weights.len();
        check(&mesh, (self.shape.points, self.rig.skeleton.nodes.len(), weights))?;
        self.header.rest = Some(RestSizes::of(&mesh));
        self.rest = Some(Arc::new(mesh));
        self.carry_tangents();
        Ok(self)
    }

    /// Brings the tangents into the rest mesh's own space, where the model has both.
    pub(super) fn carry_tangents(&mut self) {
        let carried = |mesh: &Arc<Mesh>| {
            Arc::new(Tangents::of(&self.rig.skeleton, mesh, &tangents_from_bytes(&self.tangents)))
        };
        self.carried = self.rest.as_ref().filter(|_| !self.tangents.is_empty()).map(carried);
    }

    /// The points at rest, where the model carries them.
    #[must_use]
    pub fn rest(&self) -> Option<&Mesh> {
        self.rest.as_deref()
    }

    /// The posed points in the root frame, as [`super::PosedInput`] takes them; `None` where the
    /// model does not carry its rest mesh.
    ///
    /// # Errors
    /// As [`Model::parameters_of_pose`].
    pub fn surface_of(&self, pose: &Pose) -> Result<Option<PosedPoints>, Error> {
        let Some(mesh) = &self.rest else { return Ok(None) };
        let root = self.root_frame_of(pose)?;
        let globals = self.rig.skeleton.globals(&pose.local);
        let mut out = Deformed::default();
        deform(mesh, &globals, &pose.weights, root, &mut out);
        let Deformed { positions, normals } = out;
        let mut tangents = Vec::new();
        if let Some(carried) = &self.carried {
            carried.pose(mesh, &globals, root, &normals, &mut tangents);
        }
        Ok(Some(PosedPoints { positions, normals, tangents }))
    }
}

/// A mesh in flat arrays, as the blob stores it.
#[derive(Debug, Clone, Default)]
pub(super) struct Arrays {
    /// `[point, 3]`, metres.
    pub(super) positions: Vec<f32>,
    /// `[point, 3]`.
    pub(super) normals: Vec<f32>,
    /// `[deformer, 12]`: the columns of the matrix, the translation last.
    pub(super) binds: Vec<f32>,
    /// `[influence]`.
    pub(super) weights: Vec<f32>,
    /// `[delta, 3]`, metres.
    pub(super) position_deltas: Vec<f32>,
    /// `[delta, 3]`, zeros where a target has none.
    pub(super) normal_deltas: Vec<f32>,
    /// `[deformer]`, nodes of the rig.
    pub(super) nodes: Vec<u32>,
    /// `[point]`: how many influences it has.
    pub(super) counts: Vec<u32>,
    /// `[influence]`, deformers.
    pub(super) deformers: Vec<u32>,
    /// `[morph]`: the morph weight of each target.
    pub(super) slots: Vec<u32>,
    /// `[morph]`: how many points it displaces.
    pub(super) lengths: Vec<u32>,
    /// `[delta]`, points.
    pub(super) displaced: Vec<u32>,
}

impl Arrays {
    pub(super) fn of(mesh: &Mesh) -> Self {
        let flat =
            |vectors: &[Vec3]| -> Vec<f32> { vectors.iter().flat_map(Vec3::to_array).collect() };
        let mut out = Self {
            positions: flat(&mesh.positions),
            normals: flat(&mesh.normals),
            binds: mesh.deformers.iter().flat_map(|d| d.inverse_bind.to_cols_array()).collect(),
            weights: mesh.influences.iter().map(|influence| influence.weight).collect(),
            nodes: mesh.deformers.iter().map(|deformer| deformer.node as u32).collect(),
            counts: mesh.influence_starts.windows(2).map(|pair| pair[1] - pair[0]).collect(),
            deformers: mesh.influences.iter().map(|influence| influence.deformer).collect(),
            ..Self::default()
        };
        for target in &mesh.morphs {
            out.slots.push(target.weight as u32);
            out.lengths.push(target.vertices.len() as u32);
            out.displaced.extend_from_slice(&target.vertices);
            out.position_deltas.extend(flat(&target.position_deltas));
            match target.normal_deltas.is_empty() {
                true => out.normal_deltas.resize(out.position_deltas.len(), 0.0),
                false => out.normal_deltas.extend(flat(&target.normal_deltas)),
            }
        }
        out
    }

    /// The mesh of these arrays, whose counts must add up to what is there; [`Model::with_rest`]
    /// checks the rest.
    pub(super) fn mesh(self) -> Result<Mesh, Error> {
        let vectors = |flat: &[f32]| -> Vec<Vec3> {
            flat.as_chunks().0.iter().copied().map(Vec3::from_array).collect()
        };
        let mut influence_starts = vec![0_u32];
        let mut next = 0_u64;
        for &count in &self.counts {
            next += u64::from(count);
            within("influences of the rest mesh", next, self.deformers.len() as u64)?;
            influence_starts.push(next as u32);
        }
        let binds = self.binds.as_chunks::<12>().0.iter();
        let deformers = self.nodes.iter().zip(binds).map(|(&node, columns)| Deformer {
            node: node as usize,
            inverse_bind: Affine3A::from_cols_array(columns),
        });
        let influences = self.deformers.iter().zip(&self.weights);
        let influences = influences.map(|(&deformer, &weight)| Influence { deformer, weight });
        let (places, turns) = (vectors(&self.position_deltas), vectors(&self.normal_deltas));
        let (mut morphs, mut first) = (Vec::new(), 0_usize);
        for (&slot, &length) in self.slots.iter().zip(&self.lengths) {
            let range = first..first.saturating_add(length as usize);
            let whole = self.displaced.get(range.clone());
            let vertices = whole.ok_or_else(|| wrong("map.rest_lengths", "they end too late"))?;
            morphs.push(MorphTarget {
                weight: slot as usize,
                vertices: vertices.to_vec(),
                position_deltas: places[range.clone()].to_vec(),
                normal_deltas: turns[range.clone()].to_vec(),
            });
            first = range.end;
        }
        Ok(Mesh {
            positions: vectors(&self.positions),
            normals: vectors(&self.normals),
            deformers: deformers.collect(),
            influences: influences.collect(),
            influence_starts,
            morphs,
            ..Mesh::default()
        })
    }
}

fn wrong(what: &str, problem: &str) -> Error {
    field(what, problem)
}

/// Everything that [`deform`] relies on.
fn check(mesh: &Mesh, (points, nodes, weights): (usize, usize, usize)) -> Result<(), Error> {
    for (name, found, expected) in [
        ("rest.positions", mesh.positions.len(), points),
        ("rest.normals", mesh.normals.len(), points),
        ("map.rest_counts", mesh.influence_starts.len(), points + 1),
        (
            "map.rest_deformers",
            mesh.influences.len(),
            mesh.influence_starts.last().map_or(0, |&end| end as usize),
        ),
    ] {
        if found != expected {
            return Err(Error::Length { what: name.to_owned(), found, expected });
        }
    }
    if !mesh.influence_starts.is_sorted() {
        return Err(wrong("map.rest_counts", "the influences of the points are out of order"));
    }
    let flat = Arrays::of(mesh);
    for (name, values) in [
        ("rest.positions", &flat.positions),
        ("rest.normals", &flat.normals),
        ("rest.binds", &flat.binds),
        ("rest.weights", &flat.weights),
        ("rest.position_deltas", &flat.position_deltas),
        ("rest.normal_deltas", &flat.normal_deltas),
    ] {
        check_finite(name, values)?;
    }
    let indices = [
        ("a node of the rest mesh", &flat.nodes, nodes),
        ("a deformer of the rest mesh", &flat.deformers, mesh.deformers.len()),
        ("a morph weight of the rest mesh", &flat.slots, weights),
        ("a displaced point of the rest mesh", &flat.displaced, points),
    ];
    for (what, list, count) in indices {
        if let Some(&index) = list.iter().find(|&&index| index as usize >= count) {
            check_index(what, index, count)?;
        }
    }
    let lists = |target: &MorphTarget| {
        let normals = target.normal_deltas.len();
        let count = target.vertices.len();
        target.position_deltas.len() == count && (normals == count || normals == 0)
    };
    match mesh.morphs.iter().all(lists) {
        true => Ok(()),
        false => Err(wrong("rest.position_deltas", "a morph target has not one per point")),
    }
}

#[cfg(test)]
mod tests;
