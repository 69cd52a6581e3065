//! Operators in single precision: what a frame runs, and the file that it comes in.

use std::collections::HashMap;

use glam::Vec3;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

use super::ReflectionOperator;
use crate::sh::{MAX_COEFFICIENTS, Order, evaluate};

/// The newest version of the file that is written and read.
const VERSION: u32 = 1;

/// The most terms of a file.
const MOST_TERMS: usize = MAX_COEFFICIENTS;

/// The most bytes of a file's JSON header.
const MOST_HEADER_BYTES: usize = 1 << 16;

/// What is said of an operator in its file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReflectorHeader {
    /// 1.
    pub format_version: u32,
    /// Order n of visibility and light.
    pub order: u8,
    /// k.
    pub terms: usize,
    /// 1 where the three colours are the same, else 3.
    pub channels: usize,
    /// The reflectance, as its maker named it.
    pub name: String,
    /// ‖f cos − factored‖ / ‖f cos‖ by colour.
    pub errors: Vec<f64>,
}

/// Why bytes are no operator.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReflectorError {
    /// Not the container, or damaged.
    #[error("not a safetensors file that can be read: {reason}")]
    NotSafetensors {
        /// What is wrong.
        reason: String,
    },
    /// The header is missing, or says what cannot be.
    #[error("the operator's header: {reason}")]
    Header {
        /// What is wrong.
        reason: String,
    },
    /// A tensor is missing, of another type or shape, or not finite.
    #[error("tensor `{name}`: {reason}")]
    Tensor {
        /// Which.
        name: &'static str,
        /// What is wrong.
        reason: String,
    },
}

/// A reflectance ready to shade: one or three operators in f32.
#[derive(Debug, Clone, PartialEq)]
pub struct Reflector {
    header: ReflectorHeader,
    order: Order,
    /// `[channel][b][i]`
    view: Vec<f32>,
    /// `[channel][b][j][i]`: transposed, so that sums run along memory.
    matrices: Vec<f32>,
}

/// Each of the square matrices transposed.
fn transposed(matrices: &[f32], size: usize) -> Vec<f32> {
    let entry = |k: usize| {
        let (matrix, i) = (k / (size * size), k % (size * size));
        matrices[matrix * size * size + i % size * size + i / size]
    };
    (0..matrices.len()).map(entry).collect()
}

/// acc_i += strength · v_j · M_ij over all j, the matrix transposed, its row length known to the
/// compiler.
#[inline(always)]
fn add_product<const C: usize>(acc: &mut [f32; C], strength: f32, v: &[f32], matrix: &[f32]) {
    for (row, v) in matrix.as_chunks::<C>().0.iter().zip(v) {
        let factor = strength * v;
        for (acc, m) in acc.iter_mut().zip(row) {
            *acc += factor * m;
        }
    }
}

/// Σ_b s_b M_b v of one channel.
fn transfer<const C: usize>(strengths: &[f32], v: &[f32], matrices: &[f32], out: &mut [f32]) {
    let mut acc = [0.0; C];
    for (strength, matrix) in strengths.iter().zip(matrices.chunks_exact(C * C)) {
        add_product(&mut acc, *strength, v, matrix);
    }
    out[..C].copy_from_slice(&acc);
}

impl Reflector {
    /// The operators of red, green and blue as one; kept once where they are the same.
    ///
    /// # Panics
    /// If the operators differ in order or number of terms.
    #[must_use]
    pub fn new(name: &str, operators: &[ReflectionOperator; 3], errors: [f64; 3]) -> Self {
        let [red, green, blue] = operators;
        let order = red.order();
        let same = |a: &ReflectionOperator| (a.order(), a.terms()) == (order, red.terms());
        assert!(same(green) && same(blue), "operators of one reflectance");
        let channels = if red == green && red == blue { 1 } else { 3 };
        let collect = |pick: fn(&ReflectionOperator) -> &[f64]| {
            let all = operators[..channels].iter().flat_map(|operator| pick(operator).iter());
            all.map(|&value| value as f32).collect()
        };
        let header = ReflectorHeader {
            format_version: VERSION,
            order: order.get(),
            terms: red.terms(),
            channels,
            name: name.to_owned(),
            errors: errors[..channels].to_vec(),
        };
        let (view, matrices): (_, Vec<f32>) =
            (collect(ReflectionOperator::view), collect(ReflectionOperator::matrices));
        let matrices = transposed(&matrices, order.coefficients());
        Self { header, order, view, matrices }
    }

