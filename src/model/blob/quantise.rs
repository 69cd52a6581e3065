//! Numbers as little-endian bytes in each precision, and back.

use half::f16;

use super::super::{Error, Precision};
use super::layout::Entry;

/// A tensor's bytes, and its scales where the precision has them.
#[derive(Debug)]
pub(super) struct Encoded {
    pub(super) bytes: Vec<u8>,
    pub(super) scales: Vec<f32>,
}

pub(super) fn encode(
    entry: &Entry,
    values: &[f32],
    precision: Precision,
) -> Result<Encoded, Error> {
    match precision {
        Precision::F32 => Ok(Encoded { bytes: f32_bytes(values), scales: Vec::new() }),
        Precision::F16 => {
            let mut bytes = Vec::with_capacity(values.len() * 2);
            for (index, &value) in values.iter().enumerate() {
                let half = f16::from_f32(value);
                if !half.is_finite() {
                    let tensor = entry.name.clone().into_owned();
                    return Err(Error::NotRepresentable { tensor, index, value, precision });
                }
                bytes.extend(half.to_le_bytes());
            }
            Ok(Encoded { bytes, scales: Vec::new() })
        }
        Precision::I8 => encode_i8(entry, values),
    }
}

/// q = round(x / scale) with scale = max |x| / 127 over the numbers that share it, rounded up to 16
/// significant bits: then q · scale is exact in f32, so every reader gets the same numbers, and
/// writing them again gives the same bytes.
fn encode_i8(entry: &Entry, values: &[f32]) -> Result<Encoded, Error> {
    let mut scales = vec![0.0_f32; entry.scales()];
    for (index, &value) in values.iter().enumerate() {
        let scale = &mut scales[entry.scale_of(index)];
        *scale = scale.max(scale_of(value));
        if !(*scale * 127.0).is_finite() {
            let (tensor, precision) = (entry.name.clone().into_owned(), Precision::I8);
            return Err(Error::NotRepresentable { tensor, index, value, precision });
        }
    }
    let quantised = values.iter().enumerate().map(|(index, value)| {
        let scale = scales[entry.scale_of(index)];
        // Nothing but zeros, or numbers whose scale underflows: zeros.
        let q = if scale > 0.0 { (value / scale).round().clamp(-127.0, 127.0) } else { 0.0 };
        (q as i8).to_le_bytes()[0]
    });
    Ok(Encoded { bytes: quantised.collect(), scales })
}

/// The scale at which `largest` is 127; 0 where that is subnormal and has no 16 bits.
fn scale_of(largest: f32) -> f32 {
    let exact = largest.abs() / 127.0;
    let rounded = f32::from_bits(exact.to_bits().next_multiple_of(1 << 8));
    if exact.is_normal() { rounded } else { 0.0 }
}

/// The numbers of `bytes`, whose length the reader has checked.
pub(super) fn decode(
    entry: &Entry,
    bytes: &[u8],
    scales: &[f32],
    precision: Precision,
) -> Vec<f32> {
    match precision {
        Precision::F32 => f32_values(bytes),
        Precision::F16 => {
            bytes.as_chunks().0.iter().map(|&half| f16::from_le_bytes(half).to_f32()).collect()
        }
        Precision::I8 => bytes
            .iter()
            .enumerate()
            .map(|(index, &q)| f32::from(i8::from_le_bytes([q])) * scales[entry.scale_of(index)])
            .collect(),
    }
}

pub(super) fn f32_bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

pub(super) fn f32_values(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|&value| f32::from_le_bytes(value)).collect()
}

/// Indices in `size` bytes each.
pub(super) fn index_bytes(indices: impl Iterator<Item = u32>, size: usize) -> Vec<u8> {
    indices.flat_map(|index| index.to_le_bytes().into_iter().take(size)).collect()
}

