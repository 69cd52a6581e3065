//! `cargo bench --bench choice -- SCENE.glb [--signal ao] [--order 4] [--fps 15] [--rays 64]
//! [--folder DIR] [--full]`: the automatic choice of a model against an exhaustive search. Every
//! candidate of every family, parametrisation and size is fitted to all points without each group
//! of training clips and measured on that group, in every precision; then the search chooses by
//! several targets of its own accord. A line per target: what each chose, the choice's error (for a
//! target of bytes) or bytes (for a target of error) over that of the exhaustive search's best
//! point, and the time of both.
//!
//! `--full` adds the papers' own forms; `--folder` keeps the bake. Both searches see training clips
//! only: nothing here is about motion that was held out, which the other tables are.

#![expect(clippy::print_stdout, reason = "a benchmark prints its table")]

mod arguments;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use poselight::choose::{Choice, Point, Target, decide};
use poselight::dataset::Dataset;
use poselight::pipeline::recipe::{Recipe, SignalName};
use poselight::pipeline::{self, CandidateRecipe, Job, Range, VALIDATION, Watch};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

struct Options {
    scene: PathBuf,
    folder: Option<PathBuf>,
    recipe: Recipe,
    range: Range,
}

fn main() -> Result<()> {
    let Some(options) = options()? else {
        println!("no scene was named, so there is nothing to choose for");
        return Ok(());
    };
    let temporary = tempfile::tempdir()?;
    let folder = options.folder.as_deref().unwrap_or(temporary.path());
    let dataset = baked(&options.scene, options.recipe, &folder.join("choice.zarr"))?;
    let layout = dataset.header().layout;
    let recipe = pipeline::recipe_of(&dataset)?;
    let candidates = pipeline::candidates(&recipe, layout.points, options.range);
    let cancelled = AtomicBool::new(false);
    let watch = Watch { report: &|_| {}, cancelled: &cancelled };
    let (points, exhaustive_s) = pipeline::exhaustive(&dataset, &candidates, &watch)?;
    println!(
        "{}: {:?}, {} poses, {} points; exhaustive: {} candidates, {exhaustive_s:.1} s, {} threads\n",
        options.scene.display(),
        recipe.bake.signal,
        layout.poses,
        layout.points,
        points.len(),
        rayon::current_num_threads()
    );
    println!("| target | exhaustive | choice | error | bytes | search s | of exhaustive |");
    println!("|---|---|---|---|---|---|---|");
    for (name, target) in targets(&points) {
        compare(&dataset, &candidates, (&points, exhaustive_s), (&name, target), &watch)?;
    }
    Ok(())
}

/// Errors between the best and the mean's, and a few sizes.
fn targets(points: &[Point]) -> Vec<(String, Target)> {
    let errors = || points.iter().filter_map(error);
    let (least, most) = (errors().fold(f64::INFINITY, f64::min), errors().fold(0.0, f64::max));
    let of_error = [0.1, 0.3, 0.6].map(|share| {
        let max_error = least + share * (most.min(3.0 * least) - least);
        (
            format!("error {max_error:.4}"),
            Target { max_error: Some(max_error), ..Target::default() },
        )
    });
    let of_bytes = [60_000, 150_000, 400_000].map(|bytes| {
        (format!("{} kB", bytes / 1000), Target { max_bytes: Some(bytes), ..Target::default() })
    });
    of_error.into_iter().chain(of_bytes).collect()
}

fn error(point: &Point) -> Option<f64> {
    point.errors.get(VALIDATION).map(|error| error.rms)
}

fn compare(
    dataset: &Dataset,
    candidates: &[CandidateRecipe],
    (points, exhaustive_s): (&[Point], f64),
    (name, target): (&str, Target),
    watch: &Watch,
) -> Result<()> {
    let Some(Choice::Met(best) | Choice::Missed(best)) = decide(points, VALIDATION, &target) else {
        return Err("nothing was measured".into());
    };
    let best = &points[best];
    let found = pipeline::search(dataset, candidates, &target, watch)?;
    let chosen = &found.points[found.chosen];
    // Judged by the exhaustive search's own figures.
    let judged = points.iter().find(|point| point.name == chosen.name).unwrap_or(chosen);
    let ratio = |of: &dyn Fn(&Point) -> f64| of(judged) / of(best);
    println!(
        "| {name} | {} | {} | {:.3} | {:.3} | {:.1} | {:.1} % |",
        best.name,
        chosen.name,
        ratio(&|point| error(point).unwrap_or(f64::NAN)),
        ratio(&|point| point.bytes as f64),
        found.search_s,
        100.0 * found.search_s / exhaustive_s
    );
    Ok(())
}

fn options() -> Result<Option<Options>> {
    let mut recipe = Recipe::default();
    recipe.bake.signal = SignalName::Ao;
    recipe.bake.rays = 64;
    recipe.poses.rate_hz = 15.0;
    recipe.poses.hold_out = Some(Vec::new());
    let mut options = Options { scene: PathBuf::new(), folder: None, recipe, range: Range::Quick };
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        if word == "--full" {
            options.range = Range::Full;
            continue;
        }
        if !word.starts_with("--") {
            options.scene = word.into();
            continue;
        }
        let value = words.next().ok_or(format!("{word} needs a value"))?;
        if arguments::edit(&mut options.recipe, &word, &value)? {
            continue;
        }
        match word.as_str() {
            "--folder" => options.folder = Some(value.into()),
            other => return Err(format!("there is no {other}").into()),
        }
    }
    Ok((!options.scene.as_os_str().is_empty()).then_some(options))
}

fn baked(scene: &Path, recipe: Recipe, path: &Path) -> Result<Dataset> {
    let job = Job::open(scene, recipe)?;
    let cancelled = AtomicBool::new(false);
    pipeline::bake(&job, path, &Watch { report: &|_| {}, cancelled: &cancelled })?;
    Ok(Dataset::open(path)?)
}
