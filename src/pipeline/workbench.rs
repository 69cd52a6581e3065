//! Where candidates are tried quickly: the training poses at some of the points, in memory, with
//! what fits have in common kept from one to the next.
//!
//! Errors are means over points, so a few thousand of them tell candidates apart, and every fit
//! that shares its factorisations costs as many times less as there are fewer points. What is
//! found here is an estimate: whoever decides fits the best candidates to all points.

mod importance;
mod sample;
mod whole;

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use super::candidates::CandidateRecipe;
use super::fit::{Assembled, assemble, fit_sizes, geometry, order_kept, settings_for};
use super::imported::Imported;
use super::measure::evaluate_widened;
use super::recipe::{FamilyName, FitRecipe, FrameName, OnName, ParametrisationName, Recipe};
use super::tradeoff::point;
use super::{Error, FittedModel, Job, encoding};
use crate::choose::Point;
use crate::dataset::{Dataset, Movement, Training, TrainingParts};
use crate::fit::{Inscribed, Largest, Shared};
use crate::model::{Model, PosedInput, PosedPoints, Precision, RigHeader};
use sample::{sample, thinned};
use whole::largest;

/// Points that candidates are tried on, at most.
const MOST_POINTS: usize = 1024;
/// Numbers of the data that are kept, at most: fewer points where there are many coefficients.
const MOST_NUMBERS: usize = 1 << 25;
/// Points that candidates are tried on where the data have so many, at least.
const LEAST_POINTS: usize = 256;
/// Steps of optimisers without a closed form: enough to tell candidates apart.
const STEPS: usize = 60;
/// Reaches that a model is tried with beside none: typical distances of training poses are 1, and 0
/// leaves the mean pose.
const REACHES: [f32; 7] = [8.0, 4.0, 2.0, 1.5, 1.0, 0.5, 0.0];
/// Evaluations, of which the fastest counts.
const REPETITIONS: usize = 5;

/// The training poses in one parametrisation.
struct Encoding {
    name: ParametrisationName,
    parameters: Vec<f32>,
    names: Vec<String>,
    rig: RigHeader,
}

impl Encoding {
    /// The parameters of a training pose.
    fn of(&self, pose: usize) -> &[f32] {
        let width = self.names.len();
        &self.parameters[pose * width..(pose + 1) * width]
    }
}

/// The data that candidates are tried on.
pub(super) struct Workbench<'a> {
    dataset: &'a Dataset,
    pub(super) base: TrainingParts,
    movement: Option<Movement>,
    /// Index in the data set of every training pose.
    poses: Vec<usize>,
    /// How the data set's own parameters were made.
    stored: ParametrisationName,
    encodings: Vec<Encoding>,
    /// The mesh of the points, posed as the data are, where a candidate looks at it.
    posed: Option<(Job, Vec<PosedPoints>)>,
    /// What spheres of the whole mesh are cut of.
    inscribed: Option<Arc<Inscribed>>,
    largest: Largest,
    /// Points of the data set for each one here.
    ratio: f64,
    /// What the whole mesh at rest adds to a model, where a candidate carries it.
    rest_bytes: u64,
    /// Whether each fit makes all that it needs, so that its time is its own.
    is_timing: bool,
}

/// The training poses without those that are left out, and what fits of them share.
pub(super) struct Bench<'a> {
    bench: &'a Workbench<'a>,
    keep: Vec<usize>,
    left_out: Vec<usize>,
    /// One for each encoding.
    trainings: Vec<Training<'static>>,
    shared: Shared,
}

/// What a candidate came to.
pub(super) struct Tried {
    /// In every precision, costs as all points would have them.
    pub(super) points: Vec<Point>,
    /// Mean square error of each on what was left out.
    pub(super) squares: Vec<f64>,
    /// The first one's with each of [`reaches`].
    pub(super) held: Vec<f64>,
}

/// The reaches that a candidate is tried with.
pub(super) fn reaches() -> impl Iterator<Item = Option<f32>> {
    std::iter::once(None).chain(REACHES.map(Some))
}

