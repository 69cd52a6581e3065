//! What one sphere blocks at a point: a cap of directions, in closed forms that vectorise.
//!
//! A sphere of radius r at distance d fills the cap of half-angle α, s = sin α = min(r/d, 1), about
//! the direction ω to its centre; c = n·ω. Every function takes [`LANES`] points at once, in plain
//! arrays that the compiler turns into vectors.

use glam::Mat3;

use crate::sh::{MAX_BANDS, Order};

/// Points that are looked at together.
pub const LANES: usize = 16;

/// One number of each of [`LANES`] points.
pub type Lanes = [f32; LANES];

/// Vectors, by axis, in turned axes.
#[inline(always)]
#[must_use]
pub fn rotate(turn: &Mat3, [x, y, z]: &[Lanes; 3]) -> [Lanes; 3] {
    let [mx, my, mz] = [turn.x_axis, turn.y_axis, turn.z_axis];
    let (mut a, mut b, mut c) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        a[i] = mx.x * x[i] + my.x * y[i] + mz.x * z[i];
        b[i] = mx.y * x[i] + my.y * y[i] + mz.y * z[i];
        c[i] = mx.z * x[i] + my.z * y[i] + mz.z * z[i];
    }
    [a, b, c]
}

/// The square of a distance, in units of the square of a radius, below which a point counts as at
/// the centre: keeps directions finite.
const CENTRE: f32 = 1e-8;

/// How [`LANES`] points see one sphere.
#[derive(Debug, Clone, Copy)]
pub struct View {
    /// Unit direction to the centre, by axis.
    pub direction: [Lanes; 3],
    /// s, the sine of the cap's half-angle.
    pub sine: Lanes,
    /// c, the cosine between normal and direction.
    pub cosine: Lanes,
}

/// Adds gain · [`View::occlusion`] of a sphere (centre and radius) to the sums, in one pass that
/// keeps everything in registers: where only the scalar is asked for.
#[inline(always)]
pub fn add_occlusion(
    position: &[Lanes; 3],
    normal: &[Lanes; 3],
    (centre, radius): ([f32; 3], f32),
    gain: &Lanes,
    sums: &mut Lanes,
) {
    let least = CENTRE * radius * radius;
    for i in 0..LANES {
        let [x, y, z] = [0, 1, 2].map(|axis| centre[axis] - position[axis][i]);
        let along = x * normal[0][i] + y * normal[1][i] + z * normal[2][i];
        let inverse = 1.0 / (x * x + y * y + z * z + least).sqrt();
        let (s, c) = (radius * inverse, along * inverse);
        // Comparisons rather than `min` and `max`, whose care for NaN takes three instructions.
        let s = if s < 1.0 { s } else { 1.0 };
        let soft = if c + s > 0.0 { c + s } else { 0.0 };
        let soft = if soft < 2.0 * s { soft } else { 2.0 * s };
        let above = if c > s { c - s } else { 0.0 };
        sums[i] += gain[i] * (s * (0.25 * soft * soft + s * above));
    }
}

impl View {
    /// `position` and `normal` by axis. `None` where the sphere is below the horizon of all points
    /// (c + s ≤ 0), so that it blocks nothing: found out before any root is taken.
    #[inline(always)]
    #[must_use]
    pub fn new(
        position: &[Lanes; 3],
        normal: &[Lanes; 3],
        centre: [f32; 3],
        radius: f32,
    ) -> Option<Self> {
        let mut view =
            Self { direction: [[0.0; LANES]; 3], sine: [0.0; LANES], cosine: [0.0; LANES] };
        for axis in 0..3 {
            for i in 0..LANES {
                let d = centre[axis] - position[axis][i];
                view.direction[axis][i] = d;
                view.cosine[i] += d * normal[axis][i];
            }
        }
        let highest = view.cosine.iter().fold(f32::NEG_INFINITY, |most, &x| most.max(x));
        if highest <= -radius {
            return None;
        }
        let least = CENTRE * radius * radius;
        let [x, y, z] = &mut view.direction;
        for i in 0..LANES {
            let square = x[i] * x[i] + y[i] * y[i] + z[i] * z[i] + least;
            let inverse = 1.0 / square.sqrt();
            (x[i], y[i], z[i]) = (x[i] * inverse, y[i] * inverse, z[i] * inverse);
            view.sine[i] = (radius * inverse).min(1.0);
            view.cosine[i] *= inverse;
        }
        Some(view)
    }

    /// (1/π) ∫_cap (n·ω)₊ dω: s²c above the horizon, 0 below it, and where the cap meets the
    /// horizon (|c| < s) the parabola s(c + s)²/4 that joins the two with equal slopes. Exact away
    /// from the horizon.
    #[inline(always)]
    #[must_use]
    pub fn occlusion(&self) -> Lanes {
        std::array::from_fn(|i| {
            let (s, c) = (self.sine[i], self.cosine[i]);
            let soft = (c + s).clamp(0.0, 2.0 * s);
            s * (0.25 * soft * soft + s * (c - s).max(0.0))
        })
    }

    /// The share of the cap that stands above the horizon, by its height: (c + s)/2s in \[0, 1\].
    #[inline(always)]
    #[must_use]
    pub fn above(&self) -> Lanes {
        std::array::from_fn(|i| {
            let (s, c) = (self.sine[i], self.cosine[i]);
            ((c + s) / (2.0 * s)).clamp(0.0, 1.0)
        })
    }

    /// Per band, what a cap's coefficients have before y_lm(ω): 2π/(2l+1)·(P_{l−1} − P_{l+1})(cos α),
    /// so that ∫_cap y_lm = that · y_lm(ω); band 0 is the solid angle 2π(1 − cos α).
    #[inline(always)]
    pub fn bands(&self, order: Order, out: &mut [Lanes; MAX_BANDS]) {
        let bands = order.bands();
        for i in 0..LANES {
            let x = (1.0 - self.sine[i] * self.sine[i]).max(0.0).sqrt();
            // P_{-1} = 1 makes the formula hold for l = 0.
            let (mut before, mut now) = (1.0, 1.0);
            for (l, out) in out.iter_mut().enumerate().take(bands) {
                let lf = l as f32;
                let next = if l == 0 {
                    x
                } else {
                    ((2.0 * lf + 1.0) * x * now - lf * before) / (lf + 1.0)
                };
                out[i] = 2.0 * std::f32::consts::PI / (2.0 * lf + 1.0) * (before - next);
                (before, now) = (now, next);
            }
        }
    }
}
