//! The refined surface as parts of the file, its vertices in the file's order.

use crate::bake::subdivide::Refined;
use crate::pipeline::Job;
use crate::rig::Mix;
use crate::scene::RefinedPart;

use super::Refinement;
use super::skin::{self, Skinned};
use super::smooth::Shape;
use super::source::Surface;

/// Where a vertex of the refined surface went: its primitive, and its number there.
pub(super) struct Placed {
    primitive: usize,
    number: u32,
}

/// Each primitive's own vertices keep their numbers, its new ones follow.
pub(super) fn place_all(surface: &Surface, refined: &Refined) -> Vec<Placed> {
    let mut all = Vec::with_capacity(refined.rows.len());
    let mut next: Vec<u32> = Vec::new();
    for (index, primitive) in surface.primitives.iter().enumerate() {
        let number = |number| Placed { primitive: index, number };
        all.extend((0..primitive.vertices as u32).map(number));
        next.push(primitive.vertices as u32);
    }
    for place in &refined.places {
        let primitive = surface.primitive_of(place.triangle);
        all.push(Placed { primitive, number: next[primitive] });
        next[primitive] += 1;
    }
    all
}

/// What every primitive becomes, and how its new vertices are bound.
pub(super) fn parts(
    job: &Job,
    surface: &Surface,
    (refined, all): (&Refined, &[Placed]),
    key_poses: &[usize],
    refinement: &Refinement,
) -> (Vec<RefinedPart>, Skinned) {
    let mesh = &job.scene.mesh;
    let part_of = |primitive: usize| surface.primitives[primitive].parts[0];
    let mut parts: Vec<RefinedPart> = (0..surface.primitives.len())
        .map(|primitive| RefinedPart {
            part: part_of(primitive),
            added: Vec::new(),
            influences: Vec::new(),
            moved: Vec::new(),
            triangles: Vec::new(),
        })
        .collect();
    let mixes: Vec<Mix> = refined
        .places
        .iter()
        .map(|place| {
            let primitive = &surface.primitives[surface.primitive_of(place.triangle)];
            let start = mesh.parts[primitive.parts[0]].vertices.start - primitive.first_vertex;
            let corners = surface.triangles[place.triangle as usize];
            let vertices = corners.map(|vertex| start as u32 + vertex);
            Mix { vertices, weights: place.weights }
        })
        .collect();
    let shape = match refinement.smooth {
        true => Shape::smooth(mesh, surface, &refined.places),
        false => Shape::flat(),
    };
    let moved = shape.moved(mesh, &mixes);
    let bound_m = refinement.bound * job.poses.size_m;
    let skinned = skin::bind(job, (&mixes, &shape), key_poses, bound_m);
    for (index, (place, mix)) in refined.places.iter().zip(&mixes).enumerate() {
        let primitive = surface.primitive_of(place.triangle);
        let start = mesh.parts[part_of(primitive)].vertices.start as u32;
        let own = Mix { vertices: mix.vertices.map(|vertex| vertex - start), ..*mix };
        parts[primitive].added.push(own);
        parts[primitive].influences.push(skinned.influences[index].clone());
        parts[primitive].moved.extend(moved.get(index));
    }
    for leaf in &refined.triangles {
        let corners = leaf.corners.map(|vertex| all[vertex as usize].number);
        parts[surface.primitive_of(leaf.root)].triangles.push(corners);
    }
    (parts, skinned)
}

/// The first view's transfer by primitive and number, as import numbers the result.
pub(super) fn values(surface: &Surface, refined: &Refined, all: &[Placed]) -> Option<Vec<f32>> {
    if surface.primitives.iter().any(|primitive| primitive.parts.len() > 1) {
        return None;
    }
    let views = refined.rows.iter().map(|row| row.normals.len()).max()?;
    let width = refined.rows.iter().map(|row| row.transfer.len()).max()? / views;
    let nothing = vec![0.0; width];
    let mut out = Vec::with_capacity(refined.rows.len() * width);
    for vertex in in_order(all) {
        let row = &refined.rows[vertex].transfer;
        out.extend_from_slice(row.get(..width).unwrap_or(&nothing));
    }
    Some(out)
}

/// The estimate at every vertex: the largest of its triangles.
pub(super) fn errors(refined: &Refined, all: &[Placed]) -> Vec<f32> {
    let mut of_vertex = vec![0.0_f32; refined.rows.len()];
    for (leaf, &error) in refined.triangles.iter().zip(&refined.errors) {
        for corner in leaf.corners {
            let here = &mut of_vertex[corner as usize];
            *here = here.max(error);
        }
    }
    in_order(all).into_iter().map(|vertex| of_vertex[vertex]).collect()
}

/// Vertices by primitive, then by number.
fn in_order(all: &[Placed]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by_key(|&vertex| (all[vertex].primitive, all[vertex].number));
    order
}
