//! The kernels in AVX2 with FMA, and in AVX-512F: one text for both vector widths.

use std::arch::x86_64::{
    __m256, __m512, _mm256_and_si256, _mm256_blendv_ps, _mm256_castsi256_ps, _mm256_cmpeq_epi32,
    _mm256_set1_epi32, _mm256_setr_epi32, _mm512_mask_blend_ps,
};

/// The kernels of one vector width. The last four are the tile sizes: columns of `accumulate` at
/// most, rows in the lanes that it sums at a time, rows and vectors of columns of `along`. Their
/// sums, one broadcast and the loaded vectors fit the 16 or 32 registers.
macro_rules! kernels {
    (
        $module:ident, $feature:literal, $vector:ident, $lanes:literal, $widest:literal, $rows:literal,
        $set1:ident, $load:ident, $store:ident, $fmadd:ident, $blend:path
    ) => {
        pub(super) mod $module {
            use std::arch::x86_64::{$fmadd, $load, $set1, $store, $vector};

            use super::super::{Buffer, Groups, Lanes, PANEL_ROWS, Panels, TILE};

            const LANES: usize = $lanes;
            const WIDEST: usize = $widest;
            const ROWS: usize = $rows;
            const ACROSS: usize = 2;
            /// Vectors per panel and column, and those that are summed at a time.
            const VECTORS: usize = PANEL_ROWS / LANES;
            const PASS: usize = 2;
            /// Independent chains of `exercise`: enough to hide the latency of a multiply-add,
            /// few enough for the 16 registers of AVX2.
            const CHAINS: usize = 12;
            pub(in crate::num::kernels) const EXERCISE: usize = CHAINS * LANES;

            /// Vector v of the slice.
            #[target_feature(enable = $feature)]
            #[inline]
            fn load(values: &[f32], v: usize) -> $vector {
                let part = &values[v * LANES..(v + 1) * LANES];
                // SAFETY: the slice has the length of the vector.
                unsafe { $load(part.as_ptr()) }
            }

            /// The first V vectors of the slice. A loop, since a closure that holds vectors is not
            /// inlined into the standard library's functions in every build.
            #[target_feature(enable = $feature)]
            #[inline]
            fn load_all<const V: usize>(values: &[f32]) -> [$vector; V] {
                let values = &values[..V * LANES];
                let mut vectors = [$set1(0.0); V];
                for (v, vector) in vectors.iter_mut().enumerate() {
                    *vector = load(values, v);
                }
                vectors
            }

            #[target_feature(enable = $feature)]
            #[inline]
            fn store(values: &mut [f32], v: usize, vector: $vector) {
                let part = &mut values[v * LANES..(v + 1) * LANES];
                // SAFETY: the slice has the length of the vector.
                unsafe { $store(part.as_mut_ptr(), vector) };
            }

            #[target_feature(enable = $feature)]
            #[inline]
            fn accumulate<const N: usize>(
                panel: &[Lanes],
                right: &[f32],
                stride: usize,
                buffer: &mut [Lanes],
            ) {
                for first in (0..VECTORS).step_by(PASS) {
                    let mut sums = [[$set1(0.0); PASS]; N];
                    for (j, lanes) in panel.iter().enumerate() {
                        let left = load_all::<PASS>(&lanes.0[first * LANES..]);
                        let right: &[f32; N] =
                            right[j * stride..].first_chunk().expect("checked lengths");
                        // One broadcast lives at a time: the sums need the other registers.
                        for (sums, &right) in sums.iter_mut().zip(right) {
                            let right = $set1(right);
                            for v in 0..PASS {
                                sums[v] = $fmadd(left[v], right, sums[v]);
                            }
                        }
                    }
                    for (lanes, sums) in buffer.iter_mut().zip(&sums) {
                        let out = &mut lanes.0[first * LANES..(first + PASS) * LANES];
                        for v in 0..PASS {
                            store(out, v, sums[v]);
                        }
                    }
                }
            }

            #[target_feature(enable = $feature)]
            #[inline]
            fn pair(panel: &[Lanes], sides: [(u32, &[f32]); 2], out: &mut Lanes) {
                let [(a_mask, a), (b_mask, b)] = sides;
                for first in (0..VECTORS).step_by(PASS) {
                    let mut sums = [[$set1(0.0); 2]; PASS];
                    // Side by side, so that no index is checked.
                    for ((lanes, &a), &b) in panel.iter().zip(a).zip(b) {
                        let left = load_all::<PASS>(&lanes.0[first * LANES..]);
                        let (a, b) = ($set1(a), $set1(b));
                        for v in 0..PASS {
                            sums[v][0] = $fmadd(left[v], a, sums[v][0]);
                            sums[v][1] = $fmadd(left[v], b, sums[v][1]);
                        }
                    }
                    for v in 0..PASS {
                        let at = first + v;
                        let value = $blend(a_mask >> (at * LANES), load(&out.0, at), sums[v][0]);
                        store(&mut out.0, at, $blend(b_mask >> (at * LANES), value, sums[v][1]));
                    }
                }
            }

            #[target_feature(enable = $feature)]
            #[inline]
            fn along<const V: usize>(
                panel: &[Lanes],
                row: usize,
                right: &[f32],
                stride: usize,
                out: &mut [f32],
            ) {
                let mut sums = [[$set1(0.0); V]; ROWS];
                for (j, lanes) in panel.iter().enumerate() {
                    let left: &[f32; ROWS] = lanes.0[row..].first_chunk().expect("rows of a panel");
                    let right = load_all::<V>(&right[j * stride..]);
                    for (sums, &left) in sums.iter_mut().zip(left) {
                        let left = $set1(left);
                        for v in 0..V {
                            sums[v] = $fmadd(left, right[v], sums[v]);
                        }
                    }
                }
                for (r, sums) in sums.iter().enumerate() {
                    if let Some(out) = out.get_mut(r * stride..r * stride + V * LANES) {
                        for v in 0..V {
                            store(out, v, sums[v]);
                        }
                    }
                }
            }

            #[target_feature(enable = $feature)]
            pub(in crate::num::kernels) fn run<R>(work: impl FnOnce() -> R) -> R {
                work()
            }

            #[target_feature(enable = $feature)]
            #[inline]
            pub(in crate::num::kernels) fn perform<T: super::super::Task>(task: T) -> T::Output {
                task.perform()
            }

            #[target_feature(enable = $feature)]
            pub(in crate::num::kernels) fn exercise(rounds: u64, a: f32, b: f32) -> f32 {
                let (a, b) = ($set1(a), $set1(b));
                let mut sums = [a; CHAINS];
                for (i, sum) in sums.iter_mut().enumerate() {
                    *sum = $set1(i as f32);
                }
                for _ in 0..rounds {
                    for sum in &mut sums {
                        *sum = $fmadd(*sum, a, b);
                    }
                }
                let mut total = 0.0;
                for sum in sums {
                    let mut lanes = [0.0; LANES];
                    store(&mut lanes, 0, sum);
                    total += lanes.iter().sum::<f32>();
                }
                total
            }

            drivers!(target_feature(enable = $feature));
        }
    };
}

/// `b` in the lanes whose bits are set, `a` in the others.
#[target_feature(enable = "avx2")]
#[inline]
fn blend256(bits: u32, a: __m256, b: __m256) -> __m256 {
    let own = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    let set = _mm256_and_si256(_mm256_set1_epi32(bits as i32), own);
    _mm256_blendv_ps(a, b, _mm256_castsi256_ps(_mm256_cmpeq_epi32(set, own)))
}

/// `b` in the lanes whose bits are set, `a` in the others.
#[target_feature(enable = "avx512f")]
#[inline]
fn blend512(bits: u32, a: __m512, b: __m512) -> __m512 {
    _mm512_mask_blend_ps(bits as u16, a, b)
}

kernels!(
    avx2,
    "avx2,fma",
    __m256,
    8,
    4,
    4,
    _mm256_set1_ps,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    _mm256_fmadd_ps,
    super::blend256
);

kernels!(
    avx512,
    "avx512f",
    __m512,
    16,
    12,
    8,
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_fmadd_ps,
    super::blend512
);
