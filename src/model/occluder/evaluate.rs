//! What all occluders block at all points of a pose.
//!
//! Points are looked at [`LANES`] at a time, of one bone, with normals and places that are alike in
//! some pose and so, since they move together, nearly alike in all. Spheres that are below the
//! horizon of all of them block exactly nothing: bounds on the box of the points and the box of
//! their normals find most of these without looking at a single point.

use std::sync::OnceLock;

use glam::Vec3;

use super::caps::{LANES, Lanes, View, add_occlusion};
use super::{Occluders, Surface};
use crate::model::Signal;
use crate::num::cpu::Isa;
use crate::num::kernels::run;
use crate::sh::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate_lanes};

/// Cells per axis of the box around a mesh, by which points are told near or far.
const CELLS: f32 = 16.0;

/// Points of one bone that are looked at together, and their weights.
#[derive(Debug, Clone)]
pub(super) struct Chunk {
    pub(super) bone: u16,
    /// The last one repeats where there are fewer.
    pub(super) points: [u32; LANES],
    pub(super) count: usize,
    /// `[group]`.
    pub(super) weights: Vec<Lanes>,
}

/// Occluders laid out for evaluation.
#[derive(Debug, Clone)]
pub(in crate::model) struct Seen {
    groups: usize,
    pub(super) bone_of_point: Vec<u16>,
    /// Made in the first pose that is seen: which points are together changes no result, only how
    /// many spheres can be passed over.
    chunks: OnceLock<Vec<Chunk>>,
}

impl Seen {
    pub(in crate::model) fn new(occluders: &Occluders, bone_of_point: &[u16]) -> Self {
        let groups = occluders.groups(bone_of_point.len());
        Self { groups, bone_of_point: bone_of_point.to_vec(), chunks: OnceLock::new() }
    }

    pub(super) fn chunks(&self, occluders: &Occluders, surface: Surface<'_>) -> &[Chunk] {
        self.chunks.get_or_init(|| {
            let order = order(&self.bone_of_point, surface);
            let bone = |point: u32| self.bone_of_point[point as usize];
            let of_bones = order.chunk_by(|&a, &b| bone(a) == bone(b));
            let some = of_bones.flat_map(|of_bone| of_bone.chunks(LANES));
            some.map(|some| self.chunk(occluders, some)).collect()
        })
    }

    fn chunk(&self, occluders: &Occluders, some: &[u32]) -> Chunk {
        let point = |lane: usize| some[lane.min(some.len() - 1)];
        let weight = |lane, group| occluders.weights[point(lane) as usize * self.groups + group];
        Chunk {
            bone: self.bone_of_point[some[0] as usize],
            points: std::array::from_fn(point),
            count: some.len(),
            weights: (0..self.groups)
                .map(|group| std::array::from_fn(|lane| weight(lane, group)))
                .collect(),
        }
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
        let spheres = Spheres::new(centres, &occluders.radii);
        for chunk in self.chunks(occluders, surface) {
            let first = usize::from(chunk.bone) * centres.len();
            let groups = &occluders.group_of[first..first + centres.len()];
            run(isa, || match kind.0 {
                Signal::Ao => subtract_scalar(chunk, &spheres, groups, surface, out),
                Signal::Transfer | Signal::Visibility => {
                    subtract_harmonics(chunk, &spheres, groups, surface, kind, out);
                }
            });
        }
    }
}

/// Points by bones, then by the octant and main axis of their normals, then by place.
fn order(bone_of_point: &[u16], surface: Surface<'_>) -> Vec<u32> {
    let all = surface.positions.iter();
    let low = all.clone().fold(Vec3::INFINITY, |low, &p| low.min(p));
    let high = all.fold(Vec3::NEG_INFINITY, |high, &p| high.max(p));
    let scale = (high - low).max(Vec3::splat(f32::MIN_POSITIVE)).recip() * CELLS;
    let key = |&point: &u32| {
        let point = point as usize;
        let normal = surface.normals[point];
        let side = |axis: usize| u32::from(normal[axis] > 0.0) << axis;
        let axis = normal.abs().max_position() as u32;
        let facing = (side(0) | side(1) | side(2)) * 3 + axis;
        let cell = ((surface.positions[point] - low) * scale).to_array().map(|x| x as u32);
        (bone_of_point[point], facing, interleaved(cell), point)
    };
    let mut order: Vec<u32> = (0..bone_of_point.len() as u32).collect();
    order.sort_by_cached_key(key);
    order
}

/// Morton order of cells below 32.
fn interleaved(cell: [u32; 3]) -> u32 {
    (0..5).fold(0, |code, bit| {
        let bits = (0..3).map(|axis| ((cell[axis] >> bit) & 1) << (3 * bit + axis as u32));
        code | bits.sum::<u32>()
    })
}

/// The spheres of a pose, [`LANES`] at a time.
pub(super) struct Spheres {
    /// By axis; beyond the last one with a radius of −∞, which nothing sees.
    centres: [Vec<Lanes>; 3],
    radii: Vec<Lanes>,
}

