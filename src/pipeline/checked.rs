//! Raw recipe → checked recipe: only settings that passed here run.

mod bake_fields;
mod frame;
mod light;
mod target;

use std::fmt::Display;

pub(super) use frame::checked_normals;

use bake_fields::{checked_bake, checked_noises, checked_receivers, checked_subsurface};
use target::{checked_choice, checked_reference};

use super::recipe::{
    DEFAULT_CLUSTER_INPUTS, DEFAULT_CLUSTER_RETAINED, DEFAULT_DIRECTIONS, DEFAULT_GROUPS,
    DEFAULT_INPUTS, DEFAULT_OUTPUTS, DEFAULT_POSE_CLUSTERS, DEFAULT_SPHERES, FamilyName, FitRecipe,
    OnName, ParametrisationName, PoseChoiceName, PosesRecipe, PrecisionName, Recipe, RidgeName,
    VERSION,
};
use super::rounds::Noises;
use super::subdivide;
use crate::rig::ParametrisationKind;
use crate::{bake, fit, model, pose};

/// Why a recipe cannot run: which field, what it says, what it may say.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("recipe field `{field}` is {found}; {expected}")]
pub struct RecipeError {
    /// The field's path, such as `bake.order`.
    pub field: &'static str,
    /// What the recipe says.
    pub found: String,
    /// What it may say, as the end of a sentence.
    pub expected: &'static str,
}

/// A recipe whose every field was checked, as the settings of each stage.
#[derive(Debug, Clone)]
pub struct Checked {
    /// For [`pose::sample`].
    pub poses: pose::Settings,
    /// For [`bake::Baker`].
    pub bake: bake::Settings,
    /// The standard errors that set the numbers of rays.
    pub(super) noises: Noises,
    /// What light does below the surface.
    pub subsurface: Option<bake::Subsurface>,
    /// For [`fit::fit`].
    pub fit: fit::Settings,
    /// How the model is stored.
    pub precision: model::Precision,
    /// How the model is measured.
    pub reference: ReferenceSettings,
}

/// How references are baked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceSettings {
    /// Times the bake's rays.
    pub factor: u32,
    /// Poses of each split.
    pub poses: usize,
    /// Largest novel coefficient RMSE accepted.
    pub max_error: Option<f32>,
}

impl Checked {
    /// Checks every field.
    ///
    /// # Errors
    /// The first field that cannot run.
    pub fn new(recipe: &Recipe) -> Result<Self, RecipeError> {
        require(
            recipe.version == VERSION,
            "version",
            recipe.version,
            "this build reads version 1",
        )?;
        checked_receivers(recipe)?;
        subdivide::checked(recipe)?;
        checked_choice(recipe)?;
        light::checked_light(recipe)?;
        checked_normals(recipe)?;
        Ok(Self {
            poses: checked_poses(&recipe.poses)?,
            bake: checked_bake(&recipe.bake)?,
            noises: checked_noises(&recipe.bake)?,
            subsurface: checked_subsurface(&recipe.bake)?,
            fit: checked_fit(recipe)?,
            precision: precision(recipe.output.precision),
            reference: checked_reference(&recipe.target)?,
        })
    }
}

fn checked_poses(poses: &PosesRecipe) -> Result<pose::Settings, RecipeError> {
    let rate = poses.rate_hz;
    require((0.1..=1000.0).contains(&rate), "poses.rate_hz", rate, "it must be 0.1 to 1000")?;
    let near = poses.near_repeat;
    require((0.0..=1.0).contains(&near), "poses.near_repeat", near, "it must be 0 to 1")?;
    let every = poses.interpolated_every;
    require(every != 1, "poses.interpolated_every", every, "it must be 0, or 2 and more")?;
    if let Some(most) = poses.most {
        require((1..=200_000).contains(&most), "poses.most", most, "it must be 1 to 200,000")?;
    }
    let mixed = poses.mixed;
    require(mixed <= 200_000, "poses.mixed", mixed, "it must be 0 to 200,000")?;
    Ok(pose::Settings {
        clips: poses.clips.clone(),
        hold_out: poses.hold_out.clone(),
        rate_hz: rate,
        interpolated_every: every,
        near_repeat: near,
        most: poses.most.map(|most| most as usize),
        choice: match poses.choice {
            PoseChoiceName::Distance => pose::PoseChoice::Distance,
            PoseChoiceName::PredictedError => pose::PoseChoice::PredictedError,
        },
        mixed: mixed as usize,
        parametrisation: match poses.parametrisation {
            ParametrisationName::JointAngles => ParametrisationKind::JointAngles,
            ParametrisationName::Handles => ParametrisationKind::Handles,
            ParametrisationName::Dihedral => ParametrisationKind::Dihedral,
        },
        seed: poses.seed,
        root_motion: pose::RootMotion::Rigid,
    })
}

