//! Which vertices of a scene the values of a model are at.
//!
//! A model's vertices are those of the scene that it was baked from, without the nodes that only blocked,
//! and behind them those of its receivers, which lie in another file. A model that was attached to another
//! scene ([`super::rebind()`]) has all of that scene's.

use std::borrow::Cow;

use super::surroundings::carried;
use super::{EvaluateError, recipe_of_model};
use crate::model::Model;
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
/// [`EvaluateError::Vertices`] where the model is of another scene.
pub fn valued<'a>(model: &Model, scene: &'a Scene) -> Result<Valued<'a>, EvaluateError> {
    let around = recipe_of_model(model).map(|recipe| recipe.bake.surroundings).unwrap_or_default();
    let known = |name: &&String| scene.skeleton.find(name).is_some();
    let names: Vec<String> = around.occluder_nodes.iter().filter(known).cloned().collect();
    let out = carried(&scene.skeleton, &names).unwrap_or_default();
    let is_out = |node: usize| out.get(node).copied().unwrap_or(false);
    let kept: Vec<_> = scene.mesh.parts.iter().filter(|part| !is_out(part.node)).collect();

    let (all, expected) = (scene.mesh.positions.len(), model.header().mesh.vertices as usize);
    let own: usize = kept.iter().map(|part| part.vertices.len()).sum();
    let of_model = model.header().mesh.parts.iter().map(|part| part.vertices as usize);
    let alike = kept.iter().zip(of_model).all(|(part, count)| part.vertices.len() == count);
    let whole = own == expected && (alike || all != expected);
    let receives = around.receivers.is_some() && own < expected && alike;
    if own > 0 && (whole || receives) {
        let first_vertices = kept.iter().map(|part| part.vertices.start).collect();
        let mut scene = Cow::Borrowed(scene);
        if own < all {
            let kept = scene.mesh.split(|part| is_out(part.node)).0;
            scene.to_mut().mesh = kept;
        }
        return Ok(Valued { scene, receivers: expected - own, first_vertices, taken: all - own });
    }
    if all == expected {
        let first_vertices = scene.mesh.parts.iter().map(|part| part.vertices.start).collect();
        return Ok(Valued { scene: Cow::Borrowed(scene), receivers: 0, first_vertices, taken: 0 });
    }
    Err(EvaluateError::Vertices { found: own, expected })
}

#[cfg(test)]
#[path = "valued_tests.rs"]
mod tests;
