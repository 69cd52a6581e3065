//! Families `clustered-linear`, `-quadratic` and `-tanh` (RPO09 §5): for every cluster of points
//! the principal components of its outputs, and a small map from the reduced pose to these.

use std::borrow::Cow;

use rayon::prelude::*;

use super::design::Design;
use super::freedom::Freedom;
use super::mean_shift;
use super::moments::Scratch;
use super::neurons::{self, Data};
use super::output_parts::{Part, parts};
use super::report::Clock;
use super::ridge::{Regression, summary};
use super::shared::Outputs;
use super::source::Source;
use super::still::set_aside;
use super::{Error, FitReport, Fitted, On, Settings, Shared};
use crate::dataset::{Movement, Training};
use crate::model::{Cluster, Clustered, Decoder, Form};
use crate::num::linalg::{Mat, MatRef, product, rows_of, rows_of_mut};

/// How many dimensions are kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kept {
    /// So many, or as many as there are.
    Count(usize),
    /// The fewest that hold this share of the variance, in (0, 1].
    Share(f64),
}

/// The sizes of a clustered model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClusteredSizes {
    /// The features of every cluster.
    pub form: Form,
    /// Clusters of points, from 1 to their number; as many as mean shift finds when `None`.
    pub clusters: Option<usize>,
    /// Of the pose; RPO09 keeps 90 % of the variance.
    pub inputs: Kept,
    /// Of each cluster's outputs; RPO09 keeps 95 % of the variance.
    pub outputs: Kept,
    /// Neurons of each cluster; by cross-validation when `None`.
    pub neurons: Option<usize>,
}

/// Numbers of neurons to choose from (RPO09: "few").
const NEURONS: [usize; 3] = [3, 6, 12];

/// What one cluster's map leaves of its reduced outputs.
struct Mapped {
    cluster: Cluster,
    energy: f64,
    alpha: f64,
    freedom: Freedom,
}

pub(super) fn fit(
    (source, training, design): (&Source<'_>, &Training<'_>, &Design),
    sizes: ClusteredSizes,
    settings: &Settings,
    shared: &Shared,
    clock: &mut Clock,
) -> Result<Fitted, Error> {
    let inputs = inputs(design, sizes.inputs)?;
    if let Some(asked) = sizes.clusters
        && !(1..=source.points()).contains(&asked)
    {
        let available = source.points();
        return Err(Error::Clusters { what: "clusters of points", asked, available });
    }
    let labels = shared
        .labels(sizes.clusters, || mean_shift::clusters(&movement(training), sizes.clusters))?;
    clock.lap("point_clusters_s");
    let most = shared.largest().map_or(sizes.outputs, |largest| largest.cluster_outputs);
    let all = shared.parts((Outputs::of(settings), sizes.clusters), || {
        parts(source, &labels, most, settings.seed)
    })?;
    let parts: Vec<Part> = match most == sizes.outputs {
        true => Vec::new(),
        false => all.par_iter().map(|part| part.only(sizes.outputs)).collect(),
    };
    let parts = if most == sizes.outputs { &all[..] } else { &parts[..] };
    clock.lap("output_pca_s");
    // U s V's leading part: the reduced pose of every pose, in the units of the parameters, as the
    // model sees it, which subtracts the centre in f32.
    let (poses, moved) = (design.poses(), design.rounding(inputs));
    let reduced = Mat::from_fn(poses, inputs, |i, k| design.u[(i, k)] * design.s[k] - moved[k]);
    let maps: Vec<Mapped> = parts
        .par_iter()
        .map(|part| map(part, reduced.as_ref(), training.clips(), &sizes, settings))
        .collect::<Result<_, Error>>()?;
    clock.lap("maps_s");
    let mut report = report(source, design, (parts, sizes.outputs), &maps, inputs);
    let directions = design.directions(inputs);
    let mut model = Clustered {
        form: sizes.form,
        projection: directions.row_iter().flat_map(|r| r.iter().map(|&x| x as f32)).collect(),
        cluster_of_point: labels.iter().map(|&label| label as u32).collect(),
        clusters: maps.into_iter().map(|map| map.cluster).collect(),
    };
    let (still, saved) = set_aside(&mut model, parts, source);
    if still > 0 {
        report.notices.push(format!(
            "{still} of {} points never vary beyond the noise of the bake and keep only their \
             mean: {saved} numbers less",
            source.points()
        ));
    }
    let decoder = Decoder::Clustered(model);
    Ok(Fitted { decoder, training: summary(design, inputs, false), report, occluders: None })
}