fn checked_fit(recipe: &Recipe) -> Result<fit::Settings, RecipeError> {
    let fit = &recipe.fit;
    let inputs = fit.inputs.unwrap_or(DEFAULT_INPUTS);
    let outputs = fit.outputs.unwrap_or(DEFAULT_OUTPUTS);
    for (field, size) in [("fit.inputs", inputs), ("fit.outputs", outputs)] {
        require((1..=4096).contains(&size), field, size, "it must be 1 to 4096")?;
    }
    let family = match fit.family {
        FamilyName::Mean => fit::Family::Mean,
        FamilyName::Occluder if fit.inputs.is_none() => fit::Family::Mean,
        FamilyName::Occluder => {
            fit::Family::PcaLinear { inputs: inputs as usize, outputs: outputs as usize }
        }
        FamilyName::Linear => fit::Family::Linear,
        FamilyName::PcaLinear => match retaining(fit)? {
            Some((inputs, outputs)) => fit::Family::PcaRetaining { inputs, outputs },
            None => fit::Family::PcaLinear { inputs: inputs as usize, outputs: outputs as usize },
        },
        FamilyName::ClusteredLinear => clustered(fit, model::Form::Linear)?,
        FamilyName::ClusteredQuadratic => clustered(fit, model::Form::Quadratic)?,
        FamilyName::ClusteredTanh => clustered(fit, model::Form::Tanh)?,
        FamilyName::Multilinear => fit::Family::Multilinear(multilinear(fit, inputs)?),
    };
    let ridge = match (fit.ridge, fit.alpha) {
        (RidgeName::LeaveOneOut, _) => fit::Ridge::LeaveOneOut,
        (RidgeName::LeaveOneClipOut, _) => fit::Ridge::LeaveOneClipOut,
        (RidgeName::Fixed, Some(alpha)) if alpha.is_finite() && alpha >= 0.0 => {
            fit::Ridge::Fixed(alpha)
        }
        (RidgeName::Fixed, Some(alpha)) => {
            return Err(error("fit.alpha", alpha, "it must be zero or a positive number"));
        }
        (RidgeName::Fixed, None) => {
            return Err(error("fit.alpha", "absent", "a fixed ridge needs it"));
        }
    };
    let frame = frame::checked_frame(fit, recipe.bake.signal)?;
    let on = match recipe.target.on {
        OnName::Novel => fit::On::Novel,
        OnName::Trained => fit::On::Trained,
    };
    if let Some(reach) = fit.reach {
        require((0.0..=1000.0).contains(&reach), "fit.reach", reach, "it must be 0 to 1000")?;
    }
    if let Some(bands) = fit.bands {
        require((1..=10).contains(&bands), "fit.bands", bands, "it must be 1 to 10")?;
    }
    let (unshadowed, spheres) = occluders(fit)?;
    let groups = fit.groups.unwrap_or(DEFAULT_GROUPS);
    require((1..=64).contains(&groups), "fit.groups", groups, "it must be 1 to 64")?;
    let (groups, directions) = (groups as usize, directions(fit)?);
    let (seed, steps) = (fit.seed, fit::Settings::default().steps);
    let settings = fit::Settings {
        family,
        frame,
        ridge,
        on,
        unshadowed,
        spheres,
        groups,
        directions,
        local: local(fit)?,
        seed,
        steps,
    };
    Ok(settings)
}

/// How far a joint may be from what it matters to.
fn local(fit: &FitRecipe) -> Result<Option<f64>, RecipeError> {
    let Some(share) = fit.local else { return Ok(None) };
    let expected = "it must be above 0 and at most 100";
    require(share > 0.0 && share <= 100.0, "fit.local", share, expected)?;
    let expected = "a model of what occlusion takes away goes without it";
    require(fit.unshadowed != Some(true), "fit.local", share, expected)?;
    Ok(Some(share))
}

/// Whether the unshadowed part is left out, and how many spheres explain the rest.
fn occluders(fit: &FitRecipe) -> Result<(bool, Option<usize>), RecipeError> {
    let occluder = fit.family == FamilyName::Occluder;
    let spheres = fit.spheres.unwrap_or(DEFAULT_SPHERES);
    require((1..=4096).contains(&spheres), "fit.spheres", spheres, "it must be 1 to 4096")?;
    Ok((fit.unshadowed.unwrap_or(occluder), occluder.then_some(spheres as usize)))
}

