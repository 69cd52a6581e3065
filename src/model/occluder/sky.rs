//! What ellipsoids block together: their union, looked at in fixed directions.
//!
//! Sums of caps count twice where one ellipsoid hides behind another, and no weight can mend it,
//! since what hides changes with the pose. Here each direction is blocked at most once: the
//! ellipsoids take, one after another, what those before have left of it.
//!
//! An ellipsoid is |M (x − c)| ≤ 1 with a symmetric M. In the space that M makes, it is the unit ball
//! and fills a cap: with p = M (c − x), s = min(1/|p|, 1), κ = √(1 − s²), u = Mω/|Mω| for a direction
//! ω, and σ = 6.4 / N for N directions,
//! covered(ω) = h · clamp((p·u/|p| − e)/σ + ½, 0, 1), e = min(κ, 1 − σ/2), h = min(1, 2(1 − κ)/σ):
//! a cap with an edge as wide as the directions are apart, and of the cap's own solid angle. An
//! ellipsoid whose ball is below a point's horizon blocks nothing there.

mod through;

use glam::{Mat3, Vec3};

use super::caps::{LANES, Lanes};
use through::{Caps, Cones, enclosing};
pub use through::{Ellipsoid, SeenThrough};

use crate::model::Signal;
use crate::sh::{MAX_COEFFICIENTS, Order};

/// Width of a cap's edge in its cosine, times the number of directions: about 1.6 of their
/// distances (4π/N each) for a cap of middling size.
const SOFTNESS: f32 = 6.4;
/// Height above the horizon, as a cosine, below which `visibility` counts by its share.
const HORIZON: f32 = 0.1;

/// Directions that lie together.
#[derive(Debug, Clone)]
struct Bundle {
    /// By axis.
    directions: [Lanes; 3],
}

/// The directions of a model, and what is seen of the signal in each.
#[derive(Debug, Clone)]
pub struct Sky {
    kind: (Signal, Order),
    bundles: Vec<Bundle>,
    /// `[direction, coefficient]`: what a direction adds per unit of share.
    basis: Vec<[f32; MAX_COEFFICIENTS]>,
    softness: f32,
}

/// What is left of every direction for [`LANES`] points that are looked at together.
#[derive(Debug, Clone)]
pub struct View {
    /// `[direction]`: how much it counts, 0 below the horizon.
    share: Vec<Lanes>,
    /// `[direction]`: what no ellipsoid has taken yet.
    through: Vec<Lanes>,
    /// `[bundle]`: whether any of it is above the horizon of any point.
    above: Vec<bool>,
}

impl Sky {
    /// `count` directions, a multiple of [`LANES`]: those of a Fibonacci lattice, zᵢ = 1 − (2i+1)/N
    /// at azimuth π(1 + √5)(i + ½).
    #[must_use]
    pub fn new(count: usize, kind: (Signal, Order)) -> Self {
        let mut directions: Vec<Vec3> = (0..count).map(|i| lattice(i, count)).collect();
        gather(&mut directions);
        let solid_angle = 4.0 * std::f32::consts::PI / count as f32;
        let basis = directions.iter().map(|&direction| {
            let mut y = [0.0; MAX_COEFFICIENTS];
            if kind.0 == Signal::Ao {
                y[0] = 1.0;
            } else {
                crate::sh::evaluate(kind.1, direction, &mut y[..kind.1.coefficients()]);
            }
            // Both ∫ f·(n·ω)₊/π dω.
            let scale = match kind.0 {
                Signal::Ao | Signal::Transfer => solid_angle / std::f32::consts::PI,
                Signal::Visibility => solid_angle,
            };
            y.map(|y| y * scale)
        });
        let basis = basis.collect();
        let bundles = directions.chunks_exact(LANES).map(Bundle::new).collect();
        Self { kind, bundles, basis, softness: SOFTNESS / count as f32 }
    }

    /// How many bundles of [`LANES`] directions.
    #[must_use]
    pub fn bundles(&self) -> usize {
        self.bundles.len()
    }

    /// How many directions.
    #[must_use]
    pub fn directions(&self) -> usize {
        self.basis.len()
    }

    /// Numbers per channel of a point.
    #[must_use]
    pub fn coefficients(&self) -> usize {
        self.kind.0.coefficients(self.kind.1)
    }

    /// For [`look`](Self::look).
    #[must_use]
    pub fn view(&self) -> View {
        let zero = vec![[0.0; LANES]; self.directions()];
        View { share: zero.clone(), through: zero, above: vec![false; self.bundles.len()] }
    }

    /// Begins with points of these normals, by axis, from which nothing is blocked yet.
    #[inline(always)]
    pub fn look(&self, normal: &[Lanes; 3], view: &mut View) {
        view.through.fill([1.0; LANES]);
        let is_visibility = self.kind.0 == Signal::Visibility;
        for ((bundle, above), shares) in
            self.bundles.iter().zip(&mut view.above).zip(view.share.chunks_exact_mut(LANES))
        {
            let mut most = [0.0_f32; LANES];
            for (i, share) in shares.iter_mut().enumerate() {
                let [dx, dy, dz] = &bundle.directions;
                let (x, y, z) = (dx[i], dy[i], dz[i]);
                for lane in 0..LANES {
                    let c = x * normal[0][lane] + y * normal[1][lane] + z * normal[2][lane];
                    let c = if c > 0.0 { c } else { 0.0 };
                    let whole = if c < HORIZON { c / HORIZON } else { 1.0 };
                    share[lane] = if is_visibility { whole } else { c };
                    most[lane] = if c > most[lane] { c } else { most[lane] };
                }
            }
            *above = most.iter().any(|&c| c > 0.0);
        }
    }

