//! A prepared job: scene, poses and checked recipe, with the hashes that name its results.

use std::path::Path;

use super::hash::{self, Hashes};
use super::recipe::Recipe;
use super::{Checked, Error};
use crate::pose::{self, PoseSet};
use crate::rig::{self, Deformed};
use crate::scene::{self, Limits, Scene};

/// Imports a scene within the default limits.
///
/// # Errors
/// [`Error::Scene`] naming the file.
pub fn import(path: &Path) -> Result<Scene, Error> {
    scene::import(path, &Limits::default())
        .map_err(|source| Error::Scene { file: path.display().to_string(), source })
}

/// Everything that a bake needs, checked and resolved.
#[derive(Debug)]
pub struct Job {
    /// The imported scene.
    pub scene: Scene,
    /// The recipe with the scene's name and hash filled in.
    pub recipe: Recipe,
    /// The recipe as the stages' settings.
    pub checked: Checked,
    /// Names of the results.
    pub hashes: Hashes,
    /// The poses with their parameters.
    pub poses: PoseSet,
}

impl Job {
    /// Imports the scene at a path and prepares its job.
    ///
    /// # Errors
    /// What import, the recipe's check or pose sampling objects to.
    pub fn open(path: &Path, recipe: Recipe) -> Result<Self, Error> {
        // The recipe first: a wrong number should not wait for a large file.
        Checked::new(&recipe)?;
        Self::new(import(path)?, recipe)
    }

    /// Prepares the job of an imported scene.
    ///
    /// # Errors
    /// What the recipe's check or pose sampling objects to.
    pub fn new(scene: Scene, mut recipe: Recipe) -> Result<Self, Error> {
        let checked = Checked::new(&recipe)?;
        let poses = pose::sample(&scene, &checked.poses)?;
        let scene_hash = hash::scene(&scene.sources);
        recipe.scene.file = scene.sources.first().map(|s| s.name.clone()).unwrap_or_default();
        recipe.scene.sha256 = Some(scene_hash.clone());
        let hashes = Hashes::of(&scene_hash, &recipe);
        Ok(Self { scene, recipe, checked, hashes, poses })
    }

    /// The mesh of one pose in the character's root frame.
    #[must_use]
    pub fn deformed(&self, pose: usize) -> Deformed {
        let sample = &self.poses.samples[pose];
        let globals = self.scene.skeleton.globals(&sample.pose.local);
        let mut out = Deformed::default();
        rig::deform(&self.scene.mesh, &globals, &sample.pose.weights, sample.root, &mut out);
        out
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
