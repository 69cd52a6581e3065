//! A prepared job: scene, poses and checked recipe, with the hashes that name its results.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use glam::Vec3;

use super::checked::checked_normals;
use super::hash::{self, Hashes};
use super::receivers::Receivers;
use super::recipe::{BakeRecipe, DEFAULT_ALBEDO, NoiseGoalName, PosesRecipe, Recipe};
use super::surroundings::{self, Occluders};
use super::{Checked, Error, Lit, RecipeError, effective, effective_parametrisation, normals};
use crate::bake::{self, Baker, Openings, Reflectance};
use crate::model::PosedPoints;
use crate::pose::{self, PoseSet};
use crate::rig::{self, Deformed, Facets, Pose, RigidFrame, Tangents};
use crate::scene::{self, Content, Limits, Scene};

/// Imports a scene within the default limits.
///
/// # Errors
/// [`Error::Scene`] naming the file.
pub fn import(path: &Path) -> Result<Scene, Error> {
    import_content(path, Content::Shape)
}

/// As [`import`], of a `.gltf` that may be without its buffers; whether it needs none.
///
/// # Errors
/// [`Error::Scene`].
pub fn check_document(path: &Path) -> Result<bool, Error> {
    scene::check_document(path, &Limits::default())
        .map_err(|source| Error::Scene { file: path.display().to_string(), source })
}

/// What of a scene's file a recipe needs.
pub(super) fn content(recipe: &Recipe) -> Content {
    let BakeRecipe { bounces, surroundings, .. } = &recipe.bake;
    if *bounces == 0 && !surroundings.transparency && !surroundings.one_sided {
        return Content::Shape;
    }
    let plain = recipe.bake.albedo.unwrap_or(DEFAULT_ALBEDO);
    Content::Surface { plain, transparency: surroundings.transparency }
}

/// What of a file that stands around it: light passes through it, and is not passed on.
pub(super) fn content_around(recipe: &Recipe) -> Content {
    let around = &recipe.bake.surroundings;
    if around.transparency || around.one_sided { content(recipe) } else { Content::Shape }
}

/// Imports a scene within the default limits, as far as it is asked for.
fn import_content(path: &Path, content: Content) -> Result<Scene, Error> {
    scene::import_content(path, &Limits::default(), content)
        .map_err(|source| Error::Scene { file: path.display().to_string(), source })
}

/// Scenes that stand around the character's, as the recipe names them.
#[derive(Debug, Clone, Default)]
pub struct Around {
    /// What only blocks.
    pub occluders: Option<Scene>,
    /// What only receives.
    pub receivers: Option<Scene>,
}

/// Everything that a bake needs, checked and resolved.
#[derive(Debug)]
pub struct Job {
    /// The imported scene, without what only blocks.
    pub scene: Scene,
    /// What only blocks.
    pub occluders: Occluders,
    /// What of the scene's mesh was appended to receive.
    pub receivers: Receivers,
    /// The recipe with the scene's name and hash filled in.
    pub recipe: Recipe,
    /// The recipe as the stages' settings.
    pub checked: Checked,
    /// Names of the results.
    pub hashes: Hashes,
    /// The poses with their parameters.
    pub poses: PoseSet,
    /// What stands around the character.
    pub surroundings: bake::Surroundings,
    /// What passes light on, where light bounces.
    pub reflectance: Option<Reflectance>,
    /// What lets rays through, where that is asked for.
    pub openings: Option<Openings>,
    /// What pictures are lit by.
    pub lit: Option<Lit>,
    /// What computes the normals of poses anew, where that is asked for.
    pub facets: Option<Facets>,
    /// What there is to say of points inside other geometry; looked for when first asked.
    pub(super) buried: OnceLock<Vec<String>>,
    /// Of the mesh's vertices at rest; as the skin carries them. Made when first asked for.
    pub(super) tangents: OnceLock<(Vec<[i8; 3]>, Tangents)>,
}

