//! Values as answers. Large ones are written as they are sent: the numbers are there once, and a part
//! of their text, however many they are.

use std::convert::Infallible;

use axum::body::Body;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use serde_json::json;

use super::files;
use super::held::Held;
use crate::model::Distance;

/// The kind of an answer of raw numbers.
pub(super) const RAW: &str = "application/octet-stream";

/// Numbers that are written at once.
const CHUNK: usize = 16 << 10;

/// Values and how far to trust them.
pub(super) struct Values {
    /// `[pose, vertex, channel, coefficient]`, or `[pose, vertex, colour]` under a light.
    pub(super) shape: Vec<usize>,
    pub(super) values: Vec<f32>,
    pub(super) frame: &'static str,
    /// One per pose.
    pub(super) distances: Vec<Distance>,
    /// What is to be said of light and reflectance, in sentences.
    pub(super) notices: Vec<String>,
    /// What a distance's residual is to be compared with.
    pub(super) residual_rms: f32,
    /// Their room, which is free again when the last of them is written.
    pub(super) held: Option<Held>,
}

/// One JSON object, the values last.
pub(super) fn as_json(values: Values) -> Response {
    let distances = values.distances.iter().map(
        |distance| json!({ "mahalanobis": distance.mahalanobis, "residual": distance.residual }),
    );
    let mut about = json!({
        "shape": values.shape,
        "frame": values.frame,
        "distances": distances.collect::<Vec<_>>(),
        "training_residual_rms": values.residual_rms,
    });
    if !values.notices.is_empty() {
        about["notices"] = json!(values.notices);
    }
    let mut head = about.to_string();
    head.pop();
    head.push_str(",\"values\":[");
    let held = values.held;
    let numbers = chunks(values.values, move |part, is_first| {
        let _until_written = &held;
        write_json(part, is_first)
    });
    let parts = std::iter::once(head.into_bytes()).chain(numbers).chain([b"]}".to_vec()]);
    ([(header::CONTENT_TYPE, "application/json")], body(parts)).into_response()
}

/// The values as raw bytes; the rest in headers, the largest distance for all poses.
pub(super) fn as_bytes(values: Values) -> Response {
    let shape: Vec<String> = values.shape.iter().map(ToString::to_string).collect();
    let most = |of: fn(&Distance) -> f32| values.distances.iter().map(of).fold(0.0, f32::max);
    let (mahalanobis, residual) = (most(|d| d.mahalanobis), most(|d| d.residual));
    let length = HeaderValue::from(4 * values.values.len() as u64);
    let held = values.held;
    let numbers = chunks(values.values, move |part, _| {
        let _until_written = &held;
        little_endian(part)
    });
    let mut response = ([(header::CONTENT_TYPE, RAW)], body(numbers)).into_response();
    response.headers_mut().insert(header::CONTENT_LENGTH, length);
    let notices = values.notices.join("; ");
    let response = match notices.is_empty() {
        true => response,
        false => files::with(response, "poselight-notices", &notices),
    };
    let response = files::with(response, "poselight-shape", &shape.join(","));
    let response = files::with(response, "poselight-frame", values.frame);
    let response = files::with(response, "poselight-mahalanobis-max", &mahalanobis.to_string());
    files::with(response, "poselight-residual-max", &residual.to_string())
}

/// The numbers as raw bytes.
pub(super) fn little_endian(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Parts of a body that is written at once: a head, some numbers and an end.
const FEW: usize = 4;

/// Parts of a body; few are sent as one, whose length is told.
fn body(mut parts: impl Iterator<Item = Vec<u8>> + Send + 'static) -> Body {
    let few: Vec<Vec<u8>> = parts.by_ref().take(FEW).collect();
    if few.len() < FEW {
        return Body::from(few.concat());
    }
    let all = few.into_iter().chain(parts).map(Ok::<_, Infallible>);
    Body::from_stream(stream::iter(all))
}

/// Numbers written part by part; `write` is told whether it is the first.
fn chunks(
    values: Vec<f32>,
    write: impl Fn(&[f32], bool) -> Vec<u8> + Send + 'static,
) -> impl Iterator<Item = Vec<u8>> + Send + 'static {
    (0..values.len().div_ceil(CHUNK)).map(move |index| {
        let first = index * CHUNK;
        let last = values.len().min(first + CHUNK);
        write(&values[first..last], index == 0)
    })
}

/// Numbers as a part of a JSON list, each with all the digits of its f64.
fn write_json(values: &[f32], is_first: bool) -> Vec<u8> {
    let mut out = Vec::with_capacity(20 * values.len());
    for (index, value) in values.iter().enumerate() {
        if index > 0 || !is_first {
            out.push(b',');
        }
        let start = out.len();
        if serde_json::to_writer(&mut out, &f64::from(*value)).is_err() {
            // Writing to memory does not fail; a list must not lack a number if it did.
            out.truncate(start);
            out.extend_from_slice(b"null");
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A list that is written in parts is the list, whatever its length and its numbers.
    #[test]
    fn parts_make_the_list() {
        for length in [0, 1, CHUNK - 1, CHUNK, CHUNK + 1, 5 * CHUNK + 3] {
            let values: Vec<f32> = (0..length)
                .map(|index| match index % 5 {
                    0 => -0.0,
                    1 => 1e-38 * index as f32,
                    2 => f32::MAX / (index + 1) as f32,
                    3 => f32::NAN,
                    _ => 0.1 * index as f32,
                })
                .collect();
            let text: Vec<u8> = chunks(values.clone(), write_json).flatten().collect();
            let text = format!("[{}]", String::from_utf8(text).expect("text"));
            let expected = json!(values).to_string();
            assert!(text == expected, "{length} numbers");
            let bytes: Vec<u8> =
                chunks(values.clone(), |part, _| little_endian(part)).flatten().collect();
            assert!(bytes == little_endian(&values), "{length} numbers");
        }
    }

    /// Few values are one body of a known length, many are sent as they are written.
    #[test]
    fn many_values_are_not_held_as_text() {
        let values = |count| Values {
            shape: vec![1, count],
            values: vec![0.5; count],
            frame: "root",
            distances: vec![Distance { mahalanobis: 1.0, residual: 2.0 }],
            residual_rms: 0.25,
            notices: vec!["the map is black".to_owned()],
            held: None,
        };
        let known =
            |response: Response| hyper::body::Body::size_hint(response.body()).exact().is_some();
        assert!(known(as_json(values(100))) && known(as_bytes(values(100))));
        assert!(!known(as_json(values(10 * CHUNK))) && !known(as_bytes(values(10 * CHUNK))));
        assert_eq!(as_bytes(values(1)).headers()["poselight-notices"], "the map is black");
        let length = as_bytes(values(10 * CHUNK)).headers()[header::CONTENT_LENGTH].clone();
        assert_eq!(length, (40 * CHUNK).to_string());
    }
}
