//! Height fields: visibility from the horizon in every direction (Snyder and Nowrouzezahrai 2008;
//! RPO09 eqs. 4 and 5).
//!
//! The frame is the field's own: +X along columns, +Y along rows, +Z up. From a point with normal
//! n, what blocks at an azimuth is what lies between the tangent plane and the horizon there. A
//! wedge of azimuths with one horizon is a product of an integral over φ, known in closed form, and
//! one over z, tabulated; so turning a wedge about the vertical costs nothing.

use std::f32::consts::TAU;

use super::Error;
use crate::sh::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate_f64, gauss_legendre};

/// Steps of the table over z from −1 to 1.
const STEPS: usize = 512;

/// The most azimuths.
pub const MOST_AZIMUTHS: usize = 256;

/// The most samples of a field.
const MOST_SAMPLES: usize = 1 << 26;

/// Heights on a square grid with a pyramid of means over 2 × 2, 4 × 4, … samples.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightField {
    cell_m: f32,
    /// Finest first: width, height, heights row by row.
    levels: Vec<(usize, usize, Vec<f32>)>,
}

impl HeightField {
    /// A field of `width` · `height` heights in metres, row by row, `cell_m` metres apart. A single
    /// sample is a plane. Beyond its edge a field goes on level with its edge.
    ///
    /// # Errors
    /// [`Error::Heights`] for a size that does not fit, too many samples, a cell without length, or
    /// heights that are not finite.
    pub fn new(width: usize, height: usize, cell_m: f32, heights: &[f32]) -> Result<Self, Error> {
        let count = heights.len();
        let bad = heights.iter().filter(|h| !h.is_finite()).count();
        let fits = count > 0 && count <= MOST_SAMPLES && width.checked_mul(height) == Some(count);
        if !fits || bad > 0 || !(cell_m.is_finite() && cell_m > 0.0) {
            return Err(Error::Heights { width, height, found: count, bad, cell_m });
        }
        let mut levels = vec![(width, height, heights.to_vec())];
        loop {
            let (width, height, finer) = &levels[levels.len() - 1];
            if *width == 1 && *height == 1 {
                break;
            }
            levels.push(coarser(*width, *height, finer));
        }
        Ok(Self { cell_m, levels })
    }

    /// Samples across and down.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        let (width, height, _) = self.levels[0];
        [width, height]
    }

    /// The height at a level, between samples, at a place in samples of the finest level.
    fn at(&self, level: usize, x: f32, y: f32) -> f32 {
        let (width, height, heights) = &self.levels[level.min(self.levels.len() - 1)];
        let scale = 1.0 / (1_u32 << level.min(self.levels.len() - 1)) as f32;
        // A coarse sample stands in the middle of those that it is the mean of.
        let place = |c: f32, count: usize| {
            let c = ((c + 0.5) * scale - 0.5).clamp(0.0, (count - 1) as f32);
            let low = (c as usize).min(count.saturating_sub(2));
            (low, (low + 1).min(count - 1), c - low as f32)
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (place(x, *width), place(y, *height));
        let row = |y: usize| {
            let (a, b) = (heights[y * width + x0], heights[y * width + x1]);
            a + fx * (b - a)
        };
        let (a, b) = (row(y0), row(y1));
        a + fy * (b - a)
    }

    /// The slopes along +X and +Y at a sample, by central differences.
    fn slope(&self, column: usize, row: usize) -> [f32; 2] {
        let (x, y) = (column as f32, row as f32);
        let [width, height] = self.size();
        let along = |length: usize, at: usize, sample: &dyn Fn(f32) -> f32| {
            let (low, high) = (at.saturating_sub(1), (at + 1).min(length - 1));
            let run = (high - low).max(1) as f32 * self.cell_m;
            (sample(high as f32) - sample(low as f32)) / run
        };
        [along(width, column, &|x| self.at(0, x, y)), along(height, row, &|y| self.at(0, x, y))]
    }

    /// The slope (tangent of the elevation) of the horizon from a sample towards an azimuth: the
    /// steepest line of sight to three places an octave, from 1 sample to the far edge, each looked
    /// up where samples are a quarter of its distance wide. A wall between two places is seen at the
    /// farther one, so horizons are a tenth too low on average.
    fn horizon(&self, column: usize, row: usize, [cos, sin]: [f32; 2]) -> f32 {
        let (x, y) = (column as f32, row as f32);
        let here = self.at(0, x, y);
        let mut steepest = f32::NEG_INFINITY;
        for level in 0..self.levels.len() {
            for far in [1.0, 1.26, 1.587] {
                let samples = far * (1_u32 << level) as f32;
                let there = self.at(level.saturating_sub(2), x + samples * cos, y + samples * sin);
                steepest = steepest.max((there - here) / (samples * self.cell_m));
            }
        }
        steepest
    }
}

