//! What a job is asked for, and whether it can start.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use axum::http::StatusCode;
use serde::{Deserialize, Serialize};

use super::Service;
use super::answer::{document, is_sha256};
use super::assets::bad_asset;
use super::files::link;
use super::problem::Problem;
use super::store::create;
use crate::pipeline::recipe::{Recipe, VERSION};
use crate::pipeline::{self, Checked, Job};

/// Files of one job.
const MOST_FILES: usize = 256;

/// Bytes of a file's name within a scene.
const MOST_NAME_BYTES: usize = 255;

/// A request for a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct JobRequest {
    /// What is to be done.
    pub(super) kind: Kind,
    /// The files of the scene: name → SHA-256 of an uploaded asset.
    pub(super) assets: BTreeMap<String, String>,
    /// The recipe; `scene.file` is one of `assets`, and may be left out where there is only one.
    pub(super) recipe: Recipe,
    /// Higher ones run first.
    #[serde(default)]
    pub(super) priority: i32,
}

/// Kinds of jobs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Kind {
    /// Bake, fit, measure and report.
    Run,
}

impl JobRequest {
    /// Reads and checks everything that can be checked without the scene.
    ///
    /// # Errors
    /// The first field at fault.
    pub(super) fn read(body: &[u8]) -> Result<Self, Problem> {
        check_version(body)?;
        let mut request: Self = document(body)?;
        Checked::new(&request.recipe).map_err(|error| of_recipe(&error))?;
        if request.assets.is_empty() || request.assets.len() > MOST_FILES {
            let fault = format!("a job has 1 to {MOST_FILES} files");
            return Err(Problem::field("#/assets", fault));
        }
        for (name, sha256) in &request.assets {
            let pointer = format!("#/assets/{}", name.replace('~', "~0").replace('/', "~1"));
            if !is_safe(name) {
                let fault = "a name is relative, with `/` between parts, and leaves no folder";
                return Err(Problem::field(pointer, fault));
            }
            if !is_sha256(sha256) {
                let fault = "an asset is named by 64 lower-case hexadecimal digits";
                return Err(Problem::field(pointer, fault));
            }
        }
        let file = &mut request.recipe.scene.file;
        if let (true, Some(only), 1) =
            (file.is_empty(), request.assets.keys().next(), request.assets.len())
        {
            file.clone_from(only);
        }
        // Filled in when the recipe is resolved; what a client says here has no part in it.
        request.recipe.scene.sha256 = None;
        let named = request.recipe.bake.surroundings.occluders.as_ref().map(|o| &o.file);
        let scene = ("#/recipe/scene/file", &request.recipe.scene.file);
        let occluders = named.map(|file| ("#/recipe/bake/surroundings/occluders/file", file));
        for (pointer, file) in [Some(scene), occluders].into_iter().flatten() {
            if !request.assets.contains_key(file) {
                let known: Vec<&str> = request.assets.keys().map(String::as_str).collect();
                let fault = format!("`{file}` is none of the job's assets, {}", known.join(", "));
                return Err(Problem::field(pointer, fault));
            }
        }
        Ok(request)
    }

    /// Lays the scene's files out in a folder, under the names that the recipe has for them.
    ///
    /// # Errors
    /// `unknown-asset`; what the disk objects to.
    pub(super) fn lay_out(&self, service: &Service, folder: &Path) -> Result<(), Problem> {
        for (name, sha256) in &self.assets {
            if service.store.asset(sha256)?.is_none() {
                let pointer = format!("#/assets/{}", name.replace('~', "~0").replace('/', "~1"));
                let fault = format!("no asset {sha256} was uploaded");
                let status = StatusCode::UNPROCESSABLE_ENTITY;
                return Err(Problem::new(status, "unknown-asset", fault.clone()).at(pointer, fault));
            }
            let path = folder.join(name);
            create(path.parent().unwrap_or(folder))?;
            link(&service.store.folder().asset(sha256), &path)?;
        }
        Ok(())
    }

    /// Prepares the job of a scene that is laid out.
    ///
    /// # Errors
    /// What import, the recipe's check or pose sampling object to.
    pub(super) fn open(&self, folder: &Path) -> Result<Job, pipeline::Error> {
        let mut recipe = self.recipe.clone();
        if let Some(occluders) = &mut recipe.bake.surroundings.occluders {
            occluders.file = folder.join(&occluders.file).display().to_string();
        }
        Job::open(&self.scene(folder), recipe)
    }

    /// The scene's main file.
    fn scene(&self, folder: &Path) -> PathBuf {
        folder.join(&self.recipe.scene.file)
    }
}

