//! Stills of a report: the model beside its truth where it errs most, as it mostly does, and least.

use super::still::{NO_TRUTH, Still, still};
use super::{Finish, GLOSS_LOBES, GLOSS_TERMS, Job};
use crate::measure::report::ReportStill;
use crate::measure::{Kind, Measured};
use crate::model::Model;
use crate::render::Tone;

/// Pixels of a panel.
const SIZE: [u32; 2] = [220, 300];

/// The most rays of each of the four samples of a pixel; a coarse bake gets no finer truth than it
/// had itself.
const MOST_RAYS: u32 = 64;

/// The worst, the middle and the best frame of the headline split by ambient occlusion, each once; or
/// none, and why, where a still would have no truth to show.
pub(super) fn stills(
    job: &Job,
    model: &Model,
    measured: &Measured,
) -> (Vec<ReportStill>, Option<String>) {
    let split = measured.headline.and_then(|split| measured.split(split));
    let Some(split) = split else { return (Vec::new(), None) };
    let candidate = split.candidates.iter().find(|candidate| candidate.kind == Kind::Model);
    let Some(candidate) = candidate else { return (Vec::new(), None) };
    let frame = |(index, name): (usize, &str)| {
        let clip = split.clips.get(split.frames.clip[index]).map_or("", String::as_str);
        let time_s = split.frames.time_s[index] as f32;
        let error = candidate.frame_ao_mae[index];
        let png = picture(job, model, clip, time_s)?;
        Ok(ReportStill { name: name.to_owned(), clip: clip.to_owned(), time_s, error, png })
    };
    let chosen = chosen(&candidate.frame_ao_mae);
    match chosen.into_iter().map(frame).collect::<Result<_, String>>() {
        Ok(stills) => (stills, None),
        // A still is an extra: a model that cannot be shown still has its figures.
        Err(why) => (Vec::new(), Some(format!("no stills beside the truth: {why}"))),
    }
}

/// The frames of the largest, the middle and the smallest error, each once.
fn chosen(errors: &[f64]) -> Vec<(usize, &'static str)> {
    let mut order: Vec<usize> = (0..errors.len()).collect();
    order.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]));
    let Some(last) = order.len().checked_sub(1) else { return Vec::new() };
    let mut places = vec![(0, "Worst"), (last / 2, "Median"), (last, "Best")];
    places.dedup_by_key(|(place, _)| *place);
    places.into_iter().map(|(place, name)| (order[place], name)).collect()
}

/// One frame's panels as PNG; else why there is no truth beside the model.
fn picture(job: &Job, model: &Model, clip: &str, time_s: f32) -> Result<Vec<u8>, String> {
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
        brdf: job.lit.as_ref().and_then(|lit| lit.material.clone()).map(Finish::from),
        terms: job.lit.as_ref().map_or(GLOSS_TERMS, |lit| lit.recipe.terms as usize),
        lobes: job.lit.as_ref().map_or(GLOSS_LOBES, |lit| lit.recipe.lobes as usize),
        turntable: None,
        tone: Tone::Linear,
        exposure_stops: 0.0,
    };
    let made = still(&job.scene, Some(model), &settings).map_err(|error| error.to_string())?;
    if made.differences.first().copied().flatten().is_none() {
        let untold = made
            .notices
            .into_iter()
            .find_map(|told| told.strip_prefix(NO_TRUTH).map(str::to_owned));
        return Err(untold.unwrap_or_else(|| "there is no truth to show".to_owned()));
    }
    made.pictures[0].png().map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The worst frame is that of the largest error, the best that of the smallest, and the middle lies
    /// between; few frames are named once each.
    #[test]
    fn frames_are_chosen_by_their_errors() {
        let found = chosen(&[0.2, 0.5, 0.1, 0.4, 0.3]);
        assert_eq!(found, [(1, "Worst"), (4, "Median"), (2, "Best")]);
        assert_eq!(chosen(&[0.1, 0.2]), [(1, "Worst"), (0, "Best")]);
        assert_eq!(chosen(&[0.1]), [(0, "Worst")]);
        assert!(chosen(&[]).is_empty());
    }
}
