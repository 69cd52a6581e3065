//! What a report is made from, besides the measured figures. Whatever is unknown is `None` or
//! empty, and its place in the page is left out.

use glam::Vec3;

use super::ReportStill;
use crate::measure::{Measured, Split};

/// Everything on the page.
#[derive(Debug, Clone)]
pub struct ReportInput<'a> {
    /// The character's name, usually the scene's file name.
    pub title: &'a str,
    /// Version of the program and the command that made the page.
    pub made_by: &'a str,
    /// Processor, cores and instruction set on which times were taken.
    pub machine: &'a str,
    /// The figures.
    pub measured: &'a Measured,
    /// The character's key numbers.
    pub character: Character,
    /// The model's.
    pub model: ModelFacts,
    /// Eigenvalues of the pose parameters' covariance.
    pub pose_spectrum: Spectrum<'a>,
    /// Squared singular values of the outputs, rows (pose, coefficient), columns points: their
    /// energy, not centred, since no mean is stored beside the basis.
    pub output_spectrum: Spectrum<'a>,
    /// Seconds and rays.
    pub times: Times,
    /// The mesh at rest, for the picture; `None` leaves the picture out.
    pub rest: Option<RestMesh<'a>>,
    /// The model beside its truth; empty where there is none to show.
    pub stills: Vec<ReportStill>,
    /// What the fit did not use.
    pub left_out: LeftOut,
    /// What the error was to be, where that was stated.
    pub target: Option<Target>,
    /// Sentences that a reader must see first: coverage, extrapolation, few poses.
    pub warnings: Vec<String>,
    /// The resolved recipe as indented JSON.
    pub recipe: &'a str,
    /// Names and values of hashes, such as `bake` and `fit`.
    pub hashes: Vec<(String, String)>,
}

/// The largest error that was asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Root mean square error of a coefficient, over the headline split.
    pub most: f64,
    /// What was reached; `None` where it is lost in the references' noise.
    pub reached: Option<f64>,
    /// What it may be by training clips that were left out, where the target chose the model by them.
    pub validated: Option<f64>,
}

impl Target {
    /// Whether the errors are within the target; one lost in the noise is.
    #[must_use]
    pub fn is_met(&self) -> bool {
        self.is_reached() && self.validated.is_none_or(|validated| validated <= self.most)
    }

    pub(super) fn is_reached(&self) -> bool {
        self.reached.is_none_or(|reached| reached <= self.most)
    }
}

/// The character and its motion.
#[derive(Debug, Clone, Default)]
pub struct Character {
    /// Vertices of the mesh as imported.
    pub vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Joints of the skeleton that deform the mesh.
    pub joints: usize,
    /// Morph targets.
    pub morphs: usize,
    /// Diagonal of the rest pose's bounding box, metres.
    pub size_m: f32,
    /// Numbers that describe a pose in the data set after unused ones were dropped.
    pub parameters: usize,
    /// Poses of the training split.
    pub training_poses: usize,
    /// Rays per point of the training bake.
    pub rays: u32,
    /// All clips, in the scene's order.
    pub clips: Vec<ClipFacts>,
}

/// One clip.
#[derive(Debug, Clone)]
pub struct ClipFacts {
    /// Its name.
    pub name: String,
    /// Length, seconds.
    pub duration_s: f32,
    /// Poses kept of it.
    pub poses: usize,
    /// What it was used for; a clip with interpolated frames or a held-out quarter names training
    /// first.
    pub splits: Vec<Split>,
}

/// The model's sizes and costs.
#[derive(Debug, Clone, Default)]
pub struct ModelFacts {
    /// Family with its sizes, such as `pca-linear (8, 22)`.
    pub family: String,
    /// `root` or `bone`.
    pub frame: String,
    /// How its numbers are stored, such as `i8`.
    pub precision: String,
    /// Numbers that it takes a pose by, which may be others than the data set's.
    pub parameters: usize,
    /// The chosen ridge α, where there is one.
    pub alpha: Option<f64>,
    /// Bytes of the file by candidate name: the model first, then its other precisions.
    pub sizes: Vec<(String, u64)>,
    /// Bytes of the model's tensors alone, which is what the published sizes count.
    pub tensor_bytes: u64,
    /// Bytes of the training coefficients as f32.
    pub training_bytes: u64,
    /// Bytes of one pose's coefficients as f32.
    pub mesh_bytes: u64,
    /// Multiply-adds for all coefficients of one pose.
    pub multiply_adds: u64,
    /// Microseconds to evaluate one pose, all coefficients, one core.
    pub evaluate_us: Option<f64>,
    /// Microseconds for one pose folded to one light, one core.
    pub folded_us: Option<f64>,
}

/// Eigenvalues, descending.
#[derive(Debug, Clone, Copy, Default)]
pub struct Spectrum<'a> {
    /// As many as are known.
    pub values: &'a [f64],
    /// Their total where `values` are only the largest; `None` where all are known.
    pub total: Option<f64>,
    /// How many dimensions the model keeps; `None` where it has no such choice.
    pub kept: Option<usize>,
}

/// What was spent.
#[derive(Debug, Clone, Default)]
pub struct Times {
    /// Wall seconds of the training bake; unknown where several runs shared it.
    pub bake_s: Option<f64>,
    /// Rays per second of what the last of them baked.
    pub bake_rays_per_s: Option<f64>,
    /// Rays of the training bake.
    pub bake_rays: u64,
    /// Poses of the training bake (all splits).
    pub bake_poses: usize,
    /// Wall seconds of the reference bakes.
    pub reference_s: Option<f64>,
    /// Wall seconds of the fit by phase, in order.
    pub fit: Vec<Phase>,
}

/// One phase of the fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Phase {
    /// Its name.
    pub name: String,
    /// Wall seconds.
    pub seconds: f64,
    /// Whether it is counted as PCA, which PRT07 lists apart.
    pub pca: bool,
}

/// The mesh at rest.
#[derive(Debug, Clone, Copy)]
pub struct RestMesh<'a> {
    /// Posed at rest, metres, +Y up, `[vertex]`.
    pub positions: &'a [Vec3],
    /// Vertex indices.
    pub triangles: &'a [[u32; 3]],
    /// The point of each vertex.
    pub point_of_vertex: &'a [u32],
}

/// What was in the scene and is not in the model.
#[derive(Debug, Clone, Default)]
pub struct LeftOut {
    /// Degrees of freedom without variance, by name.
    pub dropped: Vec<String>,
    /// Poses dropped since they nearly repeat another.
    pub near_repeats: usize,
    /// The threshold for that, in parameter units.
    pub near_repeat: f32,
    /// Training poses that were not baked, since others lie farther apart.
    pub passed_over: usize,
    /// The rays that they would have taken.
    pub saved_rays: u64,
    /// The importer's notices.
    pub notices: Vec<String>,
}
