//! Evaluation of a model from pose parameters.

use super::fitted::Core;
use super::header::{check_finite, check_index};
use super::{Distance, Error, Model};
use crate::num::cpu::Isa;
use crate::num::kernels::{Layout, multiply};
use crate::num::panels::Panels;

impl Model {
    /// The signal in the model's own frame, `[point, channel, coefficient]`, of all points or of
    /// the listed ones in their order.
    ///
    /// The value of a point is the same bit for bit whichever points are asked for with it.
    ///
    /// # Errors
    /// [`Error::Length`] of `parameters` or `out`, [`Error::NotFinite`] parameters,
    /// [`Error::OutOfRange`] points.
    pub fn evaluate(
        &self,
        parameters: &[f32],
        points: Option<&[u32]>,
        out: &mut [f32],
    ) -> Result<(), Error> {
        self.evaluate_with(Isa::best(), parameters, points, Layout::Rows, out)
    }

    /// [`evaluate`](Self::evaluate) of all points as `[channel, coefficient, point]`: one array
    /// per coefficient, as engines like to upload it, and without the cost of interleaving.
    ///
    /// # Errors
    /// As `evaluate`.
    pub fn evaluate_planar(&self, parameters: &[f32], out: &mut [f32]) -> Result<(), Error> {
        self.evaluate_with(Isa::best(), parameters, None, Layout::Planar, out)
    }

    /// Evaluation by a given instruction set, for comparisons.
    ///
    /// # Errors
    /// As [`evaluate`](Self::evaluate).
    pub fn evaluate_with(
        &self,
        isa: Isa,
        parameters: &[f32],
        points: Option<&[u32]>,
        layout: Layout,
        out: &mut [f32],
    ) -> Result<(), Error> {
        self.check_parameters(parameters)?;
        let held = self.held(parameters);
        let parameters = &*held;
        let count = self.check_points(points)?;
        check_length("output", out.len(), count * self.shape.width)?;
        match &*self.core {
            Core::Mean(mean) => copy_mean(mean, self.shape.width, points, layout, out),
            Core::Linear(panels) => self.linear(isa, panels, parameters, points, layout, out),
            Core::Multilinear(_) | Core::Clustered(_) => {
                self.whole(isa, parameters, points, layout, out);
            }
            Core::PcaLinear { basis, .. } => {
                let reduced = self.reduced(isa, parameters);
                let width = self.shape.width;
                match points {
                    None => multiply(isa, basis, &reduced, width, layout, out),
                    Some(points) => {
                        let basis = gather(basis, points, 1);
                        multiply(isa, &basis, &reduced, width, layout, out);
                    }
                }
            }
        }
        Ok(())
    }

    /// How far the pose is from the training poses.
    ///
    /// # Errors
    /// [`Error::Length`] or [`Error::NotFinite`] of `parameters`.
    pub fn distance(&self, parameters: &[f32]) -> Result<Distance, Error> {
        self.check_parameters(parameters)?;
        Ok(self.subspace.distance(parameters))
    }

    /// Z = X^c φ of `pca-linear`, `[d_out, width]`.
    pub(super) fn reduced(&self, isa: Isa, parameters: &[f32]) -> Vec<f32> {
        let Core::PcaLinear { coefficients, .. } = &*self.core else { return Vec::new() };
        let mut reduced = vec![0.0; coefficients.rows()];
        let features = features(&self.core, &self.header.training.centre, parameters);
        multiply(isa, coefficients, &features, 1, Layout::Rows, &mut reduced);
        reduced
    }

    fn linear(
        &self,
        isa: Isa,
        panels: &Panels,
        parameters: &[f32],
        points: Option<&[u32]>,
        layout: Layout,
        out: &mut [f32],
    ) {
        let width = self.shape.width;
        let features = features(&self.core, &self.header.training.centre, parameters);
        let gathered = points.map(|points| gather(panels, points, width));
        let panels = gathered.as_ref().unwrap_or(panels);
        if layout == Layout::Rows || width == 1 {
            multiply(isa, panels, &features, 1, Layout::Rows, out);
        } else {
            let mut rows = vec![0.0; out.len()];
            multiply(isa, panels, &features, 1, Layout::Rows, &mut rows);
            transpose(&rows, width, out);
        }
    }

