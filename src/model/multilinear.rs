//! Family `multilinear` (AO07): linear models of the neighbourhoods of several poses, blended by
//! moving least squares.

use super::header::{check_finite, check_index, field, limits, within};
use super::{Error, Header, Shape};
use crate::num::cpu::Isa;
use crate::num::kernels::{Layout, multiply};
use crate::num::panels::Panels;

/// Pose clusters of less weight than this are left out of the sum: below the round-off of f32.
const LEAST_WEIGHT: f64 = 1e-7;

/// y\[v\] = mean\[v\] + Σ_j ω_j · coefficients[row_j(v), j] · (P_jᵀ(x − h̄_j), 1), where
/// ω_j ∝ (d_min/d_j)^α and d_j = ‖x − h̄_j‖ (AO07 eq. 4 and 5; the 1 is missing in the published
/// form).
#[derive(Debug, Clone, PartialEq)]
pub struct Multilinear {
    /// α, at least 0.
    pub blend_exponent: f32,
    /// d, dimensions of each pose cluster.
    pub inputs: usize,
    /// Whether each pose cluster has an intercept; the published form has none.
    pub intercepts: bool,
    /// h̄_j, `[pose cluster, parameter]`.
    pub centres: Vec<f32>,
    /// `[parameter, pose cluster, d]`.
    pub projection: Vec<f32>,
    /// `[point, width]`, or empty where the intercepts hold it.
    pub mean: Vec<f32>,
    /// `[row, pose cluster, width, d]`, or d + 1 with the intercept last. A row is a point, or a
    /// cluster of points.
    pub coefficients: Vec<f32>,
    /// `[pose cluster, point]`, or empty where the row of a point is its own.
    pub row_of_point: Vec<u32>,
}

/// The sizes that shape its tensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sizes {
    /// m.
    pub(super) clusters: usize,
    /// d.
    pub(super) inputs: usize,
    /// K.
    pub(super) rows: usize,
    /// d or d + 1.
    pub(super) inner: usize,
    pub(super) mean: bool,
    pub(super) mapped: bool,
}

impl Multilinear {
    pub(super) fn sizes(&self, width: usize, parameters: usize) -> Sizes {
        let clusters = self.centres.len() / parameters.max(1);
        let inner = self.inputs + usize::from(self.intercepts);
        let rows = self.coefficients.len() / (clusters * width * inner).max(1);
        let (mean, mapped) = (!self.mean.is_empty(), !self.row_of_point.is_empty());
        Sizes { clusters, inputs: self.inputs, rows, inner, mean, mapped }
    }

    pub(super) fn check(&self, header: &Header) -> Result<Shape, Error> {
        let points = header.mesh.points as usize;
        let (width, parameters) = (header.width(), header.parameters());
        if parameters == 0 || self.inputs == 0 {
            return Err(field("family", "multilinear needs a pose parameter"));
        }
        let sizes = self.sizes(width, parameters);
        within("pose clusters", sizes.clusters as u64, limits::CLUSTERS)?;
        within("input dimensions", sizes.inputs as u64, parameters as u64)?;
        if !(self.blend_exponent.is_finite() && self.blend_exponent >= 0.0) {
            return Err(field("encoder.blend_exponent", "it must be finite and not negative"));
        }
        if sizes.clusters == 0 || sizes.rows == 0 {
            return Err(field("family", "multilinear needs a pose cluster and its coefficients"));
        }
        let per_row = sizes.clusters * width * sizes.inner;
        let lengths = [
            ("encoder.centres", &self.centres, sizes.clusters * parameters),
            ("encoder.projection", &self.projection, parameters * sizes.clusters * sizes.inputs),
            ("mean", &self.mean, if sizes.mean { points * width } else { 0 }),
            ("decoder.coefficients", &self.coefficients, sizes.rows * per_row),
        ];
        for (name, values, expected) in lengths {
            if values.len() != expected {
                return Err(Error::Length { what: name.to_owned(), found: values.len(), expected });
            }
            check_finite(name, values)?;
        }
        self.check_rows(points, &sizes)?;
        Ok(Shape { points, width, parameters, inputs: sizes.inputs, outputs: 0 })
    }