    /// What is said of it.
    #[must_use]
    pub fn header(&self) -> &ReflectorHeader {
        &self.header
    }

    /// The order of visibility and light.
    #[must_use]
    pub fn order(&self) -> Order {
        self.order
    }

    /// Bytes of its numbers: channels · k · n²(1 + n²) · 4.
    #[must_use]
    pub fn bytes(&self) -> usize {
        4 * (self.view.len() + self.matrices.len())
    }

    /// Radiance towards a unit direction, red, green and blue: visibility, light and direction in
    /// the tangent frame. Towards below the surface nothing is reflected.
    ///
    /// # Panics
    /// If a slice is shorter than n².
    #[must_use]
    pub fn shade(&self, visibility: &[f32], light: [&[f32]; 3], outgoing: Vec3) -> [f32; 3] {
        if outgoing.z <= 0.0 { [0.0; 3] } else { self.shade_any(visibility, light, outgoing) }
    }

    /// [`Reflector::shade`] without a look at where the surface is.
    pub(super) fn shade_any(
        &self,
        visibility: &[f32],
        light: [&[f32]; 3],
        outgoing: Vec3,
    ) -> [f32; 3] {
        let (count, terms) = (self.order.coefficients(), self.header.terms);
        let mut y = [0.0; MAX_COEFFICIENTS];
        evaluate(self.order, outgoing, &mut y);
        let mut transfers = [[0.0; MAX_COEFFICIENTS]; 3];
        let channels = self
            .view
            .chunks_exact(terms * count)
            .zip(self.matrices.chunks_exact(terms * count * count));
        for (out, (view, matrices)) in transfers.iter_mut().zip(channels) {
            let mut strengths = [0.0; MOST_TERMS];
            for (s, row) in strengths.iter_mut().zip(view.chunks_exact(count)) {
                *s = row.iter().zip(&y).map(|(w, y)| w * y).sum();
            }
            self.apply(&strengths[..terms], &visibility[..count], matrices, out);
        }
        std::array::from_fn(|c| {
            let t = &transfers[c.min(self.header.channels - 1)];
            t[..count].iter().zip(&light[c][..count]).map(|(t, l)| t * l).sum()
        })
    }

    /// View factors and transposed matrices of a colour; none where they are those of the one before.
    #[inline(always)]
    pub(super) fn channel(&self, colour: usize) -> Option<(&[f32], &[f32])> {
        let (count, ReflectorHeader { channels, terms, .. }) =
            (self.order.coefficients(), &self.header);
        if colour >= *channels {
            return None;
        }
        let view = &self.view[colour * terms * count..][..terms * count];
        let matrices = &self.matrices[colour * terms * count * count..][..terms * count * count];
        Some((view, matrices))
    }

    fn apply(&self, strengths: &[f32], v: &[f32], matrices: &[f32], out: &mut [f32]) {
        match self.order.bands() {
            1 => transfer::<1>(strengths, v, matrices, out),
            2 => transfer::<4>(strengths, v, matrices, out),
            3 => transfer::<9>(strengths, v, matrices, out),
            4 => transfer::<16>(strengths, v, matrices, out),
            5 => transfer::<25>(strengths, v, matrices, out),
            6 => transfer::<36>(strengths, v, matrices, out),
            7 => transfer::<49>(strengths, v, matrices, out),
            8 => transfer::<64>(strengths, v, matrices, out),
            9 => transfer::<81>(strengths, v, matrices, out),
            _ => transfer::<100>(strengths, v, matrices, out),
        }
    }

