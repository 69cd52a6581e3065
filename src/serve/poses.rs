//! What an evaluation is asked for: poses as a tool has them.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Quat, Vec3};
use serde::{Deserialize, Deserializer};

use super::answer::{document, escaped};
use super::gloss::BrdfRequest;
use super::lights::LightRequest;
use super::problem::Problem;
use super::scenes::{self, SceneRequest};
use super::{Service, few};
use crate::model::{self, JointPose, JointTransform, Model};
use crate::pipeline::{EvaluateError, Light, Query, Scene};

/// Poses of one evaluation.
pub(super) const MOST_POSES: usize = 4096;

/// A request for values at poses: exactly one of `poses`, `parameters`, `positions` and `clip`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct EvaluateRequest {
    /// Poses by joints and morph weights; what is not named is at rest.
    #[serde(default, deserialize_with = "few::maybe::<_, _, MOST_POSES>")]
    poses: Option<Vec<PoseRequest>>,
    /// Poses by the model's own parameters.
    #[serde(default, deserialize_with = "few::maybe::<_, _, MOST_POSES>")]
    pub(super) parameters: Option<Vec<Vec<f32>>>,
    /// Poses by the vertices of the posed mesh, `[vertex, 3]` each.
    #[serde(default, deserialize_with = "few::maybe::<_, _, MOST_POSES>")]
    pub(super) positions: Option<Vec<Vec<f32>>>,
    /// Poses of a clip of an uploaded scene.
    clip: Option<ClipRequest>,
    /// The scene that the model is of; beside `poses` and `positions` of models that look at the
    /// posed mesh. The one that the model was made of where absent.
    scene: Option<SceneRequest>,
    /// Only these vertices, in this order; all when absent.
    pub(super) vertices: Option<Vec<u32>>,
    /// Shading under this light in place of coefficients.
    pub(super) light: Option<LightRequest>,
    /// Reflection of that light towards an eye, of models of visibility.
    pub(super) brdf: Option<BrdfRequest>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "an object with `joints` or `weights`")]
#[derive(Default)]
pub(super) struct PoseRequest {
    pub(super) joints: BTreeMap<String, JointRequest>,
    pub(super) weights: BTreeMap<String, f32>,
}

/// A joint's local transform, as far as it is not at rest.
#[derive(Debug, Default, Deserialize)]
#[serde(
    deny_unknown_fields,
    default,
    expecting = "an object with `rotation`, `translation` or `scale`"
)]
pub(super) struct JointRequest {
    /// Quaternion x, y, z, w; normalised.
    #[serde(deserialize_with = "quaternion")]
    pub(super) rotation: Option<[f32; 4]>,
    /// Metres.
    #[serde(deserialize_with = "vector")]
    pub(super) translation: Option<[f32; 3]>,
    #[serde(deserialize_with = "vector")]
    pub(super) scale: Option<[f32; 3]>,
}

/// So many numbers, in words where there are others.
fn numbers<'de, D: Deserializer<'de>, const N: usize>(
    deserializer: D,
    what: &str,
) -> Result<Option<[f32; N]>, D::Error> {
    let Some(given) = Option::<Vec<f32>>::deserialize(deserializer)? else { return Ok(None) };
    let count = given.len();
    let given = given
        .try_into()
        .map_err(|_| serde::de::Error::custom(format!("{what}; here {count} are given")))?;
    Ok(Some(given))
}

fn quaternion<'de, D: Deserializer<'de>>(given: D) -> Result<Option<[f32; 4]>, D::Error> {
    numbers(given, "a rotation is a quaternion of four numbers, x, y, z and w")
}

