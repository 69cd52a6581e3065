//! What can go wrong with a data set, each with its evidence and what to do about it.

use std::io;
use std::ops::Range;
use std::path::PathBuf;

/// Every failure of the data set stage.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused: full disk, missing permission, no such folder.
    #[error("cannot {action} {path}: {source}", path = path.display())]
    Io {
        /// What was tried, such as `write`.
        action: &'static str,
        /// The file or folder that it was tried on.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// There is no finished header.
    #[error("{path} is not a data set: it holds no zarr.json; give a folder that `poselight bake` wrote", path = path.display())]
    NotADataset {
        /// The folder that was opened.
        path: PathBuf,
    },
    /// A reference was asked for where no measurement has begun one.
    #[error("{path} is not there: this data set has no reference bake to measure against yet", path = path.display())]
    NoReference {
        /// The `reference` folder.
        path: PathBuf,
    },
    /// A new data set would be mixed with files that are not ours.
    #[error("{path} already holds `{entry}`, which is no part of a data set; choose a new or empty folder", path = path.display())]
    Occupied {
        /// The folder that should become a data set.
        path: PathBuf,
        /// The first foreign entry by name.
        entry: String,
    },
    /// The reader was told to stop.
    #[error("reading was stopped")]
    Stopped,
    /// Another process holds the lock.
    #[error("{path} is being written by another process; wait for it or stop it", path = path.display())]
    Locked {
        /// The folder whose lock is held.
        path: PathBuf,
    },
    /// The folder was written in another format version.
    #[error("{path} has data set format version {found}, this build reads and writes version {supported}; bake into a new folder or use the build that made it", path = path.display())]
    Version {
        /// The folder or file that states the version.
        path: PathBuf,
        /// The version stated there.
        found: u64,
        /// [`super::FORMAT_VERSION`].
        supported: u64,
    },
    /// The folder holds the result of another recipe.
    #[error("{path} was made by another recipe: its {stage} hash is {found}, this recipe's is {expected}; choose another folder, or delete this one to start anew", path = path.display())]
    OtherRecipe {
        /// The folder that was to be continued.
        path: PathBuf,
        /// Which hash differs: `scene`, `bake`, `reference`.
        stage: String,
        /// The hash of the recipe at hand.
        expected: String,
        /// The hash in the folder, or `none`.
        found: String,
    },
    /// The data set has references of other settings.
    #[error("{path} holds references of {rays} rays over {poses} poses, and {asked_rays} rays over {asked_poses} poses are asked for; ask for the same, or delete that folder to have references baked anew", path = path.display())]
    OtherReferences {
        /// The `reference` folder.
        path: PathBuf,
        /// Rays per point that are there.
        rays: u32,
        /// Poses that are there.
        poses: usize,
        /// Rays per point that were asked for.
        asked_rays: u32,
        /// Poses that were asked for.
        asked_poses: usize,
    },
    /// The hashes agree but the content does not: damage, or a build that computes differently.
    #[error("{path} agrees with the recipe's hash but differs in {what}; it is damaged or was made by a build that computes differently: choose another folder, or delete this one to start anew", path = path.display())]
    OtherContent {
        /// The folder or file that differs.
        path: PathBuf,
        /// The array or attribute.
        what: String,
    },
    /// A metadata file that is no JSON at all.
    #[error("{path} is not valid JSON: {source}", path = path.display())]
    Json {
        /// The metadata file.
        path: PathBuf,
        /// Where and what the parser objects to.
        source: serde_json::Error,
    },
    /// A file larger than anything this format writes.
    #[error("{path} has {bytes} bytes, more than the {limit} allowed for it", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The bound.
        limit: u64,
    },
    /// A field of a metadata file that is missing or is not what the format says.
    #[error("{path}: field `{field}` is {found}, expected {expected}", path = path.display())]
    Field {
        /// The metadata file; its folder is the array's or group's name.
        path: PathBuf,
        /// The field, such as `shape` or `layout.poses`.
        field: String,
        /// What the format or the rest of the data set demands.
        expected: String,
        /// What stands there, abbreviated, or `missing`.
        found: String,
    },
    /// A size outside of what a data set can have.
    #[error("a data set cannot have {field} = {found}: {bound}")]
    Layout {
        /// The size, such as `poses`.
        field: &'static str,
        /// Its value.
        found: u64,
        /// The bound, as a sentence.
        bound: String,
    },
    /// An array handed in for writing has another length than the layout says.
    #[error("array `{array}` has {found} values where the layout makes it {expected}")]
    Length {
        /// The array.
        array: &'static str,
        /// From the layout.
        expected: usize,
        /// What was given.
        found: usize,
    },
    /// A value of an array that is out of its range (an index, a split, a rotation).
    #[error("array `{array}` has {found} at index {index}, expected {expected}")]
    Value {
        /// The array.
        array: &'static str,
        /// Flat index of the value (of the row, for rotations).
        index: usize,
        /// The value.
        found: String,
        /// The range.
        expected: String,
    },
    /// NaN or infinity where a number must be.
    #[error("array `{array}` has {found} at pose {pose}, point {point}; a committed value must be finite: delete {path} to have this part baked again", path = path.display())]
    NotFinite {
        /// The array.
        array: &'static str,
        /// Pose index within the data set.
        pose: usize,
        /// Point index.
        point: usize,
        /// The value found.
        found: f32,
        /// The chunk file.
        path: PathBuf,
    },
    /// A chunk file of the wrong size: truncated, or grown.
    #[error("{path} has {found} bytes where the layout makes it {expected}; it is damaged: delete it to have this part made again", path = path.display())]
    ChunkSize {
        /// The chunk file.
        path: PathBuf,
        /// From the layout.
        expected: u64,
        /// On disk.
        found: u64,
    },
    /// A chunk that must exist does not.
    #[error("{path} is missing; the data set is damaged: delete {remedy} to have this part made again", path = path.display(), remedy = remedy.display())]
    ChunkMissing {
        /// The chunk file.
        path: PathBuf,
        /// What marks it as committed, to be deleted.
        remedy: PathBuf,
    },
    /// A block was asked for that no bake has committed yet.
    #[error("{path} holds no block {block} (poses {start} to {last}) yet; run the same `poselight bake` again to finish it", path = path.display(), start = poses.start, last = poses.end.saturating_sub(1))]
    MissingBlock {
        /// The data set.
        path: PathBuf,
        /// Block index.
        block: usize,
        /// Its poses.
        poses: Range<usize>,
    },
    /// A reference bake was asked for that is not there yet.
    #[error("{path} holds no reference of seed {seed} for pose {pose} yet; run the measurement again to finish it", path = path.display())]
    MissingReference {
        /// The `reference` folder.
        path: PathBuf,
        /// 0 or 1.
        seed: usize,
        /// Pose index within the data set.
        pose: usize,
    },
    /// Nothing to fit on.
    #[error("{path} has no pose of split `training`; bake with fewer clips held out", path = path.display())]
    NoTraining {
        /// The data set.
        path: PathBuf,
    },
}

impl Error {
    /// For `map_err`: wraps what the operating system said about `path`.
    pub(super) fn io(
        action: &'static str,
        path: impl Into<PathBuf>,
    ) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { action, path, source }
    }
}
