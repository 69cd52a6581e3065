//! How far a pose is from the training poses: whether the model extrapolates.

use std::borrow::Cow;

use super::header::field;
use super::{Error, Model, TrainingSummary};

/// Distance of a pose to the training set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance {
    /// Mahalanobis distance within the retained subspace, √Σ_k (z_k/σ_k)², over the root of its
    /// dimension: 1 is typical of the training poses, 3 far outside. 0 without a subspace.
    pub mahalanobis: f32,
    /// Length of what lies outside the retained subspace, in units of the parameters; to be
    /// compared with `training.residual_rms`.
    pub residual: f32,
}

/// The retained subspace: the encoder's directions, and an orthonormal basis of their span.
#[derive(Debug, Clone)]
pub(super) struct Subspace {
    centre: Vec<f32>,
    deviations: Vec<f32>,
    /// `[direction][parameter]`.
    directions: Vec<Vec<f64>>,
    /// Orthonormal, spanning `directions`.
    span: Vec<Vec<f64>>,
}

impl Subspace {
    /// `projection` is `[parameter, direction]`.
    ///
    /// # Errors
    /// If there is not one deviation per direction.
    pub(super) fn new(training: &TrainingSummary, projection: &[f32]) -> Result<Self, Error> {
        let (parameters, count) = (training.centre.len(), training.deviations.len());
        if projection.len() != parameters * count {
            let problem = format!(
                "{count} deviations of {parameters} parameters for {} numbers of directions",
                projection.len()
            );
            return Err(field("training.deviations", problem));
        }
        let directions: Vec<Vec<f64>> = (0..count)
            .map(|k| (0..parameters).map(|i| f64::from(projection[i * count + k])).collect())
            .collect();
        let span = orthonormal(&directions);
        let (centre, deviations) = (training.centre.clone(), training.deviations.clone());
        Ok(Self { centre, deviations, directions, span })
    }

    pub(super) fn distance(&self, parameters: &[f32]) -> Distance {
        let mut offset: Vec<f64> = parameters
            .iter()
            .zip(&self.centre)
            .map(|(&x, &c)| f64::from(x) - f64::from(c))
            .collect();
        let scaled = self.directions.iter().zip(&self.deviations);
        let square: f64 = scaled.map(|(d, &s)| (dot(d, &offset) / f64::from(s)).powi(2)).sum();
        for direction in &self.span {
            subtract(&mut offset, direction);
        }
        Distance {
            mahalanobis: (square / self.directions.len().max(1) as f64).sqrt() as f32,
            residual: dot(&offset, &offset).sqrt() as f32,
        }
    }
}

impl Model {
    /// The pose as the decoder takes it: drawn towards the centre where it lies beyond the model's
    /// reach, centre + min(1, reach/m)·(x − centre) with its Mahalanobis distance m.
    pub(super) fn held<'a>(&self, parameters: &'a [f32]) -> Cow<'a, [f32]> {
        let Some(reach) = self.header.training.reach else { return Cow::Borrowed(parameters) };
        let far = self.subspace.distance(parameters).mahalanobis;
        if far <= reach {
            return Cow::Borrowed(parameters);
        }
        // The distance may be infinite where the pose is all but so.
        let share = f64::from(reach / far);
        let drawn =
            |(&x, &c): (&f32, &f32)| (f64::from(c) + share * (f64::from(x) - f64::from(c))) as f32;
        Cow::Owned(parameters.iter().zip(&self.header.training.centre).map(drawn).collect())
    }

    /// Whether the model can tell one pose's distance from another's, and says different things of
    /// them.
    #[must_use]
    pub fn has_distance(&self) -> bool {
        self.header.family != super::Family::Mean && !self.header.training.deviations.is_empty()
    }

    /// The same model with another reach, `training.reach` of its header.
    ///
    /// # Errors
    /// A reach that is no number or negative.
    pub fn with_reach(mut self, reach: Option<f32>) -> Result<Self, Error> {
        if reach.is_some_and(|reach| !(reach.is_finite() && reach >= 0.0)) {
            return Err(field("training.reach", "it must be finite and not negative"));
        }
        self.header.training.reach = reach;
        Ok(self)
    }
}

/// Gram–Schmidt, twice over for orthogonality to round-off; dependent directions vanish. A blob
/// in f16 or i8 has directions that are not quite orthonormal.
fn orthonormal(directions: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut span: Vec<Vec<f64>> = Vec::with_capacity(directions.len());
    for direction in directions {
        let mut rest = direction.clone();
        for _ in 0..2 {
            for known in &span {
                subtract(&mut rest, known);
            }
        }
        let length = dot(&rest, &rest).sqrt();
        if length > 1e-6 * dot(direction, direction).sqrt() {
            rest.iter_mut().for_each(|x| *x /= length);
            span.push(rest);
        }
    }
    span
}

/// Removes from `x` its component along the unit vector `direction`.
fn subtract(x: &mut [f64], direction: &[f64]) {
    let along = dot(x, direction);
    for (x, d) in x.iter_mut().zip(direction) {
        *x -= along * d;
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(centre: &[f32], deviations: &[f32]) -> TrainingSummary {
        TrainingSummary {
            poses: 10,
            centre: centre.to_vec(),
            deviations: deviations.to_vec(),
            residual_rms: 0.1,
            reach: None,
            directions: Vec::new(),
        }
    }

    /// In a plane of three dimensions both parts have closed forms.
    #[test]
    fn distance_splits_into_the_plane_and_the_rest() {
        let training = summary(&[1.0, 2.0, 3.0], &[2.0, 0.5]);
        let s = std::f32::consts::FRAC_1_SQRT_2;
        // Columns (s, s, 0) and (s, −s, 0).
        let subspace = Subspace::new(&training, &[s, s, s, -s, 0.0, 0.0]).unwrap();
        let at_centre = subspace.distance(&[1.0, 2.0, 3.0]);
        assert_eq!((at_centre.mahalanobis, at_centre.residual), (0.0, 0.0));
        let far = subspace.distance(&[1.0 + s * 4.0, 2.0 + s * 4.0, 3.5]);
        assert!((far.mahalanobis - (4.0_f32 / 2.0) / 2.0_f32.sqrt()).abs() < 1e-5);
        assert!((far.residual - 0.5).abs() < 1e-6);
    }

    /// Directions that are not orthonormal span the same plane, so the residual is the same.
    #[test]
    fn residual_does_not_need_orthonormal_directions() {
        let training = summary(&[0.0; 3], &[1.0, 1.0]);
        let subspace = Subspace::new(&training, &[1.0, 1.0, 0.0, 0.1, 0.0, 0.0]).unwrap();
        assert!((subspace.distance(&[3.0, -4.0, 0.25]).residual - 0.25).abs() < 1e-6);
    }

    /// Without directions everything is residual.
    #[test]
    fn without_a_subspace_all_is_residual() {
        let subspace = Subspace::new(&summary(&[0.0; 2], &[]), &[]).unwrap();
        let distance = subspace.distance(&[3.0, 4.0]);
        assert_eq!((distance.mahalanobis, distance.residual), (0.0, 5.0));
    }
}
