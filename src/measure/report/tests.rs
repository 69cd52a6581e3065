//! The page as a whole, from synthetic measurements.

use glam::Vec3;

use super::*;
use crate::measure::{Candidate, Case, Kind, Measured, Measurement, Settings, Signal, Split};
use crate::num::random::Stream;
use crate::rig::Part;
use crate::sh::Order;

const HOSTILE: &str = "<script src=\"http://evil\">'&\u{202e}";

/// A figure of spheres: head, trunk, arms and legs, with the normals.
struct Body {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

fn body(rings: u32) -> Body {
    let mut body = Body { positions: Vec::new(), normals: Vec::new(), triangles: Vec::new() };
    let parts = [
        ([0.0, 1.62, 0.0], [0.11, 0.14, 0.12]),
        ([0.0, 1.18, 0.0], [0.2, 0.34, 0.13]),
        ([0.42, 1.38, 0.0], [0.3, 0.06, 0.06]),
        ([-0.42, 1.38, 0.0], [0.3, 0.06, 0.06]),
        ([0.11, 0.45, 0.0], [0.09, 0.46, 0.1]),
        ([-0.11, 0.45, 0.0], [0.09, 0.46, 0.1]),
    ];
    for (centre, radii) in parts {
        let first = body.positions.len() as u32;
        for i in 0..=rings {
            for k in 0..2 * rings {
                let (s, c) = (std::f32::consts::PI * i as f32 / rings as f32).sin_cos();
                let (s2, c2) = (std::f32::consts::PI * k as f32 / rings as f32).sin_cos();
                let unit = Vec3::new(s * c2, c, s * s2);
                body.positions.push(Vec3::from(centre) + unit * Vec3::from(radii));
                body.normals.push((unit / Vec3::from(radii)).normalize());
            }
        }
        for i in 0..rings {
            for k in 0..2 * rings {
                let at = |i: u32, k: u32| first + i * 2 * rings + k % (2 * rings);
                body.triangles.push([at(i, k), at(i + 1, k), at(i, k + 1)]);
                body.triangles.push([at(i, k + 1), at(i + 1, k), at(i + 1, k + 1)]);
            }
        }
    }
    body
}

fn settings(signal: Signal, bands: u8, points: usize, name: &str) -> Settings {
    let candidate = |name: &str, kind| Candidate { name: name.to_owned(), kind };
    Settings {
        signal,
        order: Order::new(bands).unwrap(),
        channels: 1,
        vertex_of_point: (0..points as u32).collect(),
        parts: vec![Part {
            node: 0,
            source_node: 0,
            primitive: 0,
            name: name.to_owned(),
            vertices: 0..points,
            triangles: 0..0,
        }],
        candidates: vec![
            candidate("model f32", Kind::Model),
            candidate("model f16", Kind::Precision),
            candidate("model i8", Kind::Precision),
            candidate("mean", Kind::Baseline),
        ],
        frame_s: 1.0 / 30.0,
        exact: None,
        on_trained: false,
        reference_rays: Some(4000),
    }
}

/// A measurement of smooth motion with errors that grow under the arms and in mid-clip.
fn measured(signal: Signal, bands: u8, body: &Body, poses: usize, clip: &str) -> Measured {
    let points = body.positions.len();
    let settings = settings(signal, bands, points, clip);
    let count = settings.order.coefficients();
    let mut measurement = Measurement::new(settings).unwrap();
    let mut stream = Stream::new(1);
    for split in [Split::Training, Split::Novel] {
        let name = if split == Split::Novel { clip } else { "walk" };
        for pose in 0..poses {
            let t = pose as f32 / 30.0;
            let phase = (t * 2.0).sin() + 0.4 * (t * 5.3).cos();
            let hard = if split == Split::Novel { 1.0 } else { 0.6 };
            let mut rows = vec![Vec::new(); 6];
            for p in &body.positions {
                let place = (-(p.y - 1.3).abs() * 5.0).exp() * (1.0 + p.x);
                for c in 0..count {
                    let size = 0.25 / (1.0 + c as f32);
                    let truth = size * (1.0 + 0.3 * phase * place);
                    let error =
                        hard * size * 0.05 * place * (0.4 + phase.abs()) * (c as f32 + 1.3).sin();
                    let model = truth + error + 0.1 * error * stream.normal() as f32;
                    let noise = 0.0015 * stream.normal() as f32;
                    let other = 0.0015 * stream.normal() as f32;
                    rows[0].push(truth + noise);
                    rows[1].push(truth + other);
                    rows[2].push(model);
                    rows[3].push((model * 4096.0).round() / 4096.0);
                    rows[4].push((model * 400.0).round() / 400.0);
                    rows[5].push(size);
                }
            }
            measurement
                .add(&Case {
                    pose,
                    clip: name,
                    time_s: t,
                    split,
                    normals: &body.normals,
                    reference1: &rows[0],
                    reference2: &rows[1],
                    candidates: &[
                        ("model f32", &rows[2]),
                        ("model f16", &rows[3]),
                        ("model i8", &rows[4]),
                        ("mean", &rows[5]),
                    ],
                })
                .unwrap();
        }
    }
    measurement.finish()
}

fn facts(name: &str) -> (Character, ModelFacts, Times, LeftOut) {
    let clip = |name: &str, poses, splits: &[Split]| ClipFacts {
        name: name.to_owned(),
        duration_s: poses as f32 / 30.0,
        poses,
        splits: splits.to_vec(),
    };
    let character = Character {
        vertices: 14_444,
        triangles: 28_320,
        joints: 53,
        morphs: 3,
        size_m: 2.31,
        parameters: 96,
        training_poses: 1_240,
        rays: 500,
        clips: vec![
            clip("walk", 343, &[Split::Training, Split::Interpolated]),
            clip(name, 180, &[Split::Novel]),
        ],
    };
    let model = ModelFacts {
        family: "pca-linear (8, 22)".to_owned(),
        frame: "bone".to_owned(),
        precision: "f32".to_owned(),
        parameters: 42,
        alpha: Some(3.1),
        sizes: vec![
            ("model f32".to_owned(), 1_306_512),
            ("model f16".to_owned(), 653_256),
            ("model i8".to_owned(), 330_100),
        ],
        tensor_bytes: 1_290_000,
        training_bytes: 2_579_000_000,
        mesh_bytes: 2_079_936,
        multiply_adds: 11_446_000,
        evaluate_us: Some(187.0),
        folded_us: Some(11.4),
    };
    let phase = |name: &str, seconds, pca| Phase { name: name.to_owned(), seconds, pca };
    let times = Times {
        bake_s: Some(912.0),
        bake_rays_per_s: None,
        bake_rays: 8_955_280_000,
        bake_poses: 1_240,
        reference_s: Some(1_430.0),
        fit: vec![
            phase("read", 3.1, false),
            phase("ridge", 0.9, false),
            phase("pose PCA", 0.2, true),
            phase("output PCA", 7.4, true),
        ],
    };
    let left_out = LeftOut {
        dropped: (0..23).map(|i| format!("{name}.finger_{i}.x")).collect(),
        near_repeats: 41,
        near_repeat: 0.005,
        passed_over: 7,
        saved_rays: 4_200_000,
        notices: vec!["2 textures were ignored".to_owned()],
    };
    (character, model, times, left_out)
}

/// The page of a synthetic measurement, hostile or not.
fn page(measured: &Measured, body: &Body, name: &str) -> String {
    let (character, model, times, left_out) = facts(name);
    let pose: Vec<f64> = (0..96).map(|i| 3.0 * 0.8f64.powi(i)).collect();
    let output: Vec<f64> = (1..600).map(|i| 1.0 / f64::from(i).powf(1.6)).collect();
    let vertices: Vec<u32> = (0..body.positions.len() as u32).collect();
    html(&ReportInput {
        title: name,
        made_by: "poselight 0.1.0, synthetic data of its own test",
        machine: "no machine: these times are made up",
        measured,
        character,
        model,
        pose_spectrum: Spectrum { values: &pose, total: None, kept: Some(8) },
        output_spectrum: Spectrum { values: &output, total: Some(2.35), kept: Some(22) },
        times,
        rest: Some(RestMesh {
            positions: &body.positions,
            triangles: &body.triangles,
            point_of_vertex: &vertices,
        }),
        stills: Vec::new(),
        left_out,
        target: None,
        warnings: vec![format!("Clip {name} leaves the training poses by 4.1 deviations")],
        recipe: "{\n  \"version\": 1,\n  \"scene\": \"<a & b>\"\n}",
        hashes: vec![("bake".to_owned(), "5f3c…".to_owned())],
    })
}

/// The page is well-formed: every element that opens closes, in order, attributes are quoted, and
/// ids are unique. It refers to nothing outside and runs nothing, even where every name of the
/// input tries to.
#[test]
fn the_page_is_well_formed_and_alone() {
    let body = body(4);
    for (signal, bands) in [(Signal::Transfer, 3), (Signal::Ao, 1), (Signal::Visibility, 2)] {
        let measured = measured(signal, bands, &body, 5, HOSTILE);
        let page = page(&measured, &body, HOSTILE);
        let ids = check_well_formed(&page);
        let unique: std::collections::BTreeSet<&String> = ids.iter().collect();
        assert_eq!(unique.len(), ids.len(), "ids repeat: {ids:?}");
        for forbidden in ["<script", "<link", "<iframe", "<img", "url(", "@import", "\u{202e}"] {
            assert!(!page.contains(forbidden), "{signal:?}: the page has {forbidden}");
        }
        assert!(page.contains("&lt;script"), "the hostile name is shown, escaped");
        for undefined in ["NaN", ">inf", "\"inf"] {
            assert!(!page.contains(undefined), "{signal:?}: the page shows {undefined}");
        }
    }
}

/// A page of nothing, and one of a single pose of a single vertex, leave sections out and stay
/// sound.
#[test]
fn pages_of_little() {
    let body = body(4);
    let nothing = Measurement::new(settings(Signal::Ao, 1, 1, "a")).unwrap().finish();
    let input = ReportInput {
        title: "static",
        made_by: "",
        machine: "",
        measured: &nothing,
        character: Character::default(),
        model: ModelFacts::default(),
        pose_spectrum: Spectrum::default(),
        output_spectrum: Spectrum::default(),
        times: Times::default(),
        rest: None,
        stills: Vec::new(),
        left_out: LeftOut::default(),
        target: None,
        warnings: Vec::new(),
        recipe: "",
        hashes: Vec::new(),
    };
    let page = html(&input);
    check_well_formed(&page);
    assert!(page.contains("Nothing was measured") && !page.contains("NaN"));
    assert!(!page.contains("What was left out"), "an empty section is left out");
    let point =
        Body { positions: vec![Vec3::ZERO], normals: vec![Vec3::Y], triangles: vec![[0, 0, 0]] };
    let one = measured(Signal::Transfer, 2, &point, 1, "one");
    let page = html(&ReportInput { measured: &one, ..input });
    check_well_formed(&page);
    assert!(!page.contains("NaN") && !page.contains("inf "), "one pose draws");
    // A mesh that does not belong to the figures goes without a picture.
    let rest =
        RestMesh { positions: &body.positions, triangles: &body.triangles, point_of_vertex: &[] };
    assert!(
        !html(&ReportInput { measured: &one, rest: Some(rest), ..page_input(&one) })
            .contains("class=\"views\"")
    );
}

fn page_input(measured: &Measured) -> ReportInput<'_> {
    ReportInput {
        title: "a",
        made_by: "",
        machine: "",
        measured,
        character: Character::default(),
        model: ModelFacts::default(),
        pose_spectrum: Spectrum::default(),
        output_spectrum: Spectrum::default(),
        times: Times::default(),
        rest: None,
        stills: Vec::new(),
        left_out: LeftOut::default(),
        target: None,
        warnings: Vec::new(),
        recipe: "",
        hashes: Vec::new(),
    }
}