    /// The operator as a safetensors file: `view` [channel, k, n²], `matrices` [channel, k, n², n²]
    /// in f32, and a header in the metadata under `poselight_reflector`.
    ///
    /// # Errors
    /// [`ReflectorError::NotSafetensors`] with what the container says.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ReflectorError> {
        let failed = |reason: String| ReflectorError::NotSafetensors { reason };
        let json =
            serde_json::to_string(&self.header).map_err(|error| failed(error.to_string()))?;
        let bytes = |values: &[f32]| -> Vec<u8> {
            values.iter().flat_map(|value| value.to_le_bytes()).collect()
        };
        let matrices = transposed(&self.matrices, self.order.coefficients());
        let (view, matrices) = (bytes(&self.view), bytes(&matrices));
        let [view_shape, matrix_shape] = self.shapes();
        let tensor = |shape: Vec<usize>, bytes| TensorView::new(Dtype::F32, shape, bytes);
        let tensors = [
            ("view", tensor(view_shape, &view).map_err(|e| failed(e.to_string()))?),
            ("matrices", tensor(matrix_shape, &matrices).map_err(|e| failed(e.to_string()))?),
        ];
        // One key only: the order of a hash map's keys must not reach the bytes.
        let metadata = HashMap::from([(KEY.to_owned(), json)]);
        safetensors::serialize(tensors, Some(metadata)).map_err(|error| failed(error.to_string()))
    }

    fn shapes(&self) -> [Vec<usize>; 2] {
        let ReflectorHeader { channels, terms, .. } = self.header;
        let count = self.order.coefficients();
        [vec![channels, terms, count], vec![channels, terms, count, count]]
    }

    /// Reads such a file, trusting nothing in it.
    ///
    /// # Errors
    /// [`ReflectorError`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ReflectorError> {
        let failed = |error: safetensors::SafeTensorError| ReflectorError::NotSafetensors {
            reason: error.to_string(),
        };
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(failed)?;
        let header = header(metadata.metadata().as_ref().and_then(|all| all.get(KEY)))?;
        let wrong = |reason: String| ReflectorError::Header { reason };
        let order = Order::new(header.order).map_err(|error| wrong(error.to_string()))?;
        let mut this = Self { header, order, view: Vec::new(), matrices: Vec::new() };
        let [view_shape, matrix_shape] = this.shapes();
        let tensors = SafeTensors::deserialize(bytes).map_err(failed)?;
        this.view = numbers(&tensors, "view", &view_shape)?;
        let matrices = numbers(&tensors, "matrices", &matrix_shape)?;
        this.matrices = transposed(&matrices, order.coefficients());
        Ok(this)
    }
}

/// The metadata's key.
const KEY: &str = "poselight_reflector";

fn header(json: Option<&String>) -> Result<ReflectorHeader, ReflectorError> {
    let wrong = |reason: String| ReflectorError::Header { reason };
    let json = json.ok_or_else(|| wrong(format!("there is no `{KEY}` in the metadata")))?;
    if json.len() > MOST_HEADER_BYTES {
        return Err(wrong(format!("it has {} bytes, at most {MOST_HEADER_BYTES}", json.len())));
    }
    let header: ReflectorHeader =
        serde_json::from_str(json).map_err(|error| wrong(error.to_string()))?;
    let ReflectorHeader { format_version, terms, channels, .. } = header;
    if format_version != VERSION {
        return Err(wrong(format!("version {format_version}; this build reads {VERSION}")));
    }
    if !(1..=MOST_TERMS).contains(&terms) || !matches!(channels, 1 | 3) {
        return Err(wrong(format!("{terms} terms in {channels} channels")));
    }
    Ok(header)
}

