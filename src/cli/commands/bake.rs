//! `poselight bake`: a data set from a scene, or the cost of one.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::cli::args::BakeArgs;
use crate::cli::{Answer, units};
use crate::pipeline::recipe::{PosesRecipe, Recipe};
use crate::pipeline::{self, Baked, Dataset, Job, Plan, Planned, Spent, Watch};

pub(in crate::cli) fn bake(args: &BakeArgs, watch: &Watch) -> anyhow::Result<Answer> {
    let mut recipe = super::start(&args.recipe)?;
    args.poses.edit(&mut recipe);
    args.bake.edit(&mut recipe)?;
    args.refine.edit(&mut recipe);
    let chosen =
        choose_rays(args.bake.choose_rays, (&args.scene, &args.output), &mut recipe, watch)?;
    if let Some(from) = &args.from {
        pipeline::go_on(from, &mut recipe)?;
    }
    let job = Job::open(&args.scene, recipe)?;
    pipeline::effective_parametrisation(args.poses.parametrisation(), job.scene.is_sequence)?;
    let place = beside(&args.output, ".refined.glb");
    if args.dry_run {
        let mut job = as_refined(job, &place)?;
        job.scene.notices.extend(chosen);
        check_place(&job, &args.output)?;
        return Ok(planned(&job, &pipeline::plan(&job)?, false));
    }
    let mut job = pipeline::refined(job, &place, watch)?;
    job.scene.notices.extend(chosen);
    let from = args.from.as_deref();
    let baked = pipeline::bake_from(&job, &args.output, from, watch)?;
    let spent = pipeline::spent(&Dataset::open(&args.output)?)?;
    let mut text = args.output.display().to_string();
    if let Some(spent) = &spent {
        text += &format!("\n  {}", left(spent));
    }
    let missed = spent.as_ref().and_then(|spent| spent.missed);
    // Known only now, and told with the rest.
    job.scene.notices.extend(missed.map(|missed| missed.story()));
    text += &format!("\n{}", summary(&job, &baked));
    let mut figures = figures(&job, &baked);
    figures["noise_rms"] = json!(spent.map(|spent| spent.noise));
    figures["noise_missed"] = json!(missed);
    let json =
        json!({ "dataset": args.output, "bake": figures, "notices": pipeline::notices(&job) });
    Ok(Answer::new(text, json))
}

/// Has a pilot beside the output choose rays and poses where that is asked for; says what it found.
pub(super) fn choose_rays(
    asked: bool,
    (scene, output): (&Path, &Path),
    recipe: &mut Recipe,
    watch: &Watch,
) -> anyhow::Result<Option<String>> {
    if !asked {
        return Ok(None);
    }
    // Noise is a matter of rays and poses: the scene's own mesh tells as much of it as a finer one.
    let open = |mut recipe: Recipe| {
        if recipe.poses.most.is_none() {
            // The pilot counts poses first, of which it does not choose any yet.
            recipe.poses.choice = PosesRecipe::default().choice;
        }
        Job::open(scene, Recipe { subdivide: None, ..recipe })
    };
    let plan = pipeline::plan_rays(open, recipe, &beside(output, ".pilot"), watch)?;
    plan.edit(recipe);
    let say = |c: &Planned| {
        let Planned { poses, error, noise, rays } = c;
        format!("{poses} poses of {rays} rays (error {error:.4}, noise {noise:.4})")
    };
    let all: Vec<String> = plan.choices.iter().map(say).collect();
    let rays = units::count(plan.pilot_rays);
    let chosen = say(&plan.choices[plan.chosen]);
    Ok(Some(format!("a pilot of {rays} rays chose {chosen} among {}", all.join("; "))))
}

/// Another output's name: the same and more.
fn beside(output: &Path, more: &str) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(more);
    name.into()
}

/// The job of the refined mesh where that is there, for a plan.
pub(super) fn as_refined(job: Job, place: &Path) -> anyhow::Result<Job> {
    Ok(pipeline::refined_already(&job, place)?.unwrap_or(job))
}

/// Whether a data set is of this job; of one that is yet to be refined there can be none.
pub(super) fn check_place(job: &Job, path: &Path) -> anyhow::Result<()> {
    if job.is_to_be_refined() { Ok(()) } else { Ok(pipeline::check_place(job, path)?) }
}

/// The rays and the noise of a data set, for people.
pub(super) fn left(spent: &Spent) -> String {
    let Spent { rays_per_point, noise, .. } = spent;
    format!("noise {noise:.5} of a coefficient (RMS) with {rays_per_point:.1} rays a point")
}

/// What a bake did, for people.
pub(super) fn summary(job: &Job, baked: &Baked) -> String {
    let points = job.poses.points.count() as u64;
    let mut text = format!("  {} poses of {} points", baked.poses, units::count(points));
    if baked.poses_now < baked.poses {
        text += &format!(", {} of them baked now", baked.poses_now);
    }
    if baked.rays > 0 {
        let rate = baked.rays as f64 / baked.bake_s / 1e6;
        text += &format!(
            "; {} rays in {}, {rate:.1} Mray/s",
            units::count(baked.rays),
            units::seconds(baked.bake_s)
        );
    }
    for notice in pipeline::notices(job) {
        text += &format!("\n  note: {notice}");
    }
    text
}

/// What a bake did, for programs.
pub(super) fn figures(job: &Job, baked: &Baked) -> Value {
    json!({
        "rays_per_point": pipeline::rays_per_point(&job.recipe.bake),
        "poses": baked.poses,
        "poses_now": baked.poses_now,
        "rays": baked.rays,
        "bake_s": baked.bake_s,
        "rays_per_s": if baked.rays > 0 { json!(baked.rays as f64 / baked.bake_s) } else { Value::Null },
    })
}

/// What a job would cost; `whole` with fit and measurement.
pub(super) fn planned(job: &Job, plan: &Plan, whole: bool) -> Answer {
    let references = format!(
        "{} rays more, {}, {} on disk",
        units::count(plan.reference_rays),
        units::seconds(plan.reference_s),
        units::bytes(plan.reference_bytes),
    );
    let mut text = format!(
        "{} poses of {} points\nbake: {} rays, {} at {:.1} Mray/s; {} on disk, {} of memory\n",
        plan.poses,
        units::count(plan.points as u64),
        units::count(plan.rays),
        units::seconds(plan.bake_s),
        plan.rays_per_s / 1e6,
        units::bytes(plan.disk_bytes),
        units::bytes(plan.memory_bytes),
    );
    if whole {
        text += &format!(
            "references: {references}\ntogether: {} and the fit; {} on disk and the model",
            units::seconds(plan.bake_s + plan.reference_s),
            units::bytes(plan.disk_bytes + plan.reference_bytes),
        );
    } else {
        text += &format!("measuring a model casts {references}");
    }
    if plan.refine_rays > 0 {
        text += &format!(
            "\nrefining the mesh first: {} rays, {}; the other numbers are of the points that it may \
             come to",
            units::count(plan.refine_rays),
            units::seconds(plan.refine_s),
        );
    }
    for notice in plan.notices(job) {
        text += &format!("\n  note: {notice}");
    }
    Answer::new(text, plan.document(job))
}
