use std::sync::atomic::AtomicBool;

use super::*;
use crate::pipeline::recipe::SignalName;
use crate::pipeline::{Job, Range, bake, candidates};
use crate::scene::{self, Limits, Source, figure};

/// Clips are never cut where there are two; a single one loses one part after another; every pose of several
/// clips is left out once. Of one pose nothing is. Models of what lies between poses lose single ones.
#[test]
fn whole_clips_are_left_out() {
    let (groups, _) = folds(&[4, 4, 1, 1, 9, 2], false);
    let mut all: Vec<usize> = groups.iter().flatten().copied().collect();
    all.sort_unstable();
    assert_eq!((groups.len(), all), (3, (0..6).collect()));
    assert!(groups.iter().any(|g| g.contains(&0) && g.contains(&1)));
    assert_eq!(folds(&[3; 8], false).0, [vec![0, 1], vec![2, 3, 4], vec![5, 6, 7]]);
    assert_eq!(folds(&[3; 2], true).0, [[0], [1]]);
    assert_eq!(folds(&[3], false).0, [[0; 0]]);
    let (groups, _) = folds(&[3; 20], true);
    assert_eq!(groups[0], [1, 7, 13, 19]);
    assert!(groups.iter().flatten().all(|pose| pose % 2 == 1));
}

/// Two clips of the bundled character, with few rays.
fn dataset(folder: &std::path::Path) -> Dataset {
    let mut recipe = Recipe::default();
    recipe.poses.clips = Some(vec!["wave".into(), "crouch".into()]);
    recipe.poses.rate_hz = 1.0;
    baked(folder, ("figure.glb", figure::figure()), recipe)
}

fn baked(folder: &std::path::Path, (name, bytes): (&str, Vec<u8>), mut recipe: Recipe) -> Dataset {
    let source = Source { name: name.into(), bytes };
    let scene = scene::import_sources(vec![source], &Limits::default()).unwrap();
    recipe.poses.hold_out = Some(Vec::new());
    recipe.poses.interpolated_every = 0;
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
    // Far from the target nothing is in doubt: one candidate is left, in every precision.
    assert!(strict.points.len() == 3 && strict.estimates.iter().all(|p| error(chosen) <= error(p)));
    let Shares { noise, bias, coverage } = strict.shares;
    assert!(noise + bias + coverage > 0.0 && strict.search_s > 0.0);
}

/// Proves that errors which are estimated from some of the points are corrected by what one group of clips says at
/// all points: where all points were tried they stay as they are, elsewhere that group's are the exact ones.
#[test]
fn doubtful_errors_are_corrected() {
    let folder = tempfile::tempdir().unwrap();
    let cloth = ("cloth.npz", scene::tests::sequences::waving_sheet(8, 12));
    let mut recipe = Recipe::default();
    recipe.poses.rate_hz = 10.0;
    let whole = baked(&folder.path().join("cloth"), cloth, recipe);
    let cancelled = AtomicBool::new(false);
    let watch = Watch { report: &|_| {}, cancelled: &cancelled };
    for dataset in [whole, dataset(folder.path())] {
        let base = crate::pipeline::recipe_of(&dataset).unwrap();
        let mut some = candidates(&base, dataset.header().layout.points, Range::Quick);
        some.retain(|candidate| candidate.name == "linear, handles");
        let bench = Workbench::new(&dataset, &some).unwrap();
        let (folds, _) = folds(bench.clips(), false);
        let mut count = Count::new(Instant::now(), 9);
        let mut entry = entries(&some).remove(0);
        for fold in &folds {
            entry.take(bench.without(fold).try_out(&some[0]), &watch, &mut count).unwrap();
        }
        let before = entry.squares.clone();
        let validation = Validation::new(&dataset).unwrap();
        assert!(entry.correct(&validation, &folds, &watch, &mut count).unwrap());
        let worst =
            (0..folds.len()).max_by(|&a, &b| before[a][0].total_cmp(&before[b][0])).unwrap();
        let exact = validation.try_out(&some[0], &folds[worst], None).unwrap();
        assert_eq!(entry.points[0].bytes, exact.points[0].bytes);
        let off = entry.squares[worst][0] / exact.squares[0] - 1.0;
        assert!(off.abs() < 1e-12, "{off}");
        let is_whole = bench.base.points == dataset.header().layout.points;
        let ratio = |fold: usize| entry.squares[fold][0] / before[fold][0];
        assert!((0..folds.len()).all(|fold| (ratio(fold) / ratio(0) - 1.0).abs() < 1e-12));
        assert!(!is_whole || (ratio(0) - 1.0).abs() < 1e-3, "{}", ratio(0));
    }
}

