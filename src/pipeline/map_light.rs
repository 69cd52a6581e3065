//! A map of light as the coefficients that a model meets.

use glam::DQuat;

use crate::model::{Model, Signal};
use crate::scene;
use crate::sh::Order;
use crate::shade::{self, EnvironmentMap};

/// Why a map is no light for a model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// The picture cannot be read.
    #[error(transparent)]
    Picture(#[from] scene::Error),
    /// What it holds is no light.
    #[error(transparent)]
    Light(#[from] shade::Error),
    /// The angle.
    #[error("the map cannot be turned by {0} degrees")]
    Turn(f64),
}

/// Whether a file is a map (Radiance HDR or OpenEXR) that can be read to its end.
///
/// # Errors
/// [`MapError::Picture`], [`MapError::Light`].
pub fn check_map(bytes: &[u8], name: &str) -> Result<(), MapError> {
    let picture = scene::environment(bytes, name)?;
    let (width, height) = (picture.width, picture.height);
    let map = EnvironmentMap { width, height, texels: &picture.texels };
    if let Ok(order) = Order::new(1) {
        map.project(order)?;
    }
    Ok(())
}

/// The map's red, green and blue as a light on a model, turned about +Y: n² coefficients each; for
/// `ao`, which has no direction, the mean radiance.
///
/// # Errors
/// [`MapError`].
pub fn map_light(
    model: &Model,
    bytes: &[u8],
    name: &str,
    turn_degrees: f64,
) -> Result<Vec<Vec<f32>>, MapError> {
    if !turn_degrees.is_finite() {
        return Err(MapError::Turn(turn_degrees));
    }
    let picture = scene::environment(bytes, name)?;
    let (width, height) = (picture.width, picture.height);
    let map = EnvironmentMap { width, height, texels: &picture.texels };
    let (light, facts) = map.project(model.header().sh_order())?;
    if model.header().signal == Signal::Ao {
        return Ok(facts.mean_radiance.iter().map(|&mean| vec![mean as f32]).collect());
    }
    let light = light.rotated(DQuat::from_rotation_y(turn_degrees.to_radians()));
    let colours = light.colours().iter();
    Ok(colours.map(|colour| colour.iter().map(|&value| value as f32).collect()).collect())
}
