//! Models that are ready to be evaluated, bounded by bytes, with the latest lights and scenes.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use sha2::{Digest, Sha256};

use super::lights::MapLight;
use super::problem::Problem;
use super::{Service, StoreError};
use crate::model::Model;
use crate::pipeline::{self, Gloss, Light, Scene, files};

/// The cache.
#[derive(Debug)]
pub(super) struct Hot {
    most_bytes: u64,
    inner: Mutex<Inner>,
    /// Held while a scene is imported or a map decoded: that may take gigabytes.
    importing: Mutex<()>,
}

/// Lights that are kept ready, each with its model folded under it.
const MOST_LIGHTS: usize = 16;

/// Scenes that are kept ready.
const MOST_SCENES: usize = 4;

/// A model's id, and a digest of the light's name.
type LightKey = (String, [u8; 32]);

#[derive(Debug, Default)]
struct Inner {
    /// The latest used one last.
    models: Vec<(String, Arc<Model>, u64)>,
    /// The latest used one last.
    lights: Vec<(LightKey, Arc<Light>)>,
    /// The latest used one last.
    glosses: Vec<(LightKey, Arc<Gloss>)>,
    /// Maps by their SHA-256; the latest used one last.
    maps: Vec<(String, Arc<MapLight>)>,
    /// By a digest of the scene's name; the latest used one last.
    scenes: Vec<([u8; 32], Arc<Scene>)>,
    hits: u64,
    misses: u64,
    /// How often a model was forgotten: what was read before that is not kept after it.
    forgotten: u64,
}

/// What the cache holds and how it was used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct HotFigures {
    pub(super) models: usize,
    pub(super) bytes: u64,
    pub(super) hits: u64,
    pub(super) misses: u64,
}

impl Hot {
    pub(super) fn new(most_bytes: u64) -> Self {
        Self { most_bytes, inner: Mutex::default(), importing: Mutex::default() }
    }

    /// A model of the store; `None` where there is none.
    ///
    /// # Errors
    /// What disk, database or the blob's reader object to.
    pub(super) fn model(&self, service: &Service, id: &str) -> Result<Option<Arc<Model>>, Problem> {
        let forgotten = match self.take(id) {
            Ok(model) => return Ok(Some(model)),
            Err(forgotten) => forgotten,
        };
        let Some(stored) = service.store.model(id)? else { return Ok(None) };
        let path = service.store.folder().model(id).join(pipeline::MODEL);
        let model = match read(&path, stored.bytes) {
            Ok(model) => Arc::new(model),
            // Deleted since the line before.
            Err(_) if service.store.model(id)?.is_none() => return Ok(None),
            Err(fault) => return Err(fault),
        };
        self.put(id, &model, stored.bytes, forgotten);
        Ok(Some(model))
    }

    /// A light on a model, folded once and kept. `name` tells lights apart: what is made under
    /// one name must always be the same.
    ///
    /// # Errors
    /// What `make` objects to.
    pub(super) fn light(
        &self,
        id: &str,
        name: &[u8],
        make: impl FnOnce() -> Result<Light, Problem>,
    ) -> Result<Arc<Light>, Problem> {
        let key = (id.to_owned(), Sha256::digest(name).into());
        if let Some(light) = take(&mut self.lock().lights, &key) {
            return Ok(light);
        }
        let light = Arc::new(make()?);
        keep(&mut self.lock().lights, key, &light);
        Ok(light)
    }

    /// As [`Hot::light`], for a light that is reflected towards an eye.
    ///
    /// # Errors
    /// What `make` objects to.
    pub(super) fn gloss(
        &self,
        id: &str,
        name: &[u8],
        make: impl FnOnce() -> Result<Gloss, Problem>,
    ) -> Result<Arc<Gloss>, Problem> {
        let key = (id.to_owned(), Sha256::digest(name).into());
        if let Some(gloss) = take(&mut self.lock().glosses, &key) {
            return Ok(gloss);
        }
        let gloss = Arc::new(make()?);
        keep(&mut self.lock().glosses, key, &gloss);
        Ok(gloss)
    }

