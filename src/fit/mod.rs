//! Rank 10. Model families fitted to a training set.
//!
//! [`fit`] streams a [`Training`] set by blocks of points and gives the decoder of one family:
//! the mean, a ridge on all pose parameters (`linear`), or a ridge between the principal
//! components of poses and of outputs (`pca-linear`), with the regularisation α that predicts
//! left-out poses or clips best.
//!
//! *Invariant:* a fit sees training poses only; [`Training`] holds no others.
//! *Invariant:* the same data and settings give the same bytes for any number of threads: blocks
//! depend on the sizes of the data alone and are combined in their order.

mod clustered;
mod design;
mod error;
mod folds;
mod frame;
mod freedom;
mod geometry;
mod greedy_split;
mod k_means;
mod leave_out;
mod linear;
mod mean;
mod mean_shift;
mod moments;
mod multilinear;
mod nearby;
mod neurons;
mod noise;
mod occluder;
mod output_basis;
mod output_parts;
mod pca_linear;
mod point_clusters;
mod report;
mod ridge;
mod shared;
mod sketch;
mod source;
mod sphere_set;
mod still;
mod tall_qr;
mod tangent_frame;

pub use clustered::{ClusteredSizes, Kept};
pub use error::Error;
pub use geometry::Geometry;
pub use multilinear::{MultilinearSizes, PointClusters};
pub use occluder::Inscribed;
pub use report::{FitReport, OccluderReport};
pub use shared::{Largest, Shared};
pub use sphere_set::sphere_set;

use crate::dataset::Training;
use crate::model::{Decoder, Frame, Occluders, TrainingSummary};
use report::Clock;
use source::Source;

/// A model family and its sizes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Family {
    /// The mean over the training poses.
    Mean,
    /// Ridge on all pose parameters.
    Linear,
    /// Ridge between principal components.
    PcaLinear {
        /// Pose dimensions, from 1 to the rank of the centred parameters.
        inputs: usize,
        /// Output dimensions, from 1 to the rank of the rows of all poses and coefficients.
        outputs: usize,
    },
    /// As `PcaLinear`, with the fewest dimensions that retain enough on one side or on both.
    PcaRetaining {
        /// Of the variance of the pose parameters.
        inputs: Kept,
        /// Of the variance of the outputs over the poses. The basis holds their mean too, for which it may
        /// need as many more dimensions as there are coefficients.
        outputs: Kept,
    },
    /// Ridges around several poses, blended (AO07).
    Multilinear(MultilinearSizes),
    /// Small maps of the pose for each cluster of points (RPO09).
    Clustered(ClusteredSizes),
}

/// How the regularisation α is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ridge {
    /// Least error on poses left out one at a time.
    LeaveOneOut,
    /// Least error on clips left out one at a time, since neighbouring frames are nearly copies;
    /// with a single clip, on its contiguous quarters.
    LeaveOneClipOut,
    /// This α, in the units of the parameters' singular values, at least 0. For the weights of occluders the
    /// same number is [`OccluderReport::penalty`].
    Fixed(f64),
}

/// The motion that a model is meant for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum On {
    /// Poses that are not in the training set: α as [`Ridge`] says.
    Novel,
    /// The training poses themselves: compression, no regularisation. The weights of occluders, whose features
    /// are seldom independent, keep the least penalty that is tried for others.
    Trained,
}

