//! The file that an operator comes in: proto/reflector.md.

use std::collections::HashMap;

use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

use super::reflector::transposed;
use super::{MOST_TERMS, Reflector};
use crate::sh::Order;

/// The version of a file in which every channel has matrices of its own.
pub(super) const VERSION: u32 = 1;

/// The version of one in which three channels share them.
pub(super) const VERSION_SHARED: u32 = 2;

/// The most bytes of a file's JSON header.
const MOST_HEADER_BYTES: usize = 1 << 16;

/// What is said of an operator in its file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReflectorHeader {
    /// 1, or 2 where three colours share their matrices.
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
    /// Whether it looks the same however a surface is turned about its normal. What a file says of it is
    /// not looked at: its numbers tell.
    #[serde(default)]
    pub isotropic: bool,
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

impl ReflectorHeader {
    /// How many sets of matrices there are.
    pub(super) fn sets(&self) -> usize {
        if self.format_version == VERSION_SHARED { 1 } else { self.channels }
    }
}

impl Reflector {
    /// The operator as a safetensors file: `view` [channel, k, n²], `matrices` [set, k, n², n²]
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
        [vec![channels, terms, count], vec![self.sets(), terms, count, count]]
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
        let mut this = Self::of(header, order, Vec::new(), Vec::new());
        let [view_shape, matrix_shape] = this.shapes();
        let tensors = SafeTensors::deserialize(bytes).map_err(failed)?;
        this.view = numbers(&tensors, "view", &view_shape)?;
        let matrices = numbers(&tensors, "matrices", &matrix_shape)?;
        this.matrices = transposed(&matrices, order.coefficients());
        this.header.isotropic = this.is_isotropic();
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
    if !matches!(format_version, VERSION | VERSION_SHARED) {
        let fault =
            format!("version {format_version}; this build reads {VERSION} and {VERSION_SHARED}");
        return Err(wrong(fault));
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
    use super::super::reflector::tests::reflectors;
    use super::*;

    /// A grain is told from the numbers, whatever a file says of it: files of before this was said, of
    /// reflectances with and without one, at any number of terms, with the cosine in either place.
    #[test]
    fn a_grain_is_told() {
        use crate::shade::{Brdf, Cosine, Factoring, factor_by};
        let order = Order::new(4).unwrap();
        let ggx = |alpha| Brdf::Ggx { normal_reflectance: [0.9, 0.5, 0.2], alpha };
        for cosine in [Cosine::Inside, Cosine::Matrix] {
            let way = Factoring { cosine, ..Factoring::default() };
            for (brdf, isotropic) in [(ggx([0.3; 2]), true), (ggx([0.3, 0.4]), false)] {
                let factored = factor_by(&brdf, order, 12, way).unwrap();
                for terms in [1, 2, 3, 8, 16] {
                    let operators = factored.each_ref().map(|colour| colour.operator(terms));
                    let mut made = Reflector::new("x", &operators, [0.0; 3]);
                    // One term has no direction to prefer.
                    let expected = isotropic || (terms == 1 && made.header.isotropic);
                    assert_eq!(made.header.isotropic, expected, "{terms} terms");
                    let told = made.header.isotropic;
                    made.header.isotropic = !told;
                    let read = Reflector::from_bytes(&made.to_bytes().unwrap()).unwrap();
                    assert_eq!(read.header.isotropic, told);
                }
            }
        }
    }

    /// What is written reads back, byte for byte the same each time, with colours that share their
    /// matrices and without; every cut file, other shapes, other versions and numbers that are not
    /// finite are refused.
    #[test]
    fn files_are_read_back_or_refused() {
        for ((reflector, _), version) in reflectors().into_iter().zip([1, 2, 1]) {
            assert_eq!(reflector.header().format_version, version);
            let bytes = reflector.to_bytes().unwrap();
            assert_eq!(bytes, reflector.to_bytes().unwrap());
            assert_eq!(Reflector::from_bytes(&bytes).unwrap(), reflector);
            for end in (0..bytes.len()).step_by(97) {
                assert!(Reflector::from_bytes(&bytes[..end]).is_err(), "cut at {end}");
            }
        }
        let [_, (shared, _), (reflector, _)] = reflectors();
        let refused = |reflector: &Reflector, change: &dyn Fn(&mut Reflector), word: &str| {
            let mut wrong = reflector.clone();
            change(&mut wrong);
            let written = wrong.to_bytes().map(|bytes| Reflector::from_bytes(&bytes));
            let message = match written {
                Ok(Err(error)) | Err(error) => error.to_string(),
                Ok(Ok(_)) => String::new(),
            };
            assert!(message.contains(word), "{word}: {message}");
        };
        for reflector in [&shared, &reflector] {
            refused(reflector, &|r| r.view[3] = f32::NAN, "finite");
            refused(reflector, &|r| r.header.order = 5, "F32 [3, 8, 25]");
            refused(reflector, &|r| r.header.order = 0, "order 0");
            refused(reflector, &|r| r.header.name = "x".repeat(1 << 17), "bytes");
            refused(reflector, &|r| r.header.terms = 7, "not");
            refused(reflector, &|r| r.header.channels = 2, "not");
        }
        refused(&reflector, &|r| r.header.format_version = 3, "version 3");
        refused(&reflector, &|r| r.header.format_version = 2, "not");
        refused(&shared, &|r| r.header.format_version = 1, "not");
    }
}
