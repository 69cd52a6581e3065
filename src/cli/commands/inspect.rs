//! `poselight inspect`: what a scene, data set or model holds.

use std::path::Path;

use serde_json::{Value, json};

use crate::cli::args::InspectArgs;
use crate::cli::{Answer, units};
use crate::dataset::{Dataset, SPLIT_NAMES};
use crate::pipeline::recipe::Recipe;
use crate::pipeline::{self, Job};

pub(in crate::cli) fn inspect(args: &InspectArgs) -> anyhow::Result<Answer> {
    if args.file.is_dir() {
        let within = [&pipeline::DATASET, &pipeline::MODEL].map(|name| args.file.join(name));
        if within[0].is_dir() {
            let there = within.iter().filter(|path| path.exists());
            let there: Vec<String> = there.map(|path| path.display().to_string()).collect();
            anyhow::bail!(
                "{} is the folder of a run, which holds several things: inspect {}",
                args.file.display(),
                there.join(" or ")
            );
        }
        return dataset(&args.file);
    }
    if args.file.extension().is_some_and(|extension| extension == "safetensors") {
        return model(&args.file);
    }
    scene(&args.file)
}

fn scene(path: &Path) -> anyhow::Result<Answer> {
    let job = Job::open(path, Recipe::default())?;
    let plan = pipeline::plan(&job)?;
    let mesh = &job.scene.mesh;
    let clips: Vec<Value> = job
        .scene
        .clips
        .iter()
        .map(|clip| json!({ "name": clip.name, "duration_s": clip.duration_s }))
        .collect();
    let parameters = &job.poses.parametrisation;
    let json = json!({
        "kind": "scene",
        "vertices": mesh.positions.len(),
        "points": job.poses.points.count(),
        "triangles": mesh.triangles.len(),
        "parts": mesh.parts.iter().map(|part| &part.name).collect::<Vec<_>>(),
        "nodes": job.scene.skeleton.nodes.len(),
        "morph_weights": mesh.weight_names,
        "size_m": job.poses.size_m,
        "root": job.poses.root_node.map(|node| &job.scene.skeleton.nodes[node].name),
        "clips": clips,
        "parameters": parameters.columns.iter().map(|c| &c.name).collect::<Vec<_>>(),
        "dropped_parameters": parameters.dropped,
        "default_bake": plan.figures(),
        "notices": pipeline::notices(&job),
    });
    Ok(Answer::new(scene_text(&job, &plan), json))
}

fn scene_text(job: &Job, plan: &pipeline::Plan) -> String {
    let mesh = &job.scene.mesh;
    let mut text = format!(
        "scene: {} vertices ({} distinct), {} triangles, {}, {} nodes, {} morph weights, {:.3} m\n",
        units::count(mesh.positions.len() as u64),
        units::count(job.poses.points.count() as u64),
        units::count(mesh.triangles.len() as u64),
        units::counted(mesh.parts.len(), "part"),
        job.scene.skeleton.nodes.len(),
        mesh.weight_names.len(),
        job.poses.size_m,
    );
    for clip in &job.scene.clips {
        text += &format!("  clip {} {:.2} s\n", clip.name, clip.duration_s);
    }
    let parameters = &job.poses.parametrisation;
    text += &format!(
        "  {} pose parameters, {} degrees of freedom never move\n",
        parameters.columns.len(),
        parameters.dropped.len()
    );
    for notice in pipeline::notices(job) {
        text += &format!("  note: {notice}\n");
    }
    text += &format!(
        "a default bake: {} poses, {} rays, about {}, {} on disk, {} of memory; measuring a model: about {}",
        plan.poses,
        units::count(plan.rays),
        units::seconds(plan.bake_s),
        units::bytes(plan.disk_bytes),
        units::bytes(plan.memory_bytes),
        units::seconds(plan.reference_s),
    );
    text
}

fn dataset(path: &Path) -> anyhow::Result<Answer> {
    let dataset = Dataset::open(path)?;
    let (layout, attributes) = (&dataset.header().layout, &dataset.header().attributes);
    let missing = dataset.missing_blocks().len();
    let spent = pipeline::spent(&dataset)?;
    let mut splits = serde_json::Map::new();
    for (index, name) in SPLIT_NAMES.iter().enumerate() {
        let poses = dataset.splits().iter().filter(|&&split| usize::from(split) == index).count();
        splits.insert((*name).to_owned(), json!(poses));
    }
    let state = if missing == 0 {
        "complete".to_owned()
    } else {
        format!("{missing} of {} blocks missing", layout.blocks())
    };
    let mut text = format!(
        "data set: {} of order {}, {} poses of {} points ({} vertices), {} parameters, {}\n  splits {}\n  clips {}\n  bake {}",
        attributes.signal,
        attributes.order,
        layout.poses,
        units::count(layout.points as u64),
        units::count(layout.vertices as u64),
        layout.parameters,
        state,
        Value::Object(splits.clone()),
        attributes.clip_names.join(", "),
        attributes.hashes.get("bake").map_or("none", String::as_str),
    );
    if let Some(spent) = &spent {
        text += &format!("\n  {}", super::bake::left(spent));
        if let Some(missed) = &spent.missed {
            text += &format!("\n  note: {}", missed.story());
        }
    }
    let json = json!({
        "kind": "dataset",
        "signal": attributes.signal,
        "order": attributes.order,
        "poses": layout.poses,
        "points": layout.points,
        "vertices": layout.vertices,
        "parameters": attributes.parameter_names,
        "clips": attributes.clip_names,
        "splits": splits,
        "blocks": layout.blocks(),
        "missing_blocks": missing,
        "rays_per_point": spent.map(|spent| spent.rays_per_point),
        "noise_rms": spent.map(|spent| spent.noise),
        "noise_missed": spent.and_then(|spent| spent.missed),
        "hashes": attributes.hashes,
        "recipe": attributes.recipe,
    });
    Ok(Answer::new(text, json))
}

fn model(path: &Path) -> anyhow::Result<Answer> {
    let (model, bytes) = super::read_model(path)?;
    let header = model.header();
    let text = format!(
        "model: {} of {} order {} in the {} frame, {}, {}\n  {} points ({} vertices), {} pose parameters, {} training poses\n  {}",
        model.kind(),
        header.signal,
        header.order,
        header.frame,
        header.precision,
        units::bytes(bytes),
        units::count(u64::from(header.mesh.points)),
        units::count(u64::from(header.mesh.vertices)),
        header.parameters(),
        header.training.poses,
        header.provenance.generator,
    );
    let json = json!({
        "kind": "model",
        "bytes": bytes,
        "header": serde_json::to_value(header)?,
    });
    Ok(Answer::new(text, json))
}
