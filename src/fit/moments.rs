//! What a ridge with leave-out errors needs to know of the outputs, gathered in one pass.

use super::design::Design;
use super::folds::{Folds, energy};
use crate::num::linalg::{
    Mat, MatMut, MatRef, Reborrow, ReborrowMut, multiply, multiply_add, rows_of_mut,
};

/// Second moments of the centred outputs B (p × n, n arbitrarily large), in terms of
/// C = UᵀB and of the residual at α = 0, B⊥ = B − UC.
///
/// Every residual is R(α) = B⊥ + U diag(w) C, so these moments, none of which grows with n, give
/// its energy for every α and every group of poses: they are the blocks of K = BBᵀ that count.
/// Gathering them from B⊥ rather than from K keeps their relative accuracy where a pose's leverage
/// comes close to 1 and its residual to 0.
#[derive(Debug, Clone)]
pub(super) struct Moments {
    /// CCᵀ, r × r.
    pub(super) gram: Mat<f64>,
    /// C B⊥ᵀ over the compressed rows, r × rows; 0 × 0 without folds.
    pub(super) cross: Mat<f64>,
    /// B⊥ B⊥ᵀ within each fold, k × k.
    pub(super) blocks: Vec<Mat<f64>>,
    /// Energy of each fold outside its regressors' span: residual for every α.
    pub(super) lost: Vec<f64>,
    /// Σ b².
    pub(super) total: f64,
    /// n, columns absorbed.
    pub(super) columns: usize,
}

impl Moments {
    /// All zero.
    pub(super) fn new(design: &Design, folds: Option<&Folds>) -> Self {
        let r = design.rank();
        let folds_of = folds.map_or(&[][..], |folds| &folds.folds[..]);
        Self {
            gram: Mat::zeros(r, r),
            cross: folds.map_or(Mat::zeros(0, 0), |folds| Mat::zeros(r, folds.rows)),
            blocks: folds_of.iter().map(|fold| Mat::zeros(fold.rows, fold.rows)).collect(),
            lost: vec![0.0; folds_of.len()],
            total: 0.0,
            columns: 0,
        }
    }

    /// Adds the moments of other columns. Addition is not associative: a fixed order of calls
    /// gives fixed bytes.
    pub(super) fn merge(&mut self, other: &Self) {
        self.gram += &other.gram;
        self.cross += &other.cross;
        for (block, other) in self.blocks.iter_mut().zip(&other.blocks) {
            *block += other;
        }
        for (lost, other) in self.lost.iter_mut().zip(&other.lost) {
            *lost += other;
        }
        self.total += other.total;
        self.columns += other.columns;
    }

    /// Σ over all poses of the squared residual on the training poses themselves, for the shares
    /// `left` of [`super::design::Filter::left`].
    pub(super) fn training_energy(&self, design: &Design, left: &[f64]) -> f64 {
        let explained: f64 = (0..design.rank()).map(|j| self.gram[(j, j)]).sum();
        let kept: f64 = left.iter().enumerate().map(|(j, w)| w * w * self.gram[(j, j)]).sum();
        (self.total - explained).max(0.0) + kept
    }
}

/// Everything about the regressors that absorbing outputs needs.
#[derive(Debug)]
pub(super) struct Absorber<'a> {
    folds: Option<&'a Folds>,
    /// U with its rows compressed (in the order of the poses without folds), rows × r.
    u: Mat<f64>,
}

/// Memory that is used again for every block of columns.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    rows: Vec<f64>,
}

impl<'a> Absorber<'a> {
    pub(super) fn new(design: &Design, folds: Option<&'a Folds>) -> Self {
        let u = folds.map_or_else(
            || design.u.clone(),
            |folds| {
                let mut u = Mat::zeros(folds.rows, design.rank());
                for fold in &folds.folds {
                    u.subrows_mut(fold.first_row, fold.rows).copy_from(&fold.u);
                }
                u
            },
        );
        Self { folds, u }
    }

    /// The pose that row `i` of a block given to [`Absorber::absorb`] belongs to.
    pub(super) fn pose(&self, i: usize) -> usize {
        self.folds.map_or(i, |folds| folds.order[i])
    }

    /// Adds a block of centred columns (p × n, rows in the order of [`Absorber::pose`]) to
    /// `moments`, writes `c` = UᵀB (r × n), and leaves `b` in ruins.
    pub(super) fn absorb(
        &self,
        mut b: MatMut<'_, f64>,
        mut c: MatMut<'_, f64>,
        moments: &mut Moments,
        scratch: &mut Scratch,
    ) {
        moments.total += energy(b.rb());
        moments.columns += b.ncols();
        match self.folds {
            None => {
                multiply(c.rb_mut(), self.u.transpose(), b.rb());
                multiply_add(moments.gram.as_mut(), 1.0, c.rb(), c.rb().transpose());
            }
            Some(folds) if folds.is_plain() => self.gather(folds, b.rb_mut(), c, moments),
            Some(folds) => {
                scratch.rows.resize(folds.rows * b.ncols(), 0.0);
                let mut rows = rows_of_mut(&mut scratch.rows, folds.rows, b.ncols());
                folds.compress(b.rb(), rows.rb_mut(), &mut moments.lost);
                self.gather(folds, rows, c, moments);
            }
        }
    }

    /// The moments of compressed rows.
    fn gather(
        &self,
        folds: &Folds,
        mut rows: MatMut<'_, f64>,
        mut c: MatMut<'_, f64>,
        moments: &mut Moments,
    ) {
        multiply(c.rb_mut(), self.u.transpose(), rows.rb());
        multiply_add(moments.gram.as_mut(), 1.0, c.rb(), c.rb().transpose());
        multiply_add(rows.rb_mut(), -1.0, self.u.as_ref(), c.rb());
        multiply_add(moments.cross.as_mut(), 1.0, c.rb(), rows.rb().transpose());
        for (fold, block) in folds.folds.iter().zip(&mut moments.blocks) {
            let own: MatRef<'_, f64> = rows.rb().subrows(fold.first_row, fold.rows);
            multiply_add(block.as_mut(), 1.0, own, own.transpose());
        }
    }
}
