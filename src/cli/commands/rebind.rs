//! `poselight rebind`: a model attached to a re-exported scene.

use serde_json::json;

use super::Usage;
use crate::cli::Answer;
use crate::cli::rebind_args::RebindArgs;
use crate::pipeline::{self, RebindSettings, Rebound, files};

/// Vertices without a point that are told, at most.
const MOST_TOLD: usize = 1000;

pub(in crate::cli) fn rebind(args: &RebindArgs) -> anyhow::Result<Answer> {
    let mut settings = RebindSettings::default();
    settings.tolerance = args.tolerance.unwrap_or(settings.tolerance);
    settings.unmatched = args.unmatched.unwrap_or(settings.unmatched);
    for (flag, value) in [("--tolerance", settings.tolerance), ("--unmatched", settings.unmatched)]
    {
        if !(0.0..=1.0).contains(&value) {
            return Err(Usage(format!("{flag} is {value}; it is a share, 0 to 1")).into());
        }
    }
    keep_files(args)?;
    let model = super::read_model(&args.model)?.0;
    let scene = pipeline::import(&args.scene)?;
    let rebound = pipeline::rebind(&model, &scene, args.original.as_deref(), &settings)?;
    let bytes = rebound.model.to_bytes(model.header().precision)?;
    files::publish(&args.output, &bytes)?;
    Ok(Answer::new(text(args, &rebound), document(args, &rebound)))
}

/// Refuses an output of another name than a model's, or that would replace what is read.
fn keep_files(args: &RebindArgs) -> Result<(), Usage> {
    super::named(&args.output, "safetensors")?;
    let mut inputs = vec![("model", args.model.as_path()), ("scene", args.scene.as_path())];
    inputs.extend(args.original.as_deref().map(|path| ("original scene", path)));
    super::keep_apart(&inputs, &[("the output", &args.output)])
}

fn text(args: &RebindArgs, rebound: &Rebound) -> String {
    let Rebound { vertices, unmatched, farthest_m, unused_points, edges_kept, .. } = rebound;
    let edges = edges_kept
        .map_or(String::new(), |share| format!(", {:.1} % of the edges as before", 100.0 * share));
    let mut text = format!(
        "{} is for {vertices} vertices: {} match a point within {farthest_m:.1e} m, {} take the \
         nearest one, {unused_points} points have no vertex{edges}",
        args.output.display(),
        vertices - unmatched.len(),
        unmatched.len()
    );
    for one in unmatched.iter().take(MOST_TOLD) {
        let (vertex, part, at, off) = (one.vertex, &one.part, one.position, one.nearest_m);
        text += &format!("\nvertex {vertex} of {part} at {at}: nearest point {off:.2e} m away");
    }
    text
}

fn document(args: &RebindArgs, rebound: &Rebound) -> serde_json::Value {
    let tell = |one: &pipeline::Unmatched| {
        json!({
            "vertex": one.vertex,
            "part": one.part,
            "position": one.position.to_array(),
            "nearest_m": one.nearest_m,
        })
    };
    json!({
        "output": args.output,
        "vertices": rebound.vertices,
        "unmatched": rebound.unmatched.len(),
        "unmatched_vertices": rebound.unmatched.iter().take(MOST_TOLD).map(tell).collect::<Vec<_>>(),
        "farthest_m": rebound.farthest_m,
        "unused_points": rebound.unused_points,
        "edges_kept": rebound.edges_kept,
    })
}
