//! A model against the references of its data set.

use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

use super::imported::Imported;
use super::progress::{Progress, Stage, Watch};
use super::recipe::{OnName, Recipe};
use super::{Error, Job, encoding, fit_mean, recipe_of};
use crate::dataset::{Dataset, Reference};
use crate::measure::{Candidate, Case, Kind, Measured, Measurement, Settings};
use crate::model::{Header, Model, PosedInput, PosedPoints, Precision, Signal};
use crate::pose::Split;
use crate::sh::Order;

/// Candidates of one measurement: the model, the mean that it must beat, and the model at each
/// other precision.
struct Candidates {
    models: Vec<Model>,
    entries: Vec<Candidate>,
    /// For each model those of every pose of the data set, `[pose, parameter]`.
    parameters: Vec<Arc<Vec<f32>>>,
    /// Poses the mesh, where a model looks at it.
    job: Option<Rc<Job>>,
    /// Whether they are for the clips that they were trained on.
    on_trained: bool,
}

/// Measures a model on every pose that the references cover, beside the mean that `recipe` gives
/// and beside the other precisions of `exact`, the same fit before it was quantised.
///
/// # Errors
/// [`Error::OtherDataset`] where the model was fitted to another bake; what the stages object to.
pub fn measure(
    (model, exact): (&Model, &Model),
    dataset: &Dataset,
    recipe: &Recipe,
    watch: &Watch,
) -> Result<Measured, Error> {
    belongs(model, dataset)?;
    let reference = Reference::open(dataset)?;
    let mean = fit_mean(dataset, recipe)?;
    let dataset = Imported::new(dataset);
    let mut candidates = candidates((model, exact), mean, &dataset)?;
    candidates.on_trained = recipe.target.on == OnName::Trained;
    stream(&candidates, &dataset, &reference, watch)
}

/// Measures several models of one data set beside each other; the first is the headline.
///
/// # Errors
/// As [`measure`]; also without any model.
pub(super) fn measure_many(
    named: &[(String, Model)],
    dataset: &Imported<'_>,
    watch: &Watch,
) -> Result<Measured, Error> {
    named.iter().try_for_each(|(_, model)| belongs(model, dataset))?;
    measure_any(named, dataset, watch)
}

/// The same for models of any bake of the data set's poses.
///
/// # Errors
/// As [`measure_many`], but never [`Error::OtherDataset`].
pub(super) fn measure_any(
    named: &[(String, Model)],
    dataset: &Imported<'_>,
    watch: &Watch,
) -> Result<Measured, Error> {
    let reference = Reference::open(dataset)?;
    let mut known: Vec<(&Model, Arc<Vec<f32>>)> = Vec::new();
    let mut parameters = Vec::new();
    for (_, model) in named {
        let like = known.iter().find(|k| k.0.header().rig.columns == model.header().rig.columns);
        let own = match like {
            Some((_, parameters)) => Arc::clone(parameters),
            None => Arc::new(encoding::parameters(model, dataset)?),
        };
        known.push((model, Arc::clone(&own)));
        parameters.push(own);
    }
    let kind = |i: usize| if i == 0 { Kind::Model } else { Kind::Baseline };
    let entries = named.iter().enumerate();
    let entries = entries.map(|(i, (name, _))| Candidate { name: name.clone(), kind: kind(i) });
    let entries = entries.collect();
    let models: Vec<Model> = named.iter().map(|(_, model)| model.clone()).collect();
    let job = models.iter().any(Model::needs_surface).then(|| dataset.job()).transpose()?;
    let on_trained = false;
    let candidates = Candidates { models, entries, parameters, job, on_trained };
    stream(&candidates, dataset, &reference, watch)
}

/// All candidates at every pose of the references.
fn stream(
    candidates: &Candidates,
    dataset: &Imported<'_>,
    reference: &Reference,
    watch: &Watch,
) -> Result<Measured, Error> {
    let settings = settings(&candidates.models[0], dataset, reference, candidates)?;
    let mut measurement = Measurement::new(settings)?;
    let total = reference.header().poses.len();
    let start = Instant::now();
    let mut bench = Bench::new(dataset, candidates);
    for index in 0..total {
        if watch.is_cancelled() {
            let when = format!("after {index} of {total} poses were measured");
            return Err(Error::Stopped { when });
        }
        bench.load(dataset, reference, candidates, index)?;
        let values = bench.values.iter().map(Vec::as_slice);
        let named: Vec<(&str, &[f32])> =
            candidates.entries.iter().map(|entry| entry.name.as_str()).zip(values).collect();
        measurement.add(&Case { candidates: &named, ..bench.case(dataset) })?;
        (watch.report)(Progress {
            stage: Stage::Measure,
            done: index as u64 + 1,
            total: total as u64,
            rays: 0,
            elapsed_s: start.elapsed().as_secs_f64(),
        });
    }
    Ok(measurement.finish())
}

/// A model is measured on the bake that it was fitted to, or the split into seen and unseen
/// motion means nothing.
pub(super) fn belongs(model: &Model, dataset: &Dataset) -> Result<(), Error> {
    let hash = |hashes: &std::collections::BTreeMap<String, String>| {
        hashes.get("bake").cloned().unwrap_or_else(|| "none".to_owned())
    };
    let (model, dataset) =
        (hash(&model.header().provenance.hashes), hash(&dataset.header().attributes.hashes));
    if model == dataset { Ok(()) } else { Err(Error::OtherDataset { model, dataset }) }
}

