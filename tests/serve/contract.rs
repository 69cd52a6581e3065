//! The service against its own document: real answers have the declared form, every property
//! declared; requests made from the document, sound and spoiled, never make it fail.

use serde_json::{Map, Value, json};

use super::client::{Answer, Server};
use super::kinds::finish;
use super::{job, small};

/// Numbers from a seed, for choices that are the same in every run.
struct Dice(u64);

impl Dice {
    fn below(&mut self, count: usize) -> usize {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % count
    }

    fn pick<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len())]
    }
}

/// The document.
struct Contract(Value);

impl Contract {
    fn of(server: &Server) -> Self {
        Self(server.get("/openapi.json", &[]).json())
    }

    fn resolve<'a>(&'a self, schema: &'a Value) -> &'a Value {
        match schema["$ref"].as_str() {
            Some(reference) => {
                let pointer = reference.trim_start_matches('#');
                self.0.pointer(pointer).unwrap_or_else(|| panic!("{reference} leads nowhere"))
            }
            None => schema,
        }
    }

    /// Fails where a value is not of its schema, or has a property that the schema does not name.
    fn check(&self, schema: &Value, value: &Value, place: &str) {
        let schema = self.resolve(schema);
        // The recipe's schema is made from its type, and the type refuses unknown fields.
        if schema["$id"] == "/schemas/recipe" {
            return;
        }
        if let Some(allowed) = schema["enum"].as_array() {
            assert!(allowed.contains(value), "{place}: {value} is none of {allowed:?}");
        }
        if let Some(options) = schema["oneOf"].as_array() {
            let option = usize::from(!value.is_null());
            return self.check(&options[option], value, place);
        }
        let types: Vec<&str> = match &schema["type"] {
            Value::String(one) => vec![one],
            Value::Array(many) => many.iter().filter_map(Value::as_str).collect(),
            _ => return,
        };
        let fits = |kind: &&str| match *kind {
            "object" => value.is_object(),
            "array" => value.is_array(),
            "string" => value.is_string(),
            "boolean" => value.is_boolean(),
            "integer" => value.is_i64() || value.is_u64(),
            "number" => value.is_number(),
            "null" => value.is_null(),
            other => panic!("{place}: the document knows no type {other}"),
        };
        assert!(types.iter().any(fits), "{place}: {value} is not {types:?}");
        for (index, item) in value.as_array().into_iter().flatten().enumerate() {
            self.check(&schema["items"], item, &format!("{place}/{index}"));
        }
        if let Some(object) = value.as_object() {
            self.check_object(schema, object, place);
        }
    }

    fn check_object(&self, schema: &Value, object: &Map<String, Value>, place: &str) {
        for name in schema["required"].as_array().into_iter().flatten() {
            assert!(object.contains_key(name.as_str().unwrap_or_default()), "{place} lacks {name}");
        }
        let more = &schema["additionalProperties"];
        let Some(properties) = schema["properties"].as_object() else {
            return object.iter().filter(|_| more.is_object()).for_each(|(name, value)| {
                self.check(more, value, &format!("{place}/{name}"));
            });
        };
        for (name, value) in object {
            let place = format!("{place}/{name}");
            let property = properties.get(name);
            self.check(
                property.unwrap_or_else(|| panic!("{place} is not declared")),
                value,
                &place,
            );
        }
    }

    /// Fails where an answer is not as the document has it: its status, its kind, its JSON.
    fn check_answer(&self, operation: &Value, answer: &Answer, request: &str) {
        assert!(answer.status < 500, "{request}: {} {}", answer.status, answer.text());
        let responses = &operation["responses"];
        let known = &responses[answer.status.to_string()];
        let declared = if known.is_null() { &responses["default"] } else { known };
        assert!(!declared.is_null(), "{request}: {} is not declared", answer.status);
        assert!(
            !known.is_null() || answer.status >= 400,
            "{request}: {} is not declared",
            answer.status
        );
        let content = &self.resolve(declared)["content"];
        let kind = answer.header("content-type").unwrap_or_default();
        let kind = kind.split(';').next().unwrap_or_default().to_owned();
        if answer.body.is_empty() && content.is_null() {
            return;
        }
        let schema = &content[&kind]["schema"];
        assert!(!schema.is_null(), "{request}: {} of kind {kind} is not declared", answer.status);
        if kind.ends_with("json") {
            self.check(schema, &answer.json(), request);
        }
    }

    fn operation(&self, method: &str, path: &str) -> &Value {
        let operation = &self.0["paths"][path][method];
        assert!(operation.is_object(), "{method} {path} is not in the document");
        operation
    }
}

