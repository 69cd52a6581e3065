//! How the points of a mesh move, for families that put points which move alike into one cluster.

/// What is known of every point's movement.
#[derive(Debug, Clone, PartialEq)]
pub enum Movement {
    /// Skin weights: for each point the nodes that move it, and their shares.
    Weights(Vec<Vec<(u32, f32)>>),
    /// How the surface turns where there is no skeleton (James and Twigg 2005): for each point its rotation
    /// matrices at some poses.
    Turns {
        /// Numbers of a point: nine times the poses.
        width: usize,
        /// `[point, pose, row, column]`, scaled so that the distance of two points is the root mean square over
        /// the poses of √2 sin(θ/2), where θ is the angle between them: √2 at most, as for skin weights.
        values: Vec<f32>,
    },
}

impl Movement {
    /// Number of points.
    #[must_use]
    pub fn points(&self) -> usize {
        match self {
            Self::Weights(weights) => weights.len(),
            Self::Turns { width, values } => values.len() / (*width).max(1),
        }
    }

    /// That of some of the points.
    ///
    /// # Panics
    /// If a point does not exist.
    #[must_use]
    pub fn at(&self, points: &[u32]) -> Self {
        let points = points.iter().map(|&point| point as usize);
        match self {
            Self::Weights(all) => Self::Weights(points.map(|point| all[point].clone()).collect()),
            Self::Turns { width, values } => {
                let row = |point: usize| &values[point * width..(point + 1) * width];
                Self::Turns { width: *width, values: points.flat_map(row).copied().collect() }
            }
        }
    }
}
