//! `poselight subdivide`: a mesh refined where its transfer changes.

use std::time::Instant;

use serde_json::json;

use super::Usage;
use crate::bake::subdivide::Fidelity;
use crate::cli::subdivide_args::SubdivideArgs;
use crate::cli::{Answer, units};
use crate::pipeline::{self, Beyond, Job, Refinement, Subdivided, Watch, Worst, files};
use crate::render::colour;
use crate::scene::{self, Attribute, Limits, Source};

/// Edges beyond the bound that are named, to people and to programs.
const TOLD_EDGES: usize = 5;
const MOST_EDGES: usize = 1000;

pub(in crate::cli) fn subdivide(args: &SubdivideArgs, watch: &Watch) -> anyhow::Result<Answer> {
    super::named(&args.output, "glb")?;
    super::keep_input(&args.scene, &args.output)?;
    let mut recipe = super::start(&args.recipe)?;
    args.poses.edit(&mut recipe);
    args.bake.edit(&mut recipe)?;
    if args.bake.choose_rays {
        let told = "--choose-rays is of bakes: a refined mesh has no model";
        return Err(Usage(told.to_owned()).into());
    }
    let mut settings = recipe.subdivide.take().unwrap_or_default();
    args.edit(&mut settings);
    if settings.smooth && (args.values || args.probes > 0) {
        let told = "--values and --probes are of the given triangles: leave the smooth surface out";
        return Err(Usage(told.to_owned()).into());
    }
    recipe.bake.rays = settings.rays.unwrap_or(recipe.bake.rays);
    let job = Job::open(&args.scene, recipe)?;
    has_room(&job, args)?;
    let given = job.scene.mesh.triangles.len();
    let refinement = Refinement::of(&job, &settings)?;
    if args.dry_run {
        let plan = pipeline::plan_subdivision(&job, &refinement, args.probes)?;
        let text = format!(
            "about {} new vertices in {} views: {} rays, {}",
            units::count(plan.vertices),
            plan.views,
            units::count(plan.rays),
            units::seconds(plan.bake_s)
        );
        let json = json!({ "vertices": plan.vertices, "views": plan.views, "rays": plan.rays, "bake_s": plan.bake_s });
        return Ok(Answer::new(text, json));
    }
    let start = Instant::now();
    let mut tell = |triangles| (watch.report)(refinement.progress(given, triangles, start));
    let stop = watch.cancelled;
    let probes = match args.probes {
        0 => None,
        count => Some(pipeline::interpolation_probes(&job, refinement.key_poses, count, stop)?),
    };
    let done = pipeline::subdivide(&job, &refinement, probes.as_ref(), stop, &mut tell)?;
    let glb = with_attributes(&job, &done, args)?;
    files::publish(&args.output, &glb)?;
    let asks_for_error = refinement.goal.error > 0.0;
    Ok(Answer::new(text(args, &job, &done, asks_for_error), figures(args, &job, &done)))
}