/// Directions in which the union of occluders is looked at.
fn directions(fit: &FitRecipe) -> Result<usize, RecipeError> {
    let count = fit.directions.unwrap_or(DEFAULT_DIRECTIONS);
    let sound = count == 0 || ((64..=4096).contains(&count) && count.is_multiple_of(16));
    require(sound, "fit.directions", count, "it must be 0, or a multiple of 16 from 64 to 4096")?;
    Ok(if fit.family == FamilyName::Occluder { count as usize } else { 0 })
}

fn clustered(fit: &FitRecipe, form: model::Form) -> Result<fit::Family, RecipeError> {
    for (field, count, most, expected) in [
        ("fit.clusters", fit.clusters, 4096, "it must be 1 to 4096"),
        ("fit.neurons", fit.neurons, 256, "it must be 1 to 256"),
    ] {
        if let Some(count) = count {
            require((1..=most).contains(&count), field, count, expected)?;
        }
    }
    let kept = |count: Option<u32>, share: Option<f64>, default: f64| match (count, share) {
        (Some(count), _) => fit::Kept::Count(count as usize),
        (None, share) => fit::Kept::Share(share.unwrap_or(default)),
    };
    retaining(fit)?;
    Ok(fit::Family::Clustered(fit::ClusteredSizes {
        form,
        clusters: fit.clusters.map(|count| count as usize),
        inputs: kept(fit.inputs, fit.retain_inputs, DEFAULT_CLUSTER_INPUTS),
        outputs: kept(fit.outputs, fit.retain_outputs, DEFAULT_CLUSTER_RETAINED),
        neurons: fit.neurons.map(|count| count as usize),
    }))
}

fn multilinear(fit: &FitRecipe, inputs: u32) -> Result<fit::MultilinearSizes, RecipeError> {
    let clusters = fit.clusters.unwrap_or(DEFAULT_POSE_CLUSTERS);
    require((1..=4096).contains(&clusters), "fit.clusters", clusters, "it must be 1 to 4096")?;
    let exponent = fit.blend_exponent;
    require(
        (0.0..=100.0).contains(&exponent),
        "fit.blend_exponent",
        exponent,
        "it must be 0 to 100",
    )?;
    let points = match (fit.point_clusters, fit.point_threshold) {
        (None, None) => fit::PointClusters::None,
        (Some(count), None) => {
            require(count > 0, "fit.point_clusters", count, "it must be at least 1")?;
            fit::PointClusters::Count(count as usize)
        }
        (None, Some(threshold)) => {
            let sound = threshold.is_finite() && threshold >= 0.0;
            require(sound, "fit.point_threshold", threshold, "it must be 0 or more")?;
            fit::PointClusters::Threshold(threshold)
        }
        (Some(_), Some(found)) => {
            let expected = "a count is given too: leave one of them out";
            return Err(error("fit.point_threshold", found, expected));
        }
    };
    Ok(fit::MultilinearSizes {
        clusters: clusters as usize,
        inputs: inputs as usize,
        points,
        published: fit.published,
        blend_exponent: exponent,
    })
}

/// Sizes of `pca-linear` where a share of the variance gives at least one of them.
fn retaining(fit: &FitRecipe) -> Result<Option<(fit::Kept, fit::Kept)>, RecipeError> {
    let sides = [
        ("fit.retain_inputs", fit.retain_inputs, fit.inputs),
        ("fit.retain_outputs", fit.retain_outputs, fit.outputs),
    ];
    for (field, share, size) in sides {
        if let Some(share) = share {
            require(share > 0.0 && share <= 1.0, field, share, "it must be above 0 and at most 1")?;
            require(size.is_none(), field, share, "a size is given too: leave one of them out")?;
        }
    }
    let any = fit.retain_inputs.or(fit.retain_outputs).is_some();
    let kept = |share: Option<f64>, count: Option<u32>, default: u32| match share {
        Some(share) => fit::Kept::Share(share),
        None => fit::Kept::Count(count.unwrap_or(default) as usize),
    };
    let inputs = kept(fit.retain_inputs, fit.inputs, DEFAULT_INPUTS);
    Ok(any.then(|| (inputs, kept(fit.retain_outputs, fit.outputs, DEFAULT_OUTPUTS))))
}

fn precision(name: PrecisionName) -> model::Precision {
    match name {
        PrecisionName::F32 => model::Precision::F32,
        PrecisionName::F16 => model::Precision::F16,
        PrecisionName::I8 => model::Precision::I8,
    }
}

fn error(field: &'static str, found: impl Display, expected: &'static str) -> RecipeError {
    let found = format!("{found}");
    RecipeError { field, found, expected }
}

