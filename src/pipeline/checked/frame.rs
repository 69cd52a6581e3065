//! The frame in which coefficients are modelled.

use super::require;
use crate::model::Frame;
use crate::pipeline::RecipeError;
use crate::pipeline::recipe::{FamilyName, FitRecipe, FrameName, NormalsRecipe, Recipe};

/// The frame of a fit.
pub(super) fn checked_frame(fit: &FitRecipe) -> Result<Frame, RecipeError> {
    let frame = match fit.frame {
        FrameName::Root => Frame::Root,
        FrameName::Bone => Frame::Bone,
        FrameName::Tangent => Frame::Tangent,
    };
    let turned = frame == Frame::Tangent && fit.family == FamilyName::Occluder;
    require(!turned, "fit.frame", frame, "occluders are weighed in the frames of bones")?;
    let turned = frame == Frame::Tangent && fit.local.is_some();
    require(!turned, "fit.frame", frame, "`fit.local` goes by the frames of bones")?;
    Ok(frame)
}

/// Whether tangents go with the normals of the bake.
pub(in crate::pipeline) fn checked_normals(recipe: &Recipe) -> Result<(), RecipeError> {
    let anew = recipe.bake.recompute_normals.as_ref().is_some_and(NormalsRecipe::is_any);
    let anew = anew && recipe.fit.frame == FrameName::Tangent;
    let expected = "it goes with normals that the skin carries, not with `bake.recompute_normals`, which is \
                    for morph targets that move none (--keep-normals)";
    require(!anew, "fit.frame", Frame::Tangent, expected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Checked;

    /// The tangent frame is one, but not of occluders, and not with normals that no skin carries.
    #[test]
    fn tangents_need_their_normals() {
        let mut recipe = Recipe::default();
        recipe.fit.frame = FrameName::Tangent;
        assert_eq!(Checked::new(&recipe).expect("a frame").fit.frame, Frame::Tangent);
        let told = |recipe: &Recipe| Checked::new(recipe).expect_err("refused").to_string();
        recipe.bake.recompute_normals = Some(NormalsRecipe::All(true));
        assert!(told(&recipe).contains("bake.recompute_normals"), "{}", told(&recipe));
        recipe.bake.recompute_normals = Some(NormalsRecipe::All(false));
        recipe.fit.local = Some(0.3);
        assert!(told(&recipe).contains("fit.local"), "{}", told(&recipe));
        recipe.fit.local = None;
        recipe.fit.family = FamilyName::Occluder;
        assert!(told(&recipe).contains("frames of bones"), "{}", told(&recipe));
    }
}
