//! A scene's mesh refined where its transfer changes.

mod beyond;
mod budget;
mod plan;
mod settings;
mod skin;
mod smooth;
mod source;
mod stage;

use std::borrow::Cow;
use std::sync::atomic::AtomicBool;

use crate::bake::subdivide::{
    Fidelity, Leaf, Probes, Refined, Refiner, Row, Source, Tessellation, Work,
};
use crate::bake::{self, Baker, MOST_RAYS, Place, Standing};
use crate::rig::{Deformed, Mix};
use crate::scene::{self, RefinedPart};

pub use beyond::Beyond;
pub(super) use plan::{Growth, growth};
pub use plan::{SubdivisionPlan, plan_subdivision};
pub use settings::Refinement;
pub(super) use settings::checked;
pub use stage::{
    REFINED, RefinedRecord, hash_of as refinement_hash, is_refinement, record_of, refined,
    refined_already,
};

use super::{Error, Job, RecipeError};
use skin::Skinned;
use smooth::Shape;
use source::{Surface, Views};

/// Rays of a probe, in those of a vertex.
const PROBE_RAYS: u32 = 4;

/// A refined scene.
#[derive(Debug)]
pub struct Subdivided {
    /// The file.
    pub glb: Vec<u8>,
    /// What was done.
    pub work: Work,
    /// Triangles before and after.
    pub triangles: [usize; 2],
    /// Vertices before and after.
    pub vertices: [usize; 2],
    /// Vertices that were baked and not used.
    pub in_vain: usize,
    /// The key poses, indices into the job's.
    pub key_poses: Vec<usize>,
    /// Of the new vertices: the largest distance from the posed triangle, metres; how many are beyond
    /// the bound, and how many have fitted weights.
    pub deviation: Deviation,
    /// The edges of the input that cannot meet the bound, the worst first.
    pub beyond: Vec<Beyond>,
    /// The character's size, metres.
    pub size_m: f32,
    /// Interpolation error before and after, where that was asked for.
    pub fidelity: Option<[Fidelity; 2]>,
    /// The probes' own noise, in the unit of their errors.
    pub probe_noise: Option<f32>,
    /// The first key pose's transfer at every vertex of the result, primitives of one instance each;
    /// `None` where a primitive has several.
    pub values: Option<Vec<f32>>,
    /// The estimate at every vertex: the largest of its triangles.
    pub errors: Vec<f32>,
}

/// How far skinning takes new vertices off the triangles they were made from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Deviation {
    /// The most over vertices and key poses, metres.
    pub most_m: f32,
    /// Vertices beyond the bound.
    pub beyond: usize,
    /// Vertices whose weights were fitted.
    pub fitted: usize,
}

impl Deviation {
    fn of(skinned: &Skinned, bound_m: f32) -> Self {
        let all = || skinned.deviations.iter().map(|off| off.most_m);
        Self {
            most_m: all().fold(0.0, f32::max),
            beyond: all().filter(|&off_m| off_m > bound_m).count(),
            fitted: skinned.fitted,
        }
    }
}

