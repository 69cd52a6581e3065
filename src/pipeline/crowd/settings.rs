//! What a picture of several characters shows.

use super::StillError;
use crate::pipeline::{Finish, STILL_SIZES};
use crate::render::Tone;
use crate::shade::{MOST_LOBES, ShLight};

/// The most characters of a picture.
pub const MOST_CHARACTERS: usize = 16;

/// A character of the picture.
#[derive(Debug, Clone, PartialEq)]
pub struct CrowdPlace {
    /// Metres along +X and +Z.
    pub at: [f32; 2],
    /// About +Y, counter-clockwise seen from above.
    pub yaw_degrees: f32,
    /// A clip, and seconds into it, which repeats; the rest pose when absent.
    pub clip: Option<(String, f32)>,
}

/// What is to be seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Crowd<'a> {
    /// Where the characters stand, 1 to [`MOST_CHARACTERS`].
    pub places: Vec<CrowdPlace>,
    /// Spheres of each, 1 to 1000.
    pub spheres: usize,
    /// Vertices along a side of the floor, 3 to 1000.
    pub floor_vertices: usize,
    /// An environment fixed in the scene.
    pub light: &'a ShLight,
    /// What characters and floor reflect by; a grain runs along the limbs, and on the floor along +X.
    pub finish: Finish,
    /// Terms of the reflectance's operator.
    pub terms: usize,
    /// Zonal lobes that stand for the light, 1 to 8.
    pub lobes: usize,
    /// Where from: degrees about +Y, from +Z towards +X, and degrees upwards.
    pub view: [f32; 2],
    /// Pixels across and down of one panel.
    pub size: [u32; 2],
    /// Samples of a pixel, across and down, 1 to 8.
    pub samples: u32,
    /// Rays of each sample of the truth, 2 to 65,536.
    pub rays: u32,
    /// A panel of the difference for each.
    pub gains: Vec<f32>,
    /// How light is brought within the screen's range.
    pub tone: Tone,
    /// Stops of brightness; at 0 the brightest open white surface is white.
    pub exposure_stops: f32,
}

/// Whether every number is in its range.
pub(super) fn check(settings: &Crowd<'_>) -> Result<(), StillError> {
    let setting = |what, found: String, range| Err(StillError::Setting { what, found, range });
    let count = settings.places.len();
    if !(1..=MOST_CHARACTERS).contains(&count) {
        return setting("the number of characters", count.to_string(), "1 to 16");
    }
    let numbers = |place: &CrowdPlace| {
        let time = place.clip.as_ref().map_or(0.0, |(_, time_s)| *time_s);
        [place.at[0], place.at[1], place.yaw_degrees, time]
    };
    if settings.places.iter().flat_map(numbers).any(|x| x.is_nan() || x.abs() > 1e6) {
        return setting(
            "a place",
            "not a number, or too far".to_owned(),
            "within a million metres",
        );
    }
    if !(1..=1000).contains(&settings.spheres) {
        return setting("spheres", settings.spheres.to_string(), "1 to 1000");
    }
    if !(3..=1000).contains(&settings.floor_vertices) {
        let found = settings.floor_vertices.to_string();
        return setting("vertices along the floor", found, "3 to 1000");
    }
    let [low, high] = STILL_SIZES;
    if let Some(side) = settings.size.iter().find(|side| !(low..=high).contains(side)) {
        return setting("a side of the picture", side.to_string(), "16 to 4096 pixels");
    }
    if !(1..=8).contains(&settings.samples) || !(2..=65_536).contains(&settings.rays) {
        let found = format!("{} and {}", settings.samples, settings.rays);
        return setting("samples and rays", found, "1 to 8 across a pixel and 2 to 65536");
    }
    if !(1..=MOST_LOBES).contains(&settings.lobes) {
        return setting("lobes", settings.lobes.to_string(), "1 to 8");
    }
    let [yaw, pitch] = settings.view;
    if !(yaw.is_finite() && (-89.0..=89.0).contains(&pitch)) {
        return setting("the view", format!("{yaw}, {pitch}"), "any yaw and a pitch of -89 to 89");
    }
    if settings.gains.iter().any(|gain| !(0.1..=1000.0).contains(gain)) {
        return setting("a gain", format!("{:?}", settings.gains), "0.1 to 1000");
    }
    let stops = settings.exposure_stops;
    if stops.is_nan() || stops.abs() > 30.0 {
        return setting("the exposure", stops.to_string(), "-30 to 30 stops");
    }
    Ok(())
}
