//! What a still shows, and what cannot be shown.

use super::super::EvaluateError;
use super::super::finish::{Finish, FinishError};
use crate::fit;
use crate::render::Tone;
use crate::shade::{self, MOST_LOBES, ShLight};
use crate::trace;

/// Pixels of a side of one panel, least and most.
pub const STILL_SIZES: [u32; 2] = [16, 4096];

/// The most frames of a sheet.
pub const MOST_STILL_FRAMES: usize = 64;

/// The most frames of a turn.
pub const MOST_TURN_FRAMES: usize = 240;

/// The most pixels of all panels together.
const MOST_PIXELS: usize = 64 << 20;

/// What is to be seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Still<'a> {
    /// The clip; the rest pose when absent.
    pub clip: Option<&'a str>,
    /// Seconds into the clip, a frame each; not looked at without a clip.
    pub times_s: Vec<f32>,
    /// Where from: degrees about +Y, from +Z towards +X, and degrees upwards.
    pub view: [f32; 2],
    /// Pixels across and down of one panel.
    pub size: [u32; 2],
    /// Samples of a pixel, across and down, 1 to 8.
    pub samples: u32,
    /// Rays of each sample of the truth, 2 to 65,536.
    pub rays: u32,
    /// A panel of the difference for each, which shows 1/gain as the end of the scale.
    pub gains: Vec<f32>,
    /// An environment fixed in the scene; ambient occlusion when absent.
    pub light: Option<ShLight>,
    /// A reflectance; white Lambert when absent. Beside it goes a model of visibility.
    pub brdf: Option<Finish>,
    /// Terms of the reflectance's operator on a model.
    pub terms: usize,
    /// Zonal lobes that stand for the light on a model of visibility, 1 to 8.
    pub lobes: usize,
    /// Frames of a turn about the vertical, one after another, 2 to 240; `view` is its first. The clip has
    /// one time, or one for each. A sheet when absent.
    pub turntable: Option<usize>,
    /// How light is brought within the screen's range.
    pub tone: Tone,
    /// Stops of brightness; at 0 the brightest open white surface is white.
    pub exposure_stops: f32,
}

/// Why a still cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StillError {
    /// The model's objection.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// The tracer's objection.
    #[error("frame {frame}: {source}")]
    Trace {
        /// Counted from 0.
        frame: usize,
        /// What it says.
        source: trace::Error,
    },
    /// A time outside of the clip.
    #[error("clip `{clip}` lasts from 0 to {duration_s} s, so there is no time {time_s}")]
    Time {
        /// The clip.
        clip: String,
        /// Its length.
        duration_s: f32,
        /// What was asked for.
        time_s: f32,
    },
    /// A number out of its range.
    #[error("{what} is {found}; it must be {range}")]
    Setting {
        /// Which.
        what: &'static str,
        /// Given.
        found: String,
        /// What is allowed.
        range: &'static str,
    },
    /// A reflectance that a model cannot meet.
    #[error("a reflectance meets a model of `visibility`; this one holds `{signal}`")]
    NeedsVisibility {
        /// What it holds.
        signal: &'static str,
    },
    /// What light is to be reflected by.
    #[error(transparent)]
    Finish(#[from] FinishError),
    /// A model that holds what rays do not tell.
    #[error("rays are no truth of this model: {0}")]
    Untold(&'static str),
    /// Heights that are no field.
    #[error(transparent)]
    Field(#[from] shade::Error),
    /// The spheres of a character could not be cut.
    #[error("the spheres that cast shadows: {0}")]
    Spheres(#[from] fit::Error),
    /// Ambient occlusion under a light.
    #[error("the model holds ambient occlusion, which meets no light; leave the light out")]
    AmbientOnly,
}

/// Whether every number is in its range.
pub(super) fn check(settings: &Still<'_>, with_model: bool) -> Result<(), StillError> {
    let setting = |what, found: String, range| Err(StillError::Setting { what, found, range });
    let [low, high] = STILL_SIZES;
    if let Some(side) = settings.size.iter().find(|side| !(low..=high).contains(side)) {
        return setting("a side of the picture", side.to_string(), "16 to 4096 pixels");
    }
    if !(1..=8).contains(&settings.samples) {
        return setting("samples", settings.samples.to_string(), "1 to 8 across a pixel");
    }
    if !(2..=65_536).contains(&settings.rays) {
        return setting("rays", settings.rays.to_string(), "2 to 65536");
    }
    let times = if settings.clip.is_some() { settings.times_s.len() } else { 1 };
    let frames = settings.turntable.unwrap_or(times);
    if settings.turntable.is_none() && !(1..=MOST_STILL_FRAMES).contains(&frames) {
        return setting("the number of frames", frames.to_string(), "1 to 64");
    }
    if settings.turntable.is_some()
        && !((2..=MOST_TURN_FRAMES).contains(&frames) && (times == 1 || times == frames))
    {
        let found = format!("{frames} at {times} times");
        return setting(
            "the number of frames of a turn",
            found,
            "2 to 240, at one time or one each",
        );
    }
    if !(1..=MOST_LOBES).contains(&settings.lobes) {
        return setting("lobes", settings.lobes.to_string(), "1 to 8");
    }
    if let Some(gain) = settings.gains.iter().find(|gain| !(**gain >= 0.1 && **gain <= 1000.0)) {
        return setting("a gain", gain.to_string(), "0.1 to 1000");
    }
    let [yaw, pitch] = settings.view;
    if !(yaw.is_finite() && (-89.0..=89.0).contains(&pitch)) {
        return setting("the view", format!("{yaw}, {pitch}"), "any yaw and a pitch of -89 to 89");
    }
    if !settings.exposure_stops.is_finite() || settings.exposure_stops.abs() > 30.0 {
        return setting("the exposure", settings.exposure_stops.to_string(), "-30 to 30 stops");
    }
    let panels = frames * if with_model { 2 + settings.gains.len() } else { 1 };
    let pixels = panels * settings.size.iter().map(|s| *s as usize).product::<usize>();
    if pixels > MOST_PIXELS {
        return setting("the picture", format!("{pixels} pixels"), "of at most 67108864 pixels");
    }
    Ok(())
}
