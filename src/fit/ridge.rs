//! The ridge that the linear families share: which α, what errors, what solution.

use std::sync::Arc;

use super::design::{Design, Filter};
use super::folds::Folds;
use super::leave_out::{LeaveOut, choose, grid};
use super::moments::{Absorber, Moments};
use super::{Error, FitReport, On, Ridge, Settings};
use crate::model::TrainingSummary;

/// Columns that are absorbed at once, at most; fewer for many poses, to stay in cache.
const COLUMNS: usize = 1024;
/// Numbers in such a block of columns.
const COLUMN_NUMBERS: usize = 1 << 19;

/// The regressors, what is left out, and how α is chosen.
#[derive(Debug)]
pub(super) struct Regression<'a> {
    pub(super) design: &'a Design,
    folds: Arc<Option<Folds>>,
    /// The only α there is to try, where it is given.
    fixed: Option<f64>,
}

/// The α of choice and the errors that led to it.
#[derive(Debug)]
pub(super) struct Choice {
    pub(super) filter: Filter,
    /// (α, energy of the errors on what was left out).
    pub(super) curve: Vec<(f64, f64)>,
}

/// Energy of outputs that the regression never saw because a basis does not hold them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Unseen {
    pub(super) outside: f64,
    /// What `outside` gains where the basis has not seen the poses either.
    pub(super) optimism: Option<f64>,
}

impl<'a> Regression<'a> {
    pub(super) fn new(design: &'a Design, clips: &[i32], settings: &Settings) -> Self {
        let folds = Self::folds_of(design, clips, settings);
        Self::with_folds(design, Arc::new(folds), settings)
    }

    /// [`Regression::new`] with what [`Regression::folds_of`] gives.
    pub(super) fn with_folds(
        design: &'a Design,
        folds: Arc<Option<Folds>>,
        settings: &Settings,
    ) -> Self {
        let fixed = match (settings.on, settings.ridge) {
            (On::Trained, _) => Some(0.0),
            (On::Novel, Ridge::Fixed(alpha)) => Some(alpha),
            (On::Novel, _) => None,
        };
        Self { design, folds, fixed }
    }

    /// What is left out to choose α; nothing where nothing is chosen, and without a direction,
    /// when every fit is the mean.
    pub(super) fn folds_of(design: &Design, clips: &[i32], settings: &Settings) -> Option<Folds> {
        let asked = settings.on == On::Novel && design.rank() > 0;
        asked.then(|| Folds::new(design, clips, settings.ridge)).flatten()
    }

    /// What of the settings [`Regression::folds_of`] depends on.
    pub(super) fn kind(settings: &Settings) -> Ridge {
        // Compression leaves nothing out; no α that a user may give is negative.
        if settings.on == On::Trained { Ridge::Fixed(-1.0) } else { settings.ridge }
    }

    fn folds(&self) -> Option<&Folds> {
        (*self.folds).as_ref()
    }

