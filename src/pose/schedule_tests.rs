use super::*;
use crate::scene::{Channel, Interpolation, Target};

fn clip(name: &str, times: &[f32]) -> Clip {
    let channel = Channel {
        target: Target::Translation(0),
        interpolation: Interpolation::Linear,
        times_s: times.to_vec(),
        values: vec![0.0; 3 * times.len()],
    };
    let duration_s = times.last().copied().unwrap_or(0.0);
    let channels = if times.is_empty() { Vec::new() } else { vec![channel] };
    Clip { name: name.into(), duration_s, channels }
}

fn scene(clips: Vec<Clip>) -> Scene {
    let (skeleton, mesh) = <_>::default();
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

fn named(names: &[&str]) -> Option<Vec<String>> {
    Some(names.iter().map(|&name| name.to_owned()).collect())
}

/// Proves which instants a clip gives: from its first key, evenly, its last key once and always.
#[test]
fn frames_of_a_clip() {
    let times = |keys: &[f32], rate| times_of(&clip("c", keys), rate, 1000).unwrap();
    assert_eq!(times(&[0.0, 1.0], 4.0), [0.0, 0.25, 0.5, 0.75, 1.0]);
    assert_eq!(times(&[0.0, 1.1], 4.0), [0.0, 0.25, 0.5, 0.75, 1.0, 1.1]);
    assert_eq!(times(&[0.0, 0.999_999], 2.0), [0.0, 0.5, 0.999_999]);
    assert_eq!(times(&[0.5, 1.0], 2.0), [0.5, 1.0]);
    assert_eq!(times(&[0.0, 0.01], 30.0), [0.0, 0.01]);
    assert_eq!(times(&[0.7], 30.0), [0.7]);
    assert_eq!(times(&[], 30.0), [0.0]);
    assert_eq!(times_of(&clip("c", &[0.0, 1e30]), 30.0, 1000), None);
    assert_eq!(times_of(&clip("c", &[0.0, 1.0]), 1e30, 1000), None);
    assert_eq!(times_of(&clip("c", &[0.0, 1.0]), 4.0, 4), None);
}

/// Proves the splits of a clip: held out whole, last quarter, every k-th but never an end.
#[test]
fn splits_of_a_clip() {
    use Split::{Interpolated as I, Novel as N, Training as T, WithinClip as W};
    assert_eq!(splits(3, true, false, 2), [N, N, N]);
    assert_eq!(splits(8, false, true, 0), [T, T, T, T, T, T, W, W]);
    assert_eq!(splits(2, false, true, 10), [T, W]);
    assert_eq!(splits(1, false, true, 10), [T]);
    assert_eq!(splits(7, false, false, 3), [T, T, I, T, T, I, T]);
    assert_eq!(splits(6, false, false, 3), [T, T, I, T, T, T]);
    assert_eq!(splits(8, false, true, 3), [T, T, I, T, T, T, W, W]);
}

/// Proves that the draw takes a quarter, leaves something to train on, prefers clips that move,
/// depends on the seed, and not on the order of the clips.
#[test]
fn drawn_clips() {
    let drawn = |clips: &[Clip], seed| {
        let scene = scene(clips.to_vec());
        let plan = plan(&scene, &Settings { seed, ..Settings::default() }).unwrap();
        let novel = plan.instants.iter().filter(|instant| instant.split == Split::Novel);
        let mut names: Vec<_> = novel.map(|i| plan.clips[i.clip].name.clone()).collect();
        names.sort();
        names.dedup();
        names
    };
    let moving: Vec<Clip> = (0..8).map(|i| clip(&format!("m{i}"), &[0.0, 1.0])).collect();
    let first = drawn(&moving, 0);
    assert_eq!(first.len(), 2);
    assert!((1..9).any(|seed| drawn(&moving, seed) != first));
    let reversed: Vec<Clip> = moving.iter().rev().cloned().collect();
    assert_eq!(drawn(&reversed, 0), first);
    let still: Vec<Clip> = (0..6).map(|i| clip(&format!("s{i}"), &[0.0])).collect();
    for seed in 0..8 {
        assert_eq!(drawn(&moving[..2], seed).len(), 1);
        assert_eq!(drawn(&still[..2], seed).len(), 1);
        let mixed = [&moving[..2], &still[..]].concat();
        assert!(drawn(&mixed, seed)[0].starts_with('m'));
        let mixed = [&moving[..1], &still[..]].concat();
        assert!(drawn(&mixed, seed).iter().all(|name| name.starts_with('s')));
    }
}

/// Proves that clips are chosen and held out by name, in the scene's order, and each refusal.
#[test]
fn named_clips() {
    let scene = scene(["a", "b", "c"].map(|name| clip(name, &[0.0, 1.0])).to_vec());
    let plan = |clips, hold_out| {
        let settings = Settings { clips, hold_out, ..Settings::default() };
        plan(&scene, &settings).map(|plan| {
            let novel = |clip| {
                let own = |i: &&Instant| i.clip == clip;
                plan.instants.iter().find(own).is_some_and(|i| i.split == Split::Novel)
            };
            let names = plan.clips.iter().map(|clip| clip.name.as_str()).enumerate();
            names.map(|(i, name)| (name.to_owned(), novel(i))).collect::<Vec<_>>()
        })
    };
    let pairs = |list: &[(&str, bool)]| -> Vec<(String, bool)> {
        list.iter().map(|&(name, out)| (name.to_owned(), out)).collect()
    };
    assert_eq!(plan(named(&["c", "a", "c"]), named(&[])), Ok(pairs(&[("a", false), ("c", false)])));
    assert_eq!(plan(named(&["c"]), named(&["b"])), Ok(pairs(&[("b", true), ("c", false)])));
    assert_eq!(plan(named(&["c"]), None), Ok(pairs(&[("c", false)])));
    let unknown = plan(named(&["d"]), None).unwrap_err().to_string();
    assert_eq!(unknown, "there is no clip named \"d\"; the scene has a, b, c");
    assert!(plan(None, named(&["x"])).unwrap_err().to_string().contains("\"x\""));
    let nothing = plan(named(&["a"]), named(&["a"])).unwrap_err();
    assert_eq!(nothing, Error::NothingToTrain { held_out: vec!["a".into()] });
    assert!(plan(None, named(&["a", "b", "c"])).is_err());
}
