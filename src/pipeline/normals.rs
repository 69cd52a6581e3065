//! Normals that a pose's own triangles make, where those of the file do not follow the pose.

use super::Error;
use super::recipe::{BakeRecipe, NormalsRecipe};
use super::surroundings::known_meshes;
use crate::pose::PoseSet;
use crate::rig::{self, Deformed, Facets, Mesh, Pose, RigidFrame};
use crate::scene::Scene;

/// Fills in which meshes' normals are computed anew where the recipe leaves it open: those that morph in some
/// pose by targets that all move positions alone. Says so.
pub(super) fn resolve(
    bake: &mut BakeRecipe,
    mesh: &Mesh,
    poses: &PoseSet,
) -> Result<Option<String>, Error> {
    match &bake.recompute_normals {
        Some(NormalsRecipe::All(_)) => return Ok(None),
        Some(NormalsRecipe::Meshes(names)) => known_meshes(names.iter(), &mesh.parts)?,
        None => {
            let names = left_behind(mesh, poses);
            if names.is_empty() {
                return Ok(None);
            }
            bake.recompute_normals = Some(NormalsRecipe::Meshes(names));
        }
    }
    Ok(bake.recompute_normals.as_ref().and_then(NormalsRecipe::meshes).map(|names| {
        let names = names.join(", ");
        format!(
            "morph targets move positions and no normals: each pose is shaded by the normals of its own \
             triangles ({names}; --keep-normals keeps those of the file)"
        )
    }))
}

/// Names of the meshes that some pose morphs, and whose normals no target moves; in order, each once.
fn left_behind(mesh: &Mesh, poses: &PoseSet) -> Vec<String> {
    let used = |weight: usize| poses.samples.iter().any(|s| s.pose.weights[weight] != 0.0);
    let mut names: Vec<String> = Vec::new();
    let mut kept = Vec::new();
    for target in &mesh.morphs {
        let Some(&first) = target.vertices.first() else { continue };
        // A target is of one part.
        let part = mesh.parts.iter().find(|part| part.vertices.contains(&(first as usize)));
        let Some(part) = part else { continue };
        if !target.normal_deltas.is_empty() {
            kept.push(&part.name);
        } else if !names.contains(&part.name) && used(target.weight) {
            names.push(part.name.clone());
        }
    }
    names.retain(|name| !kept.contains(&name));
    names
}

/// What computes the normals of a scene's poses, where any are.
pub(super) fn facets(bake: &BakeRecipe, scene: &Scene) -> Option<Facets> {
    let mesh = &scene.mesh;
    let vertices = match bake.recompute_normals.as_ref()? {
        NormalsRecipe::All(false) => return None,
        NormalsRecipe::All(true) => std::iter::once(0..mesh.positions.len()).collect(),
        NormalsRecipe::Meshes(names) => {
            let named = mesh.parts.iter().filter(|part| names.contains(&part.name));
            named.map(|part| part.vertices.clone()).collect()
        }
    };
    let rest = Pose::rest(&scene.skeleton, &mesh.default_weights);
    let globals = scene.skeleton.globals(&rest.local);
    let mut posed = Deformed::default();
    rig::deform(mesh, &globals, &rest.weights, RigidFrame::IDENTITY, &mut posed);
    Some(Facets::new(&posed, &mesh.triangles).only(vertices))
}

#[cfg(test)]
#[path = "normals_tests.rs"]
mod tests;
