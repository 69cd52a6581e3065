//! What a run knows, gathered for the report page.

use crate::dataset::Dataset;
use crate::fit::FitReport;
use crate::measure::Split;
use crate::measure::report::{
    Character, ClipFacts, LeftOut, ModelFacts, Phase, ReportInput, RestMesh, Spectrum, Target,
    Times, html,
};
use crate::model::{Model, Precision};

use super::notices::rays_of;
use super::report_stills::stills;
use super::run::headline_rms;
use super::{Figures, Job, ReferenceSettings, rays_per_point, reference_notice, spent};

/// The page of a measured model.
#[must_use]
pub(super) fn page(
    job: &Job,
    dataset: &Dataset,
    model: &Model,
    figures: &Figures,
    report: &FitReport,
    settings: ReferenceSettings,
) -> String {
    let recipe =
        serde_json::to_string_pretty(&model.header().provenance.recipe).unwrap_or_default();
    let kept = |count: usize| (count > 0).then_some(count);
    let mesh = dataset.mesh();
    let short = reference_notice(&job.recipe.bake, settings);
    // A report is not refused for what cannot be read again.
    let missed = spent(dataset).ok().flatten().and_then(|spent| spent.missed);
    let (stills, unshown) = stills(job, model, &figures.measured);
    let lit = job.lit.iter().flat_map(|lit| lit.notices.iter().cloned());
    let short =
        short.into_iter().chain(missed.map(|missed| missed.story())).chain(unshown).chain(lit);
    html(&ReportInput {
        title: &job.recipe.scene.file,
        made_by: concat!("poselight ", env!("CARGO_PKG_VERSION")),
        machine: &machine(),
        measured: &figures.measured,
        character: character(job),
        model: model_facts(dataset, model, figures, report),
        pose_spectrum: Spectrum {
            values: &figures.spectra.pose,
            total: None,
            kept: kept(figures.model.inputs),
        },
        output_spectrum: Spectrum {
            values: &figures.spectra.output,
            total: Some(figures.spectra.output_energy),
            kept: kept(figures.model.outputs),
        },
        times: times(dataset, figures),
        rest: Some(RestMesh {
            positions: &mesh.positions,
            triangles: &mesh.triangles,
            point_of_vertex: &mesh.point_of_vertex,
        }),
        stills,
        left_out: left_out(job),
        target: settings.max_error.map(|most| Target {
            most: f64::from(most),
            reached: headline_rms(&figures.measured),
            validated: figures.choice.as_ref().map(|choice| choice.validation_largest),
        }),
        warnings: report.notices.iter().cloned().chain(short).collect(),
        recipe: &recipe,
        hashes: model.header().provenance.hashes.clone().into_iter().collect(),
    })
}

/// The processor and how many threads worked.
fn machine() -> String {
    let threads = rayon::current_num_threads();
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info
        .lines()
        .find_map(|line| line.strip_prefix("model name"))
        .map_or(std::env::consts::ARCH, |rest| rest.trim_start_matches([' ', '\t', ':']));
    format!("{name}, {threads} threads, {}", crate::num::cpu::Isa::best().name())
}

fn character(job: &Job) -> Character {
    let mesh = &job.scene.mesh;
    let training = |sample: &&crate::pose::Sample| sample.split == crate::pose::Split::Training;
    let mut joints: Vec<usize> = mesh.deformers.iter().map(|deformer| deformer.node).collect();
    joints.sort_unstable();
    joints.dedup();
    Character {
        vertices: mesh.positions.len(),
        triangles: mesh.triangles.len(),
        joints: joints.len(),
        morphs: mesh.weight_names.len(),
        size_m: job.poses.size_m,
        parameters: job.poses.parametrisation.columns.len(),
        training_poses: job.poses.samples.iter().filter(training).count(),
        rays: rays_per_point(&job.recipe.bake),
        clips: clips(job),
    }
}

