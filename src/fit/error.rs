//! What can go wrong with a fit, each with its evidence and what to do about it.

use crate::{dataset, num::linalg};

/// Every failure of the fit stage.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The data set could not be read.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// Nothing to learn from.
    #[error("there are no training {what}; bake with fewer clips held out, or another scene")]
    Empty {
        /// `poses`, `points` or `coefficients`.
        what: &'static str,
    },
    /// A parameter that is NaN or infinite.
    #[error(
        "pose parameter `{name}` is {found} at training pose {pose}; a damaged animation or data \
         set: bake it again, or leave its clip out"
    )]
    Parameter {
        /// Its name.
        name: String,
        /// Index among the training poses.
        pose: usize,
        /// The value.
        found: f32,
    },
    /// A coefficient that is NaN or infinite.
    #[error(
        "coefficient {coefficient} of point {point} is {found} at training pose {pose}; the data \
         set is damaged: bake it again"
    )]
    Value {
        /// Index among the training poses.
        pose: usize,
        /// Index of the point.
        point: usize,
        /// Channel × coefficients per channel + coefficient.
        coefficient: usize,
        /// The value.
        found: f32,
    },
    /// The regularisation is not a number that can be used.
    #[error("the ridge's alpha is {found}, expected a finite number of at least 0")]
    Alpha {
        /// The value.
        found: f64,
    },
    /// A share outside (0, 1].
    #[error("the share of {what} to retain is {found}, expected more than 0 and at most 1")]
    Share {
        /// `pose variance` or `output energy`.
        what: &'static str,
        /// The value.
        found: f64,
    },
    /// More pose dimensions than there are.
    #[error(
        "{asked} pose dimensions were asked for, but the {poses} training poses vary in \
         {available}; {}", remedy(*.available)
    )]
    Inputs {
        /// From the settings.
        asked: usize,
        /// Number of training poses.
        poses: usize,
        /// Rank of the centred pose parameters.
        available: usize,
    },
    /// More output dimensions than there are.
    #[error(
        "{asked} output dimensions were asked for, but the training data have {available}; {}",
        remedy(*.available)
    )]
    Outputs {
        /// From the settings.
        asked: usize,
        /// Rank of the rows of all poses and coefficients, as far as f32 tells.
        available: usize,
    },
    /// More clusters than there is anything to put into them.
    #[error("{asked} {what} were asked for; ask for 1 to {available}")]
    Clusters {
        /// `pose clusters` or `clusters of points`.
        what: &'static str,
        /// From the settings.
        asked: usize,
        /// Poses or points of the training set.
        available: usize,
    },
    /// A setting that is out of its range.
    #[error("the {what} is {found}, which is out of its range")]
    Number {
        /// Which.
        what: &'static str,
        /// The value.
        found: f64,
    },
    /// A coefficient count that is no square cannot be turned.
    #[error(
        "the data have {found} coefficients, which are no spherical harmonics of order 1 to 10 \
         and cannot be turned into other frames; fit in the root frame"
    )]
    Harmonics {
        /// Coefficients per channel.
        found: usize,
    },
    /// A bone's rotation that is none.
    #[error(
        "bone {bone} has the rotation {found:?} at training pose {pose}; the data set is damaged: \
         bake it again"
    )]
    Rotation {
        /// Index of the bone.
        bone: usize,
        /// Index among the training poses.
        pose: usize,
        /// The quaternion (x, y, z, w).
        found: [f32; 4],
    },
    /// Something that goes by bones in the tangent frame.
    #[error("{what} go by the frames of bones; fit them in the bone frame")]
    NotInTangentFrame {
        /// Such as `occluders`.
        what: &'static str,
    },
    /// Occluders, data without their unshadowed part, or the tangent frame, for a fit that does not
    /// know the mesh.
    #[error(
        "a fit with occluders, of what occlusion takes away, or in the tangent frame needs the \
         posed mesh of every training pose"
    )]
    NeedsGeometry,
    /// A factorisation failed.
    #[error("{0}; please report this with the data set")]
    NoConvergence(#[from] linalg::NoConvergence),
}

/// With no dimension at all there is still one family that works.
fn remedy(available: usize) -> String {
    match available {
        0 => "use the family `mean`".to_owned(),
        available => format!("ask for 1 to {available}"),
    }
}
