//! Closed forms of what stands around the points.

use super::*;

fn baked(body: &Body, settings: &Settings, around: Surroundings) -> Vec<BakedPose> {
    let times: Vec<f32> = (0..64).map(|i| i as f32).collect();
    let poses: Vec<PosedMesh<'_>> = times.iter().map(|&t| body.posed(t)).collect();
    let baker = body.baker(settings).within(around).unwrap();
    baker.bake(&poses, &AtomicBool::new(false)).unwrap()
}

/// A point's mean over the repeats, and its deviation from the truth in standard errors.
fn z(poses: &[BakedPose], point: usize, truth: f64) -> f64 {
    let count = poses.len() as f64;
    let mean = poses.iter().map(|pose| f64::from(pose.coefficients[point])).sum::<f64>() / count;
    let squares: f64 = poses.iter().map(|pose| f64::from(pose.noise[point]).powi(2)).sum();
    let error = squares.sqrt() / count;
    if error == 0.0 {
        if mean == truth { 0.0 } else { f64::INFINITY }
    } else {
        (mean - truth) / error
    }
}

/// A sphere on level ground, and at every height above: a point with normal n loses exactly the
/// part (1 − n·y)/2 of its sky to an endless plane, wherever it is. The ground is not a
/// triangle, so the facets do not matter. Significance 1e-5 for each of 66 points, seed 1.
#[test]
fn a_sphere_on_a_plane() {
    let body = Body::sphere(2);
    for below in [0.0, 0.5, 40.0] {
        let around = Surroundings { ground_m: Some(-1.0 - below), ..Surroundings::default() };
        let poses = baked(&body, &settings(Signal::Ao, 256), around);
        for (point, normal) in body.normals.iter().enumerate() {
            let truth = f64::from(1.0 + normal.y) / 2.0;
            let z = z(&poses, point, truth);
            assert!(z.abs() < 5.2, "height {below}, normal {normal}: z = {z}");
        }
    }
}

/// On the ground a box's lower corners see half of the sky from its sides and nothing from its
/// bottom, exactly: no offset of ray origins shows. Below the ground everything is dark.
#[test]
fn contact_is_exact() {
    let body = Body::cube();
    for (ground, lowest) in [(-1.0, 0.5), (-0.999, 0.0)] {
        let around = Surroundings { ground_m: Some(ground), ..Surroundings::default() };
        let poses = baked(&body, &settings(Signal::Ao, 256), around);
        for (point, (position, normal)) in body.positions.iter().zip(&body.normals).enumerate() {
            let truth = match (position.y < 0.0, normal.y) {
                (_, y) if y > 0.5 => 1.0,
                (_, y) if y < -0.5 => 0.0,
                (true, _) => lowest,
                (false, _) => 0.5,
            };
            let z = z(&poses, point, truth);
            assert!(z.abs() < 5.2, "ground {ground}, {position} {normal}: z = {z}");
        }
    }
}

/// The ground is what a very large quad of triangles is: coefficients of every signal agree ray by
/// ray, but for the few rays that pass the quad's edge.
#[test]
fn the_ground_is_a_large_quad() {
    let body = Body::sphere(2).mapped(|p| p + Vec3::Y * 1.5);
    let mut floored =
        Body { sensors: body.positions.len(), ..Body::sphere(2) }.mapped(|p| p + Vec3::Y * 1.5);
    let far = 1e3;
    let corner = |x, z| Vec3::new(x, 0.0, z) * far;
    floored.quad([corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)]);
    for signal in SIGNALS {
        let settings = settings(signal, 128);
        let around = Surroundings { ground_m: Some(0.0), ..Surroundings::default() };
        let ground = &baked(&body, &settings, around)[0];
        let quad = &floored.bake(&settings, &[0.0])[0];
        let pairs = ground.coefficients.iter().zip(&quad.coefficients);
        let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // One ray of 128 weighs at most 2π·max|y|/128.
        assert!(worst < 0.15, "{signal:?}: {worst}");
        let squares: f32 =
            ground.coefficients.iter().zip(&quad.coefficients).map(|(a, b)| (a - b).powi(2)).sum();
        let rms = (squares / ground.coefficients.len() as f32).sqrt();
        assert!(rms < 0.01, "{signal:?}: {rms}");
    }
}

