//! `poselight crowd`: characters that shadow one another and a floor.

use anyhow::{Context, bail};
use serde_json::json;

use crate::cli::Answer;
use crate::cli::crowd_args::CrowdArgs;
use crate::cli::light_source::read_light;
use crate::pipeline::{self, Crowd, CrowdPlace, files};
use crate::sh::Order;

/// Vertices along a side of the floor.
const FLOOR_VERTICES: usize = 97;

pub(in crate::cli) fn crowd(args: &CrowdArgs) -> anyhow::Result<Answer> {
    super::named(&args.output, "png")?;
    let places = places(args)?;
    let scene = pipeline::import(&args.scene)?;
    let (model, _) = super::read_model(&args.model)?;
    let read = read_light(&args.light, Order::new(model.header().order)?, args.material.turn)?;
    for notice in &read.notices {
        tracing::warn!("{notice}");
    }
    let mut notices = read.notices;
    let finish = super::brdf::finish(&args.material.brdf, &mut notices)?;
    let settings = Crowd {
        places,
        spheres: args.spheres,
        floor_vertices: FLOOR_VERTICES,
        light: &read.light,
        finish,
        terms: args.material.terms,
        lobes: args.material.lobes,
        view: [args.yaw, args.pitch],
        size: [args.size[0], args.size[1]],
        samples: args.sampling.samples,
        rays: args.sampling.rays,
        gains: if args.gain.is_empty() { vec![4.0] } else { args.gain.clone() },
        tone: args.screen.tone.into(),
        exposure_stops: args.screen.exposure,
    };
    let made = pipeline::crowd(&scene, &model, &settings)?;
    files::publish(&args.output, &made.picture.png()?)?;
    let text = format!(
        "{}: {} characters of {} spheres each; model and truth differ by {:.4} (RMS), without cast \
         shadows by {:.4}; shadows and products took {:.2} µs a vertex",
        args.output.display(),
        settings.places.len(),
        made.spheres,
        made.difference,
        made.difference_without,
        made.vertex_us
    );
    let json = json!({
        "output": args.output,
        "width": made.picture.width(),
        "height": made.picture.height(),
        "characters": settings.places.len(),
        "spheres": made.spheres,
        "light": args.light,
        "brdf": args.material.brdf,
        "tone": settings.tone.name(),
        "exposure": made.exposure,
        "rms_difference": made.difference,
        "rms_difference_without_cast_shadows": made.difference_without,
        "shadow_us_per_vertex": made.vertex_us,
        "notices": notices,
    });
    Ok(Answer::new(text, json))
}

fn places(args: &CrowdArgs) -> anyhow::Result<Vec<CrowdPlace>> {
    let clip = |time_s| args.clip.clone().map(|name| (name, time_s));
    let place = |at, yaw_degrees, time_s| CrowdPlace { at, yaw_degrees, clip: clip(time_s) };
    if args.place.is_empty() {
        return Ok(vec![place([-0.4, 0.0], 0.0, 0.0), place([0.4, 0.0], 0.0, 0.0)]);
    }
    let read = |text: &String| {
        let numbers: Result<Vec<f32>, _> = text.split(',').map(|n| n.trim().parse()).collect();
        let numbers = numbers.with_context(|| format!("--place {text}"))?;
        Ok(match numbers[..] {
            [x, z] => place([x, z], 0.0, 0.0),
            [x, z, yaw] => place([x, z], yaw, 0.0),
            [x, z, yaw, time_s] => place([x, z], yaw, time_s),
            _ => {
                bail!("--place {text} has {} numbers; it is X,Z[,DEGREES[,SECONDS]]", numbers.len())
            }
        })
    };
    args.place.iter().map(read).collect()
}
