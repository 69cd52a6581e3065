//! Whole measurements of synthetic poses whose errors are known.

use std::f64::consts::PI;

use glam::Vec3;

use super::*;
use crate::num::random::Stream;
use crate::rig::Part;
use crate::sh::Order;

/// `numbers` plus normal noise of the given deviation.
fn noisy(stream: &mut Stream, numbers: &[f32], deviation: f64) -> Vec<f32> {
    numbers.iter().map(|&x| (f64::from(x) + deviation * stream.normal()) as f32).collect()
}

fn candidate(name: &str, kind: Kind) -> Candidate {
    Candidate { name: name.to_owned(), kind }
}

fn settings(signal: Signal, bands: u8, points: usize) -> Settings {
    Settings {
        signal,
        order: Order::new(bands).unwrap(),
        channels: 1,
        vertex_of_point: (0..points as u32).collect(),
        parts: Vec::new(),
        candidates: vec![candidate("model", Kind::Model)],
        frame_s: 0.1,
        exact: None,
        on_trained: false,
        reference_rays: Some(4000),
    }
}

/// One pose of a test.
struct Shot<'a> {
    pose: usize,
    clip: &'a str,
    split: Split,
    references: [&'a [f32]; 2],
    candidates: &'a [&'a [f32]],
}

/// Feeds a pose at time pose/10 s; candidates take the settings' names.
fn feed(measurement: &mut Measurement, shot: &Shot<'_>) {
    let names: Vec<String> =
        measurement.settings.candidates.iter().map(|c| c.name.clone()).collect();
    let named: Vec<(&str, &[f32])> =
        names.iter().map(String::as_str).zip(shot.candidates.iter().copied()).collect();
    let normals: Vec<Vec3> = (0..measurement.settings.points())
        .map(|i| Vec3::new((i as f32).sin(), 0.4, (i as f32).cos()).normalize())
        .collect();
    let case = Case {
        pose: shot.pose,
        clip: shot.clip,
        time_s: shot.pose as f32 / 10.0,
        split: shot.split,
        normals: &normals,
        reference1: shot.references[0],
        reference2: shot.references[1],
        candidates: &named,
    };
    measurement.add(&case).unwrap();
}

fn only(measured: &Measured) -> &CandidateMeasured {
    &measured.splits[0].candidates[0]
}

/// Known bias and variance come back. The model errs by a constant 0.002 plus independent normal
/// errors of deviation 0.005 (fixed over poses); the references carry noise of deviation 0.02,
/// four times as large. Over 200 poses × 50 points × 16 coefficients the cross form recovers the
/// mean square 2.9e-5 within 4 standard errors (significance 6e-5, seed 11), while the naive mean
/// square against the average reference is wrong by the noise's 2e-4.
#[test]
fn cross_form_is_unbiased_where_the_naive_form_is_not() {
    let mut noise = Stream::new(11);
    let mut measurement = Measurement::new(settings(Signal::Transfer, 4, 50)).unwrap();
    let (mut naive, mut count) = (0.0, 0.0);
    for pose in 0..200 {
        let truth: Vec<f32> = (0..800).map(|i| 0.3 * (i as f32 + pose as f32).sin()).collect();
        let biased: Vec<f32> = truth.iter().map(|x| x + 0.002).collect();
        let model = noisy(&mut noise, &biased, 0.005);
        let (r1, r2) = (noisy(&mut noise, &truth, 0.02), noisy(&mut noise, &truth, 0.02));
        for i in 0..800 {
            naive += f64::from(model[i] - (r1[i] + r2[i]) / 2.0).powi(2);
            count += 1.0;
        }
        let clip = ["a", "b", "c", "d", "e"][pose / 40];
        let references = [&r1[..], &r2[..]];
        let shot = Shot { pose, clip, split: Split::Novel, references, candidates: &[&model] };
        feed(&mut measurement, &shot);
    }
    let measured = measurement.finish();
    let truth = 0.002f64.powi(2) + 0.005f64.powi(2);
    let found = only(&measured).coefficients;
    // Var of one product (d−n₁)(d−n₂) about its mean: Var(d²) + 2σ²E[d²] + σ⁴.
    let (d2, s2) = (truth, 4e-4);
    let deviation = ((2.0 * 2.5e-5 * 2.5e-5 + 2.0 * s2 * d2 + s2 * s2) / count).sqrt();
    assert!((found.mean_square - truth).abs() < 4.0 * deviation, "{found:?} of {truth}");
    let claimed = found.standard_error.unwrap();
    assert!(claimed > deviation / 4.0 && claimed < deviation * 3.0, "{claimed} {deviation}");
    assert!((naive / count - truth - 2e-4).abs() < 1e-5, "naive {}", naive / count);
    let residual = &only(&measured).residual;
    assert!((residual.mean.value - 0.002).abs() < 4.0 * (2.25e-4f64 / count).sqrt());
    assert!((residual.variance - 2.5e-5).abs() < 5.0 * deviation);
    assert!((residual.variance_with_noise - 2.25e-4).abs() < 4e-6);
    let reference = &measured.splits[0].reference;
    assert!((reference.coefficient_noise_rms - 0.02 / 2f64.sqrt()).abs() < 1e-4);
    assert!(found.below_noise, "an error of 0.005 under a noise of 0.014 is not claimed");
}

