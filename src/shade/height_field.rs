//! Height fields: visibility from the horizon in every direction (Snyder and Nowrouzezahrai 2008;
//! RPO09 eqs. 4 and 5).
//!
//! The frame is the field's own: +X along columns, +Y along rows, +Z up. From a point with normal
//! n, what blocks at an azimuth is what lies between the tangent plane and the horizon there. A
//! wedge of azimuths with one horizon is a product of an integral over φ, known in closed form, and
//! one over z, tabulated; so turning a wedge about the vertical costs nothing.

mod rows;

use std::f32::consts::TAU;

use glam::Vec3;

use super::Error;
use crate::sh::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate_f64, gauss_legendre};

/// Steps of the table over z from −1 to 1.
const STEPS: usize = 512;

/// The most azimuths.
pub const MOST_AZIMUTHS: usize = 256;

/// Places that are looked at in every octave of distance.
const OCTAVE: [f32; 3] = [1.0, 1.26, 1.587];

/// The most samples of a field.
const MOST_SAMPLES: usize = 1 << 26;

/// The furthest that a height is from 0, and neighbours from one another: their slopes have squares that
/// f32 holds.
const MOST_M: f32 = 1e9;

/// The least distance of neighbours.
const LEAST_CELL_M: f32 = 1e-6;

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
    /// [`Error::Heights`] for a size that does not fit, too many samples, a cell below a micrometre, or
    /// heights that are not finite or beyond 10⁹ m.
    pub fn new(width: usize, height: usize, cell_m: f32, heights: &[f32]) -> Result<Self, Error> {
        check([width, height], cell_m, heights)?;
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

    /// Gives the field other heights, such as those of the next frame, in the memory that it has.
    ///
    /// # Errors
    /// [`Error::Heights`] for another number of heights or such as [`HeightField::new`] refuses; the field
    /// is then as it was.
    pub fn set_heights(&mut self, heights: &[f32]) -> Result<(), Error> {
        let [width, height] = self.size();
        check([width, height], self.cell_m, heights)?;
        self.levels[0].2.copy_from_slice(heights);
        for level in 1..self.levels.len() {
            let (finer, coarse) = self.levels.split_at_mut(level);
            let (width, height, finer) = &finer[level - 1];
            halve([*width, *height], finer, &mut coarse[0].2);
        }
        Ok(())
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

    /// The unit normal at a sample, by central differences.
    ///
    /// # Panics
    /// If there is no such sample.
    #[must_use]
    pub fn normal(&self, column: usize, row: usize) -> Vec3 {
        let [sx, sy] = self.slope(column, row);
        Vec3::new(-sx, -sy, 1.0).normalize()
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
            for far in OCTAVE {
                let samples = far * (1_u32 << level) as f32;
                let there = self.at(level.saturating_sub(2), x + samples * cos, y + samples * sin);
                steepest = steepest.max((there - here) / (samples * self.cell_m));
            }
        }
        steepest
    }

    /// The same by looking every `step` samples, until nothing lies ahead any more.
    fn traced(&self, column: usize, row: usize, [cos, sin]: [f32; 2], step: f32) -> f32 {
        let (x, y) = (column as f32, row as f32);
        let here = self.at(0, x, y);
        let [width, height] = self.size().map(|side| side as f32);
        let mut steepest = f32::NEG_INFINITY;
        for k in 1..=((width + height) / step).ceil() as u32 {
            let far = k as f32 * step;
            let (at_x, at_y) = (x + far * cos, y + far * sin);
            steepest = steepest.max((self.at(0, at_x, at_y) - here) / (far * self.cell_m));
            // Beyond one edge the field still varies along the other.
            let is_in = |at: f32, side: f32| (0.0..=side).contains(&at);
            if !is_in(at_x, width) && !is_in(at_y, height) {
                break;
            }
        }
        steepest
    }
}

/// Whether so many heights are a field of that size.
fn check([width, height]: [usize; 2], cell_m: f32, heights: &[f32]) -> Result<(), Error> {
    let found = heights.len();
    let bad = heights.iter().filter(|h| h.is_nan() || h.abs() > MOST_M).count();
    let fits = found > 0 && found <= MOST_SAMPLES && width.checked_mul(height) == Some(found);
    if fits && bad == 0 && (LEAST_CELL_M..=MOST_M).contains(&cell_m) {
        Ok(())
    } else {
        Err(Error::Heights { width, height, found, bad, cell_m })
    }
}

/// A level of half the size.
fn coarser(width: usize, height: usize, finer: &[f32]) -> (usize, usize, Vec<f32>) {
    let (across, down) = (width.div_ceil(2), height.div_ceil(2));
    let mut out = vec![0.0; across * down];
    halve([width, height], finer, &mut out);
    (across, down, out)
}

/// Means over 2 × 2 samples; an odd last row or column counts for itself.
fn halve([width, height]: [usize; 2], finer: &[f32], out: &mut [f32]) {
    for (y, row) in out.chunks_exact_mut(width.div_ceil(2)).enumerate() {
        let above = &finer[2 * y * width..][..width];
        let below = &finer[(2 * y + 1).min(height - 1) * width..][..width];
        for (x, mean) in row.iter_mut().enumerate() {
            let (left, right) = (2 * x, (2 * x + 1).min(width - 1));
            *mean = 0.25 * (above[left] + above[right] + below[left] + below[right]);
        }
    }
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
        self.visibility_by([column, row], field, out, |azimuth| {
            field.horizon(column, row, azimuth)
        });
    }

    /// The same by horizons that are looked for every `step` samples to the field's far edge, at its
    /// finest level: the slow truth beside [`HorizonShadows::visibility`].
    ///
    /// # Panics
    /// If there is no such sample, `out` is shorter than n², or `step` is not above 0.
    pub fn visibility_traced(
        &self,
        field: &HeightField,
        column: usize,
        row: usize,
        step: f32,
        out: &mut [f32],
    ) {
        assert!(step > 0.0, "a step of {step} samples leads nowhere");
        self.visibility_by([column, row], field, out, |azimuth| {
            field.traced(column, row, azimuth, step)
        });
    }

    fn visibility_by(
        &self,
        [column, row]: [usize; 2],
        field: &HeightField,
        out: &mut [f32],
        horizon: impl Fn([f32; 2]) -> f32,
    ) {
        let out = &mut out[..self.order.coefficients()];
        out.fill(0.0);
        out[0] = (2.0 * TAU).sqrt();
        let [sx, sy] = field.slope(column, row);
        let sine = |slope: f32| slope / (1.0 + slope * slope).sqrt();
        for (direction, around) in self.azimuths.iter().zip(&self.around) {
            let tangent = sx * direction[0] + sy * direction[1];
            let horizon = horizon(*direction);
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
mod tests;