    fn check_rows(&self, points: usize, sizes: &Sizes) -> Result<(), Error> {
        if !sizes.mapped {
            let (found, expected) = (sizes.rows, points);
            let what = "rows of decoder.coefficients".to_owned();
            return if found == expected {
                Ok(())
            } else {
                Err(Error::Length { what, found, expected })
            };
        }
        let (found, expected) = (self.row_of_point.len(), sizes.clusters * points);
        if found != expected {
            return Err(Error::Length { what: "map.row_of_point".to_owned(), found, expected });
        }
        for &row in &self.row_of_point {
            if row as usize >= sizes.rows {
                check_index("a row of map.row_of_point", row, sizes.rows)?;
            }
        }
        Ok(())
    }
}

/// In the layout that evaluates.
#[derive(Debug, Clone)]
pub(super) struct Core {
    /// Without its coefficients.
    parts: Multilinear,
    sizes: Sizes,
    points: usize,
    width: usize,
    /// One per pose cluster: rows `[row, width]`, inner as in the sizes.
    panels: Vec<Panels>,
}

impl Core {
    pub(super) fn new(mut parts: Multilinear, shape: Shape) -> Self {
        let Shape { points, width, parameters, .. } = shape;
        let sizes = parts.sizes(width, parameters);
        let coefficients = std::mem::take(&mut parts.coefficients);
        let Sizes { clusters, rows, inner, .. } = sizes;
        let panels = (0..clusters).map(|cluster| {
            Panels::new(rows * width, inner, |row, k| {
                let (row, c) = (row / width, row % width);
                coefficients[((row * clusters + cluster) * width + c) * inner + k]
            })
        });
        Self { sizes, points, width, panels: panels.collect(), parts }
    }

    /// As [`Core::new`] took it.
    pub(super) fn parts(&self) -> Multilinear {
        let Sizes { clusters, rows, inner, .. } = self.sizes;
        let mut parts = self.parts.clone();
        parts.coefficients.reserve(rows * clusters * self.width * inner);
        for row in 0..rows {
            for panels in &self.panels {
                for at in row * self.width..(row + 1) * self.width {
                    parts.coefficients.extend((0..inner).map(|k| panels.at(at, k)));
                }
            }
        }
        parts
    }

    /// `[point, width]` of all points.
    pub(super) fn evaluate(&self, isa: Isa, parameters: &[f32], out: &mut [f32]) {
        if self.parts.mean.is_empty() {
            out.fill(0.0)
        } else {
            out.copy_from_slice(&self.parts.mean)
        }
        let width = self.width;
        let mut rows = vec![0.0; self.sizes.rows * width];
        for (j, weight) in self.blend(parameters).into_iter().enumerate() {
            if weight < LEAST_WEIGHT {
                continue;
            }
            let features = self.features(j, weight, parameters);
            multiply(isa, &self.panels[j], &features, 1, Layout::Rows, &mut rows);
            match self.parts.row_of_point.get(j * self.points..(j + 1) * self.points) {
                Some(map) if self.sizes.mapped => {
                    for (out, &row) in out.chunks_exact_mut(width).zip(map) {
                        let row = &rows[row as usize * width..][..width];
                        out.iter_mut().zip(row).for_each(|(y, x)| *y += x);
                    }
                }
                _ => out.iter_mut().zip(&rows).for_each(|(y, x)| *y += x),
            }
        }
    }

    /// Multiply-adds of one evaluation with every pose cluster, the encoder included.
    pub(super) fn multiply_adds(&self) -> u64 {
        let Sizes { clusters, inner, rows, .. } = self.sizes;
        let encoder = self.parts.projection.len() + self.parts.centres.len();
        let blended = if self.sizes.mapped { self.points * self.width } else { 0 };
        (encoder + clusters * (rows * self.width * inner + blended)) as u64
    }

    /// ω_j; sums to 1.
    fn blend(&self, parameters: &[f32]) -> Vec<f64> {
        let square = |centre: &[f32]| -> f64 {
            let offsets = parameters.iter().zip(centre);
            offsets.map(|(&x, &c)| (f64::from(x) - f64::from(c)).powi(2)).sum()
        };
        let distances: Vec<f64> =
            self.parts.centres.chunks_exact(parameters.len()).map(|c| square(c).sqrt()).collect();
        blend(&distances, f64::from(self.parts.blend_exponent))
    }