/// The hemisphere, sphere and shading errors of one known Δ are ΔᵀG(n)Δ, ‖Δ‖² and (Δ·l)².
#[test]
fn transfer_errors_of_a_known_difference() {
    let mut measurement = Measurement::new(settings(Signal::Transfer, 6, 1)).unwrap();
    let delta: Vec<f32> = (0..36).map(|i| 0.01 * (i as f32 * 1.7).cos()).collect();
    let reference = vec![0.25f32; 36];
    let model: Vec<f32> = delta.iter().zip(&reference).map(|(d, r)| d + r).collect();
    let references = [&reference[..], &reference[..]];
    let split = Split::Training;
    let shot = Shot { pose: 0, clip: "", split, references, candidates: &[&model] };
    feed(&mut measurement, &shot);
    let normal = Vec3::new(0.0, 0.4, 1.0).normalize();
    let measured = measurement.finish();
    let function = only(&measured).function.unwrap();
    let order = Order::new(6).unwrap();
    let gram = crate::sh::hemisphere_gram(order, normal);
    let d: Vec<f64> = (0..36).map(|i| f64::from(model[i]) - 0.25).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let hemisphere: f64 = (0..36).map(|i| d[i] * dot(&gram[i * 36..(i + 1) * 36], &d)).sum();
    assert!((function.hemisphere.mean_square - hemisphere).abs() < 1e-6 * hemisphere);
    assert!((function.sphere.mean_square - dot(&d, &d)).abs() < 1e-12);
    for (light, shading) in lights().iter().zip(&only(&measured).shading) {
        let (error, size) = (dot(&d, &light.coefficients(order)), {
            0.25 * light.coefficients(order).iter().sum::<f64>()
        });
        assert!((shading.squared.rms.unwrap() - error.abs()).abs() < 1e-9, "{}", light.name);
        assert!((shading.relative_rms.unwrap() - (error / size).abs()).abs() < 1e-7);
        assert!((shading.psnr_db.unwrap() + 20.0 * error.abs().log10()).abs() < 1e-5);
    }
    let ao = only(&measured).ao;
    let expected = d[0] * 2.0 * PI.sqrt();
    assert!((ao.mean_signed.value - expected).abs() < 1e-9);
    assert!((ao.mean_absolute.value - expected.abs()).abs() < 1e-9);
}

/// An error that does not change gives no flicker, however large; one that alternates by ±0.01
/// gives 0.02 per frame. Pairs are only taken within a clip and without a gap in time.
#[test]
fn flicker_is_the_change_of_the_error() {
    for (swing, expected) in [(0.0, 0.0), (0.01f32, 0.02)] {
        let mut measurement = Measurement::new(settings(Signal::Ao, 1, 3)).unwrap();
        for pose in [0usize, 1, 2, 3, 6, 7, 8] {
            let truth: Vec<f32> = (0..3).map(|i| 0.5 + 0.1 * (pose + i) as f32).collect();
            let sign = if pose % 2 == 0 { 1.0 } else { -1.0 };
            let model: Vec<f32> = truth.iter().map(|t| t + 0.05 + sign * swing).collect();
            let clip = if pose == 8 { "other" } else { "walk" };
            let references = [&truth[..], &truth[..]];
            let split = Split::Novel;
            feed(&mut measurement, &Shot { pose, clip, split, references, candidates: &[&model] });
        }
        let measured = measurement.finish();
        assert_eq!(measured.splits[0].frame_pairs, 4);
        let flicker = only(&measured).flicker.unwrap();
        assert!((flicker.ao.rms.unwrap_or(0.0) - expected).abs() < 1e-6, "{flicker:?}");
        assert_eq!(flicker.shading, None);
        let change = measured.splits[0].reference.ao_change_rms.unwrap();
        assert!((change - 0.1).abs() < 1e-6, "the reference itself moves by 0.1: {change}");
    }
}

