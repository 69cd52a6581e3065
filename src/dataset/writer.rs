//! Makes a data set, block by block, and continues one that was left unfinished.

use std::borrow::Cow;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::arrays::{self, Array};
use super::files::{self, Content};
use super::layout::MAX_TABLE_BYTES;
use super::tables::Tables;
use super::values::bytes_of;
use super::{Error, Header, Layout, Static, blocks, json as fields};
use crate::scene::Source;

/// The one writer of a data set; it holds the folder's lock while it lives.
#[derive(Debug)]
pub struct Writer {
    root: PathBuf,
    layout: Layout,
    committed: Vec<bool>,
    _lock: File,
}

/// What a bake gives for one pose, borrowed for writing.
#[derive(Debug, Clone, Copy)]
pub struct PoseData<'a> {
    /// `[point, channel, coefficient]`, root frame, all finite.
    pub coefficients: &'a [f32],
    /// Root mean square over the coefficients of the standard error, one per point.
    pub noise: &'a [f32],
    /// Rays spent, one per point.
    pub rays: &'a [u32],
}

impl Writer {
    /// Creates the data set at `path`, or continues the one that is there.
    ///
    /// A folder that is absent or empty, or in which an earlier creation was interrupted, becomes
    /// a new data set. One that exists must have this format version, the same hashes and the same
    /// tables; its block size then stands ([`Writer::layout`]), whatever `header` says. Temporaries
    /// of a killed writer are removed.
    ///
    /// # Errors
    /// [`Error::OtherRecipe`], [`Error::Version`], [`Error::OtherContent`] where the existing one
    /// is another; [`Error::Locked`], [`Error::Occupied`], [`Error::Io`]; lengths and values that
    /// do not fit the layout; chunks of the wrong size.
    pub fn open(path: &Path, header: &Header, statics: &Static) -> Result<Self, Error> {
        header.check(path)?;
        let tables = Tables { poses: &statics.poses, mesh: &statics.mesh };
        tables.check(&header.layout, header.attributes.clip_names.len())?;
        files::create_folder(path)?;
        let lock = files::lock(path)?;
        let metadata = path.join("zarr.json");
        let layout = if files::size(&metadata)?.is_some() {
            let found = Header::read(&metadata)?;
            header.agree(path, &found)?;
            remove_temporaries(path, &found.layout)?;
            compare(path, &found.layout, &tables, &statics.sources)?;
            found.layout
        } else {
            create(path, header, &tables, &statics.sources)?;
            header.layout
        };
        let committed = blocks::committed(path, &layout)?;
        Ok(Self { root: path.to_path_buf(), layout, committed, _lock: lock })
    }

    /// Whether what is at `path` could be continued with this header; nothing is touched. Tables
    /// and chunks are not compared.
    ///
    /// # Errors
    /// [`Error::OtherRecipe`], [`Error::Version`], [`Error::OtherContent`] as [`Writer::open`].
    pub fn check(path: &Path, header: &Header) -> Result<(), Error> {
        let metadata = path.join("zarr.json");
        if files::size(&metadata)?.is_none() {
            return Ok(());
        }
        header.agree(path, &Header::read(&metadata)?)
    }

    /// The sizes, with the block size that this data set really has.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The blocks that are still to be baked, ascending.
    #[must_use]
    pub fn missing_blocks(&self) -> Vec<usize> {
        (0..self.committed.len()).filter(|&block| !self.committed[block]).collect()
    }

