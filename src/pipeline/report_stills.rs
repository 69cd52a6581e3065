//! Stills of a report: the model beside its truth where it errs most, as it mostly does, and least.

use super::still::{Still, still};
use super::{GLOSS_LOBES, GLOSS_TERMS, Job};
use crate::measure::report::ReportStill;
use crate::measure::{Kind, Measured};
use crate::model::Model;
use crate::render::Tone;

/// Pixels of a panel.
const SIZE: [u32; 2] = [220, 300];

/// The most rays of each of the four samples of a pixel; a coarse bake gets no finer truth than it
/// had itself.
const MOST_RAYS: u32 = 64;

/// The worst, the middle and the best frame of the headline split by ambient occlusion, each once;
/// none where a still would have no truth to show.
pub(super) fn stills(job: &Job, model: &Model, measured: &Measured) -> Vec<ReportStill> {
    let split = measured.headline.and_then(|split| measured.split(split));
    let Some(split) = split else { return Vec::new() };
    let candidate = split.candidates.iter().find(|candidate| candidate.kind == Kind::Model);
    let Some(candidate) = candidate else { return Vec::new() };
    let mut order: Vec<usize> = (0..candidate.frame_ao_mae.len()).collect();
    order.sort_by(|&a, &b| candidate.frame_ao_mae[b].total_cmp(&candidate.frame_ao_mae[a]));
    let Some(last) = order.len().checked_sub(1) else { return Vec::new() };
    let mut chosen = vec![(0, "Worst"), (last / 2, "Median"), (last, "Best")];
    chosen.dedup_by_key(|(place, _)| *place);
    let frame = |(place, name): (usize, &str)| {
        let index = order[place];
        let clip = split.clips.get(split.frames.clip[index]).map_or("", String::as_str);
        let time_s = split.frames.time_s[index] as f32;
        let error = candidate.frame_ao_mae[index];
        let png = picture(job, model, clip, time_s)?;
        Some(ReportStill { name: name.to_owned(), clip: clip.to_owned(), time_s, error, png })
    };
    chosen.into_iter().filter_map(frame).collect()
}

/// One frame's panels as PNG, where there is a truth.
fn picture(job: &Job, model: &Model, clip: &str, time_s: f32) -> Option<Vec<u8>> {
    let clip = job.scene.clips.iter().find(|known| known.name == clip);
    let settings = Still {
        clip: clip.map(|clip| clip.name.as_str()),
        times_s: vec![clip.map_or(0.0, |clip| time_s.clamp(0.0, clip.duration_s))],
        view: [30.0, 10.0],
        size: SIZE,
        samples: 2,
        rays: job.recipe.bake.rays.clamp(2, MOST_RAYS),
        gains: vec![4.0],
        light: job.lit.as_ref().map(|lit| lit.light.clone()),
        brdf: job.lit.as_ref().and_then(|lit| lit.material.clone()),
        terms: job.lit.as_ref().map_or(GLOSS_TERMS, |lit| lit.recipe.terms as usize),
        lobes: job.lit.as_ref().map_or(GLOSS_LOBES, |lit| lit.recipe.lobes as usize),
        turntable: None,
        tone: Tone::Linear,
        exposure_stops: 0.0,
    };
    // A still is an extra: a model that cannot be shown still has its figures.
    let made = still(&job.scene, Some(model), &settings).ok()?;
    made.differences.first().copied().flatten()?;
    made.pictures.first()?.png().ok()
}
