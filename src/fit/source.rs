//! The training data as a stream of blocks of points, in the frame of the fit.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::frame::{self, BoneFrame};
use super::geometry::Geometry;
use super::occluder::{Explained, Placed};
use super::tangent_frame::TangentFrame;
use super::{Error, Frame};
use crate::dataset::Training;

/// Numbers in a block, at most, where more than one point fits: small enough that a few blocks
/// per thread are nothing beside a model, large enough that products run at full speed.
/// Tests have small data, and should have many blocks too.
const BLOCK_NUMBERS: usize = if cfg!(test) { 1 << 14 } else { 1 << 21 };
/// Points in a block, at most.
const BLOCK_POINTS: usize = 1 << 12;
/// Blocks that small data are cut into, so that all threads have some, ...
const LEAST_BLOCKS: usize = 32;
/// ... unless they would get smaller than this many points.
const LEAST_BLOCK_POINTS: usize = 64;
/// Numbers of what is left of the data that are kept for the passes to come, at most: 256 MiB.
const MOST_KEPT: usize = 1 << 26;

/// A training set in the frame of the fit.
///
/// *Invariant:* blocks depend on the sizes of the data alone, and what is computed from blocks is
/// combined in their order. How many are in memory at once changes no byte.
#[derive(Debug)]
pub(super) struct Source<'a> {
    training: &'a Training<'a>,
    frame: Axes<'a>,
    explained: Option<Explained<'a>>,
    kept: Option<Arc<Rest>>,
    block_points: usize,
    in_flight: usize,
    keeps_noise: bool,
}

