//! Damaged and hostile data sets end in an error that names the place, never in a panic.

use std::fs;

use super::*;
use crate::num::random::Stream;

/// Opens and reads everything there is, as a fit would.
fn read_all(path: &Path) -> Result<(), Error> {
    let dataset = Dataset::open(path)?;
    dataset.sources()?;
    let layout = dataset.header().layout;
    let mut row = vec![0.0; layout.points * layout.row()];
    for pose in 0..layout.poses {
        dataset.read_points(&[pose], 0..layout.points, &mut row)?;
    }
    dataset.training()?;
    Ok(())
}

/// A baked data set, and the change of one of its files.
struct Victim {
    folder: tempfile::TempDir,
}

impl Victim {
    fn new() -> Self {
        let folder = folder();
        bake(folder.path(), LAYOUT).unwrap();
        Self { folder }
    }

    /// The error after `name` was given other bytes; restores them.
    fn with(&self, name: &str, bytes: &[u8]) -> Result<(), Error> {
        let path = self.folder.path().join(name);
        let before = fs::read(&path).unwrap();
        fs::write(&path, bytes).unwrap();
        let result = read_all(self.folder.path());
        fs::write(&path, before).unwrap();
        result
    }

    /// As [`Victim::with`], by replacing the one occurrence of a text.
    fn replacing(&self, name: &str, from: &str, to: &str) -> Error {
        let text = fs::read_to_string(self.folder.path().join(name)).unwrap();
        assert!(text.contains(from), "{name} has no `{from}`: {text}");
        self.with(name, text.replacen(from, to, 1).as_bytes()).unwrap_err()
    }
}

/// Lies in the header: each is refused by an error that names the field.
#[test]
fn hostile_header() {
    let victim = Victim::new();
    for (from, to, named) in [
        ("\"poses\": 10", "\"poses\": -10", "poses"),
        ("\"poses\": 10", "\"poses\": 0", "poses"),
        ("\"poses\": 10", "\"poses\": 1e30", "poses"),
        ("\"poses\": 10", "\"poses\": 18446744073709551615", "poses"),
        ("\"poses\": 10", "\"poses\": 99999999999999999999999", "poses"),
        ("\"poses\": 10", "\"posers\": 10", "poses"),
        ("\"poses\": 10", "\"poses\": 11", "shape"),
        ("\"points\": 5", "\"points\": 134217728", "shape"),
        ("\"block_poses\": 4", "\"block_poses\": 0", "block_poses"),
        ("\"block_poses\": 4", "\"block_poses\": 5", "chunk_grid"),
        ("\"coefficients\": 4", "\"coefficients\": 9", "coefficients"),
        ("\"parameters\": 3", "\"parameters\": 4", "parameter_names"),
        ("\"order\": 2", "\"order\": 0", "order"),
        ("\"order\": 2", "\"order\": 300", "order"),
        ("\"signal\": \"transfer\"", "\"signal\": \"glow\"", "signal"),
        ("\"walk\"", "7", "clip_names"),
        ("\"bake\": \"bake-1\"", "\"baked\": \"x\"", "hashes"),
        ("\"first_vertex\": 0", "\"first_vertex\": 1", "parts"),
        ("\"vertices\": 6\n      }", "\"vertices\": 18446744073709551615\n      }", "parts"),
        ("\"polarity\": \"V = 1", "\"polarity\": \"V = 0", "conventions"),
        ("\"format\": \"poselight-dataset\"", "\"format\": \"other\"", "format"),
        ("\"zarr_format\": 3", "\"zarr_format\": 2", "zarr_format"),
        ("\"node_type\": \"group\"", "\"node_type\": \"array\"", "node_type"),
    ] {
        let text = victim.replacing("zarr.json", from, to).to_string();
        assert!(text.contains(named), "{from} → {to}: {text}");
    }
}