fn vector<'de, D: Deserializer<'de>>(given: D) -> Result<Option<[f32; 3]>, D::Error> {
    numbers(given, "three numbers are expected, for x, y and z")
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with the clip's `name` and `times_s`")]
struct ClipRequest {
    /// The files of a scene: name → SHA-256 of an uploaded asset. That which the model was made of
    /// where absent.
    assets: Option<BTreeMap<String, String>>,
    /// The main one; may be left out where there is only one.
    file: Option<String>,
    name: String,
    /// Seconds on the clip's own clock.
    #[serde(deserialize_with = "few::list::<_, _, MOST_POSES>")]
    times_s: Vec<f32>,
}

/// What a request that says too little or too much is told.
const ONE_OF: &str = "give one of `poses`, `parameters`, `positions` and `clip`";

impl EvaluateRequest {
    /// Reads a request; poses that are too many are not read to their end.
    ///
    /// # Errors
    /// The first field at fault.
    pub(super) fn read(body: &[u8]) -> Result<Self, Problem> {
        document(body).map_err(|problem: Problem| match problem.fault() {
            Some((pointer, fault)) if few::is_too_many(fault) => {
                let refused = Problem::field(pointer, fault);
                let of_poses = !pointer.starts_with("#/light");
                if of_poses { refused.limit("poses", MOST_POSES as u64) } else { refused }
            }
            _ => problem,
        })
    }

    /// Where one of the poses stands.
    pub(super) fn place(&self, index: usize) -> String {
        let list = match (&self.poses, &self.parameters, &self.positions) {
            (Some(_), ..) => "poses",
            (_, Some(_), _) => "parameters",
            (.., Some(_)) => "positions",
            _ => "clip/times_s",
        };
        format!("#/{list}/{index}")
    }

    /// The poses as the model takes them.
    ///
    /// # Errors
    /// What is wrong with them, with its field.
    pub(super) fn queries(
        &self,
        service: &Service,
        id: &str,
        model: &Model,
    ) -> Result<Vec<Query>, Problem> {
        let some = |pointer: &str, found: usize| match found {
            0 => Err(Problem::field(pointer, "at least one pose is needed")),
            _ => Ok(()),
        };
        if self.scene.is_some() && self.poses.is_none() && self.positions.is_none() {
            return Err(Problem::field("#/scene", "it stands beside `poses` or `positions`"));
        }
        let at = |list: &str, index: usize| format!("#/{list}/{index}");
        match (&self.poses, &self.parameters, &self.positions, &self.clip) {
            (Some(poses), None, None, None) => {
                some("#/poses", poses.len())?;
                let scene = self.scene(service, id, model)?;
                let query = |(index, pose): (usize, &PoseRequest)| {
                    let query = pose.query(model, scene.as_deref());
                    let query = query.and_then(|query| self.posed(query, model, scene.as_deref()));
                    query.map_err(|error| refused(at("poses", index), &error))
                };
                poses.iter().enumerate().map(query).collect()
            }
            (None, None, Some(meshes), None) => {
                some("#/positions", meshes.len())?;
                let scene = self.scene(service, id, model)?;
                let query = |(index, mesh): (usize, &Vec<f32>)| {
                    let query = of_positions(model, scene.as_deref(), mesh);
                    query.map_err(|error| refused(at("positions", index), &error))
                };
                meshes.iter().enumerate().map(query).collect()
            }
            (None, Some(rows), None, None) => {
                some("#/parameters", rows.len())?;
                let query = |(index, row): (usize, &Vec<f32>)| {
                    let query = Query::from_parameters(model, row);
                    query.map_err(|error| refused(at("parameters", index), &error))
                };
                rows.iter().enumerate().map(query).collect()
            }
            (None, None, None, Some(clip)) => {
                some("#/clip/times_s", clip.times_s.len())?;
                let (queries, scene) = clip.queries(service, id, model)?;
                let posed = |query| self.posed(query, model, Some(scene.as_ref()));
                let queries: Result<_, _> = queries.into_iter().map(posed).collect();
                queries.map_err(|error| refused("#/clip".to_owned(), &error))
            }
            _ => Err(Problem::field("#", ONE_OF)),
        }
    }

    /// The scene that is named, or that the model cannot do without.
    fn scene(
        &self,
        service: &Service,
        id: &str,
        model: &Model,
    ) -> Result<Option<Arc<Scene>>, Problem> {
        let needed = needs_scene(model) || (self.positions.is_some() && model.needs_surface());
        let reflecting = self.brdf.is_some() && model.rest().is_none();
        let wanted = self.scene.is_some() || needed || reflecting;
        let scene = || scenes::of_model(service, (id, model), self.scene.as_ref(), "#/scene");
        wanted.then(scene).transpose()
    }

    /// With the posed mesh beside it where light is reflected.
    fn posed(
        &self,
        query: Query,
        model: &Model,
        scene: Option<&Scene>,
    ) -> Result<Query, EvaluateError> {
        if self.brdf.is_some() { query.posed(model, scene) } else { Ok(query) }
    }

    /// The light as the model takes it.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn light(
        &self,
        service: &Service,
        id: &str,
        model: &Model,
    ) -> Result<Option<Arc<Light>>, Problem> {
        self.light.as_ref().map(|light| light.on(service, id, model)).transpose()
    }
}

