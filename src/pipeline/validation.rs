//! Candidates as they are, fitted without some training poses and measured on these.

use super::candidates::CandidateRecipe;
use super::imported::Imported;
use super::measure::predict;
use super::tradeoff::point;
use super::workbench::Tried;
use super::{Error, Part, encoding, fit_part, timing};
use crate::dataset::Dataset;
use crate::fit::Shared;
use crate::model::{Model, Precision};

/// Training data as validation data, at all points.
pub(super) struct Validation<'a> {
    dataset: Imported<'a>,
    /// Index in the data set of every training pose.
    poses: Vec<usize>,
    /// Of every training pose.
    pub(super) clips: Vec<i32>,
    noise_variance: f64,
}

impl<'a> Validation<'a> {
    pub(super) fn new(dataset: &'a Dataset) -> Result<Self, Error> {
        let splits = dataset.splits().iter().enumerate();
        let poses = splits.filter(|(_, split)| **split == 0).map(|(pose, _)| pose).collect();
        let training = dataset.training()?;
        let (clips, noise_variance) = (training.clips().to_vec(), training.noise_variance());
        Ok(Self { dataset: Imported::new(dataset), poses, clips, noise_variance })
    }

    /// A candidate's points, and their mean square errors on the poses of a fold.
    pub(super) fn try_out(
        &self,
        candidate: &CandidateRecipe,
        fold: &[usize],
        evaluate_us: Option<f64>,
    ) -> Result<Tried, Error> {
        let keep: Vec<usize> = (0..self.poses.len()).filter(|pose| !fold.contains(pose)).collect();
        let data = Part { keep: Some(&keep), ..Part::default() };
        let fitted = fit_part(&self.dataset, &candidate.recipe, &data, &Shared::default())?;
        let evaluate_us = match evaluate_us {
            Some(time) => time,
            None => timing::evaluate(&fitted.model, &self.dataset)?.all_us,
        };
        let (mut points, mut models) = (Vec::new(), Vec::new());
        for &precision in Precision::ALL {
            let (point, model) = point(candidate, &fitted, precision, evaluate_us)?;
            points.push(point);
            models.push(model);
        }
        let squares = self.mean_squares(&models, fold)?;
        Ok(Tried { points, squares, held: Vec::new() })
    }

    /// Mean square error of models of one fit on training poses, less the noise of the data.
    fn mean_squares(&self, models: &[Model], fold: &[usize]) -> Result<Vec<f64>, Error> {
        let Some(first) = models.first() else { return Ok(Vec::new()) };
        if fold.is_empty() {
            // What is there is off by its noise.
            return Ok(vec![self.noise_variance; models.len()]);
        }
        let layout = &self.dataset.header().layout;
        let numbers = layout.points * layout.row();
        let parameters = encoding::parameters(first, &self.dataset)?;
        let job = first.needs_surface().then(|| self.dataset.job()).transpose()?;
        let (mut truth, mut found) = (vec![0.0; numbers], vec![0.0; numbers]);
        let mut sums = vec![0.0_f64; models.len()];
        for &pose in fold {
            let pose = self.poses[pose];
            self.dataset.read_points(&[pose], 0..layout.points, &mut truth)?;
            let surface = job.as_ref().map(|job| job.surface(pose, first.turns_with_tangents()));
            for (model, sum) in models.iter().zip(&mut sums) {
                predict(model, &self.dataset, &parameters, (pose, surface.as_ref()), &mut found)?;
                let errors = found.iter().zip(&truth).map(|(y, t)| f64::from(y - t).powi(2));
                *sum += errors.sum::<f64>();
            }
        }
        let count = (fold.len() * numbers).max(1) as f64;
        Ok(sums.into_iter().map(|sum| sum / count - self.noise_variance).collect())
    }
}
