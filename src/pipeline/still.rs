//! Stills: a scene at poses, by rays and by a model, as one picture.

mod settings;

use glam::{DQuat, Vec3};

use super::evaluate::{EvaluateError, Light as ModelLight, Query};
use super::recipe_of_model;
use super::still_glossy::radiance;
use crate::model::{Model, Signal};
use crate::pose;
use crate::render::{Camera, Image, Light, Panel, Picture, Stage, captioned, sheet};
use crate::rig::{self, Deformed, Pose, RigidFrame};
use crate::scene::{Clip, Scene};
use crate::sh::Order;
use crate::shade::{Brdf, Material, Reflectance, Reflector, ShLight, factor};
use crate::trace;
use settings::check;
pub use settings::{MOST_STILL_FRAMES, STILL_SIZES, Still, StillError};

/// A picture and what is to be said of it.
#[derive(Debug, Clone, PartialEq)]
pub struct StillPicture {
    /// All panels.
    pub picture: Picture,
    /// What values were multiplied with.
    pub exposure: f32,
    /// For each frame, with a model and a truth: the root mean square difference over what is
    /// seen, after exposure.
    pub differences: Vec<Option<f32>>,
    /// Sentences for the user.
    pub notices: Vec<String>,
}

/// One frame's mesh, scene frame, and pose.
struct Posed {
    pose: Pose,
    mesh: Deformed,
    time_s: f32,
}

/// Renders the scene, or the model beside the truth and their differences.
///
/// # Errors
/// See [`StillError`].
pub fn still(
    scene: &Scene,
    model: Option<&Model>,
    settings: &Still<'_>,
) -> Result<StillPicture, StillError> {
    check(settings, model.is_some())?;
    let frames = frames(scene, settings)?;
    let mut notices = Vec::new();
    let untold = model.and_then(untold);
    if let Some(untold) = untold {
        notices.push(format!("no truth is shown: {untold}"));
    }
    let maximum = model.and_then(|model| recipe_of_model(model).ok());
    let maximum = maximum.and_then(|recipe| recipe.bake.max_distance_m);
    let order = model.and_then(|model| Order::new(model.header().order).ok());
    let light = settings
        .light
        .as_ref()
        .map(|light| order.map_or_else(|| light.clone(), |order| light.resized(order)));
    let brdf = reflectance(model, settings)?;
    let reflector = match (&brdf, order) {
        (Some(brdf), Some(order)) => Some(reflector(brdf, order)?),
        _ => None,
    };
    let look = Look {
        scene,
        model,
        settings,
        camera: Camera::around(bounds(&frames), settings.view.map(f32::to_radians), settings.size),
        exposure: exposure(light.as_ref(), settings.exposure_stops),
        light,
        brdf,
        reflector,
        has_truth: untold.is_none(),
        max_distance_m: maximum,
    };
    let failed = |source| StillError::Trace { frame: 0, source };
    let device = trace::Device::new().map_err(failed)?;
    let (mut panels, mut differences) = (Vec::new(), Vec::new());
    for (index, frame) in frames.iter().enumerate() {
        let (more, difference) = look.frame(&device, index, frame)?;
        panels.extend(more);
        differences.push(difference);
    }
    let columns = match panels.len() / frames.len() {
        1 => panels.len().isqrt().max(1),
        each => each,
    };
    let picture = sheet(&panels, columns);
    Ok(StillPicture { picture, exposure: look.exposure, differences, notices })
}

/// What is the same for all frames.
struct Look<'a> {
    scene: &'a Scene,
    model: Option<&'a Model>,
    settings: &'a Still<'a>,
    camera: Camera,
    light: Option<ShLight>,
    brdf: Option<Material>,
    /// For a model of visibility.
    reflector: Option<Reflector>,
    exposure: f32,
    has_truth: bool,
    max_distance_m: Option<f32>,
}

