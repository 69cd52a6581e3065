//! Stills: a scene at poses, by rays and by a model, as one picture.

use glam::{DQuat, Vec3};

use super::evaluate::{EvaluateError, Light as ModelLight, Query};
use super::recipe_of_model;
use crate::model::{Model, Signal};
use crate::pose;
use crate::render::{Camera, Image, Light, Panel, Picture, Stage, captioned, sheet};
use crate::rig::{self, Deformed, Pose, RigidFrame};
use crate::scene::{Clip, Scene};
use crate::sh::Order;
use crate::shade::ShLight;
use crate::trace;

/// Pixels of a side of one panel, least and most.
pub const STILL_SIZES: [u32; 2] = [16, 4096];

/// The most frames of a sheet.
pub const MOST_STILL_FRAMES: usize = 64;

/// The most pixels of all panels together.
const MOST_PIXELS: usize = 64 << 20;

/// What is to be seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Still<'a> {
    /// The clip; the rest pose when absent.
    pub clip: Option<&'a str>,
    /// Seconds into the clip, a frame each; not looked at without a clip.
    pub times_s: Vec<f32>,
    /// Where from: degrees about +Y, from +Z towards +X, and degrees upwards.
    pub view: [f32; 2],
    /// Pixels across and down of one panel.
    pub size: [u32; 2],
    /// Samples of a pixel, across and down, 1 to 8.
    pub samples: u32,
    /// Rays of each sample of the truth, 2 to 65,536.
    pub rays: u32,
    /// A panel of the difference for each, which shows 1/gain as the end of the scale.
    pub gains: Vec<f32>,
    /// An environment fixed in the scene; ambient occlusion when absent.
    pub light: Option<ShLight>,
    /// Stops of brightness; at 0 the brightest open white surface is white.
    pub exposure_stops: f32,
}

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

/// Why a still cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StillError {
    /// The model's objection.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// The tracer's objection.
    #[error("frame {frame}: {source}")]
    Trace {
        /// Counted from 0.
        frame: usize,
        /// What it says.
        source: trace::Error,
    },
    /// A time outside of the clip.
    #[error("clip `{clip}` lasts from 0 to {duration_s} s, so there is no time {time_s}")]
    Time {
        /// The clip.
        clip: String,
        /// Its length.
        duration_s: f32,
        /// What was asked for.
        time_s: f32,
    },
    /// A number out of its range.
    #[error("{what} is {found}; it must be {range}")]
    Setting {
        /// Which.
        what: &'static str,
        /// Given.
        found: String,
        /// What is allowed.
        range: &'static str,
    },
    /// Ambient occlusion under a light.
    #[error("the model holds ambient occlusion, which meets no light; leave the light out")]
    AmbientOnly,
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
    let light = settings.light.as_ref().map(|light| {
        let order = model.and_then(|model| Order::new(model.header().order).ok());
        order.map_or_else(|| light.clone(), |order| light.resized(order))
    });
    let look = Look {
        scene,
        model,
        settings,
        camera: Camera::around(bounds(&frames), settings.view.map(f32::to_radians), settings.size),
        exposure: exposure(light.as_ref(), settings.exposure_stops),
        light,
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
        let light = self.light.clone().map_or(Light::Ambient, Light::Environment);
        let truth = self.has_truth.then(|| stage.truth(&self.camera, samples, rays, &light));
        let image = match self.model {
            None => None,
            Some(model) => {
                Some(stage.show(&self.camera, samples, &self.values(model, &frame.pose)?))
            }
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
    fn values(&self, model: &Model, pose: &Pose) -> Result<Vec<f32>, StillError> {
        let query = Query::from_pose(model, self.scene, pose)?;
        let mut out = Vec::new();
        if model.header().signal == Signal::Ao {
            query.values(model, None, None, &mut out)?;
            return Ok(out);
        }
        let order = Order::new(model.header().order).expect("a model's header is checked");
        let light = match &self.light {
            Some(light) => {
                let root = query.root_frame(model)?.rotation;
                light.rotated(DQuat::from_array(root.to_array().map(f64::from)).inverse())
            }
            None => ShLight::constant(order, [1.0; 3]).unwrap_or_else(|_| ShLight::black(order)),
        };
        let colour = |colour: &Vec<f64>| colour.iter().map(|&value| value as f32).collect();
        let colours = light.colours().iter().map(colour).collect();
        query.values(model, Some(&ModelLight::new(model, colours)?), None, &mut out)?;
        Ok(out)
    }
}

fn check(settings: &Still<'_>, with_model: bool) -> Result<(), StillError> {
    let setting = |what, found: String, range| Err(StillError::Setting { what, found, range });
    let [low, high] = STILL_SIZES;
    if let Some(side) = settings.size.iter().find(|side| !(low..=high).contains(side)) {
        return setting("a side of the picture", side.to_string(), "16 to 4096 pixels");
    }
    if !(1..=8).contains(&settings.samples) {
        return setting("samples", settings.samples.to_string(), "1 to 8 across a pixel");
    }
    if !(2..=65_536).contains(&settings.rays) {
        return setting("rays", settings.rays.to_string(), "2 to 65536");
    }
    let frames = if settings.clip.is_some() { settings.times_s.len() } else { 1 };
    if !(1..=MOST_STILL_FRAMES).contains(&frames) {
        return setting("the number of frames", frames.to_string(), "1 to 64");
    }
    if let Some(gain) = settings.gains.iter().find(|gain| !(**gain >= 0.1 && **gain <= 1000.0)) {
        return setting("a gain", gain.to_string(), "0.1 to 1000");
    }
    let [yaw, pitch] = settings.view;
    if !(yaw.is_finite() && (-89.0..=89.0).contains(&pitch)) {
        return setting("the view", format!("{yaw}, {pitch}"), "any yaw and a pitch of -89 to 89");
    }
    if !settings.exposure_stops.is_finite() || settings.exposure_stops.abs() > 30.0 {
        return setting("the exposure", settings.exposure_stops.to_string(), "-30 to 30 stops");
    }
    let panels = frames * if with_model { 2 + settings.gains.len() } else { 1 };
    let pixels = panels * settings.size.iter().map(|s| *s as usize).product::<usize>();
    if pixels > MOST_PIXELS {
        return setting("the picture", format!("{pixels} pixels"), "of at most 67108864 pixels");
    }
    Ok(())
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
