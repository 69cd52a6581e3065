//! Which vertices of a scene the values of a model are at.
//!
//! A model's vertices are those of the scene that it was baked from, without the nodes that only blocked,
//! and behind them those of its receivers, which lie in another file. A model that was attached to another
//! scene ([`super::rebind()`]) has all of that scene's.

use std::borrow::Cow;

use super::recipe::surroundings::SurroundingsRecipe;
use super::surroundings::carried;
use super::{EvaluateError, hash, recipe_of_model};
use crate::model::Model;
use crate::rig::Part;
use crate::scene::Scene;

/// What of a scene has values of a model.
#[derive(Debug, Clone)]
pub struct Valued<'a> {
    /// The scene without the nodes that only block; its vertices are the model's first ones.
    pub scene: Cow<'a, Scene>,
    /// How many further vertices the model has: those of its receivers.
    pub receivers: usize,
    /// For each part of `scene`, its first vertex in the scene as it was.
    pub first_vertices: Vec<usize>,
    /// Vertices that were taken out.
    pub taken: usize,
}

impl Valued<'_> {
    /// What a picture of `scene` leaves out, a sentence each.
    pub(super) fn untold(&self) -> Vec<String> {
        let Self { taken, receivers, .. } = *self;
        let taken = (taken > 0)
            .then(|| format!("{taken} vertices that only block have no values and are not shown"));
        let receivers = (receivers > 0).then(|| {
            format!("{receivers} vertices of receivers are in another file and not shown")
        });
        taken.into_iter().chain(receivers).collect()
    }
}

/// Takes out of a scene what has no values of a model.
///
/// # Errors
/// [`EvaluateError::Vertices`] and [`EvaluateError::OtherMesh`] where the model is of another mesh.
pub fn valued<'a>(model: &Model, scene: &'a Scene) -> Result<Valued<'a>, EvaluateError> {
    let choice = Choice::new(model, scene);
    let Some(hash) = &model.header().mesh.shape_sha256 else { return choice.by_count() };
    let expected = model.header().mesh.vertices as usize;
    if choice.own <= expected && hash::shape(scene, choice.kept.iter().copied()) == *hash {
        return Ok(choice.kept_alone());
    }
    if choice.kept.len() < scene.mesh.parts.len() && hash::shape(scene, &scene.mesh.parts) == *hash
    {
        return Ok(choice.whole());
    }
    choice.by_count()?;
    Err(other_mesh(model, scene))
}

/// [`valued`] without a look at where the vertices are.
pub(super) fn valued_by_count<'a>(
    model: &Model,
    scene: &'a Scene,
) -> Result<Valued<'a>, EvaluateError> {
    Choice::new(model, scene).by_count()
}

/// Refuses a scene that passes for the model's by its number of vertices and is another. One of another
/// number may still tell how the model's rig moves.
///
/// # Errors
/// [`EvaluateError::OtherMesh`].
pub fn check_mesh(model: &Model, scene: &Scene) -> Result<(), EvaluateError> {
    match valued(model, scene) {
        Err(error @ EvaluateError::OtherMesh { .. }) => Err(error),
        _ => Ok(()),
    }
}

/// Refuses receivers that are not those of the model.
///
/// # Errors
/// [`EvaluateError::OtherMesh`].
pub fn check_receivers(model: &Model, receivers: &Scene) -> Result<(), EvaluateError> {
    match &model.header().mesh.receivers_sha256 {
        Some(hash) if hash::shape(receivers, &receivers.mesh.parts) != *hash => {
            Err(EvaluateError::OtherMesh {
                found: name(receivers),
                expected: surroundings(model).receivers.map_or(String::new(), |named| named.file),
            })
        }
        _ => Ok(()),
    }
}

fn other_mesh(model: &Model, scene: &Scene) -> EvaluateError {
    let baked = recipe_of_model(model).map(|recipe| recipe.scene.file).unwrap_or_default();
    EvaluateError::OtherMesh { found: name(scene), expected: baked }
}

