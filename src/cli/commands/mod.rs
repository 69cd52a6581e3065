//! One file per command; each turns arguments into an [`Answer`].

mod apply;
mod bake;
mod brdf;
mod check;
mod crowd;
mod evaluate;
mod fit;
mod heights;
mod inspect;
mod light;
mod measure;
mod rebind;
mod run;
mod sample;
#[cfg(feature = "serve")]
mod serve;
mod still;
mod subdivide;
mod tradeoff;

pub(super) use apply::apply;
pub(super) use bake::bake;
pub(super) use brdf::brdf;
pub(super) use check::check;
pub(super) use crowd::crowd;
pub(super) use evaluate::evaluate;
pub(super) use fit::fit;
pub(super) use heights::heights;
pub(super) use inspect::inspect;
pub(super) use light::light;
pub(super) use measure::measure;
pub(super) use rebind::rebind;
pub(super) use run::run;
pub(super) use sample::{sample, schema};
#[cfg(feature = "serve")]
pub(super) use serve::{serve, token};
pub(super) use still::still;
pub(super) use subdivide::subdivide;
pub(super) use tradeoff::tradeoff;

use std::path::{Path, PathBuf};

use anyhow::Context;

use super::args::RecipeArgs;
use crate::model::Model;
use crate::pipeline::files;
use crate::pipeline::recipe::Recipe;

/// A recipe is text that a person writes.
const MOST_RECIPE_BYTES: u64 = 1 << 20;

/// A file that was named as a recipe and is none.
#[derive(Debug, thiserror::Error)]
#[error("recipe {path}: {source}", path = path.display())]
pub(super) struct UnreadRecipe {
    /// The file.
    pub(super) path: PathBuf,
    /// Where and what is wrong with it.
    pub(super) source: serde_json::Error,
}

/// Flags that make no sense together.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct Usage(pub(super) String);

/// Refuses to write over what is read.
fn keep_input(input: &Path, output: &Path) -> Result<(), Usage> {
    keep_apart(&[("scene", input)], &[("the output", output)])
}

/// Refuses outputs that would replace an input, or one another; each with what it is called.
fn keep_apart(inputs: &[(&str, &Path)], outputs: &[(&str, &Path)]) -> Result<(), Usage> {
    for (index, (output, path)) in outputs.iter().enumerate() {
        let place = place(path);
        let same = |other: &&(&str, &Path)| place == self::place(other.1);
        if let Some((input, at)) = inputs.iter().find(same) {
            let at = at.display();
            return Err(Usage(format!("{output} would replace the {input} {at}: name another")));
        }
        if let Some((other, _)) = outputs[..index].iter().find(same) {
            let path = path.display();
            return Err(Usage(format!("{output} would replace {other} {path}: name another")));
        }
    }
    Ok(())
}

/// Where a file is or would be, after every link.
fn place(path: &Path) -> PathBuf {
    if let Ok(place) = path.canonicalize() {
        return place;
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new(".")).canonicalize();
    match (folder, path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    }
}

/// Refuses an output whose name says another format than the one that is written.
fn named(output: &Path, suffix: &str) -> Result<(), Usage> {
    let found = output.extension().and_then(|found| found.to_str()).unwrap_or_default();
    if found.eq_ignore_ascii_case(suffix) {
        return Ok(());
    }
    let right = output.with_extension(suffix);
    let (output, right) = (output.display(), right.display());
    Err(Usage(format!("this writes a .{suffix} file: name the output {right}, not {output}")))
}

/// The recipe to start from.
fn start(args: &RecipeArgs) -> anyhow::Result<Recipe> {
    args.recipe.as_deref().map_or_else(|| Ok(Recipe::default()), read_recipe)
}

fn read_recipe(path: &Path) -> anyhow::Result<Recipe> {
    let bytes = files::read(path, MOST_RECIPE_BYTES)?;
    Ok(Recipe::from_json(&bytes)
        .map_err(|source| UnreadRecipe { path: path.to_owned(), source })?)
}

/// A model is about a megabyte; the full linear one of a large mesh stays below this.
const MOST_MODEL_BYTES: u64 = 4 << 30;

/// Refuses what is plainly something else, as where arguments change places.
fn is_no_model(path: &Path) -> Result<(), Usage> {
    let suffix = path.extension().and_then(|suffix| suffix.to_str()).unwrap_or_default();
    let is = if path.is_dir() {
        "a folder, such as a data set"
    } else if ["glb", "gltf", "obj", "npz"].iter().any(|s| suffix.eq_ignore_ascii_case(s)) {
        "a scene"
    } else {
        return Ok(());
    };
    let place = path.display();
    Err(Usage(format!("{place} is {is}; a model (.safetensors), as `fit` writes it, goes first")))
}

/// A model from its file.
fn read_model(path: &Path) -> anyhow::Result<(Model, u64)> {
    is_no_model(path)?;
    let bytes = files::read(path, MOST_MODEL_BYTES)?;
    let model = Model::from_bytes(&bytes)
        .with_context(|| format!("{} is not a model that can be used", path.display()))?;
    Ok((model, bytes.len() as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An output says what it will hold, in any case; a better name is proposed.
    #[test]
    fn an_output_says_what_it_holds() {
        assert!(named(Path::new("a/b.GLB"), "glb").is_ok());
        let told = |name: &str| named(Path::new(name), "png").expect_err(name).to_string();
        assert!(told("a/b.jpg").contains("a/b.png, not a/b.jpg"));
        assert!(told("still").contains("still.png, not still"));
    }

    /// Outputs keep clear of inputs and of one another, by whatever way their places are named; a sentence
    /// says which of them meet.
    #[test]
    fn outputs_replace_nothing_that_counts() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("sub")).expect("made");
        std::fs::write(at("a.glb"), b"a").expect("written");
        let around = at("sub/../a.glb");
        let (input, new, again) = (at("a.glb"), at("new.glb"), at("sub/../new.glb"));
        let inputs = [("scene", input.as_path())];
        let told = |outputs: &[(&str, &Path)]| keep_apart(&inputs, outputs).map_err(|told| told.0);
        assert_eq!(told(&[("the output", &new)]), Ok(()));
        let replaced = told(&[("the output", &new), ("--more", &around)]).expect_err("the input");
        assert!(replaced.starts_with("--more would replace the scene"), "{replaced}");
        let met = told(&[("the output", &new), ("--more", &again)]).expect_err("met");
        assert!(met.starts_with("--more would replace the output"), "{met}");
    }

    /// A scene or a folder in the place of a model is named as what it is.
    #[test]
    fn what_is_no_model_is_named() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let told = |path: &Path| read_model(path).expect_err("no model").to_string();
        assert!(told(folder.path()).contains("is a folder, such as a data set; a model"));
        assert!(told(Path::new("hero.glb")).contains("hero.glb is a scene; a model"));
    }
}
