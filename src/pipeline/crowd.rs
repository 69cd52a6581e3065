//! Several characters that shadow one another and a floor: self-visibility from a model, cast shadows
//! from the spheres that each carries, combined by products of spherical harmonics (RPO09 §5.5), beside
//! rays.

mod settings;

use glam::{Affine3A, Quat, Vec3};
use rayon::prelude::*;

use super::evaluate::Query;
use super::gloss::{Gloss, GlossPoints, upright};
use super::recipe_of_model;
use super::still::{StillError, untold};
use crate::fit::sphere_set;
use crate::model::Model;
use crate::pose;
use crate::render::{Camera, Panel, Picture, Stage, captioned, sheet};
use crate::rig::{self, Deformed, Pose, RigidFrame, Tangents, to_tangent_frame};
use crate::scene::Scene;
use crate::sh::{MAX_COEFFICIENTS, Order, Rotation, TripleProduct, hemisphere_gram};
use crate::shade::{Sphere, SphereSet, SphereShadows};
use crate::trace;
use settings::check;
pub use settings::{Crowd, CrowdPlace, MOST_CHARACTERS};

/// A picture of characters and what is to be said of it.
#[derive(Debug, Clone, PartialEq)]
pub struct CrowdPicture {
    /// All panels in a row.
    pub picture: Picture,
    /// What values were multiplied with.
    pub exposure: f32,
    /// Root mean square difference of model and truth over what is seen, after exposure.
    pub difference: f32,
    /// The same of the model without the shadows that characters cast on one another and the floor.
    pub difference_without: f32,
    /// Spheres of one character.
    pub spheres: usize,
    /// Microseconds that shadows and products took at a vertex, on all threads together.
    pub vertex_us: f64,
}

/// Vertices of one piece of work.
const BLOCK: usize = 1024;

/// One character, or the floor.
#[derive(Default)]
struct Body {
    /// In the scene, placed.
    mesh: Deformed,
    triangles: Vec<[u32; 3]>,
    /// Unit, by vertex, where a reflectance has a grain; else of the floor alone.
    tangents: Vec<Vec3>,
    /// `[vertex][coefficient]`, in the scene's frame.
    visibility: Vec<f32>,
    spheres: Vec<Sphere>,
    is_floor: bool,
}

/// Renders characters of one scene at several places, by the model and by rays.
///
/// # Errors
/// See [`StillError`].
pub fn crowd(
    scene: &Scene,
    model: &Model,
    settings: &Crowd<'_>,
) -> Result<CrowdPicture, StillError> {
    check(settings)?;
    told(model)?;
    let valued = super::valued(model, scene)?;
    let scene = valued.scene.as_ref();
    let order = model.header().sh_order();
    let light = settings.light.resized(order);
    let material = settings.finish.reflectance()?;
    let reflector = settings.finish.operator("crowd", order, settings.terms)?;
    let gloss = Gloss::new(model, &light, reflector, settings.lobes)?;
    let set = sphere_set(&scene.skeleton, &scene.mesh, settings.spheres)?;
    let grained = !settings.finish.is_isotropic();
    let tangents = grained.then(|| Tangents::new(&scene.skeleton, &scene.mesh));
    let mut bodies = Vec::new();
    for place in &settings.places {
        bodies.push(character((scene, tangents.as_ref()), model, &set, place)?);
    }
    let bounds = bounds(&bodies);
    bodies.push(floor(bounds, settings.floor_vertices, order));
    let shadows = SphereShadows::new(order);
    // What of a body's spheres hide one another in its pose.
    let overlaps: Vec<f32> = bodies.par_iter().map(|body| shadows.overlap(&body.spheres)).collect();
    let start = std::time::Instant::now();
    let shadowed = shadowed(&bodies, (&shadows, &overlaps), bounds[0].y);
    let vertices: usize = bodies.iter().map(|body| body.mesh.positions.len()).sum();
    let vertex_us = start.elapsed().as_secs_f64() * 1e6 / vertices as f64;
    let camera = Camera::around(bounds, settings.view.map(f32::to_radians), settings.size);
    let shade = |visibility: &[Vec<f32>]| colours(&bodies, visibility, &gloss, camera.eye());
    let alone: Vec<Vec<f32>> = bodies.iter().map(|body| body.visibility.clone()).collect();
    let (with, without) = (shade(&shadowed), shade(&alone));
    let all = together(&bodies);
    let failed = |source| StillError::Trace { frame: 0, source };
    let device = trace::Device::new().map_err(failed)?;
    let stage = Stage::new(&device, &all.mesh.positions, &all.mesh.normals, &all.triangles, None)
        .map_err(failed)?;
    let stage = if grained { stage.with_tangents(&all.tangents) } else { stage };
    let (samples, rays) = (settings.samples, settings.rays);
    let model = stage.show(&camera, samples, &with);
    let truth = stage.reflected(&camera, (samples, rays), &light, &material);
    let exposure = super::still::exposure(Some(&light), settings.exposure_stops);
    let apart = |image: &crate::render::Image| exposure * image.rms_difference(&truth);
    let tone = settings.tone;
    let lit =
        |image, name| captioned(&Panel::Light { image, exposure, tone }, name, "of white", true);
    let mut panels = vec![lit(&model, "model and spheres"), lit(&truth, "truth")];
    for &gain in &settings.gains {
        let panel = Panel::Difference { image: &model, truth: &truth, exposure, gain };
        panels.push(captioned(&panel, &format!("difference x{gain}"), "of white", true));
    }
    Ok(CrowdPicture {
        picture: sheet(&panels, panels.len()),
        exposure,
        difference: apart(&model),
        difference_without: apart(&stage.show(&camera, samples, &without)),
        spheres: set.len(),
        vertex_us,
    })
}

