//! The product of a tall matrix with a narrow one, which every model evaluates: one file of CPU
//! kernels, chosen once at run time. All `unsafe` outside `trace/embree/` is here.
//!
//! `out[row, column] = Σ_j left[row, j] · right[j, column]`, in f32, j ascending. The left matrix
//! (the model) is kept as [`Panels`]: blocks of 32 rows, transposed, so that a vector register
//! holds one j of 16 or 8 rows and no lane is wasted whatever the number of columns is. A tile of
//! columns is accumulated in registers, put down in a buffer of one panel, and written out from
//! there in the layout that the caller wants.
//!
//! One instruction set gives the same bytes for any choice of rows; between instruction sets the
//! results differ by rounding (the baseline of x86-64 has no fused multiply-add).

#![allow(unsafe_code, reason = "vector loads and stores, and calls that need a detected feature")]

use super::cpu::{Isa, Kind};
use super::panels::{Groups, Lanes, PANEL_ROWS, Panels};

/// Columns that are accumulated before they are written out.
const TILE: usize = 12;

/// The results of one panel: `[column][row]`.
type Buffer = [Lanes; TILE];

/// Order of the results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// `[row, column]`.
    Rows,
    /// `[column, row]`: no transposition, for engines that want one array per coefficient.
    Planar,
}