    /// Looks at the directions through an ellipsoid.
    #[inline(always)]
    pub fn see_through(&self, ellipsoid: &Ellipsoid, seen: &mut SeenThrough) {
        seen.ellipsoid = *ellipsoid;
        seen.directions.clear();
        seen.cones.clear();
        for bundles in self.bundles.chunks(LANES) {
            // Beyond the last bundle a cone that meets nothing.
            let mut cones =
                Cones { axis: [[0.0; LANES]; 3], cosine: [1.0; LANES], sine: [0.0; LANES] };
            for (i, bundle) in bundles.iter().enumerate() {
                let turned = bundle.through(&ellipsoid.shape);
                let (axis, cosine) = enclosing(&turned);
                for k in 0..3 {
                    cones.axis[k][i] = axis[k];
                }
                cones.cosine[i] = cosine;
                cones.sine[i] = (1.0 - cosine * cosine).max(0.0).sqrt();
                seen.directions.push(turned);
            }
            seen.cones.push(cones);
        }
    }

    /// Adds to `taken` `[direction]`, by weight, what an ellipsoid takes of the directions from points
    /// given by position and normal, and marks in `touched` `[bundle]` where.
    #[inline(always)]
    pub fn block(
        &self,
        (position, normal): (&[Lanes; 3], &[Lanes; 3]),
        seen: &SeenThrough,
        gain: &Lanes,
        view: &mut View,
        (taken, touched): (&mut [Lanes], &mut [bool]),
    ) {
        let caps = Caps::new(position, normal, &seen.ellipsoid, self.softness);
        let Some(cone) = caps.cone() else { return };
        for (block, cones) in seen.cones.iter().enumerate() {
            let mut mask = cone.meets(cones);
            while mask != 0 {
                let bundle = block * LANES + mask.trailing_zeros() as usize;
                mask &= mask - 1;
                // Also false beyond the last bundle.
                if !view.above.get(bundle).is_some_and(|&above| above) {
                    continue;
                }
                touched[bundle] = true;
                let first = bundle * LANES;
                let through = &mut view.through[first..first + LANES];
                let taken = &mut taken[first..first + LANES];
                caps.take(&seen.directions[bundle], gain, through, taken);
            }
        }
    }

    /// Adds what a bundle's directions bring of the signal to `sums` `[coefficient]`, by how much of
    /// them has been taken, `[direction]`.
    #[inline(always)]
    pub fn add(&self, view: &View, bundle: usize, taken: &[Lanes], sums: &mut [Lanes]) {
        let directions = bundle * LANES..(bundle + 1) * LANES;
        for direction in directions {
            let (share, taken) = (&view.share[direction], &taken[direction]);
            let mut blocked = [0.0; LANES];
            for lane in 0..LANES {
                blocked[lane] = share[lane] * taken[lane];
            }
            for (sum, y) in sums.iter_mut().zip(&self.basis[direction]) {
                for lane in 0..LANES {
                    sum[lane] += y * blocked[lane];
                }
            }
        }
    }
}

impl Bundle {
    fn new(directions: &[Vec3]) -> Self {
        let by_axis = [0, 1, 2].map(|axis| std::array::from_fn(|i| directions[i][axis]));
        Self { directions: by_axis }
    }

    /// u = Mω/|Mω| of each direction.
    #[inline(always)]
    fn through(&self, shape: &Mat3) -> [Lanes; 3] {
        let [mx, my, mz] = [shape.x_axis, shape.y_axis, shape.z_axis];
        let [dx, dy, dz] = &self.directions;
        let (mut ux, mut uy, mut uz) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let (x, y, z) = (dx[i], dy[i], dz[i]);
            let a = mx.x * x + my.x * y + mz.x * z;
            let b = mx.y * x + my.y * y + mz.y * z;
            let c = mx.z * x + my.z * y + mz.z * z;
            let inverse = 1.0 / (a * a + b * b + c * c).sqrt();
            (ux[i], uy[i], uz[i]) = (a * inverse, b * inverse, c * inverse);
        }
        [ux, uy, uz]
    }
}

fn lattice(i: usize, count: usize) -> Vec3 {
    let i = i as f64 + 0.5;
    let z = 1.0 - 2.0 * i / count as f64;
    let azimuth = std::f64::consts::PI * (1.0 + 5.0_f64.sqrt()) * i;
    let radius = (1.0 - z * z).sqrt();
    Vec3::new((radius * azimuth.cos()) as f32, (radius * azimuth.sin()) as f32, z as f32)
}

/// Orders directions so that every [`LANES`] of them lie together: halves them across the axis
/// along which they extend farthest.
fn gather(directions: &mut [Vec3]) {
    let bundles = directions.len() / LANES;
    if bundles < 2 {
        return;
    }
    let (low, high) = directions
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &d| (low.min(d), high.max(d)));
    let axis = (high - low).max_position();
    directions.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
    let (a, b) = directions.split_at_mut(bundles / 2 * LANES);
    gather(a);
    gather(b);
}

#[cfg(test)]
mod tests;
