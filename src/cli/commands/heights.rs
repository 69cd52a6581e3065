//! `poselight heights`: height fields from above.

use anyhow::bail;
use serde_json::json;

use crate::cli::heights_args::HeightsArgs;
use crate::cli::light_source::read_light;
use crate::cli::{Answer, files as arrays, units};
use crate::pipeline::{self, Heights, files};
use crate::render::animated_png;
use crate::sh::Order;

pub(in crate::cli) fn heights(args: &HeightsArgs) -> anyhow::Result<Answer> {
    super::named(&args.output, "png")?;
    let order = Order::new(args.order)?;
    let (shape, values) = arrays::read_npy(&args.field)?;
    let (rows, columns) = match shape[..] {
        [rows, columns] | [_, rows, columns] => (rows, columns),
        _ => bail!(
            "{} has shape {shape:?}; a field is [row, column] or [frame, row, column]",
            args.field.display()
        ),
    };
    let read = read_light(&args.light, order, args.material.turn)?;
    for notice in &read.notices {
        tracing::warn!("{notice}");
    }
    let mut notices = read.notices;
    let finish = super::brdf::finish(&args.material.brdf, &mut notices)?;
    let made = pipeline::heights(&Heights {
        size: [columns, rows],
        cell_m: args.cell,
        heights: &values,
        order,
        azimuths: args.azimuths,
        light: &read.light,
        finish,
        terms: args.material.terms,
        lobes: args.material.lobes,
        tone: args.screen.tone.into(),
        exposure_stops: args.screen.exposure,
    })?;
    let png = match made.pictures.as_slice() {
        [picture] => picture.png()?,
        frames => animated_png(frames, args.speed)?,
    };
    files::publish(&args.output, &png)?;
    let [mean, largest] = made.error;
    let text = format!(
        "{} of {columns} × {rows} pixels, {} frames; visibility takes {} a frame and is off by {mean:.4} \
         of open sky on average, {largest:.4} at most, from traced horizons",
        args.output.display(),
        made.pictures.len(),
        units::seconds(made.visibility_s)
    );
    let json = json!({
        "output": args.output,
        "width": columns,
        "height": rows,
        "frames": made.pictures.len(),
        "light": args.light,
        "brdf": args.material.brdf,
        "exposure": made.exposure,
        "visibility_s": made.visibility_s,
        "mean_error": mean,
        "largest_error": largest,
        "notices": notices,
    });
    Ok(Answer::new(text, json))
}
