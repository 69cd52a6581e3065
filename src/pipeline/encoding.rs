//! The pose parameters of a fit, where they are not those that the data set stores: another
//! parametrisation of the same poses needs no new bake.

use super::imported::Imported;
use super::recipe::{FamilyName, FitRecipe, Recipe};
use super::{Error, Job, RecipeError, recipe_of};
use crate::dataset::{Dataset, Movement, Training};
use crate::model::{Model, RigHeader};
use crate::pose::{Sample, Split};
use crate::rig;

/// Poses at which points that move alike are told from others, where no skeleton tells them.
const TURNS: usize = 12;

/// The training poses of a data set in the parametrisation that a recipe's fit asks for, and the
/// rig whose columns these are.
///
/// Without the parameters and bands that the fit leaves out.
pub(super) fn training<'a>(
    dataset: &Imported<'a>,
    recipe: &Recipe,
    left_out: &[i32],
) -> Result<(Training<'a>, RigHeader), Error> {
    let (training, rig) = whole(dataset, recipe, left_out)?;
    lessened(training, rig, &recipe.fit)
}

/// A training set and its rig without the parameters and bands that a fit leaves out.
pub(super) fn lessened<'a>(
    mut training: Training<'a>,
    mut rig: RigHeader,
    fit: &FitRecipe,
) -> Result<(Training<'a>, RigHeader), Error> {
    if !fit.without.is_empty() {
        let names = training.parameter_names();
        if let Some(unknown) = fit.without.iter().find(|name| !names.contains(name)) {
            return Err(Error::Recipe(RecipeError {
                field: "fit.without",
                found: format!("`{unknown}`"),
                expected: "it names no pose parameter of this data set; `inspect` lists them",
            }));
        }
        let kept: Vec<usize> =
            (0..names.len()).filter(|&i| !fit.without.contains(&names[i])).collect();
        let names: Vec<String> = kept.iter().map(|&i| names[i].clone()).collect();
        let rows = training.parameters().chunks_exact(training.parameter_names().len());
        let parameters = rows.flat_map(|row| kept.iter().map(|&i| row[i])).collect();
        rig.columns = kept.iter().map(|&i| rig.columns[i].clone()).collect();
        rig.dropped.extend(fit.without.iter().cloned());
        training = training.with_parameters(parameters, names);
    }
    if let Some(bands) = fit.bands.map(|bands| usize::from(bands).pow(2)) {
        let keep = bands.min(training.coefficients());
        training = training.with_coefficients(keep);
    }
    Ok((training, rig))
}

fn whole<'a>(
    dataset: &Imported<'a>,
    recipe: &Recipe,
    left_out: &[i32],
) -> Result<(Training<'a>, RigHeader), Error> {
    let stored = recipe_of(dataset)?.poses.parametrisation;
    let training = dataset.dataset.training_without(left_out)?;
    let training = moving(training, dataset, recipe, left_out)?;
    match recipe.fit.parametrisation {
        Some(asked) if asked != stored => {
            let job = dataset.job_as(recipe.fit.parametrisation)?;
            let columns = &job.poses.parametrisation.columns;
            let names = columns.iter().map(|column| column.name.clone()).collect();
            let rows = job.poses.parameters.chunks_exact(columns.len().max(1));
            let of_training = job.poses.samples.iter().zip(rows);
            let parameters = of_training
                .filter(|(sample, _)| is_training(sample, left_out))
                .flat_map(|(_, row)| row.iter().copied())
                .collect();
            Ok((training.with_parameters(parameters, names), super::describe::rig_header(&job)))
        }
        _ => Ok((training, stored_rig(dataset)?)),
    }
}

/// Whether a fit that leaves these clips out sees a pose.
pub(super) fn is_training(sample: &Sample, left_out: &[i32]) -> bool {
    sample.split == Split::Training && !left_out.contains(&(sample.clip as i32))
}

/// Adds how points move where the family goes by that: skin weights, or where one node carries all points how
/// the surface turns.
fn moving<'a>(
    training: Training<'a>,
    dataset: &Imported<'_>,
    recipe: &Recipe,
    left_out: &[i32],
) -> Result<Training<'a>, Error> {
    use FamilyName::{ClusteredLinear, ClusteredQuadratic, ClusteredTanh};
    if !matches!(recipe.fit.family, ClusteredLinear | ClusteredQuadratic | ClusteredTanh) {
        return Ok(training);
    }
    let job = dataset.job_as(recipe.fit.parametrisation)?;
    let mesh = &job.scene.mesh;
    let influences = |&vertex: &u32| {
        let all = mesh.influences_of(vertex as usize).iter();
        all.map(|i| (mesh.deformers[i.deformer as usize].node as u32, i.weight)).collect()
    };
    let weights: Vec<Vec<(u32, f32)>> = job.poses.points.vertex.iter().map(influences).collect();
    let of_one = |weights: &Vec<(u32, f32)>| match (&weights[..], weights.first()) {
        ([(node, _)], Some(_)) => Some(*node),
        _ => None,
    };
    let first = weights.first().and_then(of_one);
    let is_one = first.is_some() && weights.iter().all(|weights| of_one(weights) == first);
    let movement = if is_one { turns(&job, left_out) } else { Movement::Weights(weights) };
    Ok(training.moving(movement))
}

/// How the surface turns at some of the training poses, evenly among them.
fn turns(job: &Job, left_out: &[i32]) -> Movement {
    let samples = job.poses.samples.iter().enumerate();
    let poses: Vec<usize> =
        samples.filter(|(_, sample)| is_training(sample, left_out)).map(|(pose, _)| pose).collect();
    let step = poses.len().div_ceil(TURNS).max(1);
    let some: Vec<usize> = poses.into_iter().step_by(step).collect();
    let point = |vertex: u32| job.poses.points.of_vertex[vertex as usize];
    let corners: Vec<[u32; 3]> =
        job.scene.mesh.triangles.iter().map(|corners| corners.map(point)).collect();
    let rest = job.rest_points();
    let width = 9 * some.len();
    let mut values = vec![0.0; rest.len() * width];
    // |R − S| is 2√2 sin(θ/2) in the Frobenius norm.
    let scale = 0.5 / (some.len().max(1) as f32).sqrt();
    for (place, &pose) in some.iter().enumerate() {
        let surface = job.surface(pose, false);
        let turns = rig::turns(&corners, &rest, surface.as_surface().positions);
        for (row, turn) in values.chunks_exact_mut(width).zip(turns) {
            let numbers = turn.to_cols_array().map(|x| x * scale);
            row[9 * place..9 * (place + 1)].copy_from_slice(&numbers);
        }
    }
    Movement::Turns { width, values }
}

fn stored_rig(dataset: &Dataset) -> Result<RigHeader, Error> {
    serde_json::from_value(dataset.header().attributes.rig.clone())
        .map_err(|source| Error::Json { what: "the rig in the data set".into(), source })
}

/// The parameters of every pose of the data set as a model takes them, `[pose, parameter]`.
pub(super) fn parameters(model: &Model, dataset: &Imported<'_>) -> Result<Vec<f32>, Error> {
    if model.header().rig.columns == stored_rig(dataset)?.columns {
        return Ok(dataset.parameters().to_vec());
    }
    let job = dataset.job()?;
    let mut parameters = Vec::new();
    for (pose, sample) in job.poses.samples.iter().enumerate() {
        let surface = model.needs_positions().then(|| job.surface(pose, false));
        let points = surface.as_ref().map_or(&[][..], |surface| surface.as_surface().positions);
        parameters.extend(model.parameters_of_posed(&sample.pose, points)?);
    }
    Ok(parameters)
}
