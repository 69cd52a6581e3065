//! The light and the reflectance of a job's pictures, read once.

use std::path::Path;
use std::sync::Arc;

use super::hash;
use super::map_light::{map_notices, read_map, read_words};
use super::recipe::Recipe;
use super::recipe::light::{LightRecipe, WindowName, WindowRecipe};
use super::{Error, MapError, files};
use crate::scene::Source;
use crate::sh::{MAX_BANDS, Order};
use crate::shade::{Material, Merl, ShLight, Window, brdf_of_words, light_of_words};

/// Bytes of a map's file: the largest map, uncompressed.
const MOST_BYTES: u64 = 512 << 20;

/// What pictures are lit and shaded by.
#[derive(Debug, Clone, PartialEq)]
pub struct Lit {
    /// The recipe's part, resolved.
    pub(super) recipe: LightRecipe,
    /// Of the largest order: a model takes as many bands as it has.
    pub(super) light: ShLight,
    pub(super) material: Option<Material>,
    /// What is to be said of both, in sentences.
    pub(super) notices: Vec<String>,
}

impl Lit {
    /// Takes the light out of a recipe, which so stays the recipe of what is baked and fitted.
    pub(super) fn take(recipe: &mut Recipe) -> Result<Option<Self>, Error> {
        let Some(mut part) = recipe.light.take() else { return Ok(None) };
        let most = Order::new(MAX_BANDS as u8).expect("the largest order is an order");
        let failed = |light: &str, source| Error::Light { light: light.to_owned(), source };
        let mut notices = Vec::new();
        let mut light = if is_words(&part.source) {
            read_words(&part.source, most, part.turn_degrees)
                .map_err(|source| failed(&part.source, source))?
        } else {
            let path = Path::new(&part.source).to_owned();
            let bytes = files::read(&path, MOST_BYTES)?;
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let read = read_map(&bytes, &name, most, part.turn_degrees);
            let (light, facts, _) = read.map_err(|source| failed(&name, source))?;
            notices
                .extend(map_notices(&facts).iter().map(|told| format!("light `{name}`: {told}")));
            part.sha256 = Some(hash::scene(&[Source { name: String::new(), bytes }]));
            part.source = name;
            light
        };
        if let Some(window) = part.window {
            let window = shape(window, recipe.bake.order).checked().map_err(MapError::Light);
            light = light.windowed(window.map_err(|source| failed(&part.source, source))?);
        }
        let material = material(&mut part)?;
        let named = part.brdf.as_deref().unwrap_or_default();
        let told = material.iter().flat_map(Material::warnings);
        notices.extend(told.map(|told| format!("reflectance `{named}`: {told}")));
        Ok(Some(Self { recipe: part, light, material, notices }))
    }
}

/// The reflectance that a light's part names, of which a file leaves its name alone and its hash.
fn material(part: &mut LightRecipe) -> Result<Option<Material>, Error> {
    let Some(source) = &part.brdf else { return Ok(None) };
    if let Some(brdf) = brdf_of_words(source) {
        // Checked words are a reflectance.
        return Ok(brdf.ok().map(Material::from));
    }
    let path = Path::new(source);
    let bytes = files::read(path, Merl::BYTES as u64)?;
    let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let merl = Merl::from_bytes(&bytes)
        .map_err(|source| Error::Reflectance { file: file.clone(), source })?;
    part.brdf_sha256 = Some(hash::scene(&[Source { name: String::new(), bytes }]));
    part.brdf = Some(file);
    Ok(Some(Material::Measured(Arc::new(merl))))
}

/// Whether a reflectance is said in words, not by a file.
#[must_use]
pub fn is_brdf_words(source: &str) -> bool {
    brdf_of_words(source).is_some()
}

/// Whether a light is said in words, not by a file.
#[must_use]
pub fn is_words(source: &str) -> bool {
    Order::new(1).is_ok_and(|order| light_of_words(source, order).is_some())
}

/// The window of a recipe for light of an order.
pub(super) fn shape(window: WindowRecipe, order: u8) -> Window {
    let width = window.size.unwrap_or(f64::from(order));
    match window.kind {
        WindowName::Hann => Window::Hann { width },
        WindowName::Lanczos => Window::Lanczos { width },
        WindowName::Laplacian => Window::Laplacian { strength: window.size.unwrap_or(0.01) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shade::Brdf;

    fn lit(part: LightRecipe) -> Result<Option<Lit>, Error> {
        let mut recipe = Recipe { light: Some(part), ..Recipe::default() };
        let taken = Lit::take(&mut recipe);
        assert_eq!(recipe, Recipe::default());
        taken
    }

    /// Words become the light of every band, turned and windowed; a map that is not there, or is none,
    /// is named by its file.
    #[test]
    fn words_and_files_are_lights() {
        let order = Order::new(10).expect("order");
        let source = "directional:1,0,0".to_owned();
        let brdf = Some("ggx:0.5,0.4".to_owned());
        let window = Some(WindowRecipe { kind: WindowName::Hann, size: Some(4.0) });
        let part =
            LightRecipe { source, brdf, window, turn_degrees: 90.0, ..LightRecipe::default() };
        let found = lit(part.clone()).expect("lit").expect("a light");
        let expected = ShLight::directional(order, [0.0, 0.0, -1.0], [1.0; 3]).expect("light");
        let expected = expected.windowed(Window::Hann { width: 4.0 });
        for (a, b) in found.light.colours()[0].iter().zip(&expected.colours()[0]) {
            assert!((a - b).abs() < 1e-12);
        }
        assert!(found.material.is_some() && found.recipe == part);
        let file = |source: &str| LightRecipe { source: source.into(), ..LightRecipe::default() };
        let told = lit(file("/nowhere/sky.hdr")).expect_err("no such file").to_string();
        assert!(told.contains("/nowhere/sky.hdr"), "{told}");
        let told = lit(file("Cargo.toml")).expect_err("no map").to_string();
        assert!(told.starts_with("light `Cargo.toml`: "), "{told}");
        let measured = |brdf: &Path| {
            let brdf = Some(brdf.display().to_string());
            lit(LightRecipe { brdf, ..LightRecipe::default() })
        };
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("paint.binary");
        let bytes = Merl::bytes_of(&Brdf::Lambert { albedo: [0.5; 3] });
        std::fs::write(&path, &bytes[..5000]).expect("written");
        let told = measured(&path).expect_err("cut off").to_string();
        assert!(told.contains("`paint.binary`") && told.contains("5000"), "{told}");
        std::fs::write(&path, bytes).expect("written");
        let found = measured(&path).expect("lit").expect("a light");
        assert!(matches!(found.material, Some(Material::Measured(_))));
        assert_eq!(found.recipe.brdf.as_deref(), Some("paint.binary"));
        assert_eq!(found.recipe.brdf_sha256.map(|hash| hash.len()), Some(64));
        assert!(found.notices.is_empty(), "{:?}", found.notices);
        let gain = LightRecipe { brdf: Some("phong:1,0.5,2".into()), ..LightRecipe::default() };
        let told = lit(gain).expect("lit").expect("a light").notices;
        assert!(
            told.len() == 1 && told[0].contains("`phong:1,0.5,2`: the reflectance makes energy")
        );
        assert_eq!(lit(LightRecipe::default()).expect("lit").expect("a light").material, None);
    }
}