impl<'a> Workbench<'a> {
    /// Reads what the candidates need.
    pub(super) fn new(dataset: &'a Dataset, candidates: &[CandidateRecipe]) -> Result<Self, Error> {
        let layout = &dataset.header().layout;
        let splits = dataset.splits().iter().enumerate();
        let poses: Vec<usize> =
            splits.filter(|(_, split)| **split == 0).map(|(pose, _)| pose).collect();
        let most = (MOST_NUMBERS / (poses.len() * layout.row()).max(1)).max(LEAST_POINTS);
        let points = sample(dataset.point_bones(), most.min(MOST_POINTS));
        let stored = super::recipe_of(dataset)?;
        let imported = Imported::new(dataset);
        let mut this = Self {
            dataset,
            base: dataset.training()?.parts_at(&points)?,
            movement: None,
            poses,
            stored: stored.poses.parametrisation,
            encodings: Vec::new(),
            posed: None,
            inscribed: None,
            largest: largest(candidates),
            ratio: layout.points as f64 / points.len() as f64,
            rest_bytes: 0,
            is_timing: false,
        };
        for candidate in candidates {
            let name = candidate.recipe.fit.parametrisation.unwrap_or(stored.poses.parametrisation);
            if this.encodings.iter().all(|known| known.name != name) {
                this.encode(&imported, name, &stored, &points)?;
            }
        }
        let turns = candidates.iter().any(|c| c.recipe.fit.frame == FrameName::Tangent);
        let looks = |c: &CandidateRecipe| {
            let FitRecipe { family, unshadowed, local, .. } = &c.recipe.fit;
            *family == FamilyName::Occluder || *unshadowed == Some(true) || local.is_some()
        };
        if turns || candidates.iter().any(looks) {
            let job = super::job_of(dataset)?;
            if candidates.iter().any(|candidate| candidate.recipe.fit.include_rest) {
                this.rest_bytes = whole::rest_bytes(&job);
            }
            if candidates.iter().any(|c| c.recipe.fit.family == FamilyName::Occluder) {
                this.inscribed = Some(Arc::new(whole::inscribed(&job, &points)));
            }
            let job = thinned(job, &points);
            let surfaces = this.poses.iter().map(|&pose| job.surface(pose, turns)).collect();
            this.posed = Some((job, surfaces));
        }
        Ok(this)
    }

    /// Whether the time of fits matters.
    pub(super) fn timing(self, is_timing: bool) -> Self {
        Self { is_timing, ..self }
    }

    fn encode(
        &mut self,
        imported: &Imported<'_>,
        name: ParametrisationName,
        stored: &Recipe,
        points: &[u32],
    ) -> Result<(), Error> {
        let mut recipe = stored.clone();
        recipe.fit.parametrisation = Some(name);
        // A family that goes by how points move, so that this is read, too.
        recipe.fit.family = FamilyName::ClusteredLinear;
        let (training, mut rig) = encoding::training(imported, &recipe, &[])?;
        sample::keep_within(&mut rig, points.len());
        self.movement = training.movement().map(|movement| movement.at(points));
        self.encodings.push(Encoding {
            name,
            parameters: training.parameters().to_vec(),
            names: training.parameter_names().to_vec(),
            rig,
        });
        Ok(())
    }

    /// The clip of every training pose.
    pub(super) fn clips(&self) -> &[i32] {
        &self.base.clips
    }

    /// All training poses.
    fn training(&self, encoding: &Encoding) -> Training<'static> {
        let whole = Training::in_memory(TrainingParts {
            parameters: encoding.parameters.clone(),
            parameter_names: encoding.names.clone(),
            ..self.base.clone()
        });
        match &self.movement {
            Some(movement) => whole.moving(movement.clone()),
            None => whole,
        }
    }

    /// Everything but some poses, by their indices among the training poses.
    pub(super) fn without(&'a self, left_out: &[usize]) -> Bench<'a> {
        let keep: Vec<usize> =
            (0..self.poses.len()).filter(|pose| !left_out.contains(pose)).collect();
        let trainings = self.encodings.iter().map(|e| self.training(e).only(&keep)).collect();
        let shared = Shared::new(self.largest).with_inscribed(self.inscribed.clone());
        Bench { bench: self, keep, left_out: left_out.to_vec(), trainings, shared }
    }
}