fn inputs(design: &Design, kept: Kept) -> Result<usize, Error> {
    let (available, poses) = (design.rank(), design.poses());
    let asked = match kept {
        Kept::Count(count) => count,
        Kept::Share(share) => design.retaining(share).max(1),
    };
    match (1..=available).contains(&asked) {
        true => Ok(asked),
        false => Err(Error::Inputs { asked, poses, available }),
    }
}

/// How points move, or where that is not known each wholly with its bone.
fn movement<'a>(training: &'a Training<'_>) -> Cow<'a, Movement> {
    let rigid = || training.point_bones().iter().map(|&bone| vec![(u32::from(bone), 1.0)]);
    match training.movement() {
        Some(movement) => Cow::Borrowed(movement),
        None => Cow::Owned(Movement::Weights(rigid().collect())),
    }
}

/// The map of one cluster.
fn map(
    part: &Part,
    reduced: MatRef<'_, f64>,
    clips: &[i32],
    sizes: &ClusteredSizes,
    settings: &Settings,
) -> Result<Mapped, Error> {
    let outputs = part.scores.ncols();
    let mut cluster = Cluster { outputs, basis: part.basis(), ..Cluster::default() };
    if outputs == 0 {
        return Ok(Mapped { cluster, energy: 0.0, alpha: 0.0, freedom: Freedom::default() });
    }
    let (energy, alpha, freedom) = if sizes.form == Form::Tanh {
        layer(&mut cluster, part, reduced, clips, sizes, settings)
    } else {
        ridge(&mut cluster, part, reduced, clips, sizes.form, settings)?
    };
    Ok(Mapped { cluster, energy, alpha, freedom })
}

/// Weights of linear or quadratic features.
fn ridge(
    cluster: &mut Cluster,
    part: &Part,
    reduced: MatRef<'_, f64>,
    clips: &[i32],
    form: Form,
    settings: &Settings,
) -> Result<(f64, f64, Freedom), Error> {
    let (poses, outputs) = (reduced.nrows(), cluster.outputs);
    let rows: Vec<Vec<f32>> = (0..poses)
        .map(|i| {
            let x: Vec<f32> = (0..reduced.ncols()).map(|k| reduced[(i, k)] as f32).collect();
            form.features(&x, &[])
        })
        .collect();
    let count = rows[0].len();
    // A square of a parameter is as large as the parameter's own unit makes it: features of one
    // size each are penalised alike. Linear features keep PRT07's own metric.
    let scales: Vec<f32> = (0..count)
        .map(|j| {
            let rms =
                (rows.iter().map(|r| f64::from(r[j]).powi(2)).sum::<f64>() / poses as f64).sqrt();
            if form == Form::Linear || rms == 0.0 { 1.0 } else { 1.0 / rms as f32 }
        })
        .collect();
    let flat: Vec<f32> =
        rows.iter().flat_map(|r| r.iter().zip(&scales).map(|(x, s)| x * s)).collect();
    let names: Vec<String> = (0..count).map(|j| format!("feature {j}")).collect();
    let design = Design::new(&flat, &names, poses)?;
    let regression = Regression::new(&design, clips, settings);
    let (absorber, mut moments) = (regression.absorber(), regression.moments());
    let mut b = Vec::with_capacity(poses * outputs);
    for i in 0..poses {
        let pose = absorber.pose(i);
        b.extend((0..outputs).map(|k| part.scores[(pose, k)]));
    }
    let mut c = vec![0.0; design.rank() * outputs];
    let c_rows = rows_of_mut(&mut c, design.rank(), outputs);
    let b_rows = rows_of_mut(&mut b, poses, outputs);
    absorber.absorb(b_rows, c_rows, &mut moments, &mut Scratch::default());
    let choice = regression.choose(&moments, design.rank())?;
    let gains = choice.filter.gains(&design.s);
    let c = rows_of(&c, design.rank(), outputs);
    let scaled = Mat::from_fn(design.rank(), outputs, |j, k| gains[j] * c[(j, k)]);
    let weights = product(design.v.as_ref(), scaled.as_ref());
    for k in 0..outputs {
        let mut bias = 0.0;
        for j in 0..count {
            bias -= weights[(j, k)] * design.centre[j];
            cluster.weights.push((weights[(j, k)] * f64::from(scales[j])) as f32);
        }
        cluster.weights.push(bias as f32);
    }
    let left = choice.filter.left(&design.s);
    let share = |k: usize| -> f64 {
        let along = left.iter().enumerate().map(|(j, w)| (1.0 - w) * c[(j, k)].powi(2));
        along.sum::<f64>() / part.squares()[k]
    };
    let freedom = Freedom {
        of_features: choice.filter.degrees_of_freedom(&design.s) - 1.0,
        held: (0..outputs).map(share).sum(),
    };
    Ok((moments.training_energy(&design, &left), choice.filter.alpha, freedom))
}

