//! Analytic truth about rays and triangles, and agreement of all packet widths.

use glam::Vec3;

use super::shapes::sphere;
use super::*;
use crate::num::random::Stream;

/// Directions as structure of arrays.
struct Block {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

impl Block {
    fn new(directions: &[Vec3]) -> Self {
        Self {
            x: directions.iter().map(|d| d.x).collect(),
            y: directions.iter().map(|d| d.y).collect(),
            z: directions.iter().map(|d| d.z).collect(),
        }
    }

    fn rays(&self, origin: Vec3) -> Rays<'_> {
        let Self { x, y, z } = self;
        Rays { origin, x, y, z, near: 0.0, far: f32::INFINITY }
    }
}

fn on_sphere(stream: &mut Stream) -> Vec3 {
    Vec3::from_array([(); 3].map(|()| stream.normal() as f32)).normalize()
}

fn random_directions(count: usize, seed: u64) -> Vec<Vec3> {
    let mut stream = Stream::new(seed);
    (0..count).map(|_| on_sphere(&mut stream)).collect()
}

fn occluded(scene: &Scene, rays: &Rays<'_>, width: Width) -> Vec<bool> {
    let mut blocked = vec![u64::MAX; words_of(rays.len())];
    scene.occluded_by(width, rays, &mut blocked);
    let spare = blocked.iter().map(|w| w.count_ones()).sum::<u32>();
    let bits: Vec<bool> = (0..rays.len()).map(|i| blocked[i / 64] >> (i % 64) & 1 == 1).collect();
    assert_eq!(spare as usize, bits.iter().filter(|&&bit| bit).count(), "bits past the end");
    bits
}

/// One triangle: rays through its inside hit it at the analytic distance and barycentrics, rays
/// past it do not, and near and far limits cut exactly there.
#[test]
fn a_triangle_is_hit_where_geometry_says() {
    let device = Device::new().unwrap();
    let corners = [Vec3::new(0.0, 0.0, 2.0), Vec3::new(1.0, 0.0, 2.0), Vec3::new(0.0, 1.0, 2.0)];
    let scene = Scene::build(&device, &corners, &[[0, 1, 2]]).unwrap();
    let target = corners[0] * 0.5 + corners[1] * 0.2 + corners[2] * 0.3;
    let block = Block::new(&[target, target.normalize(), Vec3::new(0.8, 0.8, 2.0), -target]);
    for &width in device.widths() {
        let mut hits = [None; 4];
        scene.nearest_by(width, &block.rays(Vec3::ZERO), &mut hits);
        for (hit, distance) in hits[..2].iter().zip([1.0, target.length()]) {
            let hit = hit.unwrap();
            assert!((hit.distance - distance).abs() < 1e-6 * distance);
            assert!((hit.u - 0.2).abs() < 1e-6 && (hit.v - 0.3).abs() < 1e-6);
            assert_eq!((hit.triangle, hit.normal), (0, Vec3::Z));
        }
        assert_eq!(hits[2..], [None, None]);
        let seen =
            |near, far| occluded(&scene, &Rays { near, far, ..block.rays(Vec3::ZERO) }, width);
        assert_eq!(seen(0.0, f32::INFINITY), [true, true, false, false]);
        assert_eq!(seen(0.0, 0.999), [false; 4], "beyond the far end");
        assert_eq!(seen(1.001, 3.0), [false, true, false, false], "before the near end");
    }
}

/// From inside a closed sphere every ray is blocked at a distance between the inscribed radius and
/// 1, and its hit's triangle, barycentrics and distance name the same point; from outside exactly
/// the rays into the sphere's cone are (those near its edge aside, which meet or miss facets).
#[test]
fn a_sphere_blocks_its_solid_angle() {
    let device = Device::new().unwrap();
    let (positions, triangles) = sphere(5);
    let scene = Scene::build(&device, &positions, &triangles).unwrap();
    let directions = random_directions(1000, 3);
    let block = Block::new(&directions);
    let mut hits = vec![None; directions.len()];
    scene.nearest(&block.rays(Vec3::ZERO), &mut hits);
    for (hit, &direction) in hits.iter().zip(&directions) {
        let hit = hit.unwrap();
        assert!((0.998..=1.000_001).contains(&hit.distance));
        let [a, b, c] = triangles[hit.triangle as usize].map(|i| positions[i as usize]);
        let point = a + hit.u * (b - a) + hit.v * (c - a);
        assert!(point.distance(direction * hit.distance) < 1e-5);
        assert!(hit.normal.normalize().dot(direction) > 0.99, "normals point outwards");
    }
    let origin = Vec3::new(0.0, 3.0, 0.0);
    let bits = occluded(&scene, &block.rays(origin), device.width());
    for (&bit, direction) in bits.iter().zip(&directions) {
        let sine = origin.cross(*direction).length();
        if direction.y < 0.0 && sine < 0.998 {
            assert!(bit);
        } else if direction.y > 0.0 || sine > 1.0 {
            assert!(!bit);
        }
    }
}