impl Job {
    /// Imports the scene at a path and prepares its job.
    ///
    /// # Errors
    /// What import, the recipe's check or pose sampling objects to.
    pub fn open(path: &Path, recipe: Recipe) -> Result<Self, Error> {
        // The recipe first: a wrong number should not wait for a large file.
        Checked::new(&recipe)?;
        effective(&recipe)?;
        let named = &recipe.bake.surroundings;
        let around = content_around(&recipe);
        let read = |file: Option<&String>| {
            file.map(|file| import_content(Path::new(file), around)).transpose()
        };
        let occluders = read(named.occluders.as_ref().map(|named| &named.file))?;
        let receivers = read(named.receivers.as_ref().map(|named| &named.file))?;
        let scene = import_content(path, content(&recipe))?;
        let stated = Some(recipe.poses.parametrisation);
        let stated = stated.filter(|&name| name != PosesRecipe::default().parametrisation);
        effective_parametrisation(stated.or(recipe.fit.parametrisation), scene.is_sequence)?;
        Self::among(scene, Around { occluders, receivers }, recipe)
    }

    /// Prepares the job of an imported scene, and of the scene that the recipe's occluders name.
    ///
    /// # Errors
    /// What the recipe's check, pose sampling or the surroundings object to.
    pub fn new(scene: Scene, still: Option<Scene>, recipe: Recipe) -> Result<Self, Error> {
        Self::among(scene, Around { occluders: still, receivers: None }, recipe)
    }

