use glam::Vec3;

use super::*;
use crate::rig::{Deformer, Influence, Mesh, Node, Skeleton, Transform};
use crate::scene::{Channel, Clip, Interpolation, Target};

/// A root with an arm and a helper that carries nothing; a triangle on root and arm.
fn scene(clips: Vec<Clip>) -> Scene {
    let node = |name: &str, parent| Node { name: name.into(), parent, rest: Transform::IDENTITY };
    let skeleton =
        Skeleton { nodes: vec![node("root", None), node("arm", Some(0)), node("target", None)] };
    let influence = |deformer| Influence { deformer, weight: 1.0 };
    let mesh = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        triangles: vec![[0, 1, 2]],
        deformers: (0..2).map(|node| Deformer { node, inverse_bind: Affine3A::IDENTITY }).collect(),
        influences: vec![influence(0), influence(1), influence(1)],
        influence_starts: vec![0, 1, 2, 3],
        ..Mesh::default()
    };
    Scene {
        skeleton,
        mesh,
        clips,
        is_sequence: false,
        surface: None,
        sources: Vec::new(),
        notices: Vec::new(),
    }
}

fn turning(node: usize, to: f32) -> Channel {
    let keys = [Quat::IDENTITY, Quat::from_rotation_z(to)];
    Channel {
        target: Target::Rotation(node),
        interpolation: Interpolation::Linear,
        times_s: vec![0.0, 1.0],
        values: keys.iter().flat_map(|q| q.to_array()).collect(),
    }
}

fn clip(name: &str, channels: Vec<Channel>) -> Clip {
    Clip { name: name.into(), duration_s: 1.0, channels }
}

fn splits(set: &PoseSet, split: Split) -> usize {
    set.samples.iter().filter(|sample| sample.split == split).count()
}

/// Proves the whole on one clip: parameters are angles about the training mean, the root's motion
/// and the helper's are no parameters, and bones turn as the clip says, in the root frame.
#[test]
fn one_clip() {
    let scene = scene(vec![clip("c", vec![turning(0, 2.0), turning(1, 1.2), turning(2, 0.5)])]);
    let set = sample(&scene, &Settings::default()).unwrap();
    assert_eq!((set.samples.len(), set.clip_names.len(), set.root_node), (31, 1, Some(0)));
    assert_eq!((splits(&set, Split::WithinClip), splits(&set, Split::Interpolated)), (7, 2));
    let names: Vec<&str> = set.parametrisation.columns.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["arm rotation z"]);
    assert!(set.parametrisation.dropped.contains(&"target rotation z".to_owned()));
    let training = set.samples.iter().zip(&set.parameters);
    let of_training = training.filter(|(sample, _)| sample.split == Split::Training);
    assert!(of_training.map(|(_, angle)| angle).sum::<f32>().abs() < 0.05);
    for (sample, angle) in set.samples.iter().zip(&set.parameters) {
        let expected = 1.2 * sample.time_s + set.parameters[0];
        assert!((angle - expected).abs() < 1e-5);
        assert!(
            sample.root.rotation.angle_between(Quat::from_rotation_z(2.0 * sample.time_s)) < 1e-3
        );
        let arm = sample.bone_rotations[1];
        assert!(arm.angle_between(Quat::from_rotation_z(1.2 * sample.time_s)) < 1e-3);
        assert!(sample.bone_rotations[0].angle_between(Quat::IDENTITY) < 1e-3);
    }
}

/// Proves that repeats go and are counted, within their own split only: two equal clips of which
/// one is held out both keep their poses, three equal ones do not.
#[test]
fn near_repeats_within_a_split() {
    let names = ["a", "b", "c"];
    let scene = scene(names.map(|name| clip(name, vec![turning(1, 1.0)])).to_vec());
    let hold_out = Some(vec!["b".to_owned()]);
    let settings = Settings { hold_out, interpolated_every: 0, ..Settings::default() };
    let set = sample(&scene, &settings).unwrap();
    assert_eq!((splits(&set, Split::Training), splits(&set, Split::Novel)), (31, 31));
    let dropped = NearRepeat { clip: 2, dropped: 31, sampled: 31, threshold: 0.005 };
    assert_eq!(set.near_repeats, [dropped]);
    let all = sample(&scene, &Settings { near_repeat: 0.0, ..settings }).unwrap();
    assert_eq!((all.samples.len(), all.near_repeats.len()), (93, 0));
}

