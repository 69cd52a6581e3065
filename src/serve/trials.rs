//! What jobs on a data set try: how far a trade-off looks, and with how much less than there is.

use serde::{Deserialize, Serialize};

use super::problem::Problem;
use crate::pipeline::Efforts;

/// Efforts of one sort, at most: each is a bake or a row of fits.
const MOST_EFFORTS: usize = 16;

/// How far a trade-off looks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum RangeName {
    /// Every family at a few sizes.
    #[default]
    Quick,
    /// All.
    Full,
}

/// Whether anything is to be tried, and not too much.
///
/// # Errors
/// The list at fault.
pub(super) fn check_efforts(efforts: Option<&Efforts>) -> Result<(), Problem> {
    let Some(efforts) = efforts.filter(|efforts| efforts.is_any()) else {
        let fault = "`rays`, `poses` or `orders` say what less is tried; none is there";
        return Err(Problem::field("#/efforts", fault));
    };
    let Efforts { rays, poses, orders } = efforts;
    for (name, count) in [("rays", rays.len()), ("poses", poses.len()), ("orders", orders.len())] {
        if count > MOST_EFFORTS {
            let fault = format!("{count} are more than the {MOST_EFFORTS} that are tried at most");
            return Err(Problem::field(format!("#/efforts/{name}"), fault));
        }
    }
    Ok(())
}
