//! Plain loops over arrays, which the compiler vectorises for whatever the target surely has.

use super::{Buffer, Groups, Lanes, PANEL_ROWS, Panels, TILE};

/// Columns of [`accumulate`] at most: 4 of 8 rows fill 8 of 16 registers of 4 lanes.
const WIDEST: usize = 4;
/// Rows of [`accumulate`] at a time.
const PASS: usize = 8;
/// What SSE2 and NEON have.
const LANES: usize = 4;
/// Rows and vectors of columns of [`along`]: 8 of 16 registers.
const ROWS: usize = 4;
const ACROSS: usize = 2;
/// Independent chains of [`exercise`]: where multiply and add are two instructions, hiding their
/// latency takes more chains than there are registers.
pub(in crate::num::kernels) const EXERCISE: usize = 16 * LANES;

#[inline]
fn multiply_add(a: f32, b: f32, sum: f32) -> f32 {
    // Only where it is one instruction; elsewhere it would be a slow library call.
    if cfg!(any(target_arch = "aarch64", target_feature = "fma")) {
        a.mul_add(b, sum)
    } else {
        a * b + sum
    }
}

pub(in crate::num::kernels) fn run<R>(work: impl FnOnce() -> R) -> R {
    work()
}

#[inline]
pub(in crate::num::kernels) fn perform<T: super::Task>(task: T) -> T::Output {
    task.perform()
}

/// Adds N columns of 8 rows from `start` on to the sums.
#[inline]
fn add<const N: usize>(lanes: &Lanes, start: usize, right: [f32; N], sums: &mut [[f32; PASS]; N]) {
    let left: &[f32; PASS] = lanes.0[start..].first_chunk().expect("rows of a panel");
    for (sums, z) in sums.iter_mut().zip(right) {
        for (sum, &b) in sums.iter_mut().zip(left) {
            *sum = multiply_add(b, z, *sum);
        }
    }
}

#[inline]
fn accumulate<const N: usize>(panel: &[Lanes], right: &[f32], stride: usize, buffer: &mut [Lanes]) {
    for start in (0..PANEL_ROWS).step_by(PASS) {
        let mut sums = [[0.0_f32; PASS]; N];
        for (j, lanes) in panel.iter().enumerate() {
            let right: &[f32; N] = right[j * stride..].first_chunk().expect("checked lengths");
            add(lanes, start, *right, &mut sums);
        }
        for (lanes, sums) in buffer.iter_mut().zip(&sums) {
            lanes.0[start..start + PASS].copy_from_slice(sums);
        }
    }
}

#[inline]
fn pair(panel: &[Lanes], sides: [(u32, &[f32]); 2], out: &mut Lanes) {
    for start in (0..PANEL_ROWS).step_by(PASS) {
        let mut sums = [[0.0_f32; PASS]; 2];
        for (j, lanes) in panel.iter().enumerate() {
            add(lanes, start, sides.map(|side| side.1[j]), &mut sums);
        }
        for (&(mask, _), sums) in sides.iter().zip(&sums) {
            for (lane, (out, &sum)) in out.0[start..].iter_mut().zip(sums).enumerate() {
                // The lane's own bit, so that a vector compares all lanes at once.
                *out = if (mask >> start) & (1 << lane) != 0 { sum } else { *out };
            }
        }
    }
}

#[inline]
fn along<const V: usize>(
    panel: &[Lanes],
    row: usize,
    right: &[f32],
    stride: usize,
    out: &mut [f32],
) {
    let mut sums = [[[0.0_f32; LANES]; V]; ROWS];
    for (j, lanes) in panel.iter().enumerate() {
        let left: &[f32; ROWS] = lanes.0[row..].first_chunk().expect("rows of a panel");
        let right = &right[j * stride..j * stride + V * LANES];
        for (sums, &left) in sums.iter_mut().zip(left) {
            for (sum, &z) in sums.as_flattened_mut().iter_mut().zip(right) {
                *sum = multiply_add(left, z, *sum);
            }
        }
    }
    for (r, sums) in sums.iter().enumerate() {
        if let Some(out) = out.get_mut(r * stride..r * stride + V * LANES) {
            out.copy_from_slice(sums.as_flattened());
        }
    }
}

pub(in crate::num::kernels) fn exercise(rounds: u64, a: f32, b: f32) -> f32 {
    // Flat and a power of two, which the compiler turns into vectors.
    let mut sums: [f32; EXERCISE] = std::array::from_fn(|i| i as f32);
    for _ in 0..rounds {
        for sum in &mut sums {
            *sum = multiply_add(*sum, a, b);
        }
    }
    sums.iter().sum()
}

drivers!();
