use proptest::prelude::*;
use serde_json::Value;

use super::super::synthetic;
use super::super::{Family, Frame, Precision, Signal};
use super::*;

/// The bytes of version 1: what was written by the first release reads for ever.
const GOLDEN: &[u8] = include_bytes!("golden_v1.safetensors");

fn golden_model() -> Model {
    synthetic::model(Family::PcaLinear, Signal::Transfer, Frame::Bone, 1)
}

/// Splits a blob into its safetensors header and its data.
fn split(bytes: &[u8]) -> (Value, &[u8]) {
    let length = u64::from_le_bytes(*bytes.first_chunk().unwrap()) as usize;
    (serde_json::from_slice(&bytes[8..8 + length]).unwrap(), &bytes[8 + length..])
}

fn join(header: &Value, data: &[u8]) -> Vec<u8> {
    let json = serde_json::to_vec(header).unwrap();
    [&(json.len() as u64).to_le_bytes(), json.as_slice(), data].concat()
}

/// The blob with a change to our header or to the list of tensors.
fn changed(model: &Model, change: impl Fn(&mut Value, &mut Value)) -> Vec<u8> {
    let bytes = model.to_bytes(Precision::F32).unwrap();
    let (mut outer, data) = split(&bytes);
    let text = outer["__metadata__"]["poselight"].as_str().unwrap();
    let mut inner: Value = serde_json::from_str(text).unwrap();
    change(&mut inner, &mut outer);
    outer["__metadata__"]["poselight"] = inner.to_string().into();
    join(&outer, data)
}

/// Writing the golden model gives the golden bytes, and reading them gives the model: the format
/// of version 1 has not moved. (`POSELIGHT_WRITE_GOLDEN=1` writes the file anew.)
#[test]
fn golden_bytes_of_version_1() {
    let bytes = golden_model().to_bytes(Precision::F32).unwrap();
    if std::env::var_os("POSELIGHT_WRITE_GOLDEN").is_some() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/src/model/blob/golden_v1.safetensors");
        std::fs::write(path, &bytes).unwrap();
    }
    assert!(bytes == GOLDEN, "the bytes of format version 1 have changed");
    let read = Model::from_bytes(GOLDEN).unwrap();
    assert_eq!(read.header(), golden_model().header());
    assert_eq!(read.decoder(), golden_model().decoder());
}

/// Every family, signal, frame and channel count comes back from f32 exactly as it was, and
/// writes the same bytes again from every precision.
#[test]
fn blobs_round_trip() {
    for model in synthetic::all() {
        for &precision in Precision::ALL {
            let bytes = model.to_bytes(precision).unwrap();
            let read = Model::from_bytes(&bytes).unwrap();
            assert_eq!(read.header().precision, precision);
            assert_eq!(read.point_of_vertex(), model.point_of_vertex());
            assert_eq!(read.bone_of_point(), model.bone_of_point());
            assert_eq!(read.to_bytes(precision).unwrap(), bytes);
            if precision == Precision::F32 {
                assert_eq!(read.header(), model.header());
                assert_eq!(read.decoder(), model.decoder());
            }
        }
    }
}

/// Where points are the vertices, the map that says so is left out and comes back; the sizes tell.
#[test]
fn points_that_are_the_vertices_need_no_map() {
    let model = golden_model();
    let mut header = model.header().clone();
    header.mesh.vertices = header.mesh.points;
    header.mesh.parts.clear();
    let all: Vec<u32> = (0..header.mesh.points).collect();
    let build = |map| {
        let bones = model.bone_of_point().to_vec();
        Model::new(header.clone(), model.decoder(), map, bones).unwrap()
    };
    let mut turned = all.clone();
    turned.rotate_left(1);
    let [same, turned] = [all, turned].map(build);
    let sizes = [&same, &turned].map(|model| model.sizes(Precision::F16).total());
    assert_eq!(sizes[1] - sizes[0], u64::from(header.mesh.points));
    for (model, mapped) in [(&same, false), (&turned, true)] {
        let bytes = model.to_bytes(Precision::F16).unwrap();
        assert_eq!(split(&bytes).0.get("map.point_of_vertex").is_some(), mapped);
        let read = Model::from_bytes(&bytes).unwrap();
        assert_eq!(read.point_of_vertex(), model.point_of_vertex());
        assert_eq!(read.to_bytes(Precision::F16).unwrap(), bytes);
    }
    let lost = |_: &mut Value, outer: &mut Value| {
        outer.as_object_mut().unwrap().remove("map.point_of_vertex");
    };
    let lost = Model::from_bytes(&changed(&golden_model(), lost));
    assert!(lost.is_err(), "fewer points than vertices need the map");
}

