//! QR of tall matrices in parallel: blocks of rows on their own, then their triangles together.

use rayon::prelude::*;

use crate::num::linalg::{Mat, Qr, rows_of};

/// Rows in a block, at least; more for matrices with many columns, so that the second stage stays
/// small beside the first.
const ROWS: usize = 2048;

/// A = QR of a row-major matrix; Q is row-major too. Reflections keep Q orthonormal to round-off
/// whatever the rank of A. Blocks depend on the shape alone.
///
/// # Panics
/// If A has fewer rows than columns, or none.
pub(super) fn tall_qr(a: &[f64], columns: usize) -> (Vec<f64>, Mat<f64>) {
    let rows = a.len() / columns.max(1);
    assert!(columns > 0 && rows >= columns, "{rows} x {columns} is not tall");
    let size = ROWS.max(4 * columns);
    let blocks = a.par_chunks(size * columns);
    let leaves: Vec<Qr> =
        blocks.map(|block| Qr::new(rows_of(block, block.len() / columns, columns))).collect();
    let triangles: Vec<Mat<f64>> = leaves.iter().map(Qr::r).collect();
    let mut stacked = Mat::zeros(triangles.iter().map(Mat::nrows).sum(), columns);
    let mut starts = Vec::with_capacity(triangles.len());
    let mut first = 0;
    for r in &triangles {
        stacked.subrows_mut(first, r.nrows()).copy_from(r);
        starts.push(first);
        first += r.nrows();
    }
    let root = Qr::new(stacked.as_ref());
    let top = root.q();
    let mut q = vec![0.0; rows * columns];
    let parts = q.par_chunks_mut(size * columns).zip(&leaves).zip(&triangles).zip(&starts);
    parts.for_each(|(((out, leaf), r), &first)| {
        let part = leaf.q_times(top.subrows(first, r.nrows()));
        for (out, row) in out.chunks_exact_mut(columns).zip(part.row_iter()) {
            out.iter_mut().zip(row.iter()).for_each(|(out, &x)| *out = x);
        }
    });
    (q, root.r())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::linalg::rows_of;
    use crate::num::random::Stream;

    /// Proves A = QR, orthonormality and the triangle, over several blocks whose last one has
    /// fewer rows than columns, and where columns are copies of one another.
    #[test]
    fn blocks_make_one_factorisation() {
        let (rows, columns) = (2 * ROWS + 5, 9);
        let mut stream = Stream::new(1);
        let mut a: Vec<f64> = (0..rows * columns).map(|_| stream.normal()).collect();
        a.chunks_exact_mut(columns).for_each(|row| row[7] = row[2]);
        let (q, r) = tall_qr(&a, columns);
        let q = rows_of(&q, rows, columns);
        let defect = q.transpose() * q - Mat::<f64>::identity(columns, columns);
        assert!(defect.norm_max() < 1e-12);
        assert!((q * &r - rows_of(&a, rows, columns)).norm_max() < 1e-11);
        assert!((0..columns).all(|i| (0..i).all(|j| r[(i, j)] == 0.0)));
    }
}
