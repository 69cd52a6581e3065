//! A request on its way to being a job: what stops it from starting is told now, and what it lacks
//! is filled in.

use std::path::Path;

use axum::http::StatusCode;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::faults::of_pipeline;
use super::problem::Problem;
use super::request::{JobRequest, Kind};
use super::store::{self, Job, Key, NewJob, Submitted, hexadecimal};
use super::{Service, disk, memory, webhooks};
use crate::pipeline::recipe::Recipe;
use crate::pipeline::{self, Checked, Efforts, Hashes};

/// Memory of a job that bakes nothing: the poses at hand and the sums of its products.
const FIT_BYTES: u64 = 128 << 20;

/// What names a job's work and result, and what it takes.
struct Named {
    bake: String,
    key: String,
    memory_bytes: u64,
    /// What it writes.
    disk_bytes: u64,
}

/// Checks all that can be checked, and writes the job down.
///
/// # Errors
/// The field that stops the job from starting; what disk and database object to.
pub(super) fn prepare(
    service: &Service,
    mut request: JobRequest,
    key: Option<&Key>,
) -> Result<Submitted, Problem> {
    if let Some(webhook) = &request.webhook {
        webhooks::check(service, &webhook.url)?;
    }
    let id = store::random_id()?;
    let incoming = service.store.folder().incoming()?;
    let named = match request.kind {
        Kind::Run | Kind::Bake => of_scene(service, &request, incoming.path())?,
        _ => of_dataset(service, &mut request)?,
    };
    check_memory(service, named.memory_bytes)?;
    let earlier = earlier(service, request.kind, &named)?;
    if earlier.is_none() {
        // What was begun has that much of its room already.
        let begun = disk::size(&service.store.folder().work(&named.bake));
        disk::check(service, named.disk_bytes.saturating_sub(begun))?;
    }
    let sources = service.store.folder().sources(&id);
    if !request.kind.needs_dataset() {
        store::settle(incoming.path(), &sources)?;
    }
    let result = earlier.map(|earlier| take_over(service, &earlier, &id)).transpose()?;
    let text = serde_json::to_string(&request).map_err(|error| Problem::internal(&error))?;
    let new = NewJob {
        id: &id,
        kind: request.kind.name(),
        priority: i64::from(request.priority),
        request: &text,
        bake: &named.bake,
        key: &named.key,
        memory_bytes: named.memory_bytes,
        needs_dataset: request.kind.needs_dataset(),
        makes_model: request.kind.makes_model(),
        result: result.as_deref(),
        most_queued: service.settings.limits.queued_jobs,
    };
    let submitted = service.store.submit(&new, key);
    if !matches!(submitted, Ok(Submitted::New(_))) {
        store::remove(&sources)?;
        store::remove(&service.store.folder().results(&id))?;
    }
    Ok(submitted?)
}

/// A job on a scene: imported now, so that a fault is told now.
fn of_scene(service: &Service, request: &JobRequest, folder: &Path) -> Result<Named, Problem> {
    request.lay_out(service, folder)?;
    let job = request.open(folder).map_err(|error| request.refused(&error))?;
    let memory_bytes = pipeline::memory_bytes(&job).map_err(|error| of_pipeline(&error))?;
    let measured = request.kind == Kind::Run;
    let disk_bytes = pipeline::disk_bytes(&job, measured).map_err(|error| of_pipeline(&error))?;
    let Hashes { bake, fit, .. } = job.hashes;
    let key = if request.kind == Kind::Run { fit } else { bake.clone() };
    Ok(Named { bake, key, memory_bytes, disk_bytes })
}

/// A job on a data set that is there, with the recipe made whole from it.
fn of_dataset(service: &Service, request: &mut JobRequest) -> Result<Named, Problem> {
    let (bake, base) = match (&request.dataset, &request.model) {
        (Some(bake), _) => (bake.clone(), None),
        (None, Some(model)) => {
            let known = service.hot.model(service, model)?;
            let known = known.ok_or_else(|| Problem::field("#/model", "there is no such model"))?;
            let recipe = pipeline::recipe_of_model(&known).map_err(|error| of_pipeline(&error))?;
            let bake = known.header().provenance.hashes.get("bake").cloned().unwrap_or_default();
            (bake, Some(recipe))
        }
        (None, None) => return Err(Problem::field("#", "`dataset` is missing")),
    };
    let dataset = open_dataset(service, &bake)?;
    let own = pipeline::recipe_of(&dataset).map_err(|error| of_pipeline(&error))?;
    let asked = &request.recipe;
    request.recipe = match base {
        // What makes the model is the model's; only how it is measured is asked for.
        Some(mut recipe) => {
            recipe.target.max_error = asked.target.max_error;
            recipe.target.reference_factor = asked.target.reference_factor;
            recipe.target.reference_poses = asked.target.reference_poses;
            recipe
        }
        None => Recipe {
            fit: asked.fit.clone(),
            target: asked.target.clone(),
            output: asked.output.clone(),
            ..own
        },
    };
    let recipe = &request.recipe;
    Checked::new(recipe).map_err(|error| of_pipeline(&error.into()))?;
    let is_said = request.kind == Kind::Fit && !pipeline::has_target(recipe);
    if is_said || request.kind == Kind::Effort {
        let effective = pipeline::effective_fit(recipe);
        effective.map_err(|error| of_pipeline(&error.into()))?;
    }
    let chooses = request.kind == Kind::Tradeoff || pipeline::has_target(recipe);
    if !chooses && !request.only.is_empty() {
        let fault = "without a target (`max_error`, `max_bytes`, …) nothing is chosen";
        return Err(Problem::field("#/only", fault));
    }
    let layout = dataset.header().layout;
    request.candidates(layout.points)?;
    let pose_bytes = (layout.points * layout.row() * 4) as u64;
    let (mut memory_bytes, mut disk_bytes) = (FIT_BYTES + 64 * pose_bytes, 0);
    if let Some(efforts) = &request.efforts {
        let baked = for_efforts(&dataset, efforts)?;
        memory_bytes = memory_bytes.max(baked);
        disk_bytes = if baked > 0 { disk::size(dataset.path()) } else { 0 };
    }
    let key = key_of(request);
    Ok(Named { bake, key, memory_bytes, disk_bytes })
}

