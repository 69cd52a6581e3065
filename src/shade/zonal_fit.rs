//! A light as a few lobes that are symmetric about an axis each, which turn for the price of an
//! evaluation: light in every vertex's tangent frame without rotating full harmonics (RPO09 §5.4).
//!
//! A lobe about d with one number z_l a band has the coefficients z_l Y_l(d), Y_l(d) being the y_lm(d)
//! of a band. Inner products of such vectors are (2l+1)/4π · P_l(d·e), so once the axes are known the
//! numbers of all lobes are a small least-squares problem in each band and colour, solved in closed
//! form; only the axes are searched for.

use std::f64::consts::PI;

use glam::{DQuat, DVec3, Mat3};

use super::ShLight;
use crate::num::lbfgs;
use crate::sh::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate, evaluate_f64};

/// Directions among which the first guess of a lobe's axis is searched (RPO09 §5.4).
const CANDIDATES: u32 = 1500;

/// The most lobes.
pub const MOST_LOBES: usize = 8;

/// Steps of the search for axes after each added lobe.
const STEPS: usize = 60;

/// Half the step of the difference quotients by which axes are moved, radians.
const NUDGE: f64 = 1e-5;

/// The share of its diagonal that is added to a Gram matrix, so that lobes which fall on one
/// another share their weight instead of cancelling.
const RIDGE: f64 = 1e-9;

/// The share of a light's energy below which nothing is left to fit: what the ridge leaves.
const SETTLED: f64 = 1e-15;

/// One lobe.
#[derive(Debug, Clone, PartialEq)]
pub struct Lobe {
    /// The unit axis.
    pub axis: [f64; 3],
    /// `[colour][band]`: the multiple of the y_lm(axis) of that band.
    pub bands: [[f64; MAX_BANDS]; 3],
}

/// A light as a sum of lobes.
#[derive(Debug, Clone, PartialEq)]
pub struct ZonalLight {
    order: Order,
    lobes: Vec<Lobe>,
    residuals: Vec<f64>,
}

impl ZonalLight {
    /// Fits `lobes` lobes (at most [`MOST_LOBES`]) one after the other: each starts at the candidate
    /// direction that takes most from what is left (eq. 15), then the axes of all lobes so far are
    /// refined together by L-BFGS. Fewer come back where nothing is left. Deterministic.
    #[must_use]
    pub fn fit(light: &ShLight, lobes: usize) -> Self {
        let order = light.order();
        let energy = energy(light);
        let mut this = Self { order, lobes: Vec::new(), residuals: Vec::new() };
        let mut left = light.clone();
        for _ in 0..lobes.min(MOST_LOBES) {
            if energy == 0.0 || self::energy(&left) <= SETTLED * energy {
                break;
            }
            let mut axes: Vec<[f64; 3]> = this.lobes.iter().map(|lobe| lobe.axis).collect();
            axes.push(best_candidate(&left));
            this.lobes = refine(light, &axes);
            left = light.clone();
            left.subtract(&this.expand());
            this.residuals.push(self::energy(&left) / energy);
        }
        this
    }

    /// The order.
    #[must_use]
    pub fn order(&self) -> Order {
        self.order
    }

    /// The lobes.
    #[must_use]
    pub fn lobes(&self) -> &[Lobe] {
        &self.lobes
    }

    /// ‖l − fit‖² / ‖l‖² over all colours, after the first lobe, after the second, and so on.
    #[must_use]
    pub fn residuals(&self) -> &[f64] {
        &self.residuals
    }

    /// The full coefficients of the sum.
    #[must_use]
    pub fn expand(&self) -> ShLight {
        let mut light = ShLight::black(self.order).into_colours();
        let mut y = [0.0; MAX_COEFFICIENTS];
        for lobe in &self.lobes {
            evaluate_f64(self.order, lobe.axis, &mut y);
            for (colour, bands) in light.iter_mut().zip(&lobe.bands) {
                for (i, value) in colour.iter_mut().enumerate() {
                    *value += bands[i.isqrt()] * y[i];
                }
            }
        }
        ShLight::from_coefficients(self.order, light)
    }

    /// The lobes turned with their light.
    #[must_use]
    pub fn rotated(&self, rotation: DQuat) -> Self {
        let mut this = self.clone();
        for lobe in &mut this.lobes {
            lobe.axis = (rotation * DVec3::from(lobe.axis)).to_array();
        }
        this
    }

