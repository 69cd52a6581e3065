//! The product of a tall matrix with a narrow one, which every model evaluates: CPU kernels,
//! chosen once at run time. All `unsafe` outside `trace/embree/` is here and in `kernels/x86.rs`.
//!
//! `out[row, column] = Σ_j left[row, j] · right[j, column]`, in f32, j ascending. The left matrix
//! (the model) is kept as [`Panels`]: blocks of 32 rows, transposed. Two ways through it leave no
//! lane of a vector idle whatever the number of columns is. Columns that fill whole vectors are
//! summed with the columns in the lanes and written straight to their rows; the few that are left
//! over, a single column, and the planar layout are summed with 32 rows in the lanes.
//!
//! One instruction set gives the same bytes for any choice of rows; between instruction sets the
//! results differ by rounding (the baseline of x86-64 has no fused multiply-add).

#![allow(unsafe_code, reason = "calls that need a detected instruction set")]

use super::cpu::{Isa, Kind};
use super::panels::{Groups, Lanes, PANEL_ROWS, Panels};

/// Columns that are summed over a panel before they are written out.
const TILE: usize = 12;

/// The sums of one panel: `[column][row]`.
type Buffer = [Lanes; TILE];

/// Order of the results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// `[row, column]`.
    Rows,
    /// `[column, row]`: for engines that want one array per coefficient.
    Planar,
}

