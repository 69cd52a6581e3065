//! What several benches are told alike.

use poselight::pipeline::recipe::Recipe;

/// Takes `--signal`, `--order`, `--rays`, `--fps`, `--most-poses`, `--choose-poses` and `--mixed-poses` into a
/// recipe; whether it was one of them.
pub(crate) fn edit(
    recipe: &mut Recipe,
    word: &str,
    value: &str,
) -> Result<bool, Box<dyn std::error::Error>> {
    match word {
        "--signal" => recipe.bake.signal = serde_json::from_value(value.into())?,
        "--order" => recipe.bake.order = value.parse()?,
        "--rays" => recipe.bake.rays = value.parse()?,
        "--fps" => recipe.poses.rate_hz = value.parse()?,
        "--most-poses" => recipe.poses.most = Some(value.parse()?),
        "--choose-poses" => recipe.poses.choice = serde_json::from_value(value.into())?,
        "--mixed-poses" => recipe.poses.mixed = value.parse()?,
        _ => return Ok(false),
    }
    Ok(true)
}
