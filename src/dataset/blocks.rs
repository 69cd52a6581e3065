//! The blocks of poses: which are committed, and reading rows out of them.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::arrays::{self, Array};
use super::{Error, Layout, files, values};

/// Which blocks are there, after the sizes of all their chunk files are found right.
pub(super) fn committed(root: &Path, layout: &Layout) -> Result<Vec<bool>, Error> {
    let [coefficients, noise, rays] = arrays::blocks(layout);
    let mut committed = Vec::with_capacity(layout.blocks());
    for block in 0..layout.blocks() {
        let path = coefficients.chunk_path(root, &[block]);
        let there = files::check_size(&path, coefficients.chunk_bytes())?.is_some();
        committed.push(there);
        if !there {
            continue;
        }
        for array in [&noise, &rays] {
            let chunk = array.chunk_path(root, &[block]);
            if files::check_size(&chunk, array.chunk_bytes())?.is_none() {
                return Err(Error::ChunkMissing { path: chunk, remedy: path });
            }
        }
    }
    Ok(committed)
}

/// Refuses NaN and infinities among the `values` of a pose, `row` per point from `first_point` on.
pub(super) fn check_finite(
    array: &'static str,
    pose: usize,
    first_point: usize,
    row: usize,
    values: &[f32],
    path: impl FnOnce() -> PathBuf,
) -> Result<(), Error> {
    // Without a branch per value, so that the compiler vectorises it.
    if !values.iter().fold(false, |bad, value| bad | !value.is_finite()) {
        return Ok(());
    }
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(index) => {
            let point = first_point + index / row;
            Err(Error::NotFinite { array, pose, point, found: values[index], path: path() })
        }
    }
}

/// An array of blocks of poses, `row` values per point, for reading.
pub(super) struct Rows<'a> {
    pub(super) root: &'a Path,
    pub(super) layout: &'a Layout,
    /// For messages.
    pub(super) name: &'static str,
    pub(super) array: &'a Array,
    pub(super) row: usize,
}

impl Rows<'_> {
    /// Reads the values of a range of points at the listed poses into `out` `[pose, point, row]`,
    /// one read per pose.
    pub(super) fn read(
        &self,
        poses: &[usize],
        points: Range<usize>,
        out: &mut [f32],
    ) -> Result<(), Error> {
        let whole = self.layout.points;
        assert!(
            points.start <= points.end && points.end <= whole,
            "points {points:?} of a data set with {whole}"
        );
        let width = points.len() * self.row;
        assert_eq!(out.len(), poses.len() * width, "length of the output");
        if width == 0 {
            return Ok(());
        }
        let block = |pose: usize| pose / self.layout.block_poses;
        let runs = poses.chunk_by(|&a, &b| block(a) == block(b));
        let mut left = out;
        for run in runs {
            let (own, rest) = left.split_at_mut(run.len() * width);
            self.read_run(block(run[0]), run, points.clone(), own)?;
            left = rest;
        }
        Ok(())
    }

    /// As [`Rows::read`], for poses of one block.
    fn read_run(
        &self,
        block: usize,
        poses: &[usize],
        points: Range<usize>,
        out: &mut [f32],
    ) -> Result<(), Error> {
        let in_block = self.layout.poses_of(block);
        let path = self.array.chunk_path(self.root, &[block]);
        let file = File::open(&path).map_err(|source| match source.kind() {
            io::ErrorKind::NotFound => {
                let root = self.root.to_path_buf();
                Error::MissingBlock { path: root, block, poses: in_block.clone() }
            }
            _ => Error::io("read", &path)(source),
        })?;
        for (&pose, out) in poses.iter().zip(out.chunks_exact_mut(points.len() * self.row)) {
            assert!(in_block.contains(&pose), "pose {pose} of {}", self.layout.poses);
            let before = (pose - in_block.start) as u64 * self.layout.points as u64;
            let offset = (before + points.start as u64) * self.row as u64;
            values::read_at(&file, &path, offset, out)?;
            check_finite(self.name, pose, points.start, self.row, out, || path.clone())?;
        }
        Ok(())
    }
}