/// Indices of `size` bytes each, which is 1, 2 or 4.
pub(super) fn index_values(bytes: &[u8], size: usize) -> Vec<u32> {
    bytes
        .chunks_exact(size)
        .map(|bytes| bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::super::{Family, Shape};
    use super::super::layout::{Detail, entries};
    use super::*;

    fn basis() -> Entry {
        let shape = Shape { points: 5, width: 4, parameters: 3, inputs: 2, outputs: 2 };
        entries(Family::PcaLinear, &shape, &Detail::Plain).pop().unwrap()
    }

    /// An 8-bit number is off by at most half a step of its own column, whatever the others hold,
    /// and a column of zeros stays zero.
    #[test]
    fn i8_error_is_half_a_step_of_the_column() {
        let values = [0.9, 0.0, -0.3, 0.0, 0.01, 0.0, 0.5, 0.0, -1.27, 0.0];
        let encoded = encode(&basis(), &values, Precision::I8).unwrap();
        assert!((encoded.scales[0] - 0.01).abs() < 1e-6, "{}", encoded.scales[0]);
        assert_eq!(encoded.scales[1], 0.0);
        let decoded = decode(&basis(), &encoded.bytes, &encoded.scales, Precision::I8);
        for (value, decoded) in values.iter().zip(&decoded) {
            assert!((value - decoded).abs() <= 0.005 + 1e-6, "{value} {decoded}");
        }
    }

    /// Decoded numbers encode to the same bytes and scales again, whatever they were, and what
    /// 8 bits would turn into infinity is refused.
    #[test]
    fn i8_is_a_fixed_point() {
        for seed in 0..2000_u32 {
            let power = f32::from_bits((seed * 7919 % 254 + 1) << 23);
            let value = |i: u32| ((seed * 31 + i * 977) % 1009) as f32 / 504.0 - 1.0;
            let values: Vec<f32> = (0..10).map(|i| value(i) * power * 0.4).collect();
            let once = encode(&basis(), &values, Precision::I8).unwrap();
            let decoded = decode(&basis(), &once.bytes, &once.scales, Precision::I8);
            let twice = encode(&basis(), &decoded, Precision::I8).unwrap();
            assert_eq!((twice.bytes, twice.scales), (once.bytes, once.scales), "seed {seed}");
        }
        let error = encode(&basis(), &[f32::MAX; 10], Precision::I8).unwrap_err();
        assert!(matches!(error, Error::NotRepresentable { index: 0, .. }), "{error}");
    }

    /// The coefficients of each output and input share a scale among the output dimensions only.
    #[test]
    fn scales_follow_their_shape() {
        let shape = Shape { points: 5, width: 4, parameters: 3, inputs: 2, outputs: 2 };
        let entries = entries(Family::PcaLinear, &shape, &Detail::Plain);
        let coefficients = &entries[1];
        assert_eq!(coefficients.scale_shape(), [4, 3, 1]);
        assert_eq!((coefficients.scale_of(0), coefficients.scale_of(1)), (0, 0));
        assert_eq!((coefficients.scale_of(2), coefficients.scale_of(23)), (1, 11));
        assert_eq!(entries[2].scale_of(7), 1);
    }

    /// A number beyond the range of a half is refused with its place.
    #[test]
    fn f16_overflow_is_an_error() {
        let mut values = [1.0; 10];
        values[3] = 1e5;
        let error = encode(&basis(), &values, Precision::F16).unwrap_err();
        assert!(matches!(error, Error::NotRepresentable { index: 3, .. }), "{error}");
    }

    /// Indices of each size come back.
    #[test]
    fn indices_round_trip() {
        for (size, indices) in [(1, [0, 255, 7]), (2, [0, 65_535, 256]), (4, [0, 1 << 25, 65_536])]
        {
            let bytes = index_bytes(indices.into_iter(), size);
            assert_eq!((bytes.len(), index_values(&bytes, size)), (3 * size, indices.to_vec()));
        }
    }
}
