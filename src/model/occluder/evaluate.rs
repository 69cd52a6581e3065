//! What all occluders block at all points of a pose.

use glam::Vec3;

use super::caps::{LANES, Lanes, View};
use super::{Occluders, Surface};
use crate::model::Signal;
use crate::num::cpu::Isa;
use crate::num::kernels::run;
use crate::sh::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate_lanes};

/// Points of one bone that are looked at together, and their weights.
#[derive(Debug, Clone)]
struct Chunk {
    bone: u16,
    /// The last one repeats where there are fewer.
    points: [u32; LANES],
    count: usize,
    /// `[group]`.
    weights: Vec<Lanes>,
}

/// Occluders laid out for evaluation.
#[derive(Debug, Clone)]
pub(in crate::model) struct Seen {
    chunks: Vec<Chunk>,
}

impl Seen {
    pub(in crate::model) fn new(occluders: &Occluders, bone_of_point: &[u16]) -> Self {
        let groups = occluders.groups(bone_of_point.len());
        let mut order: Vec<u32> = (0..bone_of_point.len() as u32).collect();
        order.sort_by_key(|&point| bone_of_point[point as usize]);
        let same = |&a: &u32, &b: &u32| bone_of_point[a as usize] == bone_of_point[b as usize];
        let chunks = order.chunk_by(same).flat_map(|of_bone| of_bone.chunks(LANES)).map(|some| {
            let point = |lane: usize| some[lane.min(some.len() - 1)];
            let weight = |lane, group| occluders.weights[point(lane) as usize * groups + group];
            Chunk {
                bone: bone_of_point[some[0] as usize],
                points: std::array::from_fn(point),
                count: some.len(),
                weights: (0..groups)
                    .map(|group| std::array::from_fn(|lane| weight(lane, group)))
                    .collect(),
            }
        });
        Self { chunks: chunks.collect() }
    }

    /// Subtracts what the spheres at `centres` block from `out` `[point, channel, coefficient]`,
    /// root frame.
    pub(in crate::model) fn subtract(
        &self,
        occluders: &Occluders,
        centres: &[Vec3],
        surface: Surface<'_>,
        kind: (Signal, Order),
        out: &mut [f32],
    ) {
        let isa = Isa::best();
        for chunk in &self.chunks {
            let first = usize::from(chunk.bone) * centres.len();
            let groups = &occluders.group_of[first..first + centres.len()];
            let spheres = Spheres { centres, radii: &occluders.radii, groups };
            run(isa, || subtract_chunk(chunk, &spheres, surface, kind, out));
        }
    }
}

/// The spheres as the points of one bone see them.
struct Spheres<'a> {
    centres: &'a [Vec3],
    radii: &'a [f32],
    groups: &'a [u8],
}

#[inline(always)]
fn subtract_chunk(
    chunk: &Chunk,
    spheres: &Spheres<'_>,
    surface: Surface<'_>,
    kind: (Signal, Order),
    out: &mut [f32],
) {
    let count = kind.0.coefficients(kind.1);
    let width = out.len() / surface.positions.len();
    let mut sums = [[0.0; LANES]; MAX_COEFFICIENTS];
    let sums = &mut sums[..count];
    let (position, normal) = gather(surface, &chunk.points);
    let all = spheres.centres.iter().zip(spheres.radii).zip(spheres.groups);
    for ((centre, &radius), &group) in all {
        if let Some(view) = View::new(&position, &normal, centre.to_array(), radius) {
            add(&view, kind, &chunk.weights[usize::from(group)], sums);
        }
    }
    for (lane, &point) in chunk.points[..chunk.count].iter().enumerate() {
        let row = &mut out[point as usize * width..][..width];
        for channel in row.chunks_exact_mut(count) {
            channel.iter_mut().zip(&*sums).for_each(|(out, sum)| *out -= sum[lane]);
        }
    }
}

/// Positions and normals of the listed points, by axis.
#[inline(always)]
fn gather(surface: Surface<'_>, points: &[u32; LANES]) -> ([Lanes; 3], [Lanes; 3]) {
    let (mut position, mut normal) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
    for (lane, &point) in points.iter().enumerate() {
        let p = surface.positions[point as usize].to_array();
        let n = surface.normals[point as usize].to_array();
        for axis in 0..3 {
            position[axis][lane] = p[axis];
            normal[axis][lane] = n[axis];
        }
    }
    (position, normal)
}

/// Adds gain · ψ to the sums, one entry per coefficient:
/// - `ao`: ψ = f, the cap's cosine-weighted share of [`View::occlusion`];
/// - `transfer`: ψ_lm = f / Ω · ∫_cap y_lm with the cap's solid angle Ω: the cosine counts by its
///   mean over the cap;
/// - `visibility`: ψ_lm = the share of the cap above the horizon · ∫_cap y_lm.
#[inline(always)]
pub fn add(view: &View, (signal, order): (Signal, Order), gain: &Lanes, sums: &mut [Lanes]) {
    let seen = match signal {
        Signal::Ao | Signal::Transfer => view.occlusion(),
        Signal::Visibility => view.above(),
    };
    if signal == Signal::Ao {
        for i in 0..LANES {
            sums[0][i] += gain[i] * seen[i];
        }
        return;
    }
    if seen.iter().all(|&x| x <= 0.0) {
        return;
    }
    let (mut bands, mut y) = ([[0.0; LANES]; MAX_BANDS], [[0.0; LANES]; MAX_COEFFICIENTS]);
    view.bands(order, &mut bands);
    evaluate_lanes(order, &view.direction, &mut y);
    let solid = bands[0];
    let factor: Lanes = std::array::from_fn(|i| match signal {
        Signal::Transfer => gain[i] * seen[i] / solid[i].max(f32::MIN_POSITIVE),
        _ => gain[i] * seen[i],
    });
    for (l, band) in bands.iter().enumerate().take(order.bands()) {
        let scale: Lanes = std::array::from_fn(|i| factor[i] * band[i]);
        for c in l * l..(l + 1) * (l + 1) {
            for i in 0..LANES {
                sums[c][i] += scale[i] * y[c][i];
            }
        }
    }
}