/// Memory of the bakes that efforts take; 0 where they take none.
fn for_efforts(dataset: &pipeline::Dataset, efforts: &Efforts) -> Result<u64, Problem> {
    let within = efforts.within(dataset).map_err(|error| match error {
        pipeline::Error::Effort { .. } => Problem::field("#/efforts", error.to_string()),
        other => of_pipeline(&other),
    })?;
    if within.rays.len() < 2 {
        return Ok(0);
    }
    let job = pipeline::job_of(dataset).map_err(|error| of_pipeline(&error))?;
    pipeline::memory_bytes(&job).map_err(|error| of_pipeline(&error))
}

/// A data set that a job of this service has finished.
pub(super) fn open_dataset(service: &Service, bake: &str) -> Result<pipeline::Dataset, Problem> {
    let gone = || {
        let fault = "there is no finished data set of this hash; submit its bake again";
        Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "unknown-dataset", fault)
    };
    if !super::answer::is_sha256(bake) || !service.store.has_dataset(bake)? {
        return Err(gone());
    }
    let path = service.store.folder().work(bake).join(pipeline::DATASET);
    pipeline::open_dataset(&path).ok().flatten().ok_or_else(gone)
}

/// Names the result of a job on a data set: a hash over everything that has a part in it. A model
/// that was fitted but not measured has other bytes than that of a run, and another id.
fn key_of(request: &JobRequest) -> String {
    let mut parts = json!({
        "kind": request.kind.name(),
        "dataset": request.dataset,
        "model": request.model,
        "range": request.range,
        "only": request.only,
        "fit": request.recipe.fit,
        "target": request.recipe.target,
        "output": request.recipe.output,
    });
    // Results from before there were efforts keep their names.
    if let Some(efforts) = &request.efforts {
        parts["efforts"] = json!(efforts);
    }
    hexadecimal(&Sha256::digest(parts.to_string()))
}

/// A job that needs more than there is would wait for ever.
fn check_memory(service: &Service, bytes: u64) -> Result<(), Problem> {
    let most = memory::most(&service.settings.limits);
    if bytes <= most {
        return Ok(());
    }
    let detail = format!("the job needs about {bytes} bytes of memory, the service has {most}");
    let status = StatusCode::UNPROCESSABLE_ENTITY;
    Err(Problem::new(status, "job-too-large", detail).limit("memory_bytes", most))
}

/// The finished job whose result this one would have.
fn earlier(service: &Service, kind: Kind, named: &Named) -> Result<Option<Job>, Problem> {
    let Some(earlier) = service.store.succeeded(kind.name(), &named.key)? else { return Ok(None) };
    let folder = service.store.folder();
    // Models are deleted, and files may be lost.
    let there = match kind {
        kind if kind.makes_model() => {
            let is_known = service.store.model(&named.key)?.is_some();
            is_known && folder.model(&named.key).join(pipeline::MODEL).is_file()
        }
        Kind::Bake => folder.work(&named.bake).join(pipeline::DATASET).exists(),
        _ => has_files(&folder.results(&earlier.id), earlier.result.as_deref()),
    };
    Ok(Some(earlier).filter(|_| there))
}

/// Whether a folder has every file that a result names.
fn has_files(folder: &Path, result: Option<&str>) -> bool {
    let result: Value = serde_json::from_str(result.unwrap_or_default()).unwrap_or_default();
    let mut names = result["files"].as_object().into_iter().flat_map(serde_json::Map::keys);
    names.all(|name| folder.join(name).is_file())
}

/// The result of an earlier job as that of a new one, with its files.
fn take_over(service: &Service, earlier: &Job, id: &str) -> Result<String, Problem> {
    let folder = service.store.folder();
    let (from, to) = (folder.results(&earlier.id), folder.results(id));
    let text = earlier.result.as_deref().unwrap_or("{}");
    let mut result: Value =
        serde_json::from_str(text).map_err(|error| Problem::internal(&error))?;
    if from.is_dir() {
        store::create(&to)?;
        for file in store::list(&from)? {
            super::files::link(&file, &to.join(file.file_name().unwrap_or_default()))?;
        }
        result["files"] = files(service, id)?;
    }
    Ok(result.to_string())
}

/// The files of a job's result: name → where.
pub(super) fn files(service: &Service, id: &str) -> Result<Value, Problem> {
    let names = store::list(&service.store.folder().results(id))?;
    let names = names.iter().filter_map(|path| path.file_name()?.to_str());
    Ok(names.map(|name| (name.to_owned(), json!(format!("/v1/jobs/{id}/files/{name}")))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A result counts as long as each of its files is there.
    #[test]
    fn a_result_without_its_files_is_none() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let result = json!({ "files": { "a.json": "/a", "b.html": "/b" } }).to_string();
        let is_there = || has_files(folder.path(), Some(&result));
        assert!(!is_there());
        std::fs::write(folder.path().join("a.json"), b"{}").expect("written");
        assert!(!is_there());
        std::fs::write(folder.path().join("b.html"), b"").expect("written");
        assert!(is_there());
        assert!(has_files(folder.path(), None) && has_files(folder.path(), Some("{}")));
    }
}