/// Steps into and out of interpolated frames count as interpolated; from training into held-out
/// time nowhere.
#[test]
fn flicker_between_splits() {
    let mut measurement = Measurement::new(settings(Signal::Ao, 1, 1)).unwrap();
    use Split::{Interpolated, Training, WithinClip};
    let splits = [Training, Training, Interpolated, Training, WithinClip, WithinClip];
    for (pose, split) in splits.into_iter().enumerate() {
        let x = [0.5f32];
        let references = [&x[..], &x[..]];
        feed(&mut measurement, &Shot { pose, clip: "c", split, references, candidates: &[&x] });
    }
    let measured = measurement.finish();
    let pairs: Vec<(Split, usize)> =
        measured.splits.iter().map(|s| (s.split, s.frame_pairs)).collect();
    assert_eq!(pairs, [(Training, 1), (Interpolated, 2), (WithinClip, 1)]);
}

/// The worst pose, vertex and sample are found and named: clip, time, part and vertex in glTF
/// order, though points are fewer than vertices.
#[test]
fn the_worst_is_named() {
    let part = |name: &str, vertices| Part {
        node: 0,
        source_node: 0,
        primitive: 0,
        name: name.to_owned(),
        vertices,
        triangles: 0..0,
    };
    let mut settings = settings(Signal::Ao, 1, 3);
    settings.vertex_of_point = vec![0, 4, 9];
    settings.parts = vec![part("body", 0..8), part("hat", 8..12)];
    let mut measurement = Measurement::new(settings).unwrap();
    let truth = [0.5f32; 3];
    let models = [[0.5f32, 0.6, 0.5], [0.5, 0.6, 0.7], [0.25, 0.5, 0.5]];
    for (pose, model) in models.iter().enumerate() {
        let (references, split) = ([&truth[..], &truth[..]], Split::Novel);
        feed(
            &mut measurement,
            &Shot { pose, clip: "run", split, references, candidates: &[model] },
        );
    }
    let measured = measurement.finish();
    let worst = only(&measured).worst.clone().unwrap();
    assert_eq!((worst.pose.pose, worst.pose.clip.as_str()), (1, "run"));
    assert!((worst.pose.time_s - 0.1).abs() < 1e-6 && (worst.pose.ao_mae - 0.1).abs() < 1e-6);
    let place = worst.vertex.place;
    assert_eq!((place.vertex, place.part.as_str(), place.vertex_in_part), (0, "body", 0));
    assert!((worst.sample.ao_error + 0.25).abs() < 1e-6);
    assert_eq!((worst.sample.pose, worst.sample.place.part.as_str()), (2, "body"));
    let surface = measured.surface.unwrap();
    assert_eq!(surface.vertex, [0, 4, 9]);
    assert!((surface.ao_mae[1] - 0.2 / 3.0).abs() < 1e-6);
}

/// The 99th percentile over all points and poses agrees with the exact one to its stated 0.4 %,
/// and the mean absolute error is exact.
#[test]
fn percentile_agrees_with_sorting() {
    let mut noise = Stream::new(5);
    let mut measurement = Measurement::new(settings(Signal::Ao, 1, 400)).unwrap();
    let mut errors = Vec::new();
    for pose in 0..30 {
        let truth = vec![0.5f32; 400];
        let model = noisy(&mut noise, &truth, 0.03);
        errors.extend(model.iter().map(|m| f64::from((m - 0.5).abs())));
        let (references, split) = ([&truth[..], &truth[..]], Split::Interpolated);
        feed(&mut measurement, &Shot { pose, clip: "c", split, references, candidates: &[&model] });
    }
    let measured = measurement.finish();
    let ao = only(&measured).ao;
    errors.sort_by(f64::total_cmp);
    let exact = crate::num::stats::quantile(&errors, 0.99).unwrap();
    assert!((ao.p99 - exact).abs() < 0.005 * exact, "{} {exact}", ao.p99);
    let mae = crate::num::stats::mean(&errors).unwrap();
    assert!((ao.mean_absolute.value - mae).abs() < 1e-9);
    let residual = &only(&measured).residual;
    let inside: f64 = residual.histogram.iter().sum();
    assert!((inside - 0.99).abs() < 5e-3, "{inside}");
    assert!(residual.cumulative.is_sorted());
}