/// A model that is worse than the baseline is called worse, at the top.
#[test]
fn worse_than_the_baseline_is_said() {
    let body = body(4);
    let mut measured = measured(Signal::Transfer, 2, &body, 3, "run");
    let better = html(&page_input(&measured));
    assert!(
        better.contains("of a model that")
            || better.contains("a model that ignores the pose is off")
    );
    assert!(!better.contains("worse</strong>"));
    for split in &mut measured.splits {
        split.candidates[0].ao.mean_absolute.value = 0.9;
    }
    assert!(html(&page_input(&measured)).contains("<strong>worse</strong>"));
}

/// A target that was missed, if only in validation, stands among the warnings with both numbers, one that was met in a tile;
/// a bake that several runs shared still has its rate.
#[test]
fn targets_and_shared_bakes_are_shown() {
    let body = body(4);
    let measured = measured(Signal::Ao, 1, &body, 2, "run");
    let of = |reached, validated| {
        let target = Some(Target { most: 0.01, reached: Some(reached), validated });
        let times = Times { bake_rays_per_s: Some(2.5e6), ..Times::default() };
        html(&ReportInput { target, times, ..page_input(&measured) })
    };
    let (missed, met) = (of(0.02, None), of(0.005, Some(0.009)));
    let doubted = of(0.005, Some(0.03));
    assert!(doubted.contains("The target is missed: here") && doubted.contains("off by 0.0300"));
    assert!(!doubted.contains("Target met"));
    assert!(missed.contains("The target is missed") && missed.contains("0.0100 (RMS)"));
    assert!(met.contains("Target met") && !met.contains("is missed"));
    assert!(met.contains("2.50 <small>million rays/s") && met.contains("the last run baked"));
}