/// Refines the mesh of a job's scene, whose main file must be a glTF.
///
/// # Errors
/// What import, bake and file object to; [`Error::Stopped`].
pub fn subdivide(
    job: &Job,
    refinement: &Refinement,
    stop: &AtomicBool,
    tell: &mut dyn FnMut(usize),
) -> Result<Subdivided, Error> {
    direct(job)?;
    let mesh = &job.scene.mesh;
    let file = whole(job)?;
    let surface = surface(job, &file, refinement)?;
    let key_poses = job.poses.covering(refinement.key_poses);
    let baker = job.baker(&job.checked.bake, None)?;
    let posed: Vec<Deformed> = key_poses.iter().map(|&pose| job.traced(pose)).collect();
    let views =
        Views { mesh, surface: &surface, poses: standing(job, &baker, &key_poses, &posed)? };
    let areas = surface.areas(mesh, &posed[0]);
    let tessellation = Tessellation::new(&surface.triangles, surface.weld.clone());
    let given: Vec<Leaf> = tessellation.leaves().map(|leaf| tessellation.leaf(leaf)).collect();
    let rows = given_rows(job, &surface, &views, stop)?;
    let probes = probes(job, refinement, (&views, &key_poses, &posed), &areas, stop)?;
    let before = probes.as_ref().map(|probes| probes.compare(&given, &rows));
    let mut refiner = Refiner::new(tessellation, rows, &areas, (&views, refinement.measure), stop)?;
    let work = refiner.run(&refinement.goal, stop, tell)?;
    let refined = refiner.finish(stop)?;
    let after = probes.as_ref().map(|probes| probes.compare(&refined.triangles, &refined.rows));
    let all = place_all(&surface, &refined);
    let (parts, skinned) = parts(job, &surface, (&refined, &all), &key_poses, refinement);
    let bound_m = refinement.bound * job.poses.size_m;
    let off = (&skinned.deviations[..], bound_m);
    let beyond = beyond::beyond(job, &surface, &refined.places, off);
    let glb = scene::refine(&file, mesh, &parts).map_err(|source| in_file(job, source))?;
    Ok(Subdivided {
        glb,
        work,
        triangles: [surface.triangles.len(), refined.triangles.len()],
        vertices: [surface.weld.len(), refined.rows.len()],
        in_vain: refined.in_vain,
        key_poses,
        deviation: Deviation::of(&skinned, bound_m),
        beyond,
        size_m: job.poses.size_m,
        probe_noise: probes.as_ref().map(Probes::noise),
        fidelity: before.zip(after).map(|(before, after)| [before, after]),
        values: values(&surface, &refined, &all),
        errors: errors(&refined, &all),
    })
}

/// The scene's primitives, each once, within the budgets.
fn surface(job: &Job, file: &[u8], refinement: &Refinement) -> Result<Surface, Error> {
    let parts = &job.scene.mesh.parts;
    let origins = scene::primitives(file, parts).map_err(|source| in_file(job, source))?;
    let surface = Surface::new(&job.scene.mesh, &origins);
    refinement.check_room(surface.triangles.len(), surface.weld.len())?;
    Ok(surface)
}

/// Whether a job's scene can be refined as its recipe says, where it says that.
pub(super) fn check_scene(job: &Job) -> Result<(), Error> {
    match job.recipe.subdivide.as_ref().filter(|_| job.is_to_be_refined()) {
        None => Ok(()),
        Some(recipe) => surface(job, &whole(job)?, &Refinement::of(job, recipe)?).map(drop),
    }
}

/// The file that is written into: the scene's, its buffers taken in.
fn whole(job: &Job) -> Result<Cow<'_, [u8]>, Error> {
    scene::as_glb(&job.scene.sources).map_err(|source| in_file(job, source))
}

fn in_file(job: &Job, source: scene::Error) -> Error {
    Error::Scene { file: job.recipe.scene.file.clone(), source }
}

