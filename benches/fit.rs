//! `cargo bench --bench fit`: seconds and memory of the fits on a data set of the published size,
//! 430 poses × 11,534 vertices × 36 coefficients, beside numpy and scikit-learn
//! where they are installed. `--quick` runs a tenth of the points.
//!
//! The data are synthetic: outputs that follow the poses linearly through modes of falling
//! weight, and noise. They are written to a real data set in a temporary folder and read from
//! there, as a fit does; `coefficients.npy` of the same numbers goes to the peers.

#![expect(clippy::print_stdout, reason = "a benchmark prints its table")]

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use glam::{Quat, Vec3};
use poselight::dataset::{
    Attributes, Dataset, Header, Layout, PartRange, PoseData, PoseTable, RestMesh, Static, Writer,
};
use poselight::fit::{Family, FitReport, Ridge, Settings, fit};
use poselight::model::Frame;
use poselight::num::linalg::{multiply, rows_of, rows_of_mut};
use poselight::num::random::{Stream, hash};
use poselight::rig::RigidFrame;
use rayon::prelude::*;

const POSES: usize = 430;
const PARAMETERS: usize = 54;
const COEFFICIENTS: usize = 36;
const BONES: usize = 20;
const MODES: usize = 600;

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, flag, data, case, frame] = &arguments[..]
        && flag == "--case"
    {
        return run(Path::new(data), &CASES[case.parse::<usize>()?], frame);
    }
    let quick = arguments.iter().any(|argument| argument == "--quick");
    let points = if quick { 1153 } else { 11_534 };
    let folder = tempfile::tempdir()?;
    write(folder.path(), points)?;
    println!(
        "{POSES} poses × {points} points × {COEFFICIENTS}, {} MB, {} threads",
        POSES * points * COEFFICIENTS * 4 / 1_000_000,
        rayon::current_num_threads()
    );
    println!("seconds are the least of {REPEATS}; CPU seconds are those of all threads");
    for frame in [Frame::Root, Frame::Bone] {
        for case in 0..CASES.len() {
            // A process each, so that no case inherits another one's memory.
            let mut command = Command::new(std::env::current_exe()?);
            command.arg("--case").arg(folder.path().join("data"));
            if !command.arg(case.to_string()).arg(frame.name()).status()?.success() {
                return Err("a case failed".into());
            }
        }
    }
    peers(folder.path(), points)
}

const REPEATS: usize = 3;

const CASES: [(&str, Family, Ridge); 5] = [
    ("mean", Family::Mean, Ridge::LeaveOneOut),
    ("linear, leave one out", Family::Linear, Ridge::LeaveOneOut),
    ("linear, leave one clip out", Family::Linear, Ridge::LeaveOneClipOut),
    ("P(8,22)", Family::PcaLinear { inputs: 8, outputs: 22 }, Ridge::LeaveOneClipOut),
    ("P(15,500)", Family::PcaLinear { inputs: 15, outputs: 500 }, Ridge::LeaveOneClipOut),
];

/// Fits one case a few times and prints its row.
fn run(data: &Path, case: &(&str, Family, Ridge), frame: &str) -> Outcome<()> {
    let &(name, family, ridge) = case;
    let frame = if frame == Frame::Root.name() { Frame::Root } else { Frame::Bone };
    let settings = Settings { family, ridge, frame, ..Settings::default() };
    let dataset = Dataset::open(data)?;
    let training = dataset.training()?;
    let before = status("VmRSS:")?;
    let (mut best, mut least_cpu_s) = (None::<FitReport>, f64::INFINITY);
    for _ in 0..REPEATS {
        let start_s = cpu_s()?;
        let report = fit(&training, &settings)?.report;
        least_cpu_s = least_cpu_s.min(cpu_s()? - start_s);
        if best.as_ref().is_none_or(|best| total(&report) < total(best)) {
            best = Some(report);
        }
    }
    let report = best.ok_or("no repeat")?;
    let phases: Vec<String> =
        report.seconds.iter().map(|(phase, s)| format!("{phase} {s:.2}")).collect();
    println!(
        "{name:26} {:4} {:6.2} s, CPU {least_cpu_s:6.2} s, {:4} MB peak, {} passes, alpha {:.2e}, \
         rmse {:.5}, retained {:.5}; {}",
        settings.frame.name(),
        total(&report),
        status("VmHWM:")?.saturating_sub(before) / 1_000_000,
        report.passes,
        report.alpha.unwrap_or(0.0),
        report.training_rmse,
        report.output_variance_retained,
        phases.join(", ")
    );
    Ok(())
}

