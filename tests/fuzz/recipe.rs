//! Fuzzes `pipeline::recipe::Recipe::from_json` and `pipeline::Checked`. The first byte of an
//! input says how the rest is read: 0 a whole document, 1 edits of the default recipe, separated by
//! zero bytes, each a byte that picks a field and JSON to put there (so that nearly every input
//! reaches the checks).

#![no_main]

use libfuzzer_sys::fuzz_target;
use poselight::pipeline::recipe::Recipe;
use poselight::pipeline::{Checked, Hashes};
use serde_json::Value;

fuzz_target!(|data: &[u8]| {
    let Some((way, rest)) = data.split_first() else { return };
    let parsed = match way % 2 {
        0 => Recipe::from_json(rest),
        _ => Recipe::from_json(edited(rest).to_string().as_bytes()),
    };
    let Ok(recipe) = parsed else { return };
    if Checked::new(&recipe).is_ok() {
        use_recipe(&recipe);
    }
});

/// The default recipe with some of its fields changed.
fn edited(edits: &[u8]) -> Value {
    let mut document = serde_json::to_value(Recipe::default()).expect("the default is JSON");
    for edit in edits.split(|&byte| byte == 0) {
        let Some((field, text)) = edit.split_first() else { continue };
        let Ok(value) = serde_json::from_slice(text) else { continue };
        let mut fields = Vec::new();
        leaves(&document, &mut String::new(), &mut fields);
        let Some(turn) = usize::from(*field).checked_rem(fields.len()) else { continue };
        if let Some(place) = document.pointer_mut(&fields[turn]) {
            *place = value;
        }
    }
    document
}

/// JSON pointers of every value that is no object.
fn leaves(value: &Value, path: &mut String, found: &mut Vec<String>) {
    let Value::Object(fields) = value else { return found.push(path.clone()) };
    for (name, value) in fields {
        let length = path.len();
        // Names that need escaping come from edits only; they are left alone.
        if !name.contains(['~', '/']) {
            path.push('/');
            path.push_str(name);
            leaves(value, path, found);
            path.truncate(length);
        }
    }
}

/// A recipe that passed its checks is written and read without a change, and keeps its hashes.
fn use_recipe(recipe: &Recipe) {
    let json = serde_json::to_vec(recipe).expect("a checked recipe is JSON");
    let again = Recipe::from_json(&json).expect("what we write we read");
    assert_eq!(&again, recipe);
    assert_eq!(Hashes::of("scene", &again), Hashes::of("scene", recipe));
    assert!(Checked::new(&again).is_ok(), "still sound");
}
