//! What each kind of job does, by way of `pipeline/`, and where its results go.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use axum::http::StatusCode;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::faults::of_pipeline;
use super::prepare;
use super::problem::Problem;
use super::recorder::Recorder;
use super::request::{JobRequest, Kind};
use super::store::{self, Incoming, Job, Level, hexadecimal};
use super::words::in_fields;
use super::{Service, StoreError, disk, refined};
use crate::model::Model;
use crate::pipeline::{self, Checked, Watch, files};

/// A job during which the service ended so often, with nothing more of its bake on disk in between,
/// brings it down, and is given up.
const MOST_ENDS: i64 = 20;

/// A model's blob at most.
const MOST_MODEL_BYTES: u64 = 4 << 30;

/// Why a job did not come to its end.
pub(super) enum Failure {
    Stopped,
    /// By a disk that takes no writes; whether the attempt counts.
    Refused {
        counts: bool,
    },
    Problem(Problem),
}

impl From<pipeline::Error> for Failure {
    fn from(error: pipeline::Error) -> Self {
        match error {
            pipeline::Error::Cancelled { .. } | pipeline::Error::Stopped { .. } => Self::Stopped,
            other => Self::Problem(of_pipeline(&other)),
        }
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        Self::Problem(error.into())
    }
}

impl From<Problem> for Failure {
    fn from(problem: Problem) -> Self {
        Self::Problem(problem)
    }
}

/// What a job came to.
pub(super) struct Made {
    /// As clients read it.
    pub(super) result: Value,
    /// The model that is to be put into its place.
    pub(super) model: Option<MadeModel>,
}

impl Made {
    /// The result with files that can be had beside it.
    fn with_files(mut self, files: Option<Value>) -> Self {
        if let Some(files) = files {
            self.result["files"] = files;
        }
        self
    }
}

/// A model that is whole.
pub(super) struct MadeModel {
    /// Of the blob.
    pub(super) sha256: String,
    /// Of the blob.
    pub(super) bytes: u64,
    /// Where its files are.
    pub(super) folder: Incoming,
}

/// A job under way.
struct Stage<'a> {
    service: &'a Service,
    job: &'a Job,
    request: JobRequest,
    watch: Watch<'a>,
    recorder: &'a Recorder<'a>,
}

/// Runs a job to its end.
///
/// # Errors
/// [`Failure`].
pub(super) fn run(
    service: &Service,
    job: &Job,
    brake: &AtomicBool,
    recorder: &Recorder<'_>,
) -> Result<Made, Failure> {
    let whole = disk::whole(&service.store.folder().work(&job.bake));
    if service.store.begin(job.seq, whole)? >= MOST_ENDS {
        let detail = format!(
            "the service ended {MOST_ENDS} times while it ran this job, which came no further"
        );
        let status = StatusCode::INTERNAL_SERVER_ERROR;
        return Err(Problem::new(status, "internal", detail).into());
    }
    if brake.load(Ordering::Relaxed) {
        return Err(Failure::Stopped);
    }
    let request: JobRequest = serde_json::from_str(&job.request)
        .map_err(|error| Failure::Problem(Problem::internal(&error)))?;
    let report = |progress| recorder.record(progress);
    let watch = Watch { report: &report, cancelled: brake };
    let stage = Stage { service, job, request, watch, recorder };
    let attempt = || match stage.request.kind {
        Kind::Run => stage.run(),
        Kind::Bake => stage.bake(),
        Kind::Fit => stage.fit(),
        Kind::Measure => stage.measure(),
        Kind::Tradeoff => stage.tradeoff(),
        Kind::Effort => stage.effort(),
    };
    match attempt() {
        Err(Attempt::Pipeline(error)) => match pipeline::other_references(&error) {
            Some(path) => {
                recorder.log(Level::Info, "references of other settings give way");
                store::remove(path)?;
                attempt().map_err(Failure::from)
            }
            None => Err(error.into()),
        },
        other => other.map_err(Failure::from),
    }
}

/// Why a stage did not come to its end, before it is decided what that means.
enum Attempt {
    Pipeline(pipeline::Error),
    Failure(Failure),
}

impl From<Attempt> for Failure {
    fn from(attempt: Attempt) -> Self {
        match attempt {
            Attempt::Pipeline(error) => error.into(),
            Attempt::Failure(failure) => failure,
        }
    }
}