/// Proves that cloth is chosen for, with vertices that share points and more or fewer points than are tried, and
/// that of a single pose the mean is taken, which is off by the noise and by nothing else.
#[test]
fn cloth_and_single_poses_are_chosen_for() {
    let folder = tempfile::tempdir().unwrap();
    let cancelled = AtomicBool::new(false);
    let watch = Watch { report: &|_| {}, cancelled: &cancelled };
    for (side, frames) in [(8, 24), (37, 24), (8, 1)] {
        let cloth = ("cloth.npz", scene::tests::sequences::waving_sheet(side, frames));
        let mut recipe = Recipe::default();
        recipe.poses.rate_hz = 10.0;
        let dataset = baked(&folder.path().join(format!("{side} {frames}")), cloth, recipe);
        let layout = dataset.header().layout;
        assert_eq!((layout.points, layout.vertices), (side * side, 2 * side * side));
        let base = crate::pipeline::recipe_of(&dataset).unwrap();
        let mut some = candidates(&base, layout.points, Range::Quick);
        some.retain(|c| ["mean", "pca-linear 2, 8", "occluder 40"].contains(&c.name.as_str()));
        let target = Target { max_bytes: Some(1 << 20), ..Target::default() };
        let found = search(&dataset, &some, &target, &watch).unwrap();
        let point = &found.points[found.chosen];
        let rms = point.errors[VALIDATION].rms;
        assert!(found.met && rms > 0.0, "{}: {rms}", point.name);
        if frames == 1 {
            let noise = dataset.training().unwrap().noise_variance().sqrt();
            assert!(point.name.starts_with("mean") && (rms - noise).abs() < 1e-12, "{rms} {noise}");
            continue;
        }
        let bench = Workbench::new(&dataset, &some).unwrap();
        let without = bench.without(&[0]);
        for candidate in &some {
            let tried = without.try_out(candidate);
            assert!(tried.is_ok(), "{}: {:?}", candidate.name, tried.err());
        }
    }
}

/// Proves that a model is never larger than was asked for, the errors told in its file with it, and that where
/// the first choice comes out too large the next is taken.
#[test]
fn files_are_within_the_bytes_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let base = crate::pipeline::recipe_of(&dataset).unwrap();
    let mut some = candidates(&base, dataset.header().layout.points, Range::Quick);
    some.retain(|c| ["mean", "linear, handles"].contains(&c.name.as_str()));
    let cancelled = AtomicBool::new(false);
    let watch = Watch { report: &|_| {}, cancelled: &cancelled };
    let found = |most: u64| {
        let target = Target { max_bytes: Some(most), ..Target::default() };
        search(&dataset, &some, &target, &watch).unwrap()
    };
    let size = |found: &Searched| found.points[found.chosen].bytes;
    let least = size(&found(1));
    assert!(!found(least - 1).met && found(least).met);
    for most in [least + 500, 2 * least, 4 * least] {
        let found = found(most);
        let blob = found.fitted.model.to_bytes(found.precision).unwrap().len() as u64;
        assert!(found.met && size(&found) <= most && blob < size(&found));
        assert!(size(&found) - blob < 900, "{}", size(&found) - blob);
    }
    // Each point costs more than was thought, but for the smallest.
    let mut recipes = entries(&some);
    for (i, entry) in recipes.iter_mut().enumerate() {
        let point = |precision: &Precision| Point {
            name: precision.name().into(),
            precision: precision.name().into(),
            bytes: 10,
            ..Point::default()
        };
        entry.points = Precision::ALL.iter().map(point).collect();
        entry.squares = vec![vec![1.0 + 100.0 * (1 - i) as f64; entry.points.len()]];
    }
    let target = Target { max_bytes: Some(least), ..Target::default() };
    let found = conclude((&dataset, &target, Instant::now()), &mut recipes).unwrap().unwrap();
    assert!(found.met && found.recipe.fit.family == FamilyName::Mean && size(&found) == least);
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

