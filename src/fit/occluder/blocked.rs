//! What the occluders block at a chunk of points in a pose, in the frame of the fit: for each group of
//! them, or summed by weights.

use glam::{Mat3, Vec3};

use super::explained::{Chunk, Explained, Placed};
use crate::fit::geometry::Moved;
use crate::model::occluder::add;
use crate::model::occluder::caps::{LANES, Lanes, View as Caps, rotate};
use crate::model::occluder::sky::{Ellipsoid, SeenThrough, Sky, View};
use crate::num::cpu::Isa;
use crate::num::kernels::{Task, perform};

/// Whom it concerns.
pub(super) struct Seen<'a> {
    pub(super) moved: &'a Moved,
    pub(super) pose: usize,
    pub(super) chunk: &'a Chunk,
    /// Of `moved`, in each pose.
    pub(super) points: usize,
}

/// What comes out.
pub(super) enum Weighing<'a> {
    /// `[group, coefficient]`, each group by itself.
    Groups,
    /// `[coefficient]`, with these weights, `[group]`.
    Sum(&'a [Lanes]),
}

/// What is kept from one chunk and pose to the next.
#[derive(Default)]
pub(super) struct Work {
    view: Option<View>,
    through: SeenThrough,
    /// `[group, direction]`, all 0 in between.
    taken: Vec<Lanes>,
    /// `[group, bundle]`: where `taken` may not be 0.
    touched: Vec<bool>,
}

impl Work {
    /// For so many groups, 1 where they are summed.
    pub(super) fn new(placed: &Placed, groups: usize) -> Self {
        let sky = placed.sky.as_deref();
        Self {
            view: sky.map(Sky::view),
            through: SeenThrough::default(),
            taken: vec![[0.0; LANES]; sky.map_or(0, |sky| groups * sky.directions())],
            touched: vec![false; sky.map_or(0, |sky| groups * sky.bundles())],
        }
    }
}

impl Explained<'_> {
    /// Adds what is blocked to `out`.
    pub(super) fn blocked(
        &self,
        placed: &Placed,
        seen: &Seen<'_>,
        weighing: &Weighing<'_>,
        work: &mut Work,
        out: &mut [Lanes],
    ) {
        let Seen { moved, pose, chunk, points } = *seen;
        let turn = Mat3::from_quat(self.turn(pose, chunk.bone)).transpose();
        let by_axis = |vectors: &[Vec3]| {
            let vectors = &vectors[pose * points..(pose + 1) * points];
            let mut axes = [[0.0; LANES]; 3];
            for (lane, &point) in chunk.points.iter().enumerate() {
                let vector = vectors[point];
                (axes[0][lane], axes[1][lane], axes[2][lane]) = (vector.x, vector.y, vector.z);
            }
            rotate(&turn, &axes)
        };
        let (position, normal) = (by_axis(&moved.positions), by_axis(&moved.normals));
        let spheres = placed.occluders.spheres();
        let groups = &placed.occluders.group_of[chunk.bone * spheres..(chunk.bone + 1) * spheres];
        let look = Look { position, normal, turn, groups, weighing };
        match placed.sky.as_deref() {
            None => self.sum(placed, pose, &look, out),
            Some(sky) => {
                let all = &placed.ellipsoids[pose * groups.len()..(pose + 1) * groups.len()];
                perform(Isa::best(), Unite { sky, all, look, work, out });
            }
        }
    }

    fn sum(&self, placed: &Placed, pose: usize, look: &Look<'_>, out: &mut [Lanes]) {
        let Look { position, normal, turn, groups, weighing } = look;
        let count = self.kind.0.coefficients(self.kind.1);
        let centres = &placed.centres[pose * groups.len()..(pose + 1) * groups.len()];
        for ((&centre, &radius), &group) in centres.iter().zip(&placed.occluders.radii).zip(*groups)
        {
            let centre = (*turn * centre).to_array();
            let Some(view) = Caps::new(position, normal, centre, radius) else { continue };
            let group = usize::from(group);
            match weighing {
                Weighing::Sum(gains) => add(&view, self.kind, &gains[group], out),
                Weighing::Groups => {
                    let own = &mut out[group * count..(group + 1) * count];
                    add(&view, self.kind, &[1.0; LANES], own);
                }
            }
        }
    }
}

/// A chunk of points in a pose, in the frame of the fit.
struct Look<'a> {
    position: [Lanes; 3],
    normal: [Lanes; 3],
    /// Into that frame.
    turn: Mat3,
    /// `[occluder]`
    groups: &'a [u8],
    weighing: &'a Weighing<'a>,
}

/// What the union of ellipsoids blocks.
struct Unite<'a> {
    sky: &'a Sky,
    all: &'a [Ellipsoid],
    look: Look<'a>,
    work: &'a mut Work,
    out: &'a mut [Lanes],
}

impl Task for Unite<'_> {
    type Output = ();

    #[inline(always)]
    fn perform(self) {
        let Self { sky, all, look, work, out } = self;
        let Look { position, normal, turn, groups, weighing } = &look;
        let Work { view: Some(view), through, taken, touched } = work else { return };
        sky.look(normal, view);
        let (directions, bundles) = (sky.directions(), sky.bundles());
        for (ellipsoid, &group) in all.iter().zip(*groups) {
            let own = ellipsoid.turned(turn);
            if !rises(&own.centre, own.radius, position, normal) {
                continue;
            }
            let group = usize::from(group);
            let (group, gain) = match weighing {
                Weighing::Sum(gains) => (0, &gains[group]),
                Weighing::Groups => (group, &[1.0; LANES]),
            };
            sky.see_through(&own, through);
            let taken = &mut taken[group * directions..(group + 1) * directions];
            let touched = &mut touched[group * bundles..(group + 1) * bundles];
            sky.block((position, normal), through, gain, view, (taken, touched));
        }
        let count = sky.coefficients();
        for (at, touched) in touched.iter_mut().enumerate().filter(|(_, touched)| **touched) {
            let (group, bundle) = (at / bundles, at % bundles);
            let own = &mut out[group * count..(group + 1) * count];
            let taken = &mut taken[group * directions..(group + 1) * directions];
            sky.add(view, bundle, taken, own);
            taken[bundle * LANES..(bundle + 1) * LANES].fill([0.0; LANES]);
            *touched = false;
        }
    }
}

/// Whether a ball stands above the horizon of any of the points.
#[inline(always)]
fn rises(centre: &Vec3, radius: f32, position: &[Lanes; 3], normal: &[Lanes; 3]) -> bool {
    let mut most = f32::NEG_INFINITY;
    for i in 0..LANES {
        let along = (centre.x - position[0][i]) * normal[0][i]
            + (centre.y - position[1][i]) * normal[1][i]
            + (centre.z - position[2][i]) * normal[2][i];
        most = if along > most { along } else { most };
    }
    most > -radius
}
