use std::collections::BTreeSet;
use std::sync::OnceLock;

use glam::{Quat, Vec3};

use super::surface::Surface;
use super::*;
use crate::rig::{Deformed, Pose, RigidFrame, deform};
use crate::scene::{Clip, Limits, Scene, Source, Target, import_sources};

/// Every directed edge once and its opposite once, V − E + F = 2, no vertex unused.
pub(super) fn assert_closed(surface: &Surface) {
    let mut edges = BTreeSet::new();
    for &[a, b, c] in &surface.triangles {
        for edge in [(a, b), (b, c), (c, a)] {
            assert!(edges.insert(edge), "edge {edge:?} occurs twice in one direction");
        }
    }
    assert!(edges.iter().all(|&(a, b)| edges.contains(&(b, a))), "the surface has a border");
    let used: BTreeSet<u32> = surface.triangles.iter().flatten().copied().collect();
    assert_eq!(used.len(), surface.positions.len(), "every vertex is used");
    let euler = used.len() as i64 - edges.len() as i64 / 2 + surface.triangles.len() as i64;
    assert_eq!(euler, 2, "one piece without holes");
}

/// Proves that the figure is one closed surface, oriented outwards, of a person's volume, with
/// vertex normals on the outer side of every face.
#[test]
fn one_closed_manifold() {
    let surface = surface::mesh(grid(), body::distance);
    assert!(surface.positions.len() >= 5000, "{} vertices", surface.positions.len());
    assert_closed(&surface);
    let normals = surface.normals();
    let mut volume = 0.0;
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(|v| surface.positions[v as usize]);
        let face = (b - a).cross(c - a);
        volume += a.dot(b.cross(c)) / 6.0;
        assert!(face.length() > 1e-7, "triangle {triangle:?} is degenerate");
        assert!(triangle.iter().all(|&v| normals[v as usize].dot(face) > 0.0), "{triangle:?}");
    }
    assert!((0.04..0.12).contains(&volume), "{volume} cubic metres");
}

/// Proves that two calls give the same bytes and that the importer takes them without a remark:
/// 19 joints, four clips of one to two seconds, at most four weights that sum to 1.
#[test]
fn imports_without_a_remark() {
    let scene = imported();
    assert_eq!(figure(), scene.sources[0].bytes);
    assert_eq!(scene.notices, Vec::<String>::new());
    assert_eq!(scene.skeleton.nodes.len(), 19 + 1);
    let names: Vec<&str> = scene.clips.iter().map(|clip| clip.name.as_str()).collect();
    assert_eq!(names, ["walk", "wave", "crouch", "jump"]);
    assert!(scene.clips.iter().all(|clip| (1.0..=2.0).contains(&clip.duration_s)));
    let mut carried = BTreeSet::new();
    for vertex in 0..scene.mesh.positions.len() {
        let influences = scene.mesh.influences_of(vertex);
        assert!((1..=4).contains(&influences.len()));
        let sum: f32 = influences.iter().map(|influence| influence.weight).sum();
        assert!((sum - 1.0).abs() < 1e-6, "vertex {vertex}: {sum}");
        carried.insert(influences[0].deformer);
    }
    assert_eq!(carried.len(), 19, "every joint carries vertices");
}

/// Proves that weights are smooth: along no edge does a joint's weight change by more than a third.
#[test]
fn smooth_weights() {
    let mesh = &imported().mesh;
    let weight = |vertex: u32, deformer: u32| {
        let own = mesh.influences_of(vertex as usize).iter();
        own.filter(|influence| influence.deformer == deformer).map(|i| i.weight).sum::<f32>()
    };
    for &[a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            for influence in mesh.influences_of(from as usize) {
                let change = (influence.weight - weight(to, influence.deformer)).abs();
                assert!(change < 0.34, "edge {from} to {to}: {change}");
            }
        }
    }
}