    /// For families whose points share work: all points, of which the listed ones are kept.
    fn whole(
        &self,
        isa: Isa,
        parameters: &[f32],
        points: Option<&[u32]>,
        layout: Layout,
        out: &mut [f32],
    ) {
        let width = self.shape.width;
        if points.is_none() && layout == Layout::Rows {
            return self.core.rows(isa, &self.header.training.centre, parameters, out);
        }
        let mut rows = vec![0.0; self.shape.points * width];
        self.core.rows(isa, &self.header.training.centre, parameters, &mut rows);
        copy_mean(&rows, width, points, layout, out);
    }

    pub(super) fn check_parameters(&self, parameters: &[f32]) -> Result<(), Error> {
        check_length("parameters", parameters.len(), self.shape.parameters)?;
        check_finite("parameters", parameters)
    }

    /// The number of points asked for, all of them in range.
    pub(super) fn check_points(&self, points: Option<&[u32]>) -> Result<usize, Error> {
        let Some(points) = points else { return Ok(self.shape.points) };
        for (i, &point) in points.iter().enumerate() {
            if point as usize >= self.shape.points {
                check_index(&format!("point {i} of the list"), point, self.shape.points)?;
            }
        }
        Ok(points.len())
    }
}

impl Core {
    /// `[point, width]` of all points, for families whose points share work; the others do
    /// nothing.
    pub(super) fn rows(&self, isa: Isa, centre: &[f32], parameters: &[f32], out: &mut [f32]) {
        match self {
            Self::Multilinear(core) => core.evaluate(isa, parameters, out),
            Self::Clustered(core) => core.evaluate(isa, centre, parameters, out),
            Self::Mean(_) | Self::Linear(_) | Self::PcaLinear { .. } => {}
        }
    }
}

/// φ: the encoder's features, the constant 1 last. Empty for `mean`.
pub(super) fn features(core: &Core, centre: &[f32], parameters: &[f32]) -> Vec<f32> {
    let mut features: Vec<f32> = match core {
        Core::Mean(_) | Core::Multilinear(_) | Core::Clustered(_) => return Vec::new(),
        Core::Linear(_) => parameters.iter().zip(centre).map(|(x, c)| x - c).collect(),
        Core::PcaLinear { projection, coefficients, .. } => {
            let inputs = coefficients.inner() - 1;
            let mut sums = vec![0.0_f32; inputs];
            if inputs > 0 {
                for (row, &x) in projection.chunks_exact(inputs).zip(parameters) {
                    for (sum, &p) in sums.iter_mut().zip(row) {
                        *sum += p * x;
                    }
                }
            }
            sums
        }
    };
    features.push(1.0);
    features
}

pub(super) fn check_length(what: &str, found: usize, expected: usize) -> Result<(), Error> {
    if found == expected {
        Ok(())
    } else {
        Err(Error::Length { what: what.to_owned(), found, expected })
    }
}

/// The rows of the listed points, `per_point` each.
fn gather(panels: &Panels, points: &[u32], per_point: usize) -> Panels {
    Panels::new(points.len() * per_point, panels.inner(), |row, j| {
        panels.at(points[row / per_point] as usize * per_point + row % per_point, j)
    })
}

fn copy_mean(mean: &[f32], width: usize, points: Option<&[u32]>, layout: Layout, out: &mut [f32]) {
    match (points, layout) {
        (None, Layout::Rows) => out.copy_from_slice(mean),
        (None, Layout::Planar) => transpose(mean, width, out),
        (Some(points), _) => {
            let count = points.len();
            for (i, &point) in points.iter().enumerate() {
                let row = &mean[point as usize * width..(point as usize + 1) * width];
                for (c, &value) in row.iter().enumerate() {
                    let at = if layout == Layout::Rows { i * width + c } else { c * count + i };
                    out[at] = value;
                }
            }
        }
    }
}

/// `[row, width]` to `[width, row]`.
fn transpose(rows: &[f32], width: usize, out: &mut [f32]) {
    let count = rows.len() / width;
    for (row, values) in rows.chunks_exact(width).enumerate() {
        for (c, &value) in values.iter().enumerate() {
            out[c * count + row] = value;
        }
    }
}
