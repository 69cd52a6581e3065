//! The scene that a model is of, where its evaluation looks at the posed mesh or plays a clip: the one
//! that is named, or the one that the model was made of as long as it is here.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::Service;
use super::answer::escaped;
use super::assets::bad_asset;
use super::poses::refused;
use super::problem::Problem;
use super::request::{JobRequest, check_files};
use crate::model::Model;
use crate::pipeline::{self, Scene};

/// An uploaded scene.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneRequest {
    /// Its files: name → SHA-256 of an uploaded asset.
    pub(super) assets: BTreeMap<String, String>,
    /// The main one; may be left out where there is only one.
    pub(super) file: Option<String>,
}

impl SceneRequest {
    /// The scene, from the cache where it was met before, for a model; `pointer` is where it stands in the
    /// request.
    ///
    /// # Errors
    /// What is wrong with it, with its field; a mesh that passes for the model's and is another.
    pub(super) fn open(
        &self,
        service: &Service,
        model: &Model,
        pointer: &str,
    ) -> Result<Arc<Scene>, Problem> {
        let name = serde_json::to_string(self).map_err(|error| Problem::internal(&error))?;
        let scene = service.hot.scene(name.as_bytes(), || self.import(service, pointer))?;
        pipeline::check_mesh(model, &scene).map_err(|error| refused(pointer.to_owned(), &error))?;
        Ok(scene)
    }

    fn import(&self, service: &Service, pointer: &str) -> Result<Scene, Problem> {
        check_files(&self.assets, &format!("{pointer}/assets"))?;
        let only = self.assets.keys().next().filter(|_| self.assets.len() == 1);
        let Some(file) = self.file.as_ref().or(only) else {
            return Err(Problem::field(
                format!("{pointer}/file"),
                "say which of the assets is the scene",
            ));
        };
        let incoming = service.store.folder().incoming()?;
        for (name, sha256) in &self.assets {
            if service.store.asset(sha256)?.is_none() {
                let pointer = format!("{pointer}/assets/{}", escaped(name));
                return Err(Problem::field(pointer, format!("no asset {sha256} was uploaded")));
            }
            let path = incoming.path().join(name);
            super::store::create(path.parent().unwrap_or(incoming.path()))?;
            super::files::link(&service.store.folder().asset(sha256), &path)?;
        }
        if !self.assets.contains_key(file) {
            return Err(Problem::field(format!("{pointer}/file"), "it is none of the assets"));
        }
        import(&incoming.path().join(file))
    }
}

/// The scene that is named, or else the one that the model was made of.
///
/// # Errors
/// As [`SceneRequest::open`]; a model whose own scene is no longer here.
pub(super) fn of_model(
    service: &Service,
    (id, model): (&str, &Model),
    named: Option<&SceneRequest>,
    pointer: &str,
) -> Result<Arc<Scene>, Problem> {
    match named {
        Some(scene) => scene.open(service, model, pointer),
        None => service.hot.scene(format!("model {id}").as_bytes(), || own(service, id, pointer)),
    }
}

/// The scene of the job that baked what the model was fitted to.
fn own(service: &Service, id: &str, pointer: &str) -> Result<Scene, Problem> {
    let gone = || {
        let fault = "the scene that this model was made of is no longer here: name it";
        Problem::field(pointer, fault)
    };
    let job = service.store.scene_job(id)?.ok_or_else(gone)?;
    let request: JobRequest =
        serde_json::from_str(&job.request).map_err(|error| Problem::internal(&error))?;
    let folder = service.store.folder();
    let path = match request.recipe.subdivide {
        None => folder.sources(&job.id).join(&request.recipe.scene.file),
        // The mesh that the model is of.
        Some(_) => folder.work(&job.bake).join(pipeline::REFINED),
    };
    if path.is_file() { import(&path) } else { Err(gone()) }
}

fn import(path: &Path) -> Result<Scene, Problem> {
    pipeline::import(path).map_err(|error| bad_asset(&error))
}
