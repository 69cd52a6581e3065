use std::sync::atomic::AtomicBool;

use serde_json::json;

use super::*;
use crate::dataset::Dataset;
use crate::model::Model;
use crate::pipeline::recipe::subsurface::SubsurfaceRecipe;
use crate::pipeline::recipe::{FamilyName, PrecisionName};
use crate::pipeline::{Watch, bake, bake_reference, examine, fit, measure, run};
use crate::scene::Source;

/// Two walls that meet at a right angle, one of this colour.
fn corner(colour: [f32; 3]) -> Vec<Source> {
    let positions: Vec<f32> = [
        [0., 0., 0.],
        [1., 0., 0.],
        [1., 0., 1.],
        [0., 0., 1.],
        [0., 0., 0.],
        [0., 0., 1.],
        [0., 1., 1.],
        [0., 1., 0.],
    ]
    .concat();
    let indices: [u32; 6] = [0, 2, 1, 0, 3, 2];
    let bytes: Vec<u8> = positions
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .chain(indices.iter().flat_map(|value| value.to_le_bytes()))
        .collect();
    let wall = |view: usize, material: usize| json!({"primitives": [{"attributes": {"POSITION": view}, "indices": 2, "material": material}]});
    let [r, g, b] = colour;
    let factor = |c: [f32; 4]| json!({"pbrMetallicRoughness": {"baseColorFactor": c}});
    let view =
        |at: usize, length: usize| json!({"buffer": 0, "byteOffset": at, "byteLength": length});
    let points = |view: usize| json!({"bufferView": view, "componentType": 5126, "count": 4, "type": "VEC3"});
    let document = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "data.bin", "byteLength": bytes.len()}],
        "bufferViews": [view(0, 48), view(48, 48), view(96, 24)],
        "accessors": [
            points(0), points(1),
            {"bufferView": 2, "componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        "materials": [factor([0.5, 0.5, 0.5, 1.0]), factor([r, g, b, 1.0])],
        "meshes": [wall(0, 0), wall(1, 1)],
        "nodes": [{"mesh": 0, "name": "floor"}, {"mesh": 1, "name": "wall"}],
        "scenes": [{"nodes": [0, 1]}],
    });
    let text = Source { name: "corner.gltf".into(), bytes: document.to_string().into_bytes() };
    vec![text, Source { name: "data.bin".into(), bytes }]
}

fn job(colour: [f32; 3], bounces: u32) -> Job {
    let mut recipe = Recipe::default();
    (recipe.bake.rays, recipe.bake.order, recipe.bake.bounces) = (64, 2, bounces);
    recipe.fit.family = FamilyName::Mean;
    recipe.target.reference_poses = 1;
    let limits = Limits::default();
    let scene = scene::import_sources_content(corner(colour), &limits, content(&recipe)).unwrap();
    Job::new(scene, None, recipe).unwrap()
}

/// A coloured wall gives three channels, a grey one, or none that bounces, one. The bake goes through
/// data set, references, fit and measurement; the floor takes the wall's colour, and every channel
/// is at least as bright as the direct light.
#[test]
fn colour_bleeds_through_every_stage() {
    assert_eq!(job([0.5; 3], 2).reflectance.unwrap().channels, 1);
    assert!(job([0.9, 0.1, 0.1], 0).reflectance.is_none());
    // The floor hides half of the room from the wall's lower edge, which passes on as much less.
    let job = job([0.98, 0.02, 0.02], 2);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("d.zarr");
    let stop = AtomicBool::new(false);
    let watch = Watch { cancelled: &stop, report: &|_| () };
    bake(&job, &path, &watch).unwrap();
    let dataset = Dataset::open(&path).unwrap();
    assert_eq!(dataset.header().layout.channels, 3);
    bake_reference(&dataset, job.checked.reference, &watch).unwrap();
    let fitted = fit(&dataset, &job.recipe).unwrap();
    let measured = measure((&fitted.model, &fitted.model), &dataset, &job.recipe, &watch).unwrap();
    assert_eq!(measured.channels, 3);
    let points = job.poses.points.count();
    let mut values = vec![0.0; points * 12];
    fitted.model.evaluate(&[], None, &mut values).unwrap();
    // A corner of the floor a metre from the wall.
    let [red, green, blue] = [0, 4, 8].map(|at| values[2 * 12 + at]);
    assert!(red > green + 0.01 && (green - blue).abs() < 1e-6, "{red} {green} {blue}");
}

