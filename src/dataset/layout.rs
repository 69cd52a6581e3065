//! The sizes of a data set, checked once; every other size follows from them.

use std::ops::Range;

use super::Error;

/// The sizes of all arrays.
///
/// *Invariant:* after [`Layout::check`] every product of sizes that the format needs fits in
/// 62 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Poses baked, training and held out. 1 to 2²⁴.
    pub poses: usize,
    /// Merged vertices. 1 to 2²⁷.
    pub points: usize,
    /// Vertices of the file. 1 to 2²⁷.
    pub vertices: usize,
    /// Triangles of the file. 1 to 2²⁷.
    pub triangles: usize,
    /// Colour channels, 1 to 3.
    pub channels: usize,
    /// Coefficients per channel, 1 to 100.
    pub coefficients: usize,
    /// Pose parameters, 0 to 2¹⁶ (0: a static scene).
    pub parameters: usize,
    /// Bones, 1 to 2¹⁶ (one more than the greatest index of a `u16`).
    pub bones: usize,
    /// Poses per chunk file, 1 to 2¹⁶. A matter of memory and speed only: a continued data set
    /// keeps the one that it was created with.
    pub block_poses: usize,
}

/// Name, greatest value and least value of each size, in the order of [`Layout::sizes`].
const BOUNDS: [(&str, u64, u64); 9] = [
    ("poses", 1 << 24, 1),
    ("points", 1 << 27, 1),
    ("vertices", 1 << 27, 1),
    ("triangles", 1 << 27, 1),
    ("channels", 3, 1),
    ("coefficients", 100, 1),
    ("parameters", 1 << 16, 0),
    ("bones", 1 << 16, 1),
    ("block_poses", 1 << 16, 1),
];

/// Bound of each table and source file, which readers hold in memory.
pub(super) const MAX_TABLE_BYTES: u64 = 4 << 30;

impl Layout {
    /// All sizes with their names, as they stand in the header.
    pub(super) fn sizes(&self) -> [(&'static str, usize); 9] {
        let values = [
            self.poses,
            self.points,
            self.vertices,
            self.triangles,
            self.channels,
            self.coefficients,
            self.parameters,
            self.bones,
            self.block_poses,
        ];
        std::array::from_fn(|i| (BOUNDS[i].0, values[i]))
    }

    /// The inverse of [`Layout::sizes`]: asks `size` for each by its name.
    pub(super) fn from_sizes(
        mut size: impl FnMut(&'static str) -> Result<usize, Error>,
    ) -> Result<Self, Error> {
        Ok(Self {
            poses: size("poses")?,
            points: size("points")?,
            vertices: size("vertices")?,
            triangles: size("triangles")?,
            channels: size("channels")?,
            coefficients: size("coefficients")?,
            parameters: size("parameters")?,
            bones: size("bones")?,
            block_poses: size("block_poses")?,
        })
    }

    /// Whether every size lies within its bounds.
    ///
    /// # Errors
    /// [`Error::Layout`] names the first size that does not.
    pub fn check(&self) -> Result<(), Error> {
        for ((field, value), (_, most, least)) in self.sizes().into_iter().zip(BOUNDS) {
            let found = value as u64;
            if found < least || found > most {
                let bound = format!("it must be from {least} to {most}");
                return Err(Error::Layout { field, found, bound });
            }
        }
        for (field, count, bytes) in
            [("poses × parameters", self.parameters, 4), ("poses × bones", self.bones, 16)]
        {
            let found = self.poses as u64 * count as u64;
            if found > MAX_TABLE_BYTES / bytes {
                let bound = format!("it must be at most {}", MAX_TABLE_BYTES / bytes);
                return Err(Error::Layout { field, found, bound });
            }
        }
        Ok(())
    }

    /// Values per point: channels × coefficients.
    #[must_use]
    pub fn row(&self) -> usize {
        self.channels * self.coefficients
    }

    /// Number of blocks; the last may be only partly filled.
    #[must_use]
    pub fn blocks(&self) -> usize {
        self.poses.div_ceil(self.block_poses)
    }

    /// The poses of a block.
    ///
    /// # Panics
    /// If there is no such block.
    #[must_use]
    pub fn poses_of(&self, block: usize) -> Range<usize> {
        assert!(block < self.blocks(), "block {block} of {}", self.blocks());
        let start = block * self.block_poses;
        start..self.poses.min(start + self.block_poses)
    }

    /// Bytes of all chunk files of a complete data set, without its sources, metadata and
    /// references. The padding of the last block counts.
    #[must_use]
    pub fn disk_bytes(&self) -> u64 {
        super::arrays::blocks(self)
            .iter()
            .chain(&super::arrays::tables(self))
            .map(|array| array.chunk_bytes() * array.chunks())
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: Layout = Layout {
        poses: 10,
        points: 5,
        vertices: 6,
        triangles: 4,
        channels: 1,
        coefficients: 4,
        parameters: 3,
        bones: 2,
        block_poses: 4,
    };

    /// Blocks tile the poses; the last one is short.
    #[test]
    fn blocks_cover_poses() {
        assert_eq!(SMALL.blocks(), 3);
        assert_eq!(SMALL.poses_of(0), 0..4);
        assert_eq!(SMALL.poses_of(2), 8..10);
        let all: Vec<usize> = (0..3).flat_map(|block| SMALL.poses_of(block)).collect();
        assert_eq!(all, (0..10).collect::<Vec<_>>());
    }

    /// Zero poses, and any size that a hostile or mistaken header may claim, is refused by name;
    /// sizes at the bounds do not overflow.
    #[test]
    fn sizes_are_bounded() {
        SMALL.check().unwrap();
        let broken = [
            Layout { poses: 0, ..SMALL },
            Layout { poses: usize::MAX, ..SMALL },
            Layout { points: 0, ..SMALL },
            Layout { vertices: 1 << 40, ..SMALL },
            Layout { triangles: 0, ..SMALL },
            Layout { channels: 4, ..SMALL },
            Layout { coefficients: 101, ..SMALL },
            Layout { parameters: 1 << 17, ..SMALL },
            Layout { bones: 0, ..SMALL },
            Layout { block_poses: 0, ..SMALL },
            Layout { poses: 1 << 24, bones: 1 << 16, ..SMALL },
        ];
        for layout in broken {
            let error = layout.check().unwrap_err();
            assert!(matches!(error, Error::Layout { .. }), "{layout:?}: {error}");
        }
        let most = Layout {
            poses: 1 << 24,
            points: 1 << 27,
            vertices: 1 << 27,
            triangles: 1 << 27,
            channels: 3,
            coefficients: 100,
            parameters: 16,
            bones: 16,
            block_poses: 1 << 16,
        };
        most.check().unwrap();
        assert!(most.disk_bytes() > 1 << 61);
    }
}
