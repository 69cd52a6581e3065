//! What a fit is allowed to see: the poses of split `training`, and nothing else.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Quat;

use super::{Dataset, Error, Movement};

/// Points that are read at once where only some are wanted.
const BLOCK: usize = 1024;

/// The training poses of a data set, read by ranges of points.
///
/// *Invariant:* no method gives a value of a pose outside split `training`; pose indices are
/// those within the training set.
#[derive(Debug)]
pub struct Training<'a> {
    parts: TrainingParts,
    movement: Option<Movement>,
    source: Source<'a>,
    stop: Option<&'a AtomicBool>,
}

#[derive(Debug)]
enum Source<'a> {
    Memory,
    Stored { dataset: &'a Dataset, poses: Vec<usize> },
}

/// A training set made in memory: for tests and synthetic data.
#[derive(Debug, Clone, Default)]
pub struct TrainingParts {
    /// Number of merged vertices.
    pub points: usize,
    /// Colour channels, 1 or 3.
    pub channels: usize,
    /// Spherical-harmonic coefficients per channel.
    pub coefficients: usize,
    /// Number of bones, at least 1.
    pub bones: usize,
    /// `[pose, parameter]`, not centred.
    pub parameters: Vec<f32>,
    /// One per parameter.
    pub parameter_names: Vec<String>,
    /// Clip of each pose, -1 where it belongs to none; its length is the number of poses.
    pub clips: Vec<i32>,
    /// `[pose, bone]`, relative to rest, in the root frame.
    pub bone_rotations: Vec<Quat>,
    /// Bone of each point.
    pub point_bones: Vec<u16>,
    /// Mean variance of one coefficient's sampling noise.
    pub noise_variance: f64,
    /// The same of each point, or empty where points are not told apart.
    pub noise_of_points: Vec<f32>,
    /// `[pose, point, channel, coefficient]`, root frame.
    pub values: Vec<f32>,
}

impl Training<'static> {
    /// A training set that is wholly in memory.
    ///
    /// # Panics
    /// If the lengths of the parts do not agree with one another.
    #[must_use]
    pub fn in_memory(parts: TrainingParts) -> Self {
        let poses = parts.clips.len();
        let row = parts.channels * parts.coefficients;
        assert_eq!(parts.parameters.len(), poses * parts.parameter_names.len(), "parameters");
        assert_eq!(parts.bone_rotations.len(), poses * parts.bones, "bone rotations");
        assert_eq!(parts.point_bones.len(), parts.points, "bones of points");
        assert_eq!(parts.values.len(), poses * parts.points * row, "values");
        Self { parts, movement: None, source: Source::Memory, stop: None }
    }
}

impl<'a> Training<'a> {
    /// The training poses `poses` of `dataset`; `parts.values` is empty.
    pub(super) fn stored(dataset: &'a Dataset, poses: Vec<usize>, parts: TrainingParts) -> Self {
        Self { parts, movement: None, source: Source::Stored { dataset, poses }, stop: None }
    }

    /// The same poses in other parameters, `[pose, parameter]`, not centred.
    ///
    /// # Panics
    /// If their number is not poses × names.
    #[must_use]
    pub fn with_parameters(mut self, parameters: Vec<f32>, names: Vec<String>) -> Self {
        assert_eq!(parameters.len(), self.poses() * names.len(), "parameters");
        self.parts.parameters = parameters;
        self.parts.parameter_names = names;
        self
    }

    /// Some of the poses, by their indices, in this order.
    ///
    /// # Panics
    /// If an index is not that of a pose.
    #[must_use]
    pub fn only(self, keep: &[usize]) -> Self {
        let (a, bones) = (self.parts.parameter_names.len(), self.parts.bones);
        let numbers = self.parts.points * self.parts.channels * self.parts.coefficients;
        fn rows<T: Copy>(from: &[T], keep: &[usize], width: usize) -> Vec<T> {
            keep.iter().flat_map(|&i| &from[i * width..(i + 1) * width]).copied().collect()
        }
        let mut parts = self.parts;
        parts.parameters = rows(&parts.parameters, keep, a);
        parts.bone_rotations = rows(&parts.bone_rotations, keep, bones);
        parts.clips = rows(&parts.clips, keep, 1);
        let source = match self.source {
            Source::Memory => {
                parts.values = rows(&parts.values, keep, numbers);
                Source::Memory
            }
            Source::Stored { dataset, poses } => {
                Source::Stored { dataset, poses: rows(&poses, keep, 1) }
            }
        };
        Self { parts, movement: self.movement, source, stop: self.stop }
    }

    /// Only the first coefficients of every channel: the lower bands of the harmonics.
    ///
    /// # Panics
    /// If there are not so many.
    #[must_use]
    pub fn with_coefficients(mut self, keep: usize) -> Self {
        let all = self.parts.coefficients;
        assert!((1..=all).contains(&keep), "{keep} of {all} coefficients");
        if let Source::Memory = self.source {
            let rows = self.parts.values.chunks_exact(all);
            self.parts.values = rows.flat_map(|row| &row[..keep]).copied().collect();
        }
        self.parts.coefficients = keep;
        self
    }

    /// The same until `stop` becomes true: then it reads no more.
    #[must_use]
    pub fn stopped_by(mut self, stop: &'a AtomicBool) -> Self {
        self.stop = Some(stop);
        self
    }