/// What a scene's main file is called.
fn name(scene: &Scene) -> String {
    scene.sources.first().map_or("the scene", |source| &source.name).to_owned()
}

fn surroundings(model: &Model) -> SurroundingsRecipe {
    recipe_of_model(model).map(|recipe| recipe.bake.surroundings).unwrap_or_default()
}

/// The hashes that a model's header keeps of a scene without the nodes that only block, and of receivers.
pub(super) fn shapes(
    scene: &Scene,
    receivers: Option<&Scene>,
    around: &SurroundingsRecipe,
) -> [Option<String>; 2] {
    let out = blocking(scene, around);
    let own = hash::shape(scene, scene.mesh.parts.iter().filter(|part| !out[part.node]));
    let receivers = receivers.map(|receivers| hash::shape(receivers, &receivers.mesh.parts));
    [Some(own), receivers]
}

/// Which nodes of a scene only block, or are carried by such a one.
fn blocking(scene: &Scene, around: &SurroundingsRecipe) -> Vec<bool> {
    let known = |name: &&String| scene.skeleton.find(name).is_some();
    let names: Vec<String> = around.occluder_nodes.iter().filter(known).cloned().collect();
    let none = || vec![false; scene.skeleton.nodes.len()];
    carried(&scene.skeleton, &names).unwrap_or_else(|_| none())
}

/// The two meshes of a scene that a model may be of.
struct Choice<'m, 'a> {
    model: &'m Model,
    scene: &'a Scene,
    /// Which nodes only block.
    out: Vec<bool>,
    /// The parts of the others.
    kept: Vec<&'a Part>,
    /// Their vertices.
    own: usize,
    receives: bool,
}

impl<'m, 'a> Choice<'m, 'a> {
    fn new(model: &'m Model, scene: &'a Scene) -> Self {
        let around = surroundings(model);
        let out = blocking(scene, &around);
        let kept: Vec<_> = scene.mesh.parts.iter().filter(|part| !out[part.node]).collect();
        let own = kept.iter().map(|part| part.vertices.len()).sum();
        Self { model, scene, out, kept, own, receives: around.receivers.is_some() }
    }

    /// The one whose number of vertices fits.
    fn by_count(self) -> Result<Valued<'a>, EvaluateError> {
        let mesh = &self.model.header().mesh;
        let (all, expected) = (self.scene.mesh.positions.len(), mesh.vertices as usize);
        let own = self.own;
        let of_model = mesh.parts.iter().map(|part| part.vertices as usize);
        let alike = self.kept.iter().zip(of_model).all(|(part, n)| part.vertices.len() == n);
        let whole = own == expected && (alike || all != expected);
        let receives = self.receives && own < expected && alike;
        if own > 0 && (whole || receives) {
            return Ok(self.kept_alone());
        }
        if all == expected {
            return Ok(self.whole());
        }
        Err(EvaluateError::Vertices { found: own, expected })
    }

    fn kept_alone(self) -> Valued<'a> {
        let (all, own) = (self.scene.mesh.positions.len(), self.own);
        let first_vertices = self.kept.iter().map(|part| part.vertices.start).collect();
        let mut scene = Cow::Borrowed(self.scene);
        if own < all {
            let kept = scene.mesh.split(|part| self.out[part.node]).0;
            scene.to_mut().mesh = kept;
        }
        let expected = self.model.header().mesh.vertices as usize;
        Valued { scene, receivers: expected - own, first_vertices, taken: all - own }
    }

    fn whole(self) -> Valued<'a> {
        let first_vertices = self.scene.mesh.parts.iter().map(|part| part.vertices.start).collect();
        Valued { scene: Cow::Borrowed(self.scene), receivers: 0, first_vertices, taken: 0 }
    }
}

#[cfg(test)]
#[path = "valued_tests.rs"]
mod tests;
