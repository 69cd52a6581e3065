//! `Evaluation.Evaluate`: a frame for each pose, in their order.
//!
//! The stream is driven by who reads it: a pose is taken from the connection when the frame before it
//! has been handed on, and the connection hands on no more than the client takes. That is all the
//! back-pressure there is, and nothing queues up.

use std::pin::Pin;
use std::sync::Arc;
use std::time::Instant;

use futures_util::{Stream, stream};
use glam::Vec3;
use tokio::sync::watch;
use tonic::{Request, Response, Status, Streaming};

use super::status::of_problem;
use super::v1::{self, evaluation_server, pose};
use crate::model::Model;
use crate::pipeline::{Gloss, Light, Query, Scene};
use crate::serve::Service;
use crate::serve::answer::{blocking, is_sha256};
use crate::serve::evaluate::Asked;
use crate::serve::gloss::BrdfRequest;
use crate::serve::lights::LightRequest;
use crate::serve::poses::{
    JointRequest, PoseRequest, check_time, needs_scene, of_positions, refused,
};
use crate::serve::problem::Problem;
use crate::serve::scenes::{self, SceneRequest};
use crate::serve::values::{Values, little_endian};

/// The service behind the interface.
pub(super) struct Evaluator(Arc<Service>);

impl Evaluator {
    pub(super) fn new(service: Arc<Service>) -> Self {
        Self(service)
    }
}

#[tonic::async_trait]
impl evaluation_server::Evaluation for Evaluator {
    type EvaluateStream = Pin<Box<dyn Stream<Item = Result<v1::Frame, Status>> + Send>>;

    async fn evaluate(
        &self,
        request: Request<Streaming<v1::Pose>>,
    ) -> Result<Response<Self::EvaluateStream>, Status> {
        let frames = Frames {
            stopping: self.0.stopping.clone(),
            service: Arc::clone(&self.0),
            poses: request.into_inner(),
            subject: None,
            index: 0,
            ended: false,
        };
        Ok(Response::new(Box::pin(stream::unfold(frames, Frames::next))))
    }
}

/// What is evaluated.
struct Subject {
    id: String,
    model: Arc<Model>,
    light: Option<Arc<Light>>,
    /// What reflects it, and towards where.
    gloss: Option<(Arc<Gloss>, Vec3)>,
    /// The scene that is named.
    scene: Option<Arc<Scene>>,
    vertices: Option<Vec<u32>>,
}

/// One stream.
struct Frames {
    service: Arc<Service>,
    stopping: watch::Receiver<bool>,
    poses: Streaming<v1::Pose>,
    subject: Option<Arc<Subject>>,
    /// Of the next pose.
    index: u64,
    ended: bool,
}

impl Frames {
    /// The next frame; after a fault, none.
    async fn next(mut self) -> Option<(Result<v1::Frame, Status>, Self)> {
        if self.ended {
            return None;
        }
        let pose = tokio::select! {
            pose = self.poses.message() => pose.transpose()?,
            _ = self.stopping.wait_for(|stopping| *stopping) => {
                Err(Status::unavailable("the service stops"))
            }
        };
        let frame = match pose {
            Ok(pose) => self.frame(pose).await.map_err(|problem| {
                of_problem(&problem, format!("pose {}: {}", self.index, problem.detail()))
            }),
            Err(status) => Err(status),
        };
        self.ended = frame.is_err();
        self.index += 1;
        Some((frame, self))
    }

    async fn frame(&mut self, pose: v1::Pose) -> Result<v1::Frame, Problem> {
        let (service, known, index) = (Arc::clone(&self.service), self.subject.take(), self.index);
        let start = Instant::now();
        let (frame, subject) = blocking(move || {
            let subject = match (pose.setup, known) {
                (Some(setup), _) => Arc::new(Subject::new(&service, setup)?),
                (None, Some(known)) => known,
                (None, None) => {
                    return Err(Problem::field("setup", "the first pose must have it"));
                }
            };
            let query = subject.query(&service, pose.at)?;
            let values = subject.values(&service, query)?;
            Ok((frame(index, &values), subject))
        })
        .await?;
        self.service.metrics.evaluated(start.elapsed());
        self.subject = Some(subject);
        Ok(frame)
    }
}

impl Subject {
    fn new(service: &Service, setup: v1::Setup) -> Result<Self, Problem> {
        let id = setup.model;
        let model = if is_sha256(&id) { service.hot.model(service, &id)? } else { None };
        let model = model.ok_or_else(|| Problem::not_found("model"))?;
        let light = setup.light.map(light_request);
        let gloss = setup.brdf.map(|brdf| {
            let brdf = brdf_request(brdf)?;
            brdf.gloss(service, (&id, &model), light.as_ref())
        });
        let gloss = gloss.transpose()?;
        // A light that is reflected shades nothing by itself.
        let light = light.filter(|_| gloss.is_none());
        let light = light.map(|light| light.on(service, &id, &model));
        let scene = setup.scene.map(|scene| {
            let file = Some(scene.file).filter(|file| !file.is_empty());
            SceneRequest { assets: scene.assets, file }.open(service, &model, "setup.scene")
        });
        let vertices = Some(setup.vertices).filter(|vertices| !vertices.is_empty());
        let (light, scene) = (light.transpose()?, scene.transpose()?);
        Ok(Self { light, gloss, scene, id, model, vertices })
    }

