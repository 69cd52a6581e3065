//! Poses in other forms: joints of a model that looks at the posed mesh, with the scene beside them,
//! and meshes that are given by their vertices.

use std::borrow::Cow;

use glam::{Affine3A, Vec3};

use super::EvaluateError;
use super::evaluate::{Query, node_order, parameters};
use super::valued::valued_by_count;
use super::{normals, recipe_of_model};
use crate::model::{JointPose, Model, PosedPoints, SourceHeader};
use crate::rig::{self, Deformed, Facets, Pose, RigidFrame, Tangents};
use crate::scene::Scene;

impl Query {
    /// A pose given by joints and morph weights, with the scene that the model is of: for models
    /// that look at the posed mesh, and right for every other.
    ///
    /// # Errors
    /// As [`Query::from_joints`] and [`Query::from_pose`].
    pub fn from_joints_in(
        model: &Model,
        scene: &Scene,
        joints: &JointPose,
    ) -> Result<Self, EvaluateError> {
        let pose = of_scene(model, scene, &model.pose_of(joints)?)?;
        Self::from_pose(model, scene, &pose)
    }

    /// A pose given by the vertices of the posed mesh, `[vertex, 3]` in metres, in the order of the
    /// scene's mesh. For models whose parameters are dihedral angles, such as those of cloth and of
    /// vertex sequences, and for models without parameters.
    ///
    /// # Errors
    /// [`EvaluateError::NeedsJoints`], [`EvaluateError::NeedsScene`], [`EvaluateError::Positions`],
    /// [`EvaluateError::PositionNotFinite`].
    pub fn from_positions(model: &Model, positions: &[f32]) -> Result<Self, EvaluateError> {
        check_positions(model, positions)?;
        let pose = model.pose_of(&JointPose::default())?;
        if model.needs_surface() {
            return Err(EvaluateError::NeedsScene);
        }
        let given = positions.chunks_exact(3).map(Vec3::from_slice);
        let parameters = model.parameters_of_posed(&pose, &places(model, given))?;
        Ok(Self { parameters, surface: None, pose: Some(pose) })
    }

    /// The same with the scene that the model is of: a model that looks at the posed mesh sees these
    /// very positions, with normals by the scene's triangles.
    ///
    /// # Errors
    /// As [`Query::from_positions`], but never [`EvaluateError::NeedsScene`];
    /// [`EvaluateError::Vertices`] of another scene.
    pub fn from_positions_in(
        model: &Model,
        scene: &Scene,
        positions: &[f32],
    ) -> Result<Self, EvaluateError> {
        check_positions(model, positions)?;
        let pose = model.pose_of(&JointPose::default())?;
        let scene = &*own(model, scene)?;
        let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
        let globals = scene.skeleton.globals(&rest.local);
        let root = model.root_frame_of(&pose)?;
        let mut posed = Deformed::default();
        rig::deform(&scene.mesh, &globals, &rest.weights, root, &mut posed);
        let facets = Facets::new(&posed, &scene.mesh.triangles);
        let to_root = root.inverse();
        for (place, given) in posed.positions.iter_mut().zip(positions.chunks_exact(3)) {
            *place = to_root.transform_point3(Vec3::from_slice(given));
        }
        facets.apply(&scene.mesh.triangles, &mut posed);
        let points = || of_points((model, scene), (&globals, root), &posed);
        let surface = model.looks_at_mesh().then(points).transpose()?;
        let parameters = parameters(model, &pose, surface.as_ref())?;
        Ok(Self { parameters, surface, pose: Some(pose) })
    }
}

/// A pose in the model's order of nodes as the scene has it; what only the scene has is at rest.
pub(super) fn of_scene(
    model: &Model,
    scene: &Scene,
    of_model: &Pose,
) -> Result<Pose, EvaluateError> {
    let mut pose = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    for (&node, local) in node_order(model, scene)?.iter().zip(&of_model.local) {
        pose.local[node] = *local;
    }
    pose.weights.clone_from(&of_model.weights);
    Ok(pose)
}

