//! Diffusion over surfaces against closed forms and against the sum over all pairs.

use glam::DVec3;

use super::*;
use crate::bake::diffusion::{Cloud, diffuse};
use crate::num::random::Stream;

fn grey(mean_free_path_m: f32, absorption_per_m: f32) -> Subsurface {
    Subsurface {
        mean_free_path_m: [mean_free_path_m; 3],
        absorption_per_m: [absorption_per_m; 3],
        refractive_index: 1.3,
    }
}

/// A level grid of (2n+1)² points at a height, `spacing` apart, the centre in the middle.
fn grid(n: i32, spacing: f64, height: f64) -> Cloud {
    let line = || (-n..=n).map(|i| f64::from(i) * spacing);
    let places: Vec<DVec3> =
        line().flat_map(|x| line().map(move |z| DVec3::new(x, height, z))).collect();
    let count = places.len();
    Cloud::of(places, vec![DVec3::Y; count], vec![spacing * spacing; count])
}

fn diffused(subsurface: &Subsurface, cloud: &Cloud, values: Vec<f32>) -> Vec<f32> {
    let points = cloud.areas.len();
    let pose = BakedPose { coefficients: values, noise: vec![0.1; points], rays: vec![1; points] };
    diffuse(subsurface, cloud, &pose, 1, &AtomicBool::new(false)).unwrap().coefficients
}

/// The kernel's integral over a disk is the sum over its rings, it tends to 1, and what lies beyond
/// is the rest; with and without absorption.
#[test]
fn the_disk_is_the_integral_of_the_kernel() {
    for (path, absorption) in [(0.01, 0.0), (0.01, 20.0), (2.0, 0.3)] {
        let [dipole, ..] = grey(path, absorption).dipoles();
        for radius in [0.003, 0.05, 1.0] {
            let rings = 20_000;
            let step = radius / f64::from(rings);
            let ring = |i: i32| {
                let r = (f64::from(i) + 0.5) * step;
                std::f64::consts::TAU * r * step * dipole.at(r * r)
            };
            let sum: f64 = (0..rings).map(ring).sum();
            assert!((sum - dipole.disk(radius)).abs() < 1e-5, "{sum} {}", dipole.disk(radius));
        }
        assert!((dipole.disk(1e6) - 1.0).abs() < 1e-5);
        assert!((dipole.beyond(0.0) - 1.0).abs() < 1e-12);
    }
}

/// In the middle of a lit disk on a plane there is the share that the kernel's closed integral says,
/// whether the points are finer than the mean free path or 20 times coarser, to 2 %.
#[test]
fn a_lit_disk_on_a_plane() {
    let cloud = grid(16, 1.0, 0.0);
    let middle = cloud.places.len() / 2;
    for path in [0.05, 0.3, 1.0, 3.0] {
        let material = grey(path, 0.1 / path);
        let [dipole, ..] = material.dipoles();
        for radius in [4.5_f64, 12.5] {
            let lit = |place: &DVec3| if place.length() < radius { 1.0 } else { 0.0 };
            let area = cloud.places.iter().map(lit).sum::<f64>();
            let values = cloud.places.iter().map(|p| lit(p) as f32).collect();
            let found = f64::from(diffused(&material, &cloud, values)[middle]);
            let expected = dipole.disk((area / std::f64::consts::PI).sqrt());
            assert!((found - expected).abs() < 0.02, "{path}, {radius}: {found} for {expected}");
        }
    }
}

/// A slab lit from above: below it shines Σ z e^{−σ d}/d over Σ e^{−σ z}, d² = h² + z², falling with the
/// thickness h, to 1.5 % of the light above.
#[test]
fn a_slab_shines_through() {
    let material = grey(1.0, 0.3);
    let [dipole, ..] = material.dipoles();
    let mut before = 1.0;
    for thickness in [0.5, 1.0, 2.0, 4.0] {
        let mut slab = grid(14, 0.7, 0.0);
        let below = grid(14, 0.7, -thickness);
        let above = slab.places.len();
        slab.places.extend(below.places);
        slab.normals.extend(below.normals.iter().map(|normal| -*normal));
        slab.areas.extend(below.areas);
        let slab = Cloud::of(slab.places, slab.normals, slab.areas);
        let values = (0..2 * above).map(|point| if point < above { 1.0 } else { 0.0 }).collect();
        let found = f64::from(diffused(&material, &slab, values)[above + above / 2]);
        let expected = dipole.beyond(thickness * thickness);
        assert!((found - expected).abs() < 0.015, "{thickness}: {found} for {expected}");
        assert!(found < before);
        before = found;
    }
}

