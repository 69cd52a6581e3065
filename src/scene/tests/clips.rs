//! Animations.

use super::*;

/// A triangle with one animation of one channel on its node.
fn animated(path: &str, interpolation: &str, times: &[f32], output: usize, maker: &mut Maker) {
    let input = maker.accessor("SCALAR", times);
    let animation = json!({
        "channels": [{"sampler": 0, "target": {"node": 0, "path": path}}],
        "samplers": [{"input": input, "output": output, "interpolation": interpolation}],
    });
    maker.push("animations", animation);
}

/// All four paths and all three interpolations; unnamed clips are numbered, equal names differ.
#[test]
fn channels_of_all_kinds_are_read() {
    let mut maker = Maker::triangle();
    let target = maker.accessor("VEC3", &[1_f32; 9]);
    maker.document["meshes"][0]["primitives"][0]["targets"] =
        json!([{"POSITION": target}, {"POSITION": target}]);
    let vectors = maker.accessor("VEC3", &[1_f32, 2., 3., 4., 5., 6.]);
    animated("translation", "LINEAR", &[0.0, 0.5], vectors, &mut maker);
    animated("scale", "STEP", &[0.25, 2.0], vectors, &mut maker);
    let shares = maker.normalized("SCALAR", &[0_u8, 255, 51, 0]);
    animated("weights", "LINEAR", &[0.0, 0.5], shares, &mut maker);
    let cubic: Vec<f32> = [[1., 0., 0., 0.], [0., 0., 0., 2.], [0., 0., 1., 0.]].concat();
    let cubic = maker.accessor("VEC4", &cubic);
    animated("rotation", "CUBICSPLINE", &[1.0], cubic, &mut maker);
    let short = maker.normalized("VEC4", &[0_i16, 0, 0, 32767, 0, 16000, 0, 16000]);
    animated("rotation", "LINEAR", &[0.0, 3.0], short, &mut maker);
    maker.document["animations"][1]["name"] = json!("clip0");
    let scene = maker.scene();
    let names: Vec<&str> = scene.clips.iter().map(|clip| clip.name.as_str()).collect();
    assert_eq!(names, ["clip0", "clip0_2", "clip2", "clip3", "clip4"]);
    let durations: Vec<f32> = scene.clips.iter().map(|clip| clip.duration_s).collect();
    assert_eq!(durations, [0.5, 2.0, 0.5, 1.0, 3.0]);
    let channels: Vec<&Channel> = scene.clips.iter().map(|clip| &clip.channels[0]).collect();
    assert_eq!(channels[0].target, Target::Translation(0));
    assert_eq!(channels[0].values, [1., 2., 3., 4., 5., 6.]);
    assert_eq!(channels[1].interpolation, Interpolation::Step);
    assert_eq!(channels[2].target, Target::Weights(0..2));
    assert_eq!(channels[2].values, [0.0, 1.0, 0.2, 0.0]);
    // Cubic rotations stay as they are, linear ones become unit quaternions.
    assert_eq!(channels[3].values[4..8], [0., 0., 0., 2.]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    assert!((channels[4].values[5] - half).abs() < 1e-6);
    assert_notice(&scene, "not of unit length");
}

/// Faults are refused with the channel: key times that do not ascend, are negative or none, counts
/// that do not fit, wrong formats, values that are not finite, zero quaternions.
#[test]
fn bad_channels_are_refused() {
    let refusal = |path: &str, interpolation: &str, times: &[f32], kind: &str, values: &[f32]| {
        let mut maker = Maker::triangle();
        let output = maker.accessor(kind, values);
        animated(path, interpolation, times, output, &mut maker);
        maker.refusal()
    };
    let six = [1_f32; 6];
    for (times, expected) in [
        (&[0.0, 0.0][..], "key 1 is at 0 s, not after the one at 0 s"),
        (&[1.0, 0.5], "key 1 is at 0.5 s"),
        (&[-1.0, 0.5], "first key is at -1 s, before 0"),
        (&[0.0, f32::NAN], "element 1, is not finite"),
        (&[0.0], "2 elements for 1 keys, which need 1"),
        (&[], "2 elements for 0 keys"),
    ] {
        let found = refusal("translation", "LINEAR", times, "VEC3", &six);
        assert!(found.contains(expected) && found.contains("animations[0]"), "{found}");
    }
    let times = [0.0, 1.0];
    let found = refusal("translation", "CUBICSPLINE", &times, "VEC3", &six);
    assert!(found.contains("2 elements for 2 keys, which need 6"), "{found}");
    let found = refusal("rotation", "LINEAR", &times, "VEC3", &six);
    assert!(found.contains("Vec3 of F32 is not allowed there"), "{found}");
    let found = refusal("rotation", "LINEAR", &times, "VEC4", &[0., 0., 0., 1., 0., 0., 0., 0.]);
    assert!(found.contains("the rotation of key 1 is zero"), "{found}");
    let found = refusal("scale", "LINEAR", &[0.0], "VEC3", &[1.0, f32::INFINITY, 1.0]);
    assert!(found.contains("element 0, is not finite"), "{found}");
    let found = refusal("scale", "CUBIC", &[0.0], "VEC3", &[1.0; 3]);
    assert!(found.contains("interpolation is none of glTF's three"), "{found}");
}

/// What moves nothing of this scene is left out and said: channels without a node, to other
/// scenes, to weights that do not exist, of unknown paths, and doubled ones.
#[test]
fn channels_to_nothing_are_left_out() {
    let mut maker = Maker::triangle();
    maker.push("nodes", json!({"name": "elsewhere"}));
    let output = maker.accessor("VEC3", &[1_f32; 3]);
    animated("translation", "LINEAR", &[0.0], output, &mut maker);
    let targets = json!([
        {"sampler": 0, "target": {"path": "translation"}},
        {"sampler": 0, "target": {"node": 1, "path": "translation"}},
        {"sampler": 0, "target": {"node": 0, "path": "weights"}},
        {"sampler": 0, "target": {"node": 0, "path": "pointer"}},
        {"sampler": 0, "target": {"node": 0, "path": "scale"}},
        {"sampler": 0, "target": {"node": 0, "path": "scale"}},
    ]);
    maker.document["animations"][0]["channels"] = targets;
    let scene = maker.scene();
    assert_eq!(scene.clips[0].channels.len(), 1);
    assert_notice(&scene, "nodes[1] is not in the scene");
    assert_notice(&scene, "nodes[0] has no morph targets");
    assert_notice(&scene, "path is none of glTF's four");
    assert_notice(&scene, "an earlier one has its target");
    let idle = json!([{"sampler": 0, "target": {"node": 1, "path": "scale"}}]);
    maker.document["animations"][0]["channels"] = idle;
    let scene = maker.scene();
    assert!(scene.clips.is_empty());
    assert_notice(&scene, "animations[0] (\"clip0\") was left out");
}

/// Key times without a view are zeros: right for one key, at 0 s, and never for two.
#[test]
fn one_key_may_have_no_view() {
    for (keys, values) in [(1, vec![1_f32; 3]), (2, vec![1_f32; 6])] {
        let mut maker = Maker::triangle();
        let output = maker.accessor("VEC3", &values);
        animated("translation", "LINEAR", &vec![0.0; keys], output, &mut maker);
        let input = maker.document["animations"][0]["samplers"][0]["input"].as_u64().unwrap();
        let accessor = &mut maker.document["accessors"][input as usize];
        *accessor = json!({"componentType": 5126, "count": keys, "type": "SCALAR"});
        if keys == 1 {
            assert_eq!(maker.scene().clips[0].channels[0].times_s, [0.0]);
        } else {
            let refusal = maker.refusal();
            assert!(refusal.contains("no bufferView, and zeros do not ascend"), "{refusal}");
        }
    }
}
