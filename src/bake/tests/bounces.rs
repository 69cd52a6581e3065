//! Light between surfaces against closed forms.

use std::sync::Arc;

use super::*;
use crate::scene::Surface;

/// The factor from a transfer's first coefficient to ambient light.
const AMBIENT: f64 = 3.544_907_701_811_032; // 2√π

pub(super) fn reflecting(body: &Body, rays: u32, bounces: u32, albedo: [f32; 3]) -> Baker {
    let surface = Arc::new(Surface::plain(albedo, body.triangles.len()));
    let grey = albedo[0] == albedo[1] && albedo[1] == albedo[2];
    let channels = if grey { 1 } else { 3 };
    let baker = body.baker(&settings(Signal::Transfer, rays));
    baker.reflecting(Reflectance { bounces, channels, surface }).unwrap()
}

fn baked(baker: &Baker, body: &Body) -> BakedPose {
    baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap().swap_remove(0)
}

/// The inside of a sphere whose top is missing, and which points are well inside.
fn open_sphere() -> (Body, Vec<usize>) {
    let mut body = Body::sphere(4);
    let height = |corners: &[u32; 3]| corners.map(|c| body.positions[c as usize].y).iter().sum();
    let mut triangles = body.triangles.clone();
    triangles.retain(|t| Vec3::splat(height(t)).x < 3.0 * 0.6);
    body.triangles = triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect();
    body.normals.iter_mut().for_each(|normal| *normal = -*normal);
    let inside = (0..body.positions.len()).filter(|&i| body.positions[i].y < 0.5).collect();
    (body, inside)
}

/// The furnace: inside a sphere with an opening of the share f of its area every point sees f of
/// the sky, and bounce k adds f(ρ(1−f))ᵏ, colour by colour. The polyhedron's f is measured (within 1 %
/// of its area's share); the sums then agree to 1 %, and grow with each bounce to at most
/// f/(1−ρ(1−f)).
#[test]
fn a_sphere_with_a_cap_removed() {
    let (body, inside) = open_sphere();
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|corner| body.positions[corner as usize]);
        f64::from((b - a).cross(c - a).length() / 2.0)
    };
    let whole: f64 = Body::sphere(4).triangles.iter().map(area).sum();
    let opening = 1.0 - body.triangles.iter().map(area).sum::<f64>() / whole;
    let mean = |pose: &BakedPose, channel: usize, channels: usize| {
        let value = |&p: &usize| f64::from(pose.coefficients[(p * channels + channel) * 36]);
        inside.iter().map(value).sum::<f64>() * AMBIENT / inside.len() as f64
    };
    let rays = 128;
    let direct = baked(&body.baker(&settings(Signal::Transfer, rays)), &body);
    let f = mean(&direct, 0, 1);
    assert!((f / opening - 1.0).abs() < 0.01, "f = {f}, opening {opening}");
    let albedo = [0.9, 0.5, 0.0];
    let mut before = f;
    for bounces in [1, 2, 8] {
        let pose = baked(&reflecting(&body, rays, bounces, albedo), &body);
        assert_eq!(pose.coefficients.len(), 3 * direct.coefficients.len());
        for (channel, albedo) in albedo.into_iter().enumerate() {
            let q = f64::from(albedo) * (1.0 - f);
            let truth = f * (1.0 - q.powi(bounces as i32 + 1)) / (1.0 - q);
            let found = mean(&pose, channel, 3);
            assert!((found / truth - 1.0).abs() < 0.01, "{bounces}, {albedo}: {found} {truth}");
        }
        let brightest = mean(&pose, 0, 3);
        assert!(brightest > before && brightest < f / (1.0 - 0.9 * (1.0 - f)) * 1.01);
        before = brightest;
    }
}

/// Under a square ceiling of half-width a at height h a level point has the form factor
/// F = 4/2π · 2 A/√(1+A²) atan(A/√(1+A²)) with A = a/h; the ceiling sees the whole sky below, so one bounce adds ρF,
/// a second nothing. Seen from behind the ceiling adds nothing, and blocks all the same.
#[test]
fn a_ceiling_adds_its_form_factor() {
    let mut body = Body { sensors: usize::MAX, ..Body::nothing() };
    body.positions.extend([Vec3::ZERO, Vec3::Z * 1e-3, Vec3::X * 1e-3]);
    body.normals.extend([Vec3::Y; 3]);
    body.triangles.push([0, 1, 2]);
    let mut turned = Body { sensors: usize::MAX, ..Body::nothing() };
    turned.append(&body);
    let a = 1.5_f32;
    let c = |x: f32, z: f32| Vec3::new(x * a, 1.0, z * a);
    body.quad([c(-1.0, -1.0), c(1.0, -1.0), c(1.0, 1.0), c(-1.0, 1.0)]);
    turned.quad([c(-1.0, -1.0), c(-1.0, 1.0), c(1.0, 1.0), c(1.0, -1.0)]);
    let side = f64::from(a) / f64::from(1.0 + a * a).sqrt();
    let factor = 4.0 * side * side.atan() / std::f64::consts::PI;
    let value = |body: &Body, bounces| {
        let pose = baked(&reflecting(body, 2048, bounces, [0.5; 3]), body);
        f64::from(pose.coefficients[0]) * AMBIENT
    };
    for bounces in [1, 3] {
        let found = value(&body, bounces);
        assert!((found - (1.0 - 0.5 * factor)).abs() < 2e-3, "{bounces}: {found}, {factor}");
    }
    let found = value(&turned, 2);
    assert!((found - (1.0 - factor)).abs() < 2e-3, "{found}, {factor}");
}

