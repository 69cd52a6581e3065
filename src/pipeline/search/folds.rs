//! What is left out of the fits that candidates are judged by.

use crate::pipeline::CandidateRecipe;
use crate::pipeline::recipe::RidgeName;

/// Groups of clips that are left out in turn, at most.
const MOST_FOLDS: usize = 3;

/// Whether the candidates are meant for what lies between trained poses.
pub(in crate::pipeline) fn leaves_poses(candidates: &[CandidateRecipe]) -> bool {
    candidates.iter().all(|candidate| candidate.recipe.fit.ridge == RidgeName::LeaveOneOut)
}

/// Groups of training poses that are left out in turn: single ones between others where that is
/// what the models are for, else whole clips where there are at least two, else parts of the only one. Nothing
/// where there is a single pose.
pub(in crate::pipeline) fn folds(clips: &[i32], single: bool) -> (Vec<Vec<usize>>, String) {
    if single && clips.len() >= 3 * MOST_FOLDS {
        // No two neighbours, and all of them in only one of three groups.
        let group = |g: usize| (2 * g + 1..clips.len()).step_by(2 * MOST_FOLDS).collect();
        let text = format!("every second training pose, in {MOST_FOLDS} groups in turn");
        return ((0..MOST_FOLDS).map(group).collect(), text);
    }
    let mut names = clips.to_vec();
    names.sort_unstable();
    names.dedup();
    if names.len() < 2 {
        if clips.len() < 2 {
            return (vec![Vec::new()], "nothing of the only pose, so that its noise is all".into());
        }
        let count = clips.len().min(MOST_FOLDS);
        let part = |i: usize| (i * clips.len() / count..(i + 1) * clips.len() / count).collect();
        return ((0..count).map(part).collect(), format!("{count} parts of the only clip in turn"));
    }
    let count = names.len().min(MOST_FOLDS);
    let fold = |clip: &i32| names.partition_point(|name| name < clip) % count;
    let group = |g: usize| (0..clips.len()).filter(|&pose| fold(&clips[pose]) == g).collect();
    let text = format!("{count} groups of the {} training clips in turn", names.len());
    ((0..count).map(group).collect(), text)
}
