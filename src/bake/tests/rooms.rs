//! Rooms whose light is known in closed form.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::DVec3;

use super::*;
use crate::scene::Surface;

/// The cosine-weighted share of a polygon above a place's horizon, counter-clockwise seen from it
/// (Lambert): (1/2π) Σ angle of an edge · (edge's plane normal · n).
fn share(place: DVec3, normal: DVec3, polygon: &[DVec3]) -> f64 {
    let towards = |i: usize| (polygon[i % polygon.len()] - place).normalize();
    let edge = |i: usize| {
        let (a, b) = (towards(i), towards(i + 1));
        a.angle_between(b) * a.cross(b).normalize().dot(normal)
    };
    (0..polygon.len()).map(edge).sum::<f64>() / (2.0 * PI)
}

/// A box from −1 to 1 in x and z, open at the top, `depth` deep: its ambient occlusion is the form factor
/// of the opening, on the floor and on a wall alike, in closed form by Lambert's sum over edges. H₀ is
/// rejected for none of 5 places at |z| > 4.4 (significance 1e-5 each), 64 repeats of 512 rays.
#[test]
fn an_open_box() {
    let depth = 1.5;
    let places = [
        (Vec3::ZERO, Vec3::Y),
        (Vec3::new(0.6, 0.0, -0.3), Vec3::Y),
        (Vec3::new(-0.95, 0.0, 0.95), Vec3::Y),
        (Vec3::new(-1.0, 0.4, 0.2), Vec3::X),
        (Vec3::new(0.3, 1.3, 1.0), -Vec3::Z),
    ];
    let mut body = Body { sensors: 3 * places.len(), ..Body::nothing() };
    for (place, normal) in places {
        let first = body.positions.len() as u32;
        let [u, v] = [normal.any_orthonormal_vector() * 1e-3, Vec3::ZERO];
        let v = v + normal.cross(u);
        body.positions.extend([place, place + u, place + v]);
        body.normals.extend([normal; 3]);
        body.triangles.push([first, first + 1, first + 2]);
    }
    let c = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let wall = |a: Vec3, b: Vec3| [a, b, b + Vec3::Y * depth, a + Vec3::Y * depth];
    let floor = [c(-1.0, 0.0, 1.0), c(1.0, 0.0, 1.0), c(1.0, 0.0, -1.0), c(-1.0, 0.0, -1.0)];
    body.quad(floor);
    for side in 0..4 {
        body.quad(wall(floor[(side + 1) % 4], floor[side]));
    }
    let opening = floor.map(|corner| (corner + Vec3::Y * depth).as_dvec3());
    let times: Vec<f32> = (0..64).map(|i| i as f32).collect();
    let baked = body.bake(&settings(Signal::Ao, 512), &times);
    for (sensor, (place, normal)) in places.into_iter().enumerate() {
        let truth = share(place.as_dvec3(), normal.as_dvec3(), &opening).abs();
        let value = |pose: &BakedPose| f64::from(pose.coefficients[3 * sensor]);
        let mean = baked.iter().map(value).sum::<f64>() / 64.0;
        let squares: f64 = baked.iter().map(|b| f64::from(b.noise[3 * sensor]).powi(2)).sum();
        let z = (mean - truth) / (squares.sqrt() / 64.0);
        assert!(z.abs() < 4.4, "{place}: z = {z}, {mean} for {truth}");
    }
}

