//! A map of light as the coefficients that a model meets.

use glam::DQuat;

use crate::model::{Model, Signal};
use crate::scene;
use crate::sh::Order;
use crate::shade::{
    self, EnvironmentMap, LIGHT_WORDS, MapFacts, ShLight, WordsError, light_of_words,
};

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
    /// Words that make no light.
    #[error("`{words}` {source}")]
    Words {
        /// What was said.
        words: String,
        /// What is wrong with it.
        source: WordsError,
    },
    /// Words that name no light.
    #[error("`{0}` is none of {LIGHT_WORDS}")]
    NoWords(String),
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

/// A map as a light of an order, turned about +Y; what was found in it, and its size.
///
/// # Errors
/// [`MapError`].
pub fn read_map(
    bytes: &[u8],
    name: &str,
    order: Order,
    turn_degrees: f64,
) -> Result<(ShLight, MapFacts, [usize; 2]), MapError> {
    let picture = scene::environment(bytes, name)?;
    let (width, height) = (picture.width, picture.height);
    let map = EnvironmentMap { width, height, texels: &picture.texels };
    let (light, facts) = map.project(order)?;
    Ok((turned(light, turn_degrees)?, facts, [width, height]))
}

/// What is to be said of a map, in sentences.
#[must_use]
pub fn map_notices(facts: &MapFacts) -> Vec<String> {
    let mut out = Vec::new();
    if facts.negative_texels > 0 {
        out.push(format!(
            "{} negative texels were taken as 0, which adds {:?} to the mean radiance",
            facts.negative_texels, facts.clamped_radiance
        ));
    }
    if facts.max_radiance == [0.0; 3] {
        out.push("the map is black".to_owned());
    }
    out
}

/// A light in words, turned about +Y.
///
/// # Errors
/// [`MapError::NoWords`], [`MapError::Words`], [`MapError::Turn`].
pub fn read_words(words: &str, order: Order, turn_degrees: f64) -> Result<ShLight, MapError> {
    match light_of_words(words, order) {
        Some(Ok(light)) => turned(light, turn_degrees),
        Some(Err(source)) => Err(MapError::Words { words: words.to_owned(), source }),
        None => Err(MapError::NoWords(words.to_owned())),
    }
}

fn turned(light: ShLight, degrees: f64) -> Result<ShLight, MapError> {
    if !degrees.is_finite() {
        return Err(MapError::Turn(degrees));
    }
    if degrees == 0.0 {
        return Ok(light);
    }
    Ok(light.rotated(DQuat::from_rotation_y(degrees.to_radians())))
}

/// A light's red, green and blue on a model, turned about +Y: n² coefficients each; for `ao`, which has
/// no direction, the mean radiance.
///
/// # Errors
/// [`MapError::Turn`].
pub fn light_on(
    model: &Model,
    light: &ShLight,
    turn_degrees: f64,
) -> Result<Vec<Vec<f32>>, MapError> {
    Ok(on(model, &turned(light.resized(model.header().sh_order()), turn_degrees)?))
}

/// The same of a light in words.
///
/// # Errors
/// As [`read_words`].
pub fn words_light(
    model: &Model,
    words: &str,
    turn_degrees: f64,
) -> Result<Vec<Vec<f32>>, MapError> {
    Ok(on(model, &read_words(words, model.header().sh_order(), turn_degrees)?))
}

/// The coefficients that a model meets.
fn on(model: &Model, light: &ShLight) -> Vec<Vec<f32>> {
    let is_ao = model.header().signal == Signal::Ao;
    let colour = |colour: &Vec<f64>| -> Vec<f32> {
        // The constant harmonic is 1/√4π.
        let mean = colour[0] / (4.0 * std::f64::consts::PI).sqrt();
        if is_ao { vec![mean as f32] } else { colour.iter().map(|&value| value as f32).collect() }
    };
    light.colours().iter().map(colour).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Negative texels and black maps are told, with the number.
    #[test]
    fn odd_maps_are_told() {
        let order = Order::new(2).expect("order");
        let told = |texels: &[[f32; 3]]| {
            let map = EnvironmentMap { width: texels.len(), height: 1, texels };
            map_notices(&map.project(order).expect("a map").1)
        };
        let negative = told(&[[1.0, -2.0, 0.5], [1.0; 3], [0.0, -1.0, 0.0]]);
        assert!(
            negative.len() == 1 && negative[0].starts_with("2 negative texels"),
            "{negative:?}"
        );
        assert_eq!(told(&[[0.0; 3]]), ["the map is black"]);
        assert!(told(&[[1.0; 3]]).is_empty());
    }

    /// Words are a light on a model, turned as a map is; what they are not is said.
    #[test]
    fn words_are_lights_on_models() {
        let blob = include_bytes!("../model/blob/golden_v1.safetensors");
        let model = Model::from_bytes(blob).expect("golden");
        let n = model.header().coefficients();
        let found = words_light(&model, "cone:1,0,0,30:1,2,3", 90.0).expect("light");
        let there = words_light(&model, "cone:0,0,-1,30:1,2,3", 0.0).expect("light");
        assert_eq!((found.len(), found[0].len()), (3, n));
        for (a, b) in found.iter().flatten().zip(there.iter().flatten()) {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
        let told = |words, turn| words_light(&model, words, turn).expect_err(words).to_string();
        assert!(told("sun", 0.0).contains("`sun` is none of constant"));
        assert!(told("cone:1", 0.0).contains("`cone:1` wants 4 numbers"));
        assert!(told("constant", f64::NAN).contains("NaN degrees"));
    }
}
