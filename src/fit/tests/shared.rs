//! Fits that share what they have in common are those that do not, and noise buys no rank.

use super::local::{clustered_family, multilinear_family, rmse};
use super::*;
use crate::fit::{ClusteredSizes, Kept, Largest, PointClusters, Shared, fit_shared};
use crate::model::Form;

const SIZES: Sizes = Sizes { poses: 24, parameters: 4, points: 12, coefficients: 4 };

fn families() -> Vec<Family> {
    let pca = |inputs, outputs| Family::PcaLinear { inputs, outputs };
    let clustered = |form, share| match clustered_family(form, 2) {
        Family::Clustered(sizes) => {
            Family::Clustered(ClusteredSizes { outputs: Kept::Share(share), ..sizes })
        }
        other => other,
    };
    vec![
        Family::Linear,
        pca(2, 3),
        pca(3, 5),
        pca(3, 8),
        multilinear_family(2, 1, PointClusters::None),
        multilinear_family(2, 2, PointClusters::Count(3)),
        clustered(Form::Linear, 0.6),
        clustered(Form::Linear, 0.9),
        clustered(Form::Quadratic, 0.9),
    ]
}

/// Proves for every family and several sizes that a fit which takes its parts from earlier ones
/// says what a fit on its own says, in any order of the fits: to the round-off of f32 products.
#[test]
fn shared_fits_are_fits() {
    let parts = synthetic(SIZES, 0.1, 21);
    let training = Training::in_memory(parts.clone());
    let largest = Largest { outputs: 8, cluster_outputs: Kept::Share(0.9), groups: 0 };
    let mut all = families();
    for _ in 0..2 {
        let shared = Shared::new(largest);
        for &family in &all {
            let alone = run(&parts, &settings(family));
            let with = fit_shared(&training, &settings(family), None, &shared).unwrap();
            let of = |pose: usize| predict(&alone, &parts.parameters[pose * 4..][..4], 4);
            assert!(worst(&parts, &with, of) < 1e-4, "{family:?}");
            let [a, b] = [&alone, &with].map(|f| f.report.training_rmse);
            assert!((a - b).abs() < 1e-4 * a, "{family:?}: {a} {b}");
        }
        all.reverse();
    }
}

/// Proves that clusters keep as many outputs as the signal has directions, not as many as it takes
/// to say the noise of few rays, where the data know their noise; and that this loses nothing.
#[test]
fn noise_buys_no_rank() {
    let mut parts = synthetic(Sizes { poses: 60, points: 80, coefficients: 1, ..SIZES }, 0.05, 22);
    // Noise that is larger than what all but the strongest of four directions say.
    let mut stream = Stream::new(23);
    parts.values.iter_mut().for_each(|y| *y += 0.6 * stream.normal() as f32);
    let outputs = |parts: &TrainingParts| {
        let fitted = run(parts, &settings(clustered_family(Form::Linear, 1)));
        let Decoder::Clustered(clustered) = &fitted.decoder else { panic!("not clustered") };
        (clustered.clusters[0].outputs, rmse(parts, &fitted))
    };
    parts.noise_variance = 0.0;
    let (blind, _) = outputs(&parts);
    parts.noise_variance = 0.36 + 0.0025;
    let (seeing, error) = outputs(&parts);
    assert!(seeing <= 4 && blind > 40, "{seeing} of {blind}");
    // What is left is the noise itself.
    assert!((error - 0.6).abs() < 0.1, "{error}");
}

/// Proves that points whose signal is only noise keep their mean alone, that others keep all, and
/// that what is said of either stays.
#[test]
fn still_points_keep_their_mean() {
    let mut parts = synthetic(Sizes { poses: 80, points: 30, coefficients: 1, ..SIZES }, 0.05, 24);
    let mut stream = Stream::new(25);
    for pose in parts.values.chunks_exact_mut(30) {
        for point in (0..30).step_by(3) {
            pose[point] = 0.7 + 0.05 * stream.normal() as f32;
        }
    }
    parts.noise_of_points = vec![0.0025; 30];
    let fitted = run(&parts, &settings(clustered_family(Form::Linear, 2)));
    let Decoder::Clustered(clustered) = &fitted.decoder else { panic!("not clustered") };
    let last = clustered.clusters.len() - 1;
    assert_eq!(clustered.clusters[last].outputs, 0);
    for (point, &cluster) in clustered.cluster_of_point.iter().enumerate() {
        assert_eq!(cluster as usize == last, point % 3 == 0, "{point}");
    }
    assert_eq!(clustered.clusters[last].basis.len(), 10);
    assert!(fitted.report.notices.iter().any(|notice| notice.starts_with("10 of 30 points")));
    assert!(rmse(&parts, &fitted) < 0.06);
}
