//! `cargo bench --bench assets -- FOLDER…`: every GLB in the folders goes through a whole run, and
//! a table says what came of it: a line per character with its vertices, poses, rays per second,
//! bytes, error on unseen motion beside the mean's, and the worst frame. `--rays N` and
//! `--reference-poses N` make it cheaper; the line above the table says what was used.

#![expect(clippy::print_stdout, reason = "a benchmark prints its table")]

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use poselight::measure::Split;
use poselight::pipeline::recipe::Recipe;
use poselight::pipeline::{self, Job, Outcome, Watch};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

fn main() -> Result<()> {
    let mut recipe = Recipe::default();
    let mut folders = Vec::new();
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        let mut number =
            || words.next().ok_or("a number is missing")?.parse::<u32>().map_err(Into::into);
        let number: &mut dyn FnMut() -> Result<u32> = &mut number;
        match word.as_str() {
            "--rays" => recipe.bake.rays = number()?,
            "--reference-poses" => recipe.target.reference_poses = number()?,
            folder => folders.push(PathBuf::from(folder)),
        }
    }
    if folders.is_empty() {
        println!("no folder of characters was named, so there is nothing to run");
        return Ok(());
    }
    println!(
        "transfer, order {}, {} rays, {} threads, P(8,22) in the bone frame, references of {} times the rays over {} poses a split\n",
        recipe.bake.order,
        recipe.bake.rays,
        rayon::current_num_threads(),
        recipe.target.reference_factor,
        recipe.target.reference_poses
    );
    println!(
        "| character | vertices | poses | Mray/s | model kB | unseen motion | RMSE | of the mean | ao error | of the mean | worst frame | fit / bake |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    let mut failed = Vec::new();
    for scene in scenes(&folders)? {
        match run(&scene, recipe.clone()) {
            Ok(line) => println!("{line}"),
            Err(error) => {
                println!("| {} | {error} |", name(&scene));
                failed.push(name(&scene));
            }
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(format!("failed: {}", failed.join(", ")).into()) }
}

fn scenes(folders: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut scenes = Vec::new();
    for folder in folders {
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if path.extension().is_some_and(|extension| extension == "glb") {
                scenes.push(path);
            }
        }
    }
    scenes.sort();
    Ok(scenes)
}

fn name(scene: &Path) -> String {
    scene.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn run(scene: &Path, recipe: Recipe) -> Result<String> {
    let folder = tempfile::tempdir()?;
    let job = Job::open(scene, recipe)?;
    let cancelled = AtomicBool::new(false);
    let watch = Watch { report: &|_| {}, cancelled: &cancelled };
    let outcome = pipeline::run(&job, folder.path(), &watch)?;
    Ok(line(scene, &job, &outcome))
}

fn line(scene: &Path, job: &Job, outcome: &Outcome) -> String {
    let measured = &outcome.figures.measured;
    let split = measured.headline.unwrap_or(Split::Training);
    let found = measured.split(split);
    let of = |name: &str| found.and_then(|s| s.candidates.iter().find(|c| c.name == name));
    let (model, mean) = (of("model"), of("mean"));
    let rms = |c: Option<&poselight::measure::CandidateMeasured>| {
        c.and_then(|c| c.coefficients.rms).map_or("below noise".to_owned(), |v| format!("{v:.4}"))
    };
    let ao = |c: Option<&poselight::measure::CandidateMeasured>| {
        c.map_or(String::new(), |c| format!("{:.4}", c.ao.mean_absolute.value))
    };
    let worst = model.and_then(|m| m.worst.as_ref()).map_or(String::new(), |worst| {
        format!("{} at {:.2} s ({:.3})", worst.pose.clip, worst.pose.time_s, worst.pose.ao_mae)
    });
    format!(
        "| {} | {} | {} | {:.1} | {} | {} ({} poses) | {} | {} | {} | {} | {} | {:.3} |",
        name(scene),
        job.scene.mesh.positions.len(),
        job.poses.samples.len(),
        outcome.figures.times.rays_per_s.unwrap_or_default() / 1e6,
        outcome.figures.model.bytes / 1000,
        split.name(),
        found.map_or(0, |s| s.poses),
        rms(model),
        rms(mean),
        ao(model),
        ao(mean),
        worst,
        outcome.figures.times.fit_s / outcome.baked.bake_s
    )
}