    /// Writes a block for good: `rays`, `noise`, then `coefficients`, whose presence commits.
    /// `poses` are those of [`Layout::poses_of`], in order. A block that is there already is
    /// replaced.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a value that no reader would accept, [`Error::Io`] on a full disk
    /// or the like; the block then stays missing and nothing has its final name half-written.
    ///
    /// # Panics
    /// If there is no such block, or the number of poses or a length is not the layout's.
    pub fn commit(&mut self, block: usize, poses: &[PoseData<'_>]) -> Result<(), Error> {
        let range = self.layout.poses_of(block);
        assert_eq!(poses.len(), range.len(), "poses of block {block}");
        let points = self.layout.points;
        for pose in poses {
            assert_eq!(pose.coefficients.len(), points * self.layout.row(), "coefficients");
            assert_eq!(pose.noise.len(), points, "noise");
            assert_eq!(pose.rays.len(), points, "rays");
        }
        let [coefficients, noise, rays] = arrays::blocks(&self.layout);
        let path = |array: &Array| array.chunk_path(&self.root, &[block]);
        for (pose, data) in range.zip(poses) {
            let row = self.layout.row();
            blocks::check_finite("coefficients", pose, 0, row, data.coefficients, || {
                path(&coefficients)
            })?;
            blocks::check_finite("noise", pose, 0, 1, data.noise, || path(&noise))?;
        }
        let bytes = poses.iter().map(|pose| bytes_of(pose.rays)).collect();
        write_chunk(&self.root, &rays, &[block], bytes)?;
        let bytes = poses.iter().map(|pose| bytes_of(pose.noise)).collect();
        write_chunk(&self.root, &noise, &[block], bytes)?;
        let bytes = poses.iter().map(|pose| bytes_of(pose.coefficients)).collect();
        write_chunk(&self.root, &coefficients, &[block], bytes)?;
        self.committed[block] = true;
        Ok(())
    }
}

/// Writes one chunk, filled up to its full size as Zarr demands.
pub(super) fn write_chunk(
    root: &Path,
    array: &Array,
    index: &[usize],
    parts: Vec<Cow<'_, [u8]>>,
) -> Result<(), Error> {
    let given: u64 = parts.iter().map(|part| part.len() as u64).sum();
    let padding = array.chunk_bytes() - given;
    let content = Content { parts, fill: array.data_type.fill(), padding };
    files::replace(&array.folder(root), &array.chunk_name(index), &content)
}

/// An array that is one chunk, with its metadata.
pub(super) fn write_table(root: &Path, array: &Array, bytes: Cow<'_, [u8]>) -> Result<(), Error> {
    array.create(root)?;
    if array.chunks() > 0 {
        write_chunk(root, array, &[], vec![bytes])?;
    }
    Ok(())
}

/// Top-level entries of a data set, which an interrupted creation may have left.
fn own_entries(layout: &Layout) -> Vec<String> {
    let arrays = arrays::tables(layout).into_iter().chain(arrays::blocks(layout));
    let mut names: Vec<String> = arrays.map(|array| array.name).collect();
    names.push(String::from("source"));
    names
}

fn create(
    root: &Path,
    header: &Header,
    tables: &Tables<'_>,
    sources: &[Source],
) -> Result<(), Error> {
    let layout = &header.layout;
    files::begin_group(root, &own_entries(layout))?;
    for (array, bytes) in arrays::tables(layout).iter().zip(tables.bytes()) {
        write_table(root, array, bytes)?;
    }
    for array in arrays::blocks(layout) {
        array.create(root)?;
    }
    let folder = root.join("source");
    files::create_folder(&folder)?;
    for (index, source) in sources.iter().enumerate() {
        let bytes = source.bytes.len() as u64;
        if bytes > MAX_TABLE_BYTES {
            let path = source.name.clone().into();
            return Err(Error::TooLarge { path, bytes, limit: MAX_TABLE_BYTES });
        }
        let array = arrays::source(index, &source.name, source.bytes.len());
        write_table(root, &array, Cow::Borrowed(&source.bytes))?;
    }
    fields::write(&folder, &sources_metadata(sources), fields::GROUP_BYTES)?;
    fields::write(root, &header.to_json(), fields::GROUP_BYTES)?;
    // The mark of an unfinished creation.
    files::remove_temporaries(root)
}

/// The `zarr.json` of group `source`.
fn sources_metadata(sources: &[Source]) -> Value {
    let files: Vec<Value> = (sources.iter())
        .map(|source| json!({"name": source.name, "bytes": source.bytes.len()}))
        .collect();
    json!({"zarr_format": 3, "node_type": "group", "attributes": {"files": files}})
}

fn remove_temporaries(root: &Path, layout: &Layout) -> Result<(), Error> {
    files::remove_temporaries(root)?;
    for array in arrays::blocks(layout) {
        files::remove_temporaries(&array.folder(root))?;
    }
    Ok(())
}

/// Refuses to continue a data set whose tables or sources are not bit for bit those at hand.
fn compare(
    root: &Path,
    layout: &Layout,
    tables: &Tables<'_>,
    sources: &[Source],
) -> Result<(), Error> {
    for array in arrays::blocks(layout) {
        array.check(root)?;
    }
    for (array, bytes) in arrays::tables(layout).iter().zip(tables.bytes()) {
        compare_table(root, array, &bytes)?;
    }
    for (index, source) in sources.iter().enumerate() {
        let array = arrays::source(index, &source.name, source.bytes.len());
        compare_table(root, &array, &source.bytes)?;
    }
    Ok(())
}

fn compare_table(root: &Path, array: &Array, bytes: &[u8]) -> Result<(), Error> {
    array.check(root)?;
    super::values::check_table(root, array)?;
    if array.chunks() == 0 {
        return Ok(());
    }
    let path = array.chunk_path(root, &[]);
    if fs::read(&path).map_err(Error::io("read", &path))? != bytes {
        let what = format!("array `{}`", array.name);
        return Err(Error::OtherContent { path: root.to_path_buf(), what });
    }
    Ok(())
}