/// The loops that all instruction sets share. A module that invokes this brings
/// - `WIDEST` and `accumulate::<N>(panel, right, stride, buffer)`: N columns of a panel, 32 rows
///   in the lanes; column c of j is `right[j * stride + c]`;
/// - `LANES`, `ROWS`, `ACROSS` and `along::<V>(panel, row, right, stride, out)`: V vectors of
///   `LANES` columns of the `ROWS` rows from `row` on, as far as `out` reaches;
/// - `pair(panel, sides, out)`: one column, of which two masks of rows take a right-hand side each.
macro_rules! drivers {
    ($($attribute:meta)?) => {
        /// Fills the first `count` columns of the buffer.
        $(#[$attribute])?
        #[inline]
        fn fill(panel: &[Lanes], right: &[f32], stride: usize, count: usize, buffer: &mut Buffer) {
            let mut done = 0;
            while done + WIDEST <= count {
                accumulate::<WIDEST>(panel, &right[done..], stride, &mut buffer[done..]);
                done += WIDEST;
            }
            while done + 4 <= count {
                accumulate::<4>(panel, &right[done..], stride, &mut buffer[done..]);
                done += 4;
            }
            match count - done {
                0 => {}
                1 => accumulate::<1>(panel, &right[done..], stride, &mut buffer[done..]),
                2 => accumulate::<2>(panel, &right[done..], stride, &mut buffer[done..]),
                _ => accumulate::<3>(panel, &right[done..], stride, &mut buffer[done..]),
            }
        }

        /// The columns that fill whole vectors, of the rows from `row` on that `out` holds.
        $(#[$attribute])?
        #[inline]
        fn whole_vectors(
            panel: &[Lanes],
            row: usize,
            right: &[f32],
            columns: usize,
            out: &mut [f32],
        ) {
            let vectors = columns / LANES;
            let mut done = 0;
            while done + ACROSS <= vectors {
                let at = done * LANES;
                along::<ACROSS>(panel, row, &right[at..], columns, &mut out[at..]);
                done += ACROSS;
            }
            while done < vectors {
                let at = done * LANES;
                along::<1>(panel, row, &right[at..], columns, &mut out[at..]);
                done += 1;
            }
        }

        $(#[$attribute])?
        pub(in crate::num::kernels) fn rows(left: &Panels, right: &[f32], columns: usize, out: &mut [f32]) {
            let mut buffer = [Lanes::ZERO; TILE];
            for (p, out) in out.chunks_mut(PANEL_ROWS * columns).enumerate() {
                let panel = left.panel(p);
                for (block, out) in out.chunks_mut(ROWS * columns).enumerate() {
                    whole_vectors(panel, block * ROWS, right, columns, out);
                }
                for first in (columns / LANES * LANES..columns).step_by(TILE) {
                    let count = TILE.min(columns - first);
                    fill(panel, &right[first..], columns, count, &mut buffer);
                    crate::num::kernels::scatter(&buffer[..count], columns, &mut out[first..]);
                }
            }
        }

        $(#[$attribute])?
        pub(in crate::num::kernels) fn planar(left: &Panels, right: &[f32], columns: usize, out: &mut [f32]) {
            let mut buffer = [Lanes::ZERO; TILE];
            for p in 0..left.rows().div_ceil(PANEL_ROWS) {
                let start = p * PANEL_ROWS;
                let panel = left.panel(p);
                let valid = PANEL_ROWS.min(left.rows() - start);
                for first in (0..columns).step_by(TILE) {
                    let count = TILE.min(columns - first);
                    fill(panel, &right[first..], columns, count, &mut buffer);
                    for (c, lanes) in buffer[..count].iter().enumerate() {
                        let at = (first + c) * left.rows() + start;
                        match out[at..].first_chunk_mut() {
                            Some(out) if valid == PANEL_ROWS => *out = lanes.0,
                            _ => out[at..at + valid].copy_from_slice(&lanes.0[..valid]),
                        }
                    }
                }
            }
        }

        $(#[$attribute])?
        pub(in crate::num::kernels) fn grouped(left: &Panels, groups: &Groups, right: &[f32], out: &mut [f32]) {
            for (p, out) in out.chunks_mut(PANEL_ROWS).enumerate() {
                let panel = left.panel(p);
                let side = |entry: &(usize, u32)| {
                    let right = &right[entry.0 * left.inner()..(entry.0 + 1) * left.inner()];
                    (entry.1, right)
                };
                let mut values = Lanes::ZERO;
                // Two at a time: they read the panel once and do not wait for their sums.
                for [a, b] in groups.of_panel(p) {
                    pair(panel, [side(a), side(b)], &mut values);
                }
                match out.first_chunk_mut() {
                    Some(out) => *out = values.0,
                    None => out.copy_from_slice(&values.0[..out.len()]),
                }
            }
        }
    };
}

mod baseline;
#[cfg(target_arch = "x86_64")]
mod x86;

/// Calls `$function` of the instruction set's module.
macro_rules! dispatch {
    ($isa:expr, $function:ident($($argument:expr),*)) => {
        match $isa.0 {
            Kind::Baseline => baseline::$function($($argument),*),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: an `Isa` of this kind is only made where AVX2 and FMA were detected.
            Kind::Avx2 => unsafe { x86::avx2::$function($($argument),*) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: an `Isa` of this kind is only made where AVX-512F was detected.
            Kind::Avx512 => unsafe { x86::avx512::$function($($argument),*) },
        }
    };
}

/// The product of `left` with `right` (`[inner, columns]`), into `out` in the given layout.
///
/// # Panics
/// If the lengths do not agree.
pub fn multiply(
    isa: Isa,
    left: &Panels,
    right: &[f32],
    columns: usize,
    layout: Layout,
    out: &mut [f32],
) {
    assert_eq!(right.len(), left.inner() * columns, "right-hand side");
    assert_eq!(out.len(), left.rows() * columns, "output");
    if left.inner() == 0 {
        // Empty sums; the kernels count on at least one term.
        out.fill(0.0);
    } else if columns == 1 || layout == Layout::Planar {
        dispatch!(isa, planar(left, right, columns, out));
    } else {
        dispatch!(isa, rows(left, right, columns, out));
    }
}

/// `out[row] = Σ_j left[row, j] · right[group of row, j]`: a product with one column that differs
/// between groups of rows. `right` is `[group, inner]`.
///
/// # Panics
/// If the lengths do not agree.
pub fn multiply_grouped(isa: Isa, left: &Panels, groups: &Groups, right: &[f32], out: &mut [f32]) {
    assert!(right.len() >= groups.count() * left.inner(), "right-hand sides");
    assert_eq!(out.len(), left.rows(), "output");
    assert_eq!(groups.panels(), left.rows().div_ceil(PANEL_ROWS), "groups");
    if left.inner() == 0 {
        out.fill(0.0);
        return;
    }
    dispatch!(isa, grouped(left, groups, right, out));
}

/// Runs plain loops compiled for an instruction set: whatever is inlined into `work` is. The loops
/// give the same bytes on all of them, since the compiler fuses no multiply with an add.
#[inline]
pub fn run<R>(isa: Isa, work: impl FnOnce() -> R) -> R {
    dispatch!(isa, run(work))
}

/// Plain loops that are worth an instruction set of their own. `perform` is `#[inline(always)]`, with
/// all that it calls: a closure as large as they are would not be inlined into three places.
pub trait Task {
    /// What comes of it.
    type Output;

    /// Does it.
    fn perform(self) -> Self::Output;
}

/// Performs a task compiled for an instruction set, as [`run`] does with small closures.
#[inline]
pub fn perform<T: Task>(isa: Isa, task: T) -> T::Output {
    dispatch!(isa, perform(task))
}

/// Nothing but multiply-adds in registers, in independent chains of `rounds` each: the machine's
/// own peak, which benchmarks compare with. The result only keeps it from vanishing.
#[must_use]
pub fn exercise(isa: Isa, rounds: u64, a: f32, b: f32) -> f32 {
    dispatch!(isa, exercise(rounds, a, b))
}

/// Multiply-adds of [`exercise`] per round.
#[must_use]
pub fn exercise_operations(isa: Isa) -> u64 {
    let operations = match isa.0 {
        Kind::Baseline => baseline::EXERCISE,
        #[cfg(target_arch = "x86_64")]
        Kind::Avx2 => x86::avx2::EXERCISE,
        #[cfg(target_arch = "x86_64")]
        Kind::Avx512 => x86::avx512::EXERCISE,
    };
    operations as u64
}

/// Writes columns of 32 rows to rows that are `stride` apart, as many as `out` has.
#[inline(always)]
fn scatter(columns: &[Lanes], stride: usize, out: &mut [f32]) {
    let (fours, rest) = columns.as_chunks::<4>();
    for (i, four) in fours.iter().enumerate() {
        for (block, out) in out[4 * i..].chunks_mut(4 * stride).enumerate().take(PANEL_ROWS / 4) {
            let rows = transposed(four.each_ref().map(|column| &column.0.as_chunks().0[block]));
            for (row, out) in rows.iter().zip(out.chunks_mut(stride)) {
                if let Some(out) = out.first_chunk_mut() {
                    *out = *row;
                }
            }
        }
    }
    for (i, column) in rest.iter().enumerate() {
        let first = 4 * fours.len() + i;
        for (out, value) in out[first..].iter_mut().step_by(stride).zip(&column.0) {
            *out = *value;
        }
    }
}

#[inline(always)]
fn transposed(columns: [&[f32; 4]; 4]) -> [[f32; 4]; 4] {
    std::array::from_fn(|row| columns.map(|column| column[row]))
}

#[cfg(test)]
mod tests;
