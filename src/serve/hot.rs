//! Models that are ready to be evaluated: the latest used ones, bounded by bytes.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::problem::Problem;
use super::{Service, StoreError};
use crate::model::Model;
use crate::pipeline::{self, files};

/// The cache.
#[derive(Debug)]
pub(super) struct Hot {
    most_bytes: u64,
    inner: Mutex<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    /// The latest used one last.
    models: Vec<(String, Arc<Model>, u64)>,
    hits: u64,
    misses: u64,
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
        Self { most_bytes, inner: Mutex::default() }
    }

    /// A model of the store; `None` where there is none.
    ///
    /// # Errors
    /// What disk, database or the blob's reader object to.
    pub(super) fn model(&self, service: &Service, id: &str) -> Result<Option<Arc<Model>>, Problem> {
        if let Some(model) = self.take(id) {
            return Ok(Some(model));
        }
        let Some(stored) = service.store.model(id)? else { return Ok(None) };
        let path = service.store.folder().model(id).join(pipeline::MODEL);
        let model = Arc::new(read(&path, stored.bytes)?);
        self.put(id, &model, stored.bytes);
        Ok(Some(model))
    }

    /// Forgets a model.
    pub(super) fn forget(&self, id: &str) {
        self.lock().models.retain(|(known, ..)| known != id);
    }

    pub(super) fn figures(&self) -> HotFigures {
        let inner = self.lock();
        let bytes = inner.models.iter().map(|(.., bytes)| bytes).sum();
        HotFigures { models: inner.models.len(), bytes, hits: inner.hits, misses: inner.misses }
    }

    fn take(&self, id: &str) -> Option<Arc<Model>> {
        let mut inner = self.lock();
        let Some(at) = inner.models.iter().position(|(known, ..)| known == id) else {
            inner.misses += 1;
            return None;
        };
        inner.hits += 1;
        let entry = inner.models.remove(at);
        let model = Arc::clone(&entry.1);
        inner.models.push(entry);
        Some(model)
    }

    /// The one that is put in stays, however large, since it is in use anyway.
    fn put(&self, id: &str, model: &Arc<Model>, bytes: u64) {
        let mut inner = self.lock();
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

    fn model() -> Arc<Model> {
        let blob = include_bytes!("../model/blob/golden_v1.safetensors");
        Arc::new(Model::from_bytes(blob).expect("golden"))
    }

    /// The least lately used one goes first, and the bound holds.
    #[test]
    fn the_cache_is_bounded() {
        let hot = Hot::new(100);
        for id in ["a", "b"] {
            hot.put(id, &model(), 40);
        }
        assert!(hot.take("a").is_some());
        hot.put("c", &model(), 40);
        assert!(hot.take("b").is_none() && hot.take("a").is_some() && hot.take("c").is_some());
        hot.forget("a");
        let figures = hot.figures();
        assert_eq!((figures.models, figures.bytes, figures.hits, figures.misses), (1, 40, 3, 1));
    }
}
