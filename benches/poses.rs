//! `cargo bench --bench poses -- [SCENE.glb] [--hold-out CLIP] [--signal ao] [--order 4] [--fps 30]
//! [--rays 64] [--reference-fps 4] [--reference-rays 512] [--folder DIR] [--fit JSON]…`: how many of
//! the training poses have to be baked. Everything is baked once at the full rate, and the held-out
//! clip once more with many rays; then models are fitted to fewer and fewer of the training poses,
//! those that lie farthest apart (`--most-poses`), those that are predicted to be most wrong
//! (`--choose-poses predicted-error`) or every n-th of each clip (a lower `--fps`), and judged on the held-out clip. A line per number of poses: rays that these take, and each model's
//! error over that of the same model fitted to everything.
//!
//! Without a scene it is the bundled character, and the held-out clip its jump.

#![expect(clippy::print_stdout, reason = "a benchmark prints its table")]

mod arguments;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use poselight::dataset::Dataset;
use poselight::model::{Model, PosedInput};
use poselight::pipeline::recipe::{FamilyName, FitRecipe, PoseChoiceName, Recipe, SignalName};
use poselight::pipeline::{self, Job, Watch};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Shares of the training poses, one over these.
const PARTS: [u32; 5] = [2, 3, 4, 8, 16];

/// How these are chosen.
const CHOSEN: [&str; 3] = ["farthest apart", "predicted error", "every n-th"];

struct Options {
    scene: Option<PathBuf>,
    folder: Option<PathBuf>,
    recipe: Recipe,
    reference: (f32, u32),
    fits: Vec<FitRecipe>,
}

fn main() -> Result<()> {
    let options = options()?;
    let temporary = tempfile::tempdir()?;
    let folder = options.folder.clone().unwrap_or_else(|| temporary.path().to_path_buf());
    let scene = match &options.scene {
        Some(scene) => scene.clone(),
        None => {
            let path = folder.join("figure.glb");
            std::fs::write(&path, poselight::scene::figure::figure())?;
            path
        }
    };
    let full_path = folder.join("full.zarr");
    let full = baked(&scene, options.recipe.clone(), &full_path, None)?;
    let mut held_out = options.recipe.clone();
    held_out.poses.clips = held_out.poses.hold_out.replace(Vec::new());
    (held_out.poses.rate_hz, held_out.bake.rays) = options.reference;
    held_out.bake.seed += 76;
    held_out.poses.mixed = 0;
    let reference = baked(&scene, held_out, &folder.join("judge.zarr"), None)?;
    let judge = Judge::new(&reference)?;
    let training = count(&full);
    let points = full.header().layout.points;
    println!(
        "{}: {:?}, {} Hz, {} rays; {training} training poses of {points} points; judged on {} poses of {} \
         rays of {:?}\n",
        scene.display(),
        options.recipe.bake.signal,
        options.recipe.poses.rate_hz,
        options.recipe.bake.rays,
        reference.header().layout.poses,
        options.reference.1,
        options.recipe.poses.hold_out,
    );
    let names: Vec<String> = options.fits.iter().map(label).collect();
    println!("| poses | chosen | million rays | of everything | {} |", names.join(" | "));
    println!("|---|---|---|---|{}", "---|".repeat(names.len()));
    let whole: Vec<f64> =
        options.fits.iter().map(|fit| judge.error(&full, fit)).collect::<Result<_>>()?;
    let line = |poses: usize, chosen: &str, errors: &[f64]| {
        let ratios = errors.iter().zip(&whole).map(|(e, w)| format!("{e:.5} ({:.3})", e / w));
        println!(
            "| {poses} | {chosen} | {:.1} | {:.2} | {} |",
            (poses * points) as f64 * f64::from(options.recipe.bake.rays) / 1e6,
            poses as f64 / training as f64,
            ratios.collect::<Vec<_>>().join(" | ")
        );
    };
    line(training, "everything", &whole);
    for part in PARTS {
        for (which, chosen) in CHOSEN.into_iter().enumerate() {
            let mut recipe = options.recipe.clone();
            if which < 2 {
                recipe.poses.most = Some((training as u32 / part).max(1));
                recipe.poses.choice =
                    [PoseChoiceName::Distance, PoseChoiceName::PredictedError][which];
            } else {
                recipe.poses.rate_hz /= part as f32;
            }
            let path = folder.join(format!("part{part}{which}.zarr"));
            let dataset = baked(&scene, recipe, &path, Some(&full_path))?;
            let errors: Result<Vec<f64>> =
                options.fits.iter().map(|fit| judge.error(&dataset, fit)).collect();
            line(count(&dataset), chosen, &errors?);
        }
    }
    Ok(())
}