/// Whether positions are those of a mesh of the model's size that give all its parameters.
fn check_positions(model: &Model, positions: &[f32]) -> Result<(), EvaluateError> {
    let columns = model.header().rig.columns.iter();
    let others = columns.filter(|c| !matches!(c.source, SourceHeader::Dihedral { .. })).count();
    if others > 0 {
        return Err(EvaluateError::NeedsJoints(others));
    }
    let (vertices, found) = (model.header().mesh.vertices as usize, positions.len());
    if found != 3 * vertices {
        return Err(EvaluateError::Positions { found, vertices });
    }
    match positions.iter().position(|value| !value.is_finite()) {
        Some(at) => Err(EvaluateError::PositionNotFinite(at / 3)),
        None => Ok(()),
    }
}

/// The model's points as the scene poses them, in the root frame. `of_scene` has the scene's order
/// of nodes, `pose` the model's.
pub(super) fn surface(
    model: &Model,
    scene: &Scene,
    of_scene: &Pose,
    pose: &Pose,
) -> Result<PosedPoints, EvaluateError> {
    let scene = &*own(model, scene)?;
    let globals = scene.skeleton.globals(&of_scene.local);
    let mut deformed = Deformed::default();
    let root = model.root_frame_of(pose)?;
    rig::deform(&scene.mesh, &globals, &of_scene.weights, root, &mut deformed);
    if let Some(facets) = anew(model, scene) {
        facets.apply(&scene.mesh.triangles, &mut deformed);
    }
    of_points((model, scene), (&globals, root), &deformed)
}

/// What computes the normals that the model was baked with, where they are not the skin's.
pub(super) fn anew(model: &Model, scene: &Scene) -> Option<Facets> {
    normals::facets(&recipe_of_model(model).ok()?.bake, scene)
}

/// The scene without what only blocks: as many vertices as the model has. Whether they are the model's was
/// asked before, once for all poses.
fn own<'a>(model: &Model, scene: &'a Scene) -> Result<Cow<'a, Scene>, EvaluateError> {
    let expected = model.header().mesh.vertices as usize;
    if scene.mesh.positions.len() == expected {
        return Ok(Cow::Borrowed(scene));
    }
    let valued = valued_by_count(model, scene)?;
    match valued.receivers {
        0 => Ok(valued.scene),
        receivers => Err(EvaluateError::Vertices { found: expected - receivers, expected }),
    }
}

/// What each of the model's points has, from the vertices that it stands for.
fn of_points(
    (model, scene): (&Model, &Scene),
    (globals, root): (&[Affine3A], RigidFrame),
    deformed: &Deformed,
) -> Result<PosedPoints, EvaluateError> {
    let (found, expected) = (deformed.positions.len(), model.header().mesh.vertices as usize);
    if found != expected {
        return Err(EvaluateError::Vertices { found, expected });
    }
    let mut tangents = Vec::new();
    if model.turns_with_tangents() {
        let of_points = rig::tangents_from_bytes(model.tangents());
        let points = model.point_of_vertex().iter();
        let at_rest: Vec<Vec3> = points.map(|&point| of_points[point as usize]).collect();
        let carried = Tangents::of(&scene.skeleton, &scene.mesh, &at_rest);
        carried.pose(&scene.mesh, globals, root, &deformed.normals, &mut tangents);
        tangents = places(model, tangents.into_iter());
    }
    Ok(PosedPoints {
        positions: places(model, deformed.positions.iter().copied()),
        normals: places(model, deformed.normals.iter().copied()),
        tangents,
    })
}

/// Vectors by point of vectors by vertex.
pub(super) fn places(model: &Model, of_vertices: impl Iterator<Item = Vec3>) -> Vec<Vec3> {
    let mut of_points = vec![Vec3::ZERO; model.shape().points];
    for (vector, &point) in of_vertices.zip(model.point_of_vertex()) {
        of_points[point as usize] = vector;
    }
    of_points
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Positions are no pose of a model that has parameters.
    #[test]
    fn joints_are_not_guessed_from_positions() {
        let blob = include_bytes!("../model/blob/golden_v1.safetensors");
        let model = Model::from_bytes(blob).expect("golden");
        let zeros = vec![0.0; 3 * model.header().mesh.vertices as usize];
        let fault = Query::from_positions(&model, &zeros);
        assert!(matches!(fault, Err(EvaluateError::NeedsJoints(1..))), "{fault:?}");
    }
}
