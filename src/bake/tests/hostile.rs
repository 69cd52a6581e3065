//! Meshes and settings that nobody should send.

use super::*;
use crate::trace;

fn error(settings: &Settings) -> Error {
    let body = Body::cube();
    Baker::new(&body.triangles, &body.points(), settings).unwrap_err()
}

/// Settings out of range are refused with the value that was given.
#[test]
fn settings_are_checked() {
    let good = settings(Signal::Ao, 1);
    for found in [0, MOST_RAYS + 1] {
        assert_eq!(error(&Settings { rays: found, ..good }), Error::Rays { found });
    }
    for found in [0.0, -1.0, f32::NAN] {
        let error = error(&Settings { max_distance_m: Some(found), ..good });
        assert!(matches!(error, Error::MaxDistance { .. }), "{error}");
    }
    let baked = Body::cube().bake(&good, &[0.0]);
    assert_eq!(baked[0].rays, vec![2; 24], "one ray becomes two batches of one");
    let many = Body::cube().baker(&Settings { rays: 5000, ..good });
    assert_eq!(many.rays_per_point(), 5004, "three blocks of two halves of 834");
}

/// Maps and poses that contradict the mesh are refused with the place.
#[test]
fn shapes_are_checked() {
    let body = Body::cube();
    let good = settings(Signal::Ao, 8);
    let triangles = [[0, 1, 24]];
    let error = Baker::new(&triangles, &body.points(), &good).unwrap_err();
    assert_eq!(error, Error::Triangle { triangle: 0, vertex: 24, vertices: 24 });
    let mut points = body.points();
    points.of_vertex[5] = 99;
    let error = Baker::new(&body.triangles, &points, &good).unwrap_err();
    assert_eq!(error.to_string(), "the point of vertex of 5 is 99, but there are only 24");

    let baker = body.baker(&good);
    let go = AtomicBool::new(false);
    let short = PosedMesh { positions: &body.positions[1..], ..body.posed(0.0) };
    let error = baker.bake(&[body.posed(0.0), short], &go).unwrap_err();
    assert_eq!(error, Error::Shape { pose: 1, positions: 23, normals: 24, vertices: 24 });
    for bad in [f32::NAN, f32::INFINITY] {
        let mut positions = body.positions.clone();
        positions[3].y = bad;
        let error = baker.bake(&[PosedMesh { positions: &positions, ..body.posed(0.0) }], &go);
        assert!(matches!(error, Err(Error::NotFinite { pose: 0, vertex: 3, .. })), "{error:?}");
    }
    let stop = AtomicBool::new(true);
    assert_eq!(baker.bake(&[body.posed(0.0)], &stop), Err(Error::Cancelled));
    assert_eq!(baker.bake(&[], &go), Ok(vec![]));
    let source = trace::Error::TooMany { what: "triangles", count: 5 };
    assert!(Error::Trace { pose: 3, source }.to_string().starts_with("pose 3 could not"));
}

/// Isolated vertices, normals of no length or not finite, triangles without area, points on one
/// spot, no triangles and no vertices at all: every number that comes out is finite.
#[test]
fn degenerate_meshes_have_a_defined_result() {
    let mut body = Body::cube();
    body.positions.extend([Vec3::new(0.0, 3.0, 0.0), Vec3::ZERO, Vec3::splat(1.0)]);
    body.normals.extend([Vec3::Y, Vec3::ZERO, Vec3::NAN]);
    body.normals[0] = Vec3::ZERO;
    body.normals[5] = Vec3::splat(f32::INFINITY);
    body.normals[9] *= 1e-30;
    body.triangles.extend([[24, 24, 24], [0, 0, 1], [0, 1, 0]]);
    let spot = Body::cube().mapped(|_| Vec3::ONE);
    let loose = Body { triangles: vec![], ..Body::cube() };
    let nothing = Body::nothing();
    let huge = Body::cube().mapped(|p| p * 3e38);
    let tiny = Body::cube().mapped(|p| p * 1e-38);
    for signal in SIGNALS {
        for body in [&body, &spot, &loose, &nothing, &huge, &tiny] {
            let baked = &body.bake(&settings(signal, 32), &[0.0])[0];
            let finite = |values: &[f32]| values.iter().all(|v| v.is_finite());
            assert!(finite(&baked.coefficients) && finite(&baked.noise), "{signal:?}");
            assert_eq!(baked.noise.len(), body.positions.len());
        }
    }
    let ao = &body.bake(&settings(Signal::Ao, 32), &[0.0])[0].coefficients;
    assert_eq!([ao[0], ao[5], ao[9], ao[24]], [1.0; 4], "the triangles' normal serves");
    assert_eq!(ao[25], 0.0, "inside the closed cube");
}