/// The version before all else, since fields of another one would be called unknown.
fn check_version(body: &[u8]) -> Result<(), Problem> {
    #[derive(Deserialize)]
    struct Outer {
        recipe: Option<Inner>,
    }
    #[derive(Deserialize)]
    struct Inner {
        version: Option<serde_json::Number>,
    }
    // A body that is none of this is refused with its reason when it is read in earnest.
    let Ok(Outer { recipe: Some(Inner { version: Some(version) }) }) = serde_json::from_slice(body)
    else {
        return Ok(());
    };
    if version.as_u64() == Some(u64::from(VERSION)) {
        return Ok(());
    }
    let fault = format!("it is {version}; this build reads version {VERSION}");
    Err(Problem::field("#/recipe/version", fault))
}

/// A name that stays within its folder.
pub(super) fn is_safe(name: &str) -> bool {
    let part = |part: &str| {
        !part.is_empty() && part != "." && part != ".." && !part.contains(['\\', '\0', ':'])
    };
    name.len() <= MOST_NAME_BYTES && name.split('/').all(part)
}

fn of_recipe(error: &pipeline::RecipeError) -> Problem {
    let pointer = super::answer::pointer(&format!("recipe.{}", error.field));
    Problem::field(pointer, format!("{}; {}", error.found, error.expected))
}

/// Why a job cannot start, or has failed.
pub(super) fn of_pipeline(error: &pipeline::Error) -> Problem {
    match error {
        pipeline::Error::Recipe(error) => of_recipe(error),
        pipeline::Error::Scene { .. } => bad_asset(error),
        pipeline::Error::Pose(error) => Problem::field("#/recipe/poses", error.to_string()),
        pipeline::Error::Surroundings(fault) => {
            Problem::field("#/recipe/bake/surroundings", fault.clone())
        }
        pipeline::Error::File { source, .. }
            if source.kind() == std::io::ErrorKind::StorageFull =>
        {
            let detail = "the disk of the service is full";
            Problem::new(StatusCode::INSUFFICIENT_STORAGE, "storage-full", detail)
        }
        // These name files of ours.
        pipeline::Error::File { .. } | pipeline::Error::Dataset(_) => Problem::internal(error),
        other => Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid-field", other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(recipe: &str, assets: &str) -> serde_json::Value {
        let body = format!(r#"{{"kind":"run","recipe":{recipe},"assets":{assets}}}"#);
        let problem = JobRequest::read(body.as_bytes()).expect_err("must be refused");
        problem.json()["errors"][0]["pointer"].clone()
    }

    /// Each fault points at its field.
    #[test]
    fn faults_are_found_before_the_scene_is_looked_at() {
        let digest = "a".repeat(64);
        let one = format!(r#"{{"a.glb":"{digest}"}}"#);
        let sound = r#"{"version":1}"#;
        let read = |recipe: &str, assets: &str| {
            JobRequest::read(
                format!(r#"{{"kind":"run","recipe":{recipe},"assets":{assets}}}"#).as_bytes(),
            )
        };
        assert_eq!(read(sound, &one).expect("sound").recipe.scene.file, "a.glb");
        assert_eq!(fault(r#"{"version":9,"surprise":1}"#, &one), "#/recipe/version");
        assert_eq!(fault(r#"{"version":1,"bake":{"ray":5}}"#, &one), "#/recipe/bake/ray");
        assert_eq!(fault(r#"{"version":1,"bake":{"order":11}}"#, &one), "#/recipe/bake/order");
        assert_eq!(fault(r#"{"version":1,"scene":{"file":"b"}}"#, &one), "#/recipe/scene/file");
        assert_eq!(fault(sound, "{}"), "#/assets");
        assert_eq!(fault(sound, r#"{"a.glb":"../../etc"}"#), "#/assets/a.glb");
        assert_eq!(fault(sound, &format!(r#"{{"../a":"{digest}"}}"#)), "#/assets/..~1a");
        for body in
            ["", "[", "{}", "null", &"[".repeat(10_000), r#"{"kind":"run","priority":1e999}"#]
        {
            JobRequest::read(body.as_bytes()).expect_err(body);
        }
    }

    /// Names cannot leave their folder.
    #[test]
    fn names_stay_in_their_folder() {
        assert!(is_safe("a.glb") && is_safe("textures/a b.png"));
        for bad in ["", "/a", "a/", "../a", "a/../b", ".", "a//b", "c:a", "a\\b", "a\0"] {
            assert!(!is_safe(bad), "{bad}");
        }
    }
}
