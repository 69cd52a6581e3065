//! From a data set to a model.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use serde_json::Value;

use super::imported::Imported;
use super::recipe::{DEFAULT_INPUTS, DEFAULT_OUTPUTS, FitRecipe, Recipe};
use super::{Checked, Error, Hashes, Job, Progress, Stage, Watch, encoding};
use crate::dataset::{Dataset, Training};
use crate::fit::{self, FitReport, Fitted};
use crate::model::{
    self, ColumnHeader, FORMAT_VERSION, Frame, Header, MeshIdentity, Model, PartRange, Provenance,
    RigHeader,
};
use crate::sh::Order;

/// A model with the story of its fit.
#[derive(Debug)]
pub struct FittedModel {
    /// The model, its numbers in f32.
    pub model: Model,
    /// What the fit found out.
    pub report: FitReport,
    /// Wall time of the whole fit, seconds.
    pub fit_s: f64,
}

/// Fits the recipe's model to the training poses of a data set.
///
/// A data set without parameters (a static scene) gives its mean, whatever family is asked for.
///
/// # Errors
/// What the stages object to.
pub fn fit(dataset: &Dataset, recipe: &Recipe) -> Result<FittedModel, Error> {
    fit_without(dataset, recipe, &[])
}

/// [`fit()`] that a caller watches and can stop.
///
/// # Errors
/// [`Error::Stopped`] when the caller asked to stop; as [`fit()`].
pub fn fit_watched(
    dataset: &Dataset,
    recipe: &Recipe,
    watch: &Watch,
) -> Result<FittedModel, Error> {
    let start = Instant::now();
    let tell = |done| {
        let elapsed_s = start.elapsed().as_secs_f64();
        (watch.report)(Progress { stage: Stage::Fit, done, total: 1, rays: 0, elapsed_s });
    };
    tell(0);
    let dataset = Imported::new(dataset);
    let data = Part { stop: Some(watch.cancelled), ..Part::default() };
    let fitted = fit_part(&dataset, recipe, &data, &fit::Shared::default())?;
    if watch.is_cancelled() {
        return Err(Error::Stopped { when: "after the fit".to_owned() });
    }
    tell(1);
    Ok(fitted)
}

/// [`fit()`] without the training poses of some clips, by index: to try the recipe on them. The
/// parametrisation is the data set's, for which those clips had a say in what varies.
///
/// # Errors
/// As [`fit()`].
pub fn fit_without(
    dataset: &Dataset,
    recipe: &Recipe,
    left_out: &[i32],
) -> Result<FittedModel, Error> {
    let data = Part { left_out, ..Part::default() };
    fit_part(&Imported::new(dataset), recipe, &data, &fit::Shared::default())
}

/// What a fit sees of a data set.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Part<'a> {
    /// Clips without which it is done.
    pub(super) left_out: &'a [i32],
    /// Indices, ascending, of the only ones to see among the training poses that are left.
    pub(super) keep: Option<&'a [usize]>,
    /// The fit ends soon after this becomes true.
    pub(super) stop: Option<&'a AtomicBool>,
}

/// [`fit()`] to a part of the training poses, which is the same for all fits that share.
///
/// # Errors
/// As [`fit()`].
pub(super) fn fit_part(
    dataset: &Imported<'_>,
    recipe: &Recipe,
    &Part { left_out, keep, stop }: &Part<'_>,
    shared: &fit::Shared,
) -> Result<FittedModel, Error> {
    let (checked, settings) = settings_for(dataset, recipe)?;
    let start = Instant::now();
    let (training, rig) = encoding::training(dataset, recipe, left_out)?;
    let job = settings.looks_at_mesh().then(|| dataset.job()).transpose()?;
    let mut geometry = job.as_deref().map(|job| geometry(job, (&rig, &settings), left_out));
    let training = match keep {
        Some(keep) => training.only(keep),
        None => training,
    };
    let training = match stop {
        Some(stop) => training.stopped_by(stop),
        None => training,
    };
    if let (Some(geometry), Some(order)) = (&mut geometry, order_kept(dataset, recipe)) {
        geometry.order = order;
    }
    if let (Some(keep), Some(geometry)) = (keep, &mut geometry) {
        geometry.poses = keep.iter().map(|&i| geometry.poses[i]).collect();
    }
    let fitted = fit_sizes(&training, settings, recipe, geometry.as_ref(), shared)?;
    let fit_s = start.elapsed().as_secs_f64();
    let mesh = dataset.mesh();
    let assembled = Assembled {
        rig,
        bone_of_point: mesh.bone_of_point.clone(),
        point_of_vertex: mesh.point_of_vertex.clone(),
        is_part: false,
        job: job.as_deref(),
    };
    let report = fitted.report.clone();
    let model = assemble(dataset, recipe, (&checked, settings), fitted, assembled)?;
    let model = model.with_shapes(dataset.shapes())?;
    let model = if recipe.fit.include_rest { with_rest(model, dataset)? } else { model };
    Ok(FittedModel { model, report, fit_s })
}

