//! Stills: a scene at poses, by rays and by a model, as one picture.

mod settings;

use glam::{DQuat, Vec3};

use super::EvaluateError;
use super::evaluate::{Light as ModelLight, Query};
use super::evaluate_posed::anew;
use super::finish::{Finish, FinishError};
use super::gloss::Gloss;
use super::recipe_of_model;
use super::valued::{Valued, valued};
use crate::model::{Model, Signal};
use crate::pose;
use crate::render::{Camera, Image, Light, Panel, Picture, Stage, captioned, sheet};
use crate::rig::{self, Deformed, Pose, RigidFrame, Tangents};
use crate::scene::{Clip, Scene};
use crate::sh::Order;
use crate::shade::{Brdf, Material, ShLight};
use crate::trace;
use settings::check;
pub use settings::{MOST_STILL_FRAMES, MOST_TURN_FRAMES, STILL_SIZES, Still, StillError};

/// What a notice begins with that says why there is no truth.
pub(super) const NO_TRUTH: &str = "no truth is shown: ";

/// A picture and what is to be said of it.
#[derive(Debug, Clone, PartialEq)]
pub struct StillPicture {
    /// All panels as one sheet; of a turn one for each frame.
    pub pictures: Vec<Picture>,
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
    /// Unit, where a reflectance has a grain; else none.
    tangents: Option<Vec<Vec3>>,
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
    let valued = model.map(|model| valued(model, scene)).transpose()?;
    let scene = valued.as_ref().map_or(scene, |valued| valued.scene.as_ref());
    let frames = frames(scene, model, settings)?;
    let mut notices: Vec<String> =
        frames.first().and_then(|f| grain(scene, f)).into_iter().collect();
    notices.extend(valued.iter().flat_map(Valued::untold));
    let untold = model.and_then(untold);
    if let Some(untold) = untold {
        notices.push(format!("{NO_TRUTH}{untold}"));
    }
    let maximum = model.and_then(|model| recipe_of_model(model).ok());
    let maximum = maximum.and_then(|recipe| recipe.bake.max_distance_m);
    let order = model.and_then(|model| Order::new(model.header().order).ok());
    let light = settings
        .light
        .as_ref()
        .map(|light| order.map_or_else(|| light.clone(), |order| light.resized(order)));
    let finish = reflectance(model, settings)?;
    notices.extend(settings.brdf.iter().flat_map(Finish::warnings));
    let gloss = match (&finish, model) {
        (Some(finish), Some(model)) => Some(gloss((model, settings), finish, light.as_ref())?),
        _ => None,
    };
    let (brdf, has_truth) = match finish.map(|finish| finish.reflectance()).transpose() {
        Err(unknown @ FinishError::Rays { .. }) if model.is_some() => {
            notices.push(format!("{NO_TRUTH}{unknown}"));
            (None, false)
        }
        brdf => (brdf?, untold.is_none()),
    };
    let look = Look {
        scene,
        model,
        settings,
        exposure: exposure(light.as_ref(), settings.exposure_stops),
        light,
        brdf,
        gloss,
        has_truth,
        max_distance_m: maximum,
    };
    let failed = |source| StillError::Trace { frame: 0, source };
    let device = trace::Device::new().map_err(failed)?;
    let bounds = bounds(&frames);
    let count = settings.turntable.unwrap_or(frames.len());
    let (mut panels, mut differences) = (Vec::new(), Vec::new());
    for index in 0..count {
        let frame = &frames[index.min(frames.len() - 1)];
        let camera = camera(settings, bounds, index);
        let (more, difference) = look.frame(&device, index, (frame, &camera))?;
        panels.push(more);
        differences.push(difference);
    }
    let pictures = if settings.turntable.is_some() {
        panels.iter().map(|panels| sheet(panels, panels.len())).collect()
    } else {
        let columns = match panels[0].len() {
            1 => panels.len().isqrt().max(1),
            each => each,
        };
        vec![sheet(&panels.concat(), columns)]
    };
    Ok(StillPicture { pictures, exposure: look.exposure, differences, notices })
}