/// The same box from its own vertices, which all lie in the planes of two or three faces, as single
/// sheets that share no points, turned at random: floor and walls see of the opening what the closed form
/// says just inside of the edge, at every scale. By rounding alone they would see through the
/// neighbouring face here and there.
#[test]
fn edges_of_an_open_box() {
    let c = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let mut body = Body::nothing();
    let walls = [c(-1.0, 0.0, 1.0), c(1.0, 0.0, 1.0), c(1.0, 0.0, -1.0), c(-1.0, 0.0, -1.0)];
    for (from, to) in [(-1.0, 0.0), (0.0, 1.0)] {
        body.quad([c(from, 0.0, 1.0), c(to, 0.0, 1.0), c(to, 0.0, -1.0), c(from, 0.0, -1.0)]);
    }
    let up = Vec3::Y * 1.5;
    for side in 0..4 {
        let (a, b) = (walls[(side + 1) % 4], walls[side]);
        body.quad([a, b, b + up, a + up]);
    }
    let opening = walls.map(|corner| (corner + up).as_dvec3());
    let plain = body.positions.clone();
    let middle = DVec3::new(0.0, 0.75, 0.0);
    for (turn, scale) in [(0.0, 1.0_f32), (0.7, 1.0), (2.1, 1e-3), (4.0, 1e3)] {
        let rotation = glam::Quat::from_axis_angle(Vec3::new(0.3, 0.8, -0.52).normalize(), turn);
        let mut turned = Body { ..Body::nothing() };
        turned.append(&body);
        turned.positions.iter_mut().for_each(|p| *p = rotation * *p * scale + Vec3::X * scale);
        turned.normals.iter_mut().for_each(|n| *n = rotation * *n);
        let baked = turned.bake(&settings(Signal::Ao, 8192), &[0.0]);
        for (vertex, found) in baked[0].coefficients.iter().enumerate() {
            // Upper corners of walls lie in the opening's plane, where the closed form has no value.
            if plain[vertex].y > 1.0 {
                continue;
            }
            let place = plain[vertex].as_dvec3();
            let inside = place + (middle - place) * 1e-4;
            let truth = share(inside, body.normals[vertex].as_dvec3(), &opening).abs();
            let error = f64::from(*found) - truth;
            assert!(error.abs() < 0.02, "{place} at {turn}, {scale}: {found} for {truth}");
        }
    }
}

/// Two facing squares of half-width 1 at a distance h: each place sees the sky beside the other,
/// t⁰ = 1 − F, and each bounce adds tᵏ⁺¹(x) = ρ ∫ K tᵏ over the other, K = h²/(π d⁴), here by quadrature over
/// 40² cells. In the middle and off it the bake's sums over one and two bounces agree to 1 %.
#[test]
fn facing_planes() {
    let (h, albedo, cells, fine) = (0.8_f32, 0.8, 12_usize, 40_usize);
    let mut body = Body::nothing();
    for top in [false, true] {
        let first = body.positions.len() as u32;
        let (y, normal) = if top { (h, -Vec3::Y) } else { (0.0, Vec3::Y) };
        let at = |k: usize| k as f32 / cells as f32 * 2.0 - 1.0;
        for i in 0..=cells {
            body.positions.extend((0..=cells).map(|j| Vec3::new(at(i), y, at(j))));
            body.normals.extend(vec![normal; cells + 1]);
        }
        for i in 0..cells {
            for j in 0..cells {
                let [a, b] = [i, i + 1].map(|i| first + (i * (cells + 1) + j) as u32);
                body.triangles.extend([[a, a + 1, b], [b, a + 1, b + 1]]);
            }
        }
    }
    let h = f64::from(h);
    let corner = |x: f64, z: f64| DVec3::new(x, h, z);
    let square = [corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)];
    let direct = |x: f64, z: f64| 1.0 - share(DVec3::new(x, 0.0, z), DVec3::Y, &square).abs();
    let at = |k: usize| (k as f64 + 0.5) / fine as f64 * 2.0 - 1.0;
    let gathered = |x: f64, z: f64, from: &[f64]| {
        let cell = |(k, value): (usize, &f64)| {
            let d = (at(k / fine) - x).powi(2) + (at(k % fine) - z).powi(2) + h * h;
            value * h * h / (PI * d * d)
        };
        let area = (2.0 / fine as f64).powi(2);
        albedo * area * from.iter().enumerate().map(cell).sum::<f64>()
    };
    let of_cells = |value: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
        (0..fine * fine).map(|k| value(at(k / fine), at(k % fine))).collect()
    };
    let first = of_cells(&direct);
    let second = of_cells(&|x, z| gathered(x, z, &first));
    for bounces in [1, 2] {
        let surface = Arc::new(Surface::plain([albedo as f32; 3], body.triangles.len()));
        let reflectance = Reflectance { bounces, channels: 1, surface };
        let baker = body.baker(&settings(Signal::Transfer, 1024)).reflecting(reflectance).unwrap();
        let pose = baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap().swap_remove(0);
        for (i, j) in [(cells / 2, cells / 2), (cells / 2 + 3, cells / 2 - 2), (1, 3)] {
            let point = i * (cells + 1) + j;
            let [x, z] = [i, j].map(|k| k as f64 / cells as f64 * 2.0 - 1.0);
            let mut truth = direct(x, z) + gathered(x, z, &first);
            if bounces == 2 {
                truth += gathered(x, z, &second);
            }
            let found = f64::from(pose.coefficients[point * 36]) * 2.0 * PI.sqrt();
            assert!((found / truth - 1.0).abs() < 0.01, "{bounces}: {found} for {truth}");
        }
    }
}