/// What real work answers is what the document says, down to each property.
#[test]
fn real_answers_have_the_declared_form() {
    let server = Server::start(&[]);
    let contract = Contract::of(&server);
    let check = |method: &str, path: &str, answer: &Answer| {
        contract.check_answer(contract.operation(method, path), answer, path);
    };
    let request = job(&server, &small());
    check("post", "/v1/jobs", &server.post("/v1/jobs?dry_run=true", &request, &[]));
    let accepted = server.post("/v1/jobs", &request, &[]);
    check("post", "/v1/jobs", &accepted);
    let place = accepted.header("location").expect("a place");
    server.wait(&place, |job| job["progress"].is_object());
    check("get", "/v1/jobs/{id}", &server.get(&place, &[]));
    let done = finish(&server, &request);
    check("get", "/v1/jobs/{id}", &server.get(&place, &[]));
    check("get", "/v1/jobs", &server.get("/v1/jobs", &[]));
    check("get", "/v1/jobs/{id}/log", &server.get(&format!("{place}/log"), &[]));
    let model = done["result"]["href"].as_str().expect("a model");
    check("get", "/v1/models", &server.get("/v1/models", &[]));
    check("get", "/v1/models/{id}", &server.get(model, &[]));
    for part in ["blob", "report", "figures"] {
        let answer = server.get(&format!("{model}/{part}"), &[]);
        check("get", &format!("/v1/models/{{id}}/{part}"), &answer);
    }
    let body = json!({ "poses": [{ "joints": {} }], "vertices": [0] });
    let evaluated = server.post(&format!("{model}/evaluate"), &body, &[]);
    check("post", "/v1/models/{id}/evaluate", &evaluated);
    let measure = json!({ "kind": "measure", "model": done["result"]["model"], "recipe": { "version": 1, "target": { "reference_poses": 1 } } });
    let measured = finish(&server, &measure);
    let place = format!("/v1/jobs/{}", measured["id"].as_str().expect("an id"));
    check("get", "/v1/jobs/{id}", &server.get(&place, &[]));
    let file = measured["result"]["files"]["figures.json"].as_str().expect("a file");
    check("get", "/v1/jobs/{id}/files/{name}", &server.get(file, &[]));
    let asset = format!("/v1/assets/{}", server.figure());
    check("get", "/v1/assets/{sha256}", &server.get(&asset, &[("Range", "bytes=0-3")]));
    check("put", "/v1/assets/{sha256}", &server.put(&asset, b"", &[]));
    for path in ["/health", "/ready", "/metrics", "/openapi.json"] {
        check("get", path, &server.get(path, &[]));
    }
}

/// What a field may be given that it does not expect.
fn junk(dice: &mut Dice) -> Value {
    let junk = [
        json!(null),
        json!(true),
        json!(-1),
        json!(1e300),
        json!(""),
        json!("../../etc/passwd"),
        json!("\u{0}\u{202e}"),
        json!([]),
        json!({}),
        json!([[[[]]]]),
        json!({ "a": { "b": [] } }),
        json!(u64::MAX),
        json!(i64::MIN),
        json!(0.5),
        json!("0".repeat(64)),
        json!("x".repeat(5000)),
    ];
    dice.pick(&junk).clone()
}

/// Puts junk at one place of a document, takes something out, or adds something.
fn spoil(dice: &mut Dice, value: &mut Value) {
    let deeper = dice.below(4) > 0;
    match value {
        Value::Object(object) if !object.is_empty() && deeper => {
            let name = object.keys().nth(dice.below(object.len())).cloned().unwrap_or_default();
            match dice.below(8) {
                0 => drop(object.remove(&name)),
                1 => drop(object.insert("surprise".to_owned(), junk(dice))),
                _ => spoil(dice, &mut object[&name]),
            }
        }
        Value::Array(items) if !items.is_empty() && deeper => {
            let index = dice.below(items.len());
            spoil(dice, &mut items[index]);
        }
        other => *other = junk(dice),
    }
}

/// Requests made from the document, each with something spoiled, get an answer that the document
/// declares, and never one of the service's failure. No job fits into the memory that is given, so
/// none is run.
#[test]
fn spoiled_requests_never_make_it_fail() {
    let server = Server::start(&["--max-asset-mib", "1", "--memory-mib", "1"]);
    let contract = Contract::of(&server);
    let mut dice = Dice(7);
    let ids = [
        "0".repeat(64),
        "0".repeat(32),
        server.figure(),
        "%00".into(),
        "%ff".into(),
        "..".into(),
        "%2e%2e%2f".into(),
        "a".repeat(3000),
        "é".replace('é', "%C3%A9"),
    ];
    let paths = contract.0["paths"].as_object().expect("paths").clone();
    for round in 0..40 {
        for (template, methods) in &paths {
            for (method, operation) in methods.as_object().expect("methods") {
                let mut path = template.clone();
                for name in ["sha256", "id", "name"] {
                    let id: &String = dice.pick(&ids);
                    path = path.replace(&format!("{{{name}}}"), id);
                }
                for parameter in operation["parameters"].as_array().into_iter().flatten() {
                    if parameter["in"] == "query" && dice.below(3) == 0 {
                        let mark = if path.contains('?') { '&' } else { '?' };
                        let value = *dice.pick(&[
                            "1",
                            "true",
                            "-1",
                            "99999999999999999999",
                            "%00",
                            "running",
                            "a&b=c",
                            "",
                        ]);
                        path +=
                            &format!("{mark}{}={value}", parameter["name"].as_str().unwrap_or("x"));
                    }
                }
                // It is what sound requests name.
                if method == "delete" && path.contains(&server.figure()) {
                    continue;
                }
                let mut body =
                    operation["requestBody"]["content"]["application/json"]["example"].clone();
                if body.is_object() {
                    // Sound assets let more of what is spoiled be reached.
                    if body["assets"].is_object() {
                        body["assets"]["hero.glb"] = json!(server.figure());
                    }
                    spoil(&mut dice, &mut body);
                    spoil(&mut dice, &mut body);
                }
                let body = if body.is_null() { String::new() } else { body.to_string() };
                let headers = [
                    ("Range", "bytes=5-1"),
                    ("If-None-Match", "\"x"),
                    ("Last-Event-ID", "x"),
                    ("Idempotency-Key", "k\u{e9}"),
                    ("Accept", "a/b;q=x,,"),
                ];
                let header = *dice.pick(&headers);
                let request = format!("round {round}: {method} {path} {header:?} {body}");
                let answer = server.send(&method.to_uppercase(), &path, body.as_bytes(), &[header]);
                // Where the document's place is not met, the answer is that of no place at all.
                if ![404, 405].contains(&answer.status) {
                    contract.check_answer(operation, &answer, &request);
                }
            }
        }
    }
    assert_eq!(server.get("/ready", &[]).status, 200);
}