    /// The light's coefficients in a frame, `[colour][coefficient]`: `to_local` takes directions of
    /// the scene to it. n² evaluations a lobe, no rotation of harmonics.
    ///
    /// # Panics
    /// If a slice is shorter than n².
    pub fn in_frame(&self, to_local: Mat3, out: [&mut [f32]; 3]) {
        let count = self.order.coefficients();
        let mut out = out.map(|colour| &mut colour[..count]);
        out.iter_mut().for_each(|colour| colour.fill(0.0));
        let mut y = [0.0; MAX_COEFFICIENTS];
        for lobe in &self.lobes {
            let axis = to_local * glam::Vec3::from(lobe.axis.map(|x| x as f32));
            evaluate(self.order, axis, &mut y);
            for (colour, bands) in out.iter_mut().zip(&lobe.bands) {
                for (l, z) in bands.iter().enumerate().take(self.order.bands()) {
                    for i in l * l..(l + 1) * (l + 1) {
                        colour[i] += *z as f32 * y[i];
                    }
                }
            }
        }
    }
}

/// ‖l‖² over all colours.
fn energy(light: &ShLight) -> f64 {
    light.colours().iter().flatten().map(|value| value * value).sum()
}

/// The direction whose lobe takes most energy: Σ 4π/(2l+1) (Y_l(d)·l_l)².
fn best_candidate(light: &ShLight) -> [f64; 3] {
    let golden = PI * (3.0 - 5_f64.sqrt());
    let half = f64::from(CANDIDATES) / 2.0;
    let mut best = (f64::NEG_INFINITY, [0.0, 0.0, 1.0]);
    for i in 0..CANDIDATES {
        let z = 1.0 - (f64::from(i) + 0.5) / half;
        let (r, angle) = ((1.0 - z * z).sqrt(), golden * f64::from(i));
        let direction = [r * angle.cos(), r * angle.sin(), z];
        let projections = projections(light, direction);
        let taken = projections.iter().flat_map(|bands| bands.iter().enumerate());
        let taken: f64 = taken.map(|(l, b)| 4.0 * PI / (2 * l + 1) as f64 * b * b).sum();
        if taken > best.0 {
            best = (taken, direction);
        }
    }
    best.1
}

/// Y_l(d)·l_l by colour and band: the light's own value there, band by band.
fn projections(light: &ShLight, direction: [f64; 3]) -> [[f64; MAX_BANDS]; 3] {
    let mut y = [0.0; MAX_COEFFICIENTS];
    evaluate_f64(light.order(), direction, &mut y);
    light.colours().each_ref().map(|colour| {
        let mut bands = [0.0; MAX_BANDS];
        for (i, (value, y)) in colour.iter().zip(&y).enumerate() {
            bands[i.isqrt()] += value * y;
        }
        bands
    })
}

/// Moves the axes until what is left is least, and gives the lobes.
fn refine(light: &ShLight, start: &[[f64; 3]]) -> Vec<Lobe> {
    // The search moves each axis in its own tangent plane, so there is no length to waste.
    let frames: Vec<[[f64; 3]; 3]> = start.iter().map(|&axis| frame(axis)).collect();
    let scale = 1.0 / energy(light);
    let axes = |x: &[f64]| -> Vec<[f64; 3]> {
        frames.iter().zip(x.chunks_exact(2)).map(|(frame, x)| moved(frame, x[0], x[1])).collect()
    };
    let minimum = lbfgs::minimise(vec![0.0; 2 * start.len()], STEPS, |x, gradient| {
        let axes = axes(x);
        let lobes = solve(light, &axes);
        let mut left = light.clone();
        left.subtract(
            &ZonalLight { order: light.order(), lobes: lobes.clone(), residuals: vec![] }.expand(),
        );
        for (k, lobe) in lobes.iter().enumerate() {
            for side in 0..2 {
                // The numbers are optimal, so only the axis' own movement counts.
                let along = |nudge: f64| {
                    let mut at = [x[2 * k], x[2 * k + 1]];
                    at[side] += nudge;
                    weighed(&left, moved(&frames[k], at[0], at[1]), lobe)
                };
                gradient[2 * k + side] =
                    -2.0 * scale * (along(NUDGE) - along(-NUDGE)) / (2.0 * NUDGE);
            }
        }
        scale * energy(&left)
    });
    solve(light, &axes(&minimum.x))
}

