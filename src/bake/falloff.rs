//! Ambient occlusion that fades with the distance of what blocks.

use crate::num::directions::Set;
use crate::trace::{Hit, Rays};

use super::ground;
use super::posed::Posed;

/// The blocked share of each half of the set and the sum of squared steps from ray to ray, where a hit at the distance d of at most `far`
/// counts (1 − d/far)^falloff.
pub(super) fn shares(
    posed: &Posed,
    point: usize,
    rays: &Rays<'_>,
    set: &Set<'_>,
    falloff: f32,
) -> ([f64; 2], f32) {
    let mut hits: Vec<Option<Hit>> = vec![None; rays.len()];
    posed.scene(point).nearest(rays, &mut hits);
    let height = posed.heights.as_ref().map(|heights| heights[point]);
    let (mut sums, mut crossed, mut before) = ([0.0; 2], 0.0, None);
    for (lane, (hit, &y)) in hits.iter().zip(rays.y).enumerate() {
        let surface = hit.map_or(f32::INFINITY, |hit| hit.distance);
        let floor = height.map_or(f32::INFINITY, |h| ground::distance(y, h, rays.near));
        let distance = surface.min(floor);
        let within = distance <= rays.far.min(f32::MAX);
        let share = if within { (1.0 - distance / rays.far).powf(falloff) } else { 0.0 };
        let second = set.second_half[lane / 64] >> (lane % 64) & 1;
        sums[second as usize] += f64::from(share);
        crossed += before.map_or(0.0, |before: f32| (share - before).powi(2));
        before = Some(share);
    }
    (sums.map(|sum| sum / (rays.len() / 2) as f64), crossed)
}