impl Bench<'_> {
    /// A candidate in every precision, and with every reach.
    pub(super) fn try_out(&self, candidate: &CandidateRecipe) -> Result<Tried, Error> {
        let own = self.lessened(&candidate.recipe)?;
        let (encoding, training) = match &own {
            Some((encoding, training)) => (encoding, training),
            None => self.encoded(&candidate.recipe)?,
        };
        let fitted = self.fit(&candidate.recipe, encoding, training)?;
        let evaluate_us = self.time(&fitted.model, encoding)? * self.bench.ratio;
        let (mut points, mut models) = (Vec::new(), Vec::new());
        for &precision in Precision::ALL {
            let (mut point, model) = point(candidate, &fitted, precision, evaluate_us)?;
            self.enlarge(&mut point, &model, precision);
            let carries = candidate.recipe.fit.include_rest && model.needs_surface();
            point.bytes += if carries { self.bench.rest_bytes } else { 0 };
            points.push(point);
            models.push(model);
        }
        let count = models.len();
        let asks = candidate.recipe.fit.reach.is_none();
        if asks && candidate.recipe.target.on == OnName::Novel && fitted.model.has_distance() {
            for reach in reaches().skip(1) {
                models.push(fitted.model.clone().with_reach(reach)?);
            }
        }
        let all = self.mean_squares(&models, encoding)?;
        let held = all[..1].iter().chain(&all[count..]).copied().collect();
        Ok(Tried { points, squares: all[..count].to_vec(), held })
    }

    /// Coefficients of a channel in the data.
    pub(super) fn coefficients(&self) -> usize {
        self.bench.base.coefficients
    }

    /// The parametrisation that a recipe asks for.
    fn encoded(&self, recipe: &Recipe) -> Result<(&Encoding, &Training<'static>), Error> {
        let asked = recipe.fit.parametrisation.unwrap_or(self.bench.stored);
        let which = self.bench.encodings.iter().position(|encoding| encoding.name == asked);
        let which = which.expect("every candidate's parametrisation is read at the start");
        Ok((&self.bench.encodings[which], &self.trainings[which]))
    }

    /// The same where the recipe leaves parameters or bands out.
    fn lessened(&self, recipe: &Recipe) -> Result<Option<(Encoding, Training<'static>)>, Error> {
        if recipe.fit.without.is_empty() && recipe.fit.bands.is_none() {
            return Ok(None);
        }
        let (encoding, _) = self.encoded(recipe)?;
        let (whole, rig) =
            encoding::lessened(self.bench.training(encoding), encoding.rig.clone(), &recipe.fit)?;
        let lessened = Encoding {
            name: encoding.name,
            parameters: whole.parameters().to_vec(),
            names: whole.parameter_names().to_vec(),
            rig,
        };
        Ok(Some((lessened, whole.only(&self.keep))))
    }

    fn fit(
        &self,
        recipe: &Recipe,
        encoding: &Encoding,
        training: &Training<'static>,
    ) -> Result<FittedModel, Error> {
        let bench = self.bench;
        let mut recipe = recipe.clone();
        // Shares of the points stay shares.
        recipe.fit.point_clusters = recipe
            .fit
            .point_clusters
            .map(|count| ((f64::from(count) / bench.ratio).round() as u32).max(1));
        let (checked, mut settings) = settings_for(bench.dataset, &recipe)?;
        if !bench.is_timing {
            settings.steps = settings.steps.min(STEPS);
        }
        let job = bench.posed.as_ref().map(|(job, _)| job).filter(|_| settings.looks_at_mesh());
        let mut geometry = job.map(|job| geometry(job, (&encoding.rig, &settings), &[]));
        if let Some(geometry) = &mut geometry {
            geometry.poses = self.keep.iter().map(|&i| geometry.poses[i]).collect();
            geometry.order = order_kept(bench.dataset, &recipe).unwrap_or(geometry.order);
        }
        let start = Instant::now();
        // What others share is of all coefficients.
        let own = Shared::new(bench.largest).with_inscribed(bench.inscribed.clone());
        let alone = recipe.fit.bands.is_some() || bench.is_timing;
        let shared = if alone { &own } else { &self.shared };
        let fitted = fit_sizes(training, settings, &recipe, geometry.as_ref(), shared)?;
        let fit_s = start.elapsed().as_secs_f64() * bench.ratio;
        let assembled = Assembled {
            rig: encoding.rig.clone(),
            bone_of_point: bench.base.point_bones.clone(),
            point_of_vertex: (0..bench.base.points as u32).collect(),
            is_part: true,
            job,
        };
        let report = fitted.report.clone();
        let model = assemble(bench.dataset, &recipe, (&checked, settings), fitted, assembled)?;
        Ok(FittedModel { model, report, fit_s })
    }

    /// Microseconds of one evaluation, as [`super::timing`] has them.
    fn time(&self, model: &Model, encoding: &Encoding) -> Result<f64, Error> {
        let mut out = vec![0.0; self.bench.base.points * model.header().width()];
        let mut least = f64::INFINITY;
        for _ in 0..REPETITIONS {
            let start = Instant::now();
            self.evaluate(black_box(model), encoding.of(0), &mut out)?;
            least = least.min(start.elapsed().as_secs_f64() * 1e6);
        }
        Ok(least)
    }

    /// The training poses' first, in the model's own frame unless it looks at the posed mesh.
    fn evaluate(&self, model: &Model, parameters: &[f32], out: &mut [f32]) -> Result<(), Error> {
        if model.needs_surface() {
            return Ok(model.evaluate_posed(&self.posed_input(parameters, 0), out)?);
        }
        Ok(model.evaluate(parameters, None, out)?)
    }

    fn posed_input<'p>(&'p self, parameters: &'p [f32], pose: usize) -> PosedInput<'p> {
        let base = &self.bench.base;
        let surface = self.bench.posed.as_ref().map(|(_, surfaces)| surfaces[pose].as_surface());
        let bone_rotations = &base.bone_rotations[pose * base.bones..(pose + 1) * base.bones];
        PosedInput { parameters, bone_rotations, surface }
    }

    fn predict(
        &self,
        model: &Model,
        encoding: &Encoding,
        pose: usize,
        out: &mut [f32],
    ) -> Result<(), Error> {
        self.predict_at(model, encoding.of(pose), pose, out)
    }

    fn predict_at(
        &self,
        model: &Model,
        parameters: &[f32],
        pose: usize,
        out: &mut [f32],
    ) -> Result<(), Error> {
        let input = self.posed_input(parameters, pose);
        evaluate_widened(model, &input, self.bench.base.coefficients, out)
    }

    /// Less the noise of the data.
    fn mean_squares(&self, models: &[Model], encoding: &Encoding) -> Result<Vec<f64>, Error> {
        let base = &self.bench.base;
        if self.left_out.is_empty() {
            // What is there is off by its noise.
            return Ok(vec![base.noise_variance; models.len()]);
        }
        let numbers = base.points * base.channels * base.coefficients;
        let mut found = vec![0.0; numbers];
        let mut sums = vec![0.0; models.len()];
        for &pose in &self.left_out {
            let truth = &base.values[pose * numbers..(pose + 1) * numbers];
            for (model, sum) in models.iter().zip(&mut sums) {
                self.predict(model, encoding, pose, &mut found)?;
                let errors = found.iter().zip(truth).map(|(y, t)| f64::from(y - t).powi(2));
                *sum += errors.sum::<f64>();
            }
        }
        let count = (self.left_out.len() * numbers).max(1) as f64;
        Ok(sums.into_iter().map(|sum| sum / count - base.noise_variance).collect())
    }
}