/// The tree's sums are those over all pairs of points to 5e-3, for values about 1 that
/// change smoothly, as transfer does, and for noise that differs from point to point;
/// on a sphere, for mean free paths from far below the points' distance to half the sphere. What is
/// said of the noise agrees to 2 %.
#[test]
fn the_tree_agrees_with_all_pairs() {
    let (positions, _) = crate::trace::shapes::sphere(4);
    let places: Vec<DVec3> = positions.iter().map(|p| p.as_dvec3()).collect();
    let points = places.len();
    let area = 4.0 * std::f64::consts::PI / points as f64;
    let mut stream = Stream::new(3);
    let smooth = |p: &DVec3| (1.0 + p.x * p.y + (4.0 * p.z).sin()) as f32;
    let values: [Vec<f32>; 2] = [
        places.iter().map(smooth).collect(),
        (0..points).map(|_| stream.normal() as f32).collect(),
    ];
    let cloud = Cloud::of(places.clone(), places, vec![area; points]);
    for path in [0.005, 0.05, 0.5] {
        let material = grey(path, 0.2 / path);
        let [dipole, ..] = material.dipoles();
        for values in &values {
            let (coefficients, noise) = (values.clone(), vec![0.1; points]);
            let pose = BakedPose { coefficients, noise, rays: vec![1; points] };
            let found = diffuse(&material, &cloud, &pose, 1, &AtomicBool::new(false)).unwrap();
            for at in (0..points).step_by(37) {
                let pair = |of: usize| (cloud.weight(&dipole, at, of), f64::from(values[of]));
                let sum: f64 = (0..points).map(pair).map(|(weight, value)| weight * value).sum();
                let square: f64 = (0..points).map(pair).map(|(w, _)| (0.1 * w).powi(2)).sum();
                let off = (f64::from(found.coefficients[at]) - sum).abs();
                assert!(off < 5e-3, "{path}, {at}: {off}");
                assert!((f64::from(found.noise[at]) / square.sqrt() - 1.0).abs() < 0.02);
            }
        }
    }
}

/// A kernel far narrower than a mesh is coarse spreads nothing, and makes nothing: a value of 1 all over
/// stays 1, on a cube whose corners are three points each, and on a square whose points lie anyhow. (With seven
/// places for a disk it came to 12 on a character.)
#[test]
fn a_coarse_mesh_makes_no_light() {
    let mut square = Body::nothing();
    let mut stream = Stream::new(5);
    let n = 12_u32;
    for i in 0..=n {
        for j in 0..=n {
            let mut at = |k: u32| k as f32 + 0.8 * (stream.uniform() as f32 - 0.5);
            let place = Vec3::new(at(j), 0.0, at(i));
            square.positions.push(place);
            square.normals.push(Vec3::Y);
        }
    }
    for i in 0..n {
        for j in 0..n {
            let [a, b] = [i, i + 1].map(|i| i * (n + 1) + j);
            square.triangles.extend([[a, b, a + 1], [b, b + 1, a + 1]]);
        }
    }
    for body in [Body::cube(), square] {
        let baker = body.baker(&settings(Signal::Transfer, 16));
        let cloud = Cloud::new(&baker.stage, &body.positions, &body.normals);
        let points = body.positions.len();
        for path in [1e-4, 1e-3, 1e-2] {
            let pose = BakedPose {
                coefficients: vec![1.0; points],
                noise: vec![0.1; points],
                rays: vec![1; points],
            };
            let material = grey(path, 0.2 / path);
            let found = diffuse(&material, &cloud, &pose, 1, &AtomicBool::new(false)).unwrap();
            for (value, noise) in found.coefficients.iter().zip(&found.noise) {
                assert!((0.9..1.15).contains(value) && *noise < 0.115, "{path}: {value} {noise}");
            }
        }
    }
}

