//! The same bytes however the work is divided.

use super::*;

fn bits(baked: &[BakedPose]) -> Vec<u32> {
    let of_pose = |b: &BakedPose| {
        let floats = b.coefficients.iter().chain(&b.noise).map(|x| x.to_bits());
        floats.chain(b.rays.iter().copied()).collect::<Vec<u32>>()
    };
    baked.iter().flat_map(of_pose).collect()
}

/// Five poses of a body whose parts move past one another, baked by 1, 2 and 3 threads, together,
/// alone, in pairs and in reverse: every pose has the same bytes each time. More points than a
/// task holds, so that tasks interleave.
#[test]
fn threads_and_grouping_change_no_bit() {
    let bodies: Vec<Body> = (0..5)
        .map(|i| {
            let mut body = Body::sphere(3);
            let shift = Vec3::new(1.2, 0.1 * i as f32, 0.0);
            body.append(&Body::sphere(2).mapped(|p| p * 0.5 + shift));
            body
        })
        .collect();
    let poses: Vec<PosedMesh<'_>> =
        bodies.iter().enumerate().map(|(i, b)| b.posed(i as f32 / 30.0)).collect();
    let go = AtomicBool::new(false);
    for signal in SIGNALS {
        let settings = settings(signal, 100);
        let expected = bits(&bodies[0].baker(&settings).bake(&poses, &go).unwrap());
        for threads in 1..=3 {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let baker = bodies[0].baker(&settings);
            pool.install(|| {
                let together = baker.bake(&poses, &go).unwrap();
                assert_eq!(bits(&together), expected, "{threads} threads, together");
                let group = |n| -> Vec<BakedPose> {
                    poses.chunks(n).flat_map(|p| baker.bake(p, &go).unwrap()).collect()
                };
                assert_eq!(bits(&group(1)), expected, "{threads} threads, alone");
                assert_eq!(bits(&group(2)), expected, "{threads} threads, in pairs");
                let reversed: Vec<PosedMesh<'_>> = poses.iter().rev().copied().collect();
                let mut back = baker.bake(&reversed, &go).unwrap();
                back.reverse();
                assert_eq!(bits(&back), expected, "{threads} threads, in reverse");
            });
        }
    }
}

/// Seed, clip and time each pick other random numbers; geometry that is not occluded is not
/// touched by them.
#[test]
fn random_numbers_depend_on_seed_clip_and_time() {
    let mut body = Body::sphere(2);
    body.append(&Body::sphere(2).mapped(|p| p * 0.5 + Vec3::X * 1.4));
    let base = settings(Signal::Ao, 64);
    let bake = |settings: &Settings, clip_key, time_s| {
        let pose = PosedMesh { clip_key, ..body.posed(time_s) };
        bits(&body.baker(settings).bake(&[pose], &AtomicBool::new(false)).unwrap())
    };
    let expected = bake(&base, 7, 0.0);
    assert_eq!(bake(&base, 7, 0.0), expected);
    assert_ne!(bake(&base, 8, 0.0), expected);
    assert_ne!(bake(&base, 7, 1.0), expected);
    assert_ne!(bake(&Settings { seed: 2, ..base }, 7, 0.0), expected);
}