/// Means over 2 × 2 samples; an odd last row or column counts for itself.
fn coarser(width: usize, height: usize, finer: &[f32]) -> (usize, usize, Vec<f32>) {
    let (across, down) = (width.div_ceil(2), height.div_ceil(2));
    let mean = |i: usize| {
        let (x0, y0) = (2 * (i % across), 2 * (i / across));
        let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
        let at = |x: usize, y: usize| finer[y * width + x] * 0.25;
        at(x0, y0) + at(x1, y0) + at(x0, y1) + at(x1, y1)
    };
    (across, down, (0..across * down).map(mean).collect())
}

/// Tables for an order and a number of azimuths, for any field of any frame.
#[derive(Debug, Clone)]
pub struct HorizonShadows {
    order: Order,
    /// Unit vectors of the azimuths in the middle of each wedge.
    azimuths: Vec<[f32; 2]>,
    /// `[wedge][m]`: ∫ cos mφ and ∫ sin mφ over it.
    around: Vec<[[f32; 2]; MAX_BANDS]>,
    /// `[step][l(l+1)+m]` for m ≥ 0: ∫ from −1 to z of what y_lm depends on there.
    below: Vec<[f32; MAX_COEFFICIENTS]>,
}

impl HorizonShadows {
    /// Tables for `azimuths` wedges, from 4 to [`MOST_AZIMUTHS`] (clamped).
    #[must_use]
    pub fn new(order: Order, azimuths: usize) -> Self {
        let count = azimuths.clamp(4, MOST_AZIMUTHS);
        let step = TAU / count as f32;
        let around = |k: usize| {
            std::array::from_fn(|m| {
                let (m, middle) = (m as f32, step * k as f32);
                let length = if m == 0.0 { step } else { 2.0 * (m * step / 2.0).sin() / m };
                let (sin, cos) = (m * middle).sin_cos();
                [length * cos, length * sin]
            })
        };
        let azimuth = |k: usize| {
            let (sin, cos) = (step * k as f32).sin_cos();
            [cos, sin]
        };
        Self {
            order,
            azimuths: (0..count).map(azimuth).collect(),
            around: (0..count).map(around).collect(),
            below: below(order),
        }
    }

    /// The visibility at a sample of a field: n² coefficients, 1 where nothing blocks and below the
    /// tangent plane.
    ///
    /// # Panics
    /// If there is no such sample, or `out` is shorter than n².
    pub fn visibility(&self, field: &HeightField, column: usize, row: usize, out: &mut [f32]) {
        let out = &mut out[..self.order.coefficients()];
        out.fill(0.0);
        out[0] = (2.0 * TAU).sqrt();
        let [sx, sy] = field.slope(column, row);
        let sine = |slope: f32| slope / (1.0 + slope * slope).sqrt();
        for (direction, around) in self.azimuths.iter().zip(&self.around) {
            let tangent = sx * direction[0] + sy * direction[1];
            let horizon = field.horizon(column, row, *direction);
            if horizon > tangent {
                self.block([sine(tangent), sine(horizon)], around, out);
            }
        }
    }

