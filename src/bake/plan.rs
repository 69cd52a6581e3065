//! What is the same for every point and pose: direction sets and their spherical harmonics.

use std::f64::consts::TAU;

use crate::num::directions::{Density, Directions};
use crate::num::random::hash;
use crate::sh::{self, MAX_BANDS, Order, zonal};
use glam::Vec3;

use super::sums::{LANES, Rows};
use super::{Error, MOST_RAYS, Settings, Signal};

/// Sets in a table: enough that what all of them have in common disappears behind the noise of
/// one, few enough that their tables stay in a core's own cache.
const SETS: usize = 64;

/// The most rays in half a set, which bounds the tables; points with more rays get several sets.
const LONGEST_HALF: usize = 1024;

/// How many rays each point gets where so many are asked for: two equal halves, and above 2,048 equal
/// blocks of two.
///
/// ```
/// # use poselight::bake::rays_cast;
/// assert_eq!([1, 17, 500, 2049].map(rays_cast), [2, 18, 500, 2052]);
/// ```
#[must_use]
pub fn rays_cast(asked: u32) -> u32 {
    let (blocks, half) = halves(asked);
    (2 * blocks * half) as u32
}

/// Blocks, and rays in half of each.
fn halves(rays: u32) -> (usize, usize) {
    let blocks = (rays as usize).div_ceil(2 * LONGEST_HALF);
    (blocks, (rays as usize).div_ceil((2 * blocks).max(1)))
}

/// Tells the seed of the tables from the seeds of points.
const TABLE_KEY: u64 = 0x7461_626c_6573;

/// Checked settings with their tables.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) signal: Signal,
    pub(super) order: Order,
    /// Numbers per point.
    pub(super) coefficients: usize,
    /// Sets of directions traced per point; each brings two independent batches.
    pub(super) blocks: usize,
    /// Metres; infinite where there is no limit.
    pub(super) max_distance_m: f32,
    /// Exponent of ambient occlusion's fall-off.
    pub(super) falloff: Option<f32>,
    pub(super) seed: u64,
    pub(super) directions: Directions,
    /// Per set, the rows yᵢ(ω) of its directions in the set's frame, scaled so that the sum over
    /// the blocked ones of a half estimates what they take away. Empty for ambient occlusion.
    pub(super) rows: Vec<Rows>,
    /// Zonal coefficients of unoccluded transfer about the normal.
    pub(super) unshadowed: [f32; MAX_BANDS],
}

impl Plan {
    pub(super) fn new(settings: &Settings) -> Result<Self, Error> {
        let Settings { signal, order, rays, max_distance_m, seed } = *settings;
        if rays == 0 || rays > MOST_RAYS {
            return Err(Error::Rays { found: rays });
        }
        if let Some(found) = max_distance_m
            && (found.is_nan() || found <= 0.0)
        {
            return Err(Error::MaxDistance { found });
        }
        let (blocks, half) = halves(rays);
        let density = match signal {
            Signal::Ao | Signal::Transfer => Density::Cosine,
            Signal::Visibility => Density::Uniform,
        };
        let directions = Directions::new(density, SETS, half, hash(&[seed, TABLE_KEY]));
        let coefficients = signal.coefficients(order);
        let rows = match signal {
            Signal::Ao => Vec::new(),
            // Of the integrand over the density: (cos/π) / (cos/π), and 1 / (1/2π).
            Signal::Transfer => all_rows(order, &directions, 1.0 / half as f64),
            Signal::Visibility => all_rows(order, &directions, TAU / half as f64),
        };
        Ok(Self {
            signal,
            order,
            coefficients,
            blocks,
            max_distance_m: max_distance_m.unwrap_or(f32::INFINITY),
            falloff: None,
            seed,
            directions,
            rows,
            unshadowed: zonal::unshadowed(order),
        })
    }

    /// Writes the signal of a point that nothing blocks.
    pub(super) fn unoccluded(&self, normal: Vec3, out: &mut [f32]) {
        match self.signal {
            Signal::Ao => out[0] = 1.0,
            Signal::Visibility => {
                out.fill(0.0);
                out[0] = (2.0 * TAU).sqrt() as f32;
            }
            Signal::Transfer => zonal::rotate(self.order, &self.unshadowed, normal, out),
        }
    }

    /// Rays per point.
    pub(super) fn rays(&self) -> usize {
        self.blocks * self.directions.directions()
    }

    /// Of all tables.
    pub(super) fn memory_bytes(&self) -> u64 {
        let floats = 3 * self.directions.sets() * self.directions.directions();
        let rows: usize = self.rows.iter().map(Rows::len).sum();
        4 * (floats + rows) as u64
    }
}

fn all_rows(order: Order, directions: &Directions, scale: f64) -> Vec<Rows> {
    let count = order.coefficients();
    let mut row = vec![0.0; count.next_multiple_of(LANES)];
    let mut of_set = |index| {
        let set = directions.set(index);
        let mut rows = Rows::new(row.len());
        for ((&x, &y), &z) in set.x.iter().zip(set.y).zip(set.z) {
            let mut exact = [0.0; sh::MAX_COEFFICIENTS];
            sh::evaluate_f64(order, [x, y, z].map(f64::from), &mut exact);
            for (out, value) in row[..count].iter_mut().zip(exact) {
                *out = (value * scale) as f32;
            }
            rows.push(&row);
        }
        rows
    };
    (0..directions.sets()).map(&mut of_set).collect()
}
