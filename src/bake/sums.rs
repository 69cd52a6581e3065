//! Visibility bits times a table: sums of the rows of blocked rays.
//!
//! The matrix product of a 0/1 vector with a table is a sum over the ones. Rows are padded to
//! whole vectors; the sum of each half is kept in registers, band by band of columns.

/// Columns that are summed together; rows are padded to a multiple.
pub(super) const LANES: usize = 8;

/// A table with one row per ray.
#[derive(Debug)]
pub(super) struct Rows {
    width: usize,
    values: Vec<f32>,
}

impl Rows {
    /// No rows, of `width` columns, a multiple of [`LANES`].
    pub(super) fn new(width: usize) -> Self {
        assert_eq!(width % LANES, 0, "rows of {width} columns");
        Self { width, values: Vec::new() }
    }

    pub(super) fn push(&mut self, row: &[f32]) {
        assert_eq!(row.len(), self.width, "a row of another width");
        self.values.extend_from_slice(row);
    }

    /// How many numbers it holds.
    pub(super) fn len(&self) -> usize {
        self.values.len()
    }

    /// Adds the rows whose numbers are listed, in the order of the list, and overwrites `out`.
    pub(super) fn sum(&self, listed: &[u16], out: &mut [f32]) {
        for (column, out) in out[..self.width].chunks_exact_mut(LANES).enumerate() {
            let mut sum = [0.0f32; LANES];
            for &row in listed {
                let start = usize::from(row) * self.width + column * LANES;
                for (sum, value) in sum.iter_mut().zip(&self.values[start..start + LANES]) {
                    *sum += value;
                }
            }
            out.copy_from_slice(&sum);
        }
    }
}

/// Writes the numbers of the set bits, ascending, to the start of `out`; says how many there are.
pub(super) fn list_bits(words: impl Iterator<Item = u64>, out: &mut [u16]) -> usize {
    let mut count = 0;
    for (index, mut word) in words.enumerate() {
        while word != 0 {
            out[count] = (index as u32 * 64 + word.trailing_zeros()) as u16;
            count += 1;
            word &= word - 1;
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::random::Stream;

    /// The listed rows' sum is that of a plain loop in f64, for sizes around the lane count.
    #[test]
    fn sums_agree_with_a_plain_loop() {
        let mut stream = Stream::new(2);
        for (rows, width) in [(1_usize, 8_usize), (70, 40), (500, 104)] {
            let mut table = Rows::new(width);
            let mut plain = vec![0.0f64; width];
            let bits: Vec<u64> = (0..rows.div_ceil(64))
                .map(|word| stream.next_u64() & u64::MAX >> (64 - (rows - word * 64).min(64)))
                .collect();
            for row in 0..rows {
                let values: Vec<f32> = (0..width).map(|_| stream.normal() as f32).collect();
                if bits[row / 64] >> (row % 64) & 1 == 1 {
                    plain.iter_mut().zip(&values).for_each(|(sum, v)| *sum += f64::from(*v));
                }
                table.push(&values);
            }
            let (mut listed, mut out) = (vec![0; rows], vec![f32::NAN; width]);
            let count = list_bits(bits.iter().copied(), &mut listed);
            assert_eq!(count, bits.iter().map(|b| b.count_ones() as usize).sum::<usize>());
            table.sum(&listed[..count], &mut out);
            for (sum, plain) in out.iter().zip(&plain) {
                assert!((f64::from(*sum) - plain).abs() < 1e-4);
            }
        }
    }
}