impl Spheres {
    pub(super) fn new(centres: &[Vec3], radii: &[f32]) -> Self {
        let blocks = centres.len().div_ceil(LANES);
        let lanes = |at: &dyn Fn(usize) -> Option<f32>, beyond: f32| -> Vec<Lanes> {
            let one = |i: usize| at(i).unwrap_or(beyond);
            (0..blocks).map(|b| std::array::from_fn(|lane| one(b * LANES + lane))).collect()
        };
        let axis = |axis: usize| lanes(&|i| centres.get(i).map(|centre| centre[axis]), 0.0);
        Self {
            centres: [axis(0), axis(1), axis(2)],
            radii: lanes(&|i| radii.get(i).copied(), f32::NEG_INFINITY),
        }
    }

    /// Calls `see` with every sphere of which a part may be above the horizon of a point: where
    /// the largest n·(q − x) over the boxes of n and of x exceeds −r. Ascending.
    #[inline(always)]
    pub(super) fn above(
        &self,
        position: &[Lanes; 3],
        normal: &[Lanes; 3],
        mut see: impl FnMut(usize, [f32; 3], f32),
    ) {
        let (positions, normals) = (position.map(bounds), normal.map(bounds));
        for (block, radii) in self.radii.iter().enumerate() {
            let mut most = *radii;
            for axis in 0..3 {
                let ([x0, x1], [n0, n1]) = (positions[axis], normals[axis]);
                let centre = &self.centres[axis][block];
                for i in 0..LANES {
                    let (d0, d1) = (centre[i] - x1, centre[i] - x0);
                    most[i] += larger(larger(d0 * n0, d0 * n1), larger(d1 * n0, d1 * n1));
                }
            }
            // The bound is of rounded sums; a sphere at the very horizon blocks next to nothing,
            // but what is passed over must not depend on which points are together.
            let slack = 1e-5;
            let mut mask = 0_u32;
            for i in 0..LANES {
                let scale = slack * (radii[i].abs() + self.extent(block, i));
                mask |= u32::from(most[i] > -scale) << i;
            }
            while mask != 0 {
                let i = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                let centre = [0, 1, 2].map(|axis| self.centres[axis][block][i]);
                see(block * LANES + i, centre, radii[i]);
            }
        }
    }

    #[inline(always)]
    fn extent(&self, block: usize, i: usize) -> f32 {
        (0..3).map(|axis| self.centres[axis][block][i].abs()).sum()
    }
}

/// Least and largest of the lanes.
#[inline(always)]
fn bounds(lanes: Lanes) -> [f32; 2] {
    let mut halves = (lanes, lanes);
    let mut width = LANES / 2;
    while width > 0 {
        for i in 0..width {
            halves.0[i] = smaller(halves.0[i], halves.0[i + width]);
            halves.1[i] = larger(halves.1[i], halves.1[i + width]);
        }
        width /= 2;
    }
    [halves.0[0], halves.1[0]]
}

/// As one instruction; neither is NaN.
#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn subtract_scalar(
    chunk: &Chunk,
    spheres: &Spheres,
    groups: &[u8],
    surface: Surface<'_>,
    out: &mut [f32],
) {
    let (position, normal) = gather(surface, &chunk.points);
    let mut sums = [0.0; LANES];
    spheres.above(&position, &normal, |sphere, centre, radius| {
        let gain = &chunk.weights[usize::from(groups[sphere])];
        add_occlusion(&position, &normal, (centre, radius), gain, &mut sums);
    });
    let width = out.len() / surface.positions.len();
    for (sum, &point) in sums.iter().zip(&chunk.points[..chunk.count]) {
        out[point as usize * width..][..width].iter_mut().for_each(|out| *out -= sum);
    }
}

#[inline(always)]
fn subtract_harmonics(
    chunk: &Chunk,
    spheres: &Spheres,
    groups: &[u8],
    surface: Surface<'_>,
    kind: (Signal, Order),
    out: &mut [f32],
) {
    let count = kind.0.coefficients(kind.1);
    let width = out.len() / surface.positions.len();
    let mut sums = [[0.0; LANES]; MAX_COEFFICIENTS];
    let sums = &mut sums[..count];
    let (position, normal) = gather(surface, &chunk.points);
    spheres.above(&position, &normal, |sphere, centre, radius| {
        if let Some(view) = View::new(&position, &normal, centre, radius) {
            add(&view, kind, &chunk.weights[usize::from(groups[sphere])], sums);
        }
    });
    for (lane, &point) in chunk.points[..chunk.count].iter().enumerate() {
        let row = &mut out[point as usize * width..][..width];
        for channel in row.chunks_exact_mut(count) {
            channel.iter_mut().zip(&*sums).for_each(|(out, sum)| *out -= sum[lane]);
        }
    }
}

/// Positions and normals of the listed points, by axis.
#[inline(always)]
pub(super) fn gather(surface: Surface<'_>, points: &[u32; LANES]) -> ([Lanes; 3], [Lanes; 3]) {
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
