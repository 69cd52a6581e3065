//! `poselight subdivide`: a mesh refined where its transfer changes.

use std::sync::atomic::AtomicBool;

use serde_json::json;

use super::Usage;
use crate::cli::subdivide_args::SubdivideArgs;
use crate::cli::{Answer, units};
use crate::pipeline::{self, Job, Subdivided, files};
use crate::render::colour;
use crate::scene::{self, Attribute, Limits, Source};

pub(in crate::cli) fn subdivide(args: &SubdivideArgs, stop: &AtomicBool) -> anyhow::Result<Answer> {
    super::named(&args.output, "glb")?;
    super::keep_input(&args.scene, &args.output)?;
    let mut recipe = super::start(&args.recipe)?;
    args.poses.edit(&mut recipe);
    args.bake.edit(&mut recipe)?;
    if args.bake.choose_rays {
        let told = "--choose-rays is of bakes: a refined mesh has no model";
        return Err(Usage(told.to_owned()).into());
    }
    let job = Job::open(&args.scene, recipe)?;
    let refinement = args.refinement(job.scene.mesh.triangles.len())?;
    if args.dry_run {
        let plan = pipeline::plan_subdivision(&job, &refinement)?;
        let text = format!(
            "at most {} new vertices in {} views: {} rays, {}",
            units::count(plan.vertices),
            plan.views,
            units::count(plan.rays),
            units::seconds(plan.bake_s)
        );
        let json = json!({ "vertices": plan.vertices, "views": plan.views, "rays": plan.rays, "bake_s": plan.bake_s });
        return Ok(Answer::new(text, json));
    }
    let done = pipeline::subdivide(&job, &refinement, stop, &mut |_| ())?;
    let glb = with_attributes(&job, &done, args)?;
    files::publish(&args.output, &glb)?;
    Ok(Answer::new(text(args, &done), figures(args, &job, &done)))
}

/// The refined file with what was asked for beside; it must import before it gets its name.
fn with_attributes(job: &Job, done: &Subdivided, args: &SubdivideArgs) -> anyhow::Result<Vec<u8>> {
    let name = "the refined scene".to_owned();
    let mut sources = vec![Source { name, bytes: done.glb.clone() }];
    sources.extend_from_slice(&job.scene.sources[1..]);
    let refined = scene::import_sources(sources, &Limits::default())?;
    let mut attributes = Vec::new();
    if args.values {
        let values = done.values.as_ref().ok_or_else(|| {
            Usage(
                "--values has no room where several nodes show one mesh; give each its own".into(),
            )
        })?;
        let width = values.len() / done.errors.len().max(1);
        attributes.extend(super::apply::columns(job.checked.bake.signal, width, values));
    }
    if args.colour {
        let most = done.errors.iter().copied().fold(0.0, f32::max);
        let shade = |error: &f32| colour(if most > 0.0 { error / most } else { 0.0 });
        let values = done.errors.iter().flat_map(shade).collect();
        attributes.push(Attribute { name: "COLOR_0".into(), width: 3, values });
    }
    if attributes.is_empty() {
        return Ok(done.glb.clone());
    }
    Ok(scene::attach(&done.glb, &refined.mesh.parts, &attributes)?)
}

fn text(args: &SubdivideArgs, done: &Subdivided) -> String {
    let Subdivided { triangles, vertices, work, deviation, .. } = done;
    let mut text = format!(
        "{}\n  {} triangles from {}, {} vertices from {}; {} splits over {} key poses, {} vertices baked in vain",
        args.output.display(),
        units::count(triangles[1] as u64),
        units::count(triangles[0] as u64),
        units::count(vertices[1] as u64),
        units::count(vertices[0] as u64),
        units::count(work.splits as u64),
        done.key_poses.len(),
        units::count(done.in_vain as u64),
    );
    if let Some([before, after]) = &done.fidelity {
        text += &format!(
            "\n  L² interpolation error {:.5} from {:.5}, largest {:.4} from {:.4}",
            after.rms, before.rms, after.most, before.most
        );
    }
    if let Some(noise) = done.probe_noise {
        text += &format!(" (noise of the probes {noise:.5})");
    }
    if work.at_depth > 0 {
        text += &format!(
            "\n  note: {} triangles are split as often as they may be (--max-depth) and still worse than asked for",
            units::count(work.at_depth as u64)
        );
    }
    // Below that it is rounding.
    if deviation.fitted > 0 || deviation.beyond > 0 || deviation.most_m > 1e-4 * done.size_m {
        text += &format!(
            "\n  skinning takes a new vertex at most {:.2e} m off its posed triangle",
            deviation.most_m
        );
    }
    if deviation.beyond > 0 {
        text +=
            &format!("; {} vertices are beyond the bound", units::count(deviation.beyond as u64));
    }
    text
}

fn figures(args: &SubdivideArgs, job: &Job, done: &Subdivided) -> serde_json::Value {
    let key_pose = |&pose: &usize| {
        let sample = &job.poses.samples[pose];
        json!({ "clip": job.poses.clip_names.get(sample.clip), "time_s": sample.time_s })
    };
    let fidelity = done.fidelity.map(|both| {
        both.map(|one| json!({ "rms": one.rms, "max": one.most, "worst_triangle": one.worst }))
    });
    json!({
        "output": args.output,
        "triangles": done.triangles,
        "vertices": done.vertices,
        "splits": done.work.splits,
        "at_depth": done.work.at_depth,
        "estimate_left": done.work.left,
        "baked_in_vain": done.in_vain,
        "key_poses": done.key_poses.iter().map(key_pose).collect::<Vec<_>>(),
        "deviation": {
            "max_m": done.deviation.most_m,
            "beyond_bound": done.deviation.beyond,
            "fitted": done.deviation.fitted,
        },
        "interpolation_error": fidelity,
        "probe_noise": done.probe_noise,
    })
}
