use std::path::Path;
use std::sync::Mutex;

use super::*;
use crate::dataset::Dataset;
use crate::pipeline::recipe::{FamilyName, Recipe, SignalName};
use crate::pipeline::{Error, Job, bake, run};
use crate::scene::figure::figure;

/// A clip of the bundled character, all of whose poses are one block.
fn job(folder: &Path) -> Job {
    let path = folder.join("figure.glb");
    std::fs::write(&path, figure()).expect("written");
    let mut recipe = Recipe::default();
    recipe.poses.clips = Some(vec!["wave".to_owned()]);
    (recipe.poses.rate_hz, recipe.poses.near_repeat) = (6.0, 0.0);
    (recipe.bake.signal, recipe.bake.rays) = (SignalName::Ao, 2);
    recipe.fit.family = FamilyName::Linear;
    recipe.target.reference_poses = 1;
    Job::open(&path, recipe).expect("a job")
}

/// Within a block poses are counted as they are done, with their rays; the count ends at the whole.
#[test]
fn a_block_is_counted_from_within() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let job = job(folder.path());
    let (heard, stop) = (Mutex::new(Vec::new()), AtomicBool::new(false));
    let report = |progress: Progress| heard.lock().expect("heard").push(progress);
    let watch = Watch { report: &report, cancelled: &stop };
    let baked = bake(&job, &folder.path().join("d.zarr"), &watch).expect("baked");
    let heard = heard.into_inner().expect("heard");
    let blocks =
        Dataset::open(&folder.path().join("d.zarr")).expect("open").header().layout.blocks();
    assert_eq!(blocks, 1, "the test wants one block");
    assert!(heard.iter().any(|p| 0 < p.done && p.done < p.total && p.rays > 0), "{heard:?}");
    assert!(heard.is_sorted_by_key(|p| (p.done, p.rays)), "{heard:?}");
    let last = heard.last().expect("told");
    assert_eq!((last.done, last.total, last.rays), (last.total, baked.poses as u64, baked.rays));
}

/// Stopped during the fit or while it measures, a run says that this part is not kept; what was
/// baked is, and the next run ends.
#[test]
fn a_fit_and_a_measurement_can_be_stopped() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let job = job(folder.path());
    let output = folder.path().join("out");
    for (stage, when) in [(Stage::Fit, "during the fit"), (Stage::Measure, "poses were measured")] {
        let stop = AtomicBool::new(false);
        let report = |progress: Progress| {
            if progress.stage == stage {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let watch = Watch { report: &report, cancelled: &stop };
        let error = run(&job, &output, &watch).expect_err("stopped");
        assert!(matches!(error, Error::Stopped { .. }), "{error}");
        assert!(error.to_string().contains(when), "{error}");
        assert!(!error.to_string().contains("continues from there"), "{error}");
        let dataset = Dataset::open(&output.join("dataset.zarr")).expect("open");
        assert!(dataset.missing_blocks().is_empty() && !output.join("model.safetensors").exists());
    }
    let stop = AtomicBool::new(false);
    let outcome = run(&job, &output, &Watch { report: &|_| (), cancelled: &stop }).expect("run");
    assert!(outcome.made && outcome.baked.poses_now == 0);
}
