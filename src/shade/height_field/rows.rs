//! A row of samples at once: what lies in one direction at one distance is a shifted row.

use super::{HeightField, HorizonShadows};

/// Samples beyond both ends of a row that are filled with its ends, for shifts of the finest levels.
const MARGIN: usize = 8;

impl HorizonShadows {
    /// The visibility at all samples of a row, `[column][coefficient]`: [`HorizonShadows::visibility`] to
    /// rounding, several times as fast.
    ///
    /// # Panics
    /// If there is no such row, or `out` is not of width · n² numbers.
    pub fn visibility_row(&self, field: &HeightField, row: usize, out: &mut [f32]) {
        let ([width, _], count) = (field.size(), self.order.coefficients());
        assert_eq!(out.len(), width * count, "numbers of a row");
        out.fill(0.0);
        out.iter_mut().step_by(count).for_each(|open| *open = (2.0 * super::TAU).sqrt());
        let slopes: Vec<[f32; 2]> = (0..width).map(|column| field.slope(column, row)).collect();
        let (mut horizon, mut line) = (vec![0.0; width], Vec::new());
        let sine = |slope: f32| slope / (1.0 + slope * slope).sqrt();
        for (direction, around) in self.azimuths.iter().zip(&self.around) {
            field.horizon_row(row, *direction, &mut horizon, &mut line);
            let points = out.chunks_exact_mut(count).zip(&slopes).zip(&horizon);
            for ((out, [sx, sy]), &horizon) in points {
                let tangent = sx * direction[0] + sy * direction[1];
                if horizon > tangent {
                    self.block([sine(tangent), sine(horizon)], around, out);
                }
            }
        }
    }
}

impl HeightField {
    /// [`HeightField::horizon`] of every sample of a row.
    fn horizon_row(
        &self,
        row: usize,
        [cos, sin]: [f32; 2],
        steepest: &mut [f32],
        line: &mut Vec<f32>,
    ) {
        let (width, _, heights) = &self.levels[0];
        let here = &heights[row * width..][..*width];
        steepest.fill(f32::NEG_INFINITY);
        for level in 0..self.levels.len() {
            for far in super::OCTAVE {
                let samples = far * (1_u32 << level) as f32;
                let source = level.saturating_sub(2);
                self.blend(source, row as f32 + samples * sin, line);
                let (run, aside) = (1.0 / (samples * self.cell_m), samples * cos);
                if source == 0 {
                    shifted(line, here, (aside, run), steepest);
                } else {
                    stretched(line, here, (aside, run, source), steepest);
                }
            }
        }
    }

    /// The row of a level at a place between its rows, with margins.
    fn blend(&self, level: usize, y: f32, line: &mut Vec<f32>) {
        let (width, height, heights) = &self.levels[level];
        let scale = 1.0 / (1_u32 << level) as f32;
        let c = ((y + 0.5) * scale - 0.5).clamp(0.0, (height - 1) as f32);
        let low = (c as usize).min(height.saturating_sub(2));
        let f = c - low as f32;
        let above = &heights[low * width..][..*width];
        let below = &heights[(low + 1).min(height - 1) * width..][..*width];
        line.clear();
        let first = above[0] + f * (below[0] - above[0]);
        line.extend([first; MARGIN]);
        line.extend(above.iter().zip(below).map(|(a, b)| a + f * (b - a)));
        let last = line[line.len() - 1];
        line.extend([last; MARGIN]);
    }
}

/// Lines of sight to the same shift from every sample, within the margins.
fn shifted(line: &[f32], here: &[f32], (aside, run): (f32, f32), steepest: &mut [f32]) {
    let whole = aside.floor();
    let f = aside - whole;
    let start = (MARGIN as i32 + whole as i32) as usize;
    let near = &line[start..][..here.len()];
    let next = &line[start + 1..][..here.len()];
    for (((steepest, here), a), b) in steepest.iter_mut().zip(here).zip(near).zip(next) {
        *steepest = steepest.max((a + f * (b - a) - here) * run);
    }
}

/// The same where samples are wider than the field's.
fn stretched(
    line: &[f32],
    here: &[f32],
    (aside, run, level): (f32, f32, usize),
    steepest: &mut [f32],
) {
    let scale = 1.0 / (1_u32 << level) as f32;
    let last = (line.len() - 2 * MARGIN - 1) as f32;
    for (x, (steepest, here)) in steepest.iter_mut().zip(here).enumerate() {
        let c = ((x as f32 + aside + 0.5) * scale - 0.5).clamp(0.0, last);
        let low = c as usize;
        let (a, b) = (line[MARGIN + low], line[MARGIN + low + 1]);
        *steepest = steepest.max((a + (c - low as f32) * (b - a) - here) * run);
    }
}