/// What to fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Family and sizes; P(8,22) by default.
    pub family: Family,
    /// The frame in which coefficients are modelled; each point's bone by default.
    pub frame: Frame,
    /// How α is chosen; by clips left out, by default, and for the weights of occluders in any case but
    /// [`Ridge::Fixed`].
    pub ridge: Ridge,
    /// What the model is for; novel motion by default.
    pub on: On,
    /// Whether the unshadowed signal of the posed normal is taken out of the data first, so that
    /// only what occlusion takes away is learned; not by default. Needs the posed mesh.
    pub unshadowed: bool,
    /// How many spheres on the bones explain what they can before the family learns the rest;
    /// none by default. Needs the posed mesh.
    pub spheres: Option<usize>,
    /// Groups of spheres that the points of a bone tell apart, at most; 12 by default.
    pub groups: usize,
    /// Directions in which the union of what are then ellipsoids is looked at, a multiple of 16; 0,
    /// the default, for the sum of what spheres block.
    pub directions: usize,
    /// For [`Family::Linear`], the distance over which the prior deviation of a joint's weights falls by e, as
    /// a share of the diagonal of the mesh at rest; none by default. Needs the posed mesh.
    pub local: Option<f64>,
    /// Seed of the randomised decomposition, 1 by default.
    pub seed: u64,
    /// Steps of an optimiser that has no closed form (`tanh`), at most; 1000 by default.
    pub steps: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            family: Family::PcaLinear { inputs: 8, outputs: 22 },
            frame: Frame::Bone,
            ridge: Ridge::LeaveOneClipOut,
            on: On::Novel,
            unshadowed: false,
            spheres: None,
            groups: 12,
            directions: 0,
            local: None,
            seed: 1,
            steps: 1000,
        }
    }
}

impl Settings {
    /// Whether the fit looks at the posed mesh.
    #[must_use]
    pub fn looks_at_mesh(&self) -> bool {
        let learns = self.unshadowed || self.spheres.is_some() || self.local.is_some();
        learns || self.frame == Frame::Tangent
    }
}

/// A fitted decoder and what is known about it.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The numbers of the model.
    pub decoder: Decoder,
    /// What spheres on the bones block, where they were asked for.
    pub occluders: Option<Occluders>,
    /// The cloud of training poses, for the distance to it.
    pub training: TrainingSummary,
    /// How the fit went.
    pub report: FitReport,
}

/// Fits one family to a training set.
///
/// Memory beyond the model, whatever the number of points that the data set has: about 40 MiB per
/// thread, at most 256 MiB of bone rotations, and for `pca-linear` with k = output dimensions + 16
/// (at least 116) 12 bytes × poses × coefficients × k and 24 bytes × points × k.
///
/// # Errors
/// Data that cannot be read or are not finite, sizes that the data do not have, an α that is no
/// number; each with the evidence. Settings that need the posed mesh: [`Error::NeedsGeometry`].
pub fn fit(training: &Training<'_>, settings: &Settings) -> Result<Fitted, Error> {
    fit_posed(training, settings, None)
}

/// [`fit`] with the posed mesh, for settings that ask for it.
///
/// # Errors
/// As [`fit`].
///
/// # Panics
/// If the geometry has another number of points or poses than the training set.
pub fn fit_posed(
    training: &Training<'_>,
    settings: &Settings,
    geometry: Option<&Geometry<'_>>,
) -> Result<Fitted, Error> {
    fit_shared(training, settings, geometry, &Shared::default())
}

