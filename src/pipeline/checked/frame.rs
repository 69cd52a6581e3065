//! The frame in which coefficients are modelled.

use super::require;
use crate::model::Frame;
use crate::pipeline::RecipeError;
use crate::pipeline::recipe::{
    FamilyName, FitRecipe, FrameName, NormalsRecipe, Recipe, SignalName,
};

/// The frame of a fit to a signal.
pub(super) fn checked_frame(fit: &FitRecipe, signal: SignalName) -> Result<Frame, RecipeError> {
    let frame = match fit.frame {
        FrameName::Root => Frame::Root,
        FrameName::Bone => Frame::Bone,
        FrameName::Tangent => Frame::Tangent,
    };
    // Ambient occlusion has no frame; of a fit to it the root's says so.
    let has_frame = frame == Frame::Tangent || signal != SignalName::Ao;
    let turned = frame != Frame::Bone && has_frame && fit.family == FamilyName::Occluder;
    let expected = "occluders are weighed in the frames of bones: leave it out";
    require(!turned, "fit.frame", frame, expected)?;
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

    /// Occluders of harmonics are in the frames of bones and in no other; ambient occlusion has none.
    #[test]
    fn occluders_are_in_the_frames_of_bones() {
        let fault = |signal, frame| {
            let mut recipe = Recipe::default();
            recipe.bake.signal = signal;
            (recipe.fit.family, recipe.fit.frame) = (FamilyName::Occluder, frame);
            Checked::new(&recipe).err().map(|error| error.field)
        };
        for signal in [SignalName::Transfer, SignalName::Visibility] {
            assert_eq!(fault(signal, FrameName::Root), Some("fit.frame"));
            assert_eq!(fault(signal, FrameName::Bone), None);
        }
        assert_eq!(fault(SignalName::Ao, FrameName::Root), None);
    }
}