/// A less precise copy of the model is compared with the model itself, where no noise hides the
/// difference; the baseline stands beside with its own, larger error.
#[test]
fn precision_and_baseline_stand_beside_the_model() {
    let mut noise = Stream::new(3);
    let mut settings = settings(Signal::Ao, 1, 200);
    settings.candidates.push(candidate("model i8", Kind::Precision));
    settings.candidates.push(candidate("mean", Kind::Baseline));
    let mut measurement = Measurement::new(settings).unwrap();
    for pose in 0..10 {
        let truth: Vec<f32> = (0..200).map(|i| ((i + pose * 7) as f32).sin()).collect();
        let model = noisy(&mut noise, &truth, 0.01);
        let coarse: Vec<f32> = model.iter().map(|x| x + 0.001).collect();
        let mean = vec![0.0; 200];
        let (r1, r2) = (noisy(&mut noise, &truth, 0.002), noisy(&mut noise, &truth, 0.002));
        let (references, split) = ([&r1[..], &r2[..]], Split::Novel);
        let candidates = [&model[..], &coarse, &mean];
        feed(
            &mut measurement,
            &Shot { pose, clip: "c", split, references, candidates: &candidates },
        );
    }
    let measured = measurement.finish();
    let [model, coarse, mean] = &measured.splits[0].candidates[..] else { panic!("three") };
    let added = coarse.added.unwrap();
    assert!((added.coefficient_rms - 0.001).abs() < 1e-6 && (added.ao_max - 0.001).abs() < 1e-6);
    assert!(added.mean_square_growth.unwrap().abs() < 0.1);
    assert_eq!((model.added, mean.added), (None, None));
    let rms = |c: &CandidateMeasured| c.coefficients.rms.unwrap();
    assert!((rms(model) - 0.01).abs() < 1e-3 && (rms(mean) - 0.7).abs() < 0.05);
}

/// Where the model is stored less precisely than another of its precisions, what that adds stands at the model and
/// is taken to the most precise one, which adds nothing.
#[test]
fn what_a_coarse_model_adds_is_its_own() {
    let mut settings = settings(Signal::Ao, 1, 100);
    settings.candidates.push(candidate("f32", Kind::Precision));
    settings.candidates.push(candidate("f16", Kind::Precision));
    settings.exact = Some(1);
    let mut measurement = Measurement::new(settings).unwrap();
    for pose in 0..4 {
        let truth: Vec<f32> = (0..100).map(|i| ((i + pose * 7) as f32).sin()).collect();
        let off = |by: f32| -> Vec<f32> { truth.iter().map(|x| x + by).collect() };
        let (coarse, exact, half) = (off(0.02), off(0.01), off(0.012));
        let (references, split) = ([&truth[..], &truth[..]], Split::Novel);
        let candidates = [&coarse[..], &exact, &half];
        feed(
            &mut measurement,
            &Shot { pose, clip: "c", split, references, candidates: &candidates },
        );
    }
    let measured = measurement.finish();
    let [coarse, exact, half] = &measured.splits[0].candidates[..] else { panic!("three") };
    let added = |c: &CandidateMeasured| c.added.unwrap().coefficient_rms;
    assert!((added(coarse) - 0.01).abs() < 1e-6 && (added(half) - 0.002).abs() < 1e-6);
    assert_eq!(exact.added, None);
    assert!((coarse.added.unwrap().mean_square_growth.unwrap() - 3.0).abs() < 1e-3);
}

/// The headline is of the most demanding motion that was measured; of a model for the trained clips it is of
/// what lies between their frames, or of these, as long as there is any such motion.
#[test]
fn the_headline_is_of_the_motion_that_counts() {
    let headline = |on_trained, splits: &[Split]| {
        let settings = Settings { on_trained, ..settings(Signal::Ao, 1, 1) };
        let mut measurement = Measurement::new(settings).unwrap();
        for (pose, &split) in splits.iter().enumerate() {
            let (references, candidates) = ([&[0.5_f32][..], &[0.5][..]], &[&[0.4_f32][..]][..]);
            feed(&mut measurement, &Shot { pose, clip: "", split, references, candidates });
        }
        measurement.finish().headline.unwrap()
    };
    let all = [Split::Training, Split::Novel, Split::Interpolated];
    assert_eq!((headline(false, &all), headline(true, &all)), (Split::Novel, Split::Interpolated));
    assert_eq!(headline(true, &all[..2]), Split::Training);
    assert_eq!(headline(true, &[Split::WithinClip]), Split::WithinClip);
}

