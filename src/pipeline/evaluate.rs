//! A model at poses: from clips, joint rotations or parameters to coefficients or shading by vertex.

use super::EvaluateError;
use super::evaluate_posed::surface;
use crate::model::{Distance, Folded, Frame, JointPose, Model, PosedInput, PosedPoints, Signal};
use crate::pose;
use crate::rig::{Pose, RigidFrame};
use crate::scene::{Clip, Scene};

/// One pose as the model takes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Query {
    pub(super) parameters: Vec<f32>,
    /// Absent where only parameters are known: the values then stay in the model's frame.
    pub(super) pose: Option<Pose>,
    /// Where the model looks at the posed mesh: its points in the root frame.
    pub(super) surface: Option<PosedPoints>,
}

impl Query {
    /// A pose given by the model's own parameters.
    ///
    /// # Errors
    /// [`EvaluateError::NeedsScene`]; a wrong number of parameters.
    pub fn from_parameters(model: &Model, parameters: &[f32]) -> Result<Self, EvaluateError> {
        if !model.decodes_alone() {
            return Err(EvaluateError::NeedsScene);
        }
        model.distance(parameters)?;
        Ok(Self { parameters: parameters.to_vec(), pose: None, surface: None })
    }

    /// A pose given by joints and morph weights; what is not named is at rest.
    ///
    /// # Errors
    /// [`EvaluateError::NeedsScene`]; unknown names, zero quaternions, numbers that are not finite.
    pub fn from_joints(model: &Model, joints: &JointPose) -> Result<Self, EvaluateError> {
        let pose = model.pose_of(joints)?;
        let surface = if model.looks_at_mesh() { model.surface_of(&pose)? } else { None };
        if model.looks_at_mesh() && surface.is_none() {
            return Err(EvaluateError::NeedsScene);
        }
        let parameters = parameters(model, &pose, surface.as_ref())?;
        Ok(Self { parameters, pose: Some(pose), surface })
    }

    /// Poses of a scene's clip at times, seconds on the clip's own clock.
    ///
    /// # Errors
    /// [`EvaluateError::Clip`], [`EvaluateError::Node`], [`EvaluateError::Vertices`].
    pub fn from_clip(
        model: &Model,
        scene: &Scene,
        name: &str,
        times_s: impl IntoIterator<Item = f32>,
    ) -> Result<Vec<Self>, EvaluateError> {
        let clip = find_clip(scene, name)?;
        times_s.into_iter().map(|time_s| Self::at(model, scene, clip, time_s)).collect()
    }

    /// The pose of a scene's clip at one time, seconds on the clip's own clock.
    ///
    /// # Errors
    /// As [`Query::from_clip`].
    pub fn of_clip(
        model: &Model,
        scene: &Scene,
        name: &str,
        time_s: f32,
    ) -> Result<Self, EvaluateError> {
        Self::at(model, scene, find_clip(scene, name)?, time_s)
    }

    fn at(model: &Model, scene: &Scene, clip: &Clip, time_s: f32) -> Result<Self, EvaluateError> {
        let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
        Self::from_pose(model, scene, &pose::evaluate(clip, time_s, &rest))
    }

    /// A pose of a scene, in the scene's order of nodes.
    ///
    /// # Errors
    /// [`EvaluateError::Node`], [`EvaluateError::Vertices`].
    pub fn from_pose(model: &Model, scene: &Scene, of_scene: &Pose) -> Result<Self, EvaluateError> {
        let order = node_order(model, scene)?;
        let local = order.iter().map(|&node| of_scene.local[node]).collect();
        let pose = Pose { local, weights: of_scene.weights.clone() };
        // Its own mesh first: a scene that it was attached to may have merged some of its points.
        let surface = match model.looks_at_mesh().then(|| model.surface_of(&pose)).transpose()? {
            Some(None) => Some(surface(model, scene, of_scene, &pose)?),
            own => own.flatten(),
        };
        let parameters = parameters(model, &pose, surface.as_ref())?;
        Ok(Self { parameters, surface, pose: Some(pose) })
    }