    pub(super) fn absorber(&self) -> Absorber<'_> {
        Absorber::new(self.design, self.folds())
    }

    pub(super) fn moments(&self) -> Moments {
        Moments::new(self.design, self.folds())
    }

    /// How many columns to absorb at once.
    pub(super) fn columns(&self) -> usize {
        (COLUMN_NUMBERS / self.design.poses()).clamp(16, COLUMNS)
    }

    /// The α with the least error on what is left out, using the first `inputs` directions.
    /// Where not all are used, they are found anew without each group.
    pub(super) fn choose(&self, moments: &Moments, inputs: usize) -> Result<Choice, Error> {
        let alphas = self.fixed.map_or_else(|| grid(self.design), |alpha| vec![alpha]);
        let filters: Vec<Filter> = alphas.iter().map(|&alpha| Filter { alpha, inputs }).collect();
        let Some(folds) = self.folds() else {
            let alpha = self.fixed.unwrap_or(0.0);
            return Ok(Choice { filter: Filter { alpha, inputs }, curve: Vec::new() });
        };
        let leave_out = LeaveOut { design: self.design, folds, moments };
        let energies = leave_out.energies(&filters, inputs < self.design.rank())?;
        let best = choose(&energies);
        let curve = alphas.into_iter().zip(energies).collect();
        Ok(Choice { filter: filters[best].clone(), curve })
    }

    /// The cloud of poses in the first `inputs` directions; `with_directions` for families that
    /// store no projection.
    pub(super) fn summary(&self, inputs: usize, with_directions: bool) -> TrainingSummary {
        summary(self.design, inputs, with_directions)
    }

    /// For each pose the index of a group that is left out to see what a basis owes to it: what
    /// the ridge leaves out, merged to at most [`MOST_GROUPS`] groups.
    pub(super) fn coarse_groups(&self) -> Vec<usize> {
        let poses = self.design.poses();
        let mut groups = vec![0; poses];
        if let Some(folds) = self.folds() {
            let most = MOST_GROUPS.min(folds.folds.len());
            for (fold, i) in folds.folds.iter().zip(0..) {
                let group = i * most / folds.folds.len();
                for &pose in &folds.order[fold.first_pose..fold.first_pose + fold.poses] {
                    groups[pose] = group;
                }
            }
        }
        groups
    }

    /// What the report says about the regression; `columns` is the number of outputs per pose.
    pub(super) fn report(
        &self,
        choice: &Choice,
        moments: &Moments,
        columns: usize,
        unseen: Unseen,
    ) -> FitReport {
        let numbers = (self.design.poses() * columns) as f64;
        let rms = |energy: f64| ((energy + unseen.outside).max(0.0) / numbers).sqrt();
        let left_out = |energy: f64| rms(energy + unseen.optimism.unwrap_or(0.0));
        let left = choice.filter.left(&self.design.s);
        let mut notices = Vec::new();
        if self.design.rank() == 0 {
            notices.push(
                "the training poses do not vary: the model is their mean, and the family `mean` \
                 says the same in fewer bytes"
                    .to_owned(),
            );
        }
        if let (Some((largest, _)), None) = (choice.curve.last(), self.fixed)
            && *largest == choice.filter.alpha
        {
            notices.push(format!(
                "leaving out {} chose the largest alpha that was tried: the pose parameters \
                 predict what was left out hardly better than the mean does",
                self.left_out()
            ));
        }
        FitReport {
            alpha: Some(choice.filter.alpha),
            alphas: choice.curve.iter().map(|&(alpha, energy)| (alpha, left_out(energy))).collect(),
            left_out: self.left_out().to_owned(),
            training_rmse: rms(moments.training_energy(self.design, &left)),
            spread_rms: rms(moments.total),
            degrees_of_freedom: choice.filter.degrees_of_freedom(&self.design.s),
            inputs: choice.filter.inputs,
            pose_spectrum: self.design.variances(),
            output_variance_retained: 1.0,
            basis_optimism: unseen.optimism.map(|energy| energy / numbers),
            notices,
            ..FitReport::default()
        }
    }

    fn left_out(&self) -> &str {
        self.folds().map_or("", |folds| &folds.description)
    }
}

/// Groups of poses without which an output basis is found anew.
const MOST_GROUPS: usize = 4;

/// The cloud of training poses in the first `inputs` principal directions.
pub(super) fn summary(design: &Design, inputs: usize, with_directions: bool) -> TrainingSummary {
    let degrees = design.poses().saturating_sub(1).max(1) as f64;
    let directions = design.directions(inputs);
    let flat = directions.row_iter().flat_map(|row| row.iter().map(|&x| x as f32));
    TrainingSummary {
        poses: u32::try_from(design.poses()).unwrap_or(u32::MAX),
        centre: design.centre.iter().map(|&x| x as f32).collect(),
        deviations: design.s[..inputs].iter().map(|s| (s / degrees.sqrt()) as f32).collect(),
        residual_rms: design.residual_rms(inputs) as f32,
        reach: None,
        directions: if with_directions { flat.collect() } else { Vec::new() },
    }
}