/// Black surfaces give the direct bake, to rounding; a convex body has nothing to gather; rows that
/// are traced anew in each pass give the same bits as rows that are kept.
#[test]
fn limits_and_memory() {
    let (body, _) = open_sphere();
    let direct = baked(&body.baker(&settings(Signal::Transfer, 32)), &body);
    let black = baked(&reflecting(&body, 32, 2, [0.0; 3]), &body);
    for (a, b) in black.coefficients.iter().zip(&direct.coefficients) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    let convex = Body::sphere(2);
    let around = baked(&reflecting(&convex, 32, 2, [0.9; 3]), &convex);
    let plain = baked(&convex.baker(&settings(Signal::Transfer, 32)), &convex);
    assert_eq!(around, plain);

    let mut baker = reflecting(&body, 32, 2, [0.8, 0.4, 0.2]);
    let kept = baked(&baker, &body);
    baker.most_row_bytes = 0;
    assert_eq!(baked(&baker, &body), kept);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    assert_eq!(pool.install(|| baked(&baker, &body)), kept);
}

/// The noise that a bounced bake claims is between once and twice the scatter over repeats.
#[test]
fn noise_is_not_understated() {
    let (body, inside) = open_sphere();
    let baker = reflecting(&body, 32, 2, [0.8; 3]);
    let times: Vec<f32> = (0..12).map(|i| i as f32).collect();
    let poses: Vec<PosedMesh<'_>> = times.iter().map(|&t| body.posed(t)).collect();
    let baked = baker.bake(&poses, &AtomicBool::new(false)).unwrap();
    let (mut scatter, mut claimed) = (0.0, 0.0);
    for &point in &inside {
        claimed += baked.iter().map(|b| f64::from(b.noise[point]).powi(2)).sum::<f64>() / 12.0;
        for c in 36 * point..36 * (point + 1) {
            let values: Vec<f64> = baked.iter().map(|b| f64::from(b.coefficients[c])).collect();
            let mean = values.iter().sum::<f64>() / 12.0;
            scatter += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 11.0 / 36.0;
        }
    }
    let ratio = (claimed / scatter).sqrt();
    assert!((0.95..2.0).contains(&ratio), "claimed over found: {ratio}");
}

/// With a target noise the cap sphere's bounces sum up as with stated rays, points get different numbers
/// of rays, the scatter over repeats is within the target of the direct part, and rows that are traced
/// anew give the same bits as rows that are kept.
#[test]
fn bounces_to_a_noise() {
    let (body, inside) = open_sphere();
    let stated = settings(Signal::Transfer, 2048);
    let noise = Noise { target: 0.01, goal: NoiseGoal::Mean };
    let mut baker = reflecting(&body, 2048, 2, [0.8; 3]).to_noise(noise, &stated).unwrap();
    let times: Vec<f32> = (0..6).map(|i| i as f32).collect();
    let poses: Vec<PosedMesh<'_>> = times.iter().map(|&t| body.posed(t)).collect();
    let adaptive = baker.bake(&poses, &AtomicBool::new(false)).unwrap();
    let fixed = baked(&reflecting(&body, 512, 2, [0.8; 3]), &body);
    let mean = |pose: &BakedPose| {
        let value = |&p: &usize| f64::from(pose.coefficients[p * 36]);
        inside.iter().map(value).sum::<f64>() / inside.len() as f64
    };
    assert!((mean(&adaptive[0]) / mean(&fixed) - 1.0).abs() < 0.005);
    assert!(adaptive[0].rays.iter().any(|&rays| rays != adaptive[0].rays[0]));
    let mut scatter = 0.0;
    for c in 0..fixed.coefficients.len() {
        let values: Vec<f64> = adaptive.iter().map(|b| f64::from(b.coefficients[c])).collect();
        let mean = values.iter().sum::<f64>() / 6.0;
        scatter += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 5.0;
    }
    let rms = (scatter / fixed.coefficients.len() as f64).sqrt();
    assert!((0.004..0.01).contains(&rms), "{rms}");
    baker.most_row_bytes = 0;
    assert_eq!(baker.bake(&poses[..1], &AtomicBool::new(false)).unwrap()[0], adaptive[0]);
}

/// What cannot be baked is refused by what it is.
#[test]
fn nonsense_is_refused() {
    let body = Body::sphere(0);
    let surface = Arc::new(Surface::default());
    let refused = |signal, bounces, channels| {
        let surface = Arc::clone(&surface);
        let reflectance = Reflectance { bounces, channels, surface };
        body.baker(&settings(signal, 16)).reflecting(reflectance).expect_err("must be refused")
    };
    assert!(matches!(refused(Signal::Ao, 1, 1), Error::BouncesOf { signal: "ao" }));
    assert_eq!(refused(Signal::Transfer, 0, 1), Error::Bounces { found: 0 });
    assert_eq!(refused(Signal::Transfer, 9, 1), Error::Bounces { found: 9 });
    assert_eq!(refused(Signal::Transfer, 1, 2), Error::Channels { found: 2 });
}