/// Weights of tanh neurons. Inputs and outputs are brought to the size of 1 first, each with one
/// scale for all, so that the penalty does not depend on units.
fn layer(
    cluster: &mut Cluster,
    part: &Part,
    reduced: MatRef<'_, f64>,
    clips: &[i32],
    sizes: &ClusteredSizes,
    settings: &Settings,
) -> (f64, f64, Freedom) {
    let (poses, inputs, outputs) = (reduced.nrows(), reduced.ncols(), cluster.outputs);
    let flat = |m: MatRef<'_, f64>, scale: f64| -> Vec<f64> {
        m.row_iter().flat_map(|row| row.iter().map(|x| x / scale).collect::<Vec<_>>()).collect()
    };
    let size = |m: MatRef<'_, f64>| {
        let energy: f64 = m.col(0).iter().map(|x| x * x).sum();
        (energy / poses as f64).sqrt().max(f64::MIN_POSITIVE)
    };
    let (x_scale, y_scale) = (size(reduced), size(part.scores.as_ref()));
    let (x, y) = (flat(reduced, x_scale), flat(part.scores.as_ref(), y_scale));
    let data = Data { x: &x, y: &y, inputs, outputs };
    let asked = sizes.neurons.map(|count| [count]);
    let counts = asked.as_ref().map_or(&NEURONS[..], |count| &count[..]);
    let regularised = settings.on == On::Novel;
    let fold = neurons::folds(clips);
    let budget = neurons::Budget { steps: settings.steps, seed: settings.seed };
    let (count, alpha) = neurons::choose(data, &fold, counts, regularised, budget);
    let layer = neurons::fit_fully(data, count, alpha, budget);
    for row in layer.hidden.chunks_exact(inputs + 1) {
        cluster.hidden.extend(row[..inputs].iter().map(|d| (d / x_scale) as f32));
        cluster.hidden.push(row[inputs] as f32);
    }
    cluster.weights = layer.weights.iter().map(|c| (c * y_scale) as f32).collect();
    let weights = layer.hidden.len() + layer.weights.len() - outputs;
    let energy = layer.energy * y_scale * y_scale;
    let held = 1.0 - energy / part.kept;
    (energy, layer.alpha, Freedom::of_neurons(weights, held, (poses, outputs)))
}

fn report(
    source: &Source<'_>,
    design: &Design,
    (parts, asked): (&[Part], Kept),
    maps: &[Mapped],
    inputs: usize,
) -> FitReport {
    let numbers = (source.poses() * source.points() * source.width()) as f64;
    let spread: f64 = parts.iter().map(|part| part.energy).sum();
    let kept: f64 = parts.iter().map(|part| part.kept).sum();
    let energy: f64 = spread - kept + maps.iter().map(|map| map.energy).sum::<f64>();
    let outputs: Vec<String> = maps.iter().map(|m| m.cluster.outputs.to_string()).collect();
    let neurons: Vec<String> =
        maps.iter().map(|m| (m.cluster.hidden.len() / (inputs + 1)).to_string()).collect();
    let mut notices =
        vec![format!("{} clusters of points with {} outputs each", maps.len(), outputs.join(", "))];
    let hidden: usize = parts.iter().map(|part| part.hidden(asked)).sum();
    if hidden > 0 {
        notices.push(format!(
            "{hidden} more outputs would only have held noise of the bake and were left out"
        ));
    }
    if maps.iter().any(|map| !map.cluster.hidden.is_empty()) {
        notices.push(format!("neurons of the clusters: {}", neurons.join(", ")));
    }
    let of_cluster =
        |(part, map): (&Part, &Mapped)| map.freedom.parameters(part.outputs(), map.cluster.outputs);
    let parameters: f64 = parts.iter().zip(maps).map(of_cluster).sum();
    FitReport {
        degrees_of_freedom: parameters / (source.points() * source.width()) as f64,
        alpha: maps.iter().map(|map| map.alpha).reduce(f64::max),
        training_rmse: (energy.max(0.0) / numbers).sqrt(),
        spread_rms: (spread / numbers).sqrt(),
        inputs,
        pose_spectrum: design.variances(),
        output_variance_retained: if spread > 0.0 { kept / spread } else { 1.0 },
        passes: 3,
        notices,
        ..FitReport::default()
    }
}
