//! Rank 14. Recipe, plan, run and resume: the only code that joins stages.
//!
//! A [`recipe::Recipe`] becomes [`Checked`] settings, a scene and a recipe become a [`Job`], and a
//! job is baked ([`bake()`]), fitted, measured, each stage on its own or all in one. Results are
//! named by [`Hashes`]; what is there under the right hash is not made again.

mod bake;
mod buried;
mod candidates;
mod check;
mod checked;
mod choice;
mod crowd;
mod data;
mod describe;
mod difference;
mod earlier;
mod effect;
mod effort;
mod encoding;
mod error;
mod evaluate;
mod evaluate_error;
mod evaluate_posed;
mod figures;
pub mod files;
mod finish;
mod fit;
mod gloss;
mod hash;
mod heights;
mod imported;
mod job;
mod lit;
mod map_light;
mod measure;
mod normals;
mod notices;
mod plan;
mod plan_rays;
mod progress;
mod rebind;
mod receivers;
pub mod recipe;
mod reference;
mod report;
mod report_stills;
mod rounds;
mod run;
mod search;
mod spent;
mod still;
mod subdivide;
mod subset;
mod surroundings;
mod timing;
mod tradeoff;
mod tradeoff_page;
mod trim;
#[cfg(test)]
mod two_nodes;
mod validation;
mod valued;
mod workbench;

pub use crate::dataset::Dataset;
pub use crate::scene::Scene;
pub use bake::{Baked, bake, bake_from, check_place};
pub use buried::buried;
pub use candidates::{CandidateRecipe, Range, candidates};
pub use check::{Baseline, BaselineError, Line, junit, page};
pub use checked::{Checked, RecipeError, ReferenceSettings};
pub use choice::{Confirmed, choose, has_target};
pub use crowd::{Crowd, CrowdPicture, CrowdPlace, MOST_CHARACTERS, crowd};
pub use data::{open_dataset, other_references};
pub use earlier::go_on;
pub use effect::{effective, effective_fit, effective_parametrisation, forget_other_sizes};
pub use effort::{Effort, EffortPoint, Efforts, check_effort, effort};
pub use error::Error;
pub use evaluate::{Light, Query};
pub use evaluate_error::EvaluateError;
pub use figures::{ChoiceFigures, Figures, ModelFigures, Spectra, Times};
pub use finish::{Finish, FinishError, has_terms};
pub use fit::{FittedModel, fit, fit_mean, fit_watched, fit_without, recipe_of, recipe_of_model};
use fit::{Part, fit_part};
pub use gloss::{GLOSS_LOBES, GLOSS_TERMS, Gloss};
pub use hash::Hashes;
pub use heights::{HeightPictures, Heights, MOST_HEIGHT_FRAMES, heights};
pub use job::{Around, Job, check_document, import};
pub use lit::{Lit, is_brdf_words, is_words};
pub use map_light::{
    MapError, check_map, light_on, map_notices, read_map, read_words, words_light,
};
pub use measure::measure;
pub use notices::{notices, reference_notice};
pub use plan::{Plan, disk_bytes, memory_bytes, plan};
pub use plan_rays::{Planned, RaysPlan, plan_rays};
pub use progress::{Progress, Stage, Watch};
pub use rebind::{RebindError, RebindSettings, Rebound, Unmatched, rebind};
pub use receivers::Receivers;
pub use reference::{ReferenceBaked, bake_reference, job_of, rays_per_point};
pub use run::{DATASET, FIGURES, MODEL, Outcome, RECIPE, REPORT, examine, meets_target, run};
pub use search::{Searched, VALIDATION, exhaustive, search};
pub use spent::{Missed, Spent, spent};
pub use still::{
    MOST_STILL_FRAMES, MOST_TURN_FRAMES, STILL_SIZES, Still, StillError, StillPicture,
    spread_times, still,
};
pub use subdivide::{
    Beyond, Deviation, REFINED, RefinedRecord, Refinement, Subdivided, SubdivisionPlan, Worst,
    interpolation_probes, is_refinement, plan_subdivision, record_of, refined, refined_already,
    refinement_hash, subdivide,
};
pub use surroundings::Occluders;
pub use tradeoff::{Tradeoff, tradeoff};
pub use trim::Trimmed;
pub use valued::{Valued, check_mesh, check_receivers, valued};