fn total(report: &FitReport) -> f64 {
    report.seconds.get("total_s").copied().unwrap_or(f64::NAN)
}

/// Runs `benches/peers/fit.py` where Python has what it needs.
fn peers(folder: &Path, points: usize) -> Outcome<()> {
    let python = std::env::var("POSELIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has = |module: &str| {
        Command::new(&python)
            .args(["-c", &format!("import {module}")])
            .output()
            .is_ok_and(|o| o.status.success())
    };
    if !has("numpy") {
        println!("peers: {python} has no numpy; skipped (set POSELIGHT_PYTHON to one that has)");
        return Ok(());
    }
    if !has("sklearn") {
        println!("peers: {python} has no scikit-learn; only numpy runs");
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peers/fit.py");
    let sizes = [POSES, points, COEFFICIENTS, PARAMETERS].map(|n| n.to_string());
    Command::new(&python).arg(script).arg(folder).args(sizes).status()?;
    Ok(())
}

/// The data set `data`, and its training poses for the peers.
fn write(folder: &Path, points: usize) -> Outcome<()> {
    let layout = Layout {
        poses: POSES,
        points,
        vertices: points,
        triangles: 1,
        channels: 1,
        coefficients: COEFFICIENTS,
        parameters: PARAMETERS,
        bones: BONES,
        block_poses: 10,
    };
    let parameters = parameters();
    let header = Header {
        layout,
        attributes: Attributes {
            hashes: BTreeMap::from([("bake".to_owned(), "synthetic".to_owned())]),
            signal: "transfer".to_owned(),
            order: 6,
            clip_names: (0..4).map(|i| format!("clip{i}")).collect(),
            parameter_names: (0..PARAMETERS).map(|i| format!("p{i}")).collect(),
            parts: vec![PartRange {
                node: "body".to_owned(),
                mesh: "body".to_owned(),
                primitive: 0,
                first_vertex: 0,
                vertices: points,
                first_triangle: 0,
                triangles: 1,
            }],
            ..Attributes::default()
        },
    };
    let mut writer = Writer::open(&folder.join("data"), &header, &statics(&layout, &parameters))?;
    let floats = |name: &str| -> Outcome<BufWriter<fs::File>> {
        Ok(BufWriter::new(fs::File::create(PathBuf::from(folder).join(name))?))
    };
    floats("parameters.f32")?.write_all(bytemuck::cast_slice(&parameters))?;
    let mut peers = floats("coefficients.f32")?;
    let modes = Modes::new(&parameters, points);
    let (noise, rays) = (vec![0.01; points], vec![500; points]);
    for block in writer.missing_blocks() {
        let poses = layout.poses_of(block);
        let values: Vec<Vec<f32>> = poses.into_par_iter().map(|pose| modes.values(pose)).collect();
        let data: Vec<PoseData<'_>> = (values.iter())
            .map(|values| PoseData { coefficients: values, noise: &noise, rays: &rays })
            .collect();
        writer.commit(block, &data)?;
        values.iter().try_for_each(|values| peers.write_all(bytemuck::cast_slice(values)))?;
    }
    Ok(peers.flush()?)
}

/// Smooth motion of falling variance, 54 numbers per pose.
fn parameters() -> Vec<f32> {
    let mut stream = Stream::new(1);
    let waves: Vec<[f64; 3]> = (0..PARAMETERS)
        .map(|j| {
            let size = 0.5 * 0.85f64.powi(j as i32);
            [size, 0.02 + 0.3 * stream.uniform(), 6.0 * stream.uniform()]
        })
        .collect();
    let mut mix = || stream.normal() * 0.3;
    let mixing: Vec<f64> = (0..PARAMETERS * PARAMETERS).map(|_| mix()).collect();
    let at = |pose: usize, j: usize| -> f64 {
        let wave = |(k, [size, speed, phase]): (usize, &[f64; 3])| {
            mixing[j * PARAMETERS + k] * size * (speed * pose as f64 + phase).sin()
        };
        waves.iter().enumerate().map(wave).sum()
    };
    (0..POSES * PARAMETERS).map(|i| at(i / PARAMETERS, i % PARAMETERS) as f32).collect()
}

/// Outputs by modes over the points.
struct Modes {
    points: usize,
    /// `[point, mode]`.
    shapes: Vec<f32>,
    /// `[pose, mode, coefficient]`.
    weights: Vec<f32>,
}

impl Modes {
    fn new(parameters: &[f32], points: usize) -> Self {
        let mut shapes = vec![0.0; points * MODES];
        shapes.par_chunks_mut(MODES).enumerate().for_each(|(point, row)| {
            let mut stream = Stream::new(hash(&[2, point as u64]));
            row.iter_mut().for_each(|x| *x = stream.normal() as f32);
        });
        let mut stream = Stream::new(3);
        let mut weights = vec![0.0; POSES * MODES * COEFFICIENTS];
        for mode in 0..MODES {
            let size = 0.3 / (mode as f64 + 1.0).powf(0.8);
            for c in 0..COEFFICIENTS {
                let band = 1.0 / (1.0 + (c as f64).sqrt());
                let offset = stream.normal();
                let slopes: Vec<f64> = (0..PARAMETERS).map(|_| stream.normal()).collect();
                for pose in 0..POSES {
                    let x = &parameters[pose * PARAMETERS..(pose + 1) * PARAMETERS];
                    let along: f64 = x.iter().zip(&slopes).map(|(&x, s)| f64::from(x) * s).sum();
                    let value = size * band * (offset + along + 0.2 * stream.normal());
                    weights[(pose * MODES + mode) * COEFFICIENTS + c] = value as f32;
                }
            }
        }
        Self { points, shapes, weights }
    }

    /// `[point, coefficient]` of one pose, with noise of 0.01.
    fn values(&self, pose: usize) -> Vec<f32> {
        let mut out = vec![0.0; self.points * COEFFICIENTS];
        let size = MODES * COEFFICIENTS;
        multiply(
            rows_of_mut(&mut out, self.points, COEFFICIENTS),
            rows_of(&self.shapes, self.points, MODES),
            rows_of(&self.weights[pose * size..(pose + 1) * size], MODES, COEFFICIENTS),
        );
        let mut stream = Stream::new(hash(&[4, pose as u64]));
        // Uniform noise is quicker to draw than normal noise.
        out.iter_mut().for_each(|y| *y += (0.035 * (stream.uniform() - 0.5)) as f32);
        out
    }
}

fn statics(layout: &Layout, parameters: &[f32]) -> Static {
    Static {
        poses: PoseTable {
            parameters: parameters.to_vec(),
            clips: (0..POSES).map(|pose| (pose * 4 / POSES) as i32).collect(),
            times_s: (0..POSES).map(|pose| pose as f32 / 30.0).collect(),
            splits: vec![0; POSES],
            roots: vec![RigidFrame { rotation: Quat::IDENTITY, translation: Vec3::ZERO }; POSES],
            bone_rotations: vec![Quat::IDENTITY; POSES * BONES],
        },
        mesh: RestMesh {
            positions: vec![Vec3::ZERO; layout.vertices],
            normals: vec![Vec3::Y; layout.vertices],
            triangles: vec![[0, 1, 2]],
            point_of_vertex: (0..layout.points as u32).collect(),
            vertex_of_point: (0..layout.points as u32).collect(),
            // Runs of a few dozen neighbours, as vertices come in a mesh.
            bone_of_point: (0..layout.points).map(|i| (i / 37 % BONES) as u16).collect(),
        },
        sources: Vec::new(),
    }
}

/// CPU seconds of this process so far.
fn cpu_s() -> Outcome<f64> {
    // Fields 14 and 15 of proc(5), after the name in parentheses; a tick is 10 ms.
    let text = fs::read_to_string("/proc/self/stat")?;
    let fields = text.rsplit(')').next().ok_or("no fields")?.split_whitespace();
    let ticks: Vec<f64> = fields.skip(11).take(2).map(str::parse).collect::<Result<_, _>>()?;
    Ok(ticks.iter().sum::<f64>() / 100.0)
}

/// A number of bytes from the kernel's view of this process.
fn status(field: &str) -> Outcome<u64> {
    let text = fs::read_to_string("/proc/self/status")?;
    let line = text.lines().find_map(|line| line.strip_prefix(field)).ok_or("no such field")?;
    let kib: u64 = line.trim().trim_end_matches("kB").trim().parse()?;
    Ok(kib * 1024)
}