/// Nothing measured, one pose and one vertex all end in a document without NaN or infinity that
/// reads back as it was written.
#[test]
fn small_measurements_are_sound_documents() {
    let empty = Measurement::new(settings(Signal::Visibility, 3, 4)).unwrap().finish();
    assert_eq!((empty.headline, empty.splits.len(), empty.surface.as_ref()), (None, 0, None));
    for (signal, bands) in [(Signal::Ao, 1), (Signal::Visibility, 3), (Signal::Transfer, 3)] {
        let mut measurement = Measurement::new(settings(signal, bands, 1)).unwrap();
        let truth = vec![0.5f32; usize::from(bands).pow(2)];
        let (references, split) = ([&truth[..], &truth[..]], Split::Training);
        feed(
            &mut measurement,
            &Shot { pose: 0, clip: "", split, references, candidates: &[&truth] },
        );
        let measured = measurement.finish();
        assert_eq!(measured.headline, Some(Split::Training));
        let candidate = only(&measured);
        assert_eq!(candidate.coefficients.rms, Some(0.0));
        assert_eq!(candidate.coefficients.standard_error, None);
        assert!(candidate.shading.iter().all(|s| s.psnr_db.is_none()), "no error, no decibels");
        assert_eq!(candidate.flicker, None);
        let text = serde_json::to_string(&measured).unwrap();
        // A NaN would be written as null and not read back as a number.
        assert_eq!(serde_json::from_str::<Measured>(&text).unwrap(), measured);
    }
}

/// Every lie of a case is an error that names it, and adds nothing.
#[test]
fn bad_cases_are_refused() {
    let mut measurement = Measurement::new(settings(Signal::Transfer, 2, 2)).unwrap();
    let good = vec![0.1f32; 8];
    let mut broken = good.clone();
    broken[5] = f32::NAN;
    let normals = [Vec3::X, Vec3::Y];
    let named = [("model", &good[..])];
    let case = Case {
        pose: 7,
        clip: "a",
        time_s: 0.0,
        split: Split::Novel,
        normals: &normals,
        reference1: &good,
        reference2: &good,
        candidates: &named,
    };
    let error = measurement.add(&Case { reference2: &good[1..], ..case }).unwrap_err();
    let what = "reference 2".to_owned();
    assert_eq!(error, Error::Length { pose: 7, what, expected: 8, found: 7 });
    let error = measurement.add(&Case { candidates: &[("model", &broken)], ..case }).unwrap_err();
    let what = "model".to_owned();
    assert_eq!(error, Error::NotFinite { pose: 7, what, point: 1, coefficient: 1 });
    let error = measurement.add(&Case { normals: &[Vec3::X, Vec3::ZERO], ..case }).unwrap_err();
    assert_eq!(error, Error::Normal { pose: 7, point: 1, length: 0.0 });
    let error = measurement.add(&Case { candidates: &[("other", &good)], ..case }).unwrap_err();
    assert!(matches!(error, Error::Candidates { .. }));
    assert_eq!(measurement.poses(), 0);
    measurement.add(&case).unwrap();
    assert_eq!(measurement.poses(), 1);

    let two_models = Settings {
        candidates: vec![candidate("a", Kind::Model), candidate("b", Kind::Model)],
        ..settings(Signal::Ao, 1, 1)
    };
    assert!(matches!(Measurement::new(two_models), Err(Error::Model { models: 2, .. })));
    assert!(matches!(
        Measurement::new(settings(Signal::Ao, 2, 1)),
        Err(Error::Layout { order: 2, .. })
    ));
}

/// The same poses give the same bytes with one thread and with three, over several blocks of
/// points and three channels.
#[test]
fn figures_do_not_depend_on_threads() {
    let document = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut noise = Stream::new(9);
            let mut settings = settings(Signal::Transfer, 3, 600);
            settings.channels = 3;
            let mut measurement = Measurement::new(settings).unwrap();
            for pose in 0..4 {
                let truth = noisy(&mut noise, &vec![0.2; 600 * 27], 0.1);
                let model = noisy(&mut noise, &truth, 0.02);
                let (r1, r2) = (noisy(&mut noise, &truth, 0.01), noisy(&mut noise, &truth, 0.01));
                let (references, split) = ([&r1[..], &r2[..]], Split::Novel);
                let candidates = [&model[..]];
                feed(
                    &mut measurement,
                    &Shot { pose, clip: "c", split, references, candidates: &candidates },
                );
            }
            serde_json::to_string(&measurement.finish()).unwrap()
        })
    };
    assert_eq!(document(1), document(3));
}
