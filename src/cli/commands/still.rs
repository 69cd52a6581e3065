//! `poselight still`: a picture of a scene, by rays and by a model.

use serde_json::json;

use crate::cli::Answer;
use crate::cli::light_source::read_light;
use crate::cli::still_args::StillArgs;
use crate::pipeline::{self, GLOSS_LOBES, GLOSS_TERMS, Still, StillPicture, files};
use crate::render::animated_png;
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
    let turntable = args.turntable.map(usize::from);
    let times_s = match (&args.clip, args.time) {
        (None, _) => Vec::new(),
        (Some(_), Some(time)) => vec![time],
        (Some(clip), None) if turntable.is_some() => {
            // The last frame is followed by the first.
            let count = turntable.unwrap_or(1);
            let mut times = pipeline::spread_times(&scene, clip, count + 1)?;
            times.truncate(count);
            times
        }
        (Some(clip), None) => {
            pipeline::spread_times(&scene, clip, usize::from(args.frames.unwrap_or(1)))?
        }
    };
    // A still tells what is to be said against it itself.
    let brdf = args.brdf.as_deref().map(|brdf| super::brdf::finish(brdf, &mut Vec::new()));
    let brdf = brdf.transpose()?;
    let settings = Still {
        clip: args.clip.as_deref(),
        times_s,
        view: [args.yaw, args.pitch],
        size: [args.size[0], args.size[1]],
        samples: args.sampling.samples,
        rays: args.sampling.rays,
        gains: if args.gain.is_empty() { vec![4.0] } else { args.gain.clone() },
        light: light.as_ref().map(|read| read.light.clone()),
        brdf,
        terms: args.terms.map_or(GLOSS_TERMS, usize::from),
        lobes: args.lobes.map_or(GLOSS_LOBES, usize::from),
        turntable,
        tone: args.screen.tone.into(),
        exposure_stops: args.screen.exposure,
    };
    let made = pipeline::still(&scene, model.as_ref(), &settings)?;
    let png = match made.pictures.as_slice() {
        [picture] => picture.png()?,
        frames => animated_png(frames, args.speed)?,
    };
    files::publish(&args.output, &png)?;
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
    let (width, height) = (made.pictures[0].width(), made.pictures[0].height());
    let mut text = format!("{} of {width} × {height} pixels", args.output.display());
    if made.pictures.len() > 1 {
        text = format!("{text}, {} frames", made.pictures.len());
    }
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
        "tone": settings.tone.name(),
        "turntable": settings.turntable,
        "gains": settings.gains,
        "frames": frames,
        "notices": notices,
    });
    Answer::new(text, json)
}