/// All packet widths, native or emulated, give the bits and hits of single rays, for every number
/// of rays around the packet boundaries, none included.
#[test]
fn every_width_agrees_with_single_rays() {
    let device = Device::new().unwrap();
    let (positions, triangles) = sphere(3);
    let scene = Scene::build(&device, &positions, &triangles).unwrap();
    let mut total = 0;
    for count in [0, 1, 3, 4, 5, 8, 15, 16, 17, 63, 64, 65, 250, 500] {
        let block = Block::new(&random_directions(count, count as u64));
        let rays = block.rays(Vec3::new(0.3, 0.9, 0.7));
        let single = occluded(&scene, &rays, Width::One);
        let mut single_hits = vec![None; count];
        scene.nearest_by(Width::One, &rays, &mut single_hits);
        total += single.iter().filter(|&&bit| bit).count();
        for &width in device.widths() {
            assert_eq!(occluded(&scene, &rays, width), single, "{width:?}, {count} rays");
            let mut hits = vec![None; count];
            scene.nearest_by(width, &rays, &mut hits);
            for (hit, single) in hits.iter().zip(&single_hits) {
                let pair = hit.map(|h: Hit| (h.triangle, h.distance));
                let expected = single.map(|h: Hit| (h.triangle, h.distance));
                match (pair, expected) {
                    (Some((a, d)), Some((b, e))) => {
                        assert!(a == b && (d - e).abs() < 1e-5, "{width:?}: {pair:?} {expected:?}");
                    }
                    _ => assert_eq!(pair, expected, "{width:?}, {count} rays"),
                }
            }
        }
        assert!(device.widths().contains(&device.width()));
    }
    assert!(total > 100, "only {total} rays were blocked");
}

/// No triangles, triangles without area and repeated corners block nothing and do no harm.
#[test]
fn nothing_blocks_nothing() {
    let device = Device::new().unwrap();
    let points = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0, Vec3::Y];
    let flat = [[0, 1, 2], [0, 0, 0], [1, 1, 3]];
    let block = Block::new(&random_directions(100, 1));
    for (positions, triangles) in [(&points[..], &flat[..]), (&points, &[]), (&[], &[])] {
        let scene = Scene::build(&device, positions, triangles).unwrap();
        assert_eq!(scene.triangles(), triangles.len());
        for &width in device.widths() {
            let rays = block.rays(Vec3::new(0.5, -0.5, 0.25));
            assert!(occluded(&scene, &rays, width).iter().all(|bit| !bit));
            let mut hits = vec![None; 100];
            scene.nearest_by(width, &rays, &mut hits);
            assert!(hits.iter().all(Option::is_none));
        }
    }
}

/// A sphere blocks the same rays at a scale of 1e-6 and 1e6.
#[test]
fn scale_does_not_matter() {
    let device = Device::new().unwrap();
    let (unit, triangles) = sphere(3);
    let block = Block::new(&random_directions(500, 9));
    let bits_at = |scale: f32| {
        let positions: Vec<Vec3> = unit.iter().map(|p| *p * scale).collect();
        let scene = Scene::build(&device, &positions, &triangles).unwrap();
        occluded(&scene, &block.rays(Vec3::new(0.0, 2.0, 0.0) * scale), device.width())
    };
    let expected = bits_at(1.0);
    for exponent in [-20, -10, 10, 20] {
        assert_eq!(bits_at(2.0f32.powi(exponent)), expected, "scale 2^{exponent}");
    }
}

/// Whatever Embree would drop silently or read out of bounds is refused, with the evidence.
#[test]
fn bad_meshes_are_refused() {
    let device = Device::new().unwrap();
    let good = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let error = Scene::build(&device, &good, &[[0, 1, 2], [0, 1, 3]]).unwrap_err();
    assert_eq!(error, Error::Vertex { triangle: 1, vertex: 3, vertices: 3 });
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -2e18] {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::new(0.0, bad, 0.0)];
        let error = Scene::build(&device, &positions, &[[0, 1, 2]]).unwrap_err();
        assert!(matches!(error, Error::Position { vertex: 2, .. }), "{error}");
        assert!(error.to_string().contains("vertex 2"));
    }
    let error = Error::Build { triangles: 7, code: Code(4), message: "no room".into() };
    assert_eq!(
        error.to_string(),
        "Embree could not build a scene of 7 triangles: out of memory: no room"
    );
    assert_eq!(Code(99).to_string(), "error 99");
}

/// Scenes outlive their device, are traced by several threads at once, and building leaves the
/// thread's floating-point mode alone (denormal numbers survive).
#[test]
fn scenes_are_shared_and_self_contained() {
    let (positions, triangles) = sphere(4);
    let scene = Scene::build(&Device::new().unwrap(), &positions, &triangles).unwrap();
    let tiny = std::hint::black_box(f32::MIN_POSITIVE) / 4.0;
    assert!(tiny > 0.0, "denormal numbers are flushed to zero");
    let block = Block::new(&random_directions(2000, 5));
    let rays = block.rays(Vec3::new(0.0, 0.0, 1.5));
    let expected = occluded(&scene, &rays, Width::One);
    std::thread::scope(|scope| {
        for width in Width::ALL.into_iter().cycle().take(8) {
            let (scene, rays, expected) = (&scene, &rays, &expected);
            scope.spawn(move || {
                if Device::new().unwrap().widths().contains(&width) {
                    assert_eq!(&occluded(scene, rays, width), expected);
                }
            });
        }
    });
}

