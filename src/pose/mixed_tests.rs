use super::*;
use crate::pose::{Error, Settings, sample};
use crate::rig::carried_weight;
use crate::scene::{self, Limits, Scene, Source, figure};

fn figure() -> Scene {
    let source = Source { name: "figure.glb".into(), bytes: figure::figure() };
    scene::import_sources(vec![source], &Limits::default()).unwrap()
}

/// Arms, legs and head are limbs of their own, their joints go along; the trunk is the root's.
#[test]
fn limbs_hang_from_branches() {
    let scene = figure();
    let limbs = limbs(&scene.skeleton, &carried_weight(&scene.skeleton, &scene.mesh));
    let of = |name: &str| limbs[scene.skeleton.find(name).expect(name)];
    let legs = ["LeftUpperLeg", "RightUpperLeg"].map(of);
    assert!(legs[0] != legs[1] && !legs.contains(&of("Spine")));
    assert_eq!(of("LeftLowerLeg"), legs[0]);
    assert_eq!(of("LeftLowerArm"), of("LeftUpperArm"));
    assert_ne!(of("LeftUpperArm"), of("RightUpperArm"));
    assert_eq!(limbs[0], 0);
}

/// Every limb of a mixed pose is that of a training frame of its clip, the trunk's frame is not everybody's,
/// and what is held out lends nothing; mixes are dated after the clip, too far apart to be motion; the same
/// seed mixes the same, and other poses stay as they were.
#[test]
fn limbs_are_of_the_clip() {
    let scene = figure();
    let settings = Settings { rate_hz: 4.0, near_repeat: 0.0, mixed: 30, ..Settings::default() };
    let mixed = sample(&scene, &settings).unwrap();
    let plain = sample(&scene, &Settings { mixed: 0, ..settings.clone() }).unwrap();
    assert_eq!(mixed, sample(&scene, &settings).unwrap());
    let others: Vec<_> = mixed.samples.iter().filter(|sample| !sample.mixed).cloned().collect();
    assert_eq!(others, plain.samples);
    let limbs = limbs(&scene.skeleton, &carried_weight(&scene.skeleton, &scene.mesh));
    let mut frames_of_one = Vec::new();
    for sample in mixed.samples.iter().filter(|sample| sample.mixed) {
        assert_eq!(sample.split, Split::Training);
        let is_own =
            |s: &&super::super::Sample| s.clip == sample.clip && s.split == Split::Training;
        let lenders: Vec<_> = plain.samples.iter().filter(is_own).collect();
        let mut used = Vec::new();
        for limb in 0..=*limbs.iter().max().unwrap() {
            let nodes: Vec<usize> = (0..limbs.len()).filter(|&node| limbs[node] == limb).collect();
            let lends = |s: &super::super::Sample| {
                nodes.iter().all(|&node| s.pose.local[node] == sample.pose.local[node])
            };
            used.push(lenders.iter().position(|lender| lends(lender)).expect("no frame has it"));
        }
        used.sort_unstable();
        used.dedup();
        frames_of_one.push(used.len());
        let last = plain.samples.iter().filter(|s| s.clip == sample.clip).map(|s| s.time_s);
        assert!(sample.time_s > last.fold(0.0, f32::max) + 1.0);
    }
    assert_eq!(frames_of_one.len(), 30);
    assert!(frames_of_one.iter().filter(|&&frames| frames > 1).count() > 25);
}

/// A sequence of meshes has no limbs, and poses without bound are refused with both numbers.
#[test]
fn what_cannot_be_mixed() {
    let mut scene = figure();
    let many = Settings { mixed: 300_000, ..Settings::default() };
    let told = sample(&scene, &many).unwrap_err().to_string();
    assert!(told.contains("300000") && told.contains("200000"), "{told}");
    scene.is_sequence = true;
    let some = Settings { mixed: 3, ..Settings::default() };
    assert_eq!(sample(&scene, &some).unwrap_err(), Error::MixedSequence);
}
