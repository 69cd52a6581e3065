//! Reflection towards an eye: a model of visibility, a light and a reflectance as radiance by vertex.

use glam::{Mat3, Quat, Vec3};

use super::evaluate::{EvaluateError, Query, spread};
use super::evaluate_posed::{of_scene, places, surface};
use crate::model::{Model, Signal};
use crate::rig::to_tangent_frame;
use crate::scene::Scene;
use crate::sh::{MAX_COEFFICIENTS, Rotation};
use crate::shade::{Reflector, ShLight, ZonalLight};

/// Terms of an operator where nobody says how many: 8.5 KB at order 4.
pub const GLOSS_TERMS: usize = 8;

/// Lobes that a light is fitted with where nobody says how many.
pub const GLOSS_LOBES: usize = 8;

/// A light as lobes and a reflectance as an operator, ready for a model of visibility. For isotropic
/// reflectances, since any tangent will do for them.
#[derive(Debug, Clone)]
pub struct Gloss {
    lobes: ZonalLight,
    reflector: Reflector,
}

impl Gloss {
    /// The light is in the frame of the values, the root frame where poses are known.
    ///
    /// # Errors
    /// [`EvaluateError::NeedsVisibility`] of another signal, [`EvaluateError::Operator`] of another
    /// order than the model's.
    pub fn new(
        model: &Model,
        light: &ShLight,
        reflector: Reflector,
        lobes: usize,
    ) -> Result<Self, EvaluateError> {
        let header = model.header();
        if header.signal != Signal::Visibility {
            return Err(EvaluateError::NeedsVisibility { signal: header.signal.name() });
        }
        let (found, expected) = (reflector.order().get(), header.order);
        if found != expected {
            return Err(EvaluateError::Operator { found, expected });
        }
        Ok(Self::of(light, reflector, lobes))
    }

    /// Without a model: for visibility of the operator's order.
    #[must_use]
    pub fn of(light: &ShLight, reflector: Reflector, lobes: usize) -> Self {
        let lobes = ZonalLight::fit(&light.resized(reflector.order()), lobes);
        Self { lobes, reflector }
    }

    /// The share of the light's energy that the lobes leave out.
    #[must_use]
    pub fn residual(&self) -> f64 {
        self.lobes.residuals().last().copied().unwrap_or(0.0)
    }

    /// The same under the light as another frame has it.
    #[must_use]
    pub fn turned(&self, rotation: Quat) -> Self {
        let lobes = self.lobes.rotated(rotation.as_dquat());
        Self { lobes, reflector: self.reflector.clone() }
    }

    /// Radiance towards an eye at a place, three colours, by the rotation into the place's tangent frame:
    /// visibility is turned into it, the light arrives there as lobes. All in one frame.
    ///
    /// # Panics
    /// If there are fewer than n² numbers of visibility.
    #[must_use]
    pub fn shade(&self, visibility: &[f32], [at, eye]: [Vec3; 2], to_local: Quat) -> [f32; 3] {
        let (mut local, mut light) = ([0.0; MAX_COEFFICIENTS], [[0.0; MAX_COEFFICIENTS]; 3]);
        Rotation::new(self.reflector.order(), to_local).apply(visibility, &mut local);
        let [r, g, b] = &mut light;
        self.lobes.in_frame(Mat3::from_quat(to_local), [r, g, b]);
        let outgoing = to_local * (eye - at).normalize_or_zero();
        self.reflector.shade(&local, [&light[0], &light[1], &light[2]], outgoing)
    }
}

/// The shortest rotation that takes a normal to +Z.
pub(super) fn upright(normal: Vec3) -> Quat {
    Quat::from_rotation_arc(normal, Vec3::Z)
}