/// The tensors take exactly the bytes of the published sizes' formula (Nowrouzezahrai et al. 2007,
/// §5) at f32, half at f16, a quarter at i8 (scales beside), and `sizes` tells the truth about the
/// file.
#[test]
fn tensors_take_the_stated_bytes() {
    for model in synthetic::all() {
        // Exponent and centres of `multilinear` are f32 in every precision.
        let exact = if model.header().family == Family::Multilinear { 1 + 3 * 6 } else { 0 };
        for &precision in Precision::ALL {
            let sizes = model.sizes(precision);
            let rounded = model.numbers() - exact;
            assert_eq!(sizes.decoder, rounded * precision.bytes() + exact * 4);
            let bytes = model.to_bytes(precision).unwrap();
            let (outer, data) = split(&bytes);
            assert_eq!(sizes.total(), data.len() as u64);
            let scales: u64 = outer.as_object().unwrap().iter().fold(0, |sum, (name, info)| {
                let offset = |i: usize| info["data_offsets"][i].as_u64().unwrap();
                if name.ends_with(".scale") { sum + offset(1) - offset(0) } else { sum }
            });
            assert_eq!(sizes.scales, scales);
        }
    }
    let shape = golden_model().shape();
    let [v, c, a] = [shape.points, shape.width, shape.parameters];
    let formula = 4 * (v * 5 + c * (2 + 1) * 5 + a * 2);
    assert_eq!(golden_model().sizes(Precision::F32).decoder, formula as u64);
}

/// Quantised models evaluate close to the exact one.
#[test]
fn quantised_models_are_close() {
    for model in synthetic::all() {
        let parameters = synthetic::numbers(11, synthetic::PARAMETERS);
        let evaluate = |model: &Model| {
            let shape = model.shape();
            let mut out = vec![0.0; shape.points * shape.width];
            model.evaluate(&parameters, None, &mut out).unwrap();
            out
        };
        let exact = evaluate(&model);
        for (precision, bound) in [(Precision::F16, 5e-3), (Precision::I8, 8e-2)] {
            let read = Model::from_bytes(&model.to_bytes(precision).unwrap()).unwrap();
            for (a, b) in exact.iter().zip(evaluate(&read)) {
                assert!((a - b).abs() < bound, "{precision}: {a} {b}");
            }
        }
    }
}

/// No prefix of a blob is a blob, nor is a blob with something after it.
#[test]
fn every_truncation_is_an_error() {
    for length in 0..GOLDEN.len() {
        assert!(Model::from_bytes(&GOLDEN[..length]).is_err(), "{length} bytes");
    }
    assert!(Model::from_bytes(&[GOLDEN, &[0]].concat()).is_err());
}

/// Each lie in the header is refused with a message that names it.
#[test]
fn lies_in_the_header_are_named() {
    type Lie = (&'static str, fn(&mut Value), &'static str);
    let lies: [Lie; 30] = [
        ("version", |h| h["format_version"] = 2.into(), "version 2"),
        ("family", |h| h["family"] = "magic".into(), "magic"),
        ("other family", |h| h["family"] = "linear".into(), "mean"),
        ("precision", |h| h["precision"] = "f16".into(), "encoder.projection"),
        ("order", |h| h["order"] = 11.into(), "order"),
        ("order 0", |h| h["order"] = 0.into(), "order"),
        ("smaller order", |h| h["order"] = 2.into(), "decoder.coefficients"),
        ("channels", |h| h["channels"] = 2.into(), "channels"),
        ("ao with bands", |h| h["signal"] = "ao".into(), "order"),
        ("frame", |h| h["frame"] = "root".into(), "map.bone_of_point"),
        ("conventions", |h| h["conventions"]["units"] = "feet".into(), "conventions"),
        ("unknown field", |h| h["magic"] = 1.into(), "magic"),
        ("points", |h| h["mesh"]["points"] = 38.into(), "decoder.basis"),
        ("no points", |h| h["mesh"]["points"] = 0.into(), "mesh.points"),
        ("vertices", |h| h["mesh"]["vertices"] = 4_000_000_000_u32.into(), "vertices"),
        ("hash", |h| h["mesh"]["scene_sha256"] = "x".into(), "mesh.scene_sha256"),
        ("shape", |h| h["mesh"]["shape_sha256"] = "x".into(), "mesh.shape_sha256"),
        ("receivers", |h| h["mesh"]["receivers_sha256"] = "x".into(), "mesh.receivers_sha256"),
        ("gap", |h| h["mesh"]["parts"][1]["first_vertex"] = 31.into(), "mesh.parts[1]"),
        ("part node", |h| h["mesh"]["parts"][0]["node"] = 4.into(), "mesh.parts[0].node"),
        ("cycle", |h| h["rig"]["nodes"][1]["parent"] = 1.into(), "rig.nodes[1].parent"),
        ("twins", |h| h["rig"]["nodes"][1]["name"] = "Arm".into(), "Arm"),
        ("root", |h| h["rig"]["root_node"] = 4.into(), "rig.root_node"),
        ("bone", |h| h["rig"]["bones"][2] = 9.into(), "rig.bones[2]"),
        ("slot", |h| h["rig"]["columns"][5]["source"]["slot"] = 1.into(), "rig.columns[5].slot"),
        ("axis", |h| h["rig"]["columns"][0]["source"]["axis"] = 3.into(), "rig.columns[0].axis"),
        ("mean", |h| h["rig"]["columns"][0]["source"]["mean"][3] = 5.into(), "columns[0].mean"),
        ("size", |h| h["rig"]["size_m"] = 0.into(), "rig.size_m"),
        ("deviation", |h| h["training"]["deviations"][0] = 0.into(), "training.deviations"),
        ("centre", |h| h["training"]["centre"] = Value::Array(vec![]), "training.centre"),
    ];
    for (name, lie, expected) in lies {
        let bytes = changed(&golden_model(), |inner, _| lie(inner));
        let message = Model::from_bytes(&bytes).unwrap_err().to_string();
        assert!(message.contains(expected), "{name}: {message}");
    }
    assert!(Model::from_bytes(&changed(&golden_model(), |_, _| ())).is_ok());
}

