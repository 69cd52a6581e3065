//! A writer may be killed anywhere; the next one finishes the same bytes.

use super::*;

/// Stops a bake after every single change it makes to the disk (create, half a write, flush,
/// rename, remove), continues it, and compares with an undisturbed bake. After the stop, no reader
/// finds a block that was not committed whole.
#[test]
fn every_stop_continues_to_the_same_bytes() {
    let undisturbed = folder();
    bake(undisturbed.path(), LAYOUT).unwrap();
    let expected = tree(undisturbed.path());
    let mut steps = 0;
    loop {
        let stopped = folder();
        let path = stopped.path().join("set");
        interruption::after(Some(steps));
        let result = bake(&path, LAYOUT);
        interruption::after(None);
        if result.is_ok() {
            break;
        }
        check_committed(&path);
        bake(&path, LAYOUT).unwrap();
        assert_eq!(tree(&path), expected, "stopped after {steps} changes");
        steps += 1;
    }
    assert!(steps > 200, "the bake made {steps} changes only");
}

/// Whatever a reader gets from a stopped data set is right.
fn check_committed(path: &Path) {
    match Dataset::open(path) {
        Err(error) => assert!(matches!(error, Error::NotADataset { .. }), "{error}"),
        Ok(dataset) => {
            let missing = dataset.missing_blocks();
            for index in 0..LAYOUT.blocks() {
                let poses: Vec<usize> = LAYOUT.poses_of(index).collect();
                let mut out = vec![0.0; poses.len() * 5 * 4];
                let read = dataset.read_points(&poses, 0..5, &mut out);
                assert_eq!(read.is_err(), missing.contains(&index), "block {index}");
                if read.is_ok() {
                    let all: Vec<f32> =
                        poses.iter().flat_map(|&p| pose(&LAYOUT, p).coefficients).collect();
                    assert_eq!(out, all);
                }
            }
        }
    }
}

/// Stopped again and again, each time a little further, it still ends with the same bytes.
#[test]
fn many_stops_in_a_row() {
    let undisturbed = folder();
    bake(undisturbed.path(), LAYOUT).unwrap();
    let stopped = folder();
    for steps in (1..).step_by(7) {
        interruption::after(Some(steps));
        let result = bake(stopped.path(), LAYOUT);
        interruption::after(None);
        if result.is_ok() {
            break;
        }
    }
    assert_eq!(tree(stopped.path()), tree(undisturbed.path()));
}

/// An interrupted creation leaves nothing of its own to a different bake in the same folder.
#[test]
fn interrupted_creation_gives_way() {
    let other = Layout { poses: 4, ..LAYOUT };
    let expected = folder();
    bake(expected.path(), other).unwrap();
    let place = folder();
    interruption::after(Some(150));
    bake(place.path(), LAYOUT).unwrap_err();
    interruption::after(None);
    assert!(!place.path().join("zarr.json").exists());
    bake(place.path(), other).unwrap();
    assert_eq!(tree(place.path()), tree(expected.path()));
}

/// Block size is in no hash: a continued bake keeps the one of the data set.
#[test]
fn block_size_of_the_data_set_stands() {
    let place = folder();
    drop(Writer::open(place.path(), &header(LAYOUT), &statics(&LAYOUT)).unwrap());
    let other = Layout { block_poses: 3, ..LAYOUT };
    let writer = Writer::open(place.path(), &header(other), &statics(&other)).unwrap();
    assert_eq!(writer.layout(), &LAYOUT);
    assert_eq!(writer.missing_blocks(), [0, 1, 2]);
}

/// Parts of the recipe that no byte of a bake depends on may differ; the hash decides.
#[test]
fn recipe_text_may_differ() {
    let place = folder();
    bake(place.path(), LAYOUT).unwrap();
    let before = tree(place.path());
    let mut header = header(LAYOUT);
    header.attributes.recipe = json!({"version": 1, "fit": {"family": "mean"}});
    header.attributes.hashes.insert(String::from("fit"), String::from("f"));
    let writer = Writer::open(place.path(), &header, &statics(&LAYOUT)).unwrap();
    assert!(writer.missing_blocks().is_empty());
    assert_eq!(tree(place.path()), before);
}

/// Another recipe, named by the stage whose hash differs with both hashes.
#[test]
fn other_recipe_is_refused() {
    let place = folder();
    drop(Writer::open(place.path(), &header(LAYOUT), &statics(&LAYOUT)).unwrap());
    let before = tree(place.path());
    for stage in ["scene", "bake"] {
        let mut header = header(LAYOUT);
        header.attributes.hashes.insert(stage.to_owned(), String::from("2"));
        let error = Writer::open(place.path(), &header, &statics(&LAYOUT)).unwrap_err();
        let Error::OtherRecipe { stage: named, expected, found, .. } = &error else {
            panic!("{error}")
        };
        assert_eq!((named.as_str(), expected.as_str()), (stage, "2"));
        assert_eq!(found, &format!("{stage}-1"));
    }
    assert_eq!(tree(place.path()), before);
}

/// Equal hashes with other tables: another build's arithmetic, or damage. Both are refused.
#[test]
fn other_content_is_refused() {
    let place = folder();
    drop(Writer::open(place.path(), &header(LAYOUT), &statics(&LAYOUT)).unwrap());
    let mut tables = statics(&LAYOUT);
    tables.poses.parameters[4] += 1e-6;
    let error = Writer::open(place.path(), &header(LAYOUT), &tables).unwrap_err();
    assert!(matches!(&error, Error::OtherContent { what, .. } if what.contains("parameters")));
    let mut renamed = header(LAYOUT);
    renamed.attributes.clip_names[0] = String::from("run");
    let error = Writer::open(place.path(), &renamed, &statics(&LAYOUT)).unwrap_err();
    assert!(matches!(&error, Error::OtherContent { what, .. } if what.contains("clip_names")));
}

/// Another format version is refused for writing and for reading.
#[test]
fn other_version_is_refused() {
    let place = folder();
    bake(place.path(), LAYOUT).unwrap();
    let path = place.path().join("zarr.json");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("\"format_version\": 1", "\"format_version\": 2")).unwrap();
    for error in [
        Writer::open(place.path(), &header(LAYOUT), &statics(&LAYOUT)).unwrap_err(),
        Dataset::open(place.path()).unwrap_err(),
    ] {
        assert!(matches!(error, Error::Version { found: 2, supported: 1, .. }), "{error}");
    }
}