    /// As [`Self::new`], with the scene of the recipe's receivers.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn among(mut scene: Scene, around: Around, mut recipe: Recipe) -> Result<Self, Error> {
        let mut checked = Checked::new(&recipe)?;
        let lit = Lit::take(&mut recipe)?;
        Receivers::resolve(&scene, around.receivers.as_ref(), &mut recipe)?;
        let occluders = Occluders::take(&mut scene, around.occluders, &mut recipe)?;
        checked.poses.root_motion = occluders.root_motion(&scene, &recipe.bake.surroundings);
        let mut poses = pose::sample(&scene, &checked.poses)?;
        let recomputed = normals::resolve(&mut recipe.bake, &scene.mesh, &poses)?;
        checked_normals(&recipe)?;
        scene.notices.extend(recomputed);
        let receivers = Receivers::add(&mut scene, &poses, around.receivers);
        let own = receivers.parts_before(&scene.mesh);
        let kinds = surroundings::kinds(&recipe.bake, &scene.mesh, own);
        if kinds.iter().any(|&kind| kind > 0) {
            poses.take_in(&scene, &kinds);
        }
        deep_enough(checked.subsurface, poses.size_m)?;
        let scene_hash = hash::scene(&scene.sources);
        forget_other_scene(&mut recipe, &scene_hash);
        recipe.scene.file = scene.sources.first().map(|s| s.name.clone()).unwrap_or_default();
        recipe.scene.sha256 = Some(scene_hash.clone());
        if checked.noises.last().is_some() {
            recipe.bake.noise_goal.get_or_insert(NoiseGoalName::Each);
        }
        let hashes = Hashes::of(&scene_hash, &recipe);
        let surroundings = bake::Surroundings::default();
        let surface = scene.surface.take().map(Arc::new);
        let all = surface.clone().map(|lit| {
            let received = receivers.surface();
            occluders.surface_after(lit, (received, scene.mesh.triangles.len()))
        });
        let openings = all.and_then(|surface| openings(surface, &recipe));
        let surface = surface.filter(|_| recipe.bake.bounces > 0);
        let reflectance = surface.map(|surface| reflectance(surface, recipe.bake.bounces));
        let mut job = Self {
            scene,
            occluders,
            receivers,
            recipe,
            checked,
            hashes,
            poses,
            surroundings,
            reflectance,
            openings,
            lit,
            facets: None,
            buried: OnceLock::new(),
            tangents: OnceLock::new(),
        };
        job.facets = normals::facets(&job.recipe.bake, &job.scene);
        let around = &job.recipe.bake.surroundings;
        let character = |pose| job.receivers.without(job.deformed(pose));
        let mesh = &job.scene.mesh;
        let (mut resolved, notices) = surroundings::resolve(around, mesh, &job.poses, character)?;
        job.receivers.hide(&mut resolved.views, &job.poses.points, mesh.triangles.len());
        job.surroundings = resolved;
        job.scene.notices.extend(notices);
        job.skin()?;
        super::subdivide::check_scene(&job)?;
        Ok(job)
    }

    /// Whether the recipe asks for a finer mesh than the scene's: [`super::refined`] makes the job of it,
    /// which is what can be baked.
    #[must_use]
    pub fn is_to_be_refined(&self) -> bool {
        self.recipe.subdivide.as_ref().is_some_and(|subdivide| subdivide.of.is_none())
    }

    /// The mesh at rest with everything that only blocks, in the scene.
    fn rest(&self) -> Deformed {
        let mesh = &self.scene.mesh;
        let rest = Pose::rest(&self.scene.skeleton, &mesh.default_weights);
        let globals = self.scene.skeleton.globals(&rest.local);
        let mut out = Deformed::default();
        rig::deform(mesh, &globals, &rest.weights, RigidFrame::IDENTITY, &mut out);
        self.occluders.append(&globals, &rest.weights, RigidFrame::IDENTITY, &mut out);
        out
    }

    /// The mesh of one pose in the character's root frame.
    #[must_use]
    pub fn deformed(&self, pose: usize) -> Deformed {
        let sample = &self.poses.samples[pose];
        let globals = self.scene.skeleton.globals(&sample.pose.local);
        let mut out = Deformed::default();
        rig::deform(&self.scene.mesh, &globals, &sample.pose.weights, sample.root, &mut out);
        if let Some(facets) = &self.facets {
            facets.apply(&self.scene.mesh.triangles, &mut out);
        }
        self.receivers.settle(&mut out);
        out
    }

    /// The same with everything that only blocks, as [`Self::baker`] takes it.
    #[must_use]
    pub fn traced(&self, pose: usize) -> Deformed {
        let mut out = self.deformed(pose);
        let sample = &self.poses.samples[pose];
        let globals = self.scene.skeleton.globals(&sample.pose.local);
        self.occluders.append(&globals, &sample.pose.weights, sample.root, &mut out);
        out
    }

    /// What bakes the job's poses with these settings, and to a noise where one is given.
    ///
    /// # Errors
    /// What [`Baker::new`] and [`Baker::within`] object to.
    pub fn baker(
        &self,
        settings: &bake::Settings,
        noise: Option<bake::Noise>,
    ) -> Result<Baker, Error> {
        let baker = self.stating(settings)?;
        Ok(match noise {
            Some(noise) => baker.to_noise(noise, settings)?,
            None => baker,
        })
    }

    /// The same to a noise, on top of rounds of so many rays that every point has.
    ///
    /// # Errors
    /// As [`Self::baker`].
    pub(super) fn baker_beside(
        &self,
        settings: &bake::Settings,
        noise: bake::Noise,
        rounds: &[u32],
    ) -> Result<Baker, Error> {
        Ok(self.stating(settings)?.to_noise_beside(noise, settings, rounds)?)
    }

    /// What bakes stated rays, in all that stands around.
    fn stating(&self, settings: &bake::Settings) -> Result<Baker, Error> {
        let (triangles, points) = self.occluders.with(&self.scene.mesh, &self.poses.points);
        let baker = Baker::new(&triangles, &points, settings)?.within(self.surroundings.clone())?;
        let baker = match &self.openings {
            Some(openings) => baker.through(openings.clone()),
            None => baker,
        };
        let baker = match (self.recipe.bake.vertex_fit, &self.reflectance) {
            (Some(samples), _) => baker.fitted(&self.rest().positions, samples)?,
            (None, Some(reflectance)) => baker.reflecting(reflectance.clone())?,
            (None, None) => baker,
        };
        match self.checked.subsurface {
            Some(subsurface) => Ok(baker.diffusing_at(subsurface, self.skin()?)?),
            None => Ok(baker),
        }
    }

    /// The points that light travels below the surface of.
    fn skin(&self) -> Result<Vec<u32>, Error> {
        let Some(below) = &self.recipe.bake.subsurface else { return Ok(Vec::new()) };
        let mesh = &self.scene.mesh;
        let own = self.receivers.parts_before(mesh);
        surroundings::skin(below, mesh, own, &self.poses.points)
    }

    /// Colour channels of the bake.
    #[must_use]
    pub fn channels(&self) -> usize {
        let surface = self.reflectance.as_ref().map_or(1, |reflectance| reflectance.channels);
        self.checked.subsurface.map_or(surface, |below| below.channels(surface))
    }

    /// The points of one pose in the character's root frame, with their tangents where asked for.
    #[must_use]
    pub fn surface(&self, pose: usize, with_tangents: bool) -> PosedPoints {
        let Deformed { positions, normals } = self.deformed(pose);
        let mut tangents = Vec::new();
        if with_tangents {
            let sample = &self.poses.samples[pose];
            let globals = self.scene.skeleton.globals(&sample.pose.local);
            let mesh = &self.scene.mesh;
            self.tangents().pose(mesh, &globals, sample.root, &normals, &mut tangents);
        }
        let of_points = |vectors: &[Vec3]| {
            let vertices = self.poses.points.vertex.iter();
            vertices.filter_map(|&vertex| vectors.get(vertex as usize)).copied().collect()
        };
        PosedPoints {
            positions: of_points(&positions),
            normals: of_points(&normals),
            tangents: of_points(&tangents),
        }
    }

    /// Tangents of the mesh's vertices as its skin carries them.
    pub(super) fn tangents(&self) -> &Tangents {
        &self.tangents_at_rest().1
    }

    /// Tangents of the points at rest, as a model keeps them.
    pub(super) fn tangents_of_points(&self) -> Vec<[i8; 3]> {
        let (bytes, _) = self.tangents_at_rest();
        self.poses.points.vertex.iter().map(|&vertex| bytes[vertex as usize]).collect()
    }

    fn tangents_at_rest(&self) -> &(Vec<[i8; 3]>, Tangents) {
        self.tangents.get_or_init(|| {
            let (skeleton, mesh) = (&self.scene.skeleton, &self.scene.mesh);
            // What is fitted is what the model's bytes say.
            let bytes = rig::tangents_to_bytes(&rig::tangents_at_rest(skeleton, mesh));
            let carried = Tangents::of(skeleton, mesh, &rig::tangents_from_bytes(&bytes));
            (bytes, carried)
        })
    }

    /// Where the points are at rest.
    pub(super) fn rest_points(&self) -> Vec<Vec3> {
        let positions = self.rest().positions;
        self.poses.points.vertex.iter().map(|&vertex| positions[vertex as usize]).collect()
    }

    /// The key of a pose's clip in random streams: a hash of the clip's name, so that neither the
    /// order nor the number of clips changes what is drawn.
    #[must_use]
    pub fn clip_key(&self, pose: usize) -> u64 {
        let name = self.poses.clip_names.get(self.poses.samples[pose].clip);
        let bytes = name.map_or(&[][..], String::as_bytes);
        let words: Vec<u64> = bytes.iter().map(|&byte| u64::from(byte)).collect();
        crate::num::random::hash(&words)
    }
}