    /// A scene, imported once and kept; one at a time is imported. `name` tells scenes apart: what
    /// is made under one name must always be the same.
    ///
    /// # Errors
    /// What `make` objects to.
    pub(super) fn scene(
        &self,
        name: &[u8],
        make: impl FnOnce() -> Result<Scene, Problem>,
    ) -> Result<Arc<Scene>, Problem> {
        let key: [u8; 32] = Sha256::digest(name).into();
        if let Some(scene) = self.take_scene(&key) {
            return Ok(scene);
        }
        let _alone = self.importing.lock().unwrap_or_else(PoisonError::into_inner);
        // Somebody else may have made it meanwhile.
        if let Some(scene) = self.take_scene(&key) {
            return Ok(scene);
        }
        let scene = Arc::new(make()?);
        let mut inner = self.lock();
        inner.scenes.push((key, Arc::clone(&scene)));
        if inner.scenes.len() > MOST_SCENES {
            inner.scenes.remove(0);
        }
        Ok(scene)
    }

    /// A map as a light, decoded once and kept; one at a time is decoded.
    ///
    /// # Errors
    /// What `make` objects to.
    pub(super) fn map(
        &self,
        asset: &str,
        make: impl FnOnce() -> Result<MapLight, Problem>,
    ) -> Result<Arc<MapLight>, Problem> {
        let key = asset.to_owned();
        if let Some(map) = take(&mut self.lock().maps, &key) {
            return Ok(map);
        }
        let _alone = self.importing.lock().unwrap_or_else(PoisonError::into_inner);
        // Somebody else may have made it meanwhile.
        if let Some(map) = take(&mut self.lock().maps, &key) {
            return Ok(map);
        }
        let map = Arc::new(make()?);
        keep(&mut self.lock().maps, key, &map);
        Ok(map)
    }

    fn take_scene(&self, key: &[u8; 32]) -> Option<Arc<Scene>> {
        let mut inner = self.lock();
        let at = inner.scenes.iter().position(|(known, _)| known == key)?;
        let entry = inner.scenes.remove(at);
        let scene = Arc::clone(&entry.1);
        inner.scenes.push(entry);
        Some(scene)
    }

    /// Forgets a model that is no longer in the store.
    pub(super) fn forget(&self, id: &str) {
        let mut inner = self.lock();
        inner.forgotten += 1;
        inner.models.retain(|(known, ..)| known != id);
        inner.lights.retain(|((known, _), _)| known != id);
        inner.glosses.retain(|((known, _), _)| known != id);
    }

    pub(super) fn figures(&self) -> HotFigures {
        let inner = self.lock();
        let bytes = inner.models.iter().map(|(.., bytes)| bytes).sum();
        HotFigures { models: inner.models.len(), bytes, hits: inner.hits, misses: inner.misses }
    }

    /// A model that is here; else how often one was forgotten until now.
    fn take(&self, id: &str) -> Result<Arc<Model>, u64> {
        let mut inner = self.lock();
        let Some(at) = inner.models.iter().position(|(known, ..)| known == id) else {
            inner.misses += 1;
            return Err(inner.forgotten);
        };
        inner.hits += 1;
        let entry = inner.models.remove(at);
        let model = Arc::clone(&entry.1);
        inner.models.push(entry);
        Ok(model)
    }

