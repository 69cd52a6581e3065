//! What is measured, and where it goes.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use poselight::choose::Point;
use poselight::dataset::Dataset;
use poselight::measure::report::{Lines, Series, lines};
use poselight::pipeline::recipe::{FitRecipe, OnName, Recipe, SignalName};
use poselight::pipeline::{self, CandidateRecipe, Job, Progress, Tradeoff, Watch};

pub(crate) type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// What the command line says.
pub(crate) struct Options {
    scenes: Vec<PathBuf>,
    recipe: Recipe,
    pub(crate) folder: Option<PathBuf>,
    pub(crate) output: Option<PathBuf>,
    pub(crate) parts: Vec<String>,
}

impl Options {
    pub(crate) fn parse() -> Result<Self> {
        let mut recipe = Recipe::default();
        (recipe.poses.rate_hz, recipe.poses.interpolated_every) = (4.0, 4);
        (recipe.bake.rays, recipe.bake.order) = (64, 4);
        (recipe.target.reference_factor, recipe.target.reference_poses) = (8, 10);
        let parts = ["tables", "quarter", "studies", "frames", "equal"].map(str::to_owned).to_vec();
        let mut this = Self { scenes: Vec::new(), recipe, folder: None, output: None, parts };
        let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
        while let Some(word) = words.next() {
            if !word.starts_with("--") {
                this.scenes.push(word.into());
                continue;
            }
            let value = words.next().ok_or(format!("{word} needs a value"))?;
            match word.as_str() {
                "--fps" => this.recipe.poses.rate_hz = value.parse()?,
                "--rays" => this.recipe.bake.rays = value.parse()?,
                "--order" => this.recipe.bake.order = value.parse()?,
                "--factor" => this.recipe.target.reference_factor = value.parse()?,
                "--poses" => this.recipe.target.reference_poses = value.parse()?,
                "--folder" => this.folder = Some(value.into()),
                "--output" => this.output = Some(value.into()),
                "--part" => this.parts = value.split(',').map(str::to_owned).collect(),
                other => return Err(format!("there is no {other}").into()),
            }
        }
        Ok(this)
    }

    /// The scenes' files; the bundled character where none was named.
    pub(crate) fn scenes(&self, temporary: &Path) -> Result<Vec<PathBuf>> {
        if !self.scenes.is_empty() {
            return Ok(self.scenes.clone());
        }
        let path = temporary.join("figure.glb");
        std::fs::write(&path, poselight::scene::figure::figure())?;
        Ok(vec![path])
    }
}

/// The data sets of one scene, with references.
pub(crate) struct Bakes {
    pub(crate) name: String,
    pub(crate) ao: Dataset,
    pub(crate) transfer: Dataset,
    pub(crate) visibility: Dataset,
}

impl Bakes {
    pub(crate) fn new(scene: &Path, options: &Options, folder: &Path) -> Result<Self> {
        let name = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let bake = |signal: SignalName, word: &str| -> Result<Dataset> {
            let mut recipe = options.recipe.clone();
            recipe.bake.signal = signal;
            if signal == SignalName::Ao {
                recipe.bake.order = Recipe::default().bake.order;
            }
            let job = Job::open(scene, recipe)?;
            let path = folder.join(format!("{name}.{word}.zarr"));
            let cancelled = AtomicBool::new(false);
            pipeline::bake(&job, &path, &watch(&cancelled))?;
            let dataset = Dataset::open(&path)?;
            pipeline::bake_reference(&dataset, job.checked.reference, &watch(&cancelled))?;
            Ok(dataset)
        };
        Ok(Self {
            ao: bake(SignalName::Ao, "ao")?,
            transfer: bake(SignalName::Transfer, "transfer")?,
            visibility: bake(SignalName::Visibility, "visibility")?,
            name,
        })
    }
}

pub(crate) fn watch(cancelled: &AtomicBool) -> Watch<'_> {
    Watch { report: &|_| {}, cancelled }
}

/// A model to try: the data set's recipe with another fit.
pub(crate) fn candidate(
    dataset: &Dataset,
    name: impl Into<String>,
    on: OnName,
    edit: impl FnOnce(&mut FitRecipe),
) -> Result<CandidateRecipe> {
    let mut recipe = pipeline::recipe_of(dataset)?;
    recipe.fit = FitRecipe::default();
    recipe.target.on = on;
    edit(&mut recipe.fit);
    Ok(CandidateRecipe { name: name.into(), recipe, poses: None })
}

