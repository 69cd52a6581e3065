//! Jobs of every kind: each makes what its command makes, and says what it did.

use std::fs;

use serde_json::{Value, json};

use super::client::Server;
use super::{job, small};

/// Submits a job and waits for its end; the finished job.
pub(crate) fn finish(server: &Server, request: &Value) -> Value {
    let accepted = server.post("/v1/jobs", request, &[]);
    assert_eq!(accepted.status, 202, "{}", accepted.text());
    let place = accepted.header("location").expect("a place");
    let ended = |job: &Value| {
        ["succeeded", "failed", "cancelled"].contains(&job["state"].as_str().unwrap_or_default())
    };
    let done = server.wait(&place, ended);
    let log = || server.get(&format!("{place}/log"), &[]).text();
    assert_eq!(done["state"], "succeeded", "{done}\n{}", log());
    done
}

fn refused(server: &Server, request: &Value, kind: &str) {
    let answer = server.post("/v1/jobs", request, &[]);
    assert_eq!(answer.status, 422, "{}", answer.text());
    assert_eq!(answer.json()["type"], format!("/problems/{kind}"), "{}", answer.text());
}

/// A bake is fitted, measured and traded off, each by a job of its own: the model is, byte for byte,
/// what `poselight bake` and `fit` make; figures, page and plots can be had; logs tell the stages.
#[test]
fn each_kind_does_what_its_command_does() {
    let server = Server::start(&[]);
    let recipe = small();
    fs::write(server.path("recipe.json"), recipe.to_string()).expect("written");
    server.command(&["bake", "figure.glb", "-o", "set", "--recipe", "recipe.json"]);
    let words = ["fit", "set", "-o", "model.safetensors", "--family", "pca-linear"];
    server.command(&[&words[..], &["--inputs", "3", "--outputs", "4"]].concat());
    let expected = fs::read(server.path("model.safetensors")).expect("made");

    let mut bake = job(&server, &recipe);
    bake["kind"] = json!("bake");
    let baked = finish(&server, &bake);
    let dataset = baked["result"]["dataset"].as_str().expect("a data set").to_owned();
    assert!(baked["result"]["poses"].as_u64().is_some_and(|poses| poses > 0), "{baked}");
    let again = server.post("/v1/jobs", &bake, &[]).json();
    assert_eq!((&again["state"], &again["cached"]), (&json!("succeeded"), &json!(true)));

    let sizes =
        json!({ "version": 1, "fit": { "inputs": 3, "outputs": 4 }, "target": recipe["target"] });
    let fit = json!({ "kind": "fit", "dataset": dataset, "recipe": sizes });
    let fitted = finish(&server, &fit);
    let model = fitted["result"]["model"].as_str().expect("a model").to_owned();
    let blob = server.get(&format!("/v1/models/{model}/blob"), &[]);
    assert!(blob.body == expected, "the service's model is not the command line's");
    assert_eq!(server.get(&format!("/v1/models/{model}/report"), &[]).status, 404);
    assert_eq!(fitted["request"]["recipe"]["bake"]["rays"], 2, "the recipe is not made whole");

    let measure = json!({ "kind": "measure", "model": model, "recipe": { "version": 1, "target": { "reference_poses": 1 } } });
    let measured = finish(&server, &measure);
    measured_well(&server, &measured);
    // Other references take the place of those.
    let other = json!({ "kind": "measure", "model": model, "recipe": { "version": 1, "target": { "reference_poses": 1, "reference_factor": 9 } } });
    let other = finish(&server, &other);
    assert!(log_of(&server, &other).contains("give way"), "{}", log_of(&server, &other));
    let again = server.post("/v1/jobs", &measure, &[]).json();
    assert_eq!(again["cached"], true);
    measured_well(&server, &again);

    let listed = server.get("/v1/jobs?kind=measure", &[]).json();
    assert_eq!(listed["jobs"].as_array().map(Vec::len), Some(3), "{listed}");
    for id in server.get("/v1/jobs", &[]).json()["jobs"].as_array().expect("jobs") {
        assert_eq!(server.delete(&format!("/v1/jobs/{}", id["id"].as_str().unwrap())).status, 204);
    }
    refused(&server, &fit, "unknown-dataset");
    refused(&server, &measure, "unknown-dataset");
    assert_eq!(server.get(&format!("/v1/models/{model}/blob"), &[]).status, 200, "models stay");
}

