use std::sync::atomic::AtomicBool;

use super::*;
use crate::pipeline::recipe::SignalName;
use crate::pipeline::{Job, Range, bake, candidates};
use crate::scene::{self, Limits, Source, figure};

/// Clips are never cut where there are two; a single one loses its end; every pose of several
/// clips is left out once. Models of what lies between poses lose single ones.
#[test]
fn whole_clips_are_left_out() {
    let (groups, _) = folds(&[4, 4, 1, 1, 9, 2], false);
    let mut all: Vec<usize> = groups.iter().flatten().copied().collect();
    all.sort_unstable();
    assert_eq!((groups.len(), all), (3, (0..6).collect()));
    assert!(groups.iter().any(|g| g.contains(&0) && g.contains(&1)));
    assert_eq!(folds(&[3; 8], false).0, [vec![6, 7]]);
    let (groups, _) = folds(&[3; 20], true);
    assert_eq!(groups[0], [1, 7, 13, 19]);
    assert!(groups.iter().flatten().all(|pose| pose % 2 == 1));
}

/// Two clips of the bundled character, with few rays.
fn dataset(folder: &std::path::Path) -> Dataset {
    let source = Source { name: "figure.glb".into(), bytes: figure::figure() };
    let scene = scene::import_sources(vec![source], &Limits::default()).unwrap();
    let mut recipe = Recipe::default();
    recipe.poses.clips = Some(vec!["wave".into(), "crouch".into()]);
    recipe.poses.hold_out = Some(Vec::new());
    (recipe.poses.rate_hz, recipe.poses.interpolated_every) = (1.0, 0);
    (recipe.bake.signal, recipe.bake.rays) = (SignalName::Ao, 4);
    let job = Job::new(scene, None, recipe).unwrap();
    let cancelled = AtomicBool::new(false);
    let path = folder.join("d.zarr");
    bake(&job, &path, &Watch { report: &|_| {}, cancelled: &cancelled }).unwrap();
    Dataset::open(&path).unwrap()
}

/// Proves the whole search on a small bake: one candidate of each kind is tried; a loose target
/// takes the simplest point of all, the smallest; one that nothing reaches takes the least error,
/// says that it is missed and what would help; and the model that comes out is the one named.
#[test]
fn a_search_ends_with_the_simplest_or_the_best() {
    const KINDS: [&str; 6] = [
        "mean",
        "linear, handles",
        "pca-linear 2, 8",
        "multilinear 3, 5",
        "clustered-linear 0.6",
        "occluder 40",
    ];
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let base = crate::pipeline::recipe_of(&dataset).unwrap();
    let mut some = candidates(&base, dataset.header().layout.points, Range::Quick);
    some.retain(|candidate| KINDS.contains(&candidate.name.as_str()));
    assert_eq!(some.len(), KINDS.len());
    let cancelled = AtomicBool::new(false);
    let watch = Watch { report: &|_| {}, cancelled: &cancelled };
    let found = |some: &[CandidateRecipe], max_error| {
        let target = Target { max_error: Some(max_error), ..Target::default() };
        search(&dataset, some, &target, &watch).unwrap()
    };
    let error = |point: &Point| point.errors[VALIDATION].rms;

    let loose = found(&some, 10.0);
    let chosen = &loose.points[loose.chosen];
    assert!(loose.met && loose.points.iter().all(|point| chosen.bytes <= point.bytes));
    assert_eq!(chosen.precision, loose.precision.name());
    let blob = loose.fitted.model.to_bytes(loose.precision).unwrap();
    // The header tells of other poses than in validation.
    assert!((blob.len() as u64).abs_diff(chosen.bytes) < 1000, "{} {}", blob.len(), chosen.bytes);

    let strict = found(&some[..3], 1e-7);
    let chosen = &strict.points[strict.chosen];
    assert!(!strict.met && strict.points.iter().all(|point| error(chosen) <= error(point)));
    // Candidates without hope are dropped on the way; the others are there in every precision.
    let (count, rest) = (strict.points.len(), strict.estimates.len());
    assert!((3..=3 * 3).contains(&count) && count.is_multiple_of(3) && rest == 0, "{count} {rest}");
    let Shares { noise, bias, coverage } = strict.shares;
    assert!(noise + bias + coverage > 0.0 && strict.search_s > 0.0);
}

