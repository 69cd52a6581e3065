//! Vertices that stay together: the two sides of a seam are one place in every pose, and so must be what is
//! made between them.

use std::collections::HashMap;

use glam::Vec3;

use crate::rig::{Influence, Mesh, Mix, MorphTarget};

/// Skin weights that differ by less are the same: files round them on either side of a seam.
const SAME_WEIGHT: f32 = 1e-4;

/// Vertex → its place: equal where vertices have one position and what moves them is the same.
pub(super) fn places(mesh: &Mesh) -> Vec<u32> {
    let mut found: HashMap<[u32; 3], Vec<u32>> = HashMap::new();
    let mut place = Vec::with_capacity(mesh.positions.len());
    for (vertex, position) in (0_u32..).zip(&mesh.positions) {
        // Adding 0 turns −0 into 0.
        let here = found.entry(position.to_array().map(|x| (x + 0.0).to_bits())).or_default();
        let same = here.iter().find(|&&other| move_alike(mesh, vertex as usize, other as usize));
        place.push(same.copied().unwrap_or(vertex));
        if same.is_none() {
            here.push(vertex);
        }
    }
    place
}

/// New vertex → the first that is the same mix of the same places, and lies no farther from it than
/// `near_m` where `moved` says how far each lies from its mix.
pub(super) fn firsts(places: &[u32], mixes: &[Mix], moved: &[Vec3], near_m: f32) -> Vec<usize> {
    let mut found: HashMap<Vec<(u32, u32)>, Vec<usize>> = HashMap::new();
    let is_near = |a: usize, b: usize| {
        moved.get(a).zip(moved.get(b)).is_none_or(|(a, b)| (*a - *b).length() <= near_m)
    };
    let mut first = Vec::with_capacity(mixes.len());
    for (index, mix) in mixes.iter().enumerate() {
        let parts = mix.parts().map(|(vertex, weight)| (places[vertex], weight.to_bits()));
        let mut parts: Vec<(u32, u32)> = parts.collect();
        parts.sort_unstable();
        let here = found.entry(parts).or_default();
        let same = here.iter().copied().find(|&other| is_near(index, other));
        first.push(same.unwrap_or(index));
        if same.is_none() {
            here.push(index);
        }
    }
    first
}

/// Whether two vertices at one place of a mesh stay together in every pose.
pub(super) fn move_alike(mesh: &Mesh, a: usize, b: usize) -> bool {
    let same_delta = |morph: &MorphTarget| {
        let [a, b] = [a, b].map(|vertex| {
            let at = morph.vertices.binary_search(&(vertex as u32)).ok();
            at.map_or(Vec3::ZERO, |at| morph.position_deltas[at])
        });
        a == b
    };
    let [one, other] = [a, b].map(|vertex| mesh.influences_of(vertex));
    let weight_in = |all: &[Influence], deformer| {
        let own = all.iter().filter(|one| one.deformer == deformer);
        own.map(|one| one.weight).sum::<f32>()
    };
    let same_weights = one.iter().chain(other).all(|influence| {
        let [a, b] = [one, other].map(|all| weight_in(all, influence.deformer));
        (a - b).abs() < SAME_WEIGHT
    });
    same_weights && mesh.morphs.iter().all(same_delta)
}
