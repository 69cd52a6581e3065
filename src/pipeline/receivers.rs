//! Receivers: geometry of another file that the character casts its shadow on (Nowrouzezahrai et al.
//! 2007, section 8: a receiver bound to the articulated character).
//!
//! They are points of the bake and of the model like any other, behind those of the character, and block
//! only themselves and one another. They keep their place in the root frame, so what is taken out of the
//! character's motion, its parameters and poses are those of a bake without them.

use glam::Affine3A;

use super::recipe::Recipe;
use super::recipe::surroundings::ReceiversRecipe;
use super::{Error, hash};
use crate::bake::View;
use crate::pose::PoseSet;
use crate::rig::{self, Deformed, Mesh, Points, Pose, RigidFrame};
use crate::scene::{Scene, Source, Surface};

/// Before the names of a receivers' scene's files among a data set's sources.
pub(super) const PREFIX: &str = "receivers:";

/// Where the receivers are among the scene's vertices and triangles. The default is none.
#[derive(Debug, Clone, Default)]
pub struct Receivers {
    /// Their first part, vertex and triangle; nothing where there are none.
    first: Option<(usize, usize, usize)>,
    /// In the root frame of every pose.
    place: Deformed,
    /// What they let through.
    surface: Option<Surface>,
    /// The files that they came from.
    sources: Vec<Source>,
}

impl Receivers {
    /// Checks what the recipe names, and fills in its name and hash.
    pub(super) fn resolve(
        scene: &Scene,
        receivers: Option<&Scene>,
        recipe: &mut Recipe,
    ) -> Result<(), Error> {
        let named = &mut recipe.bake.surroundings.receivers;
        let fault = match (named, receivers) {
            (None, None) => return Ok(()),
            (Some(ReceiversRecipe { file, sha256 }), Some(receivers)) => {
                let found = hash::scene(&receivers.sources);
                if !hash::same_contents(&receivers.sources, &scene.sources) {
                    *file = receivers.sources.first().map(|s| s.name.clone()).unwrap_or_default();
                    *sha256 = Some(found);
                    return Ok(());
                }
                "the receivers' file is the scene itself, whose points get values anyway".to_owned()
            }
            (Some(named), None) => format!("the receivers' file {:?} was not read", named.file),
            (None, Some(_)) => "there are receivers that the recipe does not name".to_owned(),
        };
        Err(Error::Surroundings(fault))
    }

    /// Appends a scene at rest to the mesh of another, bound to the node whose motion is taken out.
    pub(super) fn add(scene: &mut Scene, poses: &PoseSet, receivers: Option<Scene>) -> Self {
        let Some(receivers) = receivers else { return Self::default() };
        let rest = Pose::rest(&receivers.skeleton, &receivers.mesh.default_weights);
        let globals = receivers.skeleton.globals(&rest.local);
        let mut place = Deformed::default();
        rig::deform(&receivers.mesh, &globals, &rest.weights, RigidFrame::IDENTITY, &mut place);
        place.normals.iter_mut().for_each(|normal| *normal = normal.normalize_or_zero());
        let mesh = &scene.mesh;
        let first = Some((mesh.parts.len(), mesh.positions.len(), mesh.triangles.len()));
        let node = poses.root_node.unwrap_or(0);
        let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
        let rest = scene.skeleton.globals(&rest.local).get(node).copied();
        let carrier = (node, rest.unwrap_or(Affine3A::IDENTITY));
        scene.mesh.carry(carrier, &place, &receivers.mesh.triangles, &receivers.mesh.parts);
        let name = |source: Source| Source { name: format!("{PREFIX}{}", source.name), ..source };
        let told = receivers.notices.into_iter().map(|notice| format!("receivers: {notice}"));
        scene.notices.extend(told);
        let sources = receivers.sources.into_iter().map(name).collect();
        Self { first, place, surface: receivers.surface, sources }
    }

    /// How many parts a mesh has before the receivers'.
    pub(super) fn parts_before(&self, mesh: &Mesh) -> usize {
        self.first.map_or(mesh.parts.len(), |(part, ..)| part)
    }

    /// What they let through, where that is known.
    pub(super) fn surface(&self) -> Option<&Surface> {
        self.surface.as_ref()
    }

    /// The files, as they go into a data set.
    pub(super) fn sources(&self) -> &[Source] {
        &self.sources
    }

    /// Puts the receivers of a mesh in the root frame in their place.
    pub(super) fn settle(&self, out: &mut Deformed) {
        let Some((_, vertex, _)) = self.first else { return };
        let range = vertex..vertex + self.place.positions.len();
        out.positions[range.clone()].copy_from_slice(&self.place.positions);
        out.normals[range].copy_from_slice(&self.place.normals);
    }

    /// Cuts a mesh to what is not a receiver.
    pub(super) fn without(&self, mut out: Deformed) -> Deformed {
        if let Some((_, vertex, _)) = self.first {
            out.positions.truncate(vertex);
            out.normals.truncate(vertex);
        }
        out
    }

    /// Hides the receivers, which end at `triangles`, from all points but their own.
    pub(super) fn hide(&self, views: &mut Vec<View>, points: &Points, triangles: usize) {
        let Some((_, vertex, triangle)) = self.first else { return };
        let hidden = triangle..triangles;
        let mut others: Vec<u32> = points.of_vertex[..vertex].to_vec();
        others.sort_unstable();
        others.dedup();
        for view in views.iter_mut() {
            // A view of receivers alone sees them.
            if view.points.first().is_some_and(|point| others.binary_search(point).is_ok()) {
                view.hidden.push(hidden.clone());
            }
        }
        for view in views.iter() {
            others.retain(|point| view.points.binary_search(point).is_err());
        }
        views.push(View { points: others, hidden: vec![hidden] });
    }
}

#[cfg(test)]
#[path = "receivers_tests.rs"]
mod tests;
