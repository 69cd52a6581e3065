//! Shading of a visibility model's vertices by a reflection operator.

use glam::{DQuat, Mat3, Quat, Vec3};

use super::evaluate::{EvaluateError, Query};
use crate::model::Model;
use crate::rig::Deformed;
use crate::sh::{MAX_COEFFICIENTS, Rotation};
use crate::shade::{Reflector, ShLight, ZonalLight};

/// Lobes that the light is fitted with.
const LOBES: usize = 8;

/// Radiance towards an eye at every vertex, three colours each: the model's visibility is turned
/// into each vertex's tangent frame, the light arrives there as lobes. For isotropic reflectances,
/// since any tangent will do for them.
///
/// # Errors
/// What the model objects to.
pub(super) fn radiance(
    (model, query): (&Model, &Query),
    mesh: &Deformed,
    (light, reflector): (&ShLight, &Reflector),
    eye: Vec3,
) -> Result<Vec<f32>, EvaluateError> {
    let mut visibility = Vec::new();
    query.values(model, None, None, &mut visibility)?;
    let root = query.root_frame(model)?.rotation;
    let to_root = root.inverse();
    let turned = DQuat::from_array(root.to_array().map(f64::from)).inverse();
    let lobes = ZonalLight::fit(&light.rotated(turned), LOBES);
    let order = reflector.order();
    let count = order.coefficients();
    let mut rotation = Rotation::identity(order);
    let mut out = Vec::with_capacity(3 * mesh.positions.len());
    let rows = visibility.chunks_exact(count);
    for ((v, &position), &normal) in rows.zip(&mesh.positions).zip(&mesh.normals) {
        let to_local = Quat::from_rotation_arc(to_root * normal, Vec3::Z);
        rotation.set(to_local);
        let (mut local, mut light) = ([0.0; MAX_COEFFICIENTS], [[0.0; MAX_COEFFICIENTS]; 3]);
        rotation.apply(v, &mut local);
        let [r, g, b] = &mut light;
        lobes.in_frame(Mat3::from_quat(to_local), [r, g, b]);
        let outgoing = to_local * (to_root * (eye - position).normalize_or_zero());
        out.extend(reflector.shade(&local, [&light[0], &light[1], &light[2]], outgoing));
    }
    Ok(out)
}
