//! What the union of all ellipsoids blocks at all points of a pose.

use glam::{Mat3, Quat, Vec3};

use super::caps::{LANES, Lanes, rotate};
use super::evaluate::{Chunk, Seen, Spheres, gather};
use super::sky::{Ellipsoid, SeenThrough, Sky, View};
use super::{Occluders, Surface};
use crate::num::cpu::Isa;
use crate::num::kernels::{Task, perform};
use crate::sh::MAX_COEFFICIENTS;

/// What is kept from one chunk of points to the next.
struct Work {
    view: View,
    /// `[direction]`: what has been taken, by weight.
    taken: Vec<Lanes>,
    /// `[bundle]`: whether anything has.
    touched: Vec<bool>,
    /// The ellipsoids that stand above the horizon.
    above: Vec<usize>,
}

impl Seen {
    /// Subtracts what the ellipsoids block from `out` `[point, channel, coefficient]`, in the frames
    /// of the points' bones, whose turns are `rotations`.
    pub(in crate::model) fn subtract_union(
        &self,
        occluders: &Occluders,
        surface: Surface<'_>,
        rotations: &[Quat],
        sky: &Sky,
        out: &mut [f32],
    ) {
        let isa = Isa::best();
        let all = occluders.ellipsoids(surface.positions, &self.bone_of_point, rotations);
        let mut work = Work {
            view: sky.view(),
            taken: vec![[0.0; LANES]; sky.directions()],
            touched: vec![false; sky.bundles()],
            above: Vec::new(),
        };
        let mut own = vec![SeenThrough::default(); all.len()];
        for chunks in self.chunks(occluders, surface).chunk_by(|a, b| a.bone == b.bone) {
            let bone = usize::from(chunks[0].bone);
            let turn = Mat3::from_quat(rotations[bone].normalize()).transpose();
            let turned: Vec<Ellipsoid> = all.iter().map(|e| e.turned(&turn)).collect();
            let centres: Vec<Vec3> = turned.iter().map(|e| e.centre).collect();
            let spheres = Spheres::new(&centres, &occluders.radii);
            let groups = &occluders.group_of[bone * all.len()..(bone + 1) * all.len()];
            let (own, work, out) = (&mut own[..], &mut work, &mut *out);
            let (turned, spheres) = (&turned, &spheres);
            perform(
                isa,
                OfBone { turn, turned, own, spheres, groups, chunks, surface, sky, work, out },
            );
        }
    }
}

/// What the points of a bone see, in its frame.
struct OfBone<'a> {
    turn: Mat3,
    turned: &'a [Ellipsoid],
    /// Made of the turned ones.
    own: &'a mut [SeenThrough],
    spheres: &'a Spheres,
    groups: &'a [u8],
    chunks: &'a [Chunk],
    surface: Surface<'a>,
    sky: &'a Sky,
    work: &'a mut Work,
    out: &'a mut [f32],
}

impl Task for OfBone<'_> {
    type Output = ();

    #[inline(always)]
    fn perform(mut self) {
        for (own, ellipsoid) in self.own.iter_mut().zip(self.turned) {
            self.sky.see_through(ellipsoid, own);
        }
        for chunk in self.chunks {
            self.subtract(chunk);
        }
    }
}

impl OfBone<'_> {
    #[inline(always)]
    fn subtract(&mut self, chunk: &Chunk) {
        let Self { surface, sky, out, .. } = self;
        let (position, normal) = gather(*surface, &chunk.points);
        let (position, normal) = (rotate(&self.turn, &position), rotate(&self.turn, &normal));
        let Work { view, taken, touched, above } = &mut *self.work;
        sky.look(&normal, view);
        taken.fill([0.0; LANES]);
        touched.fill(false);
        above.clear();
        self.spheres.above(&position, &normal, |sphere, _, _| above.push(sphere));
        for &sphere in &*above {
            let gain = &chunk.weights[usize::from(self.groups[sphere])];
            let seen = &self.own[sphere];
            sky.block((&position, &normal), seen, gain, view, (&mut *taken, &mut *touched));
        }
        let mut sums = [[0.0; LANES]; MAX_COEFFICIENTS];
        let sums = &mut sums[..sky.coefficients()];
        for (bundle, _) in touched.iter().enumerate().filter(|(_, touched)| **touched) {
            sky.add(view, bundle, taken, sums);
        }
        let width = out.len() / surface.positions.len();
        for (lane, &point) in chunk.points[..chunk.count].iter().enumerate() {
            let row = &mut out[point as usize * width..][..width];
            for channel in row.chunks_exact_mut(sums.len()) {
                channel.iter_mut().zip(&*sums).for_each(|(out, sum)| *out -= sum[lane]);
            }
        }
    }
}

#[cfg(test)]
mod tests;
