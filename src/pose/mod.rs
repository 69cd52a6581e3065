//! Rank 6. Clips sampled to poses: what is baked, what is held out, and the parameters of each.
//!
//! *Invariant:* the result depends on the scene and the settings alone.
//! *Invariant:* parameters keep only what varies in [`Split::Training`]; no other split has a say.

mod choice;
mod error;
mod evaluate;
mod folds;
mod mixed;
mod predicted;
mod repeats;
mod schedule;
mod spread;

use glam::{Affine3A, Quat};

pub use choice::PoseChoice;
pub use error::Error;
pub use evaluate::evaluate;

pub use crate::rig::RootMotion;
use crate::rig::{
    self, Bones, Parametrisation, ParametrisationKind, Points, Pose, RigidFrame, Skeleton,
    bone_rotations, carried_weight, in_root,
};
use crate::scene::{Scene, size_m};
use choice::keep_apart;
use folds::Folds;
use schedule::{Instant, Schedule};

/// What to sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Clips by name. Default: all.
    pub clips: Option<Vec<String>>,
    /// Clips that are never trained on, by name; they need not be among `clips`. An empty list
    /// holds out nothing. Default: with two clips or more a quarter of them, at least one, drawn
    /// by the seed from those of ten frames or more; with one clip its last quarter
    /// ([`Split::WithinClip`]).
    pub hold_out: Option<Vec<String>>,
    /// Frames per second, positive. Default 30. A clip's first and last key are always sampled.
    pub rate_hz: f32,
    /// Every k-th frame of a training clip is [`Split::Interpolated`]; 0 for none, else at least
    /// 2. Default 10.
    pub interpolated_every: u32,
    /// A pose is dropped where no parameter differs by more than this (radians, model sizes,
    /// units of scale and weight) from an earlier pose of the same split; 0 drops none.
    /// Default 0.005, which is 0.3°.
    pub near_repeat: f32,
    /// Training poses at most, chosen greedily by where the joints are
    /// ([`Parametrisation::handles`]); a larger number takes the same and more. At least 1.
    /// Default: all.
    pub most: Option<usize>,
    /// Which of the training poses those are. Default: the ones that lie farthest apart.
    pub choice: PoseChoice,
    /// Further training poses: limbs of different frames of a clip. Default 0.
    pub mixed: usize,
    /// How a pose becomes numbers. Default joint angles; a sequence of meshes has dihedral angles
    /// only.
    pub parametrisation: ParametrisationKind,
    /// Draws the clips that are held out. Default 0.
    pub seed: u64,
    /// What of the character's own motion is taken out. Default: all of it.
    pub root_motion: RootMotion,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            clips: None,
            hold_out: None,
            rate_hz: 30.0,
            interpolated_every: 10,
            near_repeat: 0.005,
            most: None,
            choice: PoseChoice::Distance,
            mixed: 0,
            parametrisation: ParametrisationKind::JointAngles,
            seed: 0,
            root_motion: RootMotion::Rigid,
        }
    }
}

/// What a pose is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Split {
    /// Fitted.
    Training = 0,
    /// Of a clip that is held out as a whole.
    Novel = 1,
    /// Held out between training frames of the same clip.
    Interpolated = 2,
    /// Of the last quarter of the only clip.
    WithinClip = 3,
}

/// One pose with where it comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Index into [`PoseSet::clip_names`].
    pub clip: usize,
    /// Seconds on the clip's own clock.
    pub time_s: f32,
    /// What it is for.
    pub split: Split,
    /// Whether it is none of a clip's poses but mixed of several ([`Settings::mixed`]).
    pub mixed: bool,
    /// Local transforms and morph weights.
    pub pose: Pose,
    /// The root's rigid motion since rest, which is taken out before baking.
    pub root: RigidFrame,
    /// Bone → rotation since rest, in the root frame.
    pub bone_rotations: Vec<Quat>,
}