/// A job refines the mesh first where its recipe says so: model and refined scene are the command
/// line's, evaluation plays the refined scene's clips, and another bake takes the refinement over.
#[test]
fn a_job_refines_its_mesh_first() {
    let server = Server::start(&[]);
    let mut recipe = small();
    recipe["subdivide"] = json!({ "triangles": 15_000, "key_poses": 2, "rays": 2 });
    fs::write(server.path("recipe.json"), recipe.to_string()).expect("written");
    server.command(&["run", "figure.glb", "-o", "out", "--recipe", "recipe.json"]);
    let plan = server.post("/v1/jobs?dry_run=true", &job(&server, &recipe), &[]).json();
    assert!(plan["refine_rays"].as_u64() > Some(0), "{plan}");
    let done = finish(&server, &job(&server, &recipe));
    assert_eq!(done["hashes"]["bake"], plan["hashes"]["bake"]);
    let model = done["result"]["href"].as_str().expect("a model").to_owned();
    let made = |name: &str| fs::read(server.path("out").join(name)).expect("made");
    assert!(server.get(&format!("{model}/blob"), &[]).body == made("model.safetensors"));
    let place = done["result"]["files"]["refined.glb"].as_str().expect("a place").to_owned();
    let scene = server.get(&place, &[]);
    assert!(scene.body == made("refined.glb"), "the service's mesh is not the command line's");
    assert_eq!(scene.header("content-type").as_deref(), Some("model/gltf-binary"));
    assert!(log_of(&server, &done).contains("stage subdivide"), "{}", log_of(&server, &done));
    let clip = json!({ "clip": { "name": "walk", "times_s": [0.5] }, "vertices": [0] });
    let values = server.post(&format!("{model}/evaluate"), &clip, &[]);
    assert_eq!(values.status, 200, "{}", values.text());

    recipe["bake"]["rays"] = json!(4);
    let other = finish(&server, &job(&server, &recipe));
    assert!(!log_of(&server, &other).contains("stage subdivide"), "{}", log_of(&server, &other));
    let there = other["result"]["files"]["refined.glb"].as_str().expect("a place");
    assert!(server.get(there, &[]).body == scene.body);
    for (field, value) in [("depth", json!(0)), ("triangles", json!(10)), ("surprise", json!(1))] {
        let mut wrong = recipe.clone();
        wrong["subdivide"][field] = value;
        let accepted = server.post("/v1/jobs", &job(&server, &wrong), &[]);
        assert_eq!(accepted.status, 422, "{field}: {}", accepted.text());
        let pointer = format!("#/recipe/subdivide/{field}");
        assert_eq!(accepted.json()["errors"][0]["pointer"], pointer, "{}", accepted.text());
    }
}

fn log_of(server: &Server, job: &Value) -> String {
    let id = job["id"].as_str().expect("an id");
    server.get(&format!("/v1/jobs/{id}/log"), &[]).text()
}

fn measured_well(server: &Server, measured: &Value) {
    let files = &measured["result"]["files"];
    let get = |name: &str| server.get(files[name].as_str().expect(name), &[]);
    assert!(get("report.html").text().contains("<html"), "{measured}");
    let figures = get("figures.json").json();
    assert!(figures["measured"]["splits"].is_array(), "{figures}");
    let place = files["figures.json"].as_str().expect("a place");
    assert_eq!(server.get(&place.replace("figures.json", "..%2Flock"), &[]).status, 404);
    assert_eq!(server.get(&place.replace("figures", "no"), &[]).status, 404);
}

