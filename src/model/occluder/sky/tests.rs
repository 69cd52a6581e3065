use super::*;
use crate::num::random::Stream;

const ORDER: u8 = 3;

fn ball(centre: Vec3, radius: f32) -> Ellipsoid {
    Ellipsoid { centre, shape: Mat3::from_diagonal(Vec3::splat(1.0 / radius)), radius }
}

/// What is taken of each direction, one after another, from points at the origin and around it.
fn taken(
    sky: &Sky,
    ellipsoids: &[Ellipsoid],
    positions: &[Vec3; LANES],
    normal: Vec3,
) -> (View, Vec<Lanes>) {
    let by_axis = |v: &[Vec3; LANES]| [0, 1, 2].map(|axis| v.map(|v| v[axis]));
    let (position, normal) = (by_axis(positions), by_axis(&[normal; LANES]));
    let mut view = sky.view();
    sky.look(&normal, &mut view);
    let mut taken = vec![[0.0; LANES]; sky.directions()];
    let mut touched = vec![false; sky.bundles()];
    let mut through = SeenThrough::default();
    for ellipsoid in ellipsoids {
        sky.see_through(ellipsoid, &mut through);
        let out = (&mut taken[..], &mut touched[..]);
        sky.block((&position, &normal), &through, &[1.0; LANES], &mut view, out);
    }
    (view, taken)
}

fn sums(sky: &Sky, (view, taken): &(View, Vec<Lanes>)) -> Vec<Lanes> {
    let mut sums = vec![[0.0; LANES]; sky.coefficients()];
    for bundle in 0..sky.bundles() {
        sky.add(view, bundle, taken, &mut sums);
    }
    sums
}

fn kind(signal: Signal) -> (Signal, Order) {
    (signal, Order::new(ORDER).unwrap())
}

/// Proves that directions are spread evenly: their harmonics sum to nothing but the constant, and
/// everything blocked is the unshadowed signal.
#[test]
fn directions_are_a_quadrature() {
    for signal in [Signal::Ao, Signal::Transfer] {
        let sky = Sky::new(256, kind(signal));
        let normal = Vec3::new(0.3, -0.5, 0.7).normalize();
        let view_and_all = {
            let (view, _) = taken(&sky, &[], &[Vec3::ZERO; LANES], normal);
            (view, vec![[1.0; LANES]; sky.directions()])
        };
        let found = sums(&sky, &view_and_all);
        let mut expected = vec![0.0; sky.coefficients()];
        crate::model::unshadowed(kind(signal), normal, &mut expected);
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found[3] - expected).abs() < 0.01, "{signal}: {} {expected}", found[3]);
        }
    }
}

/// Proves that a ball blocks its cap's cosine-weighted share, s²c, near and far, whatever the
/// directions' distance.
#[test]
fn caps_have_their_share() {
    let sky = Sky::new(512, kind(Signal::Ao));
    for (distance, share) in [(2.0_f32, 0.9_f32), (2.0, 0.5), (3.0, 0.3), (3.0, 0.15)] {
        let mut total = (0.0, 0.0);
        for turn in 0..40 {
            let angle = turn as f32 * 0.7;
            let towards = Vec3::new(0.3 * angle.cos(), 0.3 * angle.sin(), 1.0).normalize();
            let ball = ball(distance * towards, share * distance);
            let found = sums(&sky, &taken(&sky, &[ball], &[Vec3::ZERO; LANES], Vec3::Z))[0][0];
            total.0 += found;
            total.1 += share * share * towards.z;
        }
        // A cap that reaches the horizon blocks what is above it only: less than the formula.
        let ratio = total.0 / total.1;
        let expected = if share > 0.8 { 0.85..1.02 } else { 0.95..1.05 };
        assert!(expected.contains(&ratio), "{distance} {share}: {ratio}");
    }
}