fn clips(job: &Job) -> Vec<ClipFacts> {
    let names = job.poses.clip_names.iter().enumerate();
    names
        .map(|(index, name)| {
            let samples: Vec<_> =
                job.poses.samples.iter().filter(|sample| sample.clip == index).collect();
            let mut splits: Vec<Split> = samples.iter().map(|s| s.split.into()).collect();
            splits.sort_unstable();
            splits.dedup();
            let clip = job.scene.clips.iter().find(|clip| &clip.name == name);
            ClipFacts {
                name: name.clone(),
                duration_s: clip.map_or(0.0, |clip| clip.duration_s),
                poses: samples.len(),
                splits,
            }
        })
        .collect()
}

fn model_facts(
    dataset: &Dataset,
    model: &Model,
    figures: &Figures,
    report: &FitReport,
) -> ModelFacts {
    let layout = &dataset.header().layout;
    let mesh_bytes = (layout.points * layout.row() * 4) as u64;
    let training = dataset.splits().iter().filter(|&&split| split == 0).count() as u64;
    let sizes = &figures.model;
    let family = if sizes.outputs > 0 {
        format!("{} ({}, {})", sizes.family, sizes.inputs, sizes.outputs)
    } else {
        sizes.family.clone()
    };
    ModelFacts {
        family,
        frame: sizes.frame.clone(),
        precision: sizes.precision.clone(),
        parameters: sizes.parameters,
        alpha: report.alpha,
        sizes: precisions(model, figures),
        tensor_bytes: sizes.tensor_bytes,
        training_bytes: mesh_bytes * training,
        mesh_bytes,
        multiply_adds: sizes.multiply_adds,
        evaluate_us: Some(figures.times.evaluate_us),
        folded_us: figures.times.folded_us,
    }
}

/// Bytes of the model's file, then of those of the other precisions that can hold its numbers.
fn precisions(model: &Model, figures: &Figures) -> Vec<(String, u64)> {
    let own = model.header().precision;
    let others = Precision::ALL.iter().filter(|&&p| p != own);
    let written = others.filter_map(|&p| Some((p, model.to_bytes(p).ok()?.len() as u64)));
    std::iter::once(("model".to_owned(), figures.model.bytes))
        .chain(written.map(|(p, bytes)| (p.name().to_owned(), bytes)))
        .collect()
}

fn times(dataset: &Dataset, figures: &Figures) -> Times {
    let layout = &dataset.header().layout;
    let phases = figures.times.fit_phases_s.iter().filter(|(name, _)| *name != "total_s");
    Times {
        bake_s: figures.times.bake_s,
        bake_rays_per_s: figures.times.rays_per_s,
        bake_rays: (figures.times.rays_per_s.zip(figures.times.bake_s))
            .map_or(0, |(rate, seconds)| (rate * seconds).round() as u64),
        bake_poses: layout.poses,
        reference_s: figures.times.reference_s,
        fit: phases
            .map(|(name, &seconds)| Phase {
                name: phase(name),
                seconds,
                pca: name.contains("pca") || name.contains("svd"),
            })
            .collect(),
    }
}

/// A phase of a fit in words.
fn phase(name: &str) -> String {
    let words = match name {
        "leave_out_s" => "choosing the ridge by what is left out",
        "maps_s" => "maps of the clusters",
        "occluders_s" => "spheres and the unshadowed part",
        "output_pca_s" => "principal components of the outputs",
        "pass_s" => "reading the data",
        "point_clusters_s" => "clusters of points",
        "pose_clusters_s" => "clusters of poses",
        "pose_svd_s" => "decomposition of the poses",
        "project_s" => "projection of the outputs",
        "ridge_s" => "ridge",
        "solve_s" => "solving for the outputs",
        other => return other.trim_end_matches("_s").replace('_', " "),
    };
    words.to_owned()
}

fn left_out(job: &Job) -> LeftOut {
    LeftOut {
        dropped: job.poses.parametrisation.dropped.clone(),
        near_repeats: job.poses.near_repeats.iter().map(|repeat| repeat.dropped).sum(),
        near_repeat: job.checked.poses.near_repeat,
        passed_over: job.poses.passed_over,
        saved_rays: rays_of(job, job.poses.passed_over),
        notices: job.scene.notices.clone(),
    }
}
