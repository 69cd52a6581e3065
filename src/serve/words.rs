//! Faults in the words of who sent the request: a type of ours, or a flag of the command line, tells a
//! client nothing.

/// Characters of a client's own text that are told back.
const MOST_TOLD: usize = 80;

/// Flags that stages name in their sentences, with the recipe's field of each.
const FIELDS: [(&str, &str); 5] = [
    ("--hold-out", "`poses.hold_out`"),
    ("--noise", "`bake.noise`"),
    ("--ground", "`bake.surroundings.ground`"),
    ("--rays", "`bake.rays`"),
    ("--keep-normals", "`bake.recompute_normals`: false"),
];

/// A stage's sentence with the recipe's fields in place of flags.
pub(super) fn in_fields(text: &str) -> String {
    FIELDS.iter().fold(text.to_owned(), |text, (flag, field)| text.replace(flag, field))
}

/// What is wrong with a value of a JSON document. Of a value in the wrong form its field tells the
/// place; of text that is no JSON the line does.
pub(super) fn of_json(error: &serde_json::Error) -> String {
    let text = error.to_string();
    if error.classify() != serde_json::error::Category::Data {
        return text;
    }
    let text = text.rsplit_once(" at line ").map_or(text.as_str(), |(text, _)| text);
    of_data(text)
}

/// The same of what follows a `?`.
pub(super) fn of_query(text: &str) -> String {
    let text = text.rsplit_once("query string: ").map_or(text, |(_, text)| text);
    let number = "a whole number is expected";
    ["invalid digit found in string", "cannot parse integer from empty string"]
        .iter()
        .fold(text.to_owned(), |text, digits| text.replace(digits, number))
}

fn of_data(text: &str) -> String {
    let Some((found, expected)) = text.split_once(", expected ") else { return shortened(text) };
    match found_in_words(found) {
        Some(found) => format!("it is {found}; {} is expected", expected_in_words(expected)),
        None => shortened(text),
    }
}

/// What was found, where a value has another type, range or length than it may have.
fn found_in_words(found: &str) -> Option<String> {
    if let Some(length) = found.strip_prefix("invalid length ") {
        return Some(format!("a list of {length}"));
    }
    let found = found.strip_prefix("invalid type: ").or(found.strip_prefix("invalid value: "))?;
    let number = ["integer `", "floating point `", "number `", "boolean `"];
    let number = number.iter().find_map(|kind| found.strip_prefix(kind)?.strip_suffix('`'));
    Some(match found {
        "map" => "an object".to_owned(),
        "sequence" => "a list".to_owned(),
        "null" | "unit value" => "null".to_owned(),
        _ => number.map_or_else(|| shortened(found), str::to_owned),
    })
}

/// What a type of ours is to who writes JSON.
fn expected_in_words(expected: &str) -> String {
    let whole = |most: &str| format!("a whole number from 0 to {most}");
    match expected {
        "a map" => "an object".to_owned(),
        "a sequence" => "a list".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        "i32" | "i64" => "a whole number".to_owned(),
        "u8" => whole("255"),
        "u16" => whole("65535"),
        "u32" => whole("4294967295"),
        "u64" | "usize" => "a whole number from 0".to_owned(),
        "string or map" | "variant identifier" => "one of its names".to_owned(),
        other => match other.strip_prefix("an array of length ") {
            Some(length) => format!("a list of {length}"),
            None if other.starts_with("struct ") => "an object".to_owned(),
            None if other.contains("enum ") => "one of its names".to_owned(),
            None => other.to_owned(),
        },
    }
}

fn shortened(text: &str) -> String {
    if text.chars().count() <= MOST_TOLD * 5 {
        return text.to_owned();
    }
    text.chars().take(MOST_TOLD).chain("…".chars()).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::Path;

    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Inner {
        #[serde(rename = "turn")]
        _turn: [f32; 4],
        #[serde(rename = "count", default)]
        _count: u32,
    }

    #[derive(Debug, Deserialize)]
    struct Outer {
        #[serde(rename = "inner")]
        _inner: Inner,
        #[serde(rename = "names", default)]
        _names: BTreeMap<String, Vec<bool>>,
    }

    /// No sentence names a type of ours, and each says what is and what should be.
    #[test]
    fn types_are_told_as_json() {
        let told = |text: &str| of_json(&serde_json::from_str::<Outer>(text).expect_err(text));
        for (text, expected) in [
            (r#"{"inner": 5}"#, "it is 5; an object is expected"),
            (r#"{"inner": "a"}"#, "it is string \"a\"; an object is expected"),
            (r#"{"inner": {"turn": [1, 2, 3]}}"#, "it is a list of 3; a list of 4 is expected"),
            (r#"{"inner": {"turn": {}}}"#, "it is an object; a list of 4 is expected"),
            (r#"{"inner": {"turn": [1, 2, 3, null]}}"#, "it is null; a number is expected"),
            (
                r#"{"inner": {"turn": [1, 2, 3, 4], "count": -1}}"#,
                "it is -1; a whole number from 0 to 4294967295 is expected",
            ),
            (
                r#"{"inner": {"turn": [1, 2, 3, 4]}, "names": {"a": [1]}}"#,
                "it is 1; true or false is expected",
            ),
            (r#"{"inner": {"turns": 1}}"#, "unknown field `turns`, expected `turn` or `count`"),
            (r#"{"inner": {}}"#, "missing field `turn`"),
        ] {
            assert_eq!(told(text), expected, "{text}");
        }
        let long = format!(r#"{{"inner": "{}"}}"#, "x".repeat(10_000));
        assert!(told(&long).len() < 200);
        assert!(told("{").contains("line 1"), "of what is no JSON the place is told");
        assert_eq!(
            of_query(
                "Failed to deserialize query string: page_size: invalid digit found in string"
            ),
            "page_size: a whole number is expected"
        );
    }

    /// Every flag that a stage behind a job names has its field here.
    #[test]
    fn no_stage_names_a_flag_without_a_field() {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        let folders = ["scene", "pose", "bake", "dataset", "fit", "measure", "choose", "pipeline"];
        let mut files: Vec<_> = folders.iter().map(|folder| source.join(folder)).collect();
        let mut found = 0;
        while let Some(path) = files.pop() {
            if path.is_dir() {
                let entries = std::fs::read_dir(&path).expect("listed");
                files.extend(entries.map(|entry| entry.expect("an entry").path()));
                continue;
            }
            let name = path.display().to_string();
            // What only the command line calls.
            let own = ["rebind", "pipeline/check", "tests", "subdivide"];
            if !name.ends_with(".rs") || own.iter().any(|own| name.contains(own)) {
                continue;
            }
            let text = std::fs::read_to_string(&path).expect("read");
            for line in text.lines().filter(|line| !line.trim_start().starts_with("//")) {
                for (at, _) in line.match_indices("--") {
                    if line[at + 2..].starts_with(|c: char| c.is_ascii_lowercase()) {
                        assert!(!in_fields(line)[at..].starts_with("--"), "{name}: {line}");
                        found += 1;
                    }
                }
            }
        }
        assert!(found > 0, "there are none: this proves nothing");
        let told = in_fields("held out: jump (drawn by the seed; --hold-out chooses)");
        assert_eq!(told, "held out: jump (drawn by the seed; `poses.hold_out` chooses)");
    }
}
