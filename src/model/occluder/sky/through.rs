//! An ellipsoid as points see it: a cap with a soft edge, in the space where it is the unit ball, and
//! the directions in that space.

use glam::{Mat3, Vec3};

use super::super::caps::{LANES, Lanes};

/// The square of a distance, over the square of a radius, that counts as at the centre.
const CENTRE: f32 = 1e-8;

/// An ellipsoid in a pose: where |shape · (x − centre)| ≤ 1.
#[derive(Debug, Clone, Copy)]
pub struct Ellipsoid {
    /// Metres.
    pub centre: Vec3,
    /// M, symmetric, 1/metres.
    pub shape: Mat3,
    /// Of the ball around it, metres.
    pub radius: f32,
}

impl Ellipsoid {
    /// In axes that `turn`, a rotation, brings it to.
    #[must_use]
    pub fn turned(&self, turn: &Mat3) -> Self {
        let (centre, shape) = (*turn * self.centre, *turn * self.shape * turn.transpose());
        Self { centre, shape, radius: self.radius }
    }
}

/// One ellipsoid as the points see it, in the space where it is the unit ball.
pub(super) struct Caps {
    /// p/|p|, by axis.
    towards: [Lanes; 3],
    /// e − σ/2: the cosine at which the edge begins.
    begin: Lanes,
    /// h/σ.
    slope: Lanes,
    /// h.
    height: Lanes,
}

impl Caps {
    #[inline(always)]
    pub(super) fn new(
        position: &[Lanes; 3],
        normal: &[Lanes; 3],
        ellipsoid: &Ellipsoid,
        softness: f32,
    ) -> Self {
        let Ellipsoid { centre, shape, radius } = ellipsoid;
        let [cx, cy, cz] = centre.to_array();
        let [mx, my, mz] = [shape.x_axis, shape.y_axis, shape.z_axis];
        let zero = [0.0; LANES];
        // Arrays of their own: the compiler makes vectors of these, not of rows of a matrix.
        let (mut px, mut py, mut pz) = (zero, zero, zero);
        let (mut begin, mut slope, mut height) = (zero, zero, zero);
        let half = 0.5 * softness;
        for i in 0..LANES {
            let [x, y, z] = [cx - position[0][i], cy - position[1][i], cz - position[2][i]];
            let p = [
                mx.x * x + my.x * y + mz.x * z,
                mx.y * x + my.y * y + mz.y * z,
                mx.z * x + my.z * y + mz.z * z,
            ];
            let square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + CENTRE;
            let inverse = 1.0 / square.sqrt();
            let sine = if inverse < 1.0 { inverse } else { 1.0 };
            let cosine = (1.0 - sine * sine).sqrt();
            let e = if cosine < 1.0 - half { cosine } else { 1.0 - half };
            let h = (1.0 - cosine) / half;
            let h = if h < 1.0 { h } else { 1.0 };
            let along = x * normal[0][i] + y * normal[1][i] + z * normal[2][i];
            let h = if along > -radius { h } else { 0.0 };
            (px[i], py[i], pz[i]) = (p[0] * inverse, p[1] * inverse, p[2] * inverse);
            (begin[i], slope[i], height[i]) = (e - half, h / softness, h);
        }
        Self { towards: [px, py, pz], begin, slope, height }
    }

    /// Directions outside of which nothing is covered from any of the points; `None` where nothing is
    /// at all.
    #[inline(always)]
    pub(super) fn cone(&self) -> Option<Cone> {
        let mut own = [1.0; LANES];
        for ((own, &begin), &height) in own.iter_mut().zip(&self.begin).zip(&self.height) {
            *own = if height > 0.0 { begin } else { 1.0 };
        }
        let begin = least(&own);
        if begin >= 1.0 {
            return None;
        }
        let (axis, spread) = enclosing(&self.towards);
        if axis == Vec3::ZERO {
            return Some(Cone::ALL);
        }
        let [a, b] = [begin, spread].map(|c| (1.0 - c * c).max(0.0).sqrt());
        let (cosine, sine) = (begin * spread - a * b, a * spread + begin * b);
        // Past a half turn.
        Some(if sine <= 0.0 { Cone::ALL } else { Cone { axis, cosine, sine } })
    }