/// Calls `$function` of the instruction set's module.
macro_rules! dispatch {
    ($isa:expr, $function:ident($($argument:expr),*)) => {
        match $isa.0 {
            Kind::Baseline => baseline::$function($($argument),*),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: an `Isa` of this kind is only made where AVX2 and FMA were detected.
            Kind::Avx2 => unsafe { avx2::$function($($argument),*) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: an `Isa` of this kind is only made where AVX-512F was detected.
            Kind::Avx512 => unsafe { avx512::$function($($argument),*) },
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

/// The loops that all instruction sets share. `$accumulate::<N>(panel, right, stride, buffer)`
/// puts N columns of a panel into the buffer, `$scatter(buffer, columns, stride, out)` writes the
/// buffer's columns to 32 rows of the output.
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
            while done < count {
                accumulate::<1>(panel, &right[done..], stride, &mut buffer[done..]);
                done += 1;
            }
        }

        $(#[$attribute])?
        pub(super) fn rows(left: &Panels, right: &[f32], columns: usize, out: &mut [f32]) {
            let mut buffer = [Lanes::ZERO; TILE];
            for (p, out) in out.chunks_mut(PANEL_ROWS * columns).enumerate() {
                let panel = left.panel(p);
                for first in (0..columns).step_by(TILE) {
                    let count = TILE.min(columns - first);
                    fill(panel, &right[first..], columns, count, &mut buffer);
                    let whole = if out.len() == PANEL_ROWS * columns { count / 4 * 4 } else { 0 };
                    for c in (0..whole).step_by(4) {
                        let four = buffer[c..].first_chunk().expect("tiles are whole fours");
                        scatter(four, columns, &mut out[first + c..]);
                    }
                    for (row, out) in out.chunks_exact_mut(columns).enumerate() {
                        for c in whole..count {
                            out[first + c] = buffer[c].0[row];
                        }
                    }
                }
            }
        }

        $(#[$attribute])?
        pub(super) fn planar(left: &Panels, right: &[f32], columns: usize, out: &mut [f32]) {
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
        pub(super) fn grouped(left: &Panels, groups: &Groups, right: &[f32], out: &mut [f32]) {
            let mut buffer = [Lanes::ZERO; TILE];
            for (p, out) in out.chunks_mut(PANEL_ROWS).enumerate() {
                let panel = left.panel(p);
                for &(group, mask) in groups.of_panel(p) {
                    let right = &right[group * left.inner()..(group + 1) * left.inner()];
                    accumulate::<1>(panel, right, 1, &mut buffer);
                    for (lane, out) in out.iter_mut().enumerate() {
                        *out = if mask >> lane & 1 == 1 { buffer[0].0[lane] } else { *out };
                    }
                }
            }
        }
    };
}

/// Plain loops over arrays, which the compiler vectorises for whatever the target surely has.
mod baseline {
    use super::{Buffer, Groups, Lanes, PANEL_ROWS, Panels, TILE};

    const WIDEST: usize = 4;

    /// Rows per pass: 4 columns of 8 rows fill 8 of the 16 registers of SSE2 (and of NEON).
    const ROWS: usize = 8;

    #[inline]
    fn multiply_add(a: f32, b: f32, sum: f32) -> f32 {
        // Only where it is one instruction; elsewhere it would be a slow library call.
        if cfg!(any(target_arch = "aarch64", target_feature = "fma")) {
            a.mul_add(b, sum)
        } else {
            a * b + sum
        }
    }

    #[inline]
    fn accumulate<const N: usize>(
        panel: &[Lanes],
        right: &[f32],
        stride: usize,
        buffer: &mut [Lanes],
    ) {
        for start in (0..PANEL_ROWS).step_by(ROWS) {
            let mut sums = [[0.0_f32; ROWS]; N];
            for (j, lanes) in panel.iter().enumerate() {
                let left: &[f32; ROWS] =
                    lanes.0[start..].first_chunk().expect("rows divide panels");
                let right: &[f32; N] = right[j * stride..].first_chunk().expect("checked lengths");
                for (sums, &z) in sums.iter_mut().zip(right) {
                    for (sum, &b) in sums.iter_mut().zip(left) {
                        *sum = multiply_add(b, z, *sum);
                    }
                }
            }
            for (lanes, sums) in buffer.iter_mut().zip(&sums) {
                lanes.0[start..start + ROWS].copy_from_slice(sums);
            }
        }
    }

    fn scatter(four: &[Lanes; 4], stride: usize, out: &mut [f32]) {
        for row in 0..PANEL_ROWS {
            let values = [0, 1, 2, 3].map(|c| four[c].0[row]);
            out[row * stride..row * stride + 4].copy_from_slice(&values);
        }
    }

    drivers!();
}

/// The kernels of one x86 vector width.
macro_rules! x86 {
    (
        $module:ident, $feature:literal, $vector:ident, $lanes:literal, $widest:literal,
        $set1:ident, $load:ident, $store:ident, $fmadd:ident,
        $unpack_low:ident, $unpack_high:ident, $to_pd:ident, $to_ps:ident,
        $unpack_low_pd:ident, $unpack_high_pd:ident, $extract:ident, [$($quarter:literal),+]
    ) => {
        #[cfg(target_arch = "x86_64")]
        mod $module {
            use std::arch::x86_64::*;

            use super::{Buffer, Groups, Lanes, PANEL_ROWS, Panels, TILE};

            const WIDEST: usize = $widest;
            /// Registers per panel and column.
            const VECTORS: usize = PANEL_ROWS / $lanes;

            #[target_feature(enable = $feature)]
            #[inline]
            fn load(lanes: &Lanes, vector: usize) -> $vector {
                let part = &lanes.0[vector * $lanes..(vector + 1) * $lanes];
                // SAFETY: the slice has the length of the vector.
                unsafe { $load(part.as_ptr()) }
            }

            #[target_feature(enable = $feature)]
            #[inline]
            fn accumulate<const N: usize>(
                panel: &[Lanes],
                right: &[f32],
                stride: usize,
                buffer: &mut [Lanes],
            ) {
                let mut sums = [[$set1(0.0); VECTORS]; N];
                for (j, lanes) in panel.iter().enumerate() {
                    let right: &[f32; N] =
                        right[j * stride..].first_chunk().expect("checked lengths");
                    for v in 0..VECTORS {
                        let left = load(lanes, v);
                        for c in 0..N {
                            sums[c][v] = $fmadd(left, $set1(right[c]), sums[c][v]);
                        }
                    }
                }
                for (lanes, sums) in buffer.iter_mut().zip(&sums) {
                    for v in 0..VECTORS {
                        let part = &mut lanes.0[v * $lanes..(v + 1) * $lanes];
                        // SAFETY: the slice has the length of the vector.
                        unsafe { $store(part.as_mut_ptr(), sums[v]) };
                    }
                }
            }

            /// Transposes 4 columns × 32 rows within 128-bit lanes and writes each row's four.
            #[target_feature(enable = $feature)]
            #[inline]
            fn scatter(four: &[Lanes; 4], stride: usize, out: &mut [f32]) {
                for v in 0..VECTORS {
                    let [a, b, c, d] = [0, 1, 2, 3].map(|i| load(&four[i], v));
                    let (ab, cd) = ($to_pd($unpack_low(a, b)), $to_pd($unpack_low(c, d)));
                    let (ef, gh) = ($to_pd($unpack_high(a, b)), $to_pd($unpack_high(c, d)));
                    let rows = [
                        $unpack_low_pd(ab, cd),
                        $unpack_high_pd(ab, cd),
                        $unpack_low_pd(ef, gh),
                        $unpack_high_pd(ef, gh),
                    ];
                    for (k, row) in rows.into_iter().enumerate() {
                        let row = $to_ps(row);
                        $({
                            let start = (v * $lanes + $quarter * 4 + k) * stride;
                            let out = &mut out[start..start + 4];
                            let part = $extract::<$quarter>(row);
                            // SAFETY: the slice has the four numbers that are stored.
                            unsafe { _mm_storeu_ps(out.as_mut_ptr(), part) };
                        })+
                    }
                }
            }

            drivers!(target_feature(enable = $feature));
        }
    };
}

x86!(
    avx2,
    "avx2,fma",
    __m256,
    8,
    3,
    _mm256_set1_ps,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    _mm256_fmadd_ps,
    _mm256_unpacklo_ps,
    _mm256_unpackhi_ps,
    _mm256_castps_pd,
    _mm256_castpd_ps,
    _mm256_unpacklo_pd,
    _mm256_unpackhi_pd,
    _mm256_extractf128_ps,
    [0, 1]
);

x86!(
    avx512,
    "avx512f",
    __m512,
    16,
    12,
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_fmadd_ps,
    _mm512_unpacklo_ps,
    _mm512_unpackhi_ps,
    _mm512_castps_pd,
    _mm512_castpd_ps,
    _mm512_unpacklo_pd,
    _mm512_unpackhi_pd,
    _mm512_extractf32x4_ps,
    [0, 1, 2, 3]
);

#[cfg(test)]
#[path = "kernels_tests.rs"]
mod tests;