/// How many poses of a clip were dropped as near-repeats.
#[derive(Debug, Clone, PartialEq)]
pub struct NearRepeat {
    /// Index into [`PoseSet::clip_names`].
    pub clip: usize,
    /// Poses dropped.
    pub dropped: usize,
    /// Poses before that.
    pub sampled: usize,
    /// [`Settings::near_repeat`].
    pub threshold: f32,
}

/// Everything that the following stages need to know about poses.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseSet {
    /// The sampled clips in the scene's order; `rest` alone for a scene without clips.
    pub clip_names: Vec<String>,
    /// By clip, then by time.
    pub samples: Vec<Sample>,
    /// The map from poses to parameters.
    pub parametrisation: Parametrisation,
    /// `[pose, parameter]`, not centred.
    pub parameters: Vec<f32>,
    /// Which vertices are one point.
    pub points: Points,
    /// Which bone each point sits on.
    pub bones: Bones,
    /// The node whose rigid motion is the root frame.
    pub root_node: Option<usize>,
    /// What of that motion the root frame has.
    pub root_motion: RootMotion,
    /// The diagonal of the rest pose's bounding box, metres.
    pub size_m: f32,
    /// What was dropped, for each clip that lost poses.
    pub near_repeats: Vec<NearRepeat>,
    /// Training poses that [`Settings::most`] left out.
    pub passed_over: usize,
}

impl PoseSet {
    /// Takes in what was appended to the scene's mesh since: its points, and the turns of the nodes that
    /// carry it, of parts that are treated alike ([`Points::merge_apart`]). Poses, parameters and the root's
    /// motion are those of before.
    ///
    /// # Panics
    /// If the scene's skeleton is another.
    pub fn take_in(&mut self, scene: &Scene, kinds: &[u32]) {
        let skeleton = &scene.skeleton;
        let rest = Pose::rest(skeleton, &scene.mesh.default_weights);
        let rest_globals = skeleton.globals(&rest.local);
        self.points = Points::merge_apart(&scene.mesh, kinds);
        self.bones = Bones::dominant(&scene.mesh, &self.points);
        for sample in &mut self.samples {
            let globals = skeleton.globals(&sample.pose.local);
            sample.bone_rotations =
                bone_rotations(&globals, &rest_globals, sample.root, &self.bones);
        }
    }

    /// At most so many poses that cover all, farthest apart by their parameters; ascending.
    #[must_use]
    pub fn covering(&self, most: usize) -> Vec<usize> {
        let width = self.parameters.len() / self.samples.len().max(1);
        spread::spread(&self.parameters, width, most)
    }
}

