//! Leave-out errors in closed form against fits that really leave poses out.

use super::*;

fn singles(poses: usize) -> Vec<Vec<usize>> {
    (0..poses).map(|i| vec![i]).collect()
}

fn by_clip(parts: &TrainingParts) -> Vec<Vec<usize>> {
    let mut clips = parts.clips.clone();
    clips.sort_unstable();
    clips.dedup();
    let of = |clip: &i32| (0..parts.clips.len()).filter(|&i| parts.clips[i] == *clip).collect();
    clips.iter().map(of).collect()
}

/// Compares every point of a report's curve with the oracle.
fn assert_curve(parts: &TrainingParts, fitted: &Fitted, groups: &[Vec<usize>], inputs: usize) {
    assert!(!fitted.report.alphas.is_empty());
    for &(alpha, rmse) in &fitted.report.alphas {
        let expected = Oracle::left_out_rmse(parts, groups, alpha, inputs);
        let error = (rmse - expected).abs() / expected;
        assert!(error < 1e-6, "alpha {alpha}: {rmse} is not {expected}, relative {error:e}");
    }
    let least = fitted.report.alphas.iter().map(|(_, e)| *e).fold(f64::INFINITY, f64::min);
    let chosen = fitted.report.alphas.iter().find(|(a, _)| Some(*a) == fitted.report.alpha);
    assert_eq!(chosen.unwrap().1, least);
}

/// Proves that leave-one-out agrees with leaving each pose out, to 1e-6, with more poses than
/// parameters, with fewer, and with duplicated and constant parameters.
#[test]
fn leave_one_out_is_leaving_one_out() {
    let sizes = Sizes { poses: 24, parameters: 5, points: 7, coefficients: 4 };
    let tall = synthetic(sizes, 0.5, 1);
    let wide = synthetic(Sizes { poses: 9, parameters: 14, ..sizes }, 0.5, 2);
    let mut collinear = synthetic(sizes, 0.5, 3);
    for row in collinear.parameters.chunks_exact_mut(5) {
        (row[3], row[4]) = (row[0], 2.5);
    }
    for parts in [tall, wide, collinear] {
        let fitted = run(&parts, &settings(Family::Linear));
        assert_curve(&parts, &fitted, &singles(parts.clips.len()), usize::MAX);
    }
}

/// Proves the same for whole clips: some longer than the number of regressors (their rows are
/// compressed), some shorter, one of a single pose, poses not sorted by clip.
#[test]
fn leave_one_clip_out_is_leaving_one_clip_out() {
    let sizes = Sizes { poses: 40, parameters: 4, points: 6, coefficients: 3 };
    let mut parts = synthetic(sizes, 0.5, 4);
    for (i, clip) in parts.clips.iter_mut().enumerate() {
        *clip = [0, 0, 0, 1, 2][i % 5];
    }
    parts.clips[7] = -1;
    let settings = Settings { ridge: Ridge::LeaveOneClipOut, ..settings(Family::Linear) };
    let fitted = run(&parts, &settings);
    assert_eq!(fitted.report.left_out, "each of 4 clips in turn");
    assert_curve(&parts, &fitted, &by_clip(&parts), usize::MAX);
}

/// Proves that a single clip is cut into contiguous quarters.
#[test]
fn one_clip_leaves_its_quarters_out() {
    let parts = synthetic(Sizes { poses: 22, parameters: 3, points: 4, coefficients: 2 }, 0.3, 5);
    let settings = Settings { ridge: Ridge::LeaveOneClipOut, ..settings(Family::Linear) };
    let fitted = run(&parts, &settings);
    let groups = [0..5, 5..11, 11..16, 16..22].map(|part| part.collect::<Vec<_>>());
    assert_curve(&parts, &fitted, &groups, usize::MAX);
}

/// Proves the explicit refit where the closed form divides zero by zero: one pose (and one clip)
/// is the only one that moves a parameter, so its leverage is 1 without regularisation.
#[test]
fn leverage_of_one_is_refitted() {
    let sizes = Sizes { poses: 16, parameters: 3, points: 5, coefficients: 2 };
    let mut parts = synthetic(sizes, 0.4, 6);
    for (pose, row) in parts.parameters.chunks_exact_mut(3).enumerate() {
        row[2] = if pose == 4 { 1.0 } else { 0.0 };
    }
    for clips in [(0..16).collect(), (0..16).map(|i| i / 3).collect::<Vec<i32>>()] {
        parts.clips = clips;
        for alpha in [0.0, 1e-9, 1e-5, 1e-3] {
            let ridge = Ridge::Fixed(alpha);
            let fitted = run(&parts, &Settings { ridge, ..settings(Family::Linear) });
            assert_eq!(fitted.report.alphas.len(), 1);
            assert_curve(&parts, &fitted, &by_clip(&parts), usize::MAX);
        }
    }
}

/// Proves that `pca-linear` counts the principal directions of the poses among what is fitted
/// without a clip: the oracle finds them anew. The basis holds all outputs, so it changes nothing.
#[test]
fn principal_directions_are_left_out_too() {
    let sizes = Sizes { poses: 30, parameters: 6, points: 4, coefficients: 5 };
    let mut parts = synthetic(sizes, 0.5, 7);
    parts.clips.iter_mut().enumerate().for_each(|(i, clip)| *clip = (i / 8) as i32);
    let family = Family::PcaLinear { inputs: 3, outputs: 4 };
    let settings = Settings { ridge: Ridge::LeaveOneClipOut, ..settings(family) };
    assert_curve(&parts, &run(&parts, &settings), &by_clip(&parts), 3);
}

/// Proves that leaving out single frames of a slow motion with a disturbance that is shared by
/// neighbours chooses less regularisation than leaving out clips: why clips are the default.
#[test]
fn clips_choose_more_regularisation_than_frames() {
    let (clips, frames, parameters, outputs) = (6, 20, 8, 30);
    let sizes = Sizes { poses: clips * frames, parameters, points: outputs, coefficients: 1 };
    let mut parts = synthetic(sizes, 0.0, 8);
    let mut stream = Stream::new(9);
    for clip in 0..clips {
        let centre: Vec<f64> = (0..parameters).map(|_| stream.normal()).collect();
        let shift: Vec<f64> = (0..outputs).map(|_| 3.0 * stream.normal()).collect();
        for frame in 0..frames {
            let pose = clip * frames + frame;
            parts.clips[pose] = clip as i32;
            for (j, centre) in centre.iter().enumerate() {
                parts.parameters[pose * parameters + j] = (centre + 0.1 * stream.normal()) as f32;
            }
            for (j, shift) in shift.iter().enumerate() {
                let x = f64::from(parts.parameters[pose * parameters + j % parameters]);
                parts.values[pose * outputs + j] = (x + shift + 0.01 * stream.normal()) as f32;
            }
        }
    }
    let alpha =
        |ridge| run(&parts, &Settings { ridge, ..settings(Family::Linear) }).report.alpha.unwrap();
    let (frame, clip) = (alpha(Ridge::LeaveOneOut), alpha(Ridge::LeaveOneClipOut));
    assert!(clip > 3.0 * frame, "{clip} is not far above {frame}");
}
