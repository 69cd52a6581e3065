use std::sync::atomic::AtomicBool;

use super::*;
use crate::pipeline::recipe::{FamilyName, FitRecipe, SignalName};
use crate::pipeline::{Job, bake, fit, recipe_of, search};
use crate::scene::{self, Limits, Source, figure};

/// The bundled character's wave, in transfer of order 3.
fn dataset(folder: &std::path::Path) -> Dataset {
    let source = Source { name: "figure.glb".into(), bytes: figure::figure() };
    let scene = scene::import_sources(vec![source], &Limits::default()).unwrap();
    let mut recipe = Recipe::default();
    recipe.poses.clips = Some(vec!["wave".into()]);
    recipe.poses.hold_out = Some(Vec::new());
    (recipe.poses.rate_hz, recipe.poses.interpolated_every) = (4.0, 0);
    (recipe.bake.signal, recipe.bake.order, recipe.bake.rays) = (SignalName::Transfer, 3, 4);
    let job = Job::new(scene, None, recipe).unwrap();
    let cancelled = AtomicBool::new(false);
    let path = folder.join("d.zarr");
    bake(&job, &path, &Watch { report: &|_| {}, cancelled: &cancelled }).unwrap();
    Dataset::open(&path).unwrap()
}

/// With room to err, a model does without almost everything: one node's parameters and few bands
/// stay, its file is smaller, and it is the recipe's own fit, whose rig has those columns only. A
/// parameter that is not there is named.
#[test]
fn what_is_not_needed_goes() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let mut recipe = recipe_of(&dataset).unwrap();
    recipe.fit = FitRecipe { family: FamilyName::Linear, ..FitRecipe::default() };
    let all = [CandidateRecipe { name: "linear".to_owned(), recipe: recipe.clone(), poses: None }];
    let cancelled = AtomicBool::new(false);
    let watch = Watch { report: &|_| {}, cancelled: &cancelled };
    let target = Target { max_error: Some(10.0), ..Target::default() };
    let mut found = search(&dataset, &all, &target, &watch).unwrap();
    let trimmed = trim(&dataset, &found, &target, &watch).unwrap().expect("something goes");
    assert!(trimmed.bytes[1] < trimmed.bytes[0] && trimmed.bands == Some(1), "{trimmed:?}");
    assert!(trimmed.story().contains("pose parameters that hardly matter, and all bands"));

    recipe.fit.without.clone_from(&trimmed.without);
    recipe.fit.bands = trimmed.bands;
    let whole = std::mem::replace(&mut found.fitted, fit(&dataset, &recipe).unwrap()).model;
    let model = &found.fitted.model;
    let told = crate::pipeline::figures::longest_errors(&dataset).len() as u64;
    let bytes = model.to_bytes(found.precision).unwrap().len() as u64 + told;
    let header = model.header().clone();
    assert_eq!((header.order, header.width()), (1, 1));
    let left = groups(&header.rig.columns).len();
    assert_eq!((left, whole.header().order), (1, 3));
    assert!(trimmed.without.iter().all(|name| header.rig.dropped.contains(name)));

    // What only the whole was too large for is met by what is left of it.
    for (most, met) in [(bytes, true), (bytes - 1, false)] {
        let target = Target { max_bytes: Some(most), ..target };
        found.reconsider(&dataset, &target).unwrap();
        assert_eq!((found.met, found.points[found.chosen].bytes), (met, bytes));
    }

    recipe.fit.without = vec!["nobody".to_owned()];
    let told = fit(&dataset, &recipe).expect_err("unknown").to_string();
    assert!(told.contains("`nobody`") && told.contains("fit.without"), "{told}");
}

/// Proves that spheres alone keep all parameters: they tell how far a pose is from those trained on.
#[test]
fn spheres_keep_what_tells_the_distance() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let mut recipe = recipe_of(&dataset).unwrap();
    recipe.fit =
        FitRecipe { family: FamilyName::Occluder, spheres: Some(20), ..FitRecipe::default() };
    let all = [CandidateRecipe { name: "spheres".to_owned(), recipe, poses: None }];
    let cancelled = AtomicBool::new(false);
    let watch = Watch { report: &|_| {}, cancelled: &cancelled };
    let target = Target { max_error: Some(10.0), ..Target::default() };
    let found = search(&dataset, &all, &target, &watch).unwrap();
    let trimmed = trim(&dataset, &found, &target, &watch).unwrap();
    assert!(trimmed.is_none_or(|trimmed| trimmed.without.is_empty()));
}