/// Faults of the container: a missing tensor, one too many, another type, not ours at all.
#[test]
fn faults_of_the_container_are_named() {
    let error = |change: fn(&mut Value)| {
        let bytes = changed(&golden_model(), |_, outer| change(outer));
        Model::from_bytes(&bytes).unwrap_err()
    };
    let rename = |outer: &mut Value, from: &str, to: &str| {
        let info = outer.as_object_mut().unwrap().remove(from).unwrap();
        outer[to] = info;
    };
    let bytes = changed(&golden_model(), |_, outer| rename(outer, "decoder.basis", "basis"));
    let missing = Error::MissingTensor { name: "decoder.basis".to_owned() };
    assert_eq!(Model::from_bytes(&bytes).unwrap_err(), missing);

    let extra = |outer: &mut Value| {
        let end = outer["map.point_of_vertex"]["data_offsets"][1].clone();
        outer["zzz"] = serde_json::json!({"dtype": "U8", "shape": [0], "data_offsets": [end, end]});
    };
    assert!(matches!(error(extra), Error::UnexpectedTensor { .. } | Error::NotSafetensors { .. }));
    let retype = |outer: &mut Value| outer["decoder.basis"]["dtype"] = "I32".into();
    assert!(matches!(error(retype), Error::TensorShape { .. }));
    let flat = |outer: &mut Value| outer["decoder.basis"]["shape"] = serde_json::json!([37 * 5]);
    assert!(matches!(error(flat), Error::TensorShape { .. }));

    let (mut outer, data) = split(GOLDEN);
    outer["__metadata__"] = serde_json::json!({"format": "pt"});
    assert_eq!(Model::from_bytes(&join(&outer, data)).unwrap_err(), Error::NotPoselight);
    let huge = [&u64::MAX.to_le_bytes(), GOLDEN].concat();
    assert!(matches!(Model::from_bytes(&huge), Err(Error::Limit { .. })));
}

/// NaN among the numbers and indices out of range are refused with their place.
#[test]
fn bad_numbers_are_named() {
    let position = |name: &str| {
        let (outer, data) = split(GOLDEN);
        GOLDEN.len() - data.len() + outer[name]["data_offsets"][0].as_u64().unwrap() as usize
    };
    let with = |name: &str, offset: usize, patch: &[u8]| {
        let mut bytes = GOLDEN.to_vec();
        let at = position(name) + offset;
        bytes[at..at + patch.len()].copy_from_slice(patch);
        Model::from_bytes(&bytes).unwrap_err()
    };
    let nan = with("decoder.basis", 8, &f32::NAN.to_le_bytes());
    assert_eq!(nan, Error::NotFinite { what: "decoder.basis".to_owned(), index: 2 });
    let point = with("map.point_of_vertex", 3, &[37]);
    assert!(point.to_string().contains("point of vertex 3"), "{point}");
    let bone = with("map.bone_of_point", 36, &[3]);
    assert!(bone.to_string().contains("bone of point 36"), "{bone}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Whatever a few bytes are changed to, reading ends in a model or an error, and a model that
    /// was read evaluates without a panic.
    #[test]
    fn damaged_blobs_never_panic(
        damage in prop::collection::vec((0..GOLDEN.len(), any::<u8>()), 1..8),
    ) {
        let mut bytes = GOLDEN.to_vec();
        for (at, value) in damage {
            bytes[at] = value;
        }
        if let Ok(model) = Model::from_bytes(&bytes) {
            let shape = model.shape();
            let mut out = vec![0.0; shape.points * shape.width];
            prop_assert!(model.evaluate(&vec![0.5; shape.parameters], None, &mut out).is_ok());
        }
    }

    /// Random bytes are no model.
    #[test]
    fn noise_is_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(Model::from_bytes(&bytes).is_err());
    }
}