    /// ω_j · (P_jᵀ(x − h̄_j), 1), the 1 where there are intercepts.
    fn features(&self, cluster: usize, weight: f64, parameters: &[f32]) -> Vec<f32> {
        let Sizes { clusters, inputs, inner, .. } = self.sizes;
        let centre = &self.parts.centres[cluster * parameters.len()..];
        let mut sums = vec![0.0_f64; inputs];
        for (i, (&x, &c)) in parameters.iter().zip(centre).enumerate() {
            let row = &self.parts.projection[(i * clusters + cluster) * inputs..][..inputs];
            let offset = f64::from(x) - f64::from(c);
            sums.iter_mut().zip(row).for_each(|(sum, &p)| *sum += f64::from(p) * offset);
        }
        if inner > inputs {
            sums.push(1.0);
        }
        sums.into_iter().map(|x| (x * weight) as f32).collect()
    }

    /// Contracts every vector over the width with a light: `dot(point, colour, value)` is the
    /// light of that colour at that point times `value(0..width)`.
    pub(super) fn fold(&self, colours: usize, dot: &super::fold::Dot<'_>) -> Self {
        let Sizes { inner, .. } = self.sizes;
        let row = |j: usize, point: usize| match self.sizes.mapped {
            true => self.parts.row_of_point[j * self.points + point] as usize,
            false => point,
        };
        let mut parts = self.parts.clone();
        parts.row_of_point = Vec::new();
        if self.sizes.mean {
            let value = |at: usize| {
                let (point, colour) = (at / colours, at % colours);
                dot(point, colour, &|c| self.parts.mean[point * self.width + c])
            };
            parts.mean = (0..self.points * colours).map(value).collect();
        }
        let panels = self.panels.iter().enumerate().map(|(j, panels)| {
            Panels::new(self.points * colours, inner, |at, k| {
                let (point, colour) = (at / colours, at % colours);
                let first = row(j, point) * self.width;
                dot(point, colour, &|c| panels.at(first + c, k))
            })
        });
        let panels = panels.collect();
        let sizes = Sizes { rows: self.points, mapped: false, ..self.sizes };
        Self { parts, sizes, points: self.points, width: colours, panels }
    }
}

/// ω_j ∝ (d_min/d_j)^α, summing to 1: AO07 eq. 5 without its poles. At a centre it alone counts,
/// coincident ones alike; α = 0 weighs all alike.
fn blend(distances: &[f64], exponent: f64) -> Vec<f64> {
    let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
    let raw = distances.iter().map(|&distance| match distance <= least {
        true => 1.0,
        false => (least / distance).powf(exponent),
    });
    let raw: Vec<f64> = raw.collect();
    let sum: f64 = raw.iter().sum();
    raw.into_iter().map(|weight| weight / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The weights are exact at a centre, shared by coincident centres, and finite and a
    /// partition of one for exponents from 0 to 100 and distances over 60 decades.
    #[test]
    fn blending_has_no_poles() {
        assert_eq!(blend(&[0.0, 1.0, 2.0], 10.0), [1.0, 0.0, 0.0]);
        assert_eq!(blend(&[0.0, 1.0, 0.0], 10.0), [0.5, 0.0, 0.5]);
        assert_eq!(blend(&[0.0, 1.0], 0.0), [0.5, 0.5]);
        for exponent in [0.0, 0.5, 1.0, 10.0, 100.0] {
            for scale in [1e-30, 1.0, 1e30] {
                let weights = blend(&[scale, 1.1 * scale, 3.0 * scale, 1e9 * scale], exponent);
                assert!(weights.iter().all(|w| w.is_finite() && *w >= 0.0), "{weights:?}");
                assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                assert!(weights.is_sorted_by(|a, b| a >= b));
            }
        }
    }

    /// Equation 5 as printed, where it is defined.
    #[test]
    fn blending_is_the_published_function() {
        let distances = [0.3, 0.5, 0.9];
        let printed: Vec<f64> = distances.iter().map(|d: &f64| 1.0 / d.powi(10)).collect();
        let sum: f64 = printed.iter().sum();
        for (found, printed) in blend(&distances, 10.0).iter().zip(&printed) {
            assert!((found - printed / sum).abs() < 1e-12);
        }
    }
}
