//! Which poses are left out together, and the rows that stand for them.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use super::design::Design;
use super::leave_out::Refit;
use super::{Error, Ridge};
use crate::num::linalg::{Mat, MatMut, MatRef, Qr, Reborrow, ReborrowMut, multiply};

/// Parts into which a single clip is cut where whole clips should be left out.
const PARTS_OF_ONE_CLIP: usize = 4;

/// A partition of the poses into groups that are left out together.
///
/// All that leave-one-group-out needs of a group's rows B_g is their part inside the span of its
/// own regressors, at most r + 1 rows Qᵀ_g B_g, and the energy of the rest, since the hat matrix's
/// block H_gg acts on nothing else. So a clip of a thousand frames costs as much as r + 1 poses.
#[derive(Debug)]
pub(super) struct Folds {
    pub(super) folds: Vec<Fold>,
    /// All poses, fold by fold: the order of the rows that [`Folds::compress`] takes.
    pub(super) order: Vec<usize>,
    /// Number of compressed rows.
    pub(super) rows: usize,
    /// What is left out, in words.
    pub(super) description: String,
}

/// One group.
#[derive(Debug)]
pub(super) struct Fold {
    /// First of its rows in [`Folds::order`].
    pub(super) first_pose: usize,
    /// Number of poses.
    pub(super) poses: usize,
    /// First of its compressed rows.
    pub(super) first_row: usize,
    /// Number of compressed rows, k.
    pub(super) rows: usize,
    /// Q_g, poses × k, where it compresses; the identity is not stored.
    basis: Option<Mat<f64>>,
    /// Q_gᵀ 1 / √p, k: the group's part of the regressor that is the intercept.
    pub(super) ones: Vec<f64>,
    /// Q_gᵀ U_g, k × r.
    pub(super) u: Mat<f64>,
    /// The regressors without the group, once they were needed.
    refit: OnceLock<Refit>,
}

impl Folds {
    /// Groups for `ridge` over poses that belong to `clips`; `None` where nothing can be left out.
    pub(super) fn new(design: &Design, clips: &[i32], ridge: Ridge) -> Option<Self> {
        let (groups, description) = match ridge {
            Ridge::LeaveOneOut => singles(clips.len()),
            Ridge::LeaveOneClipOut | Ridge::Fixed(_) => by_clip(clips),
        };
        (groups.len() > 1).then(|| Self::from_groups(design, &groups, description))
    }

    /// The folds of an explicit partition.
    pub(super) fn from_groups(design: &Design, groups: &[Vec<usize>], description: String) -> Self {
        let mut this = Self { folds: Vec::new(), order: Vec::new(), rows: 0, description };
        for group in groups {
            let fold = Fold::new(design, group, this.order.len(), this.rows);
            this.rows += fold.rows;
            this.order.extend_from_slice(group);
            this.folds.push(fold);
        }
        this
    }

    /// Whether every row stands for itself.
    pub(super) fn is_plain(&self) -> bool {
        self.folds.iter().all(|fold| fold.basis.is_none())
    }

    /// The regressors without fold `i`, made when first asked for: they depend on no sizes.
    pub(super) fn refit(&self, design: &Design, i: usize) -> Result<&Refit, Error> {
        let fold = &self.folds[i];
        if let Some(known) = fold.refit.get() {
            return Ok(known);
        }
        let made = Refit::new(design, self, fold)?;
        Ok(fold.refit.get_or_init(|| made))
    }

    /// `out` = the compressed rows of `b`, whose rows are poses in [`Folds::order`]; adds the
    /// energy that each fold loses to `lost`.
    pub(super) fn compress(&self, b: MatRef<'_, f64>, mut out: MatMut<'_, f64>, lost: &mut [f64]) {
        for (fold, lost) in self.folds.iter().zip(lost) {
            let rows = b.subrows(fold.first_pose, fold.poses);
            let mut compressed = out.rb_mut().subrows_mut(fold.first_row, fold.rows);
            match &fold.basis {
                None => compressed.copy_from(rows),
                Some(basis) => {
                    multiply(compressed.rb_mut(), basis.transpose(), rows);
                    *lost += energy(rows) - energy(compressed.rb());
                }
            }
        }
    }
}

impl Fold {
    fn new(design: &Design, group: &[usize], first_pose: usize, first_row: usize) -> Self {
        let (poses, rank) = (group.len(), design.rank());
        let one = 1.0 / (design.poses() as f64).sqrt();
        let regressors = Mat::from_fn(poses, rank + 1, |i, j| match j {
            0 => one,
            _ => design.u[(group[i], j - 1)],
        });
        let (basis, inside) = if poses > rank + 1 {
            let qr = Qr::new(regressors.as_ref());
            (Some(qr.q()), qr.r())
        } else {
            (None, regressors)
        };
        Self {
            first_pose,
            poses,
            first_row,
            rows: inside.nrows(),
            basis,
            ones: inside.col(0).iter().copied().collect(),
            u: inside.subcols(1, rank).to_owned(),
            refit: OnceLock::new(),
        }
    }
}

/// Σ x².
pub(super) fn energy(a: MatRef<'_, f64>) -> f64 {
    a.row_iter().map(|row| row.iter().map(|x| x * x).sum::<f64>()).sum()
}

fn singles(poses: usize) -> (Vec<Vec<usize>>, String) {
    ((0..poses).map(|i| vec![i]).collect(), format!("each of {poses} poses in turn"))
}

/// Whole clips. Neighbouring frames are nearly copies of one another, so that leaving out single
/// frames of the only clip would choose far too little regularisation: it is cut into contiguous
/// parts instead.
pub(super) fn by_clip(clips: &[i32]) -> (Vec<Vec<usize>>, String) {
    let mut groups = BTreeMap::<i32, Vec<usize>>::new();
    for (pose, &clip) in clips.iter().enumerate() {
        groups.entry(clip).or_default().push(pose);
    }
    if groups.len() > 1 {
        let count = groups.len();
        return (groups.into_values().collect(), format!("each of {count} clips in turn"));
    }
    let poses: Vec<usize> = (0..clips.len()).collect();
    let parts = PARTS_OF_ONE_CLIP.min(poses.len());
    let cut = |part: usize| part * poses.len() / parts;
    let groups: Vec<_> = (0..parts).map(|i| poses[cut(i)..cut(i + 1)].to_vec()).collect();
    (groups, format!("each of {parts} contiguous parts of the only clip in turn"))
}
