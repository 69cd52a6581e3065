//! Which meshes have points inside other geometry, named for the user.

use super::{Error, Job};
use crate::bake::{Baker, Surroundings};

/// Meshes that are named; further ones are counted.
const MOST_NAMED: usize = 8;

/// One sentence for each mesh of which points lie inside other geometry in the first pose, most
/// points first.
///
/// # Errors
/// What the baker objects to.
pub fn buried(job: &Job) -> Result<Vec<String>, Error> {
    if job.poses.samples.is_empty() {
        return Ok(Vec::new());
    }
    let (triangles, points) = job.occluders.with(&job.scene.mesh, &job.poses.points);
    // Whom a point does not see, and what lets rays through, buries nobody. Ground has its own sentence.
    let around = Surroundings { ground_m: None, ..job.surroundings.clone() };
    let baker = Baker::new(&triangles, &points, &job.checked.bake)?.within(around)?;
    let baker = match &job.openings {
        Some(openings) => baker.through(openings.clone()),
        None => baker,
    };
    let first = job.traced(0);
    let found = baker.buried(&super::bake::posed(job, 0, &first))?;
    let mut parts = Vec::new();
    for part in &job.scene.mesh.parts {
        let mut own = points.of_vertex[part.vertices.clone()].to_vec();
        own.sort_unstable();
        own.dedup();
        let inside = own.iter().filter(|&&point| found[point as usize]).count();
        if inside > 0 {
            parts.push((inside, own.len(), part.name.as_str()));
        }
    }
    parts.sort_by(|a, b| b.0.cmp(&a.0).then(a.2.cmp(b.2)));
    // What falls off with distance takes away a part of the light alone.
    let light = if job.surroundings.falloff.is_some() { "little" } else { "no" };
    let named = parts.iter().take(MOST_NAMED).map(|(inside, all, name)| {
        format!(
            "mesh {name:?}: {inside} of {all} points lie inside other geometry and get {light} light"
        )
    });
    let mut sentences: Vec<String> = named.collect();
    if parts.len() > MOST_NAMED {
        sentences.push(format!("so do points of {} more meshes", parts.len() - MOST_NAMED));
    }
    Ok(sentences)
}
