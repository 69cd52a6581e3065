//! `poselight bake`: a data set from a scene, or the cost of one.

use serde_json::{Value, json};

use crate::cli::args::BakeArgs;
use crate::cli::{Answer, units};
use crate::pipeline::{self, Baked, Job, Plan, Watch};
use crate::pose::Split;

pub(in crate::cli) fn bake(args: &BakeArgs, watch: &Watch) -> anyhow::Result<Answer> {
    let mut recipe = super::start(&args.recipe)?;
    args.poses.edit(&mut recipe);
    args.bake.edit(&mut recipe);
    let job = Job::open(&args.scene, recipe)?;
    if args.dry_run {
        return Ok(planned(&job, &pipeline::plan(&job)?));
    }
    let from = args.from.as_deref();
    let baked = pipeline::bake_from(&job, &args.output, from, watch)?;
    let text = format!("{}\n{}", args.output.display(), summary(&job, &baked));
    let json = json!({ "dataset": args.output, "bake": figures(&baked), "notices": notices(&job) });
    Ok(Answer::new(text, json))
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
    for notice in notices(job) {
        text += &format!("\n  note: {notice}");
    }
    text
}

/// What a bake did, for programs.
pub(super) fn figures(baked: &Baked) -> Value {
    json!({
        "poses": baked.poses,
        "poses_now": baked.poses_now,
        "rays": baked.rays,
        "bake_s": baked.bake_s,
        "rays_per_s": if baked.rays > 0 { json!(baked.rays as f64 / baked.bake_s) } else { Value::Null },
    })
}

/// What import and sampling mended or left out.
pub(super) fn notices(job: &Job) -> Vec<String> {
    let mut notices = job.scene.notices.clone();
    for repeat in &job.poses.near_repeats {
        notices.push(format!(
            "clip `{}`: {} of {} poses dropped as near-repeats (threshold {})",
            job.poses.clip_names[repeat.clip], repeat.dropped, repeat.sampled, repeat.threshold
        ));
    }
    if job.poses.samples.len() == 1 {
        notices.push("the scene does not move: one pose is baked, and a model is its mean".into());
    } else if job.poses.parametrisation.columns.is_empty() {
        notices.push("no joint moves in the training poses: a model is their mean".into());
    }
    notices.extend(held_out(job));
    notices
}

/// What the model will be proven on, which the user may not have chosen.
fn held_out(job: &Job) -> Option<String> {
    let of = |split| job.poses.samples.iter().filter(move |sample| sample.split == split);
    let within = of(Split::WithinClip).count();
    if within > 0 {
        return Some(format!("held out: the last {within} poses of the only clip"));
    }
    let mut clips: Vec<&str> =
        of(Split::Novel).map(|sample| job.poses.clip_names[sample.clip].as_str()).collect();
    clips.dedup();
    let drawn = if job.checked.poses.hold_out.is_none() {
        " (drawn by the seed; --hold-out chooses)"
    } else {
        ""
    };
    (!clips.is_empty()).then(|| format!("held out: {}{drawn}", clips.join(", ")))
}

fn planned(job: &Job, plan: &Plan) -> Answer {
    let text = format!(
        "{} poses of {} points\n{} rays, {} at {:.1} Mray/s\n{} on disk, {} of memory\nmeasuring a model casts {} rays more, {}",
        plan.poses,
        units::count(plan.points as u64),
        units::count(plan.rays),
        units::seconds(plan.bake_s),
        plan.rays_per_s / 1e6,
        units::bytes(plan.disk_bytes),
        units::bytes(plan.memory_bytes),
        units::count(plan.reference_rays),
        units::seconds(plan.reference_s),
    );
    let json = json!({
        "poses": plan.poses,
        "points": plan.points,
        "rays": plan.rays,
        "disk_bytes": plan.disk_bytes,
        "memory_bytes": plan.memory_bytes,
        "rays_per_s": plan.rays_per_s,
        "bake_s": plan.bake_s,
        "reference_rays": plan.reference_rays,
        "reference_s": plan.reference_s,
        "notices": notices(job),
    });
    Answer::new(text, json)
}
