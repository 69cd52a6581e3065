//! What a job is asked for, and whether it can start.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use axum::http::StatusCode;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

use super::answer::{document, escaped, is_sha256};
use super::files::link;
use super::problem::Problem;
use super::store::create;
use super::trials::{RangeName, check_efforts};
use super::{Service, faults};
use crate::pipeline::recipe::{Recipe, VERSION};
use crate::pipeline::{self, CandidateRecipe, Checked, Efforts, Job, Range};

/// Files of one job.
pub(super) const MOST_FILES: usize = 256;

/// Bytes of a file's name within a scene.
const MOST_NAME_BYTES: usize = 255;

/// A request for a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct JobRequest {
    /// What is to be done.
    pub(super) kind: Kind,
    /// The files of the scene: name → SHA-256 of an uploaded asset; of `run` and `bake`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) assets: BTreeMap<String, String>,
    /// Hash of a bake that another job has finished; of `fit` and `tradeoff`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) dataset: Option<String>,
    /// Id of a model whose data set is still there; of `measure`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) model: Option<String>,
    /// How far to look; of `tradeoff`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) range: Option<RangeName>,
    /// What to try with less than the data set has; of `effort`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) efforts: Option<Efforts>,
    /// Only candidates whose name has one of these in it; of `tradeoff`, and of `fit` with a target.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) only: Vec<String>,
    /// The recipe; `scene.file` is one of `assets`, and may be left out where there is only one.
    /// Of jobs on a data set only the parts that the stage reads; the others are the data set's.
    pub(super) recipe: Recipe,
    /// Higher ones run first.
    #[serde(default)]
    pub(super) priority: i32,
    /// Whom to tell when the job has ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) webhook: Option<Webhook>,
}

/// Whom to tell when a job has ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Webhook {
    /// Where the message is posted.
    pub(super) url: String,
}

/// Kinds of jobs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Kind {
    /// Bake, fit, measure and report.
    Run,
    /// A data set.
    Bake,
    /// A model of a data set.
    Fit,
    /// A model against references.
    Measure,
    /// Every family and size over one data set.
    Tradeoff,
    /// One model with less than a data set has.
    Effort,
}

impl Kind {
    /// Every kind.
    pub(super) const ALL: [Self; 6] =
        [Self::Run, Self::Bake, Self::Fit, Self::Measure, Self::Tradeoff, Self::Effort];

    /// As clients read it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Bake => "bake",
            Self::Fit => "fit",
            Self::Measure => "measure",
            Self::Tradeoff => "tradeoff",
            Self::Effort => "effort",
        }
    }

    /// The kind of this name.
    pub(super) fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// What it works on: a field of the request.
    fn subject(self) -> &'static str {
        match self {
            Self::Run | Self::Bake => "assets",
            Self::Fit | Self::Tradeoff | Self::Effort => "dataset",
            Self::Measure => "model",
        }
    }

    /// The parts of the recipe that it reads.
    fn parts(self) -> &'static [&'static str] {
        match self {
            Self::Run | Self::Bake => {
                const OF_SCENE: &[&str] = &[
                    "version",
                    "scene",
                    "subdivide",
                    "poses",
                    "bake",
                    "fit",
                    "target",
                    "light",
                    "output",
                ];
                OF_SCENE
            }
            Self::Fit | Self::Effort => &["version", "fit", "target", "output"],
            Self::Measure => &["version", "target"],
            Self::Tradeoff => &["version", "fit", "target"],
        }
    }

    /// Whether it works on a data set that is there.
    pub(super) fn needs_dataset(self) -> bool {
        self.subject() != "assets"
    }

    /// Whether it makes a model.
    pub(super) fn makes_model(self) -> bool {
        matches!(self, Self::Run | Self::Fit)
    }
}