/// Proves that what hides behind another blocks nothing, that halves add up, and that the order in
/// which ellipsoids come changes nothing in their sum.
#[test]
fn a_union_counts_once() {
    let sky = Sky::new(256, kind(Signal::Transfer));
    let all = |of: &[Ellipsoid]| sums(&sky, &taken(&sky, of, &[Vec3::ZERO; LANES], Vec3::Z));
    let (near, far) = (ball(Vec3::Z, 0.5), ball(Vec3::new(0.0, 0.1, 4.0), 0.4));
    let aside = ball(Vec3::new(0.6, 0.0, 1.0), 0.4);
    let close = |a: &[Lanes], b: &[Lanes]| a.iter().zip(b).all(|(a, b)| (a[0] - b[0]).abs() < 1e-5);
    assert!(close(&all(&[near, far]), &all(&[near])));
    // A twin takes of the soft edge alone what the first has left.
    let (twins, one) = (all(&[near, near])[0][0], all(&[near])[0][0]);
    assert!((twins / one - 1.0).abs() < 0.06, "{twins} {one}");
    assert!(close(&all(&[near, aside]), &all(&[aside, near])));
    let apart: Vec<Lanes> =
        all(&[near]).iter().zip(&all(&[aside])).map(|(a, b)| [a[0] + b[0]; LANES]).collect();
    assert!(!close(&all(&[near, aside]), &apart), "they overlap");
}

/// Proves against rays: a disc is covered where a ray in the direction meets it, face on and edge on,
/// wherever the point is, and nothing below the horizon or behind.
#[test]
fn ellipsoids_are_where_rays_meet_them() {
    let sky = Sky::new(1024, kind(Signal::Visibility));
    let mut stream = Stream::new(3);
    let mut vector =
        |scale: f64| Vec3::from_array([(); 3].map(|()| (scale * stream.normal()) as f32));
    let (mut wrong, mut count) = (0, 0);
    for _ in 0..20 {
        let axes = Mat3::from_quat(
            glam::Quat::from_xyzw(vector(1.0).x, vector(1.0).x, vector(1.0).x, 1.0).normalize(),
        );
        let radii = Vec3::new(0.5, 0.3, 0.02);
        let shape = axes * Mat3::from_diagonal(radii.recip()) * axes.transpose();
        let ellipsoid = Ellipsoid { centre: vector(1.0), shape, radius: 0.5 };
        let positions = [(); LANES].map(|()| vector(0.05));
        let normal = vector(1.0).normalize();
        let (_, taken) = taken(&sky, &[ellipsoid], &positions, normal);
        for (d, lanes) in taken.iter().enumerate() {
            let bundle = &sky.bundles[d / LANES];
            let direction = Vec3::from_array(bundle.directions.map(|axis| axis[d % LANES]));
            for (position, &covered) in positions.iter().zip(lanes) {
                let p = shape * (ellipsoid.centre - *position);
                // A cap as small as the directions' distances is softened as a whole.
                if !(1.2..6.0).contains(&p.length()) || direction.dot(normal) <= 0.0 {
                    continue;
                }
                let u = (shape * direction).normalize();
                let along = p.dot(u);
                let apart = (p - along * u).length();
                let below = (ellipsoid.centre - *position).dot(normal) <= -ellipsoid.radius;
                let hit = along > 0.0 && apart < 1.0 && !below;
                // The edge itself is soft.
                if (apart - 1.0).abs() > 0.15 {
                    count += 1;
                    wrong += usize::from(hit != (covered > 0.5));
                }
            }
        }
    }
    assert!(count > 5_000, "{count}");
    assert!(wrong * 200 < count, "{wrong} of {count}");
}

/// Proves that the cones pass over nothing: points together and points apart see the same.
#[test]
fn cones_pass_over_nothing() {
    let sky = Sky::new(256, kind(Signal::Ao));
    let mut stream = Stream::new(5);
    let mut vector =
        |scale: f64| Vec3::from_array([(); 3].map(|()| (scale * stream.normal()) as f32));
    for _ in 0..30 {
        let stretch = Mat3::from_diagonal(Vec3::new(2.0, 5.0, 30.0));
        let ellipsoid = Ellipsoid { centre: vector(0.8), shape: stretch, radius: 0.5 };
        let spread: [Vec3; LANES] = [(); LANES].map(|()| vector(0.2));
        let normal = vector(1.0).normalize();
        let (_, together) = taken(&sky, &[ellipsoid], &spread, normal);
        for (lane, &position) in spread.iter().enumerate() {
            let (_, alone) = taken(&sky, &[ellipsoid], &[position; LANES], normal);
            for (a, b) in together.iter().zip(&alone) {
                assert!((a[lane] - b[0]).abs() < 1e-6, "{} {}", a[lane], b[0]);
            }
        }
    }
}
