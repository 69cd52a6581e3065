//! Group `reference`: two bakes with many more rays, of different seeds, of a few poses, against
//! which a model is measured. Their errors are independent, so (m − r₁)(m − r₂) estimates a squared
//! error without the references' own noise.

use std::fs::File;
use std::path::{Path, PathBuf};

use glam::Vec3;
use serde_json::{Map, Value, json};

use super::arrays::{Array, DataType};
use super::blocks::check_finite;
use super::values::{self, bytes_of};
use super::writer::{write_chunk, write_table};
use super::{Dataset, Error, FORMAT_VERSION, Layout, files, json as fields};

/// What a reference is of, and how it was baked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReferenceHeader {
    /// Indices of poses of the data set, ascending, each once.
    pub poses: Vec<usize>,
    /// Rays per point of each of the two.
    pub rays: u32,
    /// Seeds of the two.
    pub seeds: [u64; 2],
    /// Hash over everything that a byte of the reference depends on, hexadecimal.
    pub hash: String,
}

/// One pose of a reference, borrowed for writing.
#[derive(Debug, Clone, Copy)]
pub struct ReferencePose<'a> {
    /// `[point, channel, coefficient]`, root frame, all finite.
    pub coefficients: &'a [f32],
    /// Root mean square over the coefficients of the standard error, one per point.
    pub noise: &'a [f32],
    /// Unit shading normals of the posed points, root frame; the same for both seeds.
    pub normals: &'a [Vec3],
}

/// The reference of a data set, for writing ([`Reference::open_or_create`], which holds a lock) or
/// for reading ([`Reference::open`]).
#[derive(Debug)]
pub struct Reference {
    root: PathBuf,
    layout: Layout,
    header: ReferenceHeader,
    arrays: Arrays,
    /// `[pose in the list][seed]`
    committed: Vec<[bool; 2]>,
    lock: Option<File>,
}

/// One chunk per seed and pose each, but `pose`, which is one chunk.
#[derive(Debug)]
struct Arrays {
    pose: Array,
    coefficients: Array,
    noise: Array,
    normal: Array,
}

impl Arrays {
    fn new(layout: &Layout, poses: usize) -> Self {
        let (seed, pose, point) = (("seed", 2), ("pose", poses), ("point", layout.points));
        let last = [("channel", layout.channels), ("coefficient", layout.coefficients)];
        let float = |name: &str, dimensions: &[_]| Array::whole(name, DataType::F32, dimensions);
        Self {
            pose: Array::whole("pose", DataType::I32, &[pose]),
            coefficients: float("coefficients", &[seed, pose, point, last[0], last[1]])
                .chunked(&[1, 1]),
            noise: float("noise", &[seed, pose, point]).chunked(&[1, 1]),
            normal: float("normal", &[pose, point, ("xyz", 3)]).chunked(&[1]),
        }
    }

    fn all(&self) -> [&Array; 4] {
        [&self.pose, &self.coefficients, &self.noise, &self.normal]
    }
}

impl Reference {
    /// Creates the reference of a data set, or continues the one that is there.
    ///
    /// # Errors
    /// [`Error::OtherReferences`] where others are there, [`Error::Locked`]
    /// where it is being written, [`Error::Io`]; damage as [`Dataset::open`] names it.
    ///
    /// # Panics
    /// If the header's poses are none, not ascending, or not of the data set.
    pub fn open_or_create(dataset: &Dataset, header: &ReferenceHeader) -> Result<Self, Error> {
        let layout = dataset.header().layout;
        let poses = &header.poses;
        let ascending = poses.is_sorted_by(|a, b| a < b);
        let last = poses.last().copied().unwrap_or(usize::MAX);
        assert!(ascending && last < layout.poses, "reference poses {poses:?} of {}", layout.poses);
        let root = dataset.path().join("reference");
        files::create_folder(&root)?;
        let lock = files::lock(&root)?;
        let bake = &dataset.header().attributes.hashes["bake"];
        if files::size(&root.join("zarr.json"))?.is_none() {
            create(&root, &Arrays::new(&layout, poses.len()), header, bake)?;
        }
        let mut reference = Self::open(dataset)?;
        if reference.header != *header {
            return Err(Error::OtherReferences {
                path: root,
                rays: reference.header.rays,
                poses: reference.header.poses.len(),
                asked_rays: header.rays,
                asked_poses: poses.len(),
            });
        }
        files::remove_temporaries(&root)?;
        for array in reference.arrays.all() {
            files::remove_temporaries(&array.folder(&root))?;
        }
        reference.lock = Some(lock);
        Ok(reference)
    }