/// The trade-off of a data set with its plots; a target lets the service choose and measure.
#[test]
fn the_service_chooses_by_target() {
    let server = Server::start(&[]);
    let mut bake = job(&server, &small());
    bake["kind"] = json!("bake");
    let dataset = finish(&server, &bake)["result"]["dataset"].clone();
    let target = json!({ "reference_poses": 1, "max_bytes": 2_000_000 });
    let mut request =
        json!({ "kind": "fit", "dataset": dataset, "recipe": { "version": 1, "target": target } });
    request["only"] = json!(["no such family"]);
    assert_eq!(server.post("/v1/jobs", &request, &[]).json()["errors"][0]["pointer"], "#/only");
    request["only"] = json!(["mean", "pca-linear 2, 8"]);
    let fitted = finish(&server, &request);
    assert_eq!(fitted["result"]["target_met"], true, "{fitted}");
    let model = fitted["result"]["href"].as_str().expect("a model");
    assert!(server.get(&format!("{model}/report"), &[]).text().contains("<html"));
    assert!(server.get(model, &[]).json()["bytes"].as_u64().is_some_and(|b| b <= 2_000_000));

    let request = json!({ "kind": "tradeoff", "only": ["mean", "pca-linear 2, 8"], "dataset": dataset, "recipe": { "version": 1, "target": { "reference_poses": 1 } } });
    let traded = finish(&server, &request);
    assert!(traded["result"]["front"].as_array().is_some_and(|front| !front.is_empty()));
    for name in ["tradeoff.json", "bytes.svg", "microseconds.svg", "report.html"] {
        let place = traded["result"]["files"][name].as_str().expect(name);
        let answer = server.get(place, &[]);
        assert_eq!(answer.status, 200);
        let page = name.ends_with("html");
        assert!(
            !page || ["<svg", "pca-linear 2, 8"].iter().all(|part| answer.text().contains(part))
        );
    }
}

/// What less than a data set has would do, as the command line measures it; more than it has is refused at once, and a
/// bake of fewer rays leaves nothing behind.
#[test]
fn the_service_measures_efforts() {
    let server = Server::start(&[]);
    let mut recipe = small();
    recipe["bake"]["rays"] = json!(4);
    let mut bake = job(&server, &recipe);
    bake["kind"] = json!("bake");
    let dataset = finish(&server, &bake)["result"]["dataset"].clone();
    let recipe =
        json!({ "version": 1, "fit": { "family": "linear" }, "target": { "reference_poses": 1 } });
    let of = |efforts: Value| json!({ "kind": "effort", "dataset": dataset, "efforts": efforts, "recipe": recipe });
    for (efforts, pointer) in [
        (json!({ "rays": [5] }), "#/efforts"),
        (json!({ "poses": [0] }), "#/efforts"),
        (json!({}), "#/efforts"),
    ] {
        let answer = server.post("/v1/jobs", &of(efforts), &[]);
        assert_eq!(answer.status, 422, "{}", answer.text());
        assert_eq!(answer.json()["errors"][0]["pointer"], pointer, "{}", answer.text());
    }
    let done = finish(&server, &of(json!({ "rays": [2], "poses": [3] })));
    let get = |name: &str| server.get(done["result"]["files"][name].as_str().expect(name), &[]);
    assert!(get("effort.svg").text().starts_with("<svg"));
    let effort = get("effort.json").json();
    let points = effort["points"].as_array().expect("points");
    assert_eq!(points.len(), 4, "{effort}");
    assert!(points.iter().any(|p| p["rays_per_point"] == 2 && p["poses"] == 3), "{effort}");
    let again = server.post("/v1/jobs", &of(json!({ "rays": [2], "poses": [3] })), &[]).json();
    assert_eq!(again["cached"], true, "{again}");
}

/// A job that can never have the memory it needs is refused with what there is; each kind refuses
/// what is another's; a plan is made for a scene.
#[test]
fn what_cannot_start_is_refused() {
    let server = Server::start(&["--memory-mib", "1"]);
    let answer = server.post("/v1/jobs", &job(&server, &small()), &[]);
    assert_eq!(answer.status, 422, "{}", answer.text());
    assert_eq!(answer.json()["limit"], json!({ "name": "memory_bytes", "most": 1 << 20 }));
    let none = "0".repeat(64);
    let of =
        |kind: &str, field: &str| json!({ "kind": kind, field: none, "recipe": { "version": 1 } });
    refused(&server, &of("fit", "dataset"), "unknown-dataset");
    refused(&server, &of("tradeoff", "dataset"), "unknown-dataset");
    refused(&server, &of("measure", "model"), "invalid-field");
    refused(&server, &of("fit", "model"), "invalid-field");
    let planned = server.post("/v1/jobs?dry_run=true", &of("fit", "dataset"), &[]);
    assert_eq!(planned.status, 422, "{}", planned.text());
    assert_eq!(server.get("/v1/jobs", &[]).json()["jobs"], json!([]), "a refused job was kept");
}
