//! QR of tall matrices in parallel: blocks of rows on their own, then their triangles together.

use rayon::prelude::*;

use crate::num::linalg::{Mat, MatRef, multiply, rows_of, rows_of_mut, thin_qr};

/// Rows in a block, at least; more for matrices with many columns, so that the second stage stays
/// small beside the first.
const ROWS: usize = 2048;

/// A = QR of a row-major matrix; Q is row-major too. Reflections keep Q orthonormal to round-off
/// whatever the rank of A. Blocks depend on the shape alone.
pub(super) fn tall_qr(a: &[f64], columns: usize) -> (Vec<f64>, Mat<f64>) {
    let rows = a.len() / columns.max(1);
    assert!(columns > 0 && rows >= columns, "{rows} x {columns} is not tall");
    let size = ROWS.max(4 * columns);
    let leaves: Vec<(Mat<f64>, Mat<f64>)> = a
        .par_chunks(size * columns)
        .map(|block| thin_qr(rows_of(block, block.len() / columns, columns)))
        .collect();
    let stacked: usize = leaves.iter().map(|(_, r)| r.nrows()).sum();
    let mut triangles = Mat::zeros(stacked, columns);
    let mut first = 0;
    for (_, r) in &leaves {
        triangles.subrows_mut(first, r.nrows()).copy_from(r);
        first += r.nrows();
    }
    let (top, r) = thin_qr(triangles.as_ref());
    let mut q = vec![0.0; rows * columns];
    let mut starts = Vec::with_capacity(leaves.len());
    leaves.iter().fold(0, |first, (q, _)| {
        starts.push(first);
        first + q.ncols()
    });
    let parts = q.par_chunks_mut(size * columns).zip(&leaves).zip(&starts);
    parts.for_each(|((out, (leaf, _)), &first)| {
        let top: MatRef<'_, f64> = top.subrows(first, leaf.ncols());
        multiply(rows_of_mut(out, leaf.nrows(), columns), leaf.as_ref(), top);
    });
    (q, r)
}