/// Proves that a degree of freedom that moves only in held-out motion is no parameter, and that
/// held-out poses which differ by it alone are still different poses.
#[test]
fn held_out_motion_has_no_say() {
    let clips = vec![clip("a", vec![turning(1, 1.0)]), clip("b", vec![turning(1, 0.0)])];
    let mut scene = scene(clips);
    let shift = |time: f32| [0.0, time, 0.0];
    scene.clips[1].channels.push(Channel {
        target: Target::Translation(1),
        interpolation: Interpolation::Linear,
        times_s: vec![0.0, 1.0],
        values: [shift(0.0), shift(1.0)].concat(),
    });
    let hold_out = Some(vec!["b".to_owned()]);
    let set = sample(&scene, &Settings { hold_out, ..Settings::default() }).unwrap();
    assert_eq!(set.parametrisation.columns.len(), 1);
    assert_eq!(splits(&set, Split::Novel), 31);
}

/// Proves that a scene without clips, and one clip with a single key, give one training pose.
#[test]
fn still_scenes() {
    let set = sample(&scene(Vec::new()), &Settings::default()).unwrap();
    assert_eq!((set.samples.len(), set.parametrisation.columns.len()), (1, 0));
    assert_eq!((set.clip_names, set.samples[0].split), (vec!["rest".to_owned()], Split::Training));
    let mut key = turning(1, 1.0);
    key.times_s.truncate(1);
    key.values.truncate(4);
    let set = sample(&scene(vec![clip("pose", vec![key])]), &Settings::default()).unwrap();
    assert_eq!((set.samples.len(), set.samples[0].split), (1, Split::Training));
}

/// Proves each refusal of a setting or a scene.
#[test]
fn refusals() {
    let still = scene(Vec::new());
    let sampled = |settings: Settings| sample(&still, &settings).unwrap_err();
    for rate_hz in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let error = sampled(Settings { rate_hz, ..Settings::default() });
        assert!(matches!(error, Error::Rate { .. }), "{error}");
    }
    for near_repeat in [-0.1, f32::NAN] {
        let error = sampled(Settings { near_repeat, ..Settings::default() });
        assert!(matches!(error, Error::NearRepeat { .. }), "{error}");
    }
    let error = sampled(Settings { interpolated_every: 1, ..Settings::default() });
    assert_eq!(error, Error::InterpolatedEvery);
    let clips = Some(vec!["x".to_owned()]);
    let error = sampled(Settings { clips, ..Settings::default() }).to_string();
    assert_eq!(error, "there is no clip named \"x\"; the scene has no clips");
    let mut flat = scene(Vec::new());
    flat.mesh.positions.fill(Vec3::ONE);
    assert_eq!(sample(&flat, &Settings::default()), Err(Error::Size { size_m: 0.0 }));
    let mut long = scene(vec![clip("long", vec![turning(1, 1.0)])]);
    long.clips[0].channels[0].times_s[1] = 1e9;
    let error = sample(&long, &Settings::default()).unwrap_err();
    assert!(matches!(error, Error::TooManyPoses { .. }), "{error}");
}

/// Fewer training poses are told by where the joints are: the ends of the swing come with the
/// middle, parameters and the other splits are those of all poses, and the rest is counted.
#[test]
fn the_poses_that_lie_farthest_apart_are_kept() {
    let scene = scene(vec![clip("c", vec![turning(1, 1.2)])]);
    let all = sample(&scene, &Settings::default()).unwrap();
    let few = sample(&scene, &Settings { most: Some(3), ..Settings::default() }).unwrap();
    let counts = |set: &PoseSet| [Split::WithinClip, Split::Interpolated].map(|s| splits(set, s));
    assert_eq!((splits(&few, Split::Training), counts(&few)), (3, counts(&all)));
    assert_eq!(few.passed_over, splits(&all, Split::Training) - 3);
    assert_eq!(few.parametrisation, all.parametrisation);
    let training = |set: &PoseSet| -> Vec<f32> {
        let of = set.samples.iter().filter(|sample| sample.split == Split::Training);
        of.map(|sample| sample.time_s).collect()
    };
    let (times, every) = (training(&few), training(&all));
    assert_eq!((times[0], times[2]), (every[0], every[every.len() - 1]));
}
