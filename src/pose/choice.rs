//! Which of the training poses are kept, where not all are.

use super::{Draft, Root, Split, carries, predicted, spread};
use crate::rig::Parametrisation;
use crate::scene::Scene;

/// How few of many training poses are chosen, each in view of those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PoseChoice {
    /// The one farthest from all of them.
    #[default]
    Distance,
    /// The one at which the error of a model of them is predicted to be largest: the posterior deviation of
    /// a Gaussian process over where the joints are.
    PredictedError,
}

/// Keeps so many of the training poses, as far apart as can be, and all others.
pub(super) fn keep_apart(
    drafts: &mut Vec<Draft>,
    scene: &Scene,
    root: &Root<'_>,
    size_m: f32,
    (most, choice): (usize, PoseChoice),
) {
    let training = drafts.iter().filter(|draft| draft.instant.split == Split::Training);
    let poses: Vec<_> = training.map(|d| (&d.pose, root.inside(&d.pose))).collect();
    let names = &scene.mesh.weight_names;
    let by = Parametrisation::handles(&scene.skeleton, &poses, size_m, &carries(scene), names);
    let rows: Vec<f32> = poses.iter().flat_map(|(pose, inside)| by.encode(pose, inside)).collect();
    let width = by.columns.len();
    let keep = match choice {
        PoseChoice::Distance => spread::spread(&rows, width, most),
        PoseChoice::PredictedError => predicted::uncertain(&rows, width, most),
    };
    let mut index = 0..;
    drafts.retain(|draft| {
        draft.instant.split != Split::Training
            || index.next().is_some_and(|i: usize| keep.binary_search(&i).is_ok())
    });
}