impl JobRequest {
    /// Reads and checks everything that can be checked without the scene.
    ///
    /// # Errors
    /// The first field at fault.
    pub(super) fn read(body: &[u8]) -> Result<Self, Problem> {
        let outer = outer(body)?;
        let mut request: Self = document(body)?;
        request.check_parts(&outer)?;
        Checked::new(&request.recipe).map_err(|error| faults::of_recipe(&error))?;
        // Filled in when the recipe is resolved; what a client says here has no part in it.
        request.recipe.scene.sha256 = None;
        if let Some(subdivide) = &mut request.recipe.subdivide {
            subdivide.of = None;
        }
        match request.kind {
            Kind::Run | Kind::Bake => request.check_assets()?,
            Kind::Fit | Kind::Tradeoff => check_digest("dataset", request.dataset.as_deref())?,
            Kind::Effort => {
                check_digest("dataset", request.dataset.as_deref())?;
                check_efforts(request.efforts.as_ref())?;
            }
            Kind::Measure => check_digest("model", request.model.as_deref())?,
        }
        Ok(request)
    }

    /// Whether the request has what its kind reads, and nothing else.
    fn check_parts(&self, outer: &Outer) -> Result<(), Problem> {
        let kind = self.kind;
        let options: &[&str] = match kind {
            Kind::Tradeoff => &["range", "only"],
            Kind::Fit => &["only"],
            Kind::Effort => &["efforts"],
            _ => &[],
        };
        for field in ["assets", "dataset", "model", "range", "efforts", "only"] {
            let own = field == kind.subject() || options.contains(&field);
            if outer.fields.contains(field) && !own {
                let fault = format!("a job of kind `{}` has no `{field}`", kind.name());
                return Err(Problem::field(format!("#/{field}"), fault));
            }
        }
        let other = outer.parts.iter().find(|part| !kind.parts().contains(&part.as_str()));
        if let Some(part) = other {
            let fault = format!(
                "a job of kind `{}` takes `{part}` from the data set; leave it out",
                kind.name()
            );
            return Err(Problem::field(format!("#/recipe/{part}"), fault));
        }
        Ok(())
    }

    /// Names and digests of the scene's files.
    fn check_assets(&mut self) -> Result<(), Problem> {
        check_files(&self.assets, "#/assets")?;
        let file = &mut self.recipe.scene.file;
        if let (true, Some(only), 1) =
            (file.is_empty(), self.assets.keys().next(), self.assets.len())
        {
            file.clone_from(only);
        }
        let around = &self.recipe.bake.surroundings;
        let named = around.occluders.as_ref().map(|o| &o.file);
        let received = around.receivers.as_ref().map(|r| &r.file);
        let scene = ("#/recipe/scene/file", &self.recipe.scene.file);
        let occluders = named.map(|file| ("#/recipe/bake/surroundings/occluders/file", file));
        let receivers = received.map(|file| ("#/recipe/bake/surroundings/receivers/file", file));
        let light = self.recipe.light.as_ref().map(|light| &light.source);
        let map = light.filter(|source| !pipeline::is_words(source));
        let map = map.map(|file| ("#/recipe/light/source", file));
        let brdf = self.recipe.light.as_ref().and_then(|light| light.brdf.as_ref());
        let brdf = brdf.filter(|source| !pipeline::is_brdf_words(source));
        let brdf = brdf.map(|file| ("#/recipe/light/brdf", file));
        let named = [Some(scene), occluders, receivers, map, brdf];
        for (pointer, file) in named.into_iter().flatten() {
            if !self.assets.contains_key(file) {
                let known: Vec<&str> = self.assets.keys().map(String::as_str).collect();
                let fault = format!("`{file}` is none of the job's assets, {}", known.join(", "));
                return Err(Problem::field(pointer, fault));
            }
        }
        Ok(())
    }

    /// The models that a trade-off or a choice by target looks at.
    ///
    /// # Errors
    /// Where there is none.
    pub(super) fn candidates(&self, points: usize) -> Result<Vec<CandidateRecipe>, Problem> {
        let range = match self.range.unwrap_or_default() {
            RangeName::Quick => Range::Quick,
            RangeName::Full => Range::Full,
        };
        let mut candidates = pipeline::candidates(&self.recipe, points, range);
        if !self.only.is_empty() {
            let named = |c: &CandidateRecipe| self.only.iter().any(|part| c.name.contains(part));
            candidates.retain(named);
        }
        match candidates.is_empty() {
            true => Err(Problem::field("#/only", "no candidate has any of these in its name")),
            false => Ok(candidates),
        }
    }