impl PoseRequest {
    /// The pose as a model takes it, with the scene where one is given.
    pub(super) fn query(
        &self,
        model: &Model,
        scene: Option<&Scene>,
    ) -> Result<Query, EvaluateError> {
        match scene {
            Some(scene) => Query::from_joints_in(model, scene, &self.pose()),
            None => Query::from_joints(model, &self.pose()),
        }
    }

    fn pose(&self) -> JointPose {
        let transform = |joint: &JointRequest| JointTransform {
            rotation: joint.rotation.map(Quat::from_array),
            translation: joint.translation.map(Vec3::from_array),
            scale: joint.scale.map(Vec3::from_array),
        };
        let joints = self.joints.iter().map(|(name, joint)| (name.clone(), transform(joint)));
        JointPose { joints: joints.collect(), weights: self.weights.clone() }
    }
}

impl ClipRequest {
    fn queries(
        &self,
        service: &Service,
        id: &str,
        model: &Model,
    ) -> Result<(Vec<Query>, Arc<Scene>), Problem> {
        let named = match (&self.assets, &self.file) {
            (Some(assets), file) => {
                Some(SceneRequest { assets: assets.clone(), file: file.clone() })
            }
            (None, None) => None,
            (None, Some(_)) => {
                return Err(Problem::field("#/clip/assets", "`file` is one of them"));
            }
        };
        for (index, &time_s) in self.times_s.iter().enumerate() {
            check_time(time_s)
                .map_err(|fault| Problem::field(format!("#/clip/times_s/{index}"), fault))?;
        }
        let scene = scenes::of_model(service, (id, model), named.as_ref(), "#/clip")?;
        let queries = Query::from_clip(model, &scene, &self.name, self.times_s.iter().copied())
            .map_err(|error| refused("#/clip".to_owned(), &error))?;
        Ok((queries, scene))
    }
}

/// Whether a time is one of a clip's clock.
///
/// # Errors
/// A sentence that says what is wrong.
pub(super) fn check_time(time_s: f32) -> Result<(), &'static str> {
    let sound = time_s.is_finite() && time_s >= 0.0;
    if sound { Ok(()) } else { Err("a time is zero or a positive number of seconds") }
}

/// Whether the posed mesh is looked at, and the model does not carry it.
pub(super) fn needs_scene(model: &Model) -> bool {
    model.looks_at_mesh() && model.rest().is_none()
}

/// A pose by the vertices of its mesh, with the scene where the model looks at them.
///
/// # Errors
/// What the model objects to.
pub(super) fn of_positions(
    model: &Model,
    scene: Option<&Scene>,
    mesh: &[f32],
) -> Result<Query, EvaluateError> {
    match scene {
        Some(scene) => Query::from_positions_in(model, scene, mesh),
        None => Query::from_positions(model, mesh),
    }
}

/// The model's objection, at the field that it is about.
pub(super) fn refused(pointer: String, error: &EvaluateError) -> Problem {
    let pointer = match error {
        EvaluateError::Model(model::Error::UnknownNames { what, .. }) => {
            let list = if what.contains("joint") { "joints" } else { "weights" };
            format!("{pointer}/{list}")
        }
        EvaluateError::Model(model::Error::NoRotation { joint }) => {
            format!("{pointer}/joints/{}/rotation", escaped(joint))
        }
        EvaluateError::Clip { .. } => format!("{pointer}/name"),
        EvaluateError::Vertex { .. } => "#/vertices".to_owned(),
        _ => pointer,
    };
    Problem::new(axum::http::StatusCode::UNPROCESSABLE_ENTITY, "invalid-pose", error.to_string())
        .at(pointer, error.to_string())
}