/// Refuses a scene without room for what is to be written beside it, before the work.
fn has_room(job: &Job, args: &SubdivideArgs) -> anyhow::Result<()> {
    let mesh = &job.scene.mesh;
    let mut attributes = Vec::new();
    if args.values {
        let width = job.checked.bake.signal.coefficients(job.checked.bake.order);
        let values = vec![0.0; width * mesh.positions.len()];
        attributes.extend(super::apply::columns(job.checked.bake.signal, width, &values));
    }
    if args.colour {
        let values = vec![0.0; 3 * mesh.positions.len()];
        attributes.push(Attribute { name: "COLOR_0".into(), width: 3, values });
    }
    if !attributes.is_empty() {
        scene::attach(&scene::as_glb(&job.scene.sources)?, &mesh.parts, &attributes)?;
    }
    Ok(())
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

/// An error, or where noise is all that is left of it, that.
fn error(of: &Fidelity) -> String {
    match of.rms {
        0.0 => format!("below {:.5}, which is noise", of.with_noise),
        rms => format!("{rms:.5}"),
    }
}

fn text(args: &SubdivideArgs, job: &Job, done: &Subdivided, asks_for_error: bool) -> String {
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
            "\n  L² interpolation error {} from {}, largest with its noise {:.4} from {:.4}",
            error(after),
            error(before),
            after.most,
            before.most
        );
    }
    if let Some(noise) = done.probe_noise {
        text += &format!(" (noise of the probes {noise:.5})");
    }
    if let Some([_, worst]) = &done.worst {
        let Worst { mesh, primitive, triangle, at_m: [x, y, z] } = worst;
        text += &format!(
            "\n  the worst is triangle {triangle} of mesh {mesh:?}, primitive {primitive}, at ({x:.3}, {y:.3}, {z:.3}) m"
        );
    }
    if work.at_depth > 0 && asks_for_error {
        text += &format!(
            "\n  note: {} triangles are as fine as they may be (--max-depth, --min-edge) and still worse than asked for",
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
        text += &format!(
            "; {} vertices on {} edges are beyond the bound",
            units::count(deviation.beyond as u64),
            units::count(done.beyond.len() as u64)
        );
    }
    if done.stiff > 0 {
        text += &format!(
            "\n  {} edges and triangles that cannot meet the bound stay whole",
            units::count(done.stiff as u64)
        );
    }
    for edge in done.beyond.iter().take(TOLD_EDGES) {
        text += &format!("\n    {}", named(job, edge));
    }
    let rest = done.beyond.len().saturating_sub(TOLD_EDGES);
    if rest > 0 {
        text +=
            &format!("\n    and {} more (--json names {MOST_EDGES})", units::count(rest as u64));
    }
    text
}

/// An edge that cannot meet the bound, in words.
fn named(job: &Job, edge: &Beyond) -> String {
    let kind = if edge.vertices.len() == 2 { "edge" } else { "inside of triangle" };
    let vertices: Vec<String> = edge.vertices.iter().map(usize::to_string).collect();
    let sample = &job.poses.samples[edge.pose];
    let clip = job.poses.clip_names.get(sample.clip).map_or("the default pose", String::as_str);
    format!(
        "mesh {:?}, primitive {}, {kind} {}: {:.2e} m in {clip} at {:.2} s",
        edge.mesh,
        edge.primitive,
        vertices.join("–"),
        edge.most_m,
        sample.time_s
    )
}

fn figures(args: &SubdivideArgs, job: &Job, done: &Subdivided) -> serde_json::Value {
    let key_pose = |&pose: &usize| {
        let sample = &job.poses.samples[pose];
        json!({ "clip": job.poses.clip_names.get(sample.clip), "time_s": sample.time_s })
    };
    let edge = |edge: &Beyond| {
        let pose = key_pose(&edge.pose);
        json!({ "mesh": edge.mesh, "primitive": edge.primitive, "vertices": edge.vertices, "new_vertices": edge.count, "max_m": edge.most_m, "pose": pose })
    };
    let fidelity = done.fidelity.as_ref().zip(done.worst.as_ref()).map(|(both, worst)| {
        let one = |(one, worst): (&Fidelity, &Worst)| {
            let Worst { mesh, primitive, triangle, at_m } = worst;
            let worst = json!({ "mesh": mesh, "primitive": primitive, "triangle": triangle, "at_m": at_m });
            json!({ "rms": one.rms, "rms_with_noise": one.with_noise, "max": one.most, "worst": worst })
        };
        both.iter().zip(worst).map(one).collect::<Vec<_>>()
    });
    json!({
        "output": args.output,
        "triangles": done.triangles,
        "vertices": done.vertices,
        "splits": done.work.splits,
        "splits_before_their_turn": done.work.forced,
        "at_depth": done.work.at_depth,
        "estimate_left": done.work.left,
        "baked_in_vain": done.in_vain,
        "key_poses": done.key_poses.iter().map(key_pose).collect::<Vec<_>>(),
        "deviation": {
            "max_m": done.deviation.most_m,
            "beyond_bound": done.deviation.beyond,
            "fitted": done.deviation.fitted,
            "kept_whole": done.stiff,
            "edges_beyond": done.beyond.len(),
            "edges": done.beyond.iter().take(MOST_EDGES).map(edge).collect::<Vec<_>>(),
        },
        "interpolation_error": fidelity,
        "probe_noise": done.probe_noise,
    })
}
