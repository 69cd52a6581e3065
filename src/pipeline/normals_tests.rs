use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::*;
use crate::pipeline::recipe::{Recipe, SignalName};
use crate::pipeline::{Job, bake, two_nodes};
use crate::rig::MorphTarget;

/// The lid over the floor with a target that stands it up along z, and a second that does nothing; `normals`
/// are the first's.
fn scene(normals: Vec<Vec3>) -> Scene {
    let mut scene = two_nodes::scene(false);
    let lift = |p: &Vec3| Vec3::new(0.0, p.z, -p.z);
    let target = |weight, position_deltas, normal_deltas| MorphTarget {
        weight,
        vertices: vec![0, 1, 2, 3],
        position_deltas,
        normal_deltas,
    };
    let up = scene.mesh.positions[..4].iter().map(lift).collect();
    scene.mesh.morphs = vec![target(0, up, normals), target(1, vec![Vec3::X; 4], vec![])];
    scene.mesh.weight_names = vec!["up".into(), "aside".into()];
    scene.mesh.default_weights = vec![1.0, 0.0];
    scene
}

fn job(scene: Scene, asked: Option<NormalsRecipe>) -> Result<Job, Error> {
    let mut recipe = Recipe::default();
    (recipe.bake.signal, recipe.bake.rays) = (SignalName::Ao, 64);
    recipe.bake.recompute_normals = asked;
    Job::new(scene, None, recipe)
}

/// A mesh that is morphed by positions alone is shaded as it then stands, the notice says so and the recipe
/// keeps it; its neighbour keeps its own. Who does not want it says so; normals of the file's targets count;
/// and a target that no pose uses asks for nothing.
#[test]
fn normals_follow_positions() {
    let faces = |job: &Job| job.deformed(0).normals;
    let found = job(scene(vec![]), None).unwrap();
    let meshes = NormalsRecipe::Meshes(vec!["square".into()]);
    assert_eq!(found.recipe.bake.recompute_normals, Some(meshes.clone()));
    assert!(faces(&found)[..4].iter().all(|n| n.z.abs() > 0.999), "{:?}", faces(&found));
    assert_eq!(faces(&found)[4..], [Vec3::Y; 4]);
    let told = found.scene.notices.join("; ");
    assert!(told.contains("no normals") && told.contains("square"), "{told}");
    let again = job(scene(vec![]), Some(meshes)).unwrap();
    assert_eq!((again.hashes.bake, again.recipe), (found.hashes.bake.clone(), found.recipe));

    let kept = job(scene(vec![]), Some(NormalsRecipe::All(false))).unwrap();
    assert_eq!(faces(&kept), [Vec3::Y; 8]);
    assert_ne!(kept.hashes.bake, found.hashes.bake);
    let given = job(scene(vec![Vec3::X; 4]), None).unwrap();
    assert_eq!(given.recipe.bake.recompute_normals, None);
    let mut unused = scene(vec![]);
    unused.mesh.default_weights = vec![0.0; 2];
    let unused = job(unused, None).unwrap();
    assert_eq!(unused.recipe.bake.recompute_normals, None);
    assert_eq!(unused.hashes.bake, job(two_nodes::scene(false), None).unwrap().hashes.bake);
    let fault = job(scene(vec![]), Some(NormalsRecipe::Meshes(vec!["Hat".into()])));
    assert!(fault.expect_err("no hat").to_string().contains("no mesh \"Hat\""));
}

/// Both sides of a sheet that a target stands up are as open as it stands, not as it lay: rays leave along
/// the normals that they are shaded by.
#[test]
fn a_morphed_sheet_is_as_open_as_it_stands() {
    let mean = |asked| {
        let job = job(scene(vec![]), asked).unwrap();
        let baker = job.baker(&job.checked.bake, None).unwrap();
        let posed = job.traced(0);
        let mesh = bake::posed(&job, 0, &posed);
        let ao = baker.bake(&[mesh], &AtomicBool::new(false)).unwrap().swap_remove(0).coefficients;
        ao[..4].iter().sum::<f32>() / 4.0
    };
    let (stands, lay) = (mean(None), mean(Some(NormalsRecipe::All(false))));
    assert!(stands > lay + 0.1, "{stands} {lay}");
}
