//! What a user should know of a job before trusting its results.

use super::recipe::BakeRecipe;
use super::reference::{rays_per_point, reference_rays};
use super::{Job, ReferenceSettings, buried};
use crate::bake;
use crate::pose::Split;

/// What import, sampling and the bake mended, rounded or left out, a sentence each.
#[must_use]
pub fn notices(job: &Job) -> Vec<String> {
    let mut notices = job.scene.notices.clone();
    for repeat in &job.poses.near_repeats {
        notices.push(format!(
            "clip `{}`: {} of {} poses dropped as near-repeats (threshold {})",
            job.poses.clip_names[repeat.clip], repeat.dropped, repeat.sampled, repeat.threshold
        ));
    }
    if job.poses.passed_over > 0 {
        let all = job.poses.passed_over + of_training(job);
        notices.push(format!(
            "{} of {all} training poses are not baked, which saves {:.1} of {:.1} million rays: those \
             kept lie farthest apart",
            job.poses.passed_over,
            rays_of(job, job.poses.passed_over) as f64 * 1e-6,
            rays_of(job, all) as f64 * 1e-6,
        ));
    }
    if job.scene.clips.is_empty() && job.poses.samples.len() == 1 {
        notices.push(
            "the scene does not move, for its file has no clip: its default pose alone is baked, and \
             a model is its mean"
                .into(),
        );
    } else if job.poses.samples.len() == 1 {
        notices.push("the scene does not move: one pose is baked, and a model is its mean".into());
    } else if job.poses.parametrisation.columns.is_empty() {
        notices.push("no joint moves in the training poses: a model is their mean".into());
    }
    notices.extend(held_out(job));
    // What the tracer objects to it will say when it bakes.
    notices.extend(job.buried.get_or_init(|| buried(job).unwrap_or_default()).iter().cloned());
    notices.extend(rounded(&job.recipe.bake));
    notices.extend(job.lit.iter().flat_map(|lit| lit.notices.iter().cloned()));
    notices
}

/// The most rays that so many poses are baked with.
pub(super) fn rays_of(job: &Job, poses: usize) -> u64 {
    let of_pose = job.poses.points.count() as u64 * u64::from(rays_per_point(&job.recipe.bake));
    of_pose.saturating_mul(poses as u64)
}

fn of_training(job: &Job) -> usize {
    job.poses.samples.iter().filter(|sample| sample.split == Split::Training).count()
}

/// What the model will be proven on, which the user may not have chosen.
fn held_out(job: &Job) -> Option<String> {
    let of = |split| job.poses.samples.iter().filter(move |sample| sample.split == split);
    let within = of(Split::WithinClip).count();
    if within > 0 {
        let last = if within == 1 { "pose".to_owned() } else { format!("{within} poses") };
        return Some(format!("held out: the last {last} of the only clip"));
    }
    let mut clips: Vec<&str> =
        of(Split::Novel).map(|sample| job.poses.clip_names[sample.clip].as_str()).collect();
    clips.dedup();
    let drawn = if job.checked.poses.hold_out.is_none() {
        " (drawn by the seed; --hold-out chooses)"
    } else {
        ""
    };
    (!clips.is_empty()).then(|| format!("held out: {}{drawn}", clips.join(", ")))
}

/// Rays that are cast over and above those asked for. With a target noise the number is a bound.
fn rounded(recipe: &BakeRecipe) -> Option<String> {
    let cast = bake::rays_cast(recipe.rays);
    (recipe.noise.is_none() && cast != recipe.rays).then(|| {
        format!(
            "{cast} rays are cast at each point, not {}: they come in equal halves",
            recipe.rays
        )
    })
}

/// References that cannot have as many rays as they should.
#[must_use]
pub fn reference_notice(bake: &BakeRecipe, settings: ReferenceSettings) -> Option<String> {
    let (rays, own) = (reference_rays(bake, settings.factor), rays_per_point(bake));
    (u64::from(rays) < u64::from(own) * u64::from(settings.factor)).then(|| {
        format!(
            "the references cast {rays} rays at each point, the most there can be: {:.1} times the \
             bake's {own}, not {}",
            f64::from(rays) / f64::from(own),
            settings.factor
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene that stands still says that its model is a mean, and whether that is for want of a clip.
    #[test]
    fn standing_still_is_told() {
        let still = crate::pipeline::two_nodes::scene(false);
        let job = Job::new(still, None, crate::pipeline::recipe::Recipe::default()).unwrap();
        let told = notices(&job).join("; ");
        assert!(told.contains("does not move, for its file has no clip"), "{told}");
        let figure = crate::scene::figure::figure();
        let source = crate::scene::Source { name: "figure.glb".into(), bytes: figure };
        let limits = crate::scene::Limits::default();
        let moving = crate::scene::import_sources(vec![source], &limits).unwrap();
        let mut recipe = crate::pipeline::recipe::Recipe::default();
        recipe.poses.rate_hz = 2.0;
        let told = notices(&Job::new(moving, None, recipe).unwrap()).join("; ");
        assert!(!told.contains("does not move") && told.contains("held out"), "{told}");
    }

    /// Whoever asks for the notices of a job, a run or a service's too, hears of points inside other geometry.
    #[test]
    fn what_is_buried_is_told() {
        let corners =
            "v -3 -3 -3\nv 3 -3 -3\nv 3 3 -3\nv -3 3 -3\nv -3 -3 3\nv 3 -3 3\nv 3 3 3\nv -3 3 3\n";
        let faces = "f 1 4 3 2\nf 5 6 7 8\nf 1 5 8 4\nf 2 3 7 6\nf 1 2 6 5\nf 4 8 7 3\n";
        let bytes = format!("{corners}{faces}").into_bytes();
        let source = crate::scene::Source { name: "hull.obj".into(), bytes };
        let hull = crate::scene::import_sources(vec![source], &crate::scene::Limits::default());
        let mut recipe = crate::pipeline::recipe::Recipe::default();
        recipe.bake.surroundings.occluders = Some(Default::default());
        let floor = crate::pipeline::two_nodes::scene(false);
        let told = notices(&Job::new(floor, Some(hull.unwrap()), recipe).unwrap()).join("; ");
        assert!(told.contains("4 of 4 points lie inside other geometry"), "{told}");
    }

    /// Seventeen rays are eighteen and said to be; even numbers and bounds need no word.
    #[test]
    fn rounding_is_told() {
        let of = |rays, noise| rounded(&BakeRecipe { rays, noise, ..BakeRecipe::default() });
        let told = of(17, None).expect("17 are not cast");
        assert!(told.contains("18 rays are cast") && told.contains("not 17"), "{told}");
        assert_eq!((of(500, None), of(17, Some(0.01))), (None, None));
    }

    /// References have so many times the rays that are cast, all rounds together, up to the bound,
    /// and where that cuts them short it is said.
    #[test]
    fn a_bound_on_references_is_told() {
        let settings = ReferenceSettings { factor: 8, poses: 1, max_error: None };
        let of = |rays| BakeRecipe { rays, more_rays: vec![15], ..BakeRecipe::default() };
        assert_eq!(reference_rays(&of(17), 8), 8 * (18 + 16));
        assert_eq!(reference_notice(&of(17), settings), None);
        let told = reference_notice(&of(400_000), settings).expect("3.2 million are too many");
        assert!(told.contains("1000000 rays") && told.contains("2.5 times"), "{told}");
    }
}
