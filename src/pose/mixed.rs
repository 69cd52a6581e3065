//! Training poses that no clip has: limbs of one frame with limbs of others.
//!
//! A fit learns links between joints that only happen to move together; poses in which they do not, break
//! them (Nowrouzezahrai et al. 2009, §5.1, sample poses regularly for that reason). A limb is what hangs below
//! a joint with several children, up to the next such joint; it takes its local transforms from one frame.
//! All frames of a mixed pose are of one clip, so whoever leaves that clip out leaves its mixes out too.

use super::schedule::{Instant, MOST_POSES};
use super::{Draft, Error, Settings, Split};
use crate::num::random::hash;
use crate::rig::{Pose, Skeleton, carried_weight};
use crate::scene::Scene;

/// What hangs from a joint counts as a limb where it carries this share of all weight; fingers go along.
const LIMB_SHARE: f64 = 0.01;

/// Frames between one mixed pose and the next on the clip's clock: they are no motion.
const FRAMES_APART: f32 = 8.0;

/// Tells these random numbers from others of the same seed.
const KEY: u64 = 0x6d69_7865_6420;

/// Limb of every node: 0 for the trunk, from the root to the first joint with several limbs below it.
fn limbs(skeleton: &Skeleton, carried: &[f64]) -> Vec<usize> {
    let nodes = &skeleton.nodes;
    let roots = nodes.iter().zip(carried).filter(|(node, _)| node.parent.is_none());
    let least = LIMB_SHARE * roots.map(|(_, weight)| weight).sum::<f64>();
    let counts = |node: usize| carried[node] > 0.0 && carried[node] >= least;
    let mut branches = vec![0; nodes.len()];
    for (index, node) in nodes.iter().enumerate() {
        if let Some(parent) = node.parent.filter(|_| counts(index)) {
            branches[parent] += 1;
        }
    }
    let (mut limbs, mut count) = (vec![0; nodes.len()], 1);
    // A node comes after its parent.
    for (index, node) in nodes.iter().enumerate() {
        let Some(parent) = node.parent else { continue };
        limbs[index] = limbs[parent];
        if counts(index) && branches[parent] > 1 {
            (limbs[index], count) = (count, count + 1);
        }
    }
    limbs
}

/// Puts the mixed poses of every clip behind its own.
pub(super) fn add(
    drafts: &mut Vec<Draft>,
    scene: &Scene,
    settings: &Settings,
) -> Result<(), Error> {
    if settings.mixed == 0 {
        return Ok(());
    }
    if scene.is_sequence {
        return Err(Error::MixedSequence);
    }
    if settings.mixed + drafts.len() > MOST_POSES {
        return Err(Error::TooManyMixed { mixed: settings.mixed, most: MOST_POSES });
    }
    let carried = carried_weight(&scene.skeleton, &scene.mesh);
    let (rig, number) = ((&scene.skeleton, &carried[..]), (settings.mixed, settings.seed));
    drafts.extend(mixed(drafts, rig, number, settings.rate_hz));
    drafts.sort_by_key(|draft| draft.instant.clip);
    Ok(())
}

/// `count` poses mixed of the training frames of one clip each, evenly over all training frames; each is
/// dated after its clip's end. `carried` is the weight at and below each node.
fn mixed(
    drafts: &[Draft],
    (skeleton, carried): (&Skeleton, &[f64]),
    (count, seed): (usize, u64),
    rate_hz: f32,
) -> Vec<Draft> {
    let training: Vec<usize> =
        (0..drafts.len()).filter(|&i| drafts[i].instant.split == Split::Training).collect();
    let limbs = limbs(skeleton, carried);
    let clips = drafts.iter().map(|draft| draft.instant.clip + 1).max().unwrap_or(0);
    let mut dates = vec![0.0_f32; clips];
    for Instant { clip, time_s, .. } in drafts.iter().map(|draft| draft.instant) {
        dates[clip] = dates[clip].max(time_s);
    }
    let one = |k: usize| {
        let first = training[k * training.len() / count];
        let clip = drafts[first].instant.clip;
        let others: Vec<usize> =
            training.iter().copied().filter(|&i| drafts[i].instant.clip == clip).collect();
        let drawn = |limb: usize| {
            let number = hash(&[seed, KEY, k as u64, limb as u64]);
            others[(number % others.len() as u64) as usize]
        };
        let of = |limb: usize| if limb == 0 { first } else { drawn(limb) };
        let local = limbs.iter().enumerate();
        let local = local.map(|(node, &limb)| drafts[of(limb)].pose.local[node]).collect();
        dates[clip] += FRAMES_APART / rate_hz;
        let instant = Instant { clip, time_s: dates[clip], split: Split::Training };
        let pose = Pose { local, weights: drafts[first].pose.weights.clone() };
        Draft { instant, pose, mixed: true }
    };
    if training.is_empty() { Vec::new() } else { (0..count).map(one).collect() }
}

#[cfg(test)]
#[path = "mixed_tests.rs"]
mod tests;
