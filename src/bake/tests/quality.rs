//! Points in awkward places.

use super::*;

/// The points of a sphere inside another are buried, those of the outer one are not; inside a room,
/// whose walls face inwards, nothing is buried, however dark; half a sphere sunk into a box is.
#[test]
fn points_inside_other_geometry_are_found() {
    let small = Body::sphere(2).mapped(|p| p * 0.3);
    let count = small.positions.len();
    let found = |outer: &Body| {
        let mut body = Body::nothing();
        body.append(&small);
        body.append(outer);
        body.baker(&settings(Signal::Transfer, 16)).buried(&body.posed(0.0)).unwrap()
    };
    let inside = found(&Body::sphere(2));
    assert!(inside[..count].iter().all(|&buried| buried), "{inside:?}");
    assert!(inside[count..].iter().all(|&buried| !buried), "{inside:?}");
    let mut room = Body::cube();
    room.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    room.normals.iter_mut().for_each(|normal| *normal = -*normal);
    assert!(found(&room).iter().all(|&buried| !buried));
    let sunk = found(&Body::cube().mapped(|p| p - Vec3::Y));
    for (point, &buried) in sunk[..count].iter().enumerate() {
        let height = small.positions[point].y;
        // What touches the box's top is neither in nor out.
        assert!(buried == (height < 0.0) || height.abs() < 1e-3, "{point} at {height}");
    }
}

/// Layers that coincide, wound alike or against each other, and layers nearer than any ray could tell
/// do not shadow one another: each sees its half of the sky, at a millimetre, a metre and a kilometre.
#[test]
fn coincident_layers_do_not_shadow_each_other() {
    for scale in [1e-3, 1.0, 1e3] {
        for (against, gap) in [(false, 0.0), (true, 0.0), (true, 1e-7)] {
            let mut body = Body::nothing();
            let c = |x: f32, z: f32| Vec3::new(x, 0.0, z) * scale;
            let upper = [c(-1.0, 1.0), c(1.0, 1.0), c(1.0, -1.0), c(-1.0, -1.0)];
            let lower = upper.map(|corner| corner - Vec3::Y * gap * scale);
            body.quad(upper);
            body.quad(if against { [lower[0], lower[3], lower[2], lower[1]] } else { lower });
            let baked = &body.bake(&settings(Signal::Ao, 256), &[0.0])[0];
            assert!(baked.coefficients.iter().all(|&ao| ao == 1.0), "{scale}: {baked:?}");
        }
    }
}

/// A figure's folds give the same values at a millimetre and at a kilometre as at a metre: lengths
/// are scaled by powers of two, so between such sizes not a bit differs, and between others only
/// rays that pass an edge.
#[test]
fn size_does_not_matter() {
    let mut body = Body::sphere(2);
    let second = Body::sphere(2).mapped(|p| p * 0.7 + Vec3::new(1.2, 0.3, 0.0));
    body.append(&second);
    let bake = |scale: f32| {
        let body = Body {
            positions: body.positions.clone(),
            normals: body.normals.clone(),
            triangles: body.triangles.clone(),
            ..Body::nothing()
        };
        body.mapped(|p| p * scale).bake(&settings(Signal::Ao, 128), &[0.0]).swap_remove(0)
    };
    let metre = bake(1.0);
    assert_eq!(bake(1024.0), metre);
    assert_eq!(bake(1.0 / 1024.0), metre);
    for scale in [1e-3, 1e3] {
        let other = bake(scale);
        let differs = |(a, b): (&f32, &f32)| f64::from((a - b).abs());
        let pairs = || metre.coefficients.iter().zip(&other.coefficients);
        let mean = pairs().map(differs).sum::<f64>() / metre.coefficients.len() as f64;
        assert!(mean < 1e-4, "{scale}: {mean}");
    }
}

/// Along a seam the vertices are there twice, each with the triangles of its side, once with the same
/// normals and once with normals a thousandth apart: both sides get the same ambient occlusion. No pair
/// differs by more than 5.2 standard errors (some 30 pairs, significance 1e-5 for all), 32 repeats.
#[test]
fn both_sides_of_a_seam_agree() {
    for tilt in [0.0, 1e-3] {
        // The sphere's triangles share few vertices: where two meet there is one for each.
        let mut body = Body::sphere(3);
        let seam = |p: Vec3| p.y.abs() < 1e-6;
        let all = || (0..body.positions.len()).filter(|&i| seam(body.positions[i]));
        let twin = |&(a, b): &(usize, usize)| {
            a < b && body.positions[a].distance(body.positions[b]) < 1e-6
        };
        let twins: Vec<_> = all().flat_map(|a| all().map(move |b| (a, b))).filter(twin).collect();
        assert!((20..40).contains(&twins.len()), "{} pairs", twins.len());
        twins.iter().for_each(|&(_, b)| body.normals[b].y += tilt);
        body.append(&Body::sphere(2).mapped(|p| p * 0.8 + Vec3::new(1.4, 0.1, 0.0)));
        let times: Vec<f32> = (0..32).map(|i| i as f32).collect();
        let baked = body.bake(&settings(Signal::Ao, 128), &times);
        let mut shaded = 0;
        for &(a, b) in &twins {
            let mean = |point: usize| {
                baked.iter().map(|pose| f64::from(pose.coefficients[point])).sum::<f64>() / 32.0
            };
            let square = |point: usize| {
                baked.iter().map(|pose| f64::from(pose.noise[point]).powi(2)).sum::<f64>()
            };
            let error = (square(a) + square(b)).sqrt() / 32.0;
            let off = (mean(a) - mean(b)).abs();
            assert!(off <= 5.2 * error + f64::from(tilt), "{a}, {b}: {off} of {error}");
            shaded += usize::from(mean(a) < 0.98);
        }
        assert!(shaded > 3, "{shaded} pairs are shaded");
    }
}