/// Degrees that no joint is ever turned beyond, by the end of its name; the largest are knees,
/// elbows and shoulders.
const RANGES: [(&str, f64); 9] = [
    ("Hips", 40.0),
    ("Spine", 25.0),
    ("Chest", 25.0),
    ("Neck", 25.0),
    ("Head", 25.0),
    ("Shoulder", 25.0),
    ("Arm", 150.0),
    ("Hand", 25.0),
    ("Leg", 130.0),
];

/// Proves that every joint stays in a person's range, that nothing jerks (26 degrees in a
/// thirtieth of a second is a fast arm) and that knees bend one way only.
#[test]
fn plausible_joints() {
    let joints = body::joints();
    for motion in &clips::motions(&joints) {
        for (frame, keys) in motion.keys.windows(2).enumerate() {
            for (joint, rest) in joints.iter().enumerate() {
                let (now, next) = (keys[0].rotations[joint], keys[1].rotations[joint]);
                let angle = 2.0 * now.w.abs().min(1.0).acos().to_degrees();
                let most = RANGES.iter().find(|(end, _)| rest.name.ends_with(end));
                let most = most.map_or(60.0, |(_, most)| *most);
                assert!(angle < most, "{} {frame}: {} at {angle}", motion.name, rest.name);
                let step = 2.0 * now.dot(next).abs().min(1.0).acos().to_degrees();
                assert!(step < 26.0, "{} {frame}: {} by {step}", motion.name, rest.name);
            }
            for side in [0, body::RIGHT] {
                let knee = keys[0].rotations[body::LOWER_LEG + side];
                assert!(knee.x * knee.w.signum() > -0.02, "{} {frame}: knee {knee}", motion.name);
            }
        }
    }
}

/// Proves on the deformed mesh that no foot sinks into the ground, that someone stands on it in all
/// clips but the jump, which leaves it, and that walk and jump travel while the others stay.
#[test]
fn feet_on_the_ground() {
    let scene = imported();
    let rest = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let mut out = Deformed::default();
    for clip in &scene.clips {
        let (mut lowest, mut highest, mut travel) = (f32::MAX, f32::MIN, 0.0);
        for frame in 0..clip.channels[0].times_s.len() {
            let pose = at_key(clip, frame, &rest);
            let globals = scene.skeleton.globals(&pose.local);
            deform(&scene.mesh, &globals, &[], RigidFrame::IDENTITY, &mut out);
            let sole = out.positions.iter().map(|p| p.y).fold(f32::MAX, f32::min);
            lowest = lowest.min(sole);
            highest = highest.max(sole);
            travel = globals[body::HIPS].translation.z;
        }
        assert!(lowest > -0.02, "{}: {lowest} m", clip.name);
        let (leaves, travels) =
            (clip.name == "jump", ["walk", "jump"].contains(&clip.name.as_str()));
        assert_eq!(highest > 0.1, leaves, "{}: {highest} m above ground", clip.name);
        assert!(leaves || highest < 0.02, "{}: {highest} m above ground", clip.name);
        assert_eq!(travel > 0.4, travels, "{}: {travel} m", clip.name);
    }
}

/// Made once: it takes a while in a build without optimisation.
fn imported() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(|| {
        let source = Source { name: "figure.glb".into(), bytes: figure() };
        import_sources(vec![source], &Limits::default()).unwrap()
    })
}

/// The pose of a clip on one of its keys, which all channels share.
fn at_key(clip: &Clip, key: usize, rest: &Pose) -> Pose {
    let mut pose = rest.clone();
    for channel in &clip.channels {
        let width = channel.components();
        let value = &channel.values[key * width..(key + 1) * width];
        match channel.target {
            Target::Translation(node) => pose.local[node].translation = Vec3::from_slice(value),
            Target::Rotation(node) => pose.local[node].rotation = Quat::from_slice(value),
            _ => panic!("the figure has rotations and translations only"),
        }
    }
    pose
}
