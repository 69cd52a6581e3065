//! What the light of a recipe may say.

use super::{RecipeError, error, require};
use crate::pipeline::has_terms;
use crate::pipeline::lit::shape;
use crate::pipeline::recipe::{Recipe, SignalName};
use crate::sh::Order;
use crate::shade::{Reflectance, brdf_of_words, light_of_words};

/// What the names of files in MERL's format end in.
const MERL_ENDING: &str = ".binary";

/// Whether pictures of what is baked can be lit so.
pub(super) fn checked_light(recipe: &Recipe) -> Result<(), RecipeError> {
    let Some(light) = &recipe.light else { return Ok(()) };
    let signal = recipe.bake.signal;
    let says = "`bake.signal` is `ao`, which meets no light: leave one of them out";
    require(signal != SignalName::Ao, "light", "given", says)?;
    let source = &light.source;
    let says = "it must be a map (.hdr, .exr), constant, directional:X,Y,Z, cone:X,Y,Z,DEGREES or \
                sphere:X,Y,Z,RADIUS";
    require(!source.is_empty(), "light.source", "empty", says)?;
    let words = Order::new(1).ok().and_then(|order| light_of_words(source, order));
    if let Some(Err(fault)) = words {
        return Err(error("light.source", format!("`{source}`, which {fault}"), says));
    }
    let turn = light.turn_degrees;
    require(turn.is_finite(), "light.turn_degrees", turn, "it must be a number of degrees")?;
    if let Some(window) = light.window {
        let sound = shape(window, recipe.bake.order).checked().is_ok();
        let size = window.size.unwrap_or_default();
        require(sound, "light.window.size", size, "it must be above 0")?;
    }
    let says = "it must be 1 to the square of `bake.order`";
    let sound =
        Order::new(recipe.bake.order).is_ok_and(|order| has_terms(order, light.terms as usize));
    require(sound, "light.terms", light.terms, says)?;
    require((1..=8).contains(&light.lobes), "light.lobes", light.lobes, "it must be 1 to 8")?;
    let Some(brdf) = &light.brdf else { return Ok(()) };
    let says = "a reflectance meets `visibility`: set `bake.signal` to it, or leave the brdf out";
    require(signal == SignalName::Visibility, "light.brdf", brdf, says)?;
    let says = "it must be lambert:ALBEDO, phong:DIFFUSE,SPECULAR,EXPONENT, ggx:F0,ALPHA or \
                ashikhmin-shirley:DIFFUSE,SPECULAR,N,N, isotropic, or a MERL file (.binary)";
    match brdf_of_words(brdf) {
        None if brdf.ends_with(MERL_ENDING) => Ok(()),
        None => Err(error("light.brdf", format!("`{brdf}`"), says)),
        Some(Err(fault)) => Err(error("light.brdf", format!("`{brdf}`, which {fault}"), says)),
        Some(Ok(read)) => require(read.is_isotropic(), "light.brdf", brdf, says),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Checked;
    use crate::pipeline::recipe::light::{LightRecipe, WindowName, WindowRecipe};

    fn check(signal: SignalName, light: LightRecipe) -> Result<(), RecipeError> {
        let mut recipe = Recipe { light: Some(light), ..Recipe::default() };
        recipe.bake.signal = signal;
        Checked::new(&recipe).map(drop)
    }

    /// Sound lights pass; each bound refuses what lies outside it, by the field's name.
    #[test]
    fn each_bound_names_its_field() {
        let base = LightRecipe::default;
        let gloss = |brdf: &str| LightRecipe { brdf: Some(brdf.to_owned()), ..base() };
        check(SignalName::Transfer, base()).expect("sound");
        check(SignalName::Visibility, gloss("ggx:0.5,0.3")).expect("sound");
        check(SignalName::Visibility, gloss("gold-metallic.binary")).expect("sound");
        let map = LightRecipe { source: "sky.hdr".into(), ..base() };
        check(SignalName::Transfer, map).expect("sound");
        let refused = |signal, light| check(signal, light).expect_err("refused").field;
        let transfer = |light| refused(SignalName::Transfer, light);
        let visibility = |light| refused(SignalName::Visibility, light);
        assert_eq!(refused(SignalName::Ao, base()), "light");
        assert_eq!(transfer(LightRecipe { source: String::new(), ..base() }), "light.source");
        assert_eq!(transfer(LightRecipe { source: "cone:1".into(), ..base() }), "light.source");
        assert_eq!(
            transfer(LightRecipe { turn_degrees: f64::NAN, ..base() }),
            "light.turn_degrees"
        );
        let window = Some(WindowRecipe { kind: WindowName::Hann, size: Some(-1.0) });
        assert_eq!(transfer(LightRecipe { window, ..base() }), "light.window.size");
        assert_eq!(transfer(LightRecipe { terms: 0, ..base() }), "light.terms");
        assert_eq!(transfer(LightRecipe { terms: 37, ..base() }), "light.terms");
        assert_eq!(transfer(LightRecipe { lobes: 9, ..base() }), "light.lobes");
        assert_eq!(transfer(gloss("ggx:0.5,0.3")), "light.brdf");
        assert_eq!(visibility(gloss("ggx:0.5,0.3,0.1")), "light.brdf");
        assert_eq!(visibility(gloss("ggx:0.5")), "light.brdf");
        assert_eq!(visibility(gloss("velvet")), "light.brdf");
    }
}