pub(super) fn require(
    holds: bool,
    field: &'static str,
    found: impl Display,
    expected: &'static str,
) -> Result<(), RecipeError> {
    if holds { Ok(()) } else { Err(error(field, found, expected)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::recipe::subsurface::SubsurfaceRecipe;
    use crate::pipeline::recipe::surroundings::GroundRecipe;
    use crate::pipeline::recipe::{NoiseGoalName, SignalName};

    fn fault(edit: impl FnOnce(&mut Recipe)) -> &'static str {
        let mut recipe = Recipe::default();
        edit(&mut recipe);
        Checked::new(&recipe).expect_err("must be refused").field
    }

    /// The defaults run.
    #[test]
    fn the_default_recipe_is_sound() {
        Checked::new(&Recipe::default()).expect("sound");
    }

    /// So do those of mixed poses and of a prior on joints, which does not go with everything.
    #[test]
    fn bounds_of_options() {
        assert_eq!(fault(|r| r.poses.mixed = 200_001), "poses.mixed");
        assert_eq!(fault(|r| r.fit.local = Some(0.0)), "fit.local");
        let both = |r: &mut Recipe| (r.fit.local, r.fit.unshadowed) = (Some(0.1), Some(true));
        assert_eq!(fault(both), "fit.local");
    }

    /// Every bound refuses what lies just outside it, by the field's name.
    #[test]
    fn each_bound_names_its_field() {
        assert_eq!(fault(|r| r.version = 2), "version");
        assert_eq!(fault(|r| r.bake.order = 0), "bake.order");
        assert_eq!(fault(|r| r.bake.order = 11), "bake.order");
        assert_eq!(fault(|r| r.bake.rays = 0), "bake.rays");
        assert_eq!(fault(|r| r.bake.max_distance_m = Some(0.0)), "bake.max_distance_m");
        assert_eq!(fault(|r| r.bake.max_distance_m = Some(f32::NAN)), "bake.max_distance_m");
        assert_eq!(fault(|r| r.bake.bounces = 9), "bake.bounces");
        let ao = |r: &mut Recipe| (r.bake.signal, r.bake.bounces) = (SignalName::Ao, 1);
        assert_eq!(fault(ao), "bake.bounces");
        assert_eq!(fault(|r| r.bake.albedo = Some(0.5)), "bake.albedo");
        assert_eq!(fault(|r| (r.bake.bounces, r.bake.albedo) = (1, Some(1.5))), "bake.albedo");
        assert_eq!(fault(|r| r.bake.noise = Some(0.0)), "bake.noise");
        let goal = Some(NoiseGoalName::Mean);
        assert_eq!(fault(|r| r.bake.noise_goal = goal), "bake.noise_goal");
        assert_eq!(fault(|r| r.bake.vertex_fit = Some(0)), "bake.vertex_fit");
        let faceted = |r: &mut Recipe| r.bake.surroundings.faceted = true;
        assert_eq!(fault(faceted), "bake.surroundings.faceted");
        let below = |found| fault(|r| r.bake.subsurface = Some(found));
        let length = |metres| SubsurfaceRecipe {
            mean_free_path_m: Some([metres; 3]),
            ..SubsurfaceRecipe::default()
        };
        assert_eq!(below(SubsurfaceRecipe::default()), "bake.subsurface");
        let both = SubsurfaceRecipe { material: Some("skin".into()), ..length(0.1) };
        assert_eq!(below(both), "bake.subsurface");
        let jade =
            SubsurfaceRecipe { material: Some("jade".into()), ..SubsurfaceRecipe::default() };
        assert_eq!(below(jade), "bake.subsurface.material");
        assert_eq!(below(length(0.0)), "bake.subsurface.mean_free_path_m");
        let black = SubsurfaceRecipe { absorption_per_m: Some([10.0; 3]), ..length(0.1) };
        assert_eq!(below(black), "bake.subsurface.absorption_per_m");
        let air = SubsurfaceRecipe { refractive_index: Some(0.9), ..length(0.1) };
        assert_eq!(below(air), "bake.subsurface.refractive_index");
        let ao = |r: &mut Recipe| {
            (r.bake.signal, r.bake.subsurface) = (SignalName::Ao, Some(length(0.1)));
        };
        assert_eq!(fault(ao), "bake.subsurface");
        let bounced = |r: &mut Recipe| (r.bake.vertex_fit, r.bake.bounces) = (Some(4), 1);
        assert_eq!(fault(bounced), "bake.vertex_fit");
        assert_eq!(fault(|r| r.bake.more_rays = vec![0]), "bake.more_rays");
        let around = "bake.surroundings.ground";
        let nowhere = Some(GroundRecipe::HeightM(f32::NAN));
        assert_eq!(fault(|r| r.bake.surroundings.ground = nowhere), around);
        let near = |near| fault(|r| r.bake.surroundings.min_distance_m = Some(near));
        assert_eq!(near(-1.0), "bake.surroundings.min_distance_m");
        assert_eq!(fault(|r| r.bake.surroundings.falloff = Some(1.0)), "bake.surroundings.falloff");
        assert_eq!(fault(|r| r.poses.rate_hz = 0.0), "poses.rate_hz");
        assert_eq!(fault(|r| r.poses.rate_hz = f32::NAN), "poses.rate_hz");
        assert_eq!(fault(|r| r.poses.near_repeat = -1.0), "poses.near_repeat");
        assert_eq!(fault(|r| r.poses.most = Some(0)), "poses.most");
        assert_eq!(fault(|r| r.poses.interpolated_every = 1), "poses.interpolated_every");
        assert_eq!(fault(|r| r.fit.inputs = Some(0)), "fit.inputs");
        assert_eq!(fault(|r| r.fit.outputs = Some(0)), "fit.outputs");
        assert_eq!(fault(|r| r.fit.retain_inputs = Some(0.0)), "fit.retain_inputs");
        assert_eq!(
            fault(|r| (r.fit.outputs, r.fit.retain_outputs) = (Some(4), Some(0.9))),
            "fit.retain_outputs"
        );
        assert_eq!(fault(|r| r.fit.spheres = Some(0)), "fit.spheres");
        assert_eq!(fault(|r| r.fit.groups = Some(65)), "fit.groups");
        assert_eq!(fault(|r| r.fit.reach = Some(f32::NAN)), "fit.reach");
        assert_eq!(fault(|r| r.fit.ridge = RidgeName::Fixed), "fit.alpha");
        assert_eq!(fault(|r| r.target.reference_factor = 7), "target.reference_factor");
        assert_eq!(fault(|r| r.target.reference_poses = 0), "target.reference_poses");
        assert_eq!(fault(|r| r.target.max_error = Some(0.0)), "target.max_error");
        assert_eq!(fault(|r| r.target.max_bytes = Some(0)), "target.max_bytes");
        assert_eq!(fault(|r| r.target.max_us = Some(f64::NAN)), "target.max_us");
    }

    /// The sentence about too many clusters or neurons says how many there may be.
    #[test]
    fn bounds_of_clusters_are_told() {
        let many = |clusters, neurons| {
            let mut recipe = Recipe::default();
            let fit = &mut recipe.fit;
            (fit.family, fit.clusters, fit.neurons) =
                (FamilyName::ClusteredTanh, clusters, neurons);
            Checked::new(&recipe).expect_err("must be refused").to_string()
        };
        assert!(many(Some(6650), None).contains("`fit.clusters` is 6650; it must be 1 to 4096"));
        assert!(many(None, Some(257)).contains("`fit.neurons` is 257; it must be 1 to 256"));
    }

    /// Noises of further rounds are positive and each below the one before; a vertex fit takes none.
    #[test]
    fn noises_descend() {
        for more in [vec![0.0], vec![f32::NAN], vec![-0.1], vec![0.01, 0.01], vec![0.01, 0.02]] {
            assert_eq!(fault(|r| r.bake.more_noise.clone_from(&more)), "bake.more_noise");
        }
        let above = |r: &mut Recipe| (r.bake.noise, r.bake.more_noise) = (Some(0.01), vec![0.02]);
        assert_eq!(fault(above), "bake.more_noise");
        let most = |r: &mut Recipe| r.bake.most_rays = Some(100);
        assert_eq!(fault(most), "bake.most_rays");
        let none = |r: &mut Recipe| (r.bake.more_noise, r.bake.most_rays) = (vec![0.1], Some(0));
        assert_eq!(fault(none), "bake.most_rays");
        let fitted = |r: &mut Recipe| (r.bake.vertex_fit, r.bake.more_noise) = (Some(4), vec![0.1]);
        assert_eq!(fault(fitted), "bake.vertex_fit");
    }

    /// The sentence names the field, what it says and what it may say.
    #[test]
    fn the_message_can_be_acted_on() {
        let mut recipe = Recipe::default();
        recipe.bake.order = 12;
        let message = Checked::new(&recipe).expect_err("must be refused").to_string();
        assert_eq!(
            message,
            "recipe field `bake.order` is 12; spherical harmonics have order 1 to 10"
        );
    }
}
