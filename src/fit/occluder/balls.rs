//! Largest balls inscribed in a surface: those that touch it at a point from inside and meet it nowhere else
//! (medial balls, found by shrinking: Ma, Bae and Choi 2012).

use glam::Vec3;

use crate::num::cpu::Isa;
use crate::num::kernels::{Task, perform};

/// Largest and smallest radius of a ball, over the diagonal of the rest mesh.
const RADII: [f32; 2] = [0.001, 0.15];
/// Most rounds of shrinking a ball.
const ROUNDS: usize = 12;
/// A ball that would shrink by less than this is found.
const FOUND: f32 = 0.98;
/// Points that are looked at together.
const LANES: usize = 16;

/// The points that a ball must not hold, by axis; the lanes that are left over are infinitely far.
#[derive(Debug)]
pub(super) struct Cloud {
    blocks: Vec<[[f32; LANES]; 3]>,
    radii: [f32; 2],
}

impl Cloud {
    pub(super) fn new(points: &[Vec3], diagonal: f32) -> Self {
        let block = |some: &[Vec3]| {
            let lane = |axis: usize| {
                std::array::from_fn(|i| some.get(i).map_or(f32::INFINITY, |point| point[axis]))
            };
            [lane(0), lane(1), lane(2)]
        };
        Self {
            blocks: points.chunks(LANES).map(block).collect(),
            radii: RADII.map(|share| share * diagonal),
        }
    }

    /// Radius of the ball that touches the surface at `position` and holds no point of the cloud, metres.
    pub(super) fn ball(&self, position: Vec3, normal: Vec3) -> f32 {
        let [least, most] = self.radii;
        let mut radius = most;
        for _ in 0..ROUNDS {
            let centre = position - radius * normal;
            // Points at one place with this one touch the ball without being in its way.
            let apart = (0.5 * least).powi(2);
            let nearest = perform(Isa::best(), Nearest { cloud: self, centre, position, apart });
            let Some(q) = nearest else { break };
            let towards = position - q;
            let along = 2.0 * normal.dot(towards);
            if q.distance(centre) >= FOUND * radius || along <= 0.0 {
                break;
            }
            let touching = (towards.length_squared() / along).max(least);
            if touching >= radius {
                break;
            }
            radius = touching;
        }
        radius
    }
}

/// The point of a cloud nearest to `centre`, the first of several, of those whose square distance from
/// `position` is more than `apart`.
struct Nearest<'a> {
    cloud: &'a Cloud,
    centre: Vec3,
    position: Vec3,
    apart: f32,
}

impl Task for Nearest<'_> {
    type Output = Option<Vec3>;

    #[inline(always)]
    fn perform(self) -> Option<Vec3> {
        let Self { cloud, centre, position, apart } = self;
        let (mut least, mut at) = ([f32::INFINITY; LANES], [0_u32; LANES]);
        for (index, block) in cloud.blocks.iter().enumerate() {
            for lane in 0..LANES {
                let own = square(block, lane, position);
                let square = square(block, lane, centre);
                let nearer = own > apart && square < least[lane];
                least[lane] = if nearer { square } else { least[lane] };
                at[lane] = if nearer { index as u32 } else { at[lane] };
            }
        }
        let order = |&a: &usize, &b: &usize| {
            least[a].total_cmp(&least[b]).then((at[a], a).cmp(&(at[b], b)))
        };
        let lane = (0..LANES).filter(|&lane| least[lane] < f32::INFINITY).min_by(order)?;
        let block = &cloud.blocks[at[lane] as usize];
        Some(Vec3::new(block[0][lane], block[1][lane], block[2][lane]))
    }
}

#[inline(always)]
fn square(block: &[[f32; LANES]; 3], lane: usize, from: Vec3) -> f32 {
    let (x, y, z) = (block[0][lane] - from.x, block[1][lane] - from.y, block[2][lane] - from.z);
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::random::Stream;

    /// Points on an ellipsoid of half axes 1, 0.5 and 0.25, with their normals.
    fn ellipsoid(count: usize) -> Vec<(Vec3, Vec3)> {
        let mut stream = Stream::new(8);
        let axes = Vec3::new(1.0, 0.5, 0.25);
        let point = |_| {
            let v = Vec3::from_array(std::array::from_fn(|_| stream.normal() as f32)).normalize();
            (v * axes, (v / axes).normalize())
        };
        (0..count).map(point).collect()
    }

    /// Proves that a ball holds no point deeper than a ball that is found may, that one of the points (or the
    /// largest radius) is what stops it, and that neither the cloud's order nor its last, half empty block matters.
    #[test]
    fn balls_are_empty_and_as_large_as_can_be() {
        for count in [1, 15, 16, 17, 400] {
            let surface = ellipsoid(count);
            let points: Vec<Vec3> = surface.iter().map(|(p, _)| *p).collect();
            let cloud = Cloud::new(&points, 3.0);
            let reversed: Vec<Vec3> = points.iter().rev().copied().collect();
            let reversed = Cloud::new(&reversed, 3.0);
            let [_, most] = cloud.radii;
            for &(position, normal) in &surface {
                let radius = cloud.ball(position, normal);
                assert_eq!(radius, reversed.ball(position, normal));
                let centre = position - radius * normal;
                let others = points.iter().filter(|q| **q != position);
                let depth = |r: f32| {
                    let centre = position - r * normal;
                    others.clone().map(|q| q.distance(centre) / r).fold(f32::INFINITY, f32::min)
                };
                assert!(depth(radius) > FOUND - 1e-4, "{radius} {}", depth(radius));
                let touches =
                    others.clone().any(|q| (q.distance(centre) / radius - 1.0).abs() < 1e-3);
                assert!(touches || radius == most, "{count}: {position} {radius}");
            }
        }
    }

    /// Proves that of a ball's surface all inscribed balls are that ball, and that points at one place with
    /// the one that is looked at do not stop it.
    #[test]
    fn a_ball_is_its_own() {
        let mut stream = Stream::new(2);
        let mut points: Vec<Vec3> = (0..500)
            .map(|_| {
                Vec3::from_array(std::array::from_fn(|_| stream.normal() as f32)).normalize() * 0.1
            })
            .collect();
        points.extend(points[..50].to_vec());
        let cloud = Cloud::new(&points, 1.0);
        for point in &points[..100] {
            let radius = cloud.ball(*point, point.normalize());
            assert!((0.098..0.105).contains(&radius), "{radius}");
        }
    }
}