impl Look<'_> {
    fn frame(
        &self,
        device: &trace::Device,
        index: usize,
        frame: &Posed,
    ) -> Result<(Vec<Picture>, Option<f32>), StillError> {
        let Deformed { positions, normals } = &frame.mesh;
        let triangles = &self.scene.mesh.triangles;
        let stage = Stage::new(device, positions, normals, triangles, self.max_distance_m)
            .map_err(|source| StillError::Trace { frame: index, source })?;
        let Still { samples, rays, .. } = *self.settings;
        let truth = self.has_truth.then(|| match (&self.brdf, self.light.clone()) {
            (Some(brdf), light) => {
                let light = light.unwrap_or_else(|| white(Order::new(1).expect("order 1")));
                stage.reflected(&self.camera, (samples, rays), &light, brdf)
            }
            (None, None) => stage.truth(&self.camera, samples, rays, &Light::Ambient),
            (None, Some(light)) => {
                stage.truth(&self.camera, samples, rays, &Light::Environment(light))
            }
        });
        let image = match self.model {
            None => None,
            Some(model) => Some(stage.show(&self.camera, samples, &self.values(model, frame)?)),
        };
        let difference = match (&image, &truth) {
            (Some(image), Some(truth)) => Some(self.exposure * image.rms_difference(truth)),
            _ => None,
        };
        Ok((self.panels(frame, image.as_ref(), truth.as_ref()), difference))
    }

    fn panels(&self, frame: &Posed, image: Option<&Image>, truth: Option<&Image>) -> Vec<Picture> {
        let exposure = self.exposure;
        let unit = if self.light.is_some() { "of white" } else { "ao" };
        let when = match self.settings.clip {
            Some(clip) => format!("{clip} {:.2} s", frame.time_s),
            None => "rest".to_owned(),
        };
        let legend = image.is_some() && truth.is_some();
        let light = |image, name: &str| {
            captioned(&Panel::Light { image, exposure }, &format!("{name}{when}"), unit, legend)
        };
        let mut panels: Vec<Picture> =
            image.map(|image| light(image, "model, ")).into_iter().collect();
        let name = if image.is_some() { "truth, " } else { "" };
        panels.extend(truth.map(|truth| light(truth, name)));
        if let (Some(image), Some(truth)) = (image, truth) {
            for &gain in &self.settings.gains {
                let panel = Panel::Difference { image, truth, exposure, gain };
                panels.push(captioned(&panel, &format!("difference x{gain}"), unit, true));
            }
        }
        panels
    }

    /// One or three colours at each vertex.
    fn values(&self, model: &Model, frame: &Posed) -> Result<Vec<f32>, StillError> {
        let query = Query::from_pose(model, self.scene, &frame.pose)?;
        let mut out = Vec::new();
        if model.header().signal == Signal::Ao {
            if self.light.is_some() {
                return Err(StillError::AmbientOnly);
            }
            query.values(model, None, None, &mut out)?;
            return Ok(out);
        }
        let order = Order::new(model.header().order).expect("a model's header is checked");
        if let Some(reflector) = &self.reflector {
            let light = self.light.clone().unwrap_or_else(|| white(order));
            let (of_model, eye) = ((model, &query), self.camera.eye());
            return Ok(radiance(of_model, &frame.mesh, (&light, reflector), eye)?);
        }
        let light = match &self.light {
            Some(light) => {
                let root = query.root_frame(model)?.rotation;
                light.rotated(DQuat::from_array(root.to_array().map(f64::from)).inverse())
            }
            None => white(order),
        };
        let colour = |colour: &Vec<f64>| colour.iter().map(|&value| value as f32).collect();
        let colours = light.colours().iter().map(colour).collect();
        query.values(model, Some(&ModelLight::new(model, colours)?), None, &mut out)?;
        Ok(out)
    }
}

/// Radiance 1 from everywhere.
fn white(order: Order) -> ShLight {
    ShLight::constant(order, [1.0; 3]).expect("1 is a radiance")
}