    /// Lays the scene's files out in a folder, under the names that the recipe has for them.
    ///
    /// # Errors
    /// `unknown-asset`; what the disk objects to.
    pub(super) fn lay_out(&self, service: &Service, folder: &Path) -> Result<(), Problem> {
        for (name, sha256) in &self.assets {
            if service.store.asset(sha256)?.is_none() {
                let pointer = format!("#/assets/{}", escaped(name));
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
        if let Some(receivers) = &mut recipe.bake.surroundings.receivers {
            receivers.file = folder.join(&receivers.file).display().to_string();
        }
        if let Some(light) = &mut recipe.light
            && !pipeline::is_words(&light.source)
        {
            light.source = folder.join(&light.source).display().to_string();
        }
        let brdf = recipe.light.as_mut().and_then(|light| light.brdf.as_mut());
        if let Some(brdf) = brdf.filter(|brdf| !pipeline::is_brdf_words(brdf)) {
            *brdf = folder.join(&*brdf).display().to_string();
        }
        Job::open(&self.scene(folder), recipe)
    }

    /// Why a scene of this request does not make a job, at the field that is at fault.
    pub(super) fn refused(&self, error: &pipeline::Error) -> Problem {
        match error {
            pipeline::Error::Pose(error) => {
                let field = faults::field_of_pose(&self.recipe.poses, error);
                Problem::field(format!("#/recipe/{field}"), error.to_string())
            }
            other => faults::of_pipeline(other),
        }
    }

    /// The scene's main file.
    fn scene(&self, folder: &Path) -> PathBuf {
        folder.join(&self.recipe.scene.file)
    }
}

/// Files of a scene by name: not too many, none within another, each named by an asset. `pointer` is
/// where they stand in the request.
///
/// # Errors
/// The first name at fault.
pub(super) fn check_files(files: &BTreeMap<String, String>, pointer: &str) -> Result<(), Problem> {
    if files.is_empty() || files.len() > MOST_FILES {
        return Err(Problem::field(pointer, format!("there must be 1 to {MOST_FILES} files")));
    }
    for (name, sha256) in files {
        let pointer = format!("{pointer}/{}", escaped(name));
        let mut above = name.match_indices('/').map(|(at, _)| &name[..at]);
        if let Some(file) = above.find(|&folder| files.contains_key(folder)) {
            let fault = format!("`{file}` is a file itself, so nothing lies in it");
            return Err(Problem::field(&pointer, fault));
        }
        if !is_safe(name) {
            let fault = "a name is relative, with `/` between parts, and leaves no folder";
            return Err(Problem::field(pointer, fault));
        }
        if !is_sha256(sha256) {
            return Err(Problem::field(pointer, DIGEST));
        }
    }
    Ok(())
}

/// What a body names, whatever its values.
#[derive(Debug, Default)]
struct Outer {
    /// Fields of the request.
    fields: BTreeSet<String>,
    /// Parts of its recipe.
    parts: BTreeSet<String>,
}

/// The version before all else, since fields of another one would be called unknown.
fn outer(body: &[u8]) -> Result<Outer, Problem> {
    #[derive(Deserialize)]
    struct Raw<T> {
        recipe: T,
    }
    #[derive(Deserialize)]
    struct Version {
        version: serde_json::Number,
    }
    type Names = BTreeMap<String, IgnoredAny>;
    // A body that is none of this is refused with its reason when it is read in earnest.
    let versioned = serde_json::from_slice::<Raw<Version>>(body);
    if let Ok(Raw { recipe: Version { version } }) = versioned
        && version.as_u64() != Some(u64::from(VERSION))
    {
        let fault = format!("it is {version}; this build reads version {VERSION}");
        return Err(Problem::field("#/recipe/version", fault));
    }
    let fields: Names = serde_json::from_slice(body).unwrap_or_default();
    let parts = serde_json::from_slice::<Raw<Names>>(body).map(|raw| raw.recipe);
    let names = |names: Names| names.into_keys().collect();
    Ok(Outer { fields: names(fields), parts: names(parts.unwrap_or_default()) })
}

const DIGEST: &str = "64 lower-case hexadecimal digits are expected";

fn check_digest(field: &str, digest: Option<&str>) -> Result<(), Problem> {
    match digest {
        Some(digest) if is_sha256(digest) => Ok(()),
        Some(_) => Err(Problem::field(format!("#/{field}"), DIGEST)),
        None => Err(Problem::field("#", format!("`{field}` is missing"))),
    }
}

/// A name that stays within its folder.
pub(super) fn is_safe(name: &str) -> bool {
    let part = |part: &str| {
        !part.is_empty() && part != "." && part != ".." && !part.contains(['\\', '\0', ':'])
    };
    name.len() <= MOST_NAME_BYTES && name.split('/').all(part)
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
        let inside = format!(r#"{{"a":"{digest}","a/b.glb":"{digest}"}}"#);
        assert_eq!(fault(sound, &inside), "#/assets/a~1b.glb");
        assert_eq!(fault(sound, &format!(r#"{{"../a":"{digest}"}}"#)), "#/assets/..~1a");
        for body in
            ["", "[", "{}", "null", &"[".repeat(10_000), r#"{"kind":"run","priority":1e999}"#]
        {
            JobRequest::read(body.as_bytes()).expect_err(body);
        }
    }

    /// Each kind has its own subject and reads its own parts of the recipe.
    #[test]
    fn kinds_read_their_own_parts() {
        let digest = "a".repeat(64);
        let fault = |rest: &str| {
            let problem = JobRequest::read(format!("{{{rest}}}").as_bytes()).expect_err(rest);
            problem.json()["errors"][0]["pointer"].as_str().unwrap_or_default().to_owned()
        };
        let version = r#""recipe":{"version":1}"#;
        let less = r#""efforts":{"poses":[2]}"#;
        let effort = format!(r#""kind":"effort","dataset":"{digest}",{version}"#);
        JobRequest::read(format!("{{{effort},{less}}}").as_bytes()).expect("sound");
        assert_eq!(fault(&effort), "#/efforts");
        assert_eq!(fault(&format!(r#"{effort},"efforts":{{"rays":[]}}"#)), "#/efforts");
        let many = vec!["1"; 17].join(",");
        assert_eq!(fault(&format!(r#"{effort},"efforts":{{"rays":[{many}]}}"#)), "#/efforts/rays");
        assert_eq!(fault(&format!(r#"{effort},{less},"range":"full""#)), "#/range");
        for kind in ["fit", "tradeoff"] {
            let body = format!(r#"{{"kind":"{kind}","dataset":"{digest}",{version}}}"#);
            JobRequest::read(body.as_bytes()).expect("sound");
            assert_eq!(fault(&format!(r#""kind":"{kind}","assets":{{}},{version}"#)), "#/assets");
            assert_eq!(fault(&format!(r#""kind":"{kind}",{version}"#)), "#");
            let baked = format!(
                r#""kind":"{kind}","dataset":"{digest}","recipe":{{"version":1,"bake":{{}}}}"#
            );
            assert_eq!(fault(&baked), "#/recipe/bake");
        }
        let measure = format!(r#""kind":"measure","model":"{digest}""#);
        JobRequest::read(format!("{{{measure},{version}}}").as_bytes()).expect("sound");
        assert_eq!(fault(&format!(r#"{measure},"range":"full",{version}"#)), "#/range");
        assert_eq!(
            fault(&format!(r#"{measure},"recipe":{{"version":1,"fit":{{}}}}"#)),
            "#/recipe/fit"
        );
        assert_eq!(fault(&format!(r#""kind":"measure","model":"../x",{version}"#)), "#/model");
        assert_eq!(fault(&format!(r#""kind":"fit","dataset":null,{version}"#)), "#");
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