/// Samples the chosen clips, drops near-repeats, and finds the parameters.
///
/// A scene without clips, or with none chosen, gives its rest pose as the only, training sample.
///
/// # Errors
/// See [`Error`]: settings out of range, unknown clips, nothing left to train on, too many poses,
/// a mesh without extent.
pub fn sample(scene: &Scene, settings: &Settings) -> Result<PoseSet, Error> {
    check(settings)?;
    let size_m = size_m(&scene.mesh, &scene.skeleton);
    if !(size_m.is_finite() && size_m > 0.0) {
        return Err(Error::Size { size_m });
    }
    let schedule = schedule::plan(scene, settings)?;
    let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let mut drafts: Vec<Draft> = schedule
        .instants
        .iter()
        .map(|&instant| Draft { instant, pose: pose_at(&schedule, instant, &rest), mixed: false })
        .collect();
    mixed::add(&mut drafts, scene, settings)?;
    let root = Root::of(scene, settings.root_motion);
    // Repeats are told apart by everything that moves anywhere, parameters by training alone.
    let names = &scene.mesh.weight_names;
    let everything = angles(scene, &root, size_m, names, drafts.iter());
    let near_repeats = drop_repeats(&mut drafts, &everything, &root, settings.near_repeat);
    let training = drafts.iter().filter(|draft| draft.instant.split == Split::Training);
    // The number of a frame is no measure of its shape.
    let names = if scene.is_sequence { &[][..] } else { names };
    let points = Points::merge(&scene.mesh);
    let kind = kind(scene, settings);
    let folds = (kind == ParametrisationKind::Dihedral).then(|| Folds::of(scene, &points, &root));
    let parametrisation = match kind {
        ParametrisationKind::JointAngles => angles(scene, &root, size_m, names, training),
        ParametrisationKind::Dihedral => {
            let folds = folds.as_ref().expect("made for this kind");
            let angles: Vec<_> = training.map(|d| folds.angles(&d.pose, &root)).collect();
            Parametrisation::dihedral(&folds.hinges, &angles, size_m)
        }
        ParametrisationKind::Handles => {
            let poses: Vec<_> = training.map(|d| (&d.pose, root.inside(&d.pose))).collect();
            Parametrisation::handles(&scene.skeleton, &poses, size_m, &carries(scene), names)
        }
    };
    // What varies is a matter of all training poses, so that fewer of them are the same numbers.
    let before = drafts.len();
    if let Some(most) = settings.most {
        keep_apart(&mut drafts, scene, &root, size_m, (most, settings.choice));
    }
    let passed_over = before - drafts.len();
    let bones = Bones::dominant(&scene.mesh, &points);
    let parameters = drafts
        .iter()
        .flat_map(|Draft { pose, .. }| {
            let positions = folds.as_ref().map(|folds| folds.positions(pose, &root));
            parametrisation.encode_posed(pose, &root.inside(pose), &positions.unwrap_or_default())
        })
        .collect();
    let samples = drafts.into_iter().map(|draft| draft.into_sample(&root, &bones)).collect();
    let clip_names = clip_names(&schedule);
    Ok(PoseSet {
        clip_names,
        samples,
        parametrisation,
        parameters,
        points,
        bones,
        root_node: root.node,
        root_motion: settings.root_motion,
        size_m,
        near_repeats,
        passed_over,
    })
}

/// What a sequence of meshes has no joints for, its folds tell.
fn kind(scene: &Scene, settings: &Settings) -> ParametrisationKind {
    if scene.is_sequence { ParametrisationKind::Dihedral } else { settings.parametrisation }
}

fn check(settings: &Settings) -> Result<(), Error> {
    let Settings { rate_hz, near_repeat, interpolated_every, .. } = *settings;
    if !(rate_hz.is_finite() && rate_hz > 0.0) {
        return Err(Error::Rate { rate_hz });
    }
    if !(near_repeat.is_finite() && near_repeat >= 0.0) {
        return Err(Error::NearRepeat { near_repeat });
    }
    if interpolated_every == 1 { Err(Error::InterpolatedEvery) } else { Ok(()) }
}

/// Whose motion is taken out, and what of it.
struct Root<'a> {
    skeleton: &'a Skeleton,
    rest_globals: Vec<Affine3A>,
    node: Option<usize>,
    motion: RootMotion,
}

impl<'a> Root<'a> {
    fn of(scene: &'a Scene, motion: RootMotion) -> Self {
        let skeleton = &scene.skeleton;
        let rest = Pose::rest(skeleton, &scene.mesh.default_weights);
        let fixed = motion == RootMotion::Fixed;
        let node = if fixed { None } else { rig::root_node(skeleton, &scene.mesh) };
        Self { skeleton, rest_globals: skeleton.globals(&rest.local), node, motion }
    }

    fn frame(&self, globals: &[Affine3A]) -> RigidFrame {
        self.motion.frame(self.skeleton, globals, &self.rest_globals, self.node)
    }

    /// The pose's nodes in the root frame.
    fn inside(&self, pose: &Pose) -> Vec<Affine3A> {
        let globals = self.skeleton.globals(&pose.local);
        in_root(&globals, self.frame(&globals))
    }
}

/// A pose before its derived numbers.
struct Draft {
    instant: Instant,
    pose: Pose,
    mixed: bool,
}

