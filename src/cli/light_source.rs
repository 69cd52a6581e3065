//! Where a light comes from: a map, or a few words.

use std::path::Path;

use anyhow::{Context, bail, ensure};
use glam::DQuat;
use serde_json::{Value, json};

use super::files;
use crate::pipeline;
use crate::scene;
use crate::sh::Order;
use crate::shade::{EnvironmentMap, LIGHT_WORDS, ShLight, light_of_words};

/// Bytes of a map's file: the largest map, uncompressed.
const MOST_BYTES: u64 = 512 << 20;

/// A light and what is to be said of it.
pub(super) struct LightSource {
    pub(super) light: ShLight,
    /// What a map was found to hold; null for lights in closed form.
    pub(super) map: Value,
    /// Sentences for the user.
    pub(super) notices: Vec<String>,
}

/// Reads `constant`, `directional:X,Y,Z`, `cone:X,Y,Z,DEGREES` or `sphere:X,Y,Z,RADIUS`, each with
/// `:R,G,B` after it or white, or the map or the array of that name; `turn` degrees about +Y are added.
pub(super) fn read_light(source: &str, order: Order, turn: f64) -> anyhow::Result<LightSource> {
    ensure!(turn.is_finite(), "--turn is {turn}; it must be a number of degrees");
    let mut read = match light_of_words(source, order) {
        Some(light) => LightSource {
            light: light.with_context(|| format!("light `{source}`"))?,
            map: Value::Null,
            notices: Vec::new(),
        },
        None if is_array(source) => LightSource {
            light: from_array(Path::new(source), order)?,
            map: Value::Null,
            notices: Vec::new(),
        },
        None if !Path::new(source).exists() => {
            bail!("light `{source}` is no file, and none of {LIGHT_WORDS}")
        }
        None => from_map(Path::new(source), order)?,
    };
    if turn != 0.0 {
        read.light = read.light.rotated(DQuat::from_rotation_y(turn.to_radians()));
    }
    Ok(read)
}

/// Whether a light is given by its coefficients.
pub(super) fn is_array(source: &str) -> bool {
    Path::new(source).extension().is_some_and(|suffix| suffix.eq_ignore_ascii_case("npy"))
}

/// The coefficients of one colour or three, `n` of each.
pub(super) fn read_array(path: &Path, n: usize) -> anyhow::Result<Vec<Vec<f32>>> {
    let (shape, values) = files::read_npy(path)?;
    let colours = match shape.as_slice() {
        [found] if *found == n => 1,
        [found, 3] if *found == n => 3,
        _ => {
            bail!("{} has shape {shape:?}; what it lights takes [{n}] or [{n}, 3]", path.display())
        }
    };
    let colour = |c: usize| values.iter().skip(c).step_by(colours).copied().collect();
    Ok((0..colours).map(colour).collect())
}

fn from_array(path: &Path, order: Order) -> anyhow::Result<ShLight> {
    let read = read_array(path, order.coefficients())
        .with_context(|| format!("as a light of order {}", order.get()))?;
    let finite = read.iter().flatten().all(|value| value.is_finite());
    ensure!(finite, "{} has coefficients that are no numbers", path.display());
    let colour = |c: usize| read[c % read.len()].iter().map(|&value| f64::from(value)).collect();
    Ok(ShLight::from_coefficients(order, [0, 1, 2].map(colour)))
}

fn from_map(path: &Path, order: Order) -> anyhow::Result<LightSource> {
    let bytes = pipeline::files::read(path, MOST_BYTES)?;
    let picture = scene::environment(&bytes, &path.display().to_string())?;
    let (width, height) = (picture.width, picture.height);
    let map = EnvironmentMap { width, height, texels: &picture.texels };
    let (light, facts) =
        map.project(order).with_context(|| format!("{} as a light", path.display()))?;
    let notices = pipeline::map_notices(&facts);
    let map = json!({
        "width": width,
        "height": height,
        "negative_texels": facts.negative_texels,
        "clamped_radiance": facts.clamped_radiance,
        "mean_radiance": facts.mean_radiance,
        "max_radiance": facts.max_radiance,
    });
    Ok(LightSource { light, map, notices })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(source: &str) -> anyhow::Result<LightSource> {
        read_light(source, Order::new(4).expect("order"), 0.0)
    }

    /// What is wrong is said with the words that it is wrong in; what is no light is told with what
    /// would be one.
    #[test]
    fn other_words_are_refused() {
        for (source, word) in [
            ("cone:1,0,0", "light `cone:1,0,0`: wants 4 numbers"),
            ("no-such-map.hdr", "`no-such-map.hdr` is no file, and none of constant"),
            ("sun:0,1,0", "`sun:0,1,0` is no file"),
            ("no-such.npy", "no-such.npy"),
        ] {
            let error = light(source).err().map(|error| format!("{error:#}")).unwrap_or_default();
            assert!(error.contains(word), "{source}: {error}");
        }
    }

    /// Coefficients that `light -o` wrote are the light again; of another order they are refused.
    #[test]
    fn arrays_are_lights() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a.npy");
        let values: Vec<f32> = (0..48).map(|i| i as f32).collect();
        files::write_npy(&path, &[16, 3], &values).expect("written");
        let source = path.display().to_string();
        let read = light(&source).expect("read").light;
        assert_eq!(read.coefficient(5), [15.0, 16.0, 17.0]);
        let other = read_light(&source, Order::new(3).expect("order"), 0.0).err();
        let told = format!("{:#}", other.expect("refused"));
        assert!(
            told.contains("light of order 3: ") && told.contains("takes [9] or [9, 3]"),
            "{told}"
        );
    }

    /// A quarter turn takes what came from +X to −Z.
    #[test]
    fn lights_are_turned_about_the_vertical() {
        let order = Order::new(4).expect("order");
        let turned = read_light("directional:1,0,0", order, 90.0).expect("light").light;
        let there = light("directional:0,0,-1").expect("light").light;
        for (a, b) in turned.colours()[0].iter().zip(&there.colours()[0]) {
            assert!((a - b).abs() < 1e-12);
        }
    }
}