pub(crate) fn measured(dataset: &Dataset, candidates: &[CandidateRecipe]) -> Result<Tradeoff> {
    let cancelled = AtomicBool::new(false);
    // Whoever waits for half an hour wants to see that it goes on.
    let report = |progress: Progress| {
        let name = usize::try_from(progress.done).ok().and_then(|done| candidates.get(done));
        let next = name.map_or("done", |candidate| &candidate.name);
        eprintln!("{:.0} s, {} of {}: {next}", progress.elapsed_s, progress.done, progress.total);
    };
    let watch = Watch { report: &report, cancelled: &cancelled };
    Ok(pipeline::tradeoff(dataset, candidates, &watch)?)
}

/// The point of a candidate in a precision, where the data had its sizes.
pub(crate) fn point<'a>(tradeoff: &'a Tradeoff, name: &str, precision: &str) -> Option<&'a Point> {
    let name = format!("{name} · {precision}");
    tradeoff.points.iter().find(|point| point.name == name)
}

/// Root mean square error of a coefficient on a split; the references' noise cancels in it.
pub(crate) fn rms(point: &Point, split: &str) -> f64 {
    point.errors.get(split).map_or(f64::NAN, |error| error.rms)
}

/// Mean absolute error of ambient occlusion on a split, the references' noise in it.
pub(crate) fn ao(point: &Point, split: &str) -> f64 {
    point.errors.get(split).map_or(f64::NAN, |error| error.ao_mae)
}

/// The most demanding split that a data set has.
pub(crate) fn unseen(tradeoff: &Tradeoff) -> &str {
    &tradeoff.split
}

/// The page under way.
pub(crate) struct Page {
    pub(crate) text: String,
    pictures: Vec<(String, String)>,
}

impl Page {
    pub(crate) fn new(options: &Options) -> Self {
        let Recipe { poses, bake, target, .. } = &options.recipe;
        let text = format!(
            "# The papers' methods on our characters\n\nMade by `cargo bench --bench papers`. Reduced: \
             {} poses per second of clip, {} rays, harmonics of order {}, references of {} times the \
             rays over about {} poses of each split, of which every {}th frame is *interpolated* and a \
             quarter of the clips (or the last quarter of the only one) *unseen*. Fits as published \
             have no regularisation. Errors are of coefficients (RMSE, the references' noise taken \
             out) or of ambient occlusion (mean absolute error, as AO07 has it, the references' \
             noise in it). Times are of a shared machine with {} threads, one core for evaluation.\n",
            poses.rate_hz,
            bake.rays,
            bake.order,
            target.reference_factor,
            target.reference_poses,
            poses.interpolated_every,
            rayon::current_num_threads()
        );
        Self { text, pictures: Vec::new() }
    }

    pub(crate) fn scene(&mut self, bakes: &Bakes) {
        let layout = bakes.transfer.header().layout;
        let training = bakes.transfer.splits().iter().filter(|split| **split == 0).count();
        let _ = write!(
            self.text,
            "\n## {}\n\n{} vertices, {} points, {} parameters; {} poses, {training} of them training.\n",
            bakes.name, layout.vertices, layout.points, layout.parameters, layout.poses
        );
    }

    /// A heading and what it is about.
    pub(crate) fn head(&mut self, heading: &str, lead: &str) {
        let _ = write!(self.text, "\n### {heading}\n\n{lead}\n\n");
    }

    pub(crate) fn row<T: AsRef<str>>(&mut self, cells: &[T]) {
        let cells: Vec<&str> = cells.iter().map(AsRef::as_ref).collect();
        let _ = writeln!(self.text, "| {} |", cells.join(" | "));
    }

    pub(crate) fn header(&mut self, cells: &[&str]) {
        self.row(cells);
        let _ = writeln!(self.text, "|{}", "---|".repeat(cells.len()));
    }

    pub(crate) fn line(&mut self, line: &str) {
        let _ = writeln!(self.text, "{line}");
    }

    /// A plot, named by the scene and a word.
    pub(crate) fn plot(&mut self, file: &str, of: &Lines<'_>) {
        let _ = writeln!(self.text, "![{}]({file}.svg)\n", of.title);
        self.pictures.push((format!("{file}.svg"), lines(of)));
    }

    pub(crate) fn write(&self, folder: Option<&Path>) -> Result<()> {
        let Some(folder) = folder else { return Ok(()) };
        std::fs::create_dir_all(folder)?;
        std::fs::write(folder.join("page.md"), &self.text)?;
        for (name, svg) in &self.pictures {
            std::fs::write(folder.join(name), svg)?;
        }
        Ok(())
    }
}

/// A line of a study: one number of each of some points over another.
pub(crate) fn series<'a>(
    name: impl Into<String>,
    points: impl IntoIterator<Item = (f64, Option<&'a Point>)>,
    of: impl Fn(&Point) -> f64,
) -> Series {
    let points = points.into_iter().filter_map(|(x, point)| Some((x, of(point?))));
    (name.into(), points.collect())
}
