//! How close the evaluation of P(8,22) comes to the machine's own multiply-add peak, on one core,
//! beside the slower instruction sets and faer's product; and what folding a light saves.
//!
//! `cargo bench --bench evaluate`; numbers after `--` are other counts of points. Every round
//! runs all contestants in turn, so that what else the machine does hits all of them; ratios are
//! of the best rounds, medians stand beside.

#![expect(clippy::print_stdout, reason = "a benchmark's table is its output")]

use std::hint::black_box;
use std::time::Instant;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use glam::{Quat, Vec3};
use poselight::model::{
    Decoder, Family, Frame, Header, Model, Occluders, PosedInput, Signal, Surface, TrainingSummary,
};
use poselight::num::cpu::Isa;
use poselight::num::kernels::{Layout, exercise, exercise_operations};
use synthetic::{BONES, INPUTS, OUTPUTS, PARAMETERS, WIDTH, model, numbers};

#[path = "synthetic/mod.rs"]
mod synthetic;

const ROUNDS: usize = 400;

/// Seconds of every round of one contestant.
struct Times(Vec<f64>);

impl Times {
    fn best(&self) -> f64 {
        self.0.iter().copied().fold(f64::INFINITY, f64::min)
    }

    fn median(&self) -> f64 {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    }
}

struct Contestant<'a> {
    name: String,
    operations: u64,
    run: Box<dyn FnMut() + 'a>,
}

fn contestant<'a>(name: &str, operations: u64, run: impl FnMut() + 'a) -> Contestant<'a> {
    Contestant { name: name.to_owned(), operations, run: Box::new(run) }
}