/// The model with the points of its data set's scene at rest, if it looks at the posed mesh.
///
/// # Errors
/// What stands in the way of the scene in the data set.
pub(super) fn with_rest(model: Model, dataset: &Imported<'_>) -> Result<Model, Error> {
    if !model.needs_surface() {
        return Ok(model);
    }
    let job = dataset.job()?;
    Ok(model.with_rest(job.scene.mesh.subset(&job.poses.points.vertex))?)
}

/// The order of the harmonics that a fit keeps, where those are fewer than the data have.
pub(super) fn order_kept(dataset: &Dataset, recipe: &Recipe) -> Option<Order> {
    let fewer = recipe.fit.bands.filter(|&bands| bands < dataset.header().attributes.order)?;
    Order::new(fewer).ok()
}

/// The settings of a recipe's fit to a data set.
pub(super) fn settings_for(
    dataset: &Dataset,
    recipe: &Recipe,
) -> Result<(Checked, fit::Settings), Error> {
    let checked = Checked::new(recipe)?;
    let mut settings = checked.fit;
    if dataset.header().layout.parameters == 0 {
        settings.family = fit::Family::Mean;
        settings.spheres = None;
    }
    let is_ao = dataset.header().attributes.signal == "ao";
    if is_ao {
        // A scalar has no frame; but occluders are grouped by the points' bones.
        settings.frame = if settings.spheres.is_some() { Frame::Bone } else { Frame::Root };
        // The sum is fifteen times as quick, and for a scalar nearly as good.
        settings.directions = recipe.fit.directions.map_or(0, |_| settings.directions);
    }
    if settings.spheres.is_some() && settings.family == fit::Family::Mean && !is_ao {
        // As many outputs hold what occluders always leave at a point in full, as a mean would, and some of
        // what they leave from pose to pose.
        let bands =
            order_kept(dataset, recipe).map_or(dataset.header().attributes.order, Order::get);
        let outputs = DEFAULT_OUTPUTS.max(u32::from(bands).pow(2));
        settings.family = fit::Family::PcaLinear {
            inputs: DEFAULT_INPUTS as usize,
            outputs: recipe.fit.outputs.unwrap_or(outputs) as usize,
        };
    }
    Ok((checked, settings))
}

/// The mesh that a fit's numbers belong to.
pub(super) struct Assembled<'a> {
    pub(super) rig: RigHeader,
    pub(super) bone_of_point: Vec<u16>,
    pub(super) point_of_vertex: Vec<u32>,
    /// Whether these are only some of the scene's points.
    pub(super) is_part: bool,
    /// Has the tangents of a model in their frame.
    pub(super) job: Option<&'a Job>,
}

/// A model of what a fit found.
pub(super) fn assemble(
    dataset: &Dataset,
    recipe: &Recipe,
    (checked, settings): (&Checked, fit::Settings),
    fitted: Fitted,
    mesh: Assembled<'_>,
) -> Result<Model, Error> {
    let Fitted { decoder, training, occluders, .. } = fitted;
    let kind = (decoder.family(), settings.frame);
    let mut header = header(dataset, recipe, checked, (training, mesh.rig), kind);
    header.unshadowed = settings.unshadowed;
    header.training.reach = recipe.fit.reach;
    if mesh.is_part {
        header.mesh.parts.clear();
        header.mesh.vertices = mesh.point_of_vertex.len() as u32;
        header.mesh.points = mesh.bone_of_point.len() as u32;
    }
    let model = Model::new(header, decoder, mesh.point_of_vertex, mesh.bone_of_point)?;
    let model = match mesh.job {
        Some(job) if model.turns_with_tangents() => {
            model.with_tangents(job.tangents_of_points())?
        }
        _ => model,
    };
    Ok(match occluders {
        Some(occluders) => model.with_occluders(occluders)?,
        None => model,
    })
}