/// Whether rays among characters and their floor tell what the model holds.
fn told(model: &Model) -> Result<(), StillError> {
    if let Some(why) = untold(model) {
        return Err(StillError::Untold(why));
    }
    let maximum = recipe_of_model(model).ok().and_then(|recipe| recipe.bake.max_distance_m);
    match maximum {
        Some(_) => Err(StillError::Untold(
            "it is blind beyond a distance, and the shadows of other characters are not",
        )),
        None => Ok(()),
    }
}

/// The scene's character at a place.
fn character(
    (scene, tangents): (&Scene, Option<&Tangents>),
    model: &Model,
    set: &SphereSet,
    place: &CrowdPlace,
) -> Result<Body, StillError> {
    let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let pose = match &place.clip {
        None => rest,
        Some((name, time_s)) => {
            let clip = super::still::find(scene, name)?;
            pose::evaluate(clip, time_s.rem_euclid(clip.duration_s.max(f32::MIN_POSITIVE)), &rest)
        }
    };
    let turn = Quat::from_rotation_y(place.yaw_degrees.to_radians());
    let [x, z] = place.at;
    let moved = Affine3A::from_rotation_translation(turn, Vec3::new(x, 0.0, z));
    let globals = scene.skeleton.globals(&pose.local);
    let mut mesh = Deformed::default();
    rig::deform(&scene.mesh, &globals, &pose.weights, RigidFrame::IDENTITY, &mut mesh);
    let mut along = Vec::new();
    if let Some(tangents) = tangents {
        tangents.pose(&scene.mesh, &globals, RigidFrame::IDENTITY, &mesh.normals, &mut along);
        along.iter_mut().for_each(|t| *t = turn * *t);
    }
    mesh.positions.iter_mut().for_each(|p| *p = moved.transform_point3(*p));
    mesh.normals.iter_mut().for_each(|n| *n = turn * *n);
    let mut spheres = Vec::new();
    set.pose(&globals, &pose.weights, (RigidFrame::IDENTITY, moved), &mut spheres);
    let query = Query::from_pose(model, scene, &pose)?;
    let to_scene = turn * query.root_frame(model)?.rotation;
    let mut values = Vec::new();
    query.values(model, None, None, &mut values)?;
    let order = model.header().sh_order();
    let rotation = Rotation::new(order, to_scene);
    let mut visibility = vec![0.0; values.len()];
    let count = order.coefficients();
    for (own, out) in values.chunks_exact(count).zip(visibility.chunks_exact_mut(count)) {
        rotation.apply(own, out);
    }
    let triangles = scene.mesh.triangles.clone();
    Ok(Body { mesh, triangles, tangents: along, visibility, spheres, is_floor: false })
}

/// A level floor under everything: fine where the characters are, with an outermost ring far away.
fn floor([low, high]: [Vec3; 2], along: usize, order: Order) -> Body {
    let (middle, reach) = (low * 0.5 + high * 0.5, high * 0.5 - low * 0.5);
    let side = reach.x.max(reach.z).max(f32::MIN_POSITIVE) * 1.5;
    let place = |i: usize| {
        let at = 2.0 * i as f32 / (along - 1) as f32 - 1.0;
        if i == 0 || i == along - 1 { 50.0 * side * at } else { side * at }
    };
    let mut body = Body { is_floor: true, ..Body::default() };
    for row in 0..along {
        for column in 0..along {
            let at = Vec3::new(middle.x + place(column), low.y, middle.z + place(row));
            body.mesh.positions.push(at);
        }
    }
    let vertices = body.mesh.positions.len();
    body.mesh.normals = vec![Vec3::Y; vertices];
    body.tangents = vec![Vec3::X; vertices];
    for cell in 0..(along - 1) * (along - 1) {
        let first = (cell / (along - 1) * along + cell % (along - 1)) as u32;
        let [a, b, c, d] = [0, 1, along as u32, along as u32 + 1].map(|step| first + step);
        body.triangles.extend([[a, c, b], [b, c, d]]);
    }
    let mut open = vec![0.0; order.coefficients()];
    open[0] = (4.0 * std::f32::consts::PI).sqrt();
    body.visibility = open.repeat(vertices);
    body
}