/// Through the baker: on a level square that nothing blocks transfer stays what it is away from the
/// edges, in three channels; the bits do not depend on threads; blood reddens the shadow of a wall.
#[test]
fn a_bake_is_diffused() {
    let mut body = Body::nothing();
    let n = 16_i32;
    for i in -n..=n {
        for j in -n..=n {
            body.positions.push(Vec3::new(i as f32, 0.0, j as f32) * 1e-3);
            body.normals.push(Vec3::Y);
        }
    }
    let side = 2 * n as u32 + 1;
    for i in 0..side - 1 {
        for j in 0..side - 1 {
            let [a, b] = [i, i + 1].map(|i| i * side + j);
            body.triangles.extend([[a, a + 1, b], [b, a + 1, b + 1]]);
        }
    }
    let skin = Subsurface::named("skin").unwrap();
    let bake = |body: &Body| {
        let baker = body.baker(&settings(Signal::Transfer, 32)).diffusing(skin).unwrap();
        baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap().swap_remove(0)
    };
    let flat = bake(&body);
    assert_eq!(flat.coefficients.len(), body.positions.len() * 3 * 36);
    let middle = body.positions.len() / 2;
    let plain = &body.bake(&settings(Signal::Transfer, 32), &[0.0])[0].coefficients;
    for channel in 0..3 {
        let found = flat.coefficients[(middle * 3 + channel) * 36];
        assert!((found / plain[middle * 36] - 1.0).abs() < 0.06, "{channel}: {found}");
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    assert_eq!(pool.install(|| bake(&body)), flat);
    // A wall over the line x = 0 that shadows what lies behind it under light from −x.
    let wall = |y: f32, z: f32| Vec3::new(0.5e-3, y, z);
    body.quad([wall(1e-6, -0.1), wall(1e-6, 0.1), wall(0.1, 0.1), wall(0.1, -0.1)]);
    let shadowed = bake(&body);
    let side_light = |point: usize, channel: usize| {
        let from = &shadowed.coefficients[(point * 3 + channel) * 36..][..4];
        // Light from −x: y₀ and y₁ (x is the third of band 1).
        f64::from(from[0]) * 0.282_095 - f64::from(from[3]) * 0.488_603
    };
    let behind = middle + side as usize;
    let [red, _, blue] = [0, 1, 2].map(|channel| side_light(behind, channel));
    assert!(red > 1.05 * blue, "{red} {blue}");
}

/// What cannot be is refused by what it is; every measured material is sound.
#[test]
fn nonsense_is_refused() {
    let body = Body::sphere(0);
    let baker = |signal| body.baker(&settings(signal, 16));
    let refused = |material| baker(Signal::Transfer).diffusing(material).expect_err("refused");
    for path in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(matches!(refused(grey(path, 1.0)), Error::MeanFreePath { .. }), "{path}");
    }
    for absorption in [-1.0, 100.0, f32::NAN] {
        assert!(matches!(refused(grey(0.01, absorption)), Error::Absorption { .. }));
    }
    let glass = Subsurface { refractive_index: 0.5, ..grey(0.01, 1.0) };
    assert_eq!(refused(glass), Error::Refraction { found: 0.5 });
    let error = baker(Signal::Ao).diffusing(grey(0.01, 1.0)).expect_err("refused");
    assert_eq!(error, Error::SubsurfaceOf { signal: "ao" });
    for name in Subsurface::names() {
        let material = Subsurface::named(name).unwrap();
        baker(Signal::Transfer).diffusing(material).unwrap();
        assert_eq!((material.channels(1), grey(0.01, 1.0).channels(1)), (3, 1));
    }
    assert_eq!(Subsurface::named("jade"), None);
}

/// Where a part of the points alone is of the material, that part is diffused as if it were alone, and all
/// others keep their bits, in as many channels.
#[test]
fn skin_ends_where_it_is_said_to() {
    let mut body = Body::sphere(2);
    let own = body.positions.len();
    let skin = Subsurface::named("skin").unwrap();
    let points: Vec<u32> = (0..own as u32).collect();
    let bake = |body: &Body, points: Option<Vec<u32>>| {
        let baker = body.baker(&settings(Signal::Transfer, 16));
        let baker = match points {
            Some(points) => baker.diffusing_at(skin, points).unwrap(),
            None => baker,
        };
        baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap().swap_remove(0)
    };
    // A twin inside the sphere, dark and so close that it would darken it.
    let alone = bake(&body, Some(points.clone()));
    body.positions.extend(body.positions.clone().iter().map(|p| *p * 0.9999));
    body.normals.extend(body.normals.clone());
    let inner: Vec<[u32; 3]> = body.triangles.iter().map(|t| t.map(|c| c + own as u32)).collect();
    body.triangles.extend(inner);
    let (direct, both) = (bake(&body, None), bake(&body, Some(points)));
    let width = 36;
    for (point, row) in both.coefficients.chunks_exact(3 * width).enumerate().skip(own) {
        let kept = &direct.coefficients[point * width..(point + 1) * width];
        assert!((0..3).all(|channel| &row[channel * width..][..width] == kept));
    }
    assert_eq!((&both.noise[own..], &both.rays), (&direct.noise[own..], &direct.rays));
    let pairs = both.coefficients[..own * 3 * width].iter().zip(&alone.coefficients);
    let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(off < 1e-3, "{off}");
    let beyond =
        body.baker(&settings(Signal::Transfer, 16)).diffusing_at(skin, vec![2 * own as u32]);
    assert!(matches!(beyond, Err(Error::Points { .. })));
}