    /// Takes its part of what is left of a bundle's directions.
    #[inline(always)]
    pub(super) fn take(
        &self,
        directions: &[Lanes; 3],
        gain: &Lanes,
        through: &mut [Lanes],
        taken: &mut [Lanes],
    ) {
        for i in 0..LANES {
            let [x, y, z] = [directions[0][i], directions[1][i], directions[2][i]];
            let (through, taken) = (&mut through[i], &mut taken[i]);
            for lane in 0..LANES {
                let cosine = x * self.towards[0][lane]
                    + y * self.towards[1][lane]
                    + z * self.towards[2][lane];
                let covered = (cosine - self.begin[lane]) * self.slope[lane];
                let whole = self.height[lane];
                let covered = if covered < whole { covered } else { whole };
                let covered = if covered > 0.0 { covered } else { 0.0 };
                let own = covered * through[lane];
                through[lane] -= own;
                taken[lane] += gain[lane] * own;
            }
        }
    }
}

/// Directions about an axis.
pub(super) struct Cone {
    axis: Vec3,
    /// Of the half-angle.
    cosine: f32,
    sine: f32,
}

/// Cones around [`LANES`] bundles, by axis.
#[derive(Debug, Clone)]
pub(super) struct Cones {
    pub(super) axis: [Lanes; 3],
    pub(super) cosine: Lanes,
    pub(super) sine: Lanes,
}

impl Cone {
    const ALL: Self = Self { axis: Vec3::ZERO, cosine: -1.0, sine: 0.0 };

    /// Which of the cones it may meet, as bits.
    #[inline(always)]
    pub(super) fn meets(&self, cones: &Cones) -> u32 {
        // Rounding must not pass over what a closer look would count.
        let slack = 1e-4;
        let mut mask = 0;
        for i in 0..LANES {
            let apart = self.axis.x * cones.axis[0][i]
                + self.axis.y * cones.axis[1][i]
                + self.axis.z * cones.axis[2][i];
            let cosine = self.cosine * cones.cosine[i] - self.sine * cones.sine[i];
            let sine = self.sine * cones.cosine[i] + self.cosine * cones.sine[i];
            mask |= u32::from(apart >= cosine - slack || sine <= slack) << i;
        }
        mask
    }
}

/// The directions in the space where an ellipsoid is the unit ball.
#[derive(Debug, Clone)]
pub struct SeenThrough {
    pub(super) ellipsoid: Ellipsoid,
    /// `[bundle]`: Mω/|Mω|, by axis.
    pub(super) directions: Vec<[Lanes; 3]>,
    /// `[bundle / LANES]`
    pub(super) cones: Vec<Cones>,
}

impl SeenThrough {
    /// The ellipsoid.
    #[must_use]
    pub fn ellipsoid(&self) -> &Ellipsoid {
        &self.ellipsoid
    }
}

impl Default for SeenThrough {
    fn default() -> Self {
        let ellipsoid = Ellipsoid { centre: Vec3::ZERO, shape: Mat3::IDENTITY, radius: 1.0 };
        Self { ellipsoid, directions: Vec::new(), cones: Vec::new() }
    }
}

/// The mean of directions and the least cosine to it.
#[inline(always)]
pub(super) fn enclosing([x, y, z]: &[Lanes; 3]) -> (Vec3, f32) {
    let sum = Vec3::new(total(x), total(y), total(z));
    let Some(axis) = sum.try_normalize() else { return (Vec3::ZERO, -1.0) };
    let mut cosines = [0.0; LANES];
    for i in 0..LANES {
        cosines[i] = axis.x * x[i] + axis.y * y[i] + axis.z * z[i];
    }
    (axis, least(&cosines).min(1.0))
}

/// The sum, by halves, which are vectors.
#[inline(always)]
fn total(lanes: &Lanes) -> f32 {
    let mut sums = *lanes;
    let mut width = LANES / 2;
    while width > 0 {
        for i in 0..width {
            sums[i] += sums[i + width];
        }
        width /= 2;
    }
    sums[0]
}

/// The least, likewise.
#[inline(always)]
fn least(lanes: &Lanes) -> f32 {
    let mut least = *lanes;
    let mut width = LANES / 2;
    while width > 0 {
        for i in 0..width {
            least[i] = if least[i] < least[i + width] { least[i] } else { least[i + width] };
        }
        width /= 2;
    }
    least[0]
}
