//! Reflection towards an eye: a model of visibility, a light and a reflectance as radiance by vertex.

use std::sync::Arc;

use glam::{Mat3, Quat, Vec3};

use super::EvaluateError;
use super::evaluate::{Query, spread};
use super::evaluate_posed::{of_scene, places, surface};
use crate::model::{Model, Signal};
use crate::num::cpu::Isa;
use crate::rig::to_tangent_frame;
use crate::scene::Scene;
use crate::sh::Rotation;
use crate::shade::{Reflector, ShLight, ShadedPoints, ZonalLight};

/// Terms of an operator where nobody says how many: 8.5 KB at order 4.
pub const GLOSS_TERMS: usize = 8;

/// Lobes that a light is fitted with where nobody says how many.
pub const GLOSS_LOBES: usize = 8;

/// A light as lobes and a reflectance as an operator, ready for a model of visibility.
#[derive(Debug, Clone)]
pub struct Gloss {
    lobes: ZonalLight,
    reflector: Arc<Reflector>,
    notices: Vec<String>,
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
        Self { lobes, reflector: Arc::new(reflector), notices: Vec::new() }
    }

    /// The same with what is to be said of the reflectance, in sentences.
    #[must_use]
    pub fn with_notices(self, notices: Vec<String>) -> Self {
        Self { notices, ..self }
    }

    /// What is to be said of the reflectance.
    #[must_use]
    pub fn notices(&self) -> &[String] {
        &self.notices
    }

    /// Whether the model carries the tangents that a grain runs along; without a grain any will do.
    ///
    /// # Errors
    /// [`EvaluateError::NeedsTangents`].
    pub fn check_grain(&self, model: &Model) -> Result<(), EvaluateError> {
        if self.reflector.header().isotropic || model.turns_with_tangents() {
            return Ok(());
        }
        Err(EvaluateError::NeedsTangents(model.header().frame.name()))
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
        Self { lobes, ..self.clone() }
    }

    /// Radiance towards an eye at points: many at once, their visibility turned into their tangent
    /// frames, where the light arrives as lobes.
    ///
    /// # Panics
    /// If the lengths do not agree.
    pub(super) fn shade(&self, points: GlossPoints<'_>) -> Vec<[f32; 3]> {
        let order = self.reflector.order();
        let count = order.coefficients();
        let GlossPoints { visibility, is_local, positions, to_local, eye } = points;
        let mut rotation = Rotation::identity(order);
        let mut out = vec![[0.0; 3]; positions.len()];
        let mut turned = vec![0.0; BLOCK.min(out.len()) * count];
        let (mut frames, mut outgoing) = (Vec::new(), Vec::new());
        let blocks = out.chunks_mut(BLOCK).zip(visibility.chunks(BLOCK * count));
        for ((out, own), at) in blocks.zip((0..).step_by(BLOCK)) {
            let range = at..at + out.len();
            let turns = &to_local[range.clone()];
            let turned = &mut turned[..own.len()];
            if !is_local {
                let rows = turned.chunks_exact_mut(count).zip(own.chunks_exact(count));
                for ((turned, own), turn) in rows.zip(turns) {
                    rotation.set(*turn);
                    rotation.apply(own, turned);
                }
            }
            let visibility = if is_local { own } else { &*turned };
            frames.clear();
            frames.extend(turns.iter().map(|turn| Mat3::from_quat(*turn)));
            outgoing.clear();
            let towards = |(at, turn): (&Vec3, &Quat)| *turn * (eye - *at).normalize_or_zero();
            outgoing.extend(positions[range].iter().zip(turns).map(towards));
            let points = ShadedPoints { to_local: &frames, outgoing: &outgoing, visibility };
            self.reflector.shade_points(Isa::best(), &self.lobes, points, out);
        }
        out
    }
}

/// Points whose visibility is turned and shaded together.
const BLOCK: usize = 512;

/// Points to be shaded, all in one frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct GlossPoints<'a> {
    /// `[point][coefficient]`
    pub(super) visibility: &'a [f32],
    /// Whether visibility is in the tangent frames already.
    pub(super) is_local: bool,
    pub(super) positions: &'a [Vec3],
    /// Into the tangent frame of each.
    pub(super) to_local: &'a [Quat],
    pub(super) eye: Vec3,
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

    /// `[point, coefficient]` in the model's own frame.
    fn local_coefficients(&self, model: &Model) -> Result<Vec<f32>, EvaluateError> {
        let header = model.header();
        let mut out = vec![0.0; header.mesh.points as usize * header.width()];
        model.evaluate(&self.parameters, None, &mut out)?;
        Ok(out)
    }

    /// Appends the radiance towards an eye at the listed vertices, or at all: `[vertex, 3]`. The eye is
    /// in the root frame, metres, and so are the unit tangents of all vertices that a grain runs along,
    /// those of a model in the tangent frame when absent. The query must be [`Query::posed`].
    ///
    /// # Errors
    /// [`EvaluateError::NeedsMesh`]; [`EvaluateError::NeedsTangents`] of a grain where there are none;
    /// what the model objects to.
    pub fn reflected(
        &self,
        model: &Model,
        (gloss, eye, tangents): (&Gloss, Vec3, Option<&[Vec3]>),
        vertices: Option<&[u32]>,
        out: &mut Vec<f32>,
    ) -> Result<(), EvaluateError> {
        let mesh = self.surface.as_ref().ok_or(EvaluateError::NeedsMesh)?;
        if tangents.is_none() {
            gloss.check_grain(model)?;
        }
        let tangents = tangents.map(|tangents| places(model, tangents.iter().copied()));
        let with = |tangents: &[Vec3]| -> Vec<Quat> {
            let frames = mesh.normals.iter().zip(tangents);
            frames.map(|(&normal, &tangent)| to_tangent_frame(normal, tangent)).collect()
        };
        // Visibility that comes in the tangent frame meets the operator as it is, unless the grain runs
        // along other tangents.
        let has_own = tangents.is_none() && model.turns_with_tangents();
        let is_local = has_own && model.decodes_alone();
        let visibility = match is_local {
            true => self.local_coefficients(model)?,
            false => self.coefficients(model)?.0,
        };
        let to_local: Vec<Quat> = match &tangents {
            Some(tangents) => with(tangents),
            None if has_own => with(&mesh.tangents),
            None => mesh.normals.iter().copied().map(upright).collect(),
        };
        let (positions, to_local, visibility) =
            (&mesh.positions[..], &to_local[..], &visibility[..]);
        let points = GlossPoints { visibility, is_local, positions, to_local, eye };
        let shaded = gloss.shade(points).into_flattened();
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
        let gloss = Gloss::of(&light, reflector, 3);
        let mut open = [0.0; 16];
        open[0] = (4.0 * std::f32::consts::PI).sqrt();
        for normal in [Vec3::Y, Vec3::NEG_Z, Vec3::new(0.6, 0.0, -0.8)] {
            let turned = gloss.turned(Quat::from_rotation_x(0.4));
            // More than one block of points.
            let (positions, to_local) = (vec![Vec3::ONE; 600], vec![upright(normal); 600]);
            let points = GlossPoints {
                visibility: &open.repeat(600),
                is_local: false,
                positions: &positions,
                to_local: &to_local,
                eye: Vec3::ONE + 3.0 * normal,
            };
            let found = turned.shade(points);
            assert!(found.len() == 600 && found.iter().all(|colour| *colour == found[0]));
            for (found, albedo) in found[0].iter().zip([0.5, 0.25, 1.0]) {
                assert!((found - 2.0 * albedo).abs() < 1e-4, "{found} {albedo}");
            }
        }
    }
}
