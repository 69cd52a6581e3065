//! A scene's mesh refined where its transfer changes.

mod beyond;
mod budget;
mod parts;
mod plan;
mod settings;
mod skin;
mod smooth;
mod source;
mod stage;
mod together;
mod truth;

use std::borrow::Cow;
use std::sync::atomic::AtomicBool;

use crate::bake::subdivide::{Fidelity, Probes, Refined, Refiner, Row, Source, Work};
use crate::bake::{Baker, Standing};
use crate::rig::Deformed;
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
pub use truth::{Worst, interpolation_probes};

use super::{Error, Job, RecipeError};
use beyond::Stiff;
use parts::Placed;
use skin::Skinned;
use source::{Remembered, Surface, Views};

/// Times that a surface is refined anew so that the bound is kept.
const MOST_TRIES: usize = 12;

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
    /// Edges and triangles of the input that stay whole so that the bound is kept.
    pub stiff: usize,
    /// The character's size, metres.
    pub size_m: f32,
    /// Interpolation error before and after, where that was asked for.
    pub fidelity: Option<[Fidelity; 2]>,
    /// In which triangles that is the most.
    pub worst: Option<[Worst; 2]>,
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

/// Refines the mesh of a job's scene, whose main file must be a glTF; `probes`, of the same job and as
/// many key poses, compare interpolation with the truth before and after.
///
/// # Errors
/// What import, bake and file object to; [`Error::Stopped`].
pub fn subdivide(
    job: &Job,
    refinement: &Refinement,
    probes: Option<&Probes>,
    stop: &AtomicBool,
    tell: &mut dyn FnMut(usize),
) -> Result<Subdivided, Error> {
    direct(job)?;
    let mesh = &job.scene.mesh;
    let file = whole(job)?;
    let surface = surface(job, &file)?;
    refinement.check_room(surface.triangles.len(), surface.weld.len())?;
    let key_poses = job.poses.covering(refinement.key_poses);
    let baker = job.baker(&job.checked.bake, None)?;
    let posed: Vec<Deformed> = key_poses.iter().map(|&pose| job.traced(pose)).collect();
    let views =
        Views { mesh, surface: &surface, poses: standing(job, &baker, &key_poses, &posed)? };
    let areas = surface.areas(mesh, &posed[0]);
    let rows = truth::given_rows(job, &surface, &views, stop)?;
    let given = surface.leaves();
    let before = probes.map(|probes| probes.compare(&given, &rows));
    let scene =
        Refining { job, refinement, surface: &surface, areas: &areas, key_poses: &key_poses };
    let bound_m = refinement.bound * job.poses.size_m;
    let remembered = Remembered::new(&views);
    let mut stiff = Stiff::default();
    let mut tries = 1;
    let done = loop {
        let source: &dyn Source = if refinement.keep_bound { &remembered } else { &views };
        let done = scene.refine((source, &rows), &stiff, stop, tell)?;
        let off = (&done.skinned.deviations[..], bound_m);
        let is_kept = !refinement.keep_bound || !stiff.add(&surface, &done.refined.places, off);
        if is_kept || tries == MOST_TRIES {
            break done;
        }
        tries += 1;
    };
    let Done { work, refined, placed, parts, skinned } = done;
    let after = probes.map(|probes| probes.compare(&refined.triangles, &refined.rows));
    let fidelity = before.zip(after).map(|(before, after)| [before, after]);
    let worst = fidelity.map(|[before, after]| {
        let of = |wrong| Worst::of(job, &surface, wrong, &posed[0]);
        [of((&before, &given[..])), of((&after, &refined.triangles[..]))]
    });
    let off = (&skinned.deviations[..], bound_m);
    Ok(Subdivided {
        glb: scene::refine(&file, mesh, &parts).map_err(|source| in_file(job, source))?,
        work,
        triangles: [surface.triangles.len(), refined.triangles.len()],
        vertices: [surface.weld.len(), refined.rows.len()],
        in_vain: refined.in_vain,
        deviation: Deviation::of(&skinned, bound_m),
        beyond: beyond::beyond(job, &surface, &refined.places, off),
        stiff: stiff.count(),
        size_m: job.poses.size_m,
        probe_noise: probes.map(Probes::noise),
        fidelity,
        worst,
        values: parts::values(&surface, &refined, &placed),
        errors: parts::errors(&refined, &placed),
        key_poses,
    })
}

/// What every try to refine a surface has in common.
struct Refining<'a> {
    job: &'a Job,
    refinement: &'a Refinement,
    surface: &'a Surface,
    areas: &'a [f32],
    key_poses: &'a [usize],
}

/// What one came to.
struct Done {
    work: Work,
    refined: Refined,
    placed: Vec<Placed>,
    parts: Vec<RefinedPart>,
    skinned: Skinned,
}

impl Refining<'_> {
    fn refine(
        &self,
        (source, rows): (&dyn Source, &[Row]),
        stiff: &Stiff,
        stop: &AtomicBool,
        tell: &mut dyn FnMut(usize),
    ) -> Result<Done, Error> {
        let Self { job, refinement, surface, .. } = *self;
        let mut tessellation = surface.tessellation(&job.scene.mesh);
        stiff.stiffen(&mut tessellation);
        let by = (source, refinement.measure);
        let mut refiner = Refiner::new(tessellation, rows.to_vec(), self.areas, by, stop)?;
        let work = refiner.run(&refinement.goal, stop, tell)?;
        let refined = refiner.finish(stop)?;
        let placed = parts::place_all(surface, &refined);
        let new = (&refined, &placed[..]);
        let (parts, skinned) = parts::parts(job, surface, new, self.key_poses, refinement);
        Ok(Done { work, refined, placed, parts, skinned })
    }
}

/// The scene's primitives, each once.
fn surface(job: &Job, file: &[u8]) -> Result<Surface, Error> {
    let parts = &job.scene.mesh.parts;
    let origins = scene::primitives(file, parts).map_err(|source| in_file(job, source))?;
    Ok(Surface::new(&job.scene.mesh, &origins))
}

/// Whether a job's scene can be refined as its recipe says, where it says that.
pub(super) fn check_scene(job: &Job) -> Result<(), Error> {
    let Some(recipe) = job.recipe.subdivide.as_ref().filter(|_| job.is_to_be_refined()) else {
        return Ok(());
    };
    let refinement = Refinement::of(job, recipe)?;
    let surface = surface(job, &whole(job)?)?;
    Ok(refinement.check_room(surface.triangles.len(), surface.weld.len())?)
}

/// The file that is written into: the scene's, its buffers taken in.
fn whole(job: &Job) -> Result<Cow<'_, [u8]>, Error> {
    scene::as_glb(&job.scene.sources).map_err(|source| in_file(job, source))
}

fn in_file(job: &Job, source: scene::Error) -> Error {
    Error::Scene { file: job.recipe.scene.file.clone(), source }
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

#[cfg(test)]
mod tests;
