//! Reads a data set: its tables at once, its blocks as a stream.

use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::Quat;
use serde_json::{Map, Value};

use super::arrays::{self, Array};
use super::blocks::{self, Rows};
use super::layout::MAX_TABLE_BYTES;
use super::{
    Error, Header, PoseTable, RestMesh, Training, TrainingParts, files, json as fields, tables,
    values,
};
use crate::pose::Split;
use crate::rig::RigidFrame;
use crate::scene::Source;

/// The value of array `split` for the poses that a fit may see.
const TRAINING: u8 = Split::Training as u8;

/// Bound of the number of source files, against a header that lies.
const MAX_SOURCES: usize = 1 << 16;

/// A data set that was opened for reading. Its tables are in memory, its blocks are not.
///
/// Any number of readers may work beside one another and beside a writer.
#[derive(Debug)]
pub struct Dataset {
    root: PathBuf,
    header: Header,
    poses: PoseTable,
    mesh: RestMesh,
    committed: Vec<bool>,
    coefficients: Array,
    noise: Array,
}

impl Dataset {
    /// Opens the data set at `path` and checks everything but the values of its blocks, which
    /// are checked as they are read.
    ///
    /// # Errors
    /// [`Error::NotADataset`], [`Error::Version`]; [`Error::Field`] names the metadata file and
    /// field that lies; [`Error::ChunkSize`], [`Error::ChunkMissing`] and [`Error::Value`] name
    /// the damaged chunk or value.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let metadata = path.join("zarr.json");
        if !path.is_dir() || files::size(&metadata)?.is_none() {
            return Err(Error::NotADataset { path: path.to_path_buf() });
        }
        let header = Header::read(&metadata)?;
        let layout = &header.layout;
        for array in arrays::blocks(layout).iter().chain(&arrays::tables(layout)) {
            array.check(path)?;
        }
        let (poses, mesh) = tables::read(path, layout, header.attributes.clip_names.len())?;
        for array in source_arrays(path)? {
            array.check(path)?;
            values::check_table(path, &array)?;
        }
        let committed = blocks::committed(path, layout)?;
        let [coefficients, noise, _] = arrays::blocks(layout);
        Ok(Self { root: path.to_path_buf(), header, poses, mesh, committed, coefficients, noise })
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.root
    }

    /// Sizes and descriptions.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Whether every block was there when the data set was opened.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.committed.iter().all(|&there| there)
    }

    /// The blocks that were not there when the data set was opened, ascending.
    #[must_use]
    pub fn missing_blocks(&self) -> Vec<usize> {
        (0..self.committed.len()).filter(|&block| !self.committed[block]).collect()
    }

    /// What each pose is.
    #[must_use]
    pub fn poses(&self) -> &PoseTable {
        &self.poses
    }

    /// The mesh at rest.
    #[must_use]
    pub fn mesh(&self) -> &RestMesh {
        &self.mesh
    }

    /// Pose parameters `[pose, parameter]`, not centred.
    #[must_use]
    pub fn parameters(&self) -> &[f32] {
        &self.poses.parameters
    }

    /// Clip of each pose, -1 for none.
    #[must_use]
    pub fn clips(&self) -> &[i32] {
        &self.poses.clips
    }

    /// Split of each pose, index into [`super::SPLIT_NAMES`].
    #[must_use]
    pub fn splits(&self) -> &[u8] {
        &self.poses.splits
    }

    /// Seconds from the start of each pose's clip.
    #[must_use]
    pub fn times_s(&self) -> &[f32] {
        &self.poses.times_s
    }

    /// Root frame → scene of each pose.
    #[must_use]
    pub fn roots(&self) -> &[RigidFrame] {
        &self.poses.roots
    }

    /// Rotations of the bones `[pose, bone]`, relative to rest, in the root frame.
    #[must_use]
    pub fn bone_rotations(&self) -> &[Quat] {
        &self.poses.bone_rotations
    }

    /// The dominant bone of each point.
    #[must_use]
    pub fn point_bones(&self) -> &[u16] {
        &self.mesh.bone_of_point
    }

    /// Reads the scene's files back, the main one first.
    ///
    /// # Errors
    /// A file that cannot be read or was damaged since the data set was opened.
    pub fn sources(&self) -> Result<Vec<Source>, Error> {
        let read = |array: Array| {
            let name = array.attributes["name"].as_str().unwrap_or_default().to_owned();
            Ok(Source { name, bytes: values::read_bytes(&self.root, &array)? })
        };
        source_arrays(&self.root)?.into_iter().map(read).collect()
    }

    /// Reads the coefficients of a range of points at the listed poses into `out`
    /// `[pose in the list, point, channel, coefficient]`, root frame. One read per pose, so a list
    /// in ascending order and a wide range are fastest. Safe to call from many threads.
    ///
    /// # Errors
    /// [`Error::MissingBlock`], [`Error::ChunkSize`], [`Error::NotFinite`], [`Error::Io`].
    ///
    /// # Panics
    /// If a pose or point does not exist, or `out` has another length than the product of sizes.
    pub fn read_points(
        &self,
        poses: &[usize],
        points: Range<usize>,
        out: &mut [f32],
    ) -> Result<(), Error> {
        self.rows("coefficients", &self.coefficients, self.header.layout.row())
            .read(poses, points, out)
    }

    /// As [`Dataset::read_points`] for the noise, `[pose in the list, point]`.
    ///
    /// # Errors
    /// As [`Dataset::read_points`].
    ///
    /// # Panics
    /// As [`Dataset::read_points`].
    pub fn read_noise(
        &self,
        poses: &[usize],
        points: Range<usize>,
        out: &mut [f32],
    ) -> Result<(), Error> {
        self.rows("noise", &self.noise, 1).read(poses, points, out)
    }

    /// The rays that were traced at each point of a pose.
    ///
    /// # Errors
    /// As [`Dataset::read_points`].
    ///
    /// # Panics
    /// If the pose does not exist or `out` is not one number per point.
    pub fn read_rays(&self, pose: usize, out: &mut [u32]) -> Result<(), Error> {
        let layout = &self.header.layout;
        assert!(pose < layout.poses && out.len() == layout.points, "pose {pose}");
        let [_, _, rays] = arrays::blocks(layout);
        let block = pose / layout.block_poses;
        let path = rays.chunk_path(&self.root, &[block]);
        let file = std::fs::File::open(&path).map_err(Error::io("read", &path))?;
        let before = (pose - layout.poses_of(block).start) * layout.points;
        values::read_at(&file, &path, before as u64, out)
    }

    fn rows<'a>(&'a self, name: &'static str, array: &'a Array, row: usize) -> Rows<'a> {
        Rows { root: &self.root, layout: &self.header.layout, name, array, row }
    }

    /// What a fit may see: the poses of split `training`, all of which must be baked.
    ///
    /// # Errors
    /// [`Error::NoTraining`], [`Error::MissingBlock`], and those of reading the noise.
    pub fn training(&self) -> Result<Training<'_>, Error> {
        self.training_without(&[])
    }

    /// [`Dataset::training`] without the poses of some clips, by index: to try a fit on them.
    ///
    /// # Errors
    /// As [`Dataset::training`].
    pub fn training_without(&self, clips: &[i32]) -> Result<Training<'_>, Error> {
        let layout = &self.header.layout;
        let seen = |&pose: &usize| {
            self.poses.splits[pose] == TRAINING && !clips.contains(&self.poses.clips[pose])
        };
        let poses: Vec<usize> = (0..layout.poses).filter(seen).collect();
        if poses.is_empty() {
            return Err(Error::NoTraining { path: self.root.clone() });
        }
        let block = |pose: usize| pose / layout.block_poses;
        if let Some(&pose) = poses.iter().find(|&&pose| !self.committed[block(pose)]) {
            let (path, block) = (self.root.clone(), block(pose));
            return Err(Error::MissingBlock { path, block, poses: layout.poses_of(block) });
        }
        let of_pose = |pose: &usize, width: usize| pose * width..(pose + 1) * width;
        let variances = self.noise_variances(&poses)?;
        let parts = TrainingParts {
            points: layout.points,
            channels: layout.channels,
            coefficients: layout.coefficients,
            bones: layout.bones,
            parameters: (poses.iter())
                .flat_map(|pose| &self.poses.parameters[of_pose(pose, layout.parameters)])
                .copied()
                .collect(),
            parameter_names: self.header.attributes.parameter_names.clone(),
            clips: poses.iter().map(|&pose| self.poses.clips[pose]).collect(),
            bone_rotations: (poses.iter())
                .flat_map(|pose| &self.poses.bone_rotations[of_pose(pose, layout.bones)])
                .copied()
                .collect(),
            point_bones: self.mesh.bone_of_point.clone(),
            noise_variance: variances.iter().sum::<f64>() / layout.points.max(1) as f64,
            noise_of_points: variances.iter().map(|&variance| variance as f32).collect(),
            values: Vec::new(),
        };
        Ok(Training::stored(self, poses, parts))
    }

    /// Mean of noise² of each point over the listed poses, one pose in memory at a time.
    fn noise_variances(&self, poses: &[usize]) -> Result<Vec<f64>, Error> {
        let points = self.header.layout.points;
        let mut noise = vec![0.0; points];
        let mut sums = vec![0.0_f64; points];
        for &pose in poses {
            self.read_noise(&[pose], 0..points, &mut noise)?;
            sums.iter_mut().zip(&noise).for_each(|(sum, &x)| *sum += f64::from(x).powi(2));
        }
        Ok(sums.into_iter().map(|sum| sum / poses.len() as f64).collect())
    }
}

/// The arrays of group `source`, as its own `zarr.json` lists them.
fn source_arrays(root: &Path) -> Result<Vec<Array>, Error> {
    let path = root.join("source/zarr.json");
    let group = fields::object(&path, fields::GROUP_BYTES)?;
    let attributes: Map<String, Value> = fields::field(&path, &group, "attributes", "an object")?;
    let files: Vec<Map<String, Value>> =
        fields::field(&path, &attributes, "files", "a list of objects")?;
    if files.len() > MAX_SOURCES {
        let expected = format!("at most {MAX_SOURCES} entries");
        return Err(fields::mismatch(&path, "files", &expected, None));
    }
    let array = |(index, file): (usize, &Map<String, Value>)| {
        let name: String = fields::field(&path, file, "name", "a text")?;
        let bytes: usize = fields::field(&path, file, "bytes", "a size")?;
        if bytes as u64 > MAX_TABLE_BYTES {
            let expected = format!("at most {MAX_TABLE_BYTES}");
            return Err(fields::mismatch(&path, "bytes", &expected, file.get("bytes")));
        }
        Ok(arrays::source(index, &name, bytes))
    };
    files.iter().enumerate().map(array).collect()
}