/// Sizes that nobody asked for give way to what the data have.
pub(super) fn fit_sizes(
    training: &Training<'_>,
    mut settings: fit::Settings,
    recipe: &Recipe,
    geometry: Option<&fit::Geometry<'_>>,
    shared: &fit::Shared,
) -> Result<Fitted, Error> {
    loop {
        match fit::fit_shared(training, &settings, geometry, shared) {
            Err(error) => give_way(&mut settings.family, &recipe.fit, error)?,
            fitted => return Ok(fitted?),
        }
    }
}

/// Takes what there is for a size that nobody asked for.
///
/// # Errors
/// The error itself, where somebody did ask for it, or nothing is there.
fn give_way(
    family: &mut fit::Family,
    recipe: &FitRecipe,
    error: fit::Error,
) -> Result<(), fit::Error> {
    use fit::Family::{Multilinear, PcaLinear, PcaRetaining};
    use fit::Kept::Count;
    let (size, asked, available) = match (&error, family) {
        (
            fit::Error::Inputs { available, .. },
            PcaLinear { inputs, .. } | PcaRetaining { inputs: Count(inputs), .. },
        ) => (inputs, recipe.inputs, *available),
        (
            fit::Error::Outputs { available, .. },
            PcaLinear { outputs, .. } | PcaRetaining { outputs: Count(outputs), .. },
        ) => (outputs, recipe.outputs, *available),
        (fit::Error::Inputs { available, .. }, Multilinear(sizes)) => {
            (&mut sizes.inputs, recipe.inputs, *available)
        }
        // Clusters of points have no default: only those of poses can be too many unasked.
        (fit::Error::Clusters { available, .. }, Multilinear(sizes))
            if sizes.clusters > *available =>
        {
            (&mut sizes.clusters, recipe.clusters, *available)
        }
        _ => return Err(error),
    };
    if asked.is_some() || available == 0 {
        return Err(error);
    }
    *size = available;
    Ok(())
}

/// The job's mesh at its training poses, and the joints of a rig's parameters.
pub(super) fn geometry<'a>(
    job: &'a Job,
    (rig, settings): (&RigHeader, &fit::Settings),
    left_out: &[i32],
) -> fit::Geometry<'a> {
    let joint = |column: &ColumnHeader| {
        let node = rig.nodes.get(column.source.node()? as usize)?;
        job.scene.skeleton.find(&node.name)
    };
    let training =
        job.poses.samples.iter().filter(|sample| encoding::is_training(sample, left_out));
    fit::Geometry {
        signal: job.checked.bake.signal,
        order: job.checked.bake.order,
        skeleton: &job.scene.skeleton,
        mesh: &job.scene.mesh,
        points: &job.poses.points,
        bones: &job.poses.bones,
        columns: rig.columns.iter().map(joint).collect(),
        tangents: (settings.frame == Frame::Tangent).then(|| job.tangents()),
        poses: training.map(|sample| (&sample.pose, sample.root)).collect(),
    }
}

/// The mean over training poses in the same frame: what every model must beat.
///
/// # Errors
/// What the stages object to.
pub fn fit_mean(dataset: &Dataset, recipe: &Recipe) -> Result<Model, Error> {
    let mut recipe = recipe.clone();
    recipe.fit.family = super::recipe::FamilyName::Mean;
    recipe.fit.unshadowed = None;
    recipe.fit.bands = None;
    Ok(fit(dataset, &recipe)?.model)
}

/// The recipe of a data set with the parts that a fit may choose taken from `edited`.
///
/// # Errors
/// [`Error::Json`] if the stored recipe is not one.
pub fn recipe_of(dataset: &Dataset) -> Result<Recipe, Error> {
    serde_json::from_value(dataset.header().attributes.recipe.clone()).map_err(|source| {
        Error::Json { what: format!("the recipe in {}", dataset.path().display()), source }
    })
}

/// The recipe that a model carries.
///
/// # Errors
/// [`Error::Json`] if it is not one.
pub fn recipe_of_model(model: &Model) -> Result<Recipe, Error> {
    serde_json::from_value(model.header().provenance.recipe.clone())
        .map_err(|source| Error::Json { what: "the recipe in the model".into(), source })
}