/// Lies in an array's metadata: the error names array and field.
#[test]
fn hostile_arrays() {
    let victim = Victim::new();
    for (array, from, to, field) in [
        ("coefficients", "\"float32\"", "\"float64\"", "data_type"),
        ("noise", "\"NaN\"", "0", "fill_value"),
        ("rays", "\"little\"", "\"big\"", "codecs"),
        ("clip", "\"shape\": [\n    10", "\"shape\": [\n    -10", "shape"),
        ("clip", "\"shape\": [\n    10", "\"shape\": [\n    1e300", "shape"),
        ("clip", "\"shape\": [\n    10\n  ],", "", "shape"),
        ("clip", "\"pose\"", "\"vertex\"", "dimension_names"),
        ("position", "\".\"", "\"/\"", "chunk_key_encoding"),
        ("source/file0", "figure.gltf", "other.gltf", "name"),
        ("split", "\"node_type\"", "\"node\"", "node_type"),
    ] {
        let error = victim.replacing(&format!("{array}/zarr.json"), from, to);
        let Error::Field { path, field: named, .. } = &error else { panic!("{error}") };
        assert!(path.ends_with(format!("{array}/zarr.json")), "{error}");
        assert_eq!(named, field, "{error}");
    }
    for bytes in ["-1", "1e18", "18446744073709551615", "\"many\""] {
        let to = format!("\"bytes\": {bytes}");
        let sources = victim.replacing("source/zarr.json", "\"bytes\": 11", &to);
        assert!(sources.to_string().contains("`bytes`"), "{sources}");
    }
    let sources = victim.replacing("source/zarr.json", "\"bytes\": 11", "\"bytes\": 12");
    assert!(sources.to_string().contains("file0"), "{sources}");
}

/// Every truncation of every metadata file, and files that are no JSON, are errors.
#[test]
fn truncated_metadata() {
    let victim = Victim::new();
    for (name, bytes) in tree(victim.folder.path()) {
        if name.ends_with("zarr.json") {
            // The line feed at the end is the one byte that nothing depends on.
            for length in (0..bytes.len() - 1).step_by(13) {
                let error = victim.with(&name, &bytes[..length]).unwrap_err();
                assert!(matches!(error, Error::Json { .. }), "{name} of {length} bytes: {error}");
            }
            let deep = "[".repeat(100_000);
            victim.with(&name, deep.as_bytes()).unwrap_err();
            victim.with(&name, b"null").unwrap_err();
        }
    }
    let error = victim.with("clip/zarr.json", &vec![b' '; 2 << 20]).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
}

/// A chunk that is shorter or longer by a byte, or gone, is named.
#[test]
fn chunks_of_the_wrong_size() {
    let victim = Victim::new();
    for (name, bytes) in tree(victim.folder.path()) {
        if name.ends_with("zarr.json") {
            continue;
        }
        let longer = [&bytes[..], &[0]].concat();
        for damaged in [&bytes[..0], &bytes[..bytes.len() - 1], &longer] {
            let error = victim.with(&name, damaged).unwrap_err();
            let Error::ChunkSize { path, found, .. } = &error else { panic!("{error}") };
            assert!(path.ends_with(&name), "{error}");
            assert_eq!(*found, damaged.len() as u64);
        }
        let path = victim.folder.path().join(&name);
        fs::remove_file(&path).unwrap();
        let error = read_all(victim.folder.path()).unwrap_err();
        fs::create_dir(&path).unwrap();
        read_all(victim.folder.path()).unwrap_err();
        fs::remove_dir(&path).unwrap();
        fs::write(&path, bytes).unwrap();
        if name.starts_with("coefficients") {
            assert!(matches!(error, Error::MissingBlock { .. }), "{error}");
        } else {
            assert!(matches!(error, Error::ChunkMissing { .. }), "{error}");
        }
    }
    read_all(victim.folder.path()).unwrap();
}

/// NaN and infinity within a committed block: the error says which pose and point.
#[test]
fn not_a_number_in_a_block() {
    let victim = Victim::new();
    for (name, offset, pose, point) in
        [("coefficients/c.1.0.0.0", ((2 * 5) + 3) * 4 + 1, 6, 3), ("noise/c.0.0", 5 + 4, 1, 4)]
    {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut bytes = fs::read(victim.folder.path().join(name)).unwrap();
            bytes[offset * 4..][..4].copy_from_slice(&bad.to_le_bytes());
            let error = victim.with(name, &bytes).unwrap_err();
            let Error::NotFinite { pose: p, point: q, path, .. } = &error else {
                panic!("{error}")
            };
            assert_eq!((*p, *q), (pose, point), "{error}");
            assert!(path.ends_with(name));
        }
    }
}