/// Σ z_l (Y_l(d)·r_l) of a lobe's numbers and what is left.
fn weighed(left: &ShLight, direction: [f64; 3], lobe: &Lobe) -> f64 {
    let projections = projections(left, direction);
    projections.iter().flatten().zip(lobe.bands.iter().flatten()).map(|(b, z)| b * z).sum()
}

/// An axis and two directions at right angles to it and to one another.
fn frame([x, y, z]: [f64; 3]) -> [[f64; 3]; 3] {
    let axis = DVec3::new(x, y, z);
    let (a, b) = axis.any_orthonormal_pair();
    [axis, a, b].map(|v| v.to_array())
}

/// The axis moved by (u, v) in its tangent plane, unit.
fn moved([axis, a, b]: &[[f64; 3]; 3], u: f64, v: f64) -> [f64; 3] {
    let length = (1.0 + u * u + v * v).sqrt();
    std::array::from_fn(|i| (axis[i] + u * a[i] + v * b[i]) / length)
}

/// The best numbers of lobes about given axes: G z = b in each band and colour, with
/// G_jk = (2l+1)/4π · P_l(d_j·d_k) and b_j = Y_l(d_j)·l_l.
fn solve(light: &ShLight, axes: &[[f64; 3]]) -> Vec<Lobe> {
    let count = axes.len();
    let mut lobes: Vec<Lobe> =
        axes.iter().map(|&axis| Lobe { axis, bands: [[0.0; MAX_BANDS]; 3] }).collect();
    let right: Vec<[[f64; MAX_BANDS]; 3]> =
        axes.iter().map(|&axis| projections(light, axis)).collect();
    let legendre: Vec<[f64; MAX_BANDS]> = (0..count * count)
        .map(|jk| {
            let (a, b) = (axes[jk / count], axes[jk % count]);
            legendre(a.iter().zip(b).map(|(a, b)| a * b).sum())
        })
        .collect();
    for l in 0..light.order().bands() {
        let scale = (2 * l + 1) as f64 / (4.0 * PI);
        let mut gram: Vec<f64> = legendre.iter().map(|p| scale * p[l]).collect();
        (0..count).for_each(|k| gram[k * count + k] *= 1.0 + RIDGE);
        factor(&mut gram, count);
        for c in 0..3 {
            let mut z: Vec<f64> = right.iter().map(|right| right[c][l]).collect();
            substitute(&gram, &mut z);
            lobes.iter_mut().zip(z).for_each(|(lobe, z)| lobe.bands[c][l] = z);
        }
    }
    lobes
}

/// P_0(t) … P_9(t).
fn legendre(t: f64) -> [f64; MAX_BANDS] {
    let mut p = [1.0; MAX_BANDS];
    p[1] = t;
    for l in 2..MAX_BANDS {
        let n = l as f64;
        p[l] = ((2.0 * n - 1.0) * t * p[l - 1] - (n - 1.0) * p[l - 2]) / n;
    }
    p
}

/// Cholesky's lower factor of a symmetric positive matrix, in place. A pivot that rounding has
/// made nothing of leaves its row out.
fn factor(matrix: &mut [f64], count: usize) {
    for i in 0..count {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| matrix[i * count + k] * matrix[j * count + k]).sum();
            let rest = matrix[i * count + j] - dot;
            matrix[i * count + j] = if i == j {
                rest.max(0.0).sqrt()
            } else if matrix[j * count + j] > 0.0 {
                rest / matrix[j * count + j]
            } else {
                0.0
            };
        }
    }
}