/// Proves that the mesh at rest counts where it is asked for: a candidate that looks at the mesh is estimated with
/// the bytes that the model of choice then has more for it, and one that does not is as small as ever.
#[test]
fn the_rest_mesh_counts_in_a_choice() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let mut base = crate::pipeline::recipe_of(&dataset).unwrap();
    let mut tried = |include_rest| -> (Vec<u64>, Searched) {
        base.fit.include_rest = include_rest;
        let mut some = candidates(&base, dataset.header().layout.points, Range::Quick);
        some.retain(|candidate| ["mean", "occluder 40"].contains(&candidate.name.as_str()));
        let bench = Workbench::new(&dataset, &some).unwrap();
        let without = bench.without(&[0]);
        let bytes = some.iter().map(|c| without.try_out(c).unwrap().points[0].bytes).collect();
        let cancelled = AtomicBool::new(false);
        let watch = Watch { report: &|_| {}, cancelled: &cancelled };
        let target = Target { max_bytes: Some(1 << 30), ..Target::default() };
        (bytes, search(&dataset, &some[1..], &target, &watch).unwrap())
    };
    let ((plain, without), (carrying, with)) = (tried(false), tried(true));
    let rest = with.fitted.model.sizes(with.precision).rest;
    assert!(rest > 0 && without.fitted.model.rest().is_none());
    // The recipe in the header says so, too.
    let added = carrying[1] - plain[1];
    assert!(carrying[0] == plain[0] && (rest..rest + 100).contains(&added), "{added} of {rest}");
    let more = with.points[with.chosen].bytes - without.points[without.chosen].bytes;
    assert!((rest..rest + 2000).contains(&more), "{more} of {rest}");
}

/// Where error alone counts, candidates that are behind on the clips so far are dropped, the fewer clips the
/// farther behind; what costs too much is no rival, and a target error needs them all.
#[test]
fn those_behind_are_dropped() {
    let candidates = [("a", 100), ("b", 100), ("c", 100), ("large", 900)].map(|(name, bytes)| {
        let recipe = Recipe::default();
        (CandidateRecipe { name: name.into(), recipe, poses: None }, bytes)
    });
    let squares = [1.0, 1.05, 1.2, 0.5];
    let left_after = |groups: usize, target: &Target| {
        let mut entries = Vec::new();
        for ((candidate, bytes), square) in candidates.iter().zip(squares) {
            let fit_s = if *bytes == 900 { 5.0 } else { 1.0 };
            let points = vec![Point { bytes: *bytes, fit_s, ..Point::default() }];
            entries.push(Entry {
                candidate,
                points,
                squares: vec![vec![square]; groups],
                held: Vec::new(),
            });
        }
        drop_behind(&mut entries, target);
        entries.iter().map(|entry| entry.candidate.name.clone()).collect::<Vec<_>>().join(" ")
    };
    let left = |target: &Target| left_after(2, target);
    let bytes = |most| Target { max_bytes: Some(most), ..Target::default() };
    assert_eq!(left_after(1, &bytes(500)), "a b c");
    assert_eq!(left(&Target { max_fit_s: Some(2.0), ..Target::default() }), "a b");
    assert_eq!(left(&bytes(500)), "a b");
    assert_eq!(left(&bytes(1000)), "large");
    assert_eq!(left(&bytes(10)), "a b c large");
    assert_eq!(left(&Target { max_error: Some(0.1), ..bytes(500) }), "a b c large");
}

/// A candidate far off the front of bytes and error is dropped, unless what makes it look bad takes longer than
/// the target allows.
#[test]
fn the_hopeless_are_dropped_within_the_time_allowed() {
    let candidates = ["slow", "quick"].map(|name| CandidateRecipe {
        name: name.into(),
        recipe: Recipe::default(),
        poses: None,
    });
    let left = |target: &Target| {
        let entry = |(candidate, (evaluate_us, square))| Entry {
            candidate,
            points: vec![Point { bytes: 100, evaluate_us, ..Point::default() }],
            squares: vec![vec![square]],
            held: Vec::new(),
        };
        let costs = [(50.0, 0.1), (5.0, 1.0)];
        let mut entries: Vec<Entry<'_>> = candidates.iter().zip(costs).map(entry).collect();
        drop_hopeless(&mut entries, target);
        entries.iter().map(|entry| entry.candidate.name.clone()).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(left(&Target::default()), "slow");
    assert_eq!(left(&Target { max_us: Some(10.0), ..Target::default() }), "slow quick");
}

/// What a model of all points takes is foretold from some of them to 3 % and a header's difference, in every
/// precision, with spheres that are as many for few points as for all.
#[test]
fn bytes_are_foretold_from_some_of_the_points() {
    const KINDS: [&str; 4] =
        ["linear, handles", "clustered-linear 0.6", "occluder 40", "occluder 200"];
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let base = crate::pipeline::recipe_of(&dataset).unwrap();
    let points = dataset.header().layout.points;
    let mut some = candidates(&base, points, Range::Quick);
    some.retain(|candidate| KINDS.contains(&candidate.name.as_str()));
    assert_eq!(some.len(), KINDS.len());
    let bench = Workbench::new(&dataset, &some).unwrap();
    assert!(bench.is_sample(), "all of {points} points are looked at");
    let without = bench.without(&[0]);
    for candidate in &some {
        let model = fit(&dataset, &candidate.recipe).unwrap().model;
        for point in without.try_out(candidate).unwrap().points {
            let precision = Precision::from_name(&point.precision).unwrap();
            let own = model.to_bytes(precision).unwrap().len() as u64;
            let apart = own.abs_diff(point.bytes);
            assert!(apart < own * 3 / 100 + 1000, "{}: {own}, {}", point.name, point.bytes);
        }
    }
}
