//! Vertices fitted to samples all over the surface.

use super::*;

/// A level square of 2 m from -1 to 1 in `side`² cells, everything above it.
fn floor(side: usize) -> Body {
    let mut body = Body::nothing();
    let at = |k: usize| k as f32 / side as f32 * 2.0 - 1.0;
    for i in 0..=side {
        for j in 0..=side {
            body.positions.push(Vec3::new(at(i), 0.0, at(j)));
            body.normals.push(Vec3::Y);
        }
    }
    for i in 0..side {
        for j in 0..side {
            let [a, b] = [i, i + 1].map(|i| (i * (side + 1) + j) as u32);
            body.triangles.extend([[a, a + 1, b], [b, a + 1, b + 1]]);
        }
    }
    body
}

/// The value of a point's interpolation over the floor at a place.
fn interpolated(values: &[f32], side: usize, x: f32, z: f32) -> f32 {
    let cell = |c: f32| (((c + 1.0) / 2.0 * side as f32) as usize).min(side - 1);
    let (i, j) = (cell(x), cell(z));
    let within = |c: f32, k: usize| (c + 1.0) / 2.0 * side as f32 - k as f32;
    let (s, t) = (within(x, i), within(z, j));
    let at = |i: usize, j: usize| values[i * (side + 1) + j];
    if s + t <= 1.0 {
        at(i, j) + s * (at(i + 1, j) - at(i, j)) + t * (at(i, j + 1) - at(i, j))
    } else {
        let far = at(i + 1, j + 1);
        far + (1.0 - s) * (at(i, j + 1) - far) + (1.0 - t) * (at(i + 1, j) - far)
    }
}

/// An unoccluded surface gives exactly 1, a constant being linear, at every vertex.
#[test]
fn a_constant_is_kept() {
    let body = Body::sphere(2);
    let settings = settings(Signal::Ao, 16);
    let baker = body.baker(&settings).fitted(&body.positions, 3).unwrap();
    let baked = baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap();
    assert_eq!(baked[0].coefficients.len(), body.positions.len());
    assert!(baked[0].coefficients.iter().all(|ao| (ao - 1.0).abs() < 1e-4));
    assert!(baked[0].noise.iter().all(|&noise| noise == 0.0));
}

/// One large square among many small triangles that touch nothing, nothing blocked: every value is 1,
/// though a small triangle has one site for its three corners.
#[test]
fn lonely_triangles_keep_their_values() {
    let mut body = Body::nothing();
    let c = |x: f32, z: f32| Vec3::new(x, 0.0, z);
    body.quad([c(-10.0, 10.0), c(10.0, 10.0), c(10.0, -10.0), c(-10.0, -10.0)]);
    for i in 0..40 {
        let (first, x) = (body.positions.len() as u32, 12.0 + 0.1 * i as f32);
        body.positions.extend([c(x, 0.0), c(x, 0.01), c(x + 0.01, 0.0)]);
        body.normals.extend([Vec3::Y; 3]);
        body.triangles.push([first, first + 1, first + 2]);
    }
    for per_point in [2, 8] {
        let baker = body.baker(&settings(Signal::Ao, 16));
        let baker = baker.fitted(&body.positions, per_point).unwrap();
        let baked = baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap();
        let worst = |worst: f32, ao: &f32| worst.max((ao - 1.0).abs());
        let worst = baked[0].coefficients.iter().fold(0.0, worst);
        assert!(worst < 1e-4, "{per_point} sites a point: {worst}");
    }
}

/// The shadow terminator: a coarse sphere with smooth normals means a round one, whose ambient occlusion is 1
/// everywhere. At its vertices that is so whatever its facets do. Between them rays that start on the facets
/// meet the facets beside: the fit is some hundredths dark. Rays that start on the surface that the normals
/// mean (the default) give 1 to 1e-4.
#[test]
fn a_coarse_smooth_sphere_is_as_round_as_its_normals() {
    let body = Body::sphere(1);
    let settings = settings(Signal::Ao, 256);
    let least = |baked: &BakedPose| baked.coefficients.iter().copied().fold(1.0, f32::min);
    assert_eq!(least(&body.bake(&settings, &[0.0])[0]), 1.0, "at the vertices");
    let fitted = |faceted| {
        let baker = body.baker(&settings);
        let around = Surroundings { faceted, ..Surroundings::default() };
        let baker = baker.within(around).unwrap().fitted(&body.positions, 40).unwrap();
        baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap().swap_remove(0)
    };
    let (smooth, faceted) = (fitted(false), fitted(true));
    assert!(least(&smooth) > 1.0 - 1e-4, "{}", least(&smooth));
    let mean = faceted.coefficients.iter().sum::<f32>() / faceted.coefficients.len() as f32;
    assert!((0.9..0.99).contains(&mean), "{mean}");
}

/// A small roof between the vertices of a coarse floor: vertices sampled at themselves miss it, the
/// fit shows it; its error over the surface, against a bake of a fine floor, is a
/// sixth less at least, which is as much as the coarse triangles can show.
#[test]
fn what_lies_between_vertices_is_seen() {
    let roofed = |side: usize| {
        let mut body = floor(side);
        let points = body.positions.len();
        let c = |x: f32, z: f32| Vec3::new(0.25 + x * 0.2, 0.1, 0.25 + z * 0.2);
        body.quad([c(-1.0, -1.0), c(1.0, -1.0), c(1.0, 1.0), c(-1.0, 1.0)]);
        (body, points)
    };
    let settings = settings(Signal::Ao, 64);
    let bake = |body: &Body, per_point: Option<u32>| {
        let baker = body.baker(&settings);
        let baker = match per_point {
            Some(per_point) => baker.fitted(&body.positions, per_point).unwrap(),
            None => baker,
        };
        baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap().swap_remove(0)
    };
    let (fine, fine_points) = roofed(32);
    let truth = &bake(&fine, None).coefficients[..fine_points];
    let (coarse, _) = roofed(4);
    let error = |values: &[f32]| {
        let squares = fine.positions[..fine_points].iter().zip(truth).map(|(place, truth)| {
            f64::from(interpolated(values, 4, place.x, place.z) - truth).powi(2)
        });
        (squares.sum::<f64>() / fine_points as f64).sqrt()
    };
    let (sampled, fitted) = (bake(&coarse, None), bake(&coarse, Some(40)));
    let (sampled, fitted) = (error(&sampled.coefficients), error(&fitted.coefficients));
    assert!(fitted < 0.83 * sampled, "fitted {fitted}, sampled {sampled}");
}

/// Threads change no bit; what cannot be fitted is refused.
#[test]
fn bits_and_refusals() {
    let mut body = floor(3);
    body.append(&Body::sphere(1).mapped(|p| p * 0.4 + Vec3::Y * 0.5));
    let settings = settings(Signal::Transfer, 32);
    let bake = || {
        let baker = body.baker(&settings).fitted(&body.positions, 5).unwrap();
        baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap()
    };
    let one = bake();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    assert_eq!(pool.install(bake), one);
    let refused = |per_point| body.baker(&settings).fitted(&body.positions, per_point);
    assert!(matches!(refused(0), Err(Error::Sites { found: 0 })));
    let flat = vec![Vec3::ZERO; body.positions.len()];
    assert!(matches!(body.baker(&settings).fitted(&flat, 2), Err(Error::NoSurface)));
}
