//! What a data set's recipe says otherwise than the one at hand.

use std::path::Path;

use serde_json::Value;

use super::recipe::BakeRecipe;
use super::{Error, Job};
use crate::dataset::{self, Dataset};

/// The parts of a recipe that a data set's bytes depend on.
const PARTS: [&str; 3] = ["subdivide", "poses", "bake"];

/// A refusal to continue a data set of another recipe, with the fields in which the recipes differ;
/// every other error as it is.
pub(super) fn explain(error: dataset::Error, path: &Path, job: &Job) -> Error {
    if !matches!(error, dataset::Error::OtherRecipe { .. }) {
        return error.into();
    }
    let Ok(dataset) = Dataset::open(path) else { return error.into() };
    let Ok(ours) = serde_json::to_value(&job.recipe) else { return error.into() };
    let attributes = &dataset.header().attributes;
    let mut found = Vec::new();
    if attributes.hashes.get("scene") != Some(&job.hashes.scene) {
        found.push("the scene's files are others".to_owned());
    }
    for part in PARTS {
        compare(&mut part.to_owned(), &attributes.recipe[part], &ours[part], &mut found);
    }
    if found.is_empty() {
        return error.into();
    }
    Error::OtherBake { path: path.to_owned(), differences: found.join("; ") }
}

/// The fields in which the bake of another recipe differs, with both values; nothing where none does.
pub(super) fn of_bakes(there: &BakeRecipe, here: &BakeRecipe) -> Option<String> {
    if there == here {
        return None;
    }
    let mut found = Vec::new();
    let value = |bake| serde_json::to_value(bake).unwrap_or_default();
    compare(&mut "bake".to_owned(), &value(there), &value(here), &mut found);
    Some(found.join("; "))
}

/// Every value that differs, by its path.
fn compare(path: &mut String, there: &Value, here: &Value, found: &mut Vec<String>) {
    if let (Value::Object(theirs), Value::Object(ours)) = (there, here) {
        let names = theirs.keys().chain(ours.keys().filter(|name| !theirs.contains_key(*name)));
        for name in names {
            let length = path.len();
            path.push('.');
            path.push_str(name);
            compare(path, &there[name], &here[name], found);
            path.truncate(length);
        }
    } else if there != here {
        found.push(format!("`{path}` is {} there and {} here", said(there), said(here)));
    }
}

fn said(value: &Value) -> String {
    // Numbers of single precision as they were written.
    let single = value.as_f64().map(|number| number as f32);
    match single.filter(|&single| value.is_f64() && Some(f64::from(single)) == value.as_f64()) {
        Some(single) => single.to_string(),
        None if value.is_null() => "absent".to_owned(),
        None => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// Fields are named with both values, those that one side lacks too, equal ones not at all.
    #[test]
    fn differences_are_named_with_both_values() {
        let there = json!({ "rays": 16, "noise": 0.1_f32, "order": 6, "clips": ["a"] });
        let here = json!({ "rays": 17, "noise": 0.05, "order": 6, "clips": ["a", "b"], "far": 2 });
        let mut found = Vec::new();
        compare(&mut "bake".to_owned(), &there, &here, &mut found);
        found.sort();
        assert_eq!(
            found,
            [
                "`bake.clips` is [\"a\"] there and [\"a\",\"b\"] here",
                "`bake.far` is absent there and 2 here",
                "`bake.noise` is 0.1 there and 0.05 here",
                "`bake.rays` is 16 there and 17 here",
            ]
        );
    }
}