    /// The one that is put in stays, however large, since it is in use anyway; unless one was
    /// forgotten since the store was asked for it, for that may have been this one.
    fn put(&self, id: &str, model: &Arc<Model>, bytes: u64, forgotten: u64) {
        let mut inner = self.lock();
        if inner.forgotten != forgotten {
            return;
        }
        inner.models.retain(|(known, ..)| known != id);
        inner.models.push((id.to_owned(), Arc::clone(model), bytes));
        let mut held: u64 = inner.models.iter().map(|(.., bytes)| bytes).sum();
        while held > self.most_bytes && inner.models.len() > 1 {
            held -= inner.models.remove(0).2;
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The entry of a key, which is now the latest used one.
fn take<K: PartialEq, T>(kept: &mut Vec<(K, Arc<T>)>, key: &K) -> Option<Arc<T>> {
    let at = kept.iter().position(|(known, _)| known == key)?;
    let entry = kept.remove(at);
    let value = Arc::clone(&entry.1);
    kept.push(entry);
    Some(value)
}

/// Keeps what was made, and forgets what was not used for longest.
fn keep<K, T>(kept: &mut Vec<(K, Arc<T>)>, key: K, value: &Arc<T>) {
    kept.push((key, Arc::clone(value)));
    if kept.len() > MOST_LIGHTS {
        kept.remove(0);
    }
}

fn read(path: &Path, bytes: u64) -> Result<Model, Problem> {
    let blob = files::read(path, bytes).map_err(|error| match error {
        pipeline::Error::File { action, path, source } => {
            StoreError::Io { action, path, source }.into()
        }
        other => Problem::internal(&other),
    })?;
    Model::from_bytes(&blob).map_err(|error| Problem::internal(&error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::Order;
    use crate::shade::ShLight;

    fn model() -> Arc<Model> {
        let blob = include_bytes!("../model/blob/golden_v1.safetensors");
        Arc::new(Model::from_bytes(blob).expect("golden"))
    }

    /// The least lately used one goes first, and the bound holds.
    #[test]
    fn the_cache_is_bounded() {
        let hot = Hot::new(100);
        for id in ["a", "b"] {
            hot.put(id, &model(), 40, 0);
        }
        assert!(hot.take("a").is_ok());
        hot.put("c", &model(), 40, 0);
        assert!(hot.take("b").is_err() && hot.take("a").is_ok() && hot.take("c").is_ok());
        let make = || {
            let colours = vec![vec![1.0; model().header().coefficients()]];
            Light::new(&model(), colours).map_err(|error| Problem::internal(&error))
        };
        let light = || hot.light("a", b"white", make).expect("a light");
        assert!(Arc::ptr_eq(&light(), &light()), "a light is folded twice");
        for other in 0..MOST_LIGHTS as u64 {
            hot.light("c", &other.to_le_bytes(), make).expect("a light");
        }
        assert_eq!(hot.lock().lights.len(), MOST_LIGHTS);
        let map = |asset: &str, made: &mut bool| {
            let light = ShLight::constant(Order::new(2).expect("order"), [1.0; 3]).expect("light");
            let make = || {
                *made = true;
                Ok(MapLight { light, notices: Vec::new() })
            };
            hot.map(asset, make).expect("a map")
        };
        let (mut first, mut second) = (false, false);
        assert!(Arc::ptr_eq(&map("sky", &mut first), &map("sky", &mut second)));
        assert!(first && !second, "a map is decoded twice");
        for other in 0..MOST_LIGHTS {
            map(&other.to_string(), &mut first);
        }
        assert_eq!(hot.lock().maps.len(), MOST_LIGHTS);
        let scene = |name: &[u8]| {
            let path = tempfile::Builder::new().suffix(".obj").tempfile().expect("a file");
            std::fs::write(path.path(), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("written");
            let make = || pipeline::import(path.path()).map_err(|error| Problem::internal(&error));
            hot.scene(name, make).expect("a scene")
        };
        assert!(Arc::ptr_eq(&scene(b"a"), &scene(b"a")), "a scene is imported twice");
        for other in 0..MOST_SCENES as u64 {
            scene(&other.to_le_bytes());
        }
        assert_eq!(hot.lock().scenes.len(), MOST_SCENES);
        hot.forget("a");
        let figures = hot.figures();
        assert_eq!((figures.models, figures.bytes, figures.hits, figures.misses), (1, 40, 3, 1));
    }
    /// A model that was read before it was deleted is not kept afterwards, whichever comes first here;
    /// what is read later is.
    #[test]
    fn a_deleted_model_does_not_come_back() {
        let hot = Hot::new(100);
        let before = hot.take("a").expect_err("empty");
        hot.forget("a");
        hot.put("a", &model(), 40, before);
        let after = hot.take("a").expect_err("it came back");
        hot.put("a", &model(), 40, after);
        assert!(hot.take("a").is_ok());
        hot.forget("a");
        assert!(hot.take("a").is_err());
    }
}