/// Places between vertices, with more rays than those have.
fn probes(
    job: &Job,
    refinement: &Refinement,
    (views, key_poses, posed): (&Views<'_>, &[usize], &[Deformed]),
    areas: &[f32],
    stop: &AtomicBool,
) -> Result<Option<Probes>, Error> {
    if refinement.probes == 0 {
        return Ok(None);
    }
    let rays = job.checked.bake.rays.saturating_mul(PROBE_RAYS).min(MOST_RAYS);
    let baker = job.baker(&bake::Settings { rays, ..job.checked.bake }, None)?;
    let poses = standing(job, &baker, key_poses, posed)?;
    let views = Views { poses, ..*views };
    let seed = job.recipe.bake.seed;
    Ok(Some(Probes::new(areas, refinement.probes, seed, &views, stop)?))
}

/// The queue looks at direct light, with the same rays everywhere.
fn direct(job: &Job) -> Result<(), RecipeError> {
    let bake = &job.recipe.bake;
    let expected = "a mesh is refined by direct light with equal rays: leave it out";
    let refuse = |field, found: Option<String>| match found {
        Some(found) => Err(RecipeError { field, found, expected }),
        None => Ok(()),
    };
    refuse("bake.bounces", (bake.bounces > 0).then(|| bake.bounces.to_string()))?;
    refuse("bake.noise", bake.noise.map(|noise| noise.to_string()))?;
    refuse("bake.vertex_fit", bake.vertex_fit.map(|samples| samples.to_string()))?;
    let receivers = bake.surroundings.receivers.as_ref().map(|receivers| receivers.file.clone());
    refuse("bake.surroundings.receivers", receivers)?;
    refuse("bake.more_rays", bake.more_rays.first().map(u32::to_string))?;
    refuse("bake.more_noise", bake.more_noise.first().map(f32::to_string))?;
    refuse("bake.subsurface", bake.subsurface.as_ref().map(|_| "stated".to_owned()))
}

fn standing<'a>(
    job: &Job,
    baker: &'a Baker,
    poses: &[usize],
    posed: &[Deformed],
) -> Result<Vec<Standing<'a>>, Error> {
    let one = |(&pose, mesh): (&usize, &Deformed)| {
        Ok(baker.stand(pose, &super::bake::posed(job, pose, mesh))?)
    };
    poses.iter().zip(posed).map(one).collect()
}

/// The rows of the input's vertices: of each point one vertex is baked. A vertex without a triangle
/// gets nothing, since nobody asks.
fn given_rows(
    job: &Job,
    surface: &Surface,
    views: &Views<'_>,
    stop: &AtomicBool,
) -> Result<Vec<Row>, Error> {
    let mut corner: Vec<Option<Place>> = vec![None; surface.weld.len()];
    for (triangle, corners) in (0_u32..).zip(&surface.triangles) {
        for (i, &vertex) in corners.iter().enumerate() {
            let weights = std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
            corner[vertex as usize].get_or_insert(Place { triangle, weights });
        }
    }
    let mut first_of = std::collections::BTreeMap::new();
    let mut same = vec![usize::MAX; corner.len()];
    for primitive in &surface.primitives {
        let start = job.scene.mesh.parts[primitive.parts[0]].vertices.start;
        for own in 0..primitive.vertices {
            let vertex = primitive.first_vertex + own;
            if corner[vertex].is_some() {
                // Another number of instances makes another row.
                let point = (job.poses.points.of_vertex[start + own], primitive.parts.len());
                let key = if primitive.parts.len() == 1 { (point, 0) } else { (point, vertex) };
                same[vertex] = *first_of.entry(key).or_insert(vertex);
            }
        }
    }
    let baked: Vec<usize> = (0..same.len()).filter(|&vertex| same[vertex] == vertex).collect();
    let places: Vec<Place> = baked.iter().filter_map(|&vertex| corner[vertex]).collect();
    let numbers: Vec<u64> = baked.iter().map(|&vertex| vertex as u64).collect();
    let found = views.look(&places, &numbers, stop)?;
    let mut rows = vec![Row::default(); corner.len()];
    for (&vertex, row) in baked.iter().zip(found) {
        rows[vertex] = row;
    }
    for vertex in 0..rows.len() {
        if same[vertex] != usize::MAX && same[vertex] != vertex {
            rows[vertex] = rows[same[vertex]].clone();
        }
    }
    Ok(rows)
}

/// Where a vertex of the refined surface went: its primitive, and its number there.
struct Placed {
    primitive: usize,
    number: u32,
}

