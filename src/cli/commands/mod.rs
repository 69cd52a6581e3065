//! One file per command; each turns arguments into an [`Answer`].

mod apply;
mod bake;
mod evaluate;
mod fit;
mod inspect;
mod measure;
mod run;
mod sample;
#[cfg(feature = "serve")]
mod serve;
mod tradeoff;

pub(super) use apply::apply;
pub(super) use bake::bake;
pub(super) use evaluate::evaluate;
pub(super) use fit::fit;
pub(super) use inspect::inspect;
pub(super) use measure::measure;
pub(super) use run::run;
pub(super) use sample::{sample, schema};
#[cfg(feature = "serve")]
pub(super) use serve::{serve, token};
pub(super) use tradeoff::tradeoff;

use std::path::Path;

use anyhow::Context;

use super::args::RecipeArgs;
use crate::pipeline::files;
use crate::pipeline::recipe::Recipe;

/// A recipe is text that a person writes.
const MOST_RECIPE_BYTES: u64 = 1 << 20;

/// The recipe to start from.
fn start(args: &RecipeArgs) -> anyhow::Result<Recipe> {
    args.recipe.as_deref().map_or_else(|| Ok(Recipe::default()), read_recipe)
}

fn read_recipe(path: &Path) -> anyhow::Result<Recipe> {
    let bytes = files::read(path, MOST_RECIPE_BYTES)?;
    Recipe::from_json(&bytes).with_context(|| format!("recipe {}", path.display()))
}

/// A model is about a megabyte; the full linear one of a large mesh stays below this.
const MOST_MODEL_BYTES: u64 = 4 << 30;