/// Two threads that build on one device at the same time get the scene that they would get alone.
#[test]
fn threads_build_side_by_side() {
    let (positions, triangles) = sphere(4);
    let block = Block::new(&random_directions(300, 6));
    let rays = block.rays(Vec3::new(0.9, 0.9, 0.0));
    let device = Device::new().unwrap();
    let build = || {
        let scene = Scene::build(&device, &positions, &triangles).unwrap();
        occluded(&scene, &rays, device.width())
    };
    let expected = build();
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| (0..50).for_each(|_| assert_eq!(build(), expected)));
        }
    });
}

/// Three squares behind one another, the middle one asked about: it blocks where the answer says so,
/// by every packet width, and the nearest hit is that of a plain scene without the parts that do not
/// count, under the triangle's own number. What is asked has the place, normal and direction of the hit.
#[test]
fn a_filter_decides_which_hits_count() {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let square = |z: f32| corners.map(|[x, y]| Vec3::new(x, y, z));
    let (positions, mut triangles) = ([square(2.0), square(1.0)].concat(), Vec::new());
    for first in [0_u32, 4] {
        triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|corner: u32| first + corner)));
    }
    // The nearer square is cut out where x < 0, and seen from its front (rays towards +z see the
    // back) never blocks.
    let (near, origin) = (positions.clone(), Vec3::ZERO);
    let asked_of = triangles.clone();
    let counts = move |candidate: &Candidate| {
        let corners = asked_of[[2, 3][candidate.index]].map(|corner| near[corner as usize]);
        let (u, v) = (candidate.u, candidate.v);
        let place = (1.0 - u - v) * corners[0] + u * corners[1] + v * corners[2];
        let met = candidate.direction * (place.z / candidate.direction.z);
        (place - met).length() < 1e-5 && candidate.normal.z > 0.0 && place.x >= 0.0
    };
    let filter = Filter { triangles: vec![2, 3], counts: std::sync::Arc::new(counts) };
    let device = Device::new().unwrap();
    let scene =
        Scene::build_filtered(&device, &positions, &triangles, Some(filter.clone())).unwrap();
    let block = Block::new(&random_directions(300, 11));
    let rays = block.rays(origin);
    for width in Width::ALL {
        let blocked = occluded(&scene, &rays, width);
        let mut hits = vec![None; rays.len()];
        scene.nearest_by(width, &rays, &mut hits);
        for (lane, hit) in hits.iter().enumerate() {
            let direction = Vec3::new(rays.x[lane], rays.y[lane], rays.z[lane]);
            let at = |z: f32| direction / direction.z * z;
            let meets = |z: f32| direction.z > 0.0 && at(z).abs().truncate().max_element() < 1.0;
            let expected = match (meets(1.0) && direction.x >= 0.0, meets(2.0)) {
                (true, _) => Some(1.0),
                (false, true) => Some(2.0),
                _ => None,
            };
            assert_eq!(hit.is_some(), expected.is_some(), "{width:?}, {direction}");
            assert_eq!(blocked[lane], expected.is_some());
            if let (Some(hit), Some(z)) = (hit, expected) {
                assert!((hit.distance * direction.z - z).abs() < 1e-5);
                assert_eq!(hit.triangle / 2, if z < 1.5 { 1 } else { 0 });
            }
        }
    }
    let wrong = Filter { triangles: vec![4], ..filter };
    let error = Scene::build_filtered(&device, &positions, &triangles, Some(wrong)).unwrap_err();
    assert_eq!(error, Error::Filter { triangle: 4, triangles: 4 });
}

/// The library starts no thread of its own, whatever the order of devices and builds. A thread that
/// it started would have the name of the one that it was started from.
#[test]
fn the_library_starts_no_thread() {
    let (positions, triangles) = sphere(4);
    let work = move || {
        let devices = [(); 3].map(|()| {
            let device = Device::new().unwrap();
            Scene::build(&device, &positions, &triangles).unwrap();
            device
        });
        drop(devices);
        Scene::build(&Device::new().unwrap(), &positions, &triangles).unwrap();
        threads_named("lone-builder")
    };
    let thread = std::thread::Builder::new().name("lone-builder".into()).spawn(work).unwrap();
    assert!(thread.join().unwrap().is_none_or(|count| count == 1));
}

/// How many threads of this process have this name; `None` where the system does not say.
fn threads_named(name: &str) -> Option<usize> {
    let tasks = std::fs::read_dir("/proc/self/task").ok()?;
    let of_task = |task: std::fs::DirEntry| std::fs::read_to_string(task.path().join("comm"));
    let names = tasks.flatten().filter_map(|task| of_task(task).ok());
    Some(names.filter(|comm| comm.trim() == name).count())
}