/// The axes of the coefficients, where they are not the data's own.
#[derive(Debug)]
enum Axes<'a> {
    Root,
    Bone(BoneFrame<'a>),
    Tangent(TangentFrame<'a>),
}

/// What is left of the data without what is explained: the values of every block.
#[derive(Debug)]
pub(super) struct Rest(Vec<Vec<f32>>);

/// A block of points at all poses.
#[derive(Debug, Default)]
pub(super) struct Block {
    /// The points.
    pub(super) points: Range<usize>,
    /// `[pose, point, channel, coefficient]`.
    pub(super) values: Vec<f32>,
    scratch: frame::Scratch,
}

impl<'a> Source<'a> {
    pub(super) fn new(
        training: &'a Training<'a>,
        frame: Frame,
        geometry: Option<&'a Geometry<'a>>,
    ) -> Result<Self, Error> {
        let sizes = [
            ("poses", training.poses()),
            ("points", training.points()),
            ("coefficients", training.channels() * training.coefficients()),
        ];
        if let Some((what, _)) = sizes.into_iter().find(|(_, size)| *size == 0) {
            return Err(Error::Empty { what });
        }
        let frame = match frame {
            Frame::Root => Axes::Root,
            Frame::Bone => BoneFrame::new(training)?.map_or(Axes::Root, Axes::Bone),
            // Scalars have no direction.
            Frame::Tangent if training.coefficients() == 1 => Axes::Root,
            Frame::Tangent => {
                let geometry = geometry.filter(|g| g.tangents.is_some());
                let geometry = geometry.ok_or(Error::NeedsGeometry)?;
                Axes::Tangent(TangentFrame::new(frame::order_of(training)?, geometry))
            }
        };
        let numbers = training.poses() * training.channels() * training.coefficients();
        let few = training.points().div_ceil(LEAST_BLOCKS).max(LEAST_BLOCK_POINTS);
        let block_points = (BLOCK_NUMBERS / numbers).clamp(1, BLOCK_POINTS.min(few));
        let in_flight = 2 * rayon::current_num_threads();
        let (explained, kept, keeps_noise) = (None, None, false);
        Ok(Self { training, frame, explained, kept, block_points, in_flight, keeps_noise })
    }

    /// Removes from now on what needs no learning.
    pub(super) fn explain(&mut self, explained: Explained<'a>) {
        self.explained = Some(explained);
    }

    /// Removes from now on what these occluders block, too.
    pub(super) fn explain_further(&mut self, placed: Placed) {
        if let Some(explained) = &mut self.explained {
            explained.place(placed);
        }
    }

    /// Computes once what is left, where it is small enough to be kept: every pass over the data
    /// would look at the posed mesh again. `None` where it is not.
    pub(super) fn rest(&self) -> Result<Option<Rest>, Error> {
        if self.poses() * self.points() * self.width() > MOST_KEPT {
            return Ok(None);
        }
        let mut values = Vec::new();
        self.for_each_batch(|blocks| {
            values.extend(blocks.iter_mut().map(|block| std::mem::take(&mut block.values)));
            Ok(())
        })?;
        Ok(Some(Rest(values)))
    }

    /// Takes from now on what [`Source::rest`] of the same data gave.
    pub(super) fn take_rest(&mut self, kept: Arc<Rest>) {
        self.kept = Some(kept);
    }

    /// What is removed.
    pub(super) fn explained(&self) -> Option<&Explained<'a>> {
        self.explained.as_ref()
    }

    /// p.
    pub(super) fn poses(&self) -> usize {
        self.training.poses()
    }

    /// v.
    pub(super) fn points(&self) -> usize {
        self.training.points()
    }

    /// Numbers per point and pose, c: channels × coefficients.
    pub(super) fn width(&self) -> usize {
        self.training.channels() * self.training.coefficients()
    }

    /// σ² of one number's sampling noise, as far as the data know it and it is not wanted.
    pub(super) fn noise_variance(&self) -> f64 {
        let variance = self.training.noise_variance();
        if self.keeps_noise || !variance.is_finite() { 0.0 } else { variance.max(0.0) }
    }

    /// The same of one point's numbers; that of all where points are not told apart.
    pub(super) fn noise_of(&self, point: usize) -> f64 {
        match self.training.noise_of_points().get(point) {
            Some(&variance) if !self.keeps_noise => f64::from(variance),
            _ => self.noise_variance(),
        }
    }

    /// From now on the data are what is to be said, noise and all: compression.
    pub(super) fn keep_noise(&mut self) {
        self.keeps_noise = true;
    }

    /// Calls `use_blocks` with the blocks of all points, in order, a few at a time.
    pub(super) fn for_each_batch(
        &self,
        mut use_blocks: impl FnMut(&mut [Block]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let points = self.points();
        let count = points.div_ceil(self.block_points);
        let mut blocks: Vec<Block> = Vec::new();
        blocks.resize_with(self.in_flight.min(count), Block::default);
        for start in (0..count).step_by(self.in_flight) {
            let blocks = &mut blocks[..self.in_flight.min(count - start)];
            blocks.par_iter_mut().enumerate().try_for_each(|(i, block)| {
                let first = (start + i) * self.block_points;
                self.read(first..points.min(first + self.block_points), block)
            })?;
            use_blocks(blocks)?;
        }
        Ok(())
    }

    /// Maps blocks on all threads and folds what comes out in the order of the points.
    pub(super) fn map_fold<T: Send>(
        &self,
        map: impl Fn(&Block) -> Result<T, Error> + Sync,
        mut fold: impl FnMut(&Block, T),
    ) -> Result<(), Error> {
        self.for_each_batch(|blocks| {
            let mapped: Vec<T> = blocks.par_iter().map(&map).collect::<Result<_, Error>>()?;
            blocks.iter().zip(mapped).for_each(|(block, value)| fold(block, value));
            Ok(())
        })
    }

    fn read(&self, points: Range<usize>, block: &mut Block) -> Result<(), Error> {
        block.points = points.clone();
        if let Some(Rest(blocks)) = self.kept.as_deref() {
            block.values.clone_from(&blocks[points.start / self.block_points]);
            return Ok(());
        }
        block.values.resize(self.poses() * points.len() * self.width(), 0.0);
        self.training.read_points(points.clone(), &mut block.values)?;
        self.check(block)?;
        match &self.frame {
            Axes::Root => {}
            Axes::Bone(frame) => {
                frame.turn(points.start, &mut block.values, points.len(), &mut block.scratch);
            }
            Axes::Tangent(frame) => frame.turn(points.clone(), &mut block.values),
        }
        if let Some(explained) = &self.explained {
            explained.remove(points, &mut block.values);
        }
        Ok(())
    }

    fn check(&self, block: &Block) -> Result<(), Error> {
        // No early exit, so that the loop is a plain reduction.
        if block.values.iter().fold(true, |finite, x| finite & x.is_finite()) {
            return Ok(());
        }
        let at = block.values.iter().position(|x| !x.is_finite()).expect("one is not finite");
        let (width, points) = (self.width(), block.points.len());
        Err(Error::Value {
            pose: at / (points * width),
            point: block.points.start + at / width % points,
            coefficient: at % width,
            found: block.values[at],
        })
    }

    /// As made by `new`, with another number of blocks in memory at once.
    #[cfg(test)]
    pub(super) fn with_in_flight(mut self, in_flight: usize) -> Self {
        self.in_flight = in_flight;
        self
    }
}

impl Block {
    /// The coefficients of one pose, `[point, channel, coefficient]`.
    pub(super) fn pose(&self, pose: usize, poses: usize) -> &[f32] {
        let size = self.values.len() / poses;
        &self.values[pose * size..(pose + 1) * size]
    }
}
