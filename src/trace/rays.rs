//! What goes into a query and what comes out.

use glam::Vec3;

/// Rays from one origin, directions as structure of arrays.
///
/// Directions need not have unit length; distances count in their lengths. Rays that lie near one
/// another in the block should point in similar directions: consecutive ones share a packet.
#[derive(Debug, Clone, Copy)]
pub struct Rays<'a> {
    /// Where all of them start, metres.
    pub origin: Vec3,
    /// First coordinates of the directions.
    pub x: &'a [f32],
    /// Second coordinates, as many.
    pub y: &'a [f32],
    /// Third coordinates, as many.
    pub z: &'a [f32],
    /// Hits nearer than this do not count; at least 0.
    pub near: f32,
    /// Hits further than this do not count; may be infinite.
    pub far: f32,
}

impl Rays<'_> {
    /// How many rays there are.
    ///
    /// # Panics
    /// If the three slices differ in length.
    #[must_use]
    pub fn len(&self) -> usize {
        let len = self.x.len();
        assert!(
            self.y.len() == len && self.z.len() == len,
            "directions of {len}, {} and {} coordinates",
            self.y.len(),
            self.z.len()
        );
        len
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }
}

/// How many 64-bit words hold one bit for each of `rays` rays.
#[must_use]
pub fn words_of(rays: usize) -> usize {
    rays.div_ceil(64)
}

/// How many rays the library traverses at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Width {
    /// Single rays.
    One,
    /// Packets of 4 (SSE).
    Four,
    /// Packets of 8 (AVX and AVX2).
    Eight,
    /// Packets of 16 (AVX-512).
    Sixteen,
}

impl Width {
    /// All of them, narrow to wide.
    pub const ALL: [Self; 4] = [Self::One, Self::Four, Self::Eight, Self::Sixteen];

    /// The number of rays.
    #[must_use]
    pub fn rays(self) -> usize {
        match self {
            Self::One => 1,
            Self::Four => 4,
            Self::Eight => 8,
            Self::Sixteen => 16,
        }
    }
}

/// Where a ray first meets the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance along the ray, in lengths of its direction.
    pub distance: f32,
    /// Index of the triangle.
    pub triangle: u32,
    /// Weight of the triangle's second vertex; that of the first is 1 − u − v.
    pub u: f32,
    /// Weight of the triangle's third vertex.
    pub v: f32,
    /// (p₁ − p₀) × (p₂ − p₀): not unit; it points to where the triangle runs counter-clockwise.
    pub normal: Vec3,
}