/// [`fit_posed`] that takes from earlier fits of the same training set what they have in common
/// with it, and leaves its own to later ones. Sizes change nothing but the sketch that the basis
/// of `pca-linear` is found from.
///
/// # Errors
/// As [`fit`].
///
/// # Panics
/// As [`fit_posed`].
pub fn fit_shared(
    training: &Training<'_>,
    settings: &Settings,
    geometry: Option<&Geometry<'_>>,
    shared: &Shared,
) -> Result<Fitted, Error> {
    check(settings)?;
    let mut clock = Clock::start();
    if let Some(geometry) = geometry {
        assert_eq!(geometry.poses.len(), training.poses(), "poses of the geometry");
        assert_eq!(geometry.points.count(), training.points(), "points of the geometry");
    }
    let mut source = Source::new(training, settings.frame, geometry)?;
    if settings.on == On::Trained {
        source.keep_noise();
    }
    let explained = explain(&mut source, training, settings, geometry, shared)?;
    if explained.is_some() {
        clock.lap("occluders_s");
    }
    let names = training.parameter_names();
    let design = shared
        .design(names, || design::Design::new(training.parameters(), names, training.poses()))?;
    let design = &*design;
    clock.lap("pose_svd_s");
    let folds = shared.folds(names, ridge::Regression::kind(settings), || {
        ridge::Regression::folds_of(design, training.clips(), settings)
    })?;
    let regression = ridge::Regression::with_folds(design, folds, settings);
    let mut fitted = match settings.family {
        Family::Mean => mean::fit(&source, design, &mut clock)?,
        Family::Linear => match settings.local {
            None => linear::fit(&source, &regression, &mut clock)?,
            Some(share) => {
                let geometry = geometry.ok_or(Error::NeedsGeometry)?;
                nearby::fit(training, design, geometry, (share, settings), &mut clock)?
            }
        },
        Family::PcaLinear { inputs, outputs } => {
            let sizes = (Kept::Count(inputs), Kept::Count(outputs));
            pca_linear::fit(&source, &regression, sizes, (settings, shared), &mut clock)?
        }
        Family::PcaRetaining { inputs, outputs } => {
            let sizes = (inputs, outputs);
            pca_linear::fit(&source, &regression, sizes, (settings, shared), &mut clock)?
        }
        Family::Multilinear(sizes) => {
            let parts = (&source, training, design);
            multilinear::fit(parts, sizes, settings, shared, &mut clock)?
        }
        Family::Clustered(sizes) => {
            let parts = (&source, training, design);
            clustered::fit(parts, sizes, settings, shared, &mut clock)?
        }
    };
    if let Some((occluders, report)) = explained {
        fitted.occluders = Some(occluders);
        fitted.report.occluders = Some(report);
    }
    Ok(fitted.finish(clock))
}

/// Takes out of the source what needs no learning from poses.
fn explain<'a>(
    source: &mut Source<'a>,
    training: &'a Training<'_>,
    settings: &Settings,
    geometry: Option<&'a Geometry<'a>>,
    shared: &Shared,
) -> Result<Option<(Occluders, OccluderReport)>, Error> {
    if !settings.unshadowed && settings.spheres.is_none() {
        return Ok(None);
    }
    let geometry = geometry.ok_or(Error::NeedsGeometry)?;
    let turns = training.bone_rotations();
    let explained = occluder::Explained::new(geometry, settings, turns);
    source.explain(explained);
    let key = shared::Outputs::of(settings);
    if settings.spheres.is_none() {
        keep_rest(source, key, shared)?;
        return Ok(None);
    }
    let found = shared.placed(key, || {
        occluder::fit(source, (geometry, turns), training.clips(), settings, shared)
    })?;
    let (placed, report) = &*found;
    source.explain_further(placed.clone());
    keep_rest(source, key, shared)?;
    Ok(Some((placed.occluders.clone(), report.clone())))
}

fn keep_rest(source: &mut Source<'_>, key: shared::Outputs, shared: &Shared) -> Result<(), Error> {
    if let Some(kept) = shared.kept(key, || source.rest())? {
        source.take_rest(kept);
    }
    Ok(())
}

fn check(settings: &Settings) -> Result<(), Error> {
    if let Ridge::Fixed(found) = settings.ridge
        && !(found.is_finite() && found >= 0.0)
    {
        return Err(Error::Alpha { found });
    }
    if settings.frame == Frame::Tangent {
        for (what, is_asked) in [
            ("occluders", settings.spheres.is_some()),
            ("priors on joints", settings.local.is_some()),
        ] {
            if is_asked {
                return Err(Error::NotInTangentFrame { what });
            }
        }
    }
    if let Family::PcaRetaining { inputs, outputs } = settings.family {
        for (what, kept) in [("pose variance", inputs), ("output variance", outputs)] {
            if let Kept::Share(found) = kept
                && !(found > 0.0 && found <= 1.0)
            {
                return Err(Error::Share { what, found });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
