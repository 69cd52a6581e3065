//! Reflection over HTTP: a model of visibility, a light in words and a reflectance, as the command line
//! has it; and the light of a run's pictures.

use std::fs;

use poselight::shade::{Brdf, Merl};
use serde_json::{Value, json};

use super::client::{Server, sha256};
use super::kinds::finish;
use super::{grpc, job, small};

const LIGHT: &str = "cone:0.3,1,0.6,20:9,8,6";
const BRDF: &str = "ggx:0.5,0.5";

/// What is told at the first field of fault.
fn refused(server: &Server, path: &str, body: &Value) -> String {
    let answer = server.post(path, body, &[]);
    assert_eq!(answer.status, 422, "{}", answer.text());
    answer.json()["errors"][0]["pointer"].as_str().unwrap_or_default().to_owned()
}

/// A request with some fields of its `brdf` changed.
fn with(base: &Value, part: &str, field: &str, value: Value) -> Value {
    let mut body = base.clone();
    body[part][field] = value;
    body
}

/// A clip's poses reflect the light as `poselight evaluate --brdf` has it, by words and by an operator
/// that was uploaded; what cannot be reflected is refused at its field. The run that made the model lit
/// its pictures by its recipe.
#[test]
fn light_is_reflected_towards_an_eye() {
    let server = Server::start(&[]);
    let mut recipe = small();
    recipe["bake"]["signal"] = json!("visibility");
    recipe["bake"]["order"] = json!(3);
    recipe["light"] = json!({ "source": LIGHT, "brdf": BRDF });
    let missing = with(&recipe, "light", "source", json!("sky.hdr"));
    let request = job(&server, &missing);
    assert_eq!(refused(&server, "/v1/jobs", &request), "#/recipe/light/source");
    let unknown = with(&recipe, "light", "brdf", json!("paint.binary"));
    assert_eq!(refused(&server, "/v1/jobs", &job(&server, &unknown)), "#/recipe/light/brdf");
    let grained = with(&recipe, "light", "brdf", json!("ggx:0.5,0.1,0.5"));
    assert_eq!(refused(&server, "/v1/jobs", &job(&server, &grained)), "#/recipe/light/brdf");
    let done = finish(&server, &job(&server, &recipe));
    let model = done["result"]["href"].as_str().expect("a model").to_owned();
    let report = server.get(&format!("{model}/report"), &[]).text();
    assert!(report.contains("data:image/png"), "no lit picture");
    let path = format!("{model}/evaluate");
    let body = json!({
        "clip": { "name": "jump", "times_s": [0.0, 0.25] },
        "light": { "form": LIGHT },
        "brdf": { "form": BRDF, "eye": [0.5, 1.0, 3.0] },
    });
    let values = |body: &Value| -> Vec<f32> {
        let answer = server.post(&path, body, &[("Accept", "application/octet-stream")]);
        assert_eq!(answer.status, 200, "{}", answer.text());
        answer.body.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
    };
    let found = values(&body);
    let towards = (LIGHT, BRDF, [0.5, 1.0, 3.0]);
    grpc::reflects(&server, &model, towards, ("jump", &[0.0, 0.25], &found));
    let blob = server.get(&format!("{model}/blob"), &[]).body;
    fs::write(server.path("model.safetensors"), blob).expect("written");
    let words = ["evaluate", "model.safetensors", "--scene", "figure.glb", "--clip", "jump"];
    let reflect = ["--light", LIGHT, "--brdf", BRDF, "--eye", "0.5", "1", "3", "--fps", "4"];
    server.command(&[&words[..], &reflect, &["-o", "lit.npy"]].concat());
    let expected = fs::read(server.path("lit.npy")).expect("made");
    let expected = expected[128..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b));
    let apart = |a: f32, b: f32| (a - b).abs();
    let far = found.iter().zip(expected).map(|(a, b)| apart(*a, b)).fold(0.0, f32::max);
    let brightest = found.iter().fold(0.0_f32, |m, x| m.max(*x));
    assert!(far < 1e-3 * brightest && brightest > 0.1, "{far} {brightest}");
    server.command(&["brdf", BRDF, "--order", "3", "-o", "gloss.safetensors"]);
    let operator = fs::read(server.path("gloss.safetensors")).expect("made");
    let digest = sha256(&operator);
    let kept = server.put(&format!("/v1/assets/{digest}?name=gloss.safetensors"), &operator, &[]);
    assert_eq!(kept.status, 201, "{}", kept.text());
    let mut uploaded = body.clone();
    uploaded["brdf"] = json!({ "asset": digest, "eye": [0.5, 1.0, 3.0] });
    let by_asset = values(&uploaded);
    let far = found.iter().zip(&by_asset).map(|(a, b)| apart(*a, *b)).fold(0.0, f32::max);
    assert!(far < 1e-4 * brightest, "{far}");
    let listed = with(&body, "brdf", "eye", json!([-3.0, 1.0, 0.5]));
    assert!(values(&listed) != found, "the eye has no part in it");
    is_refused_at_its_field(&server, &path, &body, &digest);
    let grained = with(&uploaded, "brdf", "terms", json!(4));
    assert_eq!(refused(&server, &path, &grained), "#/brdf/terms");
    measured(&server, &path, &body, values);
}