fn count(dataset: &Dataset) -> usize {
    dataset.splits().iter().filter(|split| **split == 0).count()
}

fn label(fit: &FitRecipe) -> String {
    let family = serde_json::to_value(fit.family).unwrap_or_default();
    let sizes = [fit.inputs, fit.outputs, fit.spheres].into_iter().flatten();
    let sizes: Vec<String> = sizes.map(|size| size.to_string()).collect();
    format!("{} {}", family.as_str().unwrap_or_default(), sizes.join(", "))
}

/// The held-out clip, and how to pose it.
struct Judge<'a> {
    reference: &'a Dataset,
    job: Job,
}

impl<'a> Judge<'a> {
    fn new(reference: &'a Dataset) -> Result<Self> {
        Ok(Self { reference, job: pipeline::job_of(reference)? })
    }

    /// Root mean square error of a coefficient, the reference's noise taken out.
    fn error(&self, dataset: &Dataset, fit: &FitRecipe) -> Result<f64> {
        let mut recipe = pipeline::recipe_of(dataset)?;
        recipe.fit = fit.clone();
        let model: Model = match pipeline::fit(dataset, &recipe) {
            Ok(fitted) => fitted.model,
            // So few poses do not have the model's sizes.
            Err(pipeline::Error::Fit(_)) => return Ok(f64::NAN),
            Err(other) => return Err(other.into()),
        };
        let layout = self.reference.header().layout;
        let numbers = layout.points * layout.row();
        let (mut truth, mut found) = (vec![0.0; numbers], vec![0.0; numbers]);
        let mut noise = vec![0.0; layout.points];
        let (mut square, mut noise_square) = (0.0, 0.0);
        for pose in 0..layout.poses {
            self.reference.read_points(&[pose], 0..layout.points, &mut truth)?;
            self.reference.read_noise(&[pose], 0..layout.points, &mut noise)?;
            let sample = &self.job.poses.samples[pose];
            let surface = self.job.surface(pose, false);
            let input = PosedInput {
                parameters: &model.parameters_of_pose(&sample.pose)?,
                bone_rotations: &sample.bone_rotations,
                surface: Some(surface.as_surface()),
            };
            model.evaluate_posed(&input, &mut found)?;
            let errors = found.iter().zip(&truth).map(|(a, b)| f64::from(a - b).powi(2));
            square += errors.sum::<f64>() / layout.row() as f64;
            noise_square += noise.iter().map(|&noise| f64::from(noise).powi(2)).sum::<f64>();
        }
        let count = (layout.poses * layout.points) as f64;
        Ok(((square - noise_square) / count).max(0.0).sqrt())
    }
}

fn options() -> Result<Options> {
    let mut recipe = Recipe::default();
    (recipe.bake.signal, recipe.bake.rays) = (SignalName::Ao, 64);
    recipe.poses.interpolated_every = 0;
    recipe.poses.hold_out = Some(vec!["jump".to_owned()]);
    let mut options =
        Options { scene: None, folder: None, recipe, reference: (4.0, 512), fits: Vec::new() };
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        if !word.starts_with("--") {
            options.scene = Some(word.into());
            continue;
        }
        let value = words.next().ok_or(format!("{word} needs a value"))?;
        if arguments::edit(&mut options.recipe, &word, &value)? {
            continue;
        }
        match word.as_str() {
            "--hold-out" => options.recipe.poses.hold_out = Some(vec![value]),
            "--reference-fps" => options.reference.0 = value.parse()?,
            "--reference-rays" => options.reference.1 = value.parse()?,
            "--folder" => options.folder = Some(value.into()),
            "--fit" => options.fits.push(serde_json::from_str(&value)?),
            other => return Err(format!("there is no {other}").into()),
        }
    }
    if options.fits.is_empty() {
        let family = |family| FitRecipe { family, ..FitRecipe::default() };
        options.fits = vec![
            family(FamilyName::Linear),
            FitRecipe { inputs: Some(15), outputs: Some(100), ..family(FamilyName::PcaLinear) },
            family(FamilyName::Occluder),
        ];
    }
    Ok(options)
}

fn baked(scene: &Path, recipe: Recipe, path: &Path, from: Option<&Path>) -> Result<Dataset> {
    let job = Job::open(scene, recipe)?;
    let cancelled = AtomicBool::new(false);
    pipeline::bake_from(&job, path, from, &Watch { report: &|_| {}, cancelled: &cancelled })?;
    Ok(Dataset::open(path)?)
}
