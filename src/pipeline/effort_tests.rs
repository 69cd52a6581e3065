use std::sync::atomic::AtomicBool;

use super::*;
use crate::pipeline::recipe::FamilyName;
use crate::pipeline::{Checked, Job, bake_reference};
use crate::scene::{self, Limits, Source, figure};

fn quiet(stop: &AtomicBool) -> Watch<'_> {
    Watch { report: &|_| {}, cancelled: stop }
}

/// The bundled character, few rays, few poses.
fn baked(folder: &Path) -> Dataset {
    let source = Source { name: "figure.glb".into(), bytes: figure::figure() };
    let scene = scene::import_sources(vec![source], &Limits::default()).unwrap();
    let mut recipe = Recipe::default();
    (recipe.bake.rays, recipe.bake.order) = (16, 2);
    (recipe.poses.rate_hz, recipe.poses.interpolated_every) = (3.0, 0);
    (recipe.fit.family, recipe.target.reference_poses) = (FamilyName::Linear, 2);
    recipe.target.reference_factor = 8;
    let path = folder.join("whole.zarr");
    let stop = AtomicBool::new(false);
    let job = Job::new(scene, None, recipe).unwrap();
    bake(&job, &path, &quiet(&stop)).unwrap();
    let dataset = Dataset::open(&path).unwrap();
    let checked = Checked::new(&job.recipe).unwrap();
    bake_reference(&dataset, checked.reference, &quiet(&stop)).unwrap();
    dataset
}

/// Every effort is a point of its own with the rays that it takes; the whole one has the error that the
/// trade-off measures for the same model, and leaving bands out costs error; nothing of the bakes of fewer
/// rays is left behind, and nothing else goes.
#[test]
fn efforts_are_measured() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = baked(folder.path());
    let recipe = crate::pipeline::recipe_of(&dataset).unwrap();
    let stop = AtomicBool::new(false);
    // A folder of somebody else's, under the name that the bakes of fewer rays once had.
    let beside = folder.path().join("out");
    let own = beside.join("fewer-rays/4.zarr/kept.txt");
    std::fs::create_dir_all(own.parent().unwrap()).unwrap();
    std::fs::write(&own, b"mine").unwrap();
    let efforts = Efforts { rays: vec![4, 4], poses: vec![3], orders: vec![1] };
    let found = effort(&dataset, &recipe, &efforts, &beside, &quiet(&stop)).unwrap();
    assert!(found.points.len() == 8 && std::fs::read(&own).unwrap() == b"mine");
    let left: Vec<_> =
        std::fs::read_dir(&beside).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["fewer-rays"]);
    let ended = AtomicBool::new(true);
    let stopped = effort(&dataset, &recipe, &efforts, &beside, &quiet(&ended)).unwrap_err();
    assert!(matches!(stopped, Error::Stopped { .. }), "{stopped}");
    assert_eq!(std::fs::read_dir(&beside).unwrap().count(), 1, "a stopped bake stayed");
    let of = |rays, few, order| {
        let is_few = |poses| (poses == 3) == few;
        let mut points = found.points.iter();
        let is = |p: &&EffortPoint| p.rays_per_point == rays && is_few(p.poses) && p.order == order;
        points.find(is).unwrap().clone()
    };
    let whole = of(16, false, 2);
    assert_eq!(whole.rays, 16 * (whole.poses * dataset.header().layout.points) as u64);
    assert_eq!(of(4, false, 2).rays * 4, whole.rays);
    let error = |point: &EffortPoint| found.error(point);
    assert!(error(&of(16, false, 1)) > error(&whole) && of(16, false, 1).bytes < whole.bytes);
    assert!(error(&of(4, false, 2)) != error(&whole), "other rays, other noise");
    let candidates = [crate::pipeline::CandidateRecipe {
        name: "the same".into(),
        recipe: recipe.clone(),
        poses: None,
    }];
    let beside = crate::pipeline::tradeoff(&dataset, &candidates, &quiet(&stop)).unwrap();
    let same = beside.points.iter().find(|p| p.name.ends_with("f32")).unwrap();
    assert_eq!(same.errors[&found.split].rms, error(&whole));
    assert!(found.table().contains("million rays") && found.plot().starts_with("<svg"));
    assert!(beside.page(Some(&found)).contains("Rays, poses and order"));
}

/// More than there is, or nothing, is refused with what there is; so are fewer rays than a target noise.
#[test]
fn impossible_efforts_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = baked(folder.path());
    let recipe = crate::pipeline::recipe_of(&dataset).unwrap();
    let stop = AtomicBool::new(false);
    let told = |efforts: &Efforts| {
        let found = effort(&dataset, &recipe, efforts, folder.path(), &quiet(&stop));
        found.unwrap_err().to_string()
    };
    let rays = told(&Efforts { rays: vec![17], ..Efforts::default() });
    assert_eq!(
        rays,
        "17 rays per point cannot be tried: the data set has 16, and less is tried from 1 up to that"
    );
    let none = Efforts { poses: vec![0], ..Efforts::default() };
    assert!(told(&none).starts_with("0 training poses"));
    assert!(told(&Efforts { orders: vec![3], ..Efforts::default() }).starts_with("3 bands"));
    let mut noisy = recipe.clone();
    noisy.bake.noise = Some(0.1);
    let told = has_stated_rays(&noisy).unwrap_err().to_string();
    assert!(told.contains("bake.noise") && told.contains("states them in one number"), "{told}");
}