/// A reflectance measured in MERL's format, uploaded, reflects as the closed form that it was written
/// from, a little less towards the horizon, which lies between a table's cells; one that is cut off is
/// refused at its field.
fn measured(server: &Server, path: &str, body: &Value, values: impl Fn(&Value) -> Vec<f32>) {
    let paint = Brdf::Lambert { albedo: [0.5, 0.25, 0.75] };
    let bytes = Merl::bytes_of(&paint);
    let upload = |bytes: &[u8]| {
        let digest = sha256(bytes);
        let kept = server.put(&format!("/v1/assets/{digest}?name=paint.binary"), bytes, &[]);
        assert_eq!(kept.status, 201, "{}", kept.text());
        json!({ "asset": digest, "eye": [0.5, 1.0, 3.0] })
    };
    let with_brdf = |brdf: Value| {
        let mut body = body.clone();
        body["brdf"] = brdf;
        body
    };
    let found = values(&with_brdf(upload(&bytes)));
    let form = json!({ "form": "lambert:0.5,0.25,0.75", "eye": [0.5, 1.0, 3.0] });
    let expected = values(&with_brdf(form));
    let brightest = expected.iter().fold(0.0_f32, |m, x| m.max(*x));
    let apart: Vec<f32> = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).collect();
    let far = apart.iter().fold(0.0_f32, |m, x| m.max(*x));
    let mean = apart.iter().sum::<f32>() / apart.len() as f32;
    assert!(far < 0.06 * brightest && mean < 0.01 * brightest, "{far} {mean} {brightest}");
    let cut = with_brdf(upload(&bytes[..40_000]));
    assert_eq!(refused(server, path, &cut), "#/brdf/asset");
}

/// What cannot be reflected.
fn is_refused_at_its_field(server: &Server, path: &str, body: &Value, operator: &str) {
    for (part, field, value, pointer) in [
        ("brdf", "form", json!("velvet"), "#/brdf/form"),
        ("brdf", "form", json!("ggx:0.5,0.1,0.5"), "#/brdf/form"),
        ("brdf", "form", json!("ggx:2,0.5"), "#/brdf/form"),
        ("brdf", "terms", json!(0), "#/brdf/terms"),
        ("brdf", "terms", json!(10), "#/brdf/terms"),
        ("brdf", "lobes", json!(9), "#/brdf/lobes"),
        ("brdf", "asset", json!(operator), "#/brdf"),
        ("light", "form", json!("moon"), "#/light/form"),
        ("light", "form", json!("cone:1"), "#/light/form"),
        ("light", "asset", json!("0".repeat(64)), "#/light"),
    ] {
        assert_eq!(
            refused(server, path, &with(body, part, field, value.clone())),
            pointer,
            "{value}"
        );
    }
    let mut alone = body.clone();
    alone.as_object_mut().expect("an object").remove("light");
    assert_eq!(refused(server, path, &alone), "#/brdf");
    let figure = server.figure();
    let mut scene = body.clone();
    scene["brdf"] = json!({ "asset": figure, "eye": [0.5, 1.0, 3.0] });
    assert_eq!(refused(server, path, &scene), "#/brdf/asset");
}