impl Query {
    /// The query with the posed mesh beside it, which reflection needs: the model's own where it
    /// carries one, else that of the scene.
    ///
    /// # Errors
    /// [`EvaluateError::NeedsPose`] where only parameters are known, [`EvaluateError::NeedsMesh`]
    /// without a scene where the model carries no mesh.
    pub fn posed(mut self, model: &Model, scene: Option<&Scene>) -> Result<Self, EvaluateError> {
        let pose = self.pose.as_ref().ok_or(EvaluateError::NeedsPose)?;
        if self.surface.is_none() {
            self.surface = match (model.surface_of(pose)?, scene) {
                (None, Some(scene)) => {
                    Some(surface(model, scene, &of_scene(model, scene, pose)?, pose)?)
                }
                (own, _) => own,
            };
        }
        if self.surface.is_none() { Err(EvaluateError::NeedsMesh) } else { Ok(self) }
    }

    /// Appends the radiance towards an eye at the listed vertices, or at all: `[vertex, 3]`. The eye is
    /// in the root frame, metres, and so are the unit tangents of all vertices, without which the
    /// reflectance has no grain. The query must be [`Query::posed`].
    ///
    /// # Errors
    /// [`EvaluateError::NeedsMesh`]; what the model objects to.
    pub fn reflected(
        &self,
        model: &Model,
        (gloss, eye, tangents): (&Gloss, Vec3, Option<&[Vec3]>),
        vertices: Option<&[u32]>,
        out: &mut Vec<f32>,
    ) -> Result<(), EvaluateError> {
        let mesh = self.surface.as_ref().ok_or(EvaluateError::NeedsMesh)?;
        let (visibility, _) = self.coefficients(model)?;
        let rows = visibility.chunks_exact(model.header().width());
        let tangents = tangents.map(|tangents| places(model, tangents.iter().copied()));
        let frame = |point: usize| match &tangents {
            Some(tangents) => to_tangent_frame(mesh.normals[point], tangents[point]),
            None => upright(mesh.normals[point]),
        };
        let shade = |(point, v)| gloss.shade(v, [mesh.positions[point], eye], frame(point));
        let shaded: Vec<f32> = rows.enumerate().flat_map(shade).collect();
        spread(model, &shaded, vertices, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::Order;
    use crate::shade::{Brdf, factor};

    /// Transfer has no gloss, and an operator of another order does not fit.
    #[test]
    fn gloss_needs_visibility() {
        let blob = include_bytes!("../model/blob/golden_v1.safetensors");
        let model = Model::from_bytes(blob).expect("golden");
        let order = Order::new(2).expect("order");
        let operators = factor(&Brdf::Lambert { albedo: [0.5; 3] }, order, 8).expect("factored");
        let reflector = Reflector::new("a", &operators.map(|o| o.operator(1)), [0.0; 3]);
        let light = ShLight::constant(order, [1.0; 3]).expect("light");
        let told = Gloss::new(&model, &light, reflector, 1).expect_err("refused").to_string();
        assert!(told.contains("meets a model of `visibility`"), "{told}");
    }

    /// An open point reflects a constant light by its albedo, wherever it faces and whatever frame the
    /// light is turned to.
    #[test]
    fn open_points_reflect_their_albedo() {
        let order = Order::new(4).expect("order");
        let lambert = Brdf::Lambert { albedo: [0.5, 0.25, 1.0] };
        let operators = factor(&lambert, order, 16).expect("factored").map(|o| o.operator(8));
        let reflector = Reflector::new("a", &operators, [0.0; 3]);
        let light = ShLight::constant(order, [2.0; 3]).expect("light");
        let gloss = Gloss { lobes: ZonalLight::fit(&light, 3), reflector };
        let mut open = [0.0; 16];
        open[0] = (4.0 * std::f32::consts::PI).sqrt();
        for normal in [Vec3::Y, Vec3::NEG_Z, Vec3::new(0.6, 0.0, -0.8)] {
            let turned = gloss.turned(Quat::from_rotation_x(0.4));
            let places = [Vec3::ONE, Vec3::ONE + 3.0 * normal];
            let found = turned.shade(&open, places, upright(normal));
            for (found, albedo) in found.iter().zip([0.5, 0.25, 1.0]) {
                assert!((found - 2.0 * albedo).abs() < 1e-4, "{found} {albedo}");
            }
        }
    }
}