/// What is said of memory grows with the result, not with the poses in flight, and by the tables'
/// and scenes' sizes.
#[test]
fn memory_is_bounded() {
    let body = Body::sphere(4);
    let baker = body.baker(&settings(Signal::Transfer, 500));
    let result = body.positions.len() as u64 * 4 * 38;
    let working = |poses: usize| baker.memory_bytes(poses, 2) - poses as u64 * result;
    assert_eq!(working(1000), working(100));
    assert!(working(1) < working(100));
    // 64 sets of 500 directions, rows of 40 and 3 coordinates.
    assert!(working(1) > 64 * 500 * 43 * 4 && working(100) < 100_000_000);
}

/// A trial bakes something and says how fast; a mesh without points says infinitely fast.
#[test]
fn calibration_measures() {
    let body = Body::sphere(3);
    let trial = body.baker(&settings(Signal::Ao, 64)).calibrate(&body.posed(0.0), 0.01).unwrap();
    assert!(trial.rays_per_s > 0.0 && trial.rays_per_s.is_finite() && trial.prepare_s > 0.0);
    let nothing = Body::nothing();
    let trial = nothing.baker(&settings(Signal::Ao, 64)).calibrate(&nothing.posed(0.0), 0.01);
    assert_eq!(trial.unwrap().rays_per_s, f64::INFINITY);
}

/// A trial of bounces gathers as the bake does, whether rows are kept or traced anew, in colours too, and
/// leaves the bake as it was.
#[test]
fn calibration_gathers() {
    let body = Body::sphere(3);
    let mut baker = bounces::reflecting(&body, 64, 3, [0.8, 0.4, 0.2]);
    let bake = |baker: &Baker| baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap();
    let before = bake(&baker);
    for most_row_bytes in [0, u64::MAX] {
        baker.most_row_bytes = most_row_bytes;
        let trial = baker.calibrate(&body.posed(0.0), 0.01).unwrap();
        assert!(trial.rays_per_s > 0.0 && trial.rays_per_s.is_finite());
        assert_eq!(bake(&baker), before);
    }
}

/// A trial beside a pool that is at work for others says what one beside an idle pool says: the time
/// that the others take is not counted as its own.
#[test]
fn calibration_does_not_wait_for_others() {
    use std::sync::atomic::Ordering;
    use std::time::{Duration, Instant};
    let done = AtomicBool::new(false);
    let (begin, begins) = std::sync::mpsc::channel();
    let body = Body::sphere(3);
    let baker = body.baker(&settings(Signal::Ao, 64));
    let trial = std::thread::scope(|scope| {
        let done = &done;
        scope.spawn(move || {
            rayon::broadcast(|_| {
                begin.send(()).unwrap();
                // Held until the trial is over, or for an age of it.
                let start = Instant::now();
                while !done.load(Ordering::Relaxed) && start.elapsed() < Duration::from_secs(5) {
                    std::thread::sleep(Duration::from_millis(1));
                }
            });
        });
        (0..rayon::current_num_threads()).for_each(|_| begins.recv().unwrap());
        let trial = baker.calibrate(&body.posed(0.0), 0.01).unwrap();
        done.store(true, Ordering::Relaxed);
        trial
    });
    // A point of 64 rays in five seconds is 13 rays a second.
    assert!(trial.rays_per_s > 1000.0 && trial.prepare_s < 4.0, "{trial:?}");
}