impl Draft {
    fn into_sample(self, root: &Root<'_>, bones: &Bones) -> Sample {
        let globals = root.skeleton.globals(&self.pose.local);
        let frame = root.frame(&globals);
        let bone_rotations = bone_rotations(&globals, &root.rest_globals, frame, bones);
        let Instant { clip, time_s, split } = self.instant;
        let Self { pose, mixed, .. } = self;
        Sample { clip, time_s, split, mixed, pose, root: frame, bone_rotations }
    }
}

fn pose_at(schedule: &Schedule<'_>, instant: Instant, rest: &Pose) -> Pose {
    schedule
        .clips
        .get(instant.clip)
        .map_or_else(|| rest.clone(), |clip| evaluate(clip, instant.time_s, rest))
}

fn clip_names(schedule: &Schedule<'_>) -> Vec<String> {
    if schedule.clips.is_empty() {
        return vec!["rest".to_owned()];
    }
    schedule.clips.iter().map(|clip| clip.name.clone()).collect()
}

/// The parametrisation of these poses: without the root's motion as far as that is taken out, and
/// without nodes that carry no vertex.
fn angles<'a>(
    scene: &Scene,
    root: &Root<'_>,
    size_m: f32,
    names: &[String],
    drafts: impl Iterator<Item = &'a Draft>,
) -> Parametrisation {
    let poses: Vec<&Pose> = drafts.map(|draft| &draft.pose).collect();
    let nodes = &scene.skeleton.nodes;
    let mut excluded = vec![false; nodes.len()];
    let mut next = root.node;
    while let Some(node) = next {
        excluded[node] = true;
        next = nodes[node].parent;
    }
    let mut angles =
        Parametrisation::joint_angles(&scene.skeleton, &poses, size_m, &excluded, names);
    angles.retain_nodes(&carries(scene));
    let (RootMotion::Upright, Some(node)) = (root.motion, root.node) else {
        return angles;
    };
    let inside: Vec<Vec<Affine3A>> = poses.iter().map(|pose| root.inside(pose)).collect();
    let inside: Vec<&[Affine3A]> = inside.iter().map(Vec::as_slice).collect();
    angles.on_ground(node, &root.rest_globals, &inside)
}

/// Which nodes carry a vertex, themselves or below them.
fn carries(scene: &Scene) -> Vec<bool> {
    let carried = carried_weight(&scene.skeleton, &scene.mesh);
    carried.iter().map(|&weight| weight > 0.0).collect()
}

/// Removes near-repeats and counts them by clip.
fn drop_repeats(
    drafts: &mut Vec<Draft>,
    by: &Parametrisation,
    root: &Root<'_>,
    threshold: f32,
) -> Vec<NearRepeat> {
    let inside = |pose: &Pose| if by.needs_globals() { root.inside(pose) } else { Vec::new() };
    let encode = |draft: &Draft| by.encode(&draft.pose, &inside(&draft.pose));
    let rows: Vec<f32> = drafts.iter().flat_map(encode).collect();
    let splits: Vec<Split> = drafts.iter().map(|draft| draft.instant.split).collect();
    let keep = repeats::distinct(&rows, by.columns.len(), &splits, threshold);
    let clips = drafts.iter().map(|draft| draft.instant.clip + 1).max().unwrap_or(0);
    let mut report: Vec<NearRepeat> =
        (0..clips).map(|clip| NearRepeat { clip, dropped: 0, sampled: 0, threshold }).collect();
    for (draft, &keep) in drafts.iter().zip(&keep) {
        let clip = &mut report[draft.instant.clip];
        clip.sampled += 1;
        clip.dropped += usize::from(!keep);
    }
    let mut keep = keep.into_iter();
    drafts.retain(|_| keep.next().unwrap_or(true));
    report.retain(|clip| clip.dropped > 0);
    report
}

#[cfg(test)]
mod tests;
