//! `poselight sample` and `poselight schema`: what the program itself holds.

use anyhow::Context;
use serde_json::json;

use crate::cli::Answer;
use crate::cli::args::{SampleArgs, SampleName};
use crate::cli::units;
use crate::pipeline::files;
use crate::pipeline::recipe::Recipe;
use crate::scene::figure::figure;

pub(in crate::cli) fn sample(args: &SampleArgs) -> anyhow::Result<Answer> {
    let bytes = match args.name {
        SampleName::Figure => figure(),
    };
    files::publish(&args.output, &bytes)?;
    let size = bytes.len() as u64;
    let text = format!("wrote {} ({})", args.output.display(), units::bytes(size));
    Ok(Answer::new(text, json!({ "file": args.output, "bytes": size })))
}

pub(in crate::cli) fn schema() -> anyhow::Result<Answer> {
    let json = serde_json::to_value(schemars::schema_for!(Recipe)).context("the schema")?;
    Ok(Answer::new(serde_json::to_string_pretty(&json)?, json))
}