/// A recipe that was resolved for a refined scene is that scene's; any other is refined anew.
fn forget_other_scene(recipe: &mut Recipe, scene: &str) {
    let is_refined = recipe.scene.sha256.as_deref() == Some(scene);
    if let Some(subdivide) = recipe.subdivide.as_mut().filter(|_| !is_refined) {
        subdivide.of = None;
    }
}

/// A mean free path beyond the mesh's size is one in another unit.
fn deep_enough(subsurface: Option<bake::Subsurface>, size_m: f32) -> Result<(), Error> {
    match subsurface.map(|below| below.longest_m()) {
        Some(longest_m) if longest_m > size_m => Err(Error::Recipe(RecipeError {
            field: "bake.subsurface",
            found: format!("a mean free path of {longest_m} m in a mesh of {size_m} m"),
            expected: "it must be no longer than the mesh; is it in metres, and the mesh too?",
        })),
        _ => Ok(()),
    }
}

fn reflectance(surface: Arc<scene::Surface>, bounces: u32) -> Reflectance {
    let channels = if surface.is_grey() { 1 } else { 3 };
    Reflectance { bounces, channels, surface }
}

fn openings(surface: Arc<scene::Surface>, recipe: &Recipe) -> Option<Openings> {
    let around = &recipe.bake.surroundings;
    let (alpha, one_sided) = (around.transparency, around.one_sided);
    (alpha || one_sided).then_some(Openings { surface, alpha, one_sided })
}

#[cfg(test)]
#[path = "job_tests.rs"]
mod tests;