/// Solves L Lᵀ x = b in place.
fn substitute(lower: &[f64], x: &mut [f64]) {
    let count = x.len();
    let divided = |value: f64, pivot: f64| if pivot > 0.0 { value / pivot } else { 0.0 };
    for i in 0..count {
        let dot: f64 = (0..i).map(|k| lower[i * count + k] * x[k]).sum();
        x[i] = divided(x[i] - dot, lower[i * count + i]);
    }
    for i in (0..count).rev() {
        let dot: f64 = (i + 1..count).map(|k| lower[k * count + i] * x[k]).sum();
        x[i] = divided(x[i] - dot, lower[i * count + i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(bands: u8) -> Order {
        Order::new(bands).unwrap()
    }

    /// A light of three lamps of different widths and colours is found again as three lobes; the
    /// residual falls with every lobe, and is that of the expanded sum.
    #[test]
    fn lamps_are_found_again() {
        let n = order(4);
        let lamps = [
            ([0.0, 1.0, 0.0], 0.3, [20.0, 18.0, 15.0]),
            ([0.8, 0.1, 0.6], 0.6, [2.0, 0.5, 0.1]),
            ([-0.7, 0.2, -0.7], 0.9, [0.2, 0.6, 1.2]),
        ];
        let mut light = ShLight::black(n);
        for (axis, half_angle, colour) in lamps {
            light.add(&ShLight::cone(n, axis, half_angle, colour).unwrap());
        }
        let three = ZonalLight::fit(&light, 3);
        let eight = ZonalLight::fit(&light, 8);
        let residuals = eight.residuals();
        assert!(residuals.windows(2).all(|pair| pair[1] <= pair[0] + 1e-12), "{residuals:?}");
        assert!(residuals[2] < 1e-8, "{residuals:?}");
        for (axis, _, _) in lamps {
            let axis = super::super::light::unit(axis).unwrap();
            // A lobe about −d with the odd bands turned over is the same.
            let along =
                |lobe: &Lobe| lobe.axis.iter().zip(axis).map(|(a, b)| a * b).sum::<f64>().abs();
            let nearest = three.lobes().iter().map(along).fold(-1.0, f64::max);
            assert!(nearest > 0.9999, "{axis:?}: {nearest}");
        }
        let mut left = light.clone();
        left.subtract(&three.expand());
        let expected = energy(&left) / energy(&light);
        assert!((three.residuals()[2] - expected).abs() < 1e-15);
        assert_eq!(three, ZonalLight::fit(&light, 3));
    }

    /// The single lobe of a candidate axis is eq. 15: no other numbers along that axis leave less.
    #[test]
    fn numbers_are_the_best_along_their_axis() {
        let n = order(5);
        let mut light = ShLight::cone(n, [0.3, 0.5, -0.2], 0.5, [1.0, 2.0, 3.0]).unwrap();
        light.add(&ShLight::directional(n, [1.0, 0.0, 0.0], [0.5, 0.1, 0.2]).unwrap());
        let axis = [0.6, 0.64, 0.48];
        let lobes = solve(&light, &[axis]);
        let mut y = [0.0; 25];
        evaluate_f64(n, axis, &mut y);
        for (c, colour) in light.colours().iter().enumerate() {
            for l in 0..5 {
                let band = l * l..(l + 1) * (l + 1);
                let over: f64 = band.clone().map(|i| y[i] * colour[i]).sum();
                let under: f64 = band.map(|i| y[i] * y[i]).sum();
                assert!((lobes[0].bands[c][l] - over / under).abs() < 1e-8, "{c} {l}");
            }
        }
    }

    /// In any frame the lobes give what rotating the full coefficients gives.
    #[test]
    fn frames_need_no_rotation_of_harmonics() {
        let n = order(6);
        let mut light = ShLight::cone(n, [0.3, 0.5, -0.2], 0.5, [1.0, 2.0, 3.0]).unwrap();
        light.add(&ShLight::cone(n, [-1.0, 0.4, 0.1], 0.2, [5.0, 0.0, 1.0]).unwrap());
        let fit = ZonalLight::fit(&light, 3);
        let q = glam::Quat::from_xyzw(0.2, -0.5, 0.3, 0.7).normalize();
        let expected = fit.expand().rotated(q.as_dquat());
        let mut out = [[0.0_f32; 36]; 3];
        let [r, g, b] = &mut out;
        fit.in_frame(Mat3::from_quat(q), [r, g, b]);
        for (found, expected) in out.iter().flatten().zip(expected.colours().iter().flatten()) {
            assert!((f64::from(*found) - expected).abs() < 3e-5, "{found} {expected}");
        }
    }

    /// No light has no lobes; a constant one is one lobe without residual; lobes that fall on one
    /// another stay finite.
    #[test]
    fn plain_lights_need_few_lobes() {
        assert!(ZonalLight::fit(&ShLight::black(order(4)), 3).lobes().is_empty());
        let even = ShLight::constant(order(4), [1.0, 2.0, 3.0]).unwrap();
        let fit = ZonalLight::fit(&even, 5);
        assert!(fit.residuals()[0] < 1e-16 && fit.lobes().len() <= 2, "{fit:?}");
        let twice = solve(&even, &[[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
        assert!(twice.iter().flat_map(|lobe| lobe.bands.iter().flatten()).all(|z| z.is_finite()));
    }
}
