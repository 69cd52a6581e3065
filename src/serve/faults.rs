//! What the stages object to, as a client is told it: at the field of the request that is at fault, and
//! without the names of our own files.

use axum::http::StatusCode;

use super::assets::bad_asset;
use super::problem::Problem;
use super::words::in_fields;
use crate::pipeline::recipe::PosesRecipe;
use crate::{pipeline, pose};

/// Where a fault of the poses comes from.
pub(super) fn field_of_pose(poses: &PosesRecipe, error: &pose::Error) -> String {
    let place = |list: &str, names: &Option<Vec<String>>, name: &String| {
        let at = names.as_ref()?.iter().position(|known| known == name)?;
        Some(format!("poses/{list}/{at}"))
    };
    let field = match error {
        pose::Error::UnknownClip { name, .. } => {
            let found = place("clips", &poses.clips, name);
            let found = found.or_else(|| place("hold_out", &poses.hold_out, name));
            return found.unwrap_or_else(|| "poses".to_owned());
        }
        pose::Error::NothingToTrain { .. } => "poses/hold_out",
        pose::Error::Rate { .. } | pose::Error::TooManyPoses { .. } => "poses/rate_hz",
        pose::Error::NearRepeat { .. } => "poses/near_repeat",
        pose::Error::InterpolatedEvery => "poses/interpolated_every",
        pose::Error::Size { .. } => "scene/file",
    };
    field.to_owned()
}

/// Why a recipe cannot run, at its field.
pub(super) fn of_recipe(error: &pipeline::RecipeError) -> Problem {
    let pointer = super::answer::pointer(&format!("recipe.{}", error.field));
    Problem::field(pointer, format!("{}; {}", error.found, error.expected))
}

/// Why a job cannot start, or has failed.
pub(super) fn of_pipeline(error: &pipeline::Error) -> Problem {
    match error {
        pipeline::Error::Recipe(error) => of_recipe(error),
        pipeline::Error::Scene { .. } => bad_asset(error),
        pipeline::Error::Pose(error) => Problem::field("#/recipe/poses", error.to_string()),
        pipeline::Error::Surroundings(fault) => {
            Problem::field("#/recipe/bake/surroundings", in_fields(fault))
        }
        full if is_full(full) => {
            let detail = "the disk of the service is full";
            Problem::new(StatusCode::INSUFFICIENT_STORAGE, "storage-full", detail)
        }
        pipeline::Error::Fit(error) => Problem::field("#/recipe/fit", error.to_string()),
        // These name files of ours.
        pipeline::Error::File { .. } | pipeline::Error::Dataset(_) => Problem::internal(error),
        other => {
            let detail = in_fields(&other.to_string());
            Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid-field", detail)
        }
    }
}

/// Whether a full disk is at the bottom of a fault.
fn is_full(error: &(dyn std::error::Error + 'static)) -> bool {
    let cause = error.downcast_ref::<std::io::Error>();
    cause.is_some_and(|cause| cause.kind() == std::io::ErrorKind::StorageFull)
        || error.source().is_some_and(is_full)
}