/// Each primitive's own vertices keep their numbers, its new ones follow.
fn place_all(surface: &Surface, refined: &Refined) -> Vec<Placed> {
    let mut all = Vec::with_capacity(refined.rows.len());
    let mut next: Vec<u32> = Vec::new();
    for (index, primitive) in surface.primitives.iter().enumerate() {
        let number = |number| Placed { primitive: index, number };
        all.extend((0..primitive.vertices as u32).map(number));
        next.push(primitive.vertices as u32);
    }
    for place in &refined.places {
        let primitive = surface.primitive_of(place.triangle);
        all.push(Placed { primitive, number: next[primitive] });
        next[primitive] += 1;
    }
    all
}

fn parts(
    job: &Job,
    surface: &Surface,
    (refined, all): (&Refined, &[Placed]),
    key_poses: &[usize],
    refinement: &Refinement,
) -> (Vec<RefinedPart>, Skinned) {
    let mesh = &job.scene.mesh;
    let part_of = |primitive: usize| surface.primitives[primitive].parts[0];
    let mut parts: Vec<RefinedPart> = (0..surface.primitives.len())
        .map(|primitive| RefinedPart {
            part: part_of(primitive),
            added: Vec::new(),
            influences: Vec::new(),
            moved: Vec::new(),
            triangles: Vec::new(),
        })
        .collect();
    let mixes: Vec<Mix> = refined
        .places
        .iter()
        .map(|place| {
            let primitive = &surface.primitives[surface.primitive_of(place.triangle)];
            let start = mesh.parts[primitive.parts[0]].vertices.start - primitive.first_vertex;
            let corners = surface.triangles[place.triangle as usize];
            let vertices = corners.map(|vertex| start as u32 + vertex);
            Mix { vertices, weights: place.weights }
        })
        .collect();
    let shape = match refinement.smooth {
        true => Shape::smooth(mesh, surface, &refined.places),
        false => Shape::flat(),
    };
    let moved = shape.moved(mesh, &mixes);
    let bound_m = refinement.bound * job.poses.size_m;
    let skinned = skin::bind(job, (&mixes, &shape), key_poses, bound_m);
    for (index, (place, mix)) in refined.places.iter().zip(&mixes).enumerate() {
        let primitive = surface.primitive_of(place.triangle);
        let start = mesh.parts[part_of(primitive)].vertices.start as u32;
        let own = Mix { vertices: mix.vertices.map(|vertex| vertex - start), ..*mix };
        parts[primitive].added.push(own);
        parts[primitive].influences.push(skinned.influences[index].clone());
        parts[primitive].moved.extend(moved.get(index));
    }
    for leaf in &refined.triangles {
        let corners = leaf.corners.map(|vertex| all[vertex as usize].number);
        parts[surface.primitive_of(leaf.root)].triangles.push(corners);
    }
    (parts, skinned)
}

/// The first view's transfer by primitive and number, as import numbers the result.
fn values(surface: &Surface, refined: &Refined, all: &[Placed]) -> Option<Vec<f32>> {
    if surface.primitives.iter().any(|primitive| primitive.parts.len() > 1) {
        return None;
    }
    let views = refined.rows.iter().map(|row| row.normals.len()).max()?;
    let width = refined.rows.iter().map(|row| row.transfer.len()).max()? / views;
    let nothing = vec![0.0; width];
    let mut out = Vec::with_capacity(refined.rows.len() * width);
    for vertex in in_order(all) {
        let row = &refined.rows[vertex].transfer;
        out.extend_from_slice(row.get(..width).unwrap_or(&nothing));
    }
    Some(out)
}

fn errors(refined: &Refined, all: &[Placed]) -> Vec<f32> {
    let mut of_vertex = vec![0.0_f32; refined.rows.len()];
    for (leaf, &error) in refined.triangles.iter().zip(&refined.errors) {
        for corner in leaf.corners {
            let here = &mut of_vertex[corner as usize];
            *here = here.max(error);
        }
    }
    in_order(all).into_iter().map(|vertex| of_vertex[vertex]).collect()
}

/// Vertices by primitive, then by number.
fn in_order(all: &[Placed]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by_key(|&vertex| (all[vertex].primitive, all[vertex].number));
    order
}

#[cfg(test)]
mod tests;