    /// The scene that is named or that the model was made of.
    fn scene(&self, service: &Service) -> Result<Arc<Scene>, Problem> {
        match &self.scene {
            Some(scene) => Ok(Arc::clone(scene)),
            None => scenes::of_model(service, (&self.id, &self.model), None, "setup.scene"),
        }
    }

    /// The scene where it is named or needed.
    fn scene_if(&self, service: &Service, needed: bool) -> Result<Option<Arc<Scene>>, Problem> {
        (needed || self.scene.is_some()).then(|| self.scene(service)).transpose()
    }

    fn query(&self, service: &Service, at: Option<pose::At>) -> Result<Query, Problem> {
        let model = &self.model;
        let reflects = self.gloss.is_some();
        if reflects && matches!(at, Some(pose::At::Parameters(_) | pose::At::Positions(_))) {
            let fault =
                "a `brdf` wants poses by `joints` or `clip`, which tell where the surface is";
            return Err(Problem::field("at", fault));
        }
        let posed = |query: Query, scene: Option<&Scene>| match reflects {
            true => query.posed(model, scene),
            false => Ok(query),
        };
        let (field, query) = match at {
            Some(pose::At::Joints(joints)) => {
                let needed = needs_scene(model) || (reflects && model.rest().is_none());
                let scene = self.scene_if(service, needed)?;
                let query = pose_request(joints).query(model, scene.as_deref());
                ("joints", query.and_then(|query| posed(query, scene.as_deref())))
            }
            Some(pose::At::Parameters(row)) => {
                ("parameters", Query::from_parameters(model, &row.values))
            }
            Some(pose::At::Positions(mesh)) => {
                let scene = self.scene_if(service, model.needs_surface())?;
                ("positions", of_positions(model, scene.as_deref(), &mesh.values))
            }
            Some(pose::At::Clip(clip)) => {
                check_time(clip.time_s).map_err(|fault| Problem::field("clip.time_s", fault))?;
                let scene = self.scene(service)?;
                let query = Query::of_clip(model, &scene, &clip.name, clip.time_s);
                ("clip", query.and_then(|query| posed(query, Some(&scene))))
            }
            None => {
                let fault = "give one of `joints`, `parameters`, `positions` and `clip`";
                return Err(Problem::field("at", fault));
            }
        };
        query.map_err(|error| refused(field.to_owned(), &error))
    }

    fn values(&self, service: &Service, query: Query) -> Result<Values, Problem> {
        let asked = Asked {
            model: &self.model,
            light: self.light.as_deref(),
            gloss: self.gloss.as_ref().map(|(gloss, eye)| (&**gloss, *eye)),
            light_at: "setup.light",
            vertices: self.vertices.as_deref(),
        };
        tracing::trace!(model = self.id, "a pose of a stream");
        asked.values(service, &[query], |_| "at".to_owned())
    }
}

fn frame(index: u64, values: &Values) -> v1::Frame {
    let axes = match values.frame {
        "root" => v1::Axes::Root,
        "tangent" => v1::Axes::Tangent,
        _ => v1::Axes::Bone,
    };
    let distance = values.distances.first();
    v1::Frame {
        index,
        values: little_endian(&values.values).into(),
        shape: values.shape.iter().skip(1).map(|&length| length as u32).collect(),
        axes: axes.into(),
        mahalanobis: distance.map_or(0.0, |distance| distance.mahalanobis),
        residual: distance.map_or(0.0, |distance| distance.residual),
        training_residual_rms: values.residual_rms,
    }
}

fn light_request(light: v1::Light) -> LightRequest {
    let colours: Vec<Vec<f32>> = light.colours.into_iter().map(|colour| colour.values).collect();
    LightRequest {
        coefficients: Some(colours).filter(|colours| !colours.is_empty()),
        asset: Some(light.asset).filter(|asset| !asset.is_empty()),
        form: Some(light.form).filter(|form| !form.is_empty()),
        turn_degrees: light.turn_degrees,
    }
}

fn brdf_request(brdf: v1::Brdf) -> Result<BrdfRequest, Problem> {
    let given = |text: String| Some(text).filter(|text| !text.is_empty());
    let count = |number: u32| Some(number as usize).filter(|&number| number > 0);
    let eye = brdf.eye.ok_or_else(|| Problem::field("#/brdf/eye", "it must be given"))?;
    Ok(BrdfRequest {
        form: given(brdf.form),
        asset: given(brdf.asset),
        eye: [eye.x, eye.y, eye.z],
        terms: count(brdf.terms),
        lobes: count(brdf.lobes),
    })
}

fn pose_request(joints: v1::Joints) -> PoseRequest {
    let vector = |vector: v1::Vector| [vector.x, vector.y, vector.z];
    let joint = |joint: v1::Joint| JointRequest {
        rotation: joint.rotation.map(|q| [q.x, q.y, q.z, q.w]),
        translation: joint.translation.map(vector),
        scale: joint.scale.map(vector),
    };
    PoseRequest {
        joints: joints.joints.into_iter().map(|(name, given)| (name, joint(given))).collect(),
        weights: joints.weights,
    }
}
