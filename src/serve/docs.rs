//! `/docs`: the document of the interface as one page for people, made here, without a script and
//! without anything from elsewhere.

use std::fmt::Write;
use std::sync::LazyLock;

use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use serde_json::Value;

use super::health::document;
use super::problem::KINDS;

/// What the page may do: show itself.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'";

const STYLE: &str = "body{font-family:sans-serif;max-width:70em;margin:2em auto;padding:0 1em}\
    :root{color-scheme:light dark}pre{overflow-x:auto;padding:.5em;border:1px solid #8888}\
    code{font-weight:bold}summary{cursor:pointer;padding:.3em 0}td,th{text-align:left;padding:.1em \
    1em .1em 0;vertical-align:top}";

/// The way of a scene to values, as README has it, where it is run by a test.
const EXAMPLE: &str = r#"sum=$(sha256sum hero.glb | cut -d" " -f1)
curl -fT hero.glb "localhost:7878/v1/assets/$sum?name=hero.glb"
job=$(curl -f localhost:7878/v1/jobs -d '{"kind": "run", "assets": {"hero.glb": "'$sum'"},
    "recipe": {"version": 1, "poses": {"rate_hz": 10}, "bake": {"rays": 64},
        "target": {"reference_poses": 10}}}' | jq -r .id)
curl -fN localhost:7878/v1/jobs/$job/events
model=$(curl -f localhost:7878/v1/jobs/$job | jq -r .result.href)
curl -fo hero.safetensors localhost:7878$model/blob
curl -f localhost:7878$model/evaluate -d '{"vertices": [0, 1], "poses": [{"joints": {}}]}'
"#;

static PAGE: LazyLock<String> = LazyLock::new(|| page(document()));

pub(super) async fn get() -> Response {
    let mut response = PAGE.as_str().into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8"));
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    response
}

fn page(document: &Value) -> String {
    let mut out = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Poselight's interface</title>\
         <style>{STYLE}</style><h1>Poselight's interface</h1><p>{}<p>The same for programs: \
         <a href=\"/openapi.json\">/openapi.json</a>.<h2>From a scene to values</h2><p>Upload, submit, \
         watch, download, evaluate; where the service has tokens each line sends one \
         (<code>-H \"Authorization: Bearer $POSELIGHT_TOKEN\"</code>), and \
         <code>?dry_run=true</code> at the second line says what the job would cost.<pre>{}</pre>\
         <h2>Paths</h2>",
        prose(text(&document["info"]["description"])),
        escape(EXAMPLE)
    );
    for (path, methods) in document["paths"].as_object().into_iter().flatten() {
        for (method, operation) in methods.as_object().into_iter().flatten() {
            show_operation(&mut out, method, path, operation);
        }
    }
    out += "<h2>Problems</h2><table>";
    for (kind, title) in KINDS {
        let _ = write!(out, "<tr><td><code>/problems/{kind}</code><td>{}", escape(title));
    }
    out += "</table><h2>Documents</h2>";
    for (name, schema) in document["components"]["schemas"].as_object().into_iter().flatten() {
        let json = serde_json::to_string_pretty(schema).unwrap_or_default();
        let name = escape(name);
        let _ = write!(
            out,
            "<details id=\"{name}\"><summary><code>{name}</code> {}</summary><pre>{}</pre></details>",
            prose(text(&schema["description"])),
            escape(&json)
        );
    }
    out + "</html>\n"
}

fn show_operation(out: &mut String, method: &str, path: &str, operation: &Value) {
    let _ = write!(
        out,
        "<details><summary><code>{} {}</code> {}</summary>",
        escape(&method.to_uppercase()),
        escape(path),
        prose(text(&operation["summary"]))
    );
    let parameters = operation["parameters"].as_array();
    if let Some(parameters) = parameters {
        *out += "<table><tr><th>parameter<th>in<th>";
        for parameter in parameters {
            let cell = |name: &str| prose(text(&parameter[name]));
            let _ = write!(
                out,
                "<tr><td>{}<td>{}<td>{}",
                cell("name"),
                cell("in"),
                cell("description")
            );
        }
        *out += "</table>";
    }
    for (kind, content) in operation["requestBody"]["content"].as_object().into_iter().flatten() {
        let _ = write!(out, "<p>Takes {} {}", escape(kind), link(&content["schema"]));
        *out += &example(content);
    }
    *out += "<table>";
    for (status, response) in operation["responses"].as_object().into_iter().flatten() {
        let contents = response["content"].as_object().into_iter().flatten();
        let kinds: Vec<String> = contents
            .map(|(kind, content)| format!("{} {}", escape(kind), link(&content["schema"])))
            .collect();
        let what = match text(&response["$ref"]) {
            "" => prose(text(&response["description"])),
            _ => "<a href=\"#Problem\">a problem</a>".to_owned(),
        };
        let _ = write!(out, "<tr><td>{}<td>{what}<td>{}", escape(status), kinds.join("<br>"));
    }
    *out += "</table>";
    for (_, response) in operation["responses"].as_object().into_iter().flatten() {
        for (_, content) in response["content"].as_object().into_iter().flatten() {
            *out += &example(content);
        }
    }
    *out += "</details>";
}

/// An example of what is taken or given, where the document has one.
fn example(content: &Value) -> String {
    if !content["example"].is_object() {
        return String::new();
    }
    let example = serde_json::to_string_pretty(&content["example"]).unwrap_or_default();
    format!("<pre>{}</pre>", escape(&example))
}

/// A sentence of the document, its names as code.
fn prose(text: &str) -> String {
    let parts = text.split('`').map(escape).enumerate();
    let part = |(index, part): (usize, String)| match index % 2 {
        0 => part,
        _ => format!("<code>{part}</code>"),
    };
    parts.map(part).collect()
}

/// The name of a schema, which leads to it.
fn link(schema: &Value) -> String {
    let name = text(&schema["$ref"]).rsplit('/').next().map(escape).unwrap_or_default();
    if name.is_empty() { name } else { format!("<a href=\"#{name}\">{name}</a>") }
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example is README's, line by line, and so is known to work.
    #[test]
    fn the_example_is_readmes() {
        let readme = include_str!("../../README.md");
        let block = readme.split("```console\n").nth(1).and_then(|rest| rest.split("```").next());
        let block = block.expect("a block");
        let lines = block.lines().map(|line| line.strip_prefix("$ ").unwrap_or(line));
        assert!(lines.eq(EXAMPLE.lines()), "{block}");
        assert!(PAGE.contains(&escape(EXAMPLE)));
    }

    /// Every path and every schema is on the page, nothing is loaded from elsewhere, and every link
    /// leads somewhere on it.
    #[test]
    fn the_page_holds_the_whole_interface() {
        let document = document();
        for path in document["paths"].as_object().expect("paths").keys() {
            assert!(PAGE.contains(&escape(path)), "{path}");
        }
        for outside in ["http://", "https://", "<script", "<img", "<link"] {
            let named = PAGE.matches(outside).count();
            let own = escape(&document.to_string()).matches(&escape(outside)).count();
            assert!(named <= own, "{outside} is loaded");
        }
        for target in PAGE.split("href=\"#").skip(1) {
            let name = target.split('"').next().unwrap_or_default();
            assert!(PAGE.contains(&format!("id=\"{name}\"")), "{name} leads nowhere");
        }
    }
}
