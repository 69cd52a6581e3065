//! Where a light comes from: a map, or a few words.

use std::path::Path;

use anyhow::{Context, bail, ensure};
use glam::DQuat;
use serde_json::{Value, json};

use super::files;
use crate::pipeline;
use crate::scene;
use crate::sh::Order;
use crate::shade::{EnvironmentMap, ShLight};

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
    let mut read = match closed_form(source, order) {
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
        None if !Path::new(source).exists() => bail!("light `{source}` is {NEITHER}"),
        None => from_map(Path::new(source), order)?,
    };
    if turn != 0.0 {
        read.light = read.light.rotated(DQuat::from_rotation_y(turn.to_radians()));
    }
    Ok(read)
}

/// What a word is that names no light.
const NEITHER: &str = "no file, and none of constant, directional:X,Y,Z, cone:X,Y,Z,DEGREES and \
     sphere:X,Y,Z,RADIUS";

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

/// `None` where the word before the first colon is none of ours: a file's name.
fn closed_form(source: &str, order: Order) -> Option<anyhow::Result<ShLight>> {
    let mut parts = source.split(':');
    let name = parts.next().unwrap_or_default();
    let wanted = match name {
        "constant" => 0,
        "directional" => 3,
        "cone" | "sphere" => 4,
        _ => return None,
    };
    Some((|| {
        let numbers = if wanted == 0 { Vec::new() } else { numbers(parts.next(), wanted)? };
        let colour = match parts.next() {
            None => [1.0; 3],
            given => <[f64; 3]>::try_from(self::numbers(given, 3)?).unwrap_or([1.0; 3]),
        };
        ensure!(parts.next().is_none(), "has too many parts");
        Ok(match (name, numbers.as_slice()) {
            ("directional", &[x, y, z]) => ShLight::directional(order, [x, y, z], colour)?,
            ("cone", &[x, y, z, degrees]) => {
                ShLight::cone(order, [x, y, z], degrees.to_radians(), colour)?
            }
            ("sphere", &[x, y, z, radius]) => ShLight::sphere(order, [x, y, z], radius, colour)?,
            _ => ShLight::constant(order, colour)?,
        })
    })())
}

/// Numbers between commas, as many as are wanted.
fn numbers(text: Option<&str>, wanted: usize) -> anyhow::Result<Vec<f64>> {
    let text = text.unwrap_or_default();
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers {
        Ok(numbers) if numbers.len() == wanted => Ok(numbers),
        _ => bail!("wants {wanted} numbers between commas where it has `{text}`"),
    }
}

fn from_map(path: &Path, order: Order) -> anyhow::Result<LightSource> {
    let bytes = pipeline::files::read(path, MOST_BYTES)?;
    let picture = scene::environment(&bytes, &path.display().to_string())?;
    let (width, height) = (picture.width, picture.height);
    let map = EnvironmentMap { width, height, texels: &picture.texels };
    let (light, facts) =
        map.project(order).with_context(|| format!("{} as a light", path.display()))?;
    let mut notices = Vec::new();
    if facts.negative_texels > 0 {
        notices.push(format!(
            "{} negative texels were taken as 0, which adds {:?} to the mean radiance",
            facts.negative_texels, facts.clamped_radiance
        ));
    }
    if facts.max_radiance == [0.0; 3] {
        notices.push("the map is black".to_owned());
    }
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

    /// Each closed form is read with and without a colour; what is wrong is said with its text.
    #[test]
    fn words_are_lights() {
        let order = Order::new(4).expect("order");
        let expected = [
            ("constant", ShLight::constant(order, [1.0; 3])),
            ("constant:1,2,3", ShLight::constant(order, [1.0, 2.0, 3.0])),
            ("directional:0, 1,0", ShLight::directional(order, [0.0, 1.0, 0.0], [1.0; 3])),
            ("cone:1,0,0,90:1,0,0", {
                let half_angle = 90_f64.to_radians();
                ShLight::cone(order, [1.0, 0.0, 0.0], half_angle, [1.0, 0.0, 0.0])
            }),
            ("sphere:0,3,0,1", ShLight::sphere(order, [0.0, 3.0, 0.0], 1.0, [1.0; 3])),
        ];
        for (source, expected) in expected {
            assert_eq!(light(source).expect(source).light, expected.expect(source), "{source}");
        }
        for (source, word) in [
            ("cone:1,0,0", "wants 4 numbers"),
            ("cone:1,0,0,x", "`1,0,0,x`"),
            ("constant:1,2", "wants 3 numbers"),
            ("constant:1,2,3:4", "too many parts"),
            ("sphere:0,1,0,2", "radius 2 at distance 1"),
            ("directional", "wants 3 numbers"),
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
