//! Points shaded by operators, many at once.

use std::hint::black_box;

use glam::{Mat3, Quat, Vec3};
use poselight::num::cpu::Isa;
use poselight::num::random::Stream;
use poselight::shade::{
    Brdf, Colours, Factoring, GlobalReflector, Reflector, ShLight, ShadedPoints, ZonalLight,
    factor_by,
};
use rayon::prelude::*;

use crate::lights::brdfs;
use crate::{best, numbers, order};

/// Points to be shaded.
pub(crate) const POINTS: usize = 14_500;

/// A point: the way into its tangent frame, and where it is seen from there.
type Point = (Mat3, Vec3);

fn points() -> Vec<Point> {
    let mut stream = Stream::new(3);
    let mut direction = || {
        let v = Vec3::from([0; 3].map(|_| stream.normal() as f32));
        v.normalize_or(Vec3::Z)
    };
    let point = |_| {
        let turn = Quat::from_rotation_arc(direction(), Vec3::Z);
        (Mat3::from_quat(turn), (direction() + 1.5 * Vec3::Z).normalize())
    };
    (0..POINTS).map(point).collect()
}

/// Shades a frame, on one thread or on all.
type Frame<'a> = Box<dyn Fn(&mut [[f32; 3]], bool) + 'a>;

/// Points shaded by an operator of 8 terms and order 4 under three lobes, each in its own frame.
pub(crate) fn shading() {
    let n = order(4);
    let mut light = ShLight::cone(n, [0.3, 1.0, 0.2], 0.4, [3.0, 2.5, 2.0]).unwrap();
    light.add(&ShLight::cone(n, [-0.7, 0.2, 0.4], 0.8, [0.3, 0.4, 0.9]).unwrap());
    light.add(&ShLight::constant(n, [0.1; 3]).unwrap());
    let lobes = ZonalLight::fit(&light, 3);
    let points = points();
    let visibility = numbers(16 * POINTS);
    let frames: Vec<Mat3> = points.iter().map(|(frame, _)| *frame).collect();
    let views: Vec<Vec3> = points.iter().map(|(_, view)| *view).collect();
    println!(
        "\n| 14,500 points, 3 lobes, RGB light | threads | ms | frames per second |\n|---|---|---|---|"
    );
    let colours = [0.9, 0.6, 0.3];
    let gold = Brdf::Ggx { normal_reflectance: colours, alpha: [0.5; 2] };
    let lambert = Brdf::Lambert { albedo: colours };
    let (together, apart) = (Colours::Together, Colours::Apart);
    let all = [
        (brdfs()[2].0, brdfs()[2].1, together),
        ("GGX in three colours", gold, together),
        ("GGX in three colours, apart", gold, apart),
        ("Lambert in three colours", lambert, together),
    ];
    for (name, brdf, colours) in all {
        let factored = factor_by(&brdf, n, 48, Factoring { colours, ..Factoring::default() });
        let operators = factored.unwrap().map(|colour| colour.operator(8));
        let reflector = Reflector::new(name, &operators, [0.0; 3]);
        let shade = |((to_local, view), v): (&Point, &[f32])| {
            let mut light = [[0.0; 16]; 3];
            let [r, g, b] = &mut light;
            lobes.in_frame(*to_local, [r, g, b]);
            reflector.shade(v, [&light[0], &light[1], &light[2]], *view)
        };
        let many = |first: usize, out: &mut [[f32; 3]]| {
            let range = first..first + out.len();
            let shaded = ShadedPoints {
                to_local: &frames[range.clone()],
                outgoing: &views[range],
                visibility: &visibility[16 * first..16 * (first + out.len())],
            };
            reflector.shade_points(Isa::best(), &lobes, shaded, out);
        };
        let common = GlobalReflector::new(name, &operators, 256);
        let expanded = lobes.expand();
        let single = |colour: &Vec<f64>| -> Vec<f32> { colour.iter().map(|&x| x as f32).collect() };
        let [r, g, b] = expanded.colours().each_ref().map(single);
        let in_common = |((to_local, view), v): (&Point, &[f32])| {
            let (normal, outgoing) = (to_local.row(2), to_local.transpose() * *view);
            common.shade(common.nearest(normal), v, [&r, &g, &b], outgoing)
        };
        let [one, two] = frame_us(&by_blocks(&many));
        let [one_single, two_single] = frame_us(&by_points(&points, &visibility, &shade));
        let [one_common, two_common] = frame_us(&by_points(&points, &visibility, &in_common));
        let kilobytes = common.bytes() / 1000;
        let other = format!("{name}, one frame for all, 256 normals, {kilobytes} kB");
        let threads = rayon::current_num_threads();
        let single = format!("{name}, point by point");
        let name = format!("{name}, {} terms", reflector.header().terms);
        for (name, threads, time) in [
            (&name, 1, one),
            (&name, threads, two),
            (&single, 1, one_single),
            (&single, threads, two_single),
            (&other, 1, one_common),
            (&other, threads, two_common),
        ] {
            println!("| {name} | {threads} | {:.2} | {:.0} |", time / 1e3, 1e6 / time);
        }
    }
}

fn by_points<'a>(
    points: &'a [Point],
    visibility: &'a [f32],
    shade: &'a (impl Fn((&Point, &[f32])) -> [f32; 3] + Sync),
) -> Frame<'a> {
    Box::new(move |out, on_all| {
        let block = |(block, out): (usize, &mut [[f32; 3]])| {
            for (i, out) in out.iter_mut().enumerate() {
                let at = BLOCK * block + i;
                *out = shade((&points[at], &visibility[16 * at..][..16]));
            }
        };
        match on_all {
            true => out.par_chunks_mut(BLOCK).enumerate().for_each(block),
            false => out.chunks_mut(BLOCK).enumerate().for_each(block),
        }
    })
}

fn by_blocks<'a>(many: &'a (impl Fn(usize, &mut [[f32; 3]]) + Sync)) -> Frame<'a> {
    Box::new(move |out, on_all| {
        let block = |(block, out): (usize, &mut [[f32; 3]])| many(BLOCK * block, out);
        match on_all {
            true => out.par_chunks_mut(BLOCK).enumerate().for_each(block),
            false => out.chunks_mut(BLOCK).enumerate().for_each(block),
        }
    })
}

/// Points of one block.
const BLOCK: usize = 512;

/// Microseconds of a frame on one thread and on all.
fn frame_us(frame: &Frame<'_>) -> [f64; 2] {
    let (mut out, mut other) = (vec![[0.0; 3]; POINTS], vec![[0.0; 3]; POINTS]);
    best(1, [&mut || frame(black_box(&mut out), false), &mut || frame(black_box(&mut other), true)])
}
