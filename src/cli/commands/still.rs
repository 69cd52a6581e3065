//! `poselight still`: a picture of a scene, by rays and by a model.

use serde_json::json;

use crate::cli::Answer;
use crate::cli::light_source::read_light;
use crate::cli::still_args::StillArgs;
use crate::pipeline::{self, Still, StillPicture, files};
use crate::sh::Order;

pub(in crate::cli) fn still(args: &StillArgs) -> anyhow::Result<Answer> {
    super::named(&args.output, "png")?;
    let scene = pipeline::import(&args.scene)?;
    let model = args.model.as_deref().map(super::read_model).transpose()?.map(|(model, _)| model);
    let light = args.light.as_deref().map(|source| {
        let order = model.as_ref().map_or(args.order, |model| model.header().order);
        read_light(source, Order::new(order)?, args.turn)
    });
    let light = light.transpose()?;
    let times_s = match (&args.clip, args.time) {
        (None, _) => Vec::new(),
        (Some(_), Some(time)) => vec![time],
        (Some(clip), None) => {
            pipeline::spread_times(&scene, clip, usize::from(args.frames.unwrap_or(1)))?
        }
    };
    let settings = Still {
        clip: args.clip.as_deref(),
        times_s,
        view: [args.yaw, args.pitch],
        size: [args.size[0], args.size[1]],
        samples: args.samples,
        rays: args.rays,
        gains: if args.gain.is_empty() { vec![4.0] } else { args.gain.clone() },
        light: light.as_ref().map(|read| read.light.clone()),
        brdf: args.brdf.as_deref().map(super::brdf::read).transpose()?,
        exposure_stops: args.exposure,
    };
    let made = pipeline::still(&scene, model.as_ref(), &settings)?;
    files::publish(&args.output, &made.picture.png()?)?;
    let mut notices = light.map_or_else(Vec::new, |read| read.notices);
    notices.extend(made.notices.iter().cloned());
    for notice in &notices {
        tracing::warn!("{notice}");
    }
    Ok(answer(args, &settings, &made, &notices))
}

fn answer(
    args: &StillArgs,
    settings: &Still<'_>,
    made: &StillPicture,
    notices: &[String],
) -> Answer {
    let (width, height) = (made.picture.width(), made.picture.height());
    let mut text = format!("{} of {width} × {height} pixels", args.output.display());
    let frames: Vec<_> = made
        .differences
        .iter()
        .enumerate()
        .map(|(i, difference)| json!({ "time_s": settings.times_s.get(i), "rms_difference": difference }))
        .collect();
    if let Some(worst) = made.differences.iter().flatten().copied().reduce(f32::max) {
        text = format!("{text}; model and truth differ by {worst:.4} at most (RMS of a frame)");
    }
    let json = json!({
        "output": args.output,
        "width": width,
        "height": height,
        "clip": args.clip,
        "light": args.light,
        "brdf": args.brdf,
        "exposure": made.exposure,
        "gains": settings.gains,
        "frames": frames,
        "notices": notices,
    });
    Answer::new(text, json)
}
