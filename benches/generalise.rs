//! `cargo bench --bench generalise -- SCENE.glb [--signal ao] [--order 6] [--fps 15] [--rays 256]
//! [--mixed-poses N] [--reference-fps 2] [--reference-rays 1024] [--folds 4] [--folder DIR]
//! [--family NAME[,…]]…`:
//! how models do on clips that they have not seen. The scene's clips are baked once, and once more
//! with many rays at other times; then each fold of the clips is left out of the fit in turn (by
//! default each clip, at most four folds) and predicted. A line per fold and model: bytes at 8
//! bits, mean absolute error of ambient occlusion (for harmonics of their first coefficient times
//! 2√π) and RMSE of the coefficients, both over the mean model's. The reference's own noise is
//! taken out of the squares; the absolute errors contain it.
//!
//! `--folder` keeps the bakes, which are taken up again. `--family` lines may add settings of the
//! recipe's `fit` as JSON: `--family occluder`, `--fit '{"family":"occluder","spheres":60}'`.

#![expect(clippy::print_stdout, reason = "a benchmark prints its table")]

mod arguments;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use poselight::dataset::Dataset;
use poselight::model::{Model, PosedInput, Precision, Signal};
use poselight::pipeline::recipe::{FamilyName, FitRecipe, Recipe, SignalName};
use poselight::pipeline::{self, Job, Watch};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Evaluations of a pose, of which the fastest counts.
const REPETITIONS: usize = 5;

/// What the command line says.
struct Options {
    scene: PathBuf,
    folder: Option<PathBuf>,
    recipe: Recipe,
    reference: (f32, u32),
    folds: usize,
    fits: Vec<FitRecipe>,
}

