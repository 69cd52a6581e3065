//! The bundled character is worth baking.

use super::*;
use crate::rig::{Deformed, deform};
use crate::{pose, scene};

/// Its limbs shade its body: from the middle of one clip to that of another, the ambient occlusion
/// of at least a twentieth of its points changes by more than 0.15, several times what is left of
/// noise at 128 rays. A pose that is baked twice changes nowhere.
#[test]
fn limbs_shade_the_body() {
    let source = scene::Source { name: "figure.glb".into(), bytes: scene::figure::figure() };
    let scene = scene::import_sources(vec![source], &scene::Limits::default()).unwrap();
    let set = pose::sample(&scene, &pose::Settings::default()).unwrap();
    let baker = Baker::new(&scene.mesh.triangles, &set.points, &settings(Signal::Ao, 128)).unwrap();
    let middle = |name: &str| {
        let clip = set.clip_names.iter().position(|clip| clip == name).unwrap();
        let of_clip: Vec<_> = set.samples.iter().filter(|sample| sample.clip == clip).collect();
        let sample = of_clip[of_clip.len() / 2];
        let mut posed = Deformed::default();
        let globals = scene.skeleton.globals(&sample.pose.local);
        deform(&scene.mesh, &globals, &sample.pose.weights, sample.root, &mut posed);
        let (positions, normals) = (&posed.positions[..], &posed.normals[..]);
        let mesh = PosedMesh { positions, normals, clip_key: 1, time_s: 0.0 };
        baker.bake(&[mesh], &AtomicBool::new(false)).unwrap().remove(0).coefficients
    };
    let changed = |a: &[f32], b: &[f32]| {
        a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > 0.15).count() as f64 / a.len() as f64
    };
    let (crouch, wave) = (middle("crouch"), middle("wave"));
    assert!(changed(&crouch, &wave) > 0.05, "{}", changed(&crouch, &wave));
    assert_eq!(changed(&crouch, &middle("crouch")), 0.0);
}
