//! What can go wrong with a job: a stage's own error, or one of joining the stages.

use std::path::PathBuf;

use super::{MapError, RecipeError};
use crate::shade::MerlError;
use crate::{bake, dataset, fit, measure, model, pose, scene};

impl From<fit::Error> for Error {
    fn from(error: fit::Error) -> Self {
        match error {
            fit::Error::Dataset(dataset::Error::Stopped) => {
                Self::Stopped { when: "during the fit".to_owned() }
            }
            other => Self::Fit(other),
        }
    }
}

/// Every failure of a job. The stages' errors carry their own sentences.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The recipe cannot run.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// What pictures are to be lit by.
    #[error("light `{light}`: {source}")]
    Light {
        /// The file's name, or the words.
        light: String,
        /// What is wrong with it.
        source: MapError,
    },
    /// Import.
    #[error("{}", once(.file, .source))]
    Scene {
        /// The scene's file.
        file: String,
        /// What is wrong with it.
        source: scene::Error,
    },
    /// Pose sampling.
    #[error(transparent)]
    Pose(#[from] pose::Error),
    /// Baking.
    #[error(transparent)]
    Bake(#[from] bake::Error),
    /// The data set on disk.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// Fitting.
    #[error(transparent)]
    Fit(fit::Error),
    /// The model or its blob.
    #[error(transparent)]
    Model(#[from] model::Error),
    /// Measuring.
    #[error(transparent)]
    Measure(#[from] measure::Error),
    /// The caller asked to stop.
    #[error("stopped after {done} of {total} poses; the same command continues from there")]
    Cancelled {
        /// Poses whose block is committed.
        done: u64,
        /// Poses in all.
        total: u64,
    },
    /// The caller asked to stop in a part of the work that leaves nothing to continue.
    #[error("stopped {when}; what was baked is kept; this stage starts over with the same command")]
    Stopped {
        /// Such as `during the fit`.
        when: String,
    },
    /// No candidate could be fitted to the data.
    #[error("none of the candidates can be fitted to these data: {why}")]
    NothingToChoose {
        /// What the first of them came to.
        why: String,
    },
    /// An effort that is more than the data set's own, or none.
    #[error(
        "{wrong} {what} cannot be tried: the data set has {own}, and less is tried from 1 up to that"
    )]
    Effort {
        /// Such as `training poses`.
        what: &'static str,
        /// What was asked for.
        wrong: u32,
        /// What there is.
        own: u32,
    },
    /// A file that could not be read or written.
    #[error("could not {action} {path}: {source}", path = path.display())]
    File {
        /// Such as `write`.
        action: &'static str,
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A measured reflectance that is none.
    #[error("reflectance `{file}`: {source}")]
    Reflectance {
        /// Its name.
        file: String,
        /// What is wrong with it.
        source: MerlError,
    },
    /// A JSON document that does not hold what it should.
    #[error("{what}: {source}")]
    Json {
        /// Which document.
        what: String,
        /// Where and what.
        source: serde_json::Error,
    },
    /// An earlier data set that the bake cannot take from.
    #[error("nothing can be taken from {path}: {what}", path = path.display())]
    Earlier {
        /// Its folder.
        path: PathBuf,
        /// Why.
        what: String,
    },
    /// There is nothing for a pilot to find out.
    #[error("a pilot cannot choose rays: {0}")]
    Pilot(String),
    /// What stands around the character is not to be had, or makes no sense.
    #[error("surroundings: {0}")]
    Surroundings(String),
    /// A data set that another recipe began.
    #[error("{path} was baked by another recipe: {differences}; choose another folder, or delete this one to start anew", path = path.display())]
    OtherBake {
        /// The data set.
        path: PathBuf,
        /// The fields that differ, with both values.
        differences: String,
    },
    /// A model that belongs to another scene or bake.
    #[error(
        "the model was fitted to another bake ({model}) than this data set's ({dataset}); fit it anew, or name its own data set"
    )]
    OtherDataset {
        /// Bake hash in the model.
        model: String,
        /// Bake hash of the data set.
        dataset: String,
    },
}

/// The file and what is wrong with it; once, where the stage names the file itself.
fn once(file: &str, source: &scene::Error) -> String {
    let told = source.to_string();
    if told.contains(file) { told } else { format!("{file}: {told}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file that cannot be read is named once; a fault inside is told with the file's name.
    #[test]
    fn a_file_is_named_once() {
        let told = |source| Error::Scene { file: "a.glb".to_owned(), source }.to_string();
        let path = PathBuf::from("a.glb");
        let source = std::io::Error::from(std::io::ErrorKind::NotFound);
        assert!(told(scene::Error::Io { path, source }).starts_with("cannot read a.glb: "));
        let other = scene::Error::NotAFile { path: PathBuf::from("b") };
        assert!(told(other).starts_with("a.glb: b is not"));
    }
}