    /// The times of a clip's frames at a rate, seconds from 0; none where there is no such clip.
    #[must_use]
    pub fn times_of(scene: &Scene, name: &str, rate_hz: f32) -> Vec<f32> {
        let clip = scene.clips.iter().find(|clip| clip.name == name);
        let frames = clip.map_or(0, |clip| (clip.duration_s * rate_hz).floor() as usize + 1);
        (0..frames).map(|frame| frame as f32 / rate_hz).collect()
    }

    /// How far the pose is from the training poses.
    ///
    /// # Errors
    /// What [`Model::distance`] objects to.
    pub fn distance(&self, model: &Model) -> Result<Distance, EvaluateError> {
        Ok(model.distance(&self.parameters)?)
    }

    /// The root frame of the pose: a light of the scene is turned by the inverse of its rotation
    /// before it meets the values.
    ///
    /// # Errors
    /// [`EvaluateError::NeedsPose`] where only parameters are known.
    pub fn root_frame(&self, model: &Model) -> Result<RigidFrame, EvaluateError> {
        let pose = self.pose.as_ref().ok_or(EvaluateError::NeedsPose)?;
        Ok(model.root_frame_of(pose)?)
    }

    /// Whether the values come in the root frame, and so can meet a light.
    #[must_use]
    pub fn is_turned(&self, model: &Model) -> bool {
        let header = model.header();
        header.frame == Frame::Root || header.signal == Signal::Ao || self.pose.is_some()
    }

    /// Appends the values of the listed vertices, or of all: `[vertex, channel, coefficient]`, or
    /// `[vertex, colour]` under a light. Gives how far outside its bounds the signal was before it
    /// was brought within them, [`Model::bound`]; nothing under a light.
    ///
    /// # Errors
    /// [`EvaluateError::NeedsPose`] under a light; what the model objects to.
    pub fn values(
        &self,
        model: &Model,
        light: Option<&Light>,
        vertices: Option<&[u32]>,
        out: &mut Vec<f32>,
    ) -> Result<f32, EvaluateError> {
        if light.is_some() && !self.is_turned(model) {
            return Err(EvaluateError::NeedsPose);
        }
        let (points, outside) = match light {
            None => self.coefficients(model)?,
            Some(light) => (self.shading(model, light)?, 0.0),
        };
        spread(model, &points, vertices, out)?;
        Ok(outside)
    }

    /// `[point, colour]`: at the price of a folded model where the model allows it.
    fn shading(&self, model: &Model, light: &Light) -> Result<Vec<f32>, EvaluateError> {
        if model.needs_surface() {
            let (coefficients, _) = self.coefficients(model)?;
            return Ok(light.shade(&coefficients, usize::from(model.header().channels)));
        }
        let mut out = vec![0.0; model.header().mesh.points as usize * light.colours(model)];
        match (&light.folded, &self.pose) {
            (Some(folded), _) => folded.evaluate(&self.parameters, &mut out)?,
            (None, Some(pose)) => {
                let rotations = model.bone_rotations_of(pose)?;
                model.shade(&self.parameters, &light.colours.concat(), &rotations, &mut out)?;
            }
            (None, None) => return Err(EvaluateError::NeedsPose),
        }
        Ok(out)
    }

    pub(super) fn coefficients(&self, model: &Model) -> Result<(Vec<f32>, f32), EvaluateError> {
        let header = model.header();
        let mut out = vec![0.0; header.mesh.points as usize * header.width()];
        let Some(pose) = &self.pose else {
            model.evaluate(&self.parameters, None, &mut out)?;
            let outside = model.bound(&mut out);
            return Ok((out, outside));
        };
        let surface = self.surface.as_ref().map(PosedPoints::as_surface);
        let input = PosedInput {
            parameters: &self.parameters,
            bone_rotations: &model.bone_rotations_of(pose)?,
            surface,
        };
        let outside = model.evaluate_bounded(&input, &mut out)?;
        Ok((out, outside))
    }
}

/// The model's parameters for a pose, with its points where they are looked at.
pub(super) fn parameters(
    model: &Model,
    pose: &Pose,
    surface: Option<&PosedPoints>,
) -> Result<Vec<f32>, EvaluateError> {
    let positions = surface.map_or(&[][..], |surface| &surface.positions);
    Ok(model.parameters_of_posed(pose, positions)?)
}

