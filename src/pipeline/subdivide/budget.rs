//! From bytes of a model to vertices of the mesh that it is fitted to.

use crate::model::{Frame, Precision};
use crate::pipeline::recipe::{
    ChooseName, DEFAULT_INPUTS, DEFAULT_OUTPUTS, FamilyName, FitRecipe, Recipe,
};
use crate::pipeline::{Error, Job, RecipeError, describe};

/// What a blob's header says beside the rig: conventions, errors, provenance with the recipe.
const HEADER_BYTES: u64 = 48 << 10;

/// Characters of a number in the header's text, at most.
const NUMBER_BYTES: u64 = 24;

/// Bytes of an index in the maps of vertices and points, at most.
const INDEX_BYTES: u64 = 4;

/// The most vertices of a mesh whose model, of the family and precision that the recipe states, has no
/// more than so many bytes; vertices that are one point in the model are counted each.
///
/// # Errors
/// [`RecipeError`] where the recipe leaves the model's sizes open.
pub(super) fn vertices_within(job: &Job, bytes: u64) -> Result<usize, Error> {
    let recipe = &job.recipe;
    let layout = describe::header(job)?.layout;
    let rig = serde_json::to_vec(&describe::rig_header(job));
    // Text within text: quotes are escaped.
    let rig_bytes = rig.map_or(0, |rig| 2 * rig.len() as u64);
    let sizes = sizes(recipe)?;
    let number = match job.checked.precision {
        Precision::F32 => 4,
        Precision::F16 => 2,
        Precision::I8 => 1,
    };
    let (row, parameters) = (layout.row() as u64, layout.parameters as u64);
    let (each, whole) = match sizes {
        Sizes::Mean => (row, 0),
        Sizes::Linear => (row * (1 + parameters), 0),
        Sizes::PcaLinear { inputs, outputs } => {
            (outputs, parameters * inputs + row * (inputs + 1) * outputs)
        }
    };
    let maps = INDEX_BYTES * if job.checked.fit.frame == Frame::Bone { 2 } else { 1 };
    // Scales of 8-bit numbers, one for a column, are 4 bytes each.
    let scales = if number == 1 { 4 * (row * (2 + parameters) + each) } else { 0 };
    let centre = NUMBER_BYTES * (2 * parameters + 64);
    let directions = 4 * parameters * parameters.min(64);
    let fixed = HEADER_BYTES + rig_bytes + centre + directions + scales + whole * number;
    let room = bytes.saturating_sub(fixed);
    Ok((room / (each * number + maps).max(1)) as usize)
}

/// The sizes that a model's bytes follow from.
enum Sizes {
    Mean,
    Linear,
    PcaLinear { inputs: u64, outputs: u64 },
}

fn sizes(recipe: &Recipe) -> Result<Sizes, RecipeError> {
    let FitRecipe { family, inputs, outputs, .. } = recipe.fit;
    let by_share = recipe.fit.retain_inputs.or(recipe.fit.retain_outputs).is_some();
    let open = recipe.target.choose != ChooseName::Nothing;
    let looks = recipe.fit.unshadowed == Some(true);
    match family {
        _ if open || by_share || looks => {}
        FamilyName::Mean => return Ok(Sizes::Mean),
        FamilyName::Linear => return Ok(Sizes::Linear),
        FamilyName::PcaLinear => {
            let inputs = u64::from(inputs.unwrap_or(DEFAULT_INPUTS));
            let outputs = u64::from(outputs.unwrap_or(DEFAULT_OUTPUTS));
            return Ok(Sizes::PcaLinear { inputs, outputs });
        }
        _ => {}
    }
    let found =
        format!("given with a model of the family {family} whose bytes are not known before");
    let expected = "it needs the family mean, linear or pca-linear, its sizes stated";
    Err(RecipeError { field: "subdivide.bytes", found, expected })
}
