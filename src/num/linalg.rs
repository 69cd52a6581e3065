//! The thin layer over faer: dense factorisations and products on one thread.
//!
//! *Invariant:* every function here runs on the calling thread (`Par::Seq`) in an order of
//! operations that the shapes alone decide, so that callers who divide their work into fixed
//! blocks get the same bytes for any number of threads. faer's own parallel product spins and
//! slows down where cores are few; parallelism belongs to the caller's rayon blocks.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::householder::{
    apply_block_householder_sequence_on_the_left_in_place_scratch,
    apply_block_householder_sequence_on_the_left_in_place_with_conj,
};
use faer::linalg::matmul::matmul;
use faer::linalg::qr::no_pivoting::factor::{
    qr_in_place, qr_in_place_scratch, recommended_block_size,
};
use faer::linalg::svd::{ComputeSvdVectors, svd, svd_scratch};
pub use faer::prelude::{Reborrow, ReborrowMut};
use faer::traits::ComplexField;
use faer::{Accum, Conj, Par};
pub use faer::{Mat, MatMut, MatRef};

/// An iteration that found no solution. Finite input is not known to cause it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the {what} of a {rows} x {columns} matrix did not converge")]
pub struct NoConvergence {
    /// `singular value decomposition` or `eigenvalue decomposition`.
    pub what: &'static str,
    /// Rows of the matrix.
    pub rows: usize,
    /// Columns of the matrix.
    pub columns: usize,
}

/// A = U diag(s) Vᵀ with k = min(rows, columns) terms, s descending.
///
/// Of the two signs of each pair of vectors, the one is taken that makes the entry of largest
/// magnitude in the column of V positive (the first such entry where several tie).
#[derive(Debug, Clone)]
pub struct ThinSvd {
    /// Left singular vectors, rows × k.
    pub u: Mat<f64>,
    /// Singular values, k.
    pub s: Vec<f64>,
    /// Right singular vectors, columns × k.
    pub v: Mat<f64>,
}

/// The thin singular value decomposition of a finite matrix.
///
/// # Errors
/// Where the iteration does not converge.
pub fn thin_svd(a: MatRef<'_, f64>) -> Result<ThinSvd, NoConvergence> {
    let (rows, columns) = (a.nrows(), a.ncols());
    let k = rows.min(columns);
    let (mut u, mut v) = (Mat::zeros(rows, k), Mat::zeros(columns, k));
    let mut s = Diag::zeros(k);
    if k > 0 {
        let thin = ComputeSvdVectors::Thin;
        let mut memory = MemBuffer::new(svd_scratch::<f64>(
            rows,
            columns,
            thin,
            thin,
            Par::Seq,
            faer::prelude::default(),
        ));
        svd(
            a,
            s.as_mut(),
            Some(u.as_mut()),
            Some(v.as_mut()),
            Par::Seq,
            MemStack::new(&mut memory),
            faer::prelude::default(),
        )
        .map_err(|_| NoConvergence {
            what: "singular value decomposition",
            rows,
            columns,
        })?;
    }
    for j in 0..k {
        let column: Vec<f64> = v.col(j).iter().copied().collect();
        if leading_is_negative(&column) {
            v.col_mut(j).iter_mut().for_each(|x| *x = -*x);
            u.col_mut(j).iter_mut().for_each(|x| *x = -*x);
        }
    }
    let s = s.column_vector().iter().copied().collect();
    Ok(ThinSvd { u, s, v })
}

/// Whether the entry of largest magnitude (the first of them) is negative.
fn leading_is_negative(column: &[f64]) -> bool {
    let mut leading = 0.0f64;
    for &x in column {
        if x.abs() > leading.abs() {
            leading = x;
        }
    }
    leading < 0.0
}

