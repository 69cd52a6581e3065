use std::f32::consts::PI;

use super::*;
use crate::shade::Brdf;
use crate::trace::shapes::sphere;

fn camera(size: u32) -> Camera {
    Camera::around([Vec3::splat(-1.0), Vec3::ONE], [0.4, 0.3], [size, size])
}

/// A convex body is open everywhere: ambient occlusion is exactly 1 wherever it is seen, and under
/// a light the truth is the reflection of an open surface, as far as the mesh is fine.
#[test]
fn convex_bodies_are_open() {
    let (positions, triangles) = sphere(3);
    let device = Device::new().unwrap();
    let stage = Stage::new(&device, &positions, &positions, &triangles, None).unwrap();
    let image = stage.truth(&camera(24), 2, 32, &Light::Ambient);
    assert!(image.coverage.iter().filter(|c| **c > 0.0).count() > 80);
    for (value, coverage) in image.values.iter().zip(&image.coverage) {
        let expected = if *coverage > 0.0 { [1.0; 3] } else { [0.0; 3] };
        assert_eq!(*value, expected);
    }
    let order = Order::new(6).unwrap();
    let sky = ShLight::cone(order, [0.3, 1.0, 0.2], 0.8, [1.0, 0.5, 2.0]).unwrap();
    let image = stage.truth(&camera(12), 1, 16, &Light::Environment(sky.clone()));
    let open: Vec<f32> = positions
        .iter()
        .flat_map(|&n| {
            let Shader::Environment { order, reflected, .. } =
                Shader::new(&Light::Environment(sky.clone()))
            else {
                unreachable!("an environment is one")
            };
            at(order, &reflected, n)
        })
        .collect();
    let shown = stage.show(&camera(12), 1, &open);
    assert_eq!(shown.coverage, image.coverage);
    for (a, b) in shown.values.iter().zip(&image.values) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.03), "{a:?} {b:?}");
    }
}

/// Looked at from inside its open top, the floor of a long trench of half width w and depth h sees
/// the sky between its walls: ambient occlusion w/√(w² + h²) in the middle of the floor. Under a
/// constant light of radiance 3 the reflection is three times that.
#[test]
fn a_trench_has_its_closed_form() {
    let (w, h, long) = (1.0_f32, 1.5, 300.0);
    let quad = |a: Vec3, b: Vec3, c: Vec3, d: Vec3| [a, b, c, d];
    let corner = |x: f32, y: f32, z: f32| Vec3::new(x, y, z * long);
    let parts = [
        (
            quad(
                corner(-w, 0.0, -1.0),
                corner(-w, 0.0, 1.0),
                corner(w, 0.0, 1.0),
                corner(w, 0.0, -1.0),
            ),
            Vec3::Y,
        ),
        (
            quad(
                corner(-w, 0.0, -1.0),
                corner(-w, h, -1.0),
                corner(-w, h, 1.0),
                corner(-w, 0.0, 1.0),
            ),
            Vec3::X,
        ),
        (
            quad(corner(w, 0.0, -1.0), corner(w, 0.0, 1.0), corner(w, h, 1.0), corner(w, h, -1.0)),
            Vec3::NEG_X,
        ),
    ];
    let positions: Vec<Vec3> = parts.iter().flat_map(|(quad, _)| *quad).collect();
    let normals: Vec<Vec3> = parts.iter().flat_map(|(_, normal)| [*normal; 4]).collect();
    let triangles: Vec<[u32; 3]> =
        (0..3).flat_map(|part| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| i + 4 * part))).collect();
    let device = Device::new().unwrap();
    let stage = Stage::new(&device, &positions, &normals, &triangles, None).unwrap();
    let camera = Camera::around([Vec3::splat(-0.02), Vec3::splat(0.02)], [0.0, 1.5], [9, 9]);
    let expected = w / (w * w + h * h).sqrt();
    let constant = ShLight::constant(Order::new(2).unwrap(), [3.0, 0.0, 1.0]).unwrap();
    for (light, scale) in [(Light::Ambient, 1.0), (Light::Environment(constant), 3.0)] {
        let image = stage.truth(&camera, 1, 2048, &light);
        let middle = image.values[4 * 9 + 4][0];
        assert!((middle - scale * expected).abs() < 0.005 * scale, "{middle} {expected}");
    }
    // Nothing within 0.5 of the middle blocks it.
    let near = Stage::new(&device, &positions, &normals, &triangles, Some(0.5)).unwrap();
    assert_eq!(near.truth(&camera, 1, 64, &Light::Ambient).values[40], [1.0; 3]);
}