/// Indices, splits and rotations out of their range in the tables are named.
#[test]
fn values_out_of_range() {
    let victim = Victim::new();
    for (name, width, bad) in [
        ("clip/c.0", 4, 2_i32.to_le_bytes()),
        ("clip/c.0", 4, (-2_i32).to_le_bytes()),
        ("split/c.0", 1, [4; 4]),
        ("bone_of_point/c.0", 4, 65536_i32.to_le_bytes()),
        ("bone_of_point/c.0", 4, (-1_i32).to_le_bytes()),
        ("point_of_vertex/c.0", 4, 5_i32.to_le_bytes()),
        ("vertex_of_point/c.0", 4, 6_i32.to_le_bytes()),
        ("vertices_of_triangle/c.0.0", 4, (-1_i32).to_le_bytes()),
        ("bone_rotation/c.0.0.0", 4, 3_f32.to_le_bytes()),
        ("root_rotation/c.0.0", 4, f32::NAN.to_le_bytes()),
        ("parameters/c.0.0", 4, f32::NAN.to_le_bytes()),
        ("time_s/c.0", 4, f32::INFINITY.to_le_bytes()),
    ] {
        let mut bytes = fs::read(victim.folder.path().join(name)).unwrap();
        bytes[width..2 * width].copy_from_slice(&bad[..width]);
        let error = victim.with(name, &bytes).unwrap_err();
        let Error::Value { array, .. } = &error else { panic!("{name}: {error}") };
        assert!(name.starts_with(array), "{error}");
    }
}

/// Random bytes changed anywhere: reading ends, and without a panic. Seed 1.
#[test]
fn random_damage() {
    let victim = Victim::new();
    let mut random = Stream::new(1);
    let files: Vec<(String, Vec<u8>)> = tree(victim.folder.path()).into_iter().collect();
    for _ in 0..3000 {
        let (name, bytes) = &files[random.next_u64() as usize % files.len()];
        let mut bytes = bytes.clone();
        for _ in 0..=random.next_u64() % 3 {
            let at = random.next_u64() as usize % bytes.len();
            bytes[at] = (random.next_u64() >> 17) as u8;
        }
        let _ = victim.with(name, &bytes);
    }
    read_all(victim.folder.path()).unwrap();
}

/// What is handed in for writing is checked as well: lengths, values, and zero poses.
#[test]
fn wrong_input() {
    let place = folder();
    let open = |header: &Header, tables: &Static| Writer::open(place.path(), header, tables).err();
    let mut short = statics(&LAYOUT);
    short.poses.times_s.pop();
    let error = open(&header(LAYOUT), &short).unwrap();
    assert!(matches!(error, Error::Length { array: "time_s", expected: 10, found: 9 }), "{error}");
    let mut zero = statics(&LAYOUT);
    zero.poses.bone_rotations[3] = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    let error = open(&header(LAYOUT), &zero).unwrap();
    assert!(matches!(error, Error::Value { array: "bone_rotation", index: 3, .. }), "{error}");
    let none = Layout { poses: 0, ..LAYOUT };
    let error = open(&header(none), &statics(&none)).unwrap();
    assert!(matches!(error, Error::Layout { field: "poses", found: 0, .. }), "{error}");
    assert!(tree(place.path()).is_empty());
    // A header that no reader would take is not written in the first place.
    let mut endless = header(LAYOUT);
    endless.attributes.recipe = json!("x".repeat(65 << 20));
    let error = open(&endless, &statics(&LAYOUT)).unwrap();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    assert!(!place.path().join("zarr.json").exists());

    let mut writer = Writer::open(place.path(), &header(LAYOUT), &statics(&LAYOUT)).unwrap();
    let mut poses = block(&LAYOUT, 1);
    poses[2].coefficients[7] = f32::NAN;
    let error = writer.commit(1, &borrow(&poses)).unwrap_err();
    assert!(matches!(error, Error::NotFinite { pose: 6, point: 1, .. }), "{error}");
    assert_eq!(writer.missing_blocks(), [0, 1, 2]);
}

/// A data set without a training pose, or with one still missing, gives no training set.
#[test]
fn no_training() {
    let place = folder();
    drop(Writer::open(place.path(), &header(LAYOUT), &statics(&LAYOUT)).unwrap());
    let error = Dataset::open(place.path()).unwrap().training().unwrap_err();
    assert!(matches!(error, Error::MissingBlock { block: 0, .. }), "{error}");
    let place = folder();
    let mut held_out = statics(&LAYOUT);
    held_out.poses.splits.fill(1);
    drop(Writer::open(place.path(), &header(LAYOUT), &held_out).unwrap());
    let error = Dataset::open(place.path()).unwrap().training().unwrap_err();
    assert!(matches!(error, Error::NoTraining { .. }), "{error}");
}