/// Eigenvalues, descending, and eigenvectors (columns) of a symmetric matrix, of which only the
/// lower triangle is read.
///
/// # Errors
/// Where the iteration does not converge.
///
/// # Panics
/// If the matrix is not square.
pub fn symmetric_eigen(a: MatRef<'_, f64>) -> Result<(Vec<f64>, Mat<f64>), NoConvergence> {
    let n = a.nrows();
    assert_eq!(n, a.ncols(), "a symmetric matrix is square");
    let mut vectors = Mat::zeros(n, n);
    let mut values = Diag::zeros(n);
    if n > 0 {
        let mut memory = MemBuffer::new(self_adjoint_evd_scratch::<f64>(
            n,
            ComputeEigenvectors::Yes,
            Par::Seq,
            faer::prelude::default(),
        ));
        self_adjoint_evd(
            a,
            values.as_mut(),
            Some(vectors.as_mut()),
            Par::Seq,
            MemStack::new(&mut memory),
            faer::prelude::default(),
        )
        .map_err(|_| NoConvergence {
            what: "eigenvalue decomposition",
            rows: n,
            columns: n,
        })?;
    }
    // faer sorts ascending.
    let values = values.column_vector().iter().rev().copied().collect();
    let vectors = Mat::from_fn(n, n, |i, j| vectors[(i, n - 1 - j)]);
    Ok((values, vectors))
}

/// A = QR by Householder reflections, Q kept as these: rows × k with orthonormal columns even where
/// A lacks rank, k = min(rows, columns).
#[derive(Debug, Clone)]
pub struct Qr {
    /// R above the diagonal, reflections below.
    factor: Mat<f64>,
    blocks: Mat<f64>,
}

impl Qr {
    /// Factors a finite matrix.
    #[must_use]
    pub fn new(a: MatRef<'_, f64>) -> Self {
        let (rows, columns) = (a.nrows(), a.ncols());
        let k = rows.min(columns);
        let mut factor = a.to_owned();
        if k == 0 {
            return Self { factor, blocks: Mat::zeros(0, 0) };
        }
        let block = recommended_block_size::<f64>(rows, columns);
        let mut blocks = Mat::zeros(block, k);
        let spec = faer::prelude::default();
        let mut memory =
            MemBuffer::new(qr_in_place_scratch::<f64>(rows, columns, block, Par::Seq, spec));
        let stack = MemStack::new(&mut memory);
        qr_in_place(factor.as_mut(), blocks.as_mut(), Par::Seq, stack, spec);
        Self { factor, blocks }
    }

    /// R, k × columns, upper triangular.
    #[must_use]
    pub fn r(&self) -> Mat<f64> {
        let (rows, columns) = (self.factor.nrows(), self.factor.ncols());
        let entry = |i, j| if i <= j { self.factor[(i, j)] } else { 0.0 };
        Mat::from_fn(rows.min(columns), columns, entry)
    }

    /// Q·X for a k × n matrix X.
    ///
    /// # Panics
    /// If X has not k rows.
    #[must_use]
    pub fn q_times(&self, x: MatRef<'_, f64>) -> Mat<f64> {
        let (rows, columns) = (self.factor.nrows(), self.factor.ncols());
        let k = rows.min(columns);
        assert_eq!(x.nrows(), k, "Q has {k} columns");
        let mut out = Mat::zeros(rows, x.ncols());
        out.subrows_mut(0, k).copy_from(x);
        if k == 0 || x.ncols() == 0 {
            return out;
        }
        let block = self.blocks.nrows();
        let mut memory =
            MemBuffer::new(apply_block_householder_sequence_on_the_left_in_place_scratch::<f64>(
                rows,
                block,
                x.ncols(),
            ));
        apply_block_householder_sequence_on_the_left_in_place_with_conj(
            self.factor.subcols(0, k),
            self.blocks.as_ref(),
            Conj::No,
            out.as_mut(),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        out
    }

    /// Q, rows × k.
    #[must_use]
    pub fn q(&self) -> Mat<f64> {
        let k = self.factor.nrows().min(self.factor.ncols());
        self.q_times(Mat::identity(k, k).as_ref())
    }
}

/// a·b.
///
/// # Panics
/// If the shapes do not agree.
#[must_use]
pub fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), b.ncols());
    multiply(out.as_mut(), a, b);
    out
}

/// `out` = a·b.
///
/// # Panics
/// If the shapes do not agree.
pub fn multiply<T: ComplexField>(out: MatMut<'_, T>, a: MatRef<'_, T>, b: MatRef<'_, T>) {
    matmul(out, Accum::Replace, a, b, T::one_impl(), Par::Seq);
}