fn find_clip<'a>(scene: &'a Scene, name: &str) -> Result<&'a Clip, EvaluateError> {
    scene.clips.iter().find(|clip| clip.name == name).ok_or_else(|| {
        let known = scene.clips.iter().map(|clip| clip.name.clone()).collect();
        EvaluateError::Clip { name: name.to_owned(), known }
    })
}

/// The scene's node for each of the model's.
pub(super) fn node_order(model: &Model, scene: &Scene) -> Result<Vec<usize>, EvaluateError> {
    let find =
        |name: &String| scene.skeleton.find(name).ok_or_else(|| EvaluateError::Node(name.clone()));
    model.header().rig.nodes.iter().map(|node| find(&node.name)).collect()
}

/// A light's coefficients by colour, and the model under it where it stands still in the model's
/// frame.
#[derive(Debug, Clone)]
pub struct Light {
    colours: Vec<Vec<f32>>,
    folded: Option<Folded>,
}

impl Light {
    /// A light of 1 or 3 colours, n² coefficients each, that a model can meet.
    ///
    /// # Errors
    /// [`EvaluateError::NoShading`], [`EvaluateError::Light`], [`EvaluateError::LightNotFinite`].
    pub fn new(model: &Model, colours: Vec<Vec<f32>>) -> Result<Self, EvaluateError> {
        let header = model.header();
        if header.signal == Signal::Visibility {
            return Err(EvaluateError::NoShading);
        }
        let expected = header.coefficients();
        let wrong = colours.iter().map(Vec::len).find(|&found| found != expected);
        if let Some(found) = wrong.or((!matches!(colours.len(), 1 | 3)).then_some(0)) {
            return Err(EvaluateError::Light { found, expected });
        }
        if colours.iter().flatten().any(|value| !value.is_finite()) {
            return Err(EvaluateError::LightNotFinite);
        }
        let stands_still = header.frame == Frame::Root || header.signal == Signal::Ao;
        let folds = stands_still && !model.needs_surface();
        let folded = folds.then(|| model.fold(&colours.concat(), &[])).transpose()?;
        Ok(Self { colours, folded })
    }

    /// Colours of the shading of a model.
    #[must_use]
    pub fn colours(&self, model: &Model) -> usize {
        usize::from(model.header().channels).max(self.colours.len())
    }

    /// `[point, channel, coefficient]` to `[point, colour]`: a light of one colour lights each
    /// channel, a coloured one its own.
    fn shade(&self, coefficients: &[f32], channels: usize) -> Vec<f32> {
        let n = self.colours[0].len();
        let colours = channels.max(self.colours.len());
        let dot = |row: &[f32], colour: usize| -> f32 {
            let light = &self.colours[colour.min(self.colours.len() - 1)];
            let own = &row[colour.min(channels - 1) * n..][..n];
            own.iter().zip(light).map(|(t, l)| t * l).sum()
        };
        let rows = coefficients.chunks_exact(n * channels);
        rows.flat_map(|row| (0..colours).map(move |colour| dot(row, colour))).collect()
    }
}

/// Points to the vertices that they stand for.
pub(super) fn spread(
    model: &Model,
    points: &[f32],
    vertices: Option<&[u32]>,
    out: &mut Vec<f32>,
) -> Result<(), EvaluateError> {
    let width = points.len() / model.header().mesh.points as usize;
    let point_of = model.point_of_vertex();
    let mut add = |point: u32| out.extend_from_slice(&points[point as usize * width..][..width]);
    match vertices {
        None => point_of.iter().for_each(|&point| add(point)),
        Some(vertices) => {
            for &vertex in vertices {
                let count = point_of.len();
                let point =
                    point_of.get(vertex as usize).ok_or(EvaluateError::Vertex { vertex, count })?;
                add(*point);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unfolded(colours: Vec<Vec<f32>>) -> Light {
        Light { colours, folded: None }
    }

    /// One-channel transfer under a coloured light gives a colour each; a grey light lights every
    /// channel alike.
    #[test]
    fn shading_pairs_channels_with_colours() {
        let light = unfolded(vec![vec![1.0, 0.0], vec![0.0, 1.0], vec![1.0, 1.0]]);
        assert_eq!(light.shade(&[2.0, 3.0], 1), [2.0, 3.0, 5.0]);
        let grey = unfolded(vec![vec![1.0, 1.0]]);
        assert_eq!(grey.shade(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 3), [3.0, 7.0, 11.0]);
    }
}