/// Where a frame is seen from.
fn camera(settings: &Still<'_>, bounds: [Vec3; 2], frame: usize) -> Camera {
    let [yaw, pitch] = settings.view.map(f32::to_radians);
    match settings.turntable {
        None => Camera::around(bounds, [yaw, pitch], settings.size),
        Some(count) => {
            let turn = std::f32::consts::TAU * frame as f32 / count as f32;
            Camera::turning(bounds, [yaw + turn, pitch], settings.size)
        }
    }
}

/// What is the same for all frames.
struct Look<'a> {
    scene: &'a Scene,
    model: Option<&'a Model>,
    settings: &'a Still<'a>,
    light: Option<ShLight>,
    brdf: Option<Material>,
    /// For a model of visibility; the light in the scene's frame.
    gloss: Option<Gloss>,
    exposure: f32,
    has_truth: bool,
    max_distance_m: Option<f32>,
}

impl Look<'_> {
    fn frame(
        &self,
        device: &trace::Device,
        index: usize,
        (frame, camera): (&Posed, &Camera),
    ) -> Result<(Vec<Picture>, Option<f32>), StillError> {
        let Deformed { positions, normals } = &frame.mesh;
        let triangles = &self.scene.mesh.triangles;
        let stage = Stage::new(device, positions, normals, triangles, self.max_distance_m)
            .map_err(|source| StillError::Trace { frame: index, source })?;
        let stage = match &frame.tangents {
            Some(tangents) => stage.with_tangents(tangents),
            None => stage,
        };
        let Still { samples, rays, .. } = *self.settings;
        let truth = self.has_truth.then(|| match (&self.brdf, self.light.clone()) {
            (Some(brdf), light) => {
                let light = light.unwrap_or_else(|| white(Order::new(1).expect("order 1")));
                stage.reflected(camera, (samples, rays), &light, brdf)
            }
            (None, None) => stage.truth(camera, samples, rays, &Light::Ambient),
            (None, Some(light)) => stage.truth(camera, samples, rays, &Light::Environment(light)),
        });
        let image = match self.model {
            None => None,
            Some(model) => {
                Some(stage.show(camera, samples, &self.values(model, (frame, camera.eye()))?))
            }
        };
        let difference = match (&image, &truth) {
            (Some(image), Some(truth)) => Some(self.exposure * image.rms_difference(truth)),
            _ => None,
        };
        Ok((self.panels(frame, image.as_ref(), truth.as_ref()), difference))
    }

    fn panels(&self, frame: &Posed, image: Option<&Image>, truth: Option<&Image>) -> Vec<Picture> {
        let (exposure, tone) = (self.exposure, self.settings.tone);
        let unit = if self.light.is_some() { "of white" } else { "ao" };
        let when = match self.settings.clip {
            Some(clip) => format!("{clip} {:.2} s", frame.time_s),
            None => "rest".to_owned(),
        };
        let legend = image.is_some() && truth.is_some();
        let light = |image, name: &str| {
            captioned(
                &Panel::Light { image, exposure, tone },
                &format!("{name}{when}"),
                unit,
                legend,
            )
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

    /// One or three colours at each vertex of the scene.
    fn values(&self, model: &Model, of: (&Posed, Vec3)) -> Result<Vec<f32>, StillError> {
        let mut values = self.all_values(model, of)?;
        // Receivers come last, and are not in the scene.
        let colours = values.len() / (model.header().mesh.vertices as usize).max(1);
        values.truncate(colours * of.0.mesh.positions.len());
        Ok(values)
    }

    fn all_values(
        &self,
        model: &Model,
        (frame, eye): (&Posed, Vec3),
    ) -> Result<Vec<f32>, StillError> {
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
        if let Some(gloss) = &self.gloss {
            let root = query.root_frame(model)?;
            let eye = root.inverse().transform_point3(eye);
            let to_root = root.rotation.inverse();
            let gloss = gloss.turned(to_root);
            let tangents: Option<Vec<Vec3>> =
                frame.tangents.as_ref().map(|all| all.iter().map(|t| to_root * *t).collect());
            let towards = (&gloss, eye, tangents.as_deref());
            query.posed(model, Some(self.scene))?.reflected(model, towards, None, &mut out)?;
            return Ok(out);
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
fn reflectance(model: Option<&Model>, settings: &Still<'_>) -> Result<Option<Finish>, StillError> {
    let signal = model.map(|model| model.header().signal);
    match (signal, &settings.brdf) {
        (Some(signal), Some(_)) if signal != Signal::Visibility => {
            Err(StillError::NeedsVisibility { signal: signal.name() })
        }
        (Some(Signal::Visibility), None) => Ok(Some(Brdf::Lambert { albedo: [1.0; 3] }.into())),
        (_, brdf) => Ok(brdf.clone()),
    }
}

/// A reflectance on a model of visibility, under a light or white from everywhere.
fn gloss(
    (model, settings): (&Model, &Still<'_>),
    finish: &Finish,
    light: Option<&ShLight>,
) -> Result<Gloss, StillError> {
    let order = model.header().sh_order();
    let reflector = finish.operator("still", order, settings.terms)?;
    let light = light.cloned().unwrap_or_else(|| white(order));
    Ok(Gloss::new(model, &light, reflector, settings.lobes)?)
}

/// The posed meshes, in the scene's own frame.
fn frames(
    scene: &Scene,
    model: Option<&Model>,
    settings: &Still<'_>,
) -> Result<Vec<Posed>, StillError> {
    let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let grained = settings.brdf.as_ref().is_some_and(|brdf| !brdf.is_isotropic());
    let at_rest = grained.then(|| Tangents::new(&scene.skeleton, &scene.mesh));
    let facets = model.and_then(|model| anew(model, scene));
    let posed = |pose: Pose, time_s| {
        let mut mesh = Deformed::default();
        let globals = scene.skeleton.globals(&pose.local);
        rig::deform(&scene.mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut mesh);
        if let Some(facets) = &facets {
            facets.apply(&scene.mesh.triangles, &mut mesh);
        }
        let tangents = at_rest.as_ref().map(|at_rest| {
            let mut out = Vec::new();
            let here = RigidFrame::IDENTITY;
            at_rest.pose(&scene.mesh, &globals, here, &mesh.normals, &mut out);
            out
        });
        Posed { pose, mesh, tangents, time_s }
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

/// How smooth the tangents are that a grain runs along.
fn grain(scene: &Scene, frame: &Posed) -> Option<String> {
    let tangents = frame.tangents.as_ref()?;
    let found = rig::smoothness(&scene.mesh.triangles, &frame.mesh.normals, tangents);
    Some(format!(
        "the grain runs along tangents made from the bones: between neighbours they turn by {:.1}° on \
         average, 99 % by less than {:.0}°",
        found.mean_degrees, found.p99_degrees
    ))
}

/// A clip by name.
///
/// # Errors
/// [`EvaluateError::Clip`] with the names that there are.
pub(super) fn find<'a>(scene: &'a Scene, name: &str) -> Result<&'a Clip, EvaluateError> {
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
pub(super) fn exposure(light: Option<&ShLight>, stops: f32) -> f32 {
    let brightest = light.map_or(1.0, ShLight::brightest_reflection);
    let scale = if brightest > 0.0 { 1.0 / brightest } else { 1.0 };
    scale as f32 * stops.exp2()
}

/// Why the truth of a still is not that of a model, if so.
pub(super) fn untold(model: &Model) -> Option<&'static str> {
    let bake = recipe_of_model(model).ok()?.bake;
    if bake.bounces > 0 {
        return Some(
            "the model holds light that other surfaces pass on, which rays to the sky do not tell",
        );
    }
    if bake.subsurface.is_some() {
        return Some(
            "the model holds light that travels below the surface, which rays to the sky do not tell",
        );
    }
    let blocked = "the model holds what its surroundings block, which are not in the scene";
    (!bake.surroundings.is_empty()).then_some(blocked)
}

#[cfg(test)]
pub(super) mod tests;