/// A model may take poses by other numbers than the data set has: both are told, and its own stand beside the
/// published ones; the table of precisions says how the model itself is stored.
#[test]
fn the_models_own_parameters_are_told() {
    let body = body(4);
    let measured = measured(Signal::Ao, 1, &body, 2, "run");
    let page = page(&measured, &body, "run");
    assert!(page.contains("<dt>Pose parameters</dt><dd>42, of 96 in the data set</dd>"), "both");
    assert!(page.contains(", 42</td>"), "beside the published ones");
    assert!(page.contains("<th scope=\"row\">model f32 (f32)</th>"), "how it is stored");
}

/// The rule of what is kept is drawn under the marks of a spectrum, not through their labels.
#[test]
fn labels_are_drawn_over_rules() {
    let body = body(4);
    let page = page(&measured(Signal::Transfer, 2, &body, 5, "run"), &body, "run");
    let spectrum = &page[page.find("id=\"pose-spectrum-t\"").expect("the spectrum")..];
    let (rule, mark) = (spectrum.find(">kept: 8<"), spectrum.find(">90 % in"));
    assert!(rule.expect("a rule") < mark.expect("a mark"));
}

/// Walks the tags of a page; returns the ids. The style sheet is skipped.
fn check_well_formed(page: &str) -> Vec<String> {
    let body = page.strip_prefix("<!DOCTYPE html>").expect("a doctype opens the page");
    let (mut open, mut ids) = (Vec::new(), Vec::new());
    let mut rest = body;
    while let Some(at) = rest.find('<') {
        let end = at + rest[at..].find('>').expect("a tag ends");
        let tag = &rest[at + 1..end];
        assert!(
            !rest[..at].contains('>') || open.last() == Some(&"style"),
            "a stray > before <{tag}"
        );
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "</{name}> closes another");
            continue;
        }
        assert_eq!(tag.matches('"').count() % 2, 0, "quotes of <{tag}>");
        assert!(!tag.contains("src=") && !tag.contains("href="), "<{tag}> refers to something");
        let name = tag.split([' ', '/']).next().unwrap_or_default();
        if let Some(id) = tag.split(" id=\"").nth(1) {
            ids.push(id.split('"').next().unwrap_or_default().to_owned());
        }
        if !tag.ends_with('/') {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "left open: {open:?}");
    ids
}