/// Every body's visibility among the others: times the exponential of what their spheres block, and
/// above the floor times the upper half space.
fn shadowed(
    bodies: &[Body],
    (shadows, overlaps): (&SphereShadows, &[f32]),
    ground: f32,
) -> Vec<Vec<f32>> {
    let order = shadows.order();
    let gamma = TripleProduct::new(order, order, order);
    let upper = upper_half(order);
    let count = order.coefficients();
    let one = |i: usize, body: &Body| -> Vec<f32> {
        let others: Vec<(&[Sphere], f32)> = bodies
            .iter()
            .zip(overlaps)
            .enumerate()
            .filter(|(j, (other, _))| *j != i && !other.spheres.is_empty())
            .map(|(_, (other, overlap))| (other.spheres.as_slice(), *overlap))
            .collect();
        let rows = body.visibility.par_chunks_exact(count).zip(&body.mesh.positions);
        let product = |(own, &at): (&[f32], &Vec3)| {
            let (mut cast, mut both) = ([0.0; MAX_COEFFICIENTS], [0.0; MAX_COEFFICIENTS]);
            shadows.among_bodies(at, others.iter().copied(), &mut cast);
            gamma.product(own, &cast, &mut both);
            if !body.is_floor && at.y > ground {
                cast = both;
                gamma.product(&cast, &upper, &mut both);
            }
            both[..count].to_vec()
        };
        rows.flat_map_iter(product).collect()
    };
    bodies.iter().enumerate().map(|(i, body)| one(i, body)).collect()
}

/// The function that is 1 over the horizon and 0 below it.
fn upper_half(order: Order) -> [f32; MAX_COEFFICIENTS] {
    let gram = hemisphere_gram(order, Vec3::Y);
    let open = (4.0 * std::f64::consts::PI).sqrt();
    let mut out = [0.0; MAX_COEFFICIENTS];
    let first = gram.iter().take(order.coefficients());
    out.iter_mut().zip(first).for_each(|(out, g)| *out = (open * g) as f32);
    out
}

/// Radiance towards the eye at every vertex of every body.
fn colours(bodies: &[Body], visibility: &[Vec<f32>], gloss: &Gloss, eye: Vec3) -> Vec<f32> {
    let of_body = |(body, values): (&Body, &Vec<f32>)| -> Vec<f32> {
        let count = values.len() / body.mesh.positions.len().max(1);
        let normals = &body.mesh.normals;
        let to_local: Vec<Quat> = match body.tangents.len() == normals.len() {
            true => {
                normals.iter().zip(&body.tangents).map(|(&n, &t)| to_tangent_frame(n, t)).collect()
            }
            false => normals.iter().copied().map(upright).collect(),
        };
        let blocks = values.par_chunks(BLOCK * count.max(1));
        let places = body.mesh.positions.par_chunks(BLOCK).zip(to_local.par_chunks(BLOCK));
        let shade = |(visibility, (positions, to_local))| {
            gloss
                .shade(GlossPoints { visibility, is_local: false, positions, to_local, eye })
                .into_flattened()
        };
        blocks.zip(places).flat_map_iter(shade).collect()
    };
    bodies.iter().zip(visibility).flat_map(of_body).collect()
}

/// All bodies as one mesh.
fn together(bodies: &[Body]) -> Body {
    let mut all = Body::default();
    for body in bodies {
        let first = all.mesh.positions.len() as u32;
        all.mesh.positions.extend(&body.mesh.positions);
        all.mesh.normals.extend(&body.mesh.normals);
        all.tangents.extend(&body.tangents);
        all.triangles.extend(body.triangles.iter().map(|t| t.map(|vertex| first + vertex)));
    }
    all
}

/// The box around all characters, with a little of the floor.
fn bounds(bodies: &[Body]) -> [Vec3; 2] {
    let all = bodies.iter().flat_map(|body| &body.mesh.positions);
    let start = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    let [low, high] = all.fold(start, |[low, high], &p| [low.min(p), high.max(p)]);
    let room = Vec3::new(0.25, 0.0, 0.25) * (high - low).max_element();
    if low.is_finite() && high.is_finite() {
        [low - room, high + room]
    } else {
        [Vec3::ZERO, Vec3::ONE]
    }
}

#[cfg(test)]
mod tests;