fn numbers(
    tensors: &SafeTensors<'_>,
    name: &'static str,
    shape: &[usize],
) -> Result<Vec<f32>, ReflectorError> {
    let wrong = |reason: String| ReflectorError::Tensor { name, reason };
    let tensor = tensors.tensor(name).map_err(|error| wrong(error.to_string()))?;
    if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
        let (dtype, found) = (tensor.dtype(), tensor.shape());
        return Err(wrong(format!("it is {dtype:?} {found:?}, not F32 {shape:?}")));
    }
    let values: Vec<f32> =
        tensor.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    if values.iter().all(|value| value.is_finite()) {
        Ok(values)
    } else {
        Err(wrong("not all of its numbers are finite".to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn operator(phase: f64) -> ReflectionOperator {
        let (order, light) = (Order::new(4).unwrap(), Order::new(7).unwrap());
        let numbers = |count: usize, step: f64| -> Vec<f64> {
            (0..count).map(|i| (i as f64 * step + phase).sin()).collect()
        };
        ReflectionOperator::new(order, light, &numbers(8 * 49, 1.3), &numbers(8 * 16, 0.7))
    }

    fn reflector(coloured: bool) -> (Reflector, [ReflectionOperator; 3]) {
        let phases = if coloured { [0.0, 0.5, 1.0] } else { [0.2; 3] };
        let operators = phases.map(operator);
        (Reflector::new("test", &operators, [0.1, 0.2, 0.3]), operators)
    }

    /// f32 shades as the f64 operators do, in every colour; nothing goes below the surface; eight
    /// terms of order 4 are 8,704 bytes.
    #[test]
    fn f32_follows_f64() {
        for coloured in [false, true] {
            let (reflector, operators) = reflector(coloured);
            assert_eq!(reflector.bytes(), if coloured { 3 * 8704 } else { 8704 });
            let v: Vec<f64> = (0..16).map(|i| (f64::from(i) * 0.9).cos()).collect();
            let lights: [Vec<f64>; 3] =
                [0.1, 0.4, 2.0].map(|p| (0..16).map(|i| (f64::from(i) * p).sin()).collect());
            let single = |values: &[f64]| values.iter().map(|&x| x as f32).collect::<Vec<f32>>();
            let [r, g, b] = lights.each_ref().map(|light| single(light));
            let outgoing = Vec3::new(0.36, -0.48, 0.8);
            let found = reflector.shade(&single(&v), [&r, &g, &b], outgoing);
            let mut t = vec![0.0; 16];
            for c in 0..3 {
                operators[c].transfer(&v, outgoing.as_dvec3().normalize().to_array(), &mut t);
                let expected: f64 = t.iter().zip(&lights[c]).map(|(t, l)| t * l).sum();
                let size: f64 = t.iter().map(|t| t.abs()).sum::<f64>().max(1.0);
                assert!(
                    (f64::from(found[c]) - expected).abs() < 1e-5 * size,
                    "{found:?} {expected}"
                );
            }
            assert_eq!(reflector.shade(&single(&v), [&r, &g, &b], Vec3::NEG_Z), [0.0; 3]);
        }
    }

    /// What is written reads back, byte for byte the same each time; every cut file, other shapes,
    /// other versions and numbers that are not finite are refused.
    #[test]
    fn files_are_read_back_or_refused() {
        let (reflector, _) = reflector(true);
        let bytes = reflector.to_bytes().unwrap();
        assert_eq!(bytes, reflector.to_bytes().unwrap());
        assert_eq!(Reflector::from_bytes(&bytes).unwrap(), reflector);
        for end in (0..bytes.len()).step_by(97) {
            assert!(Reflector::from_bytes(&bytes[..end]).is_err(), "cut at {end}");
        }
        let refused = |change: &dyn Fn(&mut Reflector), word: &str| {
            let mut wrong = reflector.clone();
            change(&mut wrong);
            let written = wrong.to_bytes().map(|bytes| Reflector::from_bytes(&bytes));
            let message = match written {
                Ok(Err(error)) | Err(error) => error.to_string(),
                Ok(Ok(_)) => String::new(),
            };
            assert!(message.contains(word), "{word}: {message}");
        };
        refused(&|r| r.view[3] = f32::NAN, "finite");
        refused(&|r| r.header.format_version = 2, "version 2");
        refused(&|r| r.header.order = 5, "F32 [3, 8, 25]");
        refused(&|r| r.header.order = 0, "order 0");
        refused(&|r| r.header.name = "x".repeat(1 << 17), "bytes");
        refused(&|r| r.header.terms = 7, "not");
        refused(&|r| r.header.channels = 2, "not");
    }
}
