//! What is written is what is read, and only that.

use sha2::{Digest, Sha256};

use super::*;

/// Every table, source and block comes back as it went in; held-out poses and ranges of points
/// are addressed as documented.
#[test]
fn everything_comes_back() {
    let folder = folder();
    let path = folder.path().join("set");
    bake(&path, LAYOUT).unwrap();
    let dataset = Dataset::open(&path).unwrap();
    let expected = statics(&LAYOUT);
    assert_eq!(dataset.header(), &header(LAYOUT));
    assert_eq!(dataset.poses(), &expected.poses);
    assert_eq!(dataset.mesh(), &expected.mesh);
    assert_eq!(dataset.sources().unwrap(), expected.sources);
    assert!(dataset.is_complete());

    let poses = [9, 0, 1, 5, 4];
    let mut out = vec![0.0; poses.len() * 2 * 4];
    dataset.read_points(&poses, 2..4, &mut out).unwrap();
    let mut spread = vec![0.0; poses.len() * 3];
    dataset.read_noise(&poses, 1..4, &mut spread).unwrap();
    for (slot, &pose) in poses.iter().enumerate() {
        for (i, &found) in out[slot * 8..][..8].iter().enumerate() {
            assert_eq!(found, value(pose, 2 + i / 4, i % 4), "pose {pose}, value {i}");
        }
        for (i, &found) in spread[slot * 3..][..3].iter().enumerate() {
            assert_eq!(found, noise(pose, 1 + i), "pose {pose}, point {i}");
        }
    }
    dataset.read_points(&poses, 3..3, &mut []).unwrap();
    dataset.read_points(&[], 0..5, &mut []).unwrap();
}

/// A fit sees the poses of split `training` and their tables, and no others; the set on disk and
/// the one in memory answer alike.
#[test]
fn training_has_no_held_out_pose() {
    let folder = folder();
    bake(folder.path(), LAYOUT).unwrap();
    let dataset = Dataset::open(folder.path()).unwrap();
    let training = dataset.training().unwrap();
    let poses = [0, 1, 2, 4, 5, 6];
    assert_eq!(training.poses(), poses.len());
    assert_eq!(training.clips(), [0; 6]);
    let tables = statics(&LAYOUT).poses;
    for (slot, &pose) in poses.iter().enumerate() {
        let own = |width: usize| slot * width..(slot + 1) * width;
        let whole = |width: usize| pose * width..(pose + 1) * width;
        assert_eq!(training.parameters()[own(3)], tables.parameters[whole(3)]);
        assert_eq!(training.bone_rotations()[own(2)], tables.bone_rotations[whole(2)]);
    }
    let variance: f64 =
        (poses.iter().flat_map(|&pose| (0..5).map(move |point| noise(pose, point))))
            .map(|noise| f64::from(noise).powi(2))
            .sum::<f64>()
            / 30.0;
    assert!((training.noise_variance() - variance).abs() < 1e-15);

    let memory = Training::in_memory(TrainingParts {
        points: 5,
        channels: 1,
        coefficients: 4,
        bones: 2,
        parameters: training.parameters().to_vec(),
        parameter_names: training.parameter_names().to_vec(),
        clips: training.clips().to_vec(),
        bone_rotations: training.bone_rotations().to_vec(),
        point_bones: training.point_bones().to_vec(),
        noise_variance: variance,
        noise_of_points: Vec::new(),
        values: poses.iter().flat_map(|&index| pose(&LAYOUT, index).coefficients).collect(),
    });
    let (mut stored, mut copied) = (vec![0.0; 6 * 3 * 4], vec![1.0; 6 * 3 * 4]);
    training.read_points(1..4, &mut stored).unwrap();
    memory.read_points(1..4, &mut copied).unwrap();
    assert_eq!(stored, copied);
}

/// The same data gives the same files, byte for byte, and only the files of the format.
#[test]
fn bytes_are_reproducible() {
    let (one, two) = (folder(), folder());
    bake(one.path(), LAYOUT).unwrap();
    let mut writer = Writer::open(two.path(), &header(LAYOUT), &statics(&LAYOUT)).unwrap();
    for index in [2, 0, 1] {
        writer.commit(index, &borrow(&block(&LAYOUT, index))).unwrap();
    }
    let (one, two) = (tree(one.path()), tree(two.path()));
    assert_eq!(one, two);
    assert!(one.keys().all(|name| !name.contains("partial")), "{:?}", one.keys());
    // Padding of the last block: two poses of four are NaN, whole to the byte.
    let last = &one["coefficients/c.2.0.0.0"];
    assert_eq!(last.len(), 4 * 5 * 4 * 4);
    let tail: Vec<&[u8]> = last[last.len() / 2..].chunks(4).collect();
    assert!(tail.iter().all(|bytes| *bytes == f32::NAN.to_le_bytes()));
    assert_eq!(one["rays/c.2.0"][4 * 2 * 5..], [0; 4 * 2 * 5]);
}

/// A static scene has one pose and no parameter; the empty array has no chunk and opens.
#[test]
fn static_scene() {
    let layout = Layout { poses: 1, parameters: 0, ..LAYOUT };
    let folder = folder();
    bake(folder.path(), layout).unwrap();
    let dataset = Dataset::open(folder.path()).unwrap();
    assert!(dataset.parameters().is_empty());
    assert_eq!(dataset.training().unwrap().poses(), 1);
    assert!(!folder.path().join("parameters/c.0.0").exists());
}

/// The bytes on disk are pinned: a change of the format must be a change of its version. With
/// `POSELIGHT_BLESS` set the test writes the pinned files instead.
#[test]
fn bytes_are_golden() {
    let folder = folder();
    bake(folder.path(), LAYOUT).unwrap();
    let files = tree(folder.path());
    let text = |name: &str| String::from_utf8(files[name].clone()).unwrap();
    let digest = |bytes: &[u8]| -> String {
        Sha256::digest(bytes).iter().take(8).map(|byte| format!("{byte:02x}")).collect()
    };
    let list: String =
        files.iter().map(|(name, bytes)| format!("{} {name}\n", digest(bytes))).collect();
    for (name, found, golden) in [
        ("root.json", text("zarr.json"), include_str!("golden/root.json")),
        (
            "coefficients.json",
            text("coefficients/zarr.json"),
            include_str!("golden/coefficients.json"),
        ),
        ("files.txt", list, include_str!("golden/files.txt")),
    ] {
        if std::env::var_os("POSELIGHT_BLESS").is_some() {
            let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/dataset/tests/golden");
            std::fs::write(golden.join(name), found).unwrap();
        } else {
            assert_eq!(found, golden, "{name}");
        }
    }
}
