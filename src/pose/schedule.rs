//! Which instants of which clips are sampled, and what each is for.

use super::{Error, Settings, Split};
use crate::num::random::{hash, hash_bytes};
use crate::scene::{Clip, Scene};

/// More poses than this are refused: almost two hours at 30 Hz.
pub(super) const MOST_POSES: usize = 200_000;

/// A clip counts as a candidate for holding out where it has this many frames: a rest pose or a
/// flinch says little about motion that was not seen.
const TELLING_FRAMES: usize = 10;

/// One instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Instant {
    /// Index into [`Schedule::clips`].
    pub(super) clip: usize,
    pub(super) time_s: f32,
    pub(super) split: Split,
}

/// Everything that is to be sampled; no clips and one instant for a static scene.
#[derive(Debug, Default)]
pub(super) struct Schedule<'a> {
    pub(super) clips: Vec<&'a Clip>,
    pub(super) instants: Vec<Instant>,
}

pub(super) fn plan<'a>(scene: &'a Scene, settings: &Settings) -> Result<Schedule<'a>, Error> {
    let all: Vec<usize> = (0..scene.clips.len()).collect();
    let named_out = settings.hold_out.as_ref().map(|names| find(scene, names)).transpose()?;
    let mut chosen = match &settings.clips {
        Some(names) => find(scene, names)?,
        None => all,
    };
    // A clip that is held out by name need not be chosen by name as well.
    chosen.extend(named_out.iter().flatten());
    chosen.sort_unstable();
    chosen.dedup();
    let clips: Vec<&Clip> = chosen.iter().map(|&index| &scene.clips[index]).collect();
    if clips.is_empty() {
        let split = Split::Training;
        return Ok(Schedule { clips, instants: vec![Instant { clip: 0, time_s: 0.0, split }] });
    }
    let times = frames(&clips, settings.rate_hz)?;
    let held_out: Vec<bool> = match &named_out {
        Some(named) => chosen.iter().map(|index| named.contains(index)).collect(),
        None => draw(&clips, &times, settings.seed),
    };
    if held_out.iter().all(|&out| out) {
        let held_out = clips.iter().map(|clip| clip.name.clone()).collect();
        return Err(Error::NothingToTrain { held_out });
    }
    let within = clips.len() == 1 && settings.hold_out.is_none();
    let mut instants = Vec::new();
    for (clip, (times, &out)) in times.iter().zip(&held_out).enumerate() {
        let splits = splits(times.len(), out, within, settings.interpolated_every);
        let pairs = times.iter().zip(splits);
        instants.extend(pairs.map(|(&time_s, split)| Instant { clip, time_s, split }));
    }
    Ok(Schedule { clips, instants })
}

/// Indices of clips by name.
fn find(scene: &Scene, names: &[String]) -> Result<Vec<usize>, Error> {
    names
        .iter()
        .map(|name| {
            scene.clips.iter().position(|clip| clip.name == *name).ok_or_else(|| {
                let known = scene.clips.iter().map(|clip| clip.name.clone()).collect();
                Error::UnknownClip { name: name.clone(), known }
            })
        })
        .collect()
}

/// The times of each clip's frames, bounded in total.
fn frames(clips: &[&Clip], rate_hz: f32) -> Result<Vec<Vec<f32>>, Error> {
    let mut total = 0;
    clips
        .iter()
        .map(|clip| {
            let times = times_of(clip, rate_hz, MOST_POSES - total);
            total += times.as_ref().map_or(0, Vec::len);
            times.ok_or_else(|| Error::TooManyPoses {
                clip: clip.name.clone(),
                duration_s: clip.duration_s,
                rate_hz,
                most: MOST_POSES,
            })
        })
        .collect()
}

/// From the first key of any channel in steps of 1 / rate, and the last key; `None` beyond `most`.
fn times_of(clip: &Clip, rate_hz: f32, most: usize) -> Option<Vec<f32>> {
    /// A frame this close to the last key (in frames) is the last key.
    const SAME: f64 = 1e-3;
    let firsts = clip.channels.iter().filter_map(|channel| channel.times_s.first());
    let lasts = clip.channels.iter().filter_map(|channel| channel.times_s.last());
    let end = lasts.copied().fold(0.0_f32, f32::max);
    let start = firsts.copied().fold(end, f32::min);
    let (rate, first) = (f64::from(rate_hz), f64::from(start));
    let steps = (f64::from(end) - first) * rate - SAME;
    let before_end = (steps.floor() + 1.0).max(0.0);
    if before_end + 1.0 > most as f64 {
        return None;
    }
    let regular = (0..before_end as usize).map(|k| (first + k as f64 / rate) as f32);
    Some(regular.chain([end]).collect())
}

/// A quarter of the clips, at least one and not all, by the seed and the clips' names alone.
///
/// Drawn from the telling clips, of which training keeps at least one.
fn draw(clips: &[&Clip], times: &[Vec<f32>], seed: u64) -> Vec<bool> {
    let mut out = vec![false; clips.len()];
    if clips.len() < 2 {
        return out;
    }
    let (telling, still): (Vec<usize>, Vec<usize>) =
        (0..clips.len()).partition(|&clip| times[clip].len() >= TELLING_FRAMES);
    let (mut candidates, kept) = match (telling.len(), still.len()) {
        (0, _) => (still, 1),
        (1, _) => (still, 0),
        _ => (telling, 1),
    };
    candidates.sort_by_key(|&clip| hash(&[seed, hash_bytes(clips[clip].name.as_bytes())]));
    let count = (clips.len() / 4).clamp(1, candidates.len() - kept);
    candidates.iter().take(count).for_each(|&clip| out[clip] = true);
    out
}

/// What each frame of one clip is for.
fn splits(frames: usize, held_out: bool, within: bool, every: u32) -> Vec<Split> {
    let every = every as usize;
    // At least one frame where there are two; the rest is contiguous training.
    let last_quarter = if within && frames > 1 { (frames / 4).max(1) } else { 0 };
    let training = frames - last_quarter;
    (0..frames)
        .map(|frame| {
            // Never the last frame: between two training frames is what "interpolated" means.
            let between = every > 0 && frame % every == every - 1 && frame + 1 < training;
            match (held_out, frame < training, between) {
                (true, _, _) => Split::Novel,
                (_, false, _) => Split::WithinClip,
                (_, _, true) => Split::Interpolated,
                _ => Split::Training,
            }
        })
        .collect()
}

#[cfg(test)]
#[path = "schedule_tests.rs"]
mod tests;