/// Blocked light is taken away in its own colour: under a light from one side only, the truth of
/// a blocked place agrees with a plain sum over directions that knows nothing of harmonics' tables.
#[test]
fn truth_agrees_with_a_plain_sum() {
    let (mut positions, mut triangles) = sphere(2);
    let mut normals = positions.clone();
    // A lid over the ball.
    let lid = [[-2.0, 1.5, -2.0], [-2.0, 1.5, 2.0], [0.5, 1.5, 2.0], [0.5, 1.5, -2.0]];
    let first = positions.len() as u32;
    positions.extend(lid.map(Vec3::from));
    normals.extend([Vec3::Y; 4]);
    triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| first + i)));
    let device = Device::new().unwrap();
    let stage = Stage::new(&device, &positions, &normals, &triangles, None).unwrap();
    let order = Order::new(4).unwrap();
    let light = ShLight::cone(order, [-0.5, 1.0, 0.1], 0.6, [1.0, 0.2, 0.0]).unwrap();
    let shader = Shader::new(&Light::Environment(light.clone()));
    let normal = Vec3::new(0.0, 1.0, 0.0);
    let origin = normal * 1.01;
    let directions = Directions::new(Density::Cosine, SETS, 4096, 1);
    let found = shader.shade(&stage, &directions, origin, normal, 7);
    let (mut sum, steps) = ([0.0_f32; 3], 160);
    for i in 0..steps {
        for j in 0..steps {
            let z = (i as f32 + 0.5) / steps as f32;
            let angle = 2.0 * PI * (j as f32 + 0.5) / steps as f32;
            let r = (1.0 - z * z).sqrt();
            let d = Vec3::new(r * angle.cos(), z, r * angle.sin());
            let up = 0.49 / d.y;
            let blocked = (-2.0..=0.5).contains(&(d.x * up)) && (d.z * up).abs() <= 2.0;
            if !blocked {
                let weight = z * 2.0 / (steps * steps) as f32;
                let l = light.radiance(d.as_dvec3().to_array());
                (0..3).for_each(|c| sum[c] += weight * l[c] as f32);
            }
        }
    }
    for (a, b) in found.iter().zip(sum) {
        assert!((a - b).abs() < 0.004, "{found:?} {sum:?}");
    }
}

/// A Lambert surface as a reflectance is the diffuse truth of a white one times its albedo, to the
/// noise of its rays.
#[test]
fn lambert_reflects_as_the_diffuse_truth() {
    let (positions, triangles) = sphere(3);
    let device = Device::new().unwrap();
    let stage = Stage::new(&device, &positions, &positions, &triangles, None).unwrap();
    let light = ShLight::cone(Order::new(3).unwrap(), [0.0, 1.0, 0.5], 0.9, [1.0; 3]).unwrap();
    let lambert = Brdf::Lambert { albedo: [0.5, 0.25, 1.0] };
    let found = stage.reflected(&camera(8), (1, 1024), &light, &lambert);
    let expected = stage.truth(&camera(8), 1, 2, &Light::Environment(light));
    for (a, b) in found.values.iter().zip(&expected.values) {
        for (a, b) in a.iter().zip([0.5 * b[0], 0.25 * b[1], b[2]]) {
            assert!((a - b).abs() < 0.005, "{a} {b}");
        }
    }
}
