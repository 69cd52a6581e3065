//! Reading metadata that may come from anybody: bounded, and every complaint names its field.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::Error;
use super::files::{self, Content};

/// Bound of an array's `zarr.json`.
pub(super) const ARRAY_BYTES: u64 = 1 << 20;
/// Bound of a group's `zarr.json`, which holds recipe, rig and names.
pub(super) const GROUP_BYTES: u64 = 64 << 20;

/// Writes the `zarr.json` of a folder, indented, unless readers would find it too large.
pub(super) fn write(folder: &Path, value: &Value, limit: u64) -> Result<(), Error> {
    let text = format!("{value:#}\n");
    let bytes = text.len() as u64;
    if bytes > limit {
        return Err(Error::TooLarge { path: folder.join("zarr.json"), bytes, limit });
    }
    files::replace(folder, "zarr.json", &Content::of(text.into_bytes()))
}

/// The object that a metadata file holds.
pub(super) fn object(path: &Path, limit: u64) -> Result<Map<String, Value>, Error> {
    let bytes = files::read_small(path, limit)?;
    let parsed: Result<Value, _> = serde_json::from_slice(&bytes);
    match parsed.map_err(|source| Error::Json { path: path.to_path_buf(), source })? {
        Value::Object(map) => Ok(map),
        other => Err(mismatch(path, "the whole file", "an object", Some(&other))),
    }
}

/// Refuses a field that is not exactly `expected`.
pub(super) fn expect(
    path: &Path,
    map: &Map<String, Value>,
    field: &str,
    expected: &Value,
) -> Result<(), Error> {
    match map.get(field) {
        Some(found) if found == expected => Ok(()),
        found => Err(mismatch(path, field, &shorten(&expected.to_string()), found)),
    }
}

/// A field of the given type; `expected` describes it in a message.
pub(super) fn field<T: DeserializeOwned>(
    path: &Path,
    map: &Map<String, Value>,
    field: &str,
    expected: &str,
) -> Result<T, Error> {
    let value = map.get(field).ok_or_else(|| mismatch(path, field, expected, None))?;
    T::deserialize(value).map_err(|_| mismatch(path, field, expected, Some(value)))
}

/// The error of a field that is `found`, or missing.
pub(super) fn mismatch(path: &Path, field: &str, expected: &str, found: Option<&Value>) -> Error {
    Error::Field {
        path: path.to_path_buf(),
        field: field.to_owned(),
        expected: expected.to_owned(),
        found: found.map_or_else(|| String::from("missing"), |value| shorten(&value.to_string())),
    }
}

/// A foreign text cut to the length that a message can carry.
fn shorten(text: &str) -> String {
    const LONGEST: usize = 80;
    let mut short: String = text.chars().take(LONGEST).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    short
}