/// The reflectance of a still: as it is asked for, white Lambert for a model of visibility, else
/// none, which shades by transfer.
fn reflectance(
    model: Option<&Model>,
    settings: &Still<'_>,
) -> Result<Option<Material>, StillError> {
    let signal = model.map(|model| model.header().signal);
    if let Some(brdf) = &settings.brdf
        && !brdf.is_isotropic()
    {
        let found = format!("{brdf:?}");
        let range = "isotropic: a still knows no tangents";
        return Err(StillError::Setting { what: "the reflectance", found, range });
    }
    match (signal, &settings.brdf) {
        (Some(signal), Some(_)) if signal != Signal::Visibility => {
            Err(StillError::NeedsVisibility { signal: signal.name() })
        }
        (Some(Signal::Visibility), None) => Ok(Some(Brdf::Lambert { albedo: [1.0; 3] }.into())),
        (_, brdf) => Ok(brdf.clone()),
    }
}

/// Eight terms of an operator, or as many as there are.
fn reflector(brdf: &Material, order: Order) -> Result<Reflector, StillError> {
    let operators = factor(brdf, order, brdf.nodes())?.map(|colour| colour.operator(8));
    Ok(Reflector::new("still", &operators, [0.0; 3]))
}

/// The posed meshes, in the scene's own frame.
fn frames(scene: &Scene, settings: &Still<'_>) -> Result<Vec<Posed>, StillError> {
    let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let posed = |pose: Pose, time_s| {
        let mut mesh = Deformed::default();
        let globals = scene.skeleton.globals(&pose.local);
        rig::deform(&scene.mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut mesh);
        Posed { pose, mesh, time_s }
    };
    let Some(name) = settings.clip else { return Ok(vec![posed(rest, 0.0)]) };
    let clip = find(scene, name)?;
    let at = |&time_s: &f32| {
        if !(0.0..=clip.duration_s).contains(&time_s) {
            let (clip, duration_s) = (name.to_owned(), clip.duration_s);
            return Err(StillError::Time { clip, duration_s, time_s });
        }
        Ok(posed(pose::evaluate(clip, time_s, &rest), time_s))
    };
    settings.times_s.iter().map(at).collect()
}

/// A clip by name.
///
/// # Errors
/// [`EvaluateError::Clip`] with the names that there are.
fn find<'a>(scene: &'a Scene, name: &str) -> Result<&'a Clip, EvaluateError> {
    scene.clips.iter().find(|clip| clip.name == name).ok_or_else(|| {
        let known = scene.clips.iter().map(|clip| clip.name.clone()).collect();
        EvaluateError::Clip { name: name.to_owned(), known }
    })
}

/// Times spread evenly over a clip, both ends included; the middle where there is only one.
///
/// # Errors
/// [`EvaluateError::Clip`] with the names that there are.
pub fn spread_times(scene: &Scene, clip: &str, frames: usize) -> Result<Vec<f32>, EvaluateError> {
    let duration_s = find(scene, clip)?.duration_s;
    let last = frames.saturating_sub(1).max(1) as f32;
    let at = |i: usize| if frames == 1 { duration_s / 2.0 } else { duration_s * i as f32 / last };
    Ok((0..frames).map(|i| at(i).min(duration_s)).collect())
}

/// The box around all frames.
fn bounds(frames: &[Posed]) -> [Vec3; 2] {
    let all = frames.iter().flat_map(|frame| &frame.mesh.positions);
    let start = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    let [low, high] = all.fold(start, |[low, high], &p| [low.min(p), high.max(p)]);
    if low.is_finite() && high.is_finite() { [low, high] } else { [Vec3::ZERO, Vec3::ONE] }
}

/// What makes the brightest open white surface white.
fn exposure(light: Option<&ShLight>, stops: f32) -> f32 {
    let brightest = light.map_or(1.0, ShLight::brightest_reflection);
    let scale = if brightest > 0.0 { 1.0 / brightest } else { 1.0 };
    scale as f32 * stops.exp2()
}

/// Why the truth of a still is not that of a model, if so.
fn untold(model: &Model) -> Option<&'static str> {
    let bake = recipe_of_model(model).ok()?.bake;
    if bake.bounces > 0 {
        return Some(
            "the model holds light that other surfaces pass on, which rays to the sky do not tell",
        );
    }
    if !bake.surroundings.is_empty() {
        return Some("the model holds what its surroundings block, which are not in the scene");
    }
    bake.recompute_normals.then_some("the model was baked with normals of its own")
}

#[cfg(test)]
mod tests;
