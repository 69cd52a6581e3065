//! What the stages object to, as a client is told it: at the field of the request that is at fault, and
//! without the names of our own files.

use axum::http::StatusCode;
use rustix::io::Errno;

use super::assets::bad_asset;
use super::problem::{Problem, is_full_disk};
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
        pose::Error::MixedSequence | pose::Error::TooManyMixed { .. } => "poses/mixed",
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
        full if cause(full).is_some_and(is_full_disk) => {
            let detail = "the disk of the service is full";
            Problem::new(StatusCode::INSUFFICIENT_STORAGE, "storage-full", detail)
        }
        broken if cause(broken).is_some_and(is_broken_disk) => {
            tracing::error!(error = %broken, "the disk takes no writes");
            Problem::no_writes()
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

/// What the system said, at the bottom of a fault.
fn cause<'a>(error: &'a (dyn std::error::Error + 'static)) -> Option<&'a std::io::Error> {
    error.downcast_ref::<std::io::Error>().or_else(|| error.source().and_then(cause))
}

/// Whether a disk has failed, or does not let itself be written any more.
fn is_broken_disk(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{
        NotADirectory, PermissionDenied, ReadOnlyFilesystem, StaleNetworkFileHandle,
    };
    let kinds = [NotADirectory, PermissionDenied, ReadOnlyFilesystem, StaleNetworkFileHandle];
    kinds.contains(&error.kind()) || error.raw_os_error() == Some(Errno::IO.raw_os_error())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk that is full, one that is broken and a file that is not there are three things, however
    /// deep they are told.
    #[test]
    fn disks_fail_in_their_own_ways() {
        let problem = |errno: Errno| {
            let source = std::io::Error::from(errno);
            let path = std::path::PathBuf::from("c.0");
            of_pipeline(&pipeline::Error::Dataset(crate::dataset::Error::Io {
                action: "write",
                path,
                source,
            }))
        };
        for (errno, status) in [
            (Errno::NOSPC, 507),
            (Errno::DQUOT, 507),
            (Errno::ROFS, 503),
            (Errno::IO, 503),
            (Errno::ACCESS, 503),
            (Errno::NOTDIR, 503),
            (Errno::NOENT, 500),
        ] {
            let problem = problem(errno);
            assert_eq!(problem.status.as_u16(), status, "{errno}");
            assert_eq!(problem.is_for_later(), status == 503);
        }
    }
}
