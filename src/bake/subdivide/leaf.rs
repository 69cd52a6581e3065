//! A triangle as a part of one of the input's.

/// A triangle of the hierarchy, or of the result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leaf {
    /// Vertices.
    pub corners: [u32; 3],
    /// The input's triangle that it is part of.
    pub root: u32,
    /// Weights of the root's corners at each corner; dyadic, so exact.
    pub at: [[f32; 3]; 3],
    /// How often it was split.
    pub depth: u8,
}

impl Leaf {
    /// A triangle of the input.
    #[must_use]
    pub fn root(root: u32, corners: [u32; 3]) -> Self {
        let corner = |i: usize| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
        Self { corners, root, at: [corner(0), corner(1), corner(2)], depth: 0 }
    }

    /// Area as a share of the root's.
    #[must_use]
    pub fn share(&self) -> f32 {
        let [a, b, c] = self.at;
        ((b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])).abs()
    }

    /// The corners of each edge: the first from corner 0 to 1.
    pub(super) fn sides(&self) -> [[u32; 2]; 3] {
        let [a, b, c] = self.corners;
        [[a, b], [b, c], [c, a]]
    }

    /// Weights of the root's corners in the middle of a side.
    pub(super) fn middle(&self, side: usize) -> [f32; 3] {
        let (from, to) = (self.at[side], self.at[(side + 1) % 3]);
        [0, 1, 2].map(|i| (from[i] + to[i]) / 2.0)
    }
}