fn main() -> Result<()> {
    let Some(options) = options()? else {
        println!("no scene was named, so there is nothing to try");
        return Ok(());
    };
    let temporary = tempfile::tempdir()?;
    let folder = options.folder.as_deref().unwrap_or(temporary.path());
    let training = baked(&options.scene, options.recipe.clone(), &folder.join("training.zarr"))?;
    let mut many = options.recipe.clone();
    (many.poses.rate_hz, many.bake.rays) = options.reference;
    many.bake.seed += 76;
    (many.poses.mixed, many.poses.most) = (0, None);
    let reference = baked(&options.scene, many, &folder.join("reference.zarr"))?;
    let bake = &options.recipe.bake;
    println!(
        "{}: {:?}, {} training poses of {} rays, {} reference poses of {}; {} points, {} threads\n",
        options.scene.display(),
        bake.signal,
        training.header().layout.poses,
        bake.rays,
        reference.header().layout.poses,
        options.reference.1,
        training.header().layout.points,
        rayon::current_num_threads()
    );
    println!(
        "| left out | model | kB (i8) | ao error | of the mean's | RMSE | of the mean's | reference noise | fit s | ms a pose |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let job = pipeline::job_of(&reference)?;
    let mut totals = vec![[0.0; 4]; options.fits.len()];
    let folds = folds(&training, options.folds);
    for fold in &folds {
        let names: Vec<&str> = fold
            .iter()
            .map(|&clip| training.header().attributes.clip_names[clip as usize].as_str())
            .collect();
        let mean = FitRecipe { family: FamilyName::Mean, ..FitRecipe::default() };
        let baseline = tried(&training, &reference, &job, fold, &mean)?;
        for (fit, total) in options.fits.iter().zip(&mut totals) {
            let found = tried(&training, &reference, &job, fold, fit)?;
            println!(
                "| {} | {} | {:.0} | {:.4} | {:.3} | {:.4} | {:.3} | {:.4} | {:.1} | {:.2} |",
                if names.len() > 3 { format!("{} clips", names.len()) } else { names.join(", ") },
                label(fit),
                found.bytes as f64 / 1e3,
                found.ao,
                found.ao / baseline.ao,
                found.rms,
                found.rms / baseline.rms,
                found.noise,
                found.fit_s,
                found.evaluate_ms
            );
            for (sum, x) in total.iter_mut().zip([found.ao, baseline.ao, found.rms, baseline.rms]) {
                *sum += x / folds.len() as f64;
            }
        }
    }
    for (fit, [ao, mean_ao, rms, mean_rms]) in options.fits.iter().zip(totals) {
        println!(
            "| all | {} | | {ao:.4} | {:.3} | {rms:.4} | {:.3} | | |",
            label(fit),
            ao / mean_ao,
            rms / mean_rms
        );
    }
    Ok(())
}

fn label(fit: &FitRecipe) -> String {
    let (Ok(value), Ok(default)) =
        (serde_json::to_value(fit), serde_json::to_value(FitRecipe::default()))
    else {
        return String::new();
    };
    let fields = value.as_object().into_iter().flatten();
    let told = fields.filter(|(name, value)| *name == "family" || default[*name] != **value);
    told.map(|(name, value)| format!("{name} {value}")).collect::<Vec<_>>().join(", ")
}

fn options() -> Result<Option<Options>> {
    let mut recipe = Recipe::default();
    recipe.bake.signal = SignalName::Ao;
    recipe.bake.rays = 256;
    recipe.poses.rate_hz = 15.0;
    recipe.poses.interpolated_every = 0;
    recipe.poses.hold_out = Some(Vec::new());
    let mut options = Options {
        scene: PathBuf::new(),
        folder: None,
        recipe,
        reference: (2.0, 1024),
        folds: 4,
        fits: Vec::new(),
    };
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        if !word.starts_with("--") {
            options.scene = word.into();
            continue;
        }
        let value = words.next().ok_or(format!("{word} needs a value"))?;
        if arguments::edit(&mut options.recipe, &word, &value)? {
            continue;
        }
        match word.as_str() {
            "--reference-fps" => options.reference.0 = value.parse()?,
            "--reference-rays" => options.reference.1 = value.parse()?,
            "--folds" => options.folds = value.parse()?,
            "--folder" => options.folder = Some(value.into()),
            "--family" => {
                for name in value.split(',') {
                    let family = serde_json::from_value(name.into())?;
                    options.fits.push(FitRecipe { family, ..FitRecipe::default() });
                }
            }
            "--fit" => options.fits.push(serde_json::from_str(&value)?),
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

/// The clips in at most so many folds, dealt out in turn.
fn folds(dataset: &Dataset, most: usize) -> Vec<Vec<i32>> {
    let clips = dataset.header().attributes.clip_names.len();
    let count = most.clamp(1, clips);
    (0..count).map(|fold| (fold..clips).step_by(count).map(|clip| clip as i32).collect()).collect()
}

/// What a model came to on the clips that its fit left out.
struct Tried {
    bytes: usize,
    /// Mean absolute error.
    ao: f64,
    /// Of the coefficients, the reference's noise taken out.
    rms: f64,
    /// Root mean square of the reference's standard error.
    noise: f64,
    fit_s: f64,
    /// Least wall time of a whole frame on one core, from the posed mesh to the root frame.
    evaluate_ms: f64,
}

fn tried(
    training: &Dataset,
    reference: &Dataset,
    job: &Job,
    fold: &[i32],
    fit: &FitRecipe,
) -> Result<Tried> {
    let mut recipe = pipeline::recipe_of(training)?;
    recipe.fit = fit.clone();
    let fitted = pipeline::fit_without(training, &recipe, fold)?;
    let blob = fitted.model.to_bytes(Precision::I8)?;
    let model = Model::from_bytes(&blob)?;
    let layout = reference.header().layout;
    let numbers = layout.points * layout.row();
    let (mut truth, mut found) = (vec![0.0; numbers], vec![0.0; numbers]);
    let mut noise = vec![0.0; layout.points];
    let mut evaluate_ms = f64::INFINITY;
    let to_ao =
        if model.header().signal == Signal::Ao { 1.0 } else { 2.0 * std::f64::consts::PI.sqrt() };
    let (mut absolute, mut square, mut noise_square, mut count) = (0.0, 0.0, 0.0, 0.0);
    for pose in (0..layout.poses).filter(|&pose| fold.contains(&reference.clips()[pose])) {
        reference.read_points(&[pose], 0..layout.points, &mut truth)?;
        reference.read_noise(&[pose], 0..layout.points, &mut noise)?;
        let surface = job.surface(pose, false);
        let sample = &job.poses.samples[pose];
        let parameters = model.parameters_of_posed(&sample.pose, surface.as_surface().positions)?;
        let input = PosedInput {
            parameters: &parameters,
            bone_rotations: &job.poses.samples[pose].bone_rotations,
            surface: Some(surface.as_surface()),
        };
        for _ in 0..REPETITIONS {
            let start = Instant::now();
            model.evaluate_posed(&input, &mut found)?;
            evaluate_ms = evaluate_ms.min(start.elapsed().as_secs_f64() * 1e3);
        }
        let rows = found.chunks_exact(layout.row()).zip(truth.chunks_exact(layout.row()));
        for ((found, truth), noise) in rows.zip(&noise) {
            absolute += to_ao * f64::from(found[0] - truth[0]).abs();
            let errors = found.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2));
            square += errors.sum::<f64>() / layout.row() as f64;
            noise_square += f64::from(*noise).powi(2);
            count += 1.0;
        }
    }
    Ok(Tried {
        bytes: blob.len(),
        ao: absolute / count,
        rms: ((square - noise_square) / count).max(0.0).sqrt(),
        noise: (noise_square / count).sqrt(),
        fit_s: fitted.fit_s,
        evaluate_ms,
    })
}
