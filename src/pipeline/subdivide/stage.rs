//! A job's scene refined before it is baked, once: what is there under the right hash is kept.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::settings::{self, Refinement};
use super::{Subdivided, subdivide};
use crate::bake;
use crate::pipeline::recipe::Recipe;
use crate::pipeline::reference::job_of_sources;
use crate::pipeline::{Error, Job, Watch, files, hash};
use crate::scene::{Limits, Source};

/// Name of the refined scene in a run's folder.
pub const REFINED: &str = "refined.glb";

/// Bounds what is read back.
const MOST_RECORD_BYTES: u64 = 1 << 20;

/// What is kept beside a refined scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RefinedRecord {
    /// Names the refinement: over the scene's files and all of the recipe that has a part in it.
    pub hash: String,
    /// SHA-256 of the refined file.
    pub sha256: String,
    /// Triangles before and after.
    pub triangles: [usize; 2],
    /// Vertices before and after.
    pub vertices: [usize; 2],
    /// Triangles that were still worse than the goal, but split as often as they may be.
    pub at_depth: usize,
    /// Vertices that skinning takes farther off their triangles than the bound.
    pub beyond_bound: usize,
    /// The farthest, metres.
    pub deviation_m: f32,
    /// Wall time, seconds.
    pub refine_s: f64,
}

/// The record that lies beside a refined scene.
#[must_use]
pub fn record_of(place: &Path) -> PathBuf {
    place.with_extension("json")
}

/// The job with its mesh refined as its recipe says, and the refined scene at `place`, a `.glb`; the job
/// as it is where its recipe says nothing of that, or the scene is refined already.
///
/// # Errors
/// What import, bake and file object to; [`Error::Stopped`].
pub fn refined(job: Job, place: &Path, watch: &Watch) -> Result<Job, Error> {
    if !job.is_to_be_refined() {
        return Ok(job);
    }
    let hash = hash_of(&job);
    let (bytes, record) = match found(place, &hash) {
        Some(found) => found,
        None => make(&job, place, hash, watch)?,
    };
    resolved(&job, place, bytes, &record)
}

/// As [`refined`] where the refined scene is at `place` already.
///
/// # Errors
/// What import and the recipe's check object to.
pub fn refined_already(job: &Job, place: &Path) -> Result<Option<Job>, Error> {
    if !job.is_to_be_refined() {
        return Ok(None);
    }
    let found = found(place, &hash_of(job));
    found.map(|(bytes, record)| resolved(job, place, bytes, &record)).transpose()
}

/// Whether there is a refined scene of this hash at `place`; its bytes are looked at when it is used.
#[must_use]
pub fn is_refinement(place: &Path, hash: &str) -> bool {
    read_record(place).is_some_and(|record| record.hash == hash) && place.is_file()
}

fn read_record(place: &Path) -> Option<RefinedRecord> {
    let record = files::read(&record_of(place), MOST_RECORD_BYTES).ok()?;
    serde_json::from_slice(&record).ok()
}

/// Names the refinement of a job.
#[must_use]
pub fn hash_of(job: &Job) -> String {
    let direct = settings::direct(&job.recipe);
    hash::subdivision(&job.hashes.scene, &direct, job.recipe.subdivide.as_ref())
}

/// The job of the refined scene.
fn resolved(job: &Job, place: &Path, bytes: Vec<u8>, record: &RefinedRecord) -> Result<Job, Error> {
    let mut own = job.scene.sources.clone();
    let name = place.file_name().unwrap_or_default().to_string_lossy().into_owned();
    own[0] = Source { name, bytes };
    let mut recipe = job.recipe.clone();
    recipe.scene.sha256 = None;
    if let Some(subdivide) = &mut recipe.subdivide {
        subdivide.of = Some(job.hashes.scene.clone());
    }
    let mut refined = with_sources(job, &own, recipe, place)?;
    // The light was taken out of the recipe when it was resolved.
    refined.lit.clone_from(&job.lit);
    let [triangles, vertices] = [record.triangles, record.vertices];
    refined.scene.notices.push(format!(
        "the mesh was refined from {} to {} triangles, {} to {} vertices",
        triangles[0], triangles[1], vertices[0], vertices[1]
    ));
    if record.beyond_bound > 0 {
        refined.scene.notices.push(format!(
            "skinning takes {} new vertices farther off their triangles than the bound, up to {:.2e} m",
            record.beyond_bound, record.deviation_m
        ));
    }
    Ok(refined)
}

/// The job's own surroundings with other files of the scene.
fn with_sources(job: &Job, own: &[Source], recipe: Recipe, place: &Path) -> Result<Job, Error> {
    let sources = [own, job.occluders.sources()].concat();
    job_of_sources(sources, recipe, place)
}

/// What an earlier run left, where it is of this hash and whole.
fn found(place: &Path, hash: &str) -> Option<(Vec<u8>, RefinedRecord)> {
    let record = read_record(place)?;
    let bytes = files::read(place, Limits::default().file_bytes).ok()?;
    (record.hash == hash && record.sha256 == hash::sha256(&bytes)).then_some((bytes, record))
}

fn make(
    job: &Job,
    place: &Path,
    hash: String,
    watch: &Watch,
) -> Result<(Vec<u8>, RefinedRecord), Error> {
    let start = Instant::now();
    let recipe = job.recipe.subdivide.clone().unwrap_or_default();
    let file = Path::new(&job.recipe.scene.file);
    let direct = with_sources(job, &job.scene.sources, settings::direct(&job.recipe), file)?;
    let given = direct.scene.mesh.triangles.len();
    let refinement = Refinement::of(job, &recipe)?;
    let mut tell = |triangles| (watch.report)(refinement.progress(given, triangles, start));
    tell(given);
    let done =
        subdivide(&direct, &refinement, None, watch.cancelled, &mut tell).map_err(stopped)?;
    let Subdivided { triangles, vertices, work, deviation, glb, .. } = done;
    let record = RefinedRecord {
        hash,
        sha256: hash::sha256(&glb),
        triangles,
        vertices,
        at_depth: work.at_depth,
        beyond_bound: deviation.beyond,
        deviation_m: deviation.most_m,
        refine_s: start.elapsed().as_secs_f64(),
    };
    // The record is last: with it the refinement is done.
    files::publish(place, &glb)?;
    let text = serde_json::to_vec_pretty(&record);
    let text = text.map_err(|source| Error::Json { what: "the record".to_owned(), source })?;
    files::publish(&record_of(place), &text)?;
    Ok((glb, record))
}

fn stopped(error: Error) -> Error {
    match error {
        Error::Bake(bake::Error::Cancelled) => {
            Error::Stopped { when: "while the mesh was refined".to_owned() }
        }
        other => other,
    }
}