    /// Opens the reference of a data set for reading.
    ///
    /// # Errors
    /// [`Error::NoReference`] where there is none, [`Error::OtherRecipe`] where it belongs to
    /// another bake; damage as [`Dataset::open`] names it.
    pub fn open(dataset: &Dataset) -> Result<Self, Error> {
        let root = dataset.path().join("reference");
        let metadata = root.join("zarr.json");
        if !root.is_dir() || files::size(&metadata)?.is_none() {
            return Err(Error::NoReference { path: root });
        }
        let layout = dataset.header().layout;
        let header = read_header(&root, dataset)?;
        let arrays = Arrays::new(&layout, header.poses.len());
        for array in arrays.all() {
            array.check(&root)?;
        }
        let listed: Vec<i32> = values::read_table(&root, &arrays.pose)?;
        if !listed.iter().map(|&pose| pose as usize).eq(header.poses.iter().copied()) {
            let what = String::from("array `pose`");
            return Err(Error::OtherContent { path: root, what });
        }
        let committed = committed(&root, &arrays, header.poses.len())?;
        Ok(Self { root, layout, header, arrays, committed, lock: None })
    }

    /// What the reference is of.
    #[must_use]
    pub fn header(&self) -> &ReferenceHeader {
        &self.header
    }

    /// What is still to be baked: seed (0 or 1) and index into [`ReferenceHeader::poses`],
    /// both seeds of a pose after one another.
    #[must_use]
    pub fn missing(&self) -> Vec<(usize, usize)> {
        let all = (0..self.committed.len()).flat_map(|index| [(0, index), (1, index)]);
        all.filter(|&(seed, index)| !self.committed[index][seed]).collect()
    }

    /// Whether both seeds of every pose are there.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.committed.iter().flatten().all(|&there| there)
    }

    /// Writes one pose of one seed for good: normals (unless the other seed's are there), noise,
    /// then coefficients, whose presence commits.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::Io`].
    ///
    /// # Panics
    /// If the reference was opened for reading only, an index does not exist, or a length is not
    /// the layout's.
    pub fn commit(
        &mut self,
        seed: usize,
        index: usize,
        data: &ReferencePose<'_>,
    ) -> Result<(), Error> {
        assert!(self.lock.is_some(), "a reference opened for reading cannot be written");
        let points = self.layout.points;
        assert_eq!(data.coefficients.len(), points * self.layout.row(), "coefficients");
        assert_eq!(data.noise.len(), points, "noise");
        assert_eq!(data.normals.len(), points, "normals");
        let pose = self.header.poses[index];
        let normals: &[f32] = bytemuck::cast_slice(data.normals);
        let Arrays { coefficients, noise, normal, .. } = &self.arrays;
        for (name, row, values, array, chunk) in [
            (
                "coefficients",
                self.layout.row(),
                data.coefficients,
                coefficients,
                &[seed, index][..],
            ),
            ("noise", 1, data.noise, noise, &[seed, index]),
            ("normal", 3, normals, normal, &[index]),
        ] {
            check_finite(name, pose, 0, row, values, || array.chunk_path(&self.root, chunk))?;
        }
        if files::size(&normal.chunk_path(&self.root, &[index]))?.is_none() {
            write_chunk(&self.root, normal, &[index], vec![bytes_of(normals)])?;
        }
        write_chunk(&self.root, noise, &[seed, index], vec![bytes_of(data.noise)])?;
        write_chunk(&self.root, coefficients, &[seed, index], vec![bytes_of(data.coefficients)])?;
        self.committed[index][seed] = true;
        Ok(())
    }

    /// Reads the coefficients of one seed and pose into `out` `[point, channel, coefficient]`,
    /// root frame.
    ///
    /// # Errors
    /// [`Error::MissingReference`], [`Error::ChunkSize`], [`Error::NotFinite`], [`Error::Io`].
    ///
    /// # Panics
    /// If an index does not exist or `out` has another length.
    pub fn read(&self, seed: usize, index: usize, out: &mut [f32]) -> Result<(), Error> {
        let row = self.layout.row();
        self.read_chunk(seed, index, ("coefficients", row), &self.arrays.coefficients, out)
    }

    /// As [`Reference::read`] for the noise, `[point]`.
    ///
    /// # Errors
    /// As [`Reference::read`].
    ///
    /// # Panics
    /// As [`Reference::read`].
    pub fn read_noise(&self, seed: usize, index: usize, out: &mut [f32]) -> Result<(), Error> {
        self.read_chunk(seed, index, ("noise", 1), &self.arrays.noise, out)
    }

    /// Unit shading normals of the points at one pose, root frame.
    ///
    /// # Errors
    /// As [`Reference::read`].
    ///
    /// # Panics
    /// If the index does not exist.
    pub fn read_normals(&self, index: usize) -> Result<Vec<Vec3>, Error> {
        let mut normals = vec![Vec3::ZERO; self.layout.points];
        let seed = usize::from(!self.committed[index][0]);
        let out = bytemuck::cast_slice_mut(&mut normals);
        self.read_chunk(seed, index, ("normal", 3), &self.arrays.normal, out)?;
        Ok(normals)
    }

    fn read_chunk(
        &self,
        seed: usize,
        index: usize,
        (name, row): (&'static str, usize),
        array: &Array,
        out: &mut [f32],
    ) -> Result<(), Error> {
        assert_eq!(out.len(), self.layout.points * row, "length of {name}");
        let pose = self.header.poses[index];
        if !self.committed[index][seed] {
            return Err(Error::MissingReference { path: self.root.clone(), seed, pose });
        }
        let chunk = [seed, index];
        // `normal` has no dimension of seeds.
        let path = array.chunk_path(&self.root, &chunk[usize::from(name == "normal")..]);
        let file = File::open(&path).map_err(Error::io("read", &path))?;
        values::read_at(&file, &path, 0, out)?;
        check_finite(name, pose, 0, row, out, || path.clone())
    }
}

