//! Refined scenes: one that another bake was made of is not made again.

use std::path::Path;

use super::problem::Problem;
use super::{Service, files, store};
use crate::pipeline::{self, REFINED, record_of};

/// Takes a refined scene of this hash over from the work of another bake, where one has it.
///
/// # Errors
/// What the disk objects to.
pub(super) fn take_over(service: &Service, hash: &str, place: &Path) -> Result<(), Problem> {
    if place.is_file() && record_of(place).is_file() {
        return Ok(());
    }
    let folder = service.store.folder();
    for work in store::list(&folder.root().join("work"))? {
        let there = work.join(REFINED);
        if pipeline::is_refinement(&there, hash) {
            store::create(place.parent().unwrap_or(&work))?;
            // The record is last: with it the refinement is done.
            files::link(&there, place)?;
            files::link(&record_of(&there), &record_of(place))?;
            return Ok(());
        }
    }
    Ok(())
}