    /// Everything at some of the points, ascending, in memory.
    ///
    /// # Errors
    /// As [`Training::read_points`].
    ///
    /// # Panics
    /// If a point does not exist.
    pub fn parts_at(&self, points: &[u32]) -> Result<TrainingParts, Error> {
        let row = self.parts.channels * self.parts.coefficients;
        let mut values = vec![0.0; self.poses() * points.len() * row];
        let mut buffer = Vec::new();
        for first in (0..self.points()).step_by(BLOCK) {
            let range = first..self.points().min(first + BLOCK);
            let some = points.partition_point(|&p| (p as usize) < range.start)
                ..points.partition_point(|&p| (p as usize) < range.end);
            if some.is_empty() {
                continue;
            }
            buffer.resize(self.poses() * range.len() * row, 0.0);
            self.read_points(range.clone(), &mut buffer)?;
            for pose in 0..self.poses() {
                for i in some.clone() {
                    let from = (pose * range.len() + points[i] as usize - first) * row;
                    let to = (pose * points.len() + i) * row;
                    values[to..to + row].copy_from_slice(&buffer[from..from + row]);
                }
            }
        }
        let bones = &self.parts.point_bones;
        Ok(TrainingParts {
            points: points.len(),
            point_bones: points.iter().map(|&point| bones[point as usize]).collect(),
            noise_of_points: points
                .iter()
                .filter_map(|&point| self.parts.noise_of_points.get(point as usize).copied())
                .collect(),
            values,
            ..self.parts.clone()
        })
    }

    /// With how every point moves.
    ///
    /// # Panics
    /// If it is that of another number of points.
    #[must_use]
    pub fn moving(mut self, movement: Movement) -> Self {
        assert_eq!(movement.points(), self.points(), "points that move");
        self.movement = Some(movement);
        self
    }

    /// How every point moves, where that is known.
    #[must_use]
    pub fn movement(&self) -> Option<&Movement> {
        self.movement.as_ref()
    }

    /// Number of training poses.
    #[must_use]
    pub fn poses(&self) -> usize {
        self.parts.clips.len()
    }

    /// Number of points (merged vertices).
    #[must_use]
    pub fn points(&self) -> usize {
        self.parts.points
    }

    /// Colour channels, 1 or 3.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.parts.channels
    }

    /// Spherical-harmonic coefficients per channel.
    #[must_use]
    pub fn coefficients(&self) -> usize {
        self.parts.coefficients
    }

    /// Pose parameters, `[pose, parameter]`, not centred; angles in radians.
    #[must_use]
    pub fn parameters(&self) -> &[f32] {
        &self.parts.parameters
    }

    /// One name per parameter.
    #[must_use]
    pub fn parameter_names(&self) -> &[String] {
        &self.parts.parameter_names
    }

    /// The clip of each pose, -1 where it belongs to none.
    #[must_use]
    pub fn clips(&self) -> &[i32] {
        &self.parts.clips
    }

    /// Rotations of the bones relative to rest, in the root frame, `[pose, bone]`.
    #[must_use]
    pub fn bone_rotations(&self) -> &[Quat] {
        &self.parts.bone_rotations
    }

    /// Number of bones.
    #[must_use]
    pub fn bones(&self) -> usize {
        self.parts.bones
    }

    /// The dominant bone of each point.
    #[must_use]
    pub fn point_bones(&self) -> &[u16] {
        &self.parts.point_bones
    }

    /// Mean over poses and points of the variance of one coefficient's sampling noise
    /// (the square of the data set's `noise`).
    #[must_use]
    pub fn noise_variance(&self) -> f64 {
        self.parts.noise_variance
    }

    /// The same of each point; empty where points are not told apart.
    #[must_use]
    pub fn noise_of_points(&self) -> &[f32] {
        &self.parts.noise_of_points
    }

    /// Reads the coefficients of a range of points at every training pose into
    /// `out` `[pose, point, channel, coefficient]`, root frame. Safe to call from many threads.
    ///
    /// # Errors
    /// A chunk that cannot be read, is damaged, or holds a value that is not finite;
    /// [`Error::Stopped`] after a stop.
    ///
    /// # Panics
    /// If the range leaves the mesh, or `out` has another length than the product of the sizes.
    pub fn read_points(&self, points: Range<usize>, out: &mut [f32]) -> Result<(), Error> {
        if self.stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            return Err(Error::Stopped);
        }
        match &self.source {
            Source::Stored { dataset, poses } => {
                let (all, keep) = (dataset.header().layout.coefficients, self.parts.coefficients);
                if all == keep {
                    return dataset.read_points(poses, points, out);
                }
                let mut whole = vec![0.0; out.len() / keep * all];
                dataset.read_points(poses, points, &mut whole)?;
                for (out, row) in out.chunks_exact_mut(keep).zip(whole.chunks_exact(all)) {
                    out.copy_from_slice(&row[..keep]);
                }
                Ok(())
            }
            Source::Memory => {
                self.copy_points(points, out);
                Ok(())
            }
        }
    }

    fn copy_points(&self, points: Range<usize>, out: &mut [f32]) {
        let row = self.parts.channels * self.parts.coefficients;
        assert!(
            points.start <= points.end && points.end <= self.parts.points,
            "points {points:?} of {}",
            self.parts.points
        );
        assert_eq!(out.len(), self.poses() * points.len() * row, "length of the output");
        if out.is_empty() {
            return;
        }
        let stride = self.parts.points * row;
        let poses = self.parts.values.chunks_exact(stride);
        for (values, out) in poses.zip(out.chunks_exact_mut(points.len() * row)) {
            out.copy_from_slice(&values[points.start * row..points.end * row]);
        }
    }
}
