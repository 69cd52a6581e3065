//! Poselight turns a rigged, animated character into a compact model *pose → light transport*:
//! it bakes ambient occlusion, visibility or radiance transfer at the vertices over many poses,
//! fits a small model in process, and measures that model on motion it has not seen.
//!
//! # Code map
//! Folders are the pipeline, in the order of the data:
//! scene → pose → trace → bake → dataset → fit → model → measure → choose → serve.
//!
//! | rank | module | owns |
//! |---|---|---|
//! | 0 | [`num`] | random numbers, direction sets, statistics, linear algebra, CPU kernels |
//! | 1 | [`sh`] | spherical harmonics: basis, index, rotation, products, zonal |
//! | 2 | [`rig`] | skeleton, skinning, pose parameters |
//! | 3 | [`model`] | encoder and linear decoder, evaluation, light folding, the blob |
//! | 4 | [`shade`] | lights as spherical harmonics, reflectances as product operators, shadows of spheres |
//! | 5 | `scene` | glTF and OBJ import, environment maps |
//! | 6 | `pose` | clip sampling |
//! | 7 | `trace` | Embree behind safe types |
//! | 8 | `bake` | rays to signals |
//! | 9 | `dataset` | the training set on disk |
//! | 10 | `fit` | the model families |
//! | 11 | `measure` | errors, costs, reports |
//! | 12 | `render` | stills, shading by rays as their truth |
//! | 13 | `choose` | what a target asks for |
//! | 14 | `pipeline` | recipe, run, resume |
//! | 15 | `serve` | the service: HTTP, jobs, stores |
//! | 16 | `cli` | arguments, progress, output |
//!
//! *Invariant:* a module uses only modules of lower rank; `tests/tidy.rs` fails otherwise.
//! *Invariant:* ranks 0 to 4 (feature `runtime`) know nothing of Embree, glTF, threads or files.
//! *Invariant:* `unsafe` stands only in `trace/embree/`, `num/kernels.rs` and `num/kernels/`.
//! *Invariant:* equal recipe hashes give equal bytes, for any number of threads and restarts.

pub mod model;
pub mod num;
pub mod rig;
pub mod sh;
pub mod shade;

#[cfg(feature = "bake")]
pub mod bake;
#[cfg(feature = "bake")]
pub mod choose;
#[cfg(feature = "bake")]
pub mod dataset;
#[cfg(feature = "bake")]
pub mod fit;
#[cfg(feature = "bake")]
pub mod measure;
#[cfg(feature = "bake")]
pub mod pipeline;
#[cfg(feature = "bake")]
pub mod pose;
#[cfg(feature = "bake")]
pub mod render;
#[cfg(feature = "bake")]
pub mod scene;
#[cfg(feature = "bake")]
pub mod trace;

#[cfg(feature = "cli")]
pub mod cli;

#[cfg(feature = "serve")]
pub mod serve;