/// `out` += scale·a·b.
///
/// # Panics
/// If the shapes do not agree.
pub fn multiply_add<T: ComplexField>(
    out: MatMut<'_, T>,
    scale: T,
    a: MatRef<'_, T>,
    b: MatRef<'_, T>,
) {
    matmul(out, Accum::Add, a, b, scale, Par::Seq);
}

/// A row-major slice as a matrix.
///
/// # Panics
/// If the slice has another length than rows × columns.
#[must_use]
pub fn rows_of<T>(values: &[T], rows: usize, columns: usize) -> MatRef<'_, T> {
    MatRef::from_row_major_slice(values, rows, columns)
}

/// A row-major slice as a matrix to write to.
///
/// # Panics
/// If the slice has another length than rows × columns.
#[must_use]
pub fn rows_of_mut<T>(values: &mut [T], rows: usize, columns: usize) -> MatMut<'_, T> {
    MatMut::from_row_major_slice_mut(values, rows, columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::random::Stream;

    fn random(rows: usize, columns: usize, seed: u64) -> Mat<f64> {
        let mut stream = Stream::new(seed);
        Mat::from_fn(rows, columns, |_, _| stream.normal())
    }

    fn largest(a: &Mat<f64>) -> f64 {
        a.col_iter().flat_map(|column| column.iter()).fold(0.0, |m, x| m.max(x.abs()))
    }

    fn assert_orthonormal(q: &Mat<f64>) {
        let defect = q.transpose() * q - Mat::<f64>::identity(q.ncols(), q.ncols());
        assert!(largest(&defect) < 1e-12, "defect {}", largest(&defect));
    }

    /// Proves the decomposition by its definition, on tall, wide, square, rank-deficient, constant
    /// zero and empty matrices: product, orthonormality, order and sign.
    #[test]
    fn svd_is_what_it_says() {
        let low = random(30, 3, 1) * random(3, 20, 2);
        let shapes = [random(40, 7, 3), random(7, 40, 4), random(9, 9, 5), low];
        let degenerate = [Mat::zeros(6, 4), Mat::zeros(5, 0), Mat::zeros(0, 5), random(1, 1, 6)];
        for a in shapes.iter().chain(&degenerate) {
            let ThinSvd { u, s, v } = thin_svd(a.as_ref()).unwrap();
            let scaled = Mat::from_fn(u.nrows(), s.len(), |i, j| u[(i, j)] * s[j]);
            assert!(largest(&(scaled * v.transpose() - a)) < 1e-12);
            assert!(s.windows(2).all(|pair| pair[0] >= pair[1]) && s.iter().all(|x| *x >= 0.0));
            assert_orthonormal(&u);
            assert_orthonormal(&v);
            for j in 0..s.len() {
                let column: Vec<f64> = v.col(j).iter().copied().collect();
                assert!(!leading_is_negative(&column));
            }
        }
    }

    /// Proves A·v = λ·v, orthonormal vectors and descending values, on a matrix with repeated
    /// eigenvalues too.
    #[test]
    fn eigenvectors_are_eigenvectors() {
        let half = random(12, 12, 8);
        let repeated = Mat::from_fn(5, 5, |i, j| if i == j { (i / 2) as f64 } else { 0.0 });
        for a in [&half + half.transpose(), repeated, Mat::zeros(0, 0)] {
            let (values, vectors) = symmetric_eigen(a.as_ref()).unwrap();
            let n = a.nrows();
            let scaled = Mat::from_fn(n, n, |i, j| vectors[(i, j)] * values[j]);
            assert!(largest(&(&a * &vectors - scaled)) < 1e-12);
            assert!(values.windows(2).all(|pair| pair[0] >= pair[1]));
            assert_orthonormal(&vectors);
        }
    }

    /// Proves A = QR, that R is triangular and that Q is orthonormal where A lacks rank.
    #[test]
    fn qr_keeps_orthonormality_without_rank() {
        for a in [random(50, 8, 9), random(4, 9, 10), random(20, 2, 11) * random(2, 6, 12)] {
            let qr = Qr::new(a.as_ref());
            let (q, r) = (qr.q(), qr.r());
            assert!(largest(&(&q * &r - &a)) < 1e-12);
            assert_orthonormal(&q);
            assert!((0..r.nrows()).all(|i| (0..i.min(r.ncols())).all(|j| r[(i, j)] == 0.0)));
        }
    }
}