fn candidates(
    (model, exact): (&Model, &Model),
    mean: Model,
    dataset: &Imported<'_>,
) -> Result<Candidates, Error> {
    let entry = |name: &str, kind| Candidate { name: name.to_owned(), kind };
    let own = model.header().precision;
    let mut models = vec![model.clone(), mean];
    let mut entries = vec![entry("model", Kind::Model), entry("mean", Kind::Baseline)];
    for &precision in Precision::ALL {
        if precision != own {
            models.push(Model::from_bytes(&exact.to_bytes(precision)?)?);
            entries.push(entry(precision.name(), Kind::Precision));
        }
    }
    let parameters = Arc::new(encoding::parameters(model, dataset)?);
    let parameters = vec![parameters; models.len()];
    let job = models.iter().any(Model::needs_surface).then(|| dataset.job()).transpose()?;
    Ok(Candidates { models, entries, parameters, job, on_trained: false })
}

fn settings(
    model: &Model,
    dataset: &Imported<'_>,
    reference: &Reference,
    candidates: &Candidates,
) -> Result<Settings, Error> {
    let header = model.header();
    Ok(Settings {
        signal: header.signal,
        order: data_order(dataset, header),
        channels: usize::from(header.channels),
        vertex_of_point: dataset.mesh().vertex_of_point.clone(),
        parts: dataset.job()?.scene.mesh.parts.clone(),
        candidates: candidates.entries.clone(),
        // Where the model is not in f32 itself, the first of its other precisions is.
        exact: (header.precision != Precision::F32)
            .then(|| candidates.entries.iter().position(|entry| entry.kind == Kind::Precision))
            .flatten(),
        on_trained: candidates.on_trained,
        frame_s: 1.0 / recipe_of(dataset)?.poses.rate_hz,
        reference_rays: Some(reference.header().rays),
    })
}

/// The order of what was baked, of which a model may keep fewer bands.
fn data_order(dataset: &Dataset, header: &Header) -> Order {
    let order = Order::new(dataset.header().attributes.order).ok();
    order.filter(|_| header.signal != Signal::Ao).unwrap_or_else(|| header.sh_order())
}

/// The buffers of one pose.
struct Bench {
    pose: usize,
    references: [Vec<f32>; 2],
    normals: Vec<glam::Vec3>,
    values: Vec<Vec<f32>>,
}

impl Bench {
    fn new(dataset: &Dataset, candidates: &Candidates) -> Self {
        let layout = &dataset.header().layout;
        let numbers = layout.points * layout.row();
        Self {
            pose: 0,
            references: [vec![0.0; numbers], vec![0.0; numbers]],
            normals: Vec::new(),
            values: candidates.models.iter().map(|_| vec![0.0; numbers]).collect(),
        }
    }

    fn load(
        &mut self,
        dataset: &Dataset,
        reference: &Reference,
        candidates: &Candidates,
        index: usize,
    ) -> Result<(), Error> {
        self.pose = reference.header().poses[index];
        for (seed, out) in self.references.iter_mut().enumerate() {
            reference.read(seed, index, out)?;
        }
        self.normals = reference.read_normals(index)?;
        let turns = candidates.models.iter().any(Model::turns_with_tangents);
        let surface = candidates.job.as_ref().map(|job| job.surface(self.pose, turns));
        let models = candidates.models.iter().zip(&candidates.parameters);
        for ((model, parameters), out) in models.zip(&mut self.values) {
            let pose = (self.pose, surface.as_ref());
            predict(model, dataset, parameters, pose, out)?;
        }
        Ok(())
    }

    /// The pose without its candidates.
    fn case<'a>(&'a self, dataset: &'a Dataset) -> Case<'a> {
        let poses = dataset.poses();
        let clip = usize::try_from(poses.clips[self.pose]).ok();
        let names = &dataset.header().attributes.clip_names;
        Case {
            pose: self.pose,
            clip: clip.and_then(|clip| names.get(clip)).map_or("", String::as_str),
            time_s: poses.times_s[self.pose],
            split: split(poses.splits[self.pose]).into(),
            normals: &self.normals,
            reference1: &self.references[0],
            reference2: &self.references[1],
            candidates: &[],
        }
    }
}

/// A model's coefficients at a pose of the data set, root frame.
pub(super) fn predict(
    model: &Model,
    dataset: &Dataset,
    parameters: &[f32],
    (pose, surface): (usize, Option<&PosedPoints>),
    out: &mut [f32],
) -> Result<(), Error> {
    let layout = &dataset.header().layout;
    let row = |width: usize| pose * width..(pose + 1) * width;
    let input = PosedInput {
        parameters: &parameters[row(model.header().parameters())],
        bone_rotations: &dataset.bone_rotations()[row(layout.bones)],
        surface: surface.map(PosedPoints::as_surface),
    };
    evaluate_widened(model, &input, layout.coefficients, out)
}

/// A model at a pose, `[point, channel, coefficient]` with so many coefficients: what a model of
/// fewer bands does not have is 0.
pub(super) fn evaluate_widened(
    model: &Model,
    input: &PosedInput<'_>,
    all: usize,
    out: &mut [f32],
) -> Result<(), Error> {
    let kept = model.header().coefficients();
    if kept == all {
        return Ok(model.evaluate_posed(input, out)?);
    }
    let mut few = vec![0.0; out.len() / all * kept];
    model.evaluate_posed(input, &mut few)?;
    for (out, few) in out.chunks_exact_mut(all).zip(few.chunks_exact(kept)) {
        out[..kept].copy_from_slice(few);
        out[kept..].fill(0.0);
    }
    Ok(())
}

fn split(index: u8) -> Split {
    match index {
        0 => Split::Training,
        1 => Split::Novel,
        2 => Split::Interpolated,
        3 => Split::WithinClip,
        other => unreachable!("the data set's reader checks its splits, and found {other}"),
    }
}