/// A roof at distance h that falls off linearly over D takes away ∫ 2 cos θ sin θ (1 − h/(D cos θ))
/// = 1 − 2h/D + (h/D)² of a level point's sky, nothing nearer than the minimum distance counts.
#[test]
fn falloff_under_a_roof() {
    let mut body = Body { sensors: 3, ..Body::nothing() };
    body.positions.extend([Vec3::ZERO, Vec3::Z * 1e-3, Vec3::X * 1e-3]);
    body.normals.extend([Vec3::Y; 3]);
    body.triangles.push([0, 1, 2]);
    let corner = |x: f32, z: f32| Vec3::new(x * 1e3, 1.0, z * 1e3);
    body.quad([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    let most = 4.0;
    let limited = Settings { max_distance_m: Some(most), ..settings(Signal::Ao, 256) };
    let around = Surroundings { falloff: Some(1.0), ..Surroundings::default() };
    let h = 1.0 / f64::from(most);
    let z = z(&baked(&body, &limited, around), 0, 2.0 * h - h * h);
    assert!(z.abs() < 4.4, "z = {z}");
    let around = Surroundings { min_distance_m: 3.99, ..Surroundings::default() };
    let open = &baked(&body, &limited, around)[0];
    // Only rays of 3.99 m to 4 m count: cos θ within 0.25 and 0.2506, 3e-4 of the sky.
    assert!(open.coefficients[0] > 0.99, "{}", open.coefficients[0]);
}

/// Two spheres within one another: in views of their own each is convex and so unoccluded, without
/// views the inner one is dark. Vertices without a point block and are not baked.
#[test]
fn views_hide_and_occluders_block() {
    let inner = Body::sphere(2);
    let count = inner.positions.len();
    let mut both = Body::sphere(2);
    both.append(&Body::sphere(2).mapped(|p| p * 3.0));
    let settings = settings(Signal::Ao, 64);
    let dark = &both.bake(&settings, &[0.0])[0];
    assert!(dark.coefficients[..count].iter().all(|&ao| ao == 0.0));

    let outer_triangles = inner.triangles.len()..both.triangles.len();
    let view = View { points: (0..count as u32).collect(), hidden: vec![outer_triangles] };
    let around = Surroundings { views: vec![view], ..Surroundings::default() };
    let poses = baked(&both, &settings, around);
    assert!(poses[0].coefficients.iter().all(|&ao| ao == 1.0));

    let mut points = both.points();
    points.vertex.truncate(count);
    points.of_vertex[count..].fill(NO_POINT);
    let baker = Baker::new(&both.triangles, &points, &settings).unwrap();
    let baked = baker.bake(&[both.posed(0.0)], &AtomicBool::new(false)).unwrap();
    assert_eq!(baked[0].coefficients, vec![0.0; count]);
}

/// What cannot be traced is refused by what it is.
#[test]
fn nonsense_is_refused() {
    let body = Body::sphere(0);
    let refused = |settings: &Settings, around: Surroundings| {
        body.baker(settings).within(around).expect_err("must be refused")
    };
    let ao = settings(Signal::Ao, 16);
    let none = Surroundings::default;
    for found in [-1.0, f32::NAN, f32::INFINITY] {
        let error = refused(&ao, Surroundings { min_distance_m: found, ..none() });
        assert!(matches!(error, Error::MinDistance { .. }), "{error}");
    }
    let error = refused(&ao, Surroundings { ground_m: Some(f32::NAN), ..none() });
    assert!(matches!(error, Error::Ground { .. }));
    assert_eq!(refused(&ao, Surroundings { falloff: Some(1.0), ..none() }), Error::FalloffOf);
    let limited = Settings { max_distance_m: Some(1.0), ..ao };
    let error = refused(&limited, Surroundings { falloff: Some(0.0), ..none() });
    assert!(matches!(error, Error::Falloff { .. }));
    let view = View { points: vec![600], hidden: vec![] };
    let error = refused(&ao, Surroundings { views: vec![view], ..none() });
    assert!(matches!(error, Error::Points { value: 600, .. }));
}

/// A speck far away changes no bit of what is baked, on whichever scale: the tracer's numbers go by the points.
#[test]
fn far_occluders_are_harmless() {
    for size in [1e-3_f32, 1.0, 1e3] {
        let mut body = Body::sphere(2);
        body.positions.iter_mut().for_each(|p| *p = *p * size + Vec3::splat(0.3 * size));
        let points = body.positions.len();
        let bake = |body: &Body| {
            let mut own = Points { vertex: (0..points as u32).collect(), ..Points::default() };
            own.of_vertex = (0..body.positions.len() as u32).collect();
            own.of_vertex[points..].fill(NO_POINT);
            let baker = Baker::new(&body.triangles, &own, &settings(Signal::Ao, 64)).unwrap();
            let cancelled = AtomicBool::new(false);
            baker.bake(&[body.posed(0.0)], &cancelled).unwrap().swap_remove(0).coefficients
        };
        // A lid, so that something blocks.
        let lid = [[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]];
        body.quad(lid.map(|[x, z]| size * Vec3::new(x, 1.8, z)));
        let near = bake(&body);
        for far in [1e4, 1e6, 1e20, 1e30] {
            let mut body = body.clone();
            body.quad(lid.map(|[x, z]| Vec3::new(far, x, z)));
            let found = bake(&body);
            assert!(found.iter().all(|ao| ao.is_finite()), "{far}");
            let same = found == near;
            assert!(same || far > 1e9, "{size} {far}");
        }
    }
}