/// Whose names are left of candidates with these bytes, microseconds and mean square errors after one group
/// of three.
fn left(all: &[(&str, u64, f64, f64)], target: &Target) -> String {
    let candidate =
        |name: &str| CandidateRecipe { name: name.into(), recipe: Recipe::default(), poses: None };
    let candidates: Vec<CandidateRecipe> = all.iter().map(|one| candidate(one.0)).collect();
    let entry = |(candidate, &(_, bytes, evaluate_us, square))| Entry {
        candidate,
        points: vec![Point { bytes, evaluate_us, ..Point::default() }],
        squares: vec![vec![square]],
        held: Vec::new(),
    };
    let mut entries: Vec<Entry<'_>> = candidates.iter().zip(all).map(entry).collect();
    drop_hopeless(&mut entries, target, 3);
    entries.iter().map(|entry| entry.candidate.name.clone()).collect::<Vec<_>>().join(" ")
}

/// A candidate far behind the best that the target allows is dropped, and so is what it does not allow, with
/// some leeway for estimates; where it allows none, all stay.
#[test]
fn those_behind_are_dropped() {
    let all = [
        ("small", 90, 1.0, 2.0),
        ("a", 100, 1.0, 1.0),
        ("b", 500, 1.0, 1.05),
        ("c", 100, 1.0, 2.5),
        ("large", 900, 1.0, 0.3),
    ];
    let bytes = |most| Target { max_bytes: Some(most), ..Target::default() };
    assert_eq!(left(&all, &bytes(600)), "a b");
    assert_eq!(left(&all, &bytes(490)), "a b");
    assert_eq!(left(&all, &bytes(400)), "a");
    assert_eq!(left(&all, &bytes(1000)), "large");
    assert_eq!(left(&all, &bytes(10)), "small a b large", "but what a smaller one beats by far");
}

/// An error keeps those that may still meet it, the groups to come without any, and the best where none may.
#[test]
fn those_that_may_still_meet_an_error_are_kept() {
    let all = [("tiny", 10, 1.0, 7.0), ("small", 50, 1.0, 2.9), ("best", 90, 1.0, 0.5)];
    let error = |most| Target { max_error: Some(most), ..Target::default() };
    assert_eq!(left(&all, &error(2.0)), "tiny small best");
    assert_eq!(left(&all, &error(1.0)), "small best");
    assert_eq!(left(&all, &error(0.1)), "best");
    assert_eq!(left(&all, &Target { max_bytes: Some(60), ..error(0.1) }), "small");
}

/// A candidate far off the front of bytes and error is dropped, unless what makes it look bad takes longer than
/// the target allows.
#[test]
fn the_hopeless_are_dropped_within_the_time_allowed() {
    let all = [("slow", 100, 50.0, 0.1), ("rather", 100, 12.0, 0.1), ("quick", 100, 5.0, 1.0)];
    assert_eq!(left(&all, &Target::default()), "slow rather");
    let of_time = Target { max_us: Some(10.0), ..Target::default() };
    assert_eq!(left(&all[..2], &of_time), "rather", "times are guessed");
    assert_eq!(left(&[all[0], all[2]], &of_time), "quick");
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
    assert!(points > bench.base.points, "all of {points} points are looked at");
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
