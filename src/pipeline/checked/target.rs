//! What a recipe's target asks for: how the error is proven, and what is left to the target.

use super::{RecipeError, ReferenceSettings, require};
use crate::pipeline::recipe::{ChooseName, FitRecipe, OutputRecipe, Recipe, TargetRecipe};

/// What a target chooses cannot be said beforehand.
pub(super) fn checked_choice(recipe: &Recipe) -> Result<(), RecipeError> {
    let family = match recipe.target.choose {
        ChooseName::Nothing => return Ok(()),
        ChooseName::Sizes => recipe.fit.family,
        ChooseName::Any => FitRecipe::default().family,
    };
    let TargetRecipe { max_error, max_bytes, max_us, max_fit_s, .. } = recipe.target;
    let stated = max_error.is_some() || max_bytes.is_some() || max_us.or(max_fit_s).is_some();
    let says =
        "without `max_error`, `max_bytes`, `max_us` or `max_fit_s` there is nothing to choose by";
    require(stated, "target.choose", name(recipe.target.choose), says)?;
    let FitRecipe { seed, include_rest, .. } = recipe.fit;
    let open = FitRecipe { family, seed, include_rest, ..FitRecipe::default() };
    let says = "it says what `target.choose` leaves to the target: leave one of them out";
    require(recipe.fit == open, "fit", name(&recipe.fit), says)?;
    let precision = OutputRecipe::default().precision;
    require(recipe.output.precision == precision, "output", name(&recipe.output), says)
}

/// A value as the recipe writes it.
fn name(value: impl serde::Serialize) -> String {
    serde_json::to_string(&value).unwrap_or_default()
}

pub(super) fn checked_reference(target: &TargetRecipe) -> Result<ReferenceSettings, RecipeError> {
    let factor = target.reference_factor;
    require(
        (8..=1024).contains(&factor),
        "target.reference_factor",
        factor,
        "it must be 8 to 1024",
    )?;
    let poses = target.reference_poses;
    require(poses >= 1, "target.reference_poses", poses, "it must be at least 1")?;
    if let Some(error) = target.max_error {
        require(
            error > 0.0 && error.is_finite(),
            "target.max_error",
            error,
            "it must be positive",
        )?;
    }
    if let Some(bytes) = target.max_bytes {
        require(bytes > 0, "target.max_bytes", bytes, "it must be positive")?;
    }
    let times = [("target.max_us", target.max_us), ("target.max_fit_s", target.max_fit_s)];
    for (field, time) in times {
        if let Some(time) = time {
            require(time > 0.0 && time.is_finite(), field, time, "it must be positive")?;
        }
    }
    Ok(ReferenceSettings { factor, poses: poses as usize, max_error: target.max_error })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::recipe::{FamilyName, PrecisionName};

    fn fault(edit: impl FnOnce(&mut Recipe)) -> Option<&'static str> {
        let mut recipe = Recipe::default();
        recipe.target.max_bytes = Some(1000);
        recipe.target.choose = ChooseName::Any;
        edit(&mut recipe);
        checked_choice(&recipe).err().map(|error| error.field)
    }

    /// A choice needs a target, and what it chooses must not be said; a family may be, where only
    /// its sizes are left open, and whether the mesh at rest goes with it.
    #[test]
    fn what_is_left_open_is_not_said() {
        assert_eq!(fault(|_| ()), None);
        assert_eq!(fault(|r| r.target.max_bytes = None), Some("target.choose"));
        assert_eq!(fault(|r| r.fit.inputs = Some(3)), Some("fit"));
        assert_eq!(fault(|r| r.fit.include_rest = true), None);
        assert_eq!(fault(|r| r.fit.family = FamilyName::Linear), Some("fit"));
        assert_eq!(fault(|r| r.output.precision = PrecisionName::I8), Some("output"));
        let sizes = |r: &mut Recipe| {
            r.fit.family = FamilyName::Linear;
            r.target.choose = ChooseName::Sizes;
        };
        assert_eq!(fault(sizes), None);
    }
}
