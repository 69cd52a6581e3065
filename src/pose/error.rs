//! Why no poses can be sampled.

/// One reason, with what was asked and what there is.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A clip is asked for that the scene does not have.
    #[error("there is no clip named {name:?}; {}", known_clips(.known))]
    UnknownClip {
        /// What was asked for.
        name: String,
        /// Every clip of the scene.
        known: Vec<String>,
    },
    /// Every clip is held out.
    #[error(
        "holding out {} leaves no clip to train on; hold out fewer, or none, in which case a \
         scene with one clip holds out its last quarter",
        .held_out.join(", ")
    )]
    NothingToTrain {
        /// The clips that would be held out.
        held_out: Vec<String>,
    },
    /// The rate is not a positive number.
    #[error("a sampling rate of {rate_hz} Hz is not possible; it must be a positive number")]
    Rate {
        /// What was asked for.
        rate_hz: f32,
    },
    /// The threshold of near-repeats is not a number from 0.
    #[error("a near-repeat threshold of {near_repeat} is not possible; it must be 0 or more")]
    NearRepeat {
        /// What was asked for.
        near_repeat: f32,
    },
    /// Every training frame would be held out.
    #[error("holding out every frame as interpolated leaves none to train on; use 0 or at least 2")]
    InterpolatedEvery,
    /// More poses than the bound.
    #[error(
        "sampling at {rate_hz} Hz gives more than {most} poses (clip {clip:?} lasts \
         {duration_s} s); choose fewer clips or a lower rate"
    )]
    TooManyPoses {
        /// The clip at which the bound was passed.
        clip: String,
        /// Its length, seconds.
        duration_s: f32,
        /// The rate asked for.
        rate_hz: f32,
        /// The bound.
        most: usize,
    },
    /// Limbs of meshes that have none.
    #[error(
        "poses cannot be mixed of a sequence of meshes, which has no limbs; leave out mixed poses"
    )]
    MixedSequence,
    /// More mixed poses than the bound leaves room for.
    #[error("{mixed} mixed poses beside those of the clips are more than {most}; mix fewer")]
    TooManyMixed {
        /// What was asked for.
        mixed: usize,
        /// The bound.
        most: usize,
    },
    /// The rest pose has no extent, so nothing can be measured in its size.
    #[error("the rest pose has a size of {size_m} m: it has no surface that could be lit")]
    Size {
        /// The diagonal of the bounding box, metres.
        size_m: f32,
    },
}

fn known_clips(known: &[String]) -> String {
    if known.is_empty() {
        "the scene has no clips".to_owned()
    } else {
        format!("the scene has {}", known.join(", "))
    }
}
