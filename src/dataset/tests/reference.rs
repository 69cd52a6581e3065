//! The reference group: round trip, restart, refusals.

use super::*;

fn header_of(poses: &[usize]) -> ReferenceHeader {
    ReferenceHeader {
        poses: poses.to_vec(),
        rays: 4000,
        seeds: [1 << 60, 2],
        hash: String::from("reference-1"),
    }
}

fn values(seed: usize, pose: usize) -> (Vec<f32>, Vec<f32>, Vec<Vec3>) {
    let value = |i: usize| (seed * 100 + pose) as f32 + i as f32 * 0.01;
    let coefficients = (0..20).map(value).collect();
    (coefficients, vec![0.001 * (seed + 1) as f32; 5], vec![Vec3::new(0.6, pose as f32, 0.8); 5])
}

fn finish(path: &Path) -> Result<(), Error> {
    let dataset = Dataset::open(path)?;
    let mut reference = Reference::open_or_create(&dataset, &header_of(&[1, 7, 8]))?;
    for (seed, index) in reference.missing() {
        let (coefficients, noise, normals) = values(seed, [1, 7, 8][index]);
        let data = ReferencePose { coefficients: &coefficients, noise: &noise, normals: &normals };
        reference.commit(seed, index, &data)?;
    }
    Ok(())
}

/// Both seeds, noise and normals come back; what is not committed is an error that names it.
#[test]
fn everything_comes_back() {
    let place = folder();
    bake(place.path(), LAYOUT).unwrap();
    let dataset = Dataset::open(place.path()).unwrap();
    assert!(matches!(Reference::open(&dataset).unwrap_err(), Error::NoReference { .. }));
    drop(Reference::open_or_create(&dataset, &header_of(&[1, 7, 8])).unwrap());
    let reference = Reference::open(&dataset).unwrap();
    assert_eq!(reference.missing(), [(0, 0), (1, 0), (0, 1), (1, 1), (0, 2), (1, 2)]);
    let error = reference.read(1, 1, &mut [0.0; 20]).unwrap_err();
    assert!(matches!(error, Error::MissingReference { seed: 1, pose: 7, .. }), "{error}");

    finish(place.path()).unwrap();
    let reference = Reference::open(&dataset).unwrap();
    assert!(reference.is_complete());
    assert_eq!(reference.header(), &header_of(&[1, 7, 8]));
    for (index, pose) in [1, 7, 8].into_iter().enumerate() {
        for seed in 0..2 {
            let (mut out, mut noise) = (vec![0.0; 20], vec![0.0; 5]);
            reference.read(seed, index, &mut out).unwrap();
            reference.read_noise(seed, index, &mut noise).unwrap();
            let normals = reference.read_normals(index).unwrap();
            assert_eq!((out, noise, normals), values(seed, pose));
        }
    }
}

/// Stopped after every single change to the disk, it continues to the same bytes.
#[test]
fn every_stop_continues_to_the_same_bytes() {
    let start = folder();
    let expected = folder();
    bake(expected.path(), LAYOUT).unwrap();
    finish(expected.path()).unwrap();
    let expected = tree(expected.path());
    let mut steps = 0;
    bake(start.path(), LAYOUT).unwrap();
    loop {
        let _ = std::fs::remove_dir_all(start.path().join("reference"));
        interruption::after(Some(steps));
        let result = finish(start.path());
        interruption::after(None);
        finish(start.path()).unwrap();
        assert_eq!(tree(start.path()), expected, "stopped after {steps} changes");
        if result.is_ok() {
            break;
        }
        steps += 1;
    }
    assert!(steps > 100, "{steps}");
}

/// A reference with other settings, or of another bake, is refused; so are two writers.
#[test]
fn refusals() {
    let place = folder();
    bake(place.path(), LAYOUT).unwrap();
    let dataset = Dataset::open(place.path()).unwrap();
    let held = Reference::open_or_create(&dataset, &header_of(&[1])).unwrap();
    let error = Reference::open_or_create(&dataset, &header_of(&[1])).unwrap_err();
    assert!(matches!(error, Error::Locked { .. }), "{error}");
    drop(held);
    let error = Reference::open_or_create(&dataset, &header_of(&[2])).unwrap_err();
    assert!(matches!(&error, Error::OtherReferences { .. }));
    let path = place.path().join("reference/zarr.json");
    let text = std::fs::read_to_string(&path).unwrap();
    for (from, to) in [("bake-1", "bake-2"), ("[\n      1\n    ]", "[99]"), ("4000", "-1")] {
        assert!(text.contains(from), "{from} in {text}");
        std::fs::write(&path, text.replace(from, to)).unwrap();
        let error = Reference::open(&dataset).unwrap_err();
        assert!(matches!(error, Error::OtherRecipe { .. } | Error::Field { .. }), "{error}");
    }
}