/// A mean free path that is longer than the mesh is refused with both lengths; a shorter one bakes three
/// channels.
#[test]
fn a_mean_free_path_fits_into_the_mesh() {
    let limits = Limits::default();
    let of = |metres: f32| {
        let mut recipe = Recipe::default();
        recipe.bake.subsurface = Some(SubsurfaceRecipe {
            mean_free_path_m: Some([metres, metres, metres / 2.0]),
            ..SubsurfaceRecipe::default()
        });
        let scene = scene::import_sources(corner([0.5; 3]), &limits).unwrap();
        Job::new(scene, None, recipe)
    };
    assert_eq!(of(0.1).unwrap().channels(), 3);
    let error = of(20.0).expect_err("must be refused").to_string();
    assert!(error.contains("20 m in a mesh of"), "{error}");
}

/// A run in 8 bits measures the model that its file holds: measuring the file again gives the same
/// figures, and the error that the bits add is that to the unquantised fit, which itself adds none.
#[test]
fn what_is_measured_is_what_ships() {
    let mut recipe = job([0.5; 3], 0).recipe;
    recipe.output.precision = PrecisionName::I8;
    let limits = Limits::default();
    let scene = scene::import_sources_content(corner([0.5; 3]), &limits, content(&recipe)).unwrap();
    let job = Job::new(scene, None, recipe).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let watch = Watch { cancelled: &stop, report: &|_| () };
    let ran = run(&job, folder.path(), &watch).unwrap().figures;
    let blob = std::fs::read(folder.path().join("model.safetensors")).unwrap();
    let dataset = Dataset::open(&folder.path().join("dataset.zarr")).unwrap();
    let mut model = Model::from_bytes(&blob).unwrap();
    let (again, _) = examine(&mut model, &dataset, &job.recipe, &watch).unwrap();
    assert_eq!(ran.measured, again.measured);
    assert_eq!(ran.model.bytes, blob.len() as u64);
    let candidates = &ran.measured.splits[0].candidates;
    let added = |name: &str| candidates.iter().find(|c| c.name == name).unwrap().added;
    assert_eq!(added("f32"), None);
    let [half, own] = ["f16", "model"].map(|name| added(name).unwrap().coefficient_rms);
    assert!(own > half && half > 0.0, "{own} in 8 bits, {half} in 16");
}

/// Another model from the same bake keeps what the bake and its references took: in the figures, and
/// so on the page.
#[test]
fn another_model_keeps_the_times_of_the_bake() {
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let watch = Watch { cancelled: &stop, report: &|_| () };
    let mut recipe = job([0.5; 3], 0).recipe;
    let first = run(&job([0.5; 3], 0), folder.path(), &watch).unwrap().figures;
    recipe.output.precision = PrecisionName::F16;
    let limits = Limits::default();
    let scene = scene::import_sources_content(corner([0.5; 3]), &limits, content(&recipe)).unwrap();
    let again = run(&Job::new(scene, None, recipe).unwrap(), folder.path(), &watch).unwrap();
    assert!(again.made && again.baked.poses_now == 0);
    let times = |figures: &crate::pipeline::Figures| {
        (figures.times.bake_s, figures.times.rays_per_s, figures.times.reference_s)
    };
    assert!(first.times.bake_s.is_some() && first.times.reference_s.is_some());
    assert_eq!(times(&again.figures), times(&first));
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(page.contains("million rays/s"), "the tile of the bake is lost");
}