fn create(root: &Path, arrays: &Arrays, header: &ReferenceHeader, bake: &str) -> Result<(), Error> {
    let own: Vec<String> = arrays.all().map(|array| array.name.clone()).to_vec();
    files::begin_group(root, &own)?;
    let poses: Vec<i32> = header.poses.iter().map(|&pose| pose as i32).collect();
    write_table(root, &arrays.pose, bytes_of(&poses))?;
    for array in [&arrays.coefficients, &arrays.noise, &arrays.normal] {
        array.create(root)?;
    }
    let metadata = json!({
        "zarr_format": 3,
        "node_type": "group",
        "attributes": {
            "format_version": FORMAT_VERSION,
            "hash": header.hash,
            "bake": bake,
            "rays": header.rays,
            "seeds": header.seeds,
            "poses": header.poses,
        },
    });
    fields::write(root, &metadata, fields::GROUP_BYTES)?;
    files::remove_temporaries(root)
}

fn read_header(root: &Path, dataset: &Dataset) -> Result<ReferenceHeader, Error> {
    let path = root.join("zarr.json");
    let group = fields::object(&path, fields::GROUP_BYTES)?;
    let map: Map<String, Value> = fields::field(&path, &group, "attributes", "an object")?;
    let found: u64 = fields::field(&path, &map, "format_version", "an integer")?;
    if found != FORMAT_VERSION {
        return Err(Error::Version { path, found, supported: FORMAT_VERSION });
    }
    let found: String = fields::field(&path, &map, "bake", "a hash")?;
    let bake = &dataset.header().attributes.hashes["bake"];
    if found != *bake {
        let (path, stage) = (root.to_path_buf(), String::from("bake"));
        return Err(Error::OtherRecipe { path, stage, expected: bake.clone(), found });
    }
    let poses: Vec<usize> = fields::field(&path, &map, "poses", "a list of pose indices")?;
    let end = dataset.header().layout.poses;
    if poses.is_empty() || !poses.is_sorted_by(|a, b| a < b) || poses.iter().any(|&p| p >= end) {
        let expected = format!("ascending pose indices below {end}");
        return Err(fields::mismatch(&path, "poses", &expected, map.get("poses")));
    }
    Ok(ReferenceHeader {
        poses,
        rays: fields::field(&path, &map, "rays", "a count")?,
        seeds: fields::field(&path, &map, "seeds", "two integers")?,
        hash: fields::field(&path, &map, "hash", "a hash")?,
    })
}

/// Which seeds of which poses are there, after the sizes of all their chunks are found right.
fn committed(root: &Path, arrays: &Arrays, poses: usize) -> Result<Vec<[bool; 2]>, Error> {
    let mut committed = vec![[false; 2]; poses];
    for (index, of_pose) in committed.iter_mut().enumerate() {
        for (seed, there) in of_pose.iter_mut().enumerate() {
            let remedy = arrays.coefficients.chunk_path(root, &[seed, index]);
            *there = files::check_size(&remedy, arrays.coefficients.chunk_bytes())?.is_some();
            for (array, chunk) in [(&arrays.noise, &[seed, index][..]), (&arrays.normal, &[index])]
            {
                let path = array.chunk_path(root, chunk);
                if *there && files::check_size(&path, array.chunk_bytes())?.is_none() {
                    return Err(Error::ChunkMissing { path, remedy });
                }
            }
        }
    }
    Ok(committed)
}