    /// Takes a wedge between two sines of elevation away.
    fn block(&self, [low, high]: [f32; 2], around: &[[f32; 2]; MAX_BANDS], out: &mut [f32]) {
        let place = |z: f32| {
            let x = (z + 1.0) * 0.5 * STEPS as f32;
            let low = (x as usize).min(STEPS - 1);
            (low, x - low as f32)
        };
        let ((i, fi), (j, fj)) = (place(low), place(high));
        let [a0, a1, b0, b1] = [i, i + 1, j, j + 1].map(|step| &self.below[step]);
        for l in 0..self.order.bands() {
            let centre = l * (l + 1);
            for m in 0..=l {
                let k = centre + m;
                let between = b0[k] + fj * (b1[k] - b0[k]) - a0[k] - fi * (a1[k] - a0[k]);
                out[centre + m] -= between * around[m][0];
                if m > 0 {
                    out[centre - m] -= between * around[m][1];
                }
            }
        }
    }
}

/// The integrals over z, by Gauss–Legendre over every step in the polar angle, where they are smooth.
fn below(order: Order) -> Vec<[f32; MAX_COEFFICIENTS]> {
    let nodes = gauss_legendre(6);
    let (mut sum, mut y) = ([0.0; MAX_COEFFICIENTS], [0.0; MAX_COEFFICIENTS]);
    let mut out = vec![[0.0; MAX_COEFFICIENTS]];
    for step in 0..STEPS {
        let z = |step: usize| (2.0 * step as f64 / STEPS as f64 - 1.0).clamp(-1.0, 1.0).acos();
        let (from, to) = (z(step), z(step + 1));
        for (x, weight) in &nodes {
            let polar = f64::midpoint(from, to) + (from - to) / 2.0 * x;
            let (sin, cos) = polar.sin_cos();
            evaluate_f64(order, [sin, 0.0, cos], &mut y);
            let share = weight * (from - to) / 2.0 * sin;
            sum.iter_mut().zip(&y).for_each(|(sum, y)| *sum += share * y);
        }
        out.push(sum.map(|x| x as f32));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(bands: u8) -> Order {
        Order::new(bands).unwrap()
    }

    fn open() -> f32 {
        (2.0 * TAU).sqrt()
    }

    /// Level ground and a single sample block nothing, at their edges too; a slope that ends in level
    /// ground is blocked by that ground alone, between the tangent plane and the horizontal.
    #[test]
    fn planes_are_open() {
        let slope: Vec<f32> =
            (0..64).map(|i| (i % 8) as f32 * 0.5 - (i / 8) as f32 * 0.25).collect();
        let shadows = HorizonShadows::new(order(4), 32);
        let mut v = [0.0; 16];
        shadows.visibility(&HeightField::new(1, 1, 1.0, &[3.0]).unwrap(), 0, 0, &mut v);
        assert!((v[0] - open()).abs() < 1e-5, "{v:?}");
        shadows.visibility(&HeightField::new(8, 8, 1.0, &slope).unwrap(), 4, 4, &mut v);
        // Half of the lune between a plane of slope √(½² + ¼²) and the level, at most.
        let lune = (0.3125_f32.sqrt().atan() / TAU) * open();
        assert!(v[0] < open() - 0.5 * lune && v[0] > open() - 1.05 * lune, "{v:?} {lune}");
        shadows.visibility(&HeightField::new(8, 8, 1.0, &[2.0; 64]).unwrap(), 0, 7, &mut v);
        assert!((v[0] - open()).abs() < 1e-5 && v[1..].iter().all(|x| x.abs() < 1e-5), "{v:?}");
    }

    /// Before a long wall of height h at distance d the share of the sphere that is blocked is the
    /// lune between the ground and the wall's top, atan(h/d)/2π of the sphere.
    #[test]
    fn a_wall_has_its_closed_form() {
        let (size, wall) = (256, 4.0_f32);
        let heights: Vec<f32> =
            (0..size * size).map(|i| if i % size >= size / 2 + 4 { wall } else { 0.0 }).collect();
        let field = HeightField::new(size, size, 1.0, &heights).unwrap();
        let shadows = HorizonShadows::new(order(2), 128);
        let mut v = [0.0; 4];
        shadows.visibility(&field, size / 2, size / 2, &mut v);
        // The first high sample is 4 away, and heights rise over the sample before it.
        let blocked = f64::from(1.0 - v[0] / open());
        let exact = |d: f64| (f64::from(wall) / d).atan() / std::f64::consts::TAU;
        assert!((exact(5.2)..exact(3.2)).contains(&blocked), "{blocked} {}", exact(4.0));
        // The dark side is +X: the visible light leans to −X.
        assert!(v[3] < -0.05, "{v:?}");
    }

    /// Against horizons that are looked for at every half sample to the edge, over bumpy ground:
    /// the visibility is near theirs, integrated slowly.
    #[test]
    fn bumps_agree_with_traced_horizons() {
        let size = 48;
        let bump = |i: usize| {
            let (x, y) = ((i % size) as f32, (i / size) as f32);
            3.0 * (x * 0.31).sin() * (y * 0.23).cos() + 1.5 * (x * 0.11 + y * 0.17).sin()
        };
        let heights: Vec<f32> = (0..size * size).map(bump).collect();
        let field = HeightField::new(size, size, 1.0, &heights).unwrap();
        let n = order(3);
        let shadows = HorizonShadows::new(n, 32);
        let (mut found, mut apart) = ([0.0; 9], Vec::new());
        for (column, row) in [(10, 12), (24, 24), (33, 20), (17, 38), (40, 9)] {
            shadows.visibility(&field, column, row, &mut found);
            let expected = traced(&field, n, column, row);
            let off: f64 =
                found.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).powi(2)).sum();
            apart.push(off.sqrt() / f64::from(open()));
        }
        let mean = apart.iter().sum::<f64>() / apart.len() as f64;
        assert!(mean < 0.05, "{apart:?}");
    }

    fn traced(field: &HeightField, order: Order, column: usize, row: usize) -> Vec<f64> {
        let mut out = vec![0.0; order.coefficients()];
        let mut y = vec![0.0; order.coefficients()];
        out[0] = f64::from(open());
        let (turns, here) = (96, field.at(0, column as f32, row as f32));
        let [sx, sy] = field.slope(column, row);
        for k in 0..turns {
            let (sin, cos) = (TAU * k as f32 / turns as f32).sin_cos();
            let horizon = (1..200)
                .map(|step| {
                    let d = step as f32 * 0.5;
                    let there = field.at(0, column as f32 + d * cos, row as f32 + d * sin);
                    (there - here) / d
                })
                .fold(f32::NEG_INFINITY, f32::max);
            let tangent = sx * cos + sy * sin;
            if horizon <= tangent {
                continue;
            }
            let [low, high] = [tangent, horizon].map(|s| f64::from(s / (1.0 + s * s).sqrt()));
            for (x, weight) in gauss_legendre(12) {
                let z = f64::midpoint(low, high) + (high - low) / 2.0 * x;
                let r = (1.0 - z * z).sqrt();
                evaluate_f64(order, [r * f64::from(cos), r * f64::from(sin), z], &mut y);
                let share = weight * (high - low) / 2.0 * f64::from(TAU) / turns as f64;
                out.iter_mut().zip(&y).for_each(|(out, y)| *out -= share * y);
            }
        }
        out
    }

    /// NaN, sizes that do not fit and cells without length are refused with the numbers.
    #[test]
    fn bad_fields_are_refused() {
        let refused = |width, height, cell, heights: &[f32], word: &str| {
            let message = HeightField::new(width, height, cell, heights).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        };
        refused(2, 1, 1.0, &[0.0, f32::NAN], "1 of them");
        refused(2, 2, 1.0, &[0.0; 3], "2 × 2");
        refused(0, 0, 1.0, &[], "0 × 0");
        refused(1, 1, 0.0, &[0.0], "0 m");
        refused(usize::MAX, 2, 1.0, &[0.0], "heights");
    }
}