fn race(contestants: &mut [Contestant<'_>]) -> Vec<Times> {
    let mut times: Vec<Times> = contestants.iter().map(|_| Times(Vec::new())).collect();
    for _ in 0..ROUNDS {
        for (contestant, times) in contestants.iter_mut().zip(&mut times) {
            // Once to bring its own data into the caches, as in a frame loop; then the measurement.
            (contestant.run)();
            let start = Instant::now();
            (contestant.run)();
            times.0.push(start.elapsed().as_secs_f64());
        }
    }
    times
}

fn report(points: usize) {
    let (root, bone) = (model(points, Frame::Root), model(points, Frame::Bone));
    let parameters = numbers(5, PARAMETERS);
    let light = numbers(6, WIDTH);
    let turned = vec![Quat::from_xyzw(0.1, 0.2, 0.3, 0.9).normalize(); BONES];
    let (folded, bone_folded) = (
        root.fold(&light, &[]).expect("transfer folds"),
        bone.fold(&light, &turned).expect("transfer folds"),
    );
    let operations = 2 * root.multiply_adds();
    let Decoder::PcaLinear { basis, .. } = root.decoder() else { unreachable!("built above") };
    let reduced = numbers(7, OUTPUTS * WIDTH);
    let left = MatRef::from_row_major_slice(&basis, points, OUTPUTS);
    let right = MatRef::from_row_major_slice(&reduced, OUTPUTS, WIDTH);
    let mut product = Mat::<f32>::zeros(WIDTH, points);

    let [mut a, mut b, mut c, mut d] = [(); 4].map(|()| vec![0.0_f32; points]);
    let rounds = 20_000;
    let mut outputs: Vec<Vec<f32>> = (0..12).map(|_| vec![0.0; points * WIDTH]).collect();
    let mut outputs = outputs.iter_mut();
    let mut contestants = Vec::new();
    for isa in Isa::available() {
        let peak = 2 * rounds * exercise_operations(isa);
        contestants.push(contestant(&format!("peak, {}", isa.name()), peak, move || {
            black_box(exercise(isa, rounds, black_box(0.999), black_box(0.001)));
        }));
    }
    for isa in Isa::available() {
        let layouts = [(Layout::Rows, "[point, coefficient]"), (Layout::Planar, "planar")];
        for (layout, name) in layouts {
            let out = outputs.next().expect("enough outputs");
            let (root, parameters) = (&root, &parameters);
            contestants.push(contestant(
                &format!("all 36, {}, {name}", isa.name()),
                operations,
                move || {
                    let done = root.evaluate_with(isa, black_box(parameters), None, layout, out);
                    done.expect("evaluates");
                },
            ));
        }
    }
    contestants.push(contestant(
        "all 36, faer matmul",
        2 * (points * OUTPUTS * WIDTH) as u64,
        || {
            // Its faster orientation: column-major results, which are [point, coefficient] rows.
            let out = product.as_mut().transpose_mut();
            matmul(out, Accum::Replace, black_box(left), right, 1.0, Par::Seq);
        },
    ));
    let one = 2 * (points * OUTPUTS) as u64;
    contestants.push(contestant("folded, root frame", one, || {
        folded.evaluate(black_box(&parameters), &mut a).expect("evaluates");
    }));
    contestants.push(contestant("folded, bone frame", one, || {
        bone_folded.evaluate(black_box(&parameters), &mut b).expect("evaluates");
    }));
    contestants.push(contestant("light turning, root frame", one, || {
        root.shade(black_box(&parameters), &light, &[], &mut c).expect("evaluates");
    }));
    contestants.push(contestant("light turning, bone frame", one, || {
        bone.shade(black_box(&parameters), &light, &turned, &mut d).expect("evaluates");
    }));
    let names: Vec<(String, u64)> =
        contestants.iter().map(|c| (c.name.clone(), c.operations)).collect();
    print(points, &names, &race(&mut contestants));
}

fn print(points: usize, names: &[(String, u64)], times: &[Times]) {
    let rate = |i: usize| names[i].1 as f64 / times[i].best() / 1e9;
    let peak =
        (0..names.len()).filter(|&i| names[i].0.starts_with("peak")).map(rate).fold(0.0, f64::max);
    let full = (0..names.len())
        .filter(|&i| names[i].0.starts_with("all 36") && names[i].0.ends_with("coefficient]"))
        .map(|i| times[i].best())
        .fold(f64::INFINITY, f64::min);
    println!("\n{points} points, P({INPUTS},{OUTPUTS}), order 6, one core, {ROUNDS} rounds");
    println!("| what | best µs | median µs | GFlop/s | of peak | all 36 / this |");
    println!("|---|---|---|---|---|---|");
    for (i, (name, _)) in names.iter().enumerate() {
        println!(
            "| {name} | {:.1} | {:.1} | {:.1} | {:.0} % | {:.1} |",
            times[i].best() * 1e6,
            times[i].median() * 1e6,
            rate(i),
            rate(i) / peak * 100.0,
            full / times[i].best()
        );
    }
}

/// Bones of a figure of capsules: from, to, radius, metres.
const CAPSULES: [([f32; 3], [f32; 3], f32); 14] = [
    ([0.0, 0.95, 0.0], [0.0, 1.15, 0.0], 0.13),
    ([0.0, 1.2, 0.0], [0.0, 1.4, 0.0], 0.15),
    ([0.0, 1.6, 0.0], [0.0, 1.7, 0.0], 0.1),
    ([0.0, 1.45, 0.0], [0.0, 1.55, 0.0], 0.06),
    ([0.2, 1.42, 0.0], [0.45, 1.3, 0.05], 0.05),
    ([0.45, 1.3, 0.05], [0.5, 1.1, 0.25], 0.04),
    ([0.5, 1.1, 0.25], [0.48, 1.08, 0.38], 0.035),
    ([-0.2, 1.42, 0.0], [-0.45, 1.3, 0.05], 0.05),
    ([-0.45, 1.3, 0.05], [-0.5, 1.1, 0.25], 0.04),
    ([-0.5, 1.1, 0.25], [-0.48, 1.08, 0.38], 0.035),
    ([0.1, 0.9, 0.0], [0.14, 0.5, 0.05], 0.08),
    ([0.14, 0.5, 0.05], [0.14, 0.1, 0.0], 0.06),
    ([-0.1, 0.9, 0.0], [-0.14, 0.5, 0.05], 0.08),
    ([-0.14, 0.5, 0.05], [-0.14, 0.1, 0.0], 0.06),
];

/// Points around the capsules, in the order of a mesh: rings from end to end, bone by bone.
fn figure(points: usize) -> (Vec<Vec3>, Vec<Vec3>, Vec<u16>) {
    let (mut positions, mut normals, mut bones) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..points {
        let bone = i * CAPSULES.len() / points;
        let first = (bone * points).div_ceil(CAPSULES.len());
        let own = ((bone + 1) * points).div_ceil(CAPSULES.len()) - first;
        let (from, to, radius) = CAPSULES[bone];
        let (from, to) = (Vec3::from(from), Vec3::from(to));
        let axis = (to - from).normalize();
        let side = axis.any_orthonormal_vector();
        let ring = 32.0;
        let along = (i - first) as f32 / own as f32;
        let turn = std::f32::consts::TAU * (i - first) as f32 / ring;
        let normal = side * turn.cos() + axis.cross(side) * turn.sin();
        positions.push(from + (to - from) * along + radius * normal);
        normals.push(normal);
        bones.push(bone as u16);
    }
    (positions, normals, bones)
}

/// A model of the mean and `spheres` on the figure's bones, in as many groups as characters have.
fn occluded(points: usize, spheres: usize, signal: Signal) -> Model {
    const GROUPS: usize = 9;
    let (.., bones) = figure(points);
    let whole = model(points, Frame::Bone).header().clone();
    let order = if signal == Signal::Ao { 1 } else { 6 };
    let training = TrainingSummary { deviations: Vec::new(), ..whole.training.clone() };
    let header =
        Header { signal, order, family: Family::Mean, unshadowed: true, training, ..whole };
    let mean = numbers(8, points * header.width());
    let occluders = Occluders {
        anchors: (0..spheres)
            .flat_map(|q| {
                let first = (q * points / spheres).min(points - 64);
                (0..8).map(move |i| (first + 8 * i) as u32)
            })
            .collect(),
        offsets: vec![0.0; 3 * spheres],
        radii: (0..spheres).map(|q| 1.2 * CAPSULES[q * CAPSULES.len() / spheres].2).collect(),
        group_of: (0..BONES * spheres).map(|i| (i % GROUPS) as u8).collect(),
        weights: numbers(9, points * GROUPS),
        ..Occluders::default()
    };
    let maps = ((0..points as u32).collect(), bones);
    let model = Model::new(header, Decoder::Mean { mean }, maps.0, maps.1).expect("a valid model");
    model.with_occluders(occluders).expect("valid occluders")
}

/// A frame of models with occluders, from the posed mesh to the root frame.
fn report_occluders(points: usize) {
    let (positions, normals, _) = figure(points);
    let parameters = numbers(5, PARAMETERS);
    let turns = vec![Quat::IDENTITY; BONES];
    let sizes = [(Signal::Ao, 40), (Signal::Ao, 100), (Signal::Ao, 200), (Signal::Transfer, 100)];
    let models = sizes.map(|(signal, spheres)| (occluded(points, spheres, signal), spheres));
    let mut contestants: Vec<Contestant<'_>> = models
        .iter()
        .map(|(model, spheres)| {
            let name = format!("{} of {spheres} spheres", model.header().signal.name());
            let mut out = vec![0.0; points * model.header().width()];
            let surface = Surface { positions: &positions, normals: &normals, tangents: &[] };
            let input = PosedInput {
                parameters: &parameters,
                bone_rotations: &turns,
                surface: Some(surface),
            };
            contestant(&name, (points * spheres) as u64, move || {
                model.evaluate_posed(black_box(&input), &mut out).expect("evaluates");
            })
        })
        .collect();
    let names: Vec<(String, u64)> =
        contestants.iter().map(|c| (c.name.clone(), c.operations)).collect();
    let times = race(&mut contestants);
    println!("\n{points} points, occluder, one core, {ROUNDS} rounds");
    println!("| what | best µs | median µs | ns per point and sphere |");
    println!("|---|---|---|---|");
    for ((name, pairs), times) in names.iter().zip(&times) {
        let (best, median) = (times.best() * 1e6, times.median() * 1e6);
        println!("| {name} | {best:.0} | {median:.0} | {:.2} |", 1e3 * best / *pairs as f64);
    }
}

fn main() {
    let given: Vec<usize> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    for points in if given.is_empty() { vec![11_534, 14_517] } else { given } {
        report(points);
        report_occluders(points);
    }
}