impl From<pipeline::Error> for Attempt {
    fn from(error: pipeline::Error) -> Self {
        Self::Pipeline(error)
    }
}

impl From<Problem> for Attempt {
    fn from(problem: Problem) -> Self {
        Self::Failure(Failure::Problem(problem))
    }
}

impl From<StoreError> for Attempt {
    fn from(error: StoreError) -> Self {
        Self::Failure(error.into())
    }
}

impl Stage<'_> {
    /// The scene, prepared; its notices go into the log.
    fn open(&self) -> Result<pipeline::Job, Attempt> {
        let sources = self.service.store.folder().sources(&self.job.id);
        // Names that a power cut took are given again.
        self.request.lay_out(self.service, &sources)?;
        let prepared = self.request.open(&sources)?;
        for notice in pipeline::notices(&prepared) {
            self.recorder.log(Level::Warning, &in_fields(&notice));
        }
        Ok(prepared)
    }

    /// The mesh refined where the recipe asks for that; the files of it that are to be had.
    fn refine(&self, prepared: pipeline::Job) -> Result<(pipeline::Job, Option<Value>), Attempt> {
        if !prepared.is_to_be_refined() {
            return Ok((prepared, None));
        }
        let work = self.service.store.folder().work(&self.job.bake);
        let place = work.join(pipeline::REFINED);
        refined::take_over(self.service, &pipeline::refinement_hash(&prepared), &place)?;
        let refined = pipeline::refined(prepared, &place, &self.watch)?;
        let record = pipeline::record_of(&place);
        let read = |path: &Path| files::read(path, MOST_MODEL_BYTES);
        let files =
            self.keep(&[(pipeline::REFINED, read(&place)?), ("refined.json", read(&record)?)])?;
        Ok((refined, Some(files)))
    }

    fn run(&self) -> Result<Made, Attempt> {
        let (prepared, files) = self.refine(self.open()?)?;
        let work = self.service.store.folder().work(&self.job.bake);
        let outcome = pipeline::run(&prepared, &work, &self.watch)?;
        self.service.metrics.rays(outcome.baked.rays);
        let read = |name: &str| files::read(&work.join(name), MOST_MODEL_BYTES);
        let parts = [
            (pipeline::MODEL, read(pipeline::MODEL)?),
            (pipeline::REPORT, read(pipeline::REPORT)?),
            (pipeline::FIGURES, read(pipeline::FIGURES)?),
            (pipeline::RECIPE, read(pipeline::RECIPE)?),
        ];
        let made = self.publish(&parts, Some(outcome.met))?;
        Ok(made.with_files(files))
    }

    fn bake(&self) -> Result<Made, Attempt> {
        let (prepared, files) = self.refine(self.open()?)?;
        let work = self.service.store.folder().work(&self.job.bake);
        let baked = pipeline::bake(&prepared, &work.join(pipeline::DATASET), &self.watch)?;
        self.service.metrics.rays(baked.rays);
        let result = json!({ "dataset": self.job.bake, "poses": baked.poses, "rays": baked.rays });
        Ok(Made { result, model: None }.with_files(files))
    }

    fn fit(&self) -> Result<Made, Attempt> {
        let dataset = prepare::open_dataset(self.service, &self.job.bake)?;
        let recipe = &self.request.recipe;
        if pipeline::has_target(recipe) {
            let candidates = self.request.candidates(dataset.header().layout.points)?;
            let chosen = pipeline::choose(&dataset, recipe, &candidates, &self.watch)?;
            self.recorder.log(Level::Info, &format!("chosen: {}", chosen.point().name));
            let parts = [
                (pipeline::MODEL, chosen.blob),
                (pipeline::RECIPE, text(&chosen.found.recipe)?),
                (pipeline::FIGURES, text(&chosen.figures)?),
                (pipeline::REPORT, chosen.page.into_bytes()),
            ];
            return self.publish(&parts, Some(chosen.met));
        }
        let fitted = pipeline::fit_watched(&dataset, recipe, &self.watch)?;
        for notice in &fitted.report.notices {
            self.recorder.log(Level::Warning, &in_fields(notice));
        }
        let precision = Checked::new(recipe).map_err(pipeline::Error::from)?.precision;
        let blob = fitted.model.to_bytes(precision).map_err(pipeline::Error::from)?;
        self.publish(&[(pipeline::MODEL, blob), (pipeline::RECIPE, text(recipe)?)], None)
    }

    fn measure(&self) -> Result<Made, Attempt> {
        let id = self.request.model.clone().unwrap_or_default();
        let known = self.service.hot.model(self.service, &id)?;
        let mut model = Model::clone(&*known.ok_or_else(|| Problem::not_found("model"))?);
        let dataset = prepare::open_dataset(self.service, &self.job.bake)?;
        let recipe = &self.request.recipe;
        let (figures, page) = pipeline::examine(&mut model, &dataset, recipe, &self.watch)?;
        let reference = Checked::new(recipe).map_err(pipeline::Error::from)?.reference;
        let met = pipeline::meets_target(&figures.measured, reference);
        let files = self
            .keep(&[(pipeline::FIGURES, text(&figures)?), (pipeline::REPORT, page.into_bytes())])?;
        let href = format!("/v1/models/{id}");
        let result = json!({ "model": id, "href": href, "target_met": met, "files": files });
        Ok(Made { result, model: None })
    }

    fn tradeoff(&self) -> Result<Made, Attempt> {
        let dataset = prepare::open_dataset(self.service, &self.job.bake)?;
        let recipe = &self.request.recipe;
        let checked = Checked::new(recipe).map_err(pipeline::Error::from)?;
        pipeline::bake_reference(&dataset, checked.reference, &self.watch)?;
        let candidates = self.request.candidates(dataset.header().layout.points)?;
        let tradeoff = pipeline::tradeoff(&dataset, &candidates, &self.watch)?;
        let mut parts = vec![("tradeoff.json", text(&tradeoff)?)];
        parts.extend(tradeoff.plots().map(|(name, svg)| (name, svg.into_bytes())));
        parts.push((pipeline::REPORT, tradeoff.page(None).into_bytes()));
        let files = self.keep(&parts)?;
        let result = json!({ "dataset": self.job.bake, "front": tradeoff.front, "files": files });
        Ok(Made { result, model: None })
    }

    fn effort(&self) -> Result<Made, Attempt> {
        let dataset = prepare::open_dataset(self.service, &self.job.bake)?;
        let recipe = &self.request.recipe;
        let checked = Checked::new(recipe).map_err(pipeline::Error::from)?;
        pipeline::bake_reference(&dataset, checked.reference, &self.watch)?;
        // Bakes of fewer rays; what a power cut leaves of them goes at the next start.
        let incoming = self.service.store.folder().incoming()?;
        let efforts = self.request.efforts.clone().unwrap_or_default();
        let effort = pipeline::effort(&dataset, recipe, &efforts, incoming.path(), &self.watch)?;
        let files = self
            .keep(&[("effort.json", text(&effort)?), ("effort.svg", effort.plot().into_bytes())])?;
        let result = json!({ "dataset": self.job.bake, "files": files });
        Ok(Made { result, model: None })
    }

    /// Writes a model with what belongs to it; it gets to its place when the job ends.
    fn publish(&self, parts: &[(&str, Vec<u8>)], met: Option<bool>) -> Result<Made, Attempt> {
        let Self { service, job, .. } = self;
        let blob = &parts[0].1;
        let incoming = service.store.folder().incoming()?;
        write(incoming.path(), parts)?;
        let id = &job.key;
        let result = json!({ "model": id, "href": format!("/v1/models/{id}"), "target_met": met });
        let sha256 = hexadecimal(&Sha256::digest(blob));
        let model = MadeModel { sha256, bytes: blob.len() as u64, folder: incoming };
        Ok(Made { result, model: Some(model) })
    }

    /// Puts files where results of jobs are; where each can be had.
    fn keep(&self, parts: &[(&str, Vec<u8>)]) -> Result<Value, Attempt> {
        let folder = self.service.store.folder();
        let incoming = folder.incoming()?;
        write(incoming.path(), parts)?;
        let place = folder.results(&self.job.id);
        store::remove(&place)?;
        store::settle(incoming.path(), &place)?;
        Ok(prepare::files(self.service, &self.job.id)?)
    }
}

fn write(folder: &Path, parts: &[(&str, Vec<u8>)]) -> Result<(), pipeline::Error> {
    parts.iter().try_for_each(|(name, bytes)| files::publish(&folder.join(name), bytes))
}

fn text(value: &impl serde::Serialize) -> Result<Vec<u8>, Problem> {
    serde_json::to_vec_pretty(value).map_err(|error| Problem::internal(&error))
}
