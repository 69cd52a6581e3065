//! Interpolation compared with the truth.

use std::sync::atomic::AtomicBool;

use crate::bake::subdivide::{Fidelity, Leaf, Probes, Row, Source};
use crate::bake::{self, MOST_RAYS, Place};
use crate::pipeline::{Error, Job};
use crate::rig::Deformed;

use super::source::{Surface, Views};
use super::{direct, standing, surface, whole};

/// Rays of a probe, in those of a vertex.
pub(super) const PROBE_RAYS: u32 = 4;

/// The triangle in which interpolation is most wrong.
#[derive(Debug, Clone, PartialEq)]
pub struct Worst {
    /// Name of the mesh.
    pub mesh: String,
    /// The primitive's index within it.
    pub primitive: usize,
    /// The triangle's index within that.
    pub triangle: usize,
    /// Its middle in the first key pose, metres.
    pub at_m: [f32; 3],
}

impl Worst {
    /// Of a mesh whose triangles come by root.
    pub(super) fn of(
        job: &Job,
        surface: &Surface,
        (fidelity, triangles): (&Fidelity, &[Leaf]),
        posed: &Deformed,
    ) -> Self {
        let leaf = &triangles[fidelity.worst];
        let primitive = &surface.primitives[surface.primitive_of(leaf.root)];
        let part = &job.scene.mesh.parts[primitive.parts[0]];
        let first = triangles.partition_point(|l| (l.root as usize) < primitive.first_triangle);
        let corners = surface.triangles[leaf.root as usize].map(|vertex| {
            posed.positions[vertex as usize - primitive.first_vertex + part.vertices.start]
        });
        let share = |i: usize| leaf.at.iter().map(|at| at[i]).sum::<f32>() / 3.0;
        let at: glam::Vec3 = (0..3).map(|i| share(i) * corners[i]).sum();
        Self {
            mesh: part.name.clone(),
            primitive: part.primitive,
            triangle: fidelity.worst - first,
            at_m: at.to_array(),
        }
    }
}

/// So many places of a job's surface in its key poses, of which there are so many at most, with more
/// rays than its vertices have: what interpolation is compared with.
///
/// # Errors
/// As [`super::subdivide()`].
pub fn interpolation_probes(
    job: &Job,
    key_poses: usize,
    count: usize,
    stop: &AtomicBool,
) -> Result<Probes, Error> {
    direct(job)?;
    let mesh = &job.scene.mesh;
    let surface = surface(job, &whole(job)?)?;
    let key_poses = job.poses.covering(key_poses);
    let posed: Vec<Deformed> = key_poses.iter().map(|&pose| job.traced(pose)).collect();
    let areas = surface.areas(mesh, &posed[0]);
    let few = job.checked.bake;
    let rays = few.rays.saturating_mul(PROBE_RAYS).min(MOST_RAYS);
    let [few, many] =
        [few, bake::Settings { rays, ..few }].map(|settings| job.baker(&settings, None));
    let (few, many) = (few?, many?);
    let views = |baker| {
        let poses = standing(job, baker, &key_poses, &posed)?;
        Ok::<_, Error>(Views { mesh, surface: &surface, poses })
    };
    let rows = given_rows(job, &surface, &views(&few)?, stop)?;
    let drawn = (count, job.recipe.bake.seed);
    Ok(Probes::new(&areas, (&surface.leaves(), &rows), drawn, &views(&many)?, stop)?)
}

/// The rows of the input's vertices: of each point one vertex is baked. A vertex without a triangle
/// gets nothing, since nobody asks.
pub(super) fn given_rows(
    job: &Job,
    surface: &Surface,
    views: &Views<'_>,
    stop: &AtomicBool,
) -> Result<Vec<Row>, Error> {
    let mut corner: Vec<Option<Place>> = vec![None; surface.weld.len()];
    for (triangle, corners) in (0_u32..).zip(&surface.triangles) {
        for (i, &vertex) in corners.iter().enumerate() {
            let weights = std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
            corner[vertex as usize].get_or_insert(Place { triangle, weights });
        }
    }
    let mut first_of = std::collections::BTreeMap::new();
    let mut same = vec![usize::MAX; corner.len()];
    for primitive in &surface.primitives {
        let start = job.scene.mesh.parts[primitive.parts[0]].vertices.start;
        for own in 0..primitive.vertices {
            let vertex = primitive.first_vertex + own;
            if corner[vertex].is_some() {
                // Another number of instances makes another row.
                let point = (job.poses.points.of_vertex[start + own], primitive.parts.len());
                let key = if primitive.parts.len() == 1 { (point, 0) } else { (point, vertex) };
                same[vertex] = *first_of.entry(key).or_insert(vertex);
            }
        }
    }
    let baked: Vec<usize> = (0..same.len()).filter(|&vertex| same[vertex] == vertex).collect();
    let places: Vec<Place> = baked.iter().filter_map(|&vertex| corner[vertex]).collect();
    let numbers: Vec<u64> = baked.iter().map(|&vertex| vertex as u64).collect();
    let found = views.look(&places, &numbers, stop)?;
    let mut rows = vec![Row::default(); corner.len()];
    for (&vertex, row) in baked.iter().zip(found) {
        rows[vertex] = row;
    }
    for vertex in 0..rows.len() {
        if same[vertex] != usize::MAX && same[vertex] != vertex {
            rows[vertex] = rows[same[vertex]].clone();
        }
    }
    Ok(rows)
}