fn header(
    dataset: &Dataset,
    recipe: &Recipe,
    checked: &Checked,
    (training, rig): (model::TrainingSummary, RigHeader),
    (family, frame): (model::Family, Frame),
) -> Header {
    let attributes = &dataset.header().attributes;
    let layout = &dataset.header().layout;
    let scene = attributes.hashes.get("scene").cloned().unwrap_or_default();
    let hashes = Hashes::of(&scene, recipe);
    let signal = model::Signal::from_name(&attributes.signal).unwrap_or(model::Signal::Transfer);
    Header {
        format_version: FORMAT_VERSION,
        family,
        precision: checked.precision,
        signal,
        order: match signal {
            model::Signal::Ao => 1,
            _ => recipe.fit.bands.map_or(attributes.order, |bands| bands.min(attributes.order)),
        },
        channels: layout.channels as u8,
        frame,
        conventions: Header::conventions(),
        unshadowed: false,
        occluders: None,
        rest: None,
        mesh: MeshIdentity {
            scene_sha256: scene,
            shape_sha256: None,
            receivers_sha256: None,
            vertices: layout.vertices as u32,
            points: layout.points as u32,
            parts: parts(dataset, &rig),
        },
        rig,
        training,
        errors: BTreeMap::new(),
        provenance: Provenance {
            generator: concat!("poselight ", env!("CARGO_PKG_VERSION")).to_owned(),
            recipe: serde_json::to_value(recipe).unwrap_or(Value::Null),
            hashes: BTreeMap::from([
                ("bake".to_owned(), hashes.bake),
                ("fit".to_owned(), hashes.fit),
                ("scene".to_owned(), hashes.scene),
            ]),
        },
    }
}

fn parts(dataset: &Dataset, rig: &RigHeader) -> Vec<PartRange> {
    let node = |name: &str| rig.nodes.iter().position(|n| n.name == name).unwrap_or(0) as u32;
    let parts = dataset.header().attributes.parts.iter().map(|part| PartRange {
        name: part.mesh.clone(),
        node: node(&part.node),
        primitive: part.primitive as u32,
        first_vertex: part.first_vertex as u32,
        vertices: part.vertices as u32,
    });
    parts.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What nobody asked for gives way to what there is, in every family that has such a size;
    /// what was asked for, and what there is nothing of, stays an error.
    #[test]
    fn sizes_that_nobody_asked_for_give_way() {
        let pca = fit::Family::PcaLinear { inputs: 8, outputs: 22 };
        let local = fit::Family::Multilinear(fit::MultilinearSizes {
            clusters: 10,
            inputs: 8,
            points: fit::PointClusters::Count(5),
            published: false,
            blend_exponent: 10.0,
        });
        let nobody = FitRecipe::default();
        let all = FitRecipe {
            inputs: Some(8),
            outputs: Some(22),
            clusters: Some(10),
            ..FitRecipe::default()
        };
        let inputs = |available| fit::Error::Inputs { asked: 8, poses: 4, available };
        let outputs = |available| fit::Error::Outputs { asked: 22, available };
        let clusters = |available| fit::Error::Clusters { what: "clusters", asked: 10, available };
        let way = |family: fit::Family, recipe: &FitRecipe, error| {
            let mut family = family;
            give_way(&mut family, recipe, error).map(|()| family).ok()
        };
        let fewer = fit::Family::PcaLinear { inputs: 3, outputs: 22 };
        assert_eq!(way(pca, &nobody, inputs(3)), Some(fewer));
        let fewer = fit::Family::PcaLinear { inputs: 8, outputs: 3 };
        assert_eq!(way(pca, &nobody, outputs(3)), Some(fewer));
        let (half, some) = (fit::Kept::Share(0.5), fit::Kept::Count);
        let shared = fit::Family::PcaRetaining { inputs: half, outputs: some(22) };
        let fewer = fit::Family::PcaRetaining { inputs: half, outputs: some(3) };
        assert_eq!(way(shared, &nobody, outputs(3)), Some(fewer));
        let shared = fit::Family::PcaRetaining { inputs: some(8), outputs: half };
        let fewer = fit::Family::PcaRetaining { inputs: some(3), outputs: half };
        assert_eq!(way(shared, &nobody, inputs(3)), Some(fewer));
        let sizes = |family| match family {
            Some(fit::Family::Multilinear(sizes)) => Some((sizes.clusters, sizes.inputs)),
            _ => None,
        };
        assert_eq!(sizes(way(local, &nobody, inputs(1))), Some((10, 1)));
        assert_eq!(sizes(way(local, &nobody, clusters(4))), Some((4, 8)));
        for error in [inputs(3), outputs(3)] {
            assert_eq!(way(pca, &all, error), None);
        }
        for error in [inputs(1), clusters(4)] {
            assert_eq!(way(local, &all, error), None);
        }
        assert_eq!((way(pca, &nobody, inputs(0)), way(local, &nobody, inputs(0))), (None, None));
        // Clusters of points are asked for by their number alone.
        assert_eq!(way(local, &nobody, clusters(12)), None);
    }
}
