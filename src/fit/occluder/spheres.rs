//! Spheres cut from the rest mesh: points whose largest inscribed balls lie together make one.
//!
//! The ball that touches the surface at a point from inside and meets it nowhere else ([`Cloud::ball`])
//! has its centre deep within a limb, the same for all points around it. So clusters of these centres, bone by bone, are cross-sections of
//! limbs and parts of a trunk rather than patches of skin, and fill the body from inside.

use glam::{Mat3, Vec3};

use super::balls::Cloud;
use crate::fit::Error;
use crate::fit::geometry::Geometry;
use crate::model::occluder::ANCHORS;
use crate::num::linalg::{Mat, symmetric_eigen};
use crate::rig::Deformed;

/// Points that are looked at, at most: the search for balls is quadratic in them.
const CLOUD: usize = 16_000;
/// What a unit of normal counts beside lengths when clusters are cut, over the same diagonal:
/// enough to part front and back of a flat trunk, too little to part the sides of a limb.
const NORMAL_LENGTH: f32 = 0.025;
/// Spheres are this much larger than the mean of their balls, to close the gaps between them.
const INFLATION: f32 = 1.2;
/// Half the length of an ellipsoid's axis beyond its balls' mean radius, in standard deviations of
/// their centres along it: short of √3, which would be that of a rod, since its ends are round.
const ELONGATION: f32 = 1.2;
/// Smallest radius of an ellipsoid, over the same diagonal.
const THINNEST: f32 = 0.004;

/// Spheres at rest.
#[derive(Debug, Clone, Default)]
pub(in crate::fit) struct Spheres {
    /// `[sphere, ANCHORS]`, points.
    pub(in crate::fit) anchors: Vec<u32>,
    /// From the anchors' mean to the centre, metres.
    pub(in crate::fit) offsets: Vec<Vec3>,
    /// Metres.
    pub(in crate::fit) radii: Vec<f32>,
    /// As [`crate::model::Occluders::shapes`]; empty where spheres were asked for.
    pub(super) shapes: Vec<f32>,
}

/// What is cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::fit) enum Proxy {
    /// Of the balls' mean radius, a little larger.
    Sphere,
    /// Of the balls' mean radius and, along each axis, as long as their centres are spread: limbs are
    /// rods, capes and blades are discs.
    Ellipsoid,
}

/// A point that is looked at.
#[derive(Debug, Clone, Copy)]
struct Sample {
    point: u32,
    /// The same among those that may carry spheres; [`NO_CARRIER`] of the others.
    carrier: u32,
    bone: u16,
    position: Vec3,
    /// Unit, times [`NORMAL_LENGTH`].
    normal: Vec3,
    area: f32,
    ball_centre: Vec3,
    ball_radius: f32,
}

/// What carries nothing.
const NO_CARRIER: u32 = u32::MAX;

/// The balls inscribed at the points of a mesh at rest, of which spheres are cut.
#[derive(Debug)]
pub struct Inscribed {
    samples: Vec<Sample>,
    diagonal: f32,
}

impl Inscribed {
    pub(in crate::fit) fn new(geometry: &Geometry<'_>) -> Self {
        Self::looked_at(geometry, CLOUD, &[])
    }

    /// By a number of points that are looked at.
    pub(in crate::fit) fn among(geometry: &Geometry<'_>, cloud: usize) -> Self {
        Self::looked_at(geometry, cloud, &[])
    }

    fn looked_at(geometry: &Geometry<'_>, cloud: usize, also: &[u32]) -> Self {
        let rest = geometry.rest();
        let areas = geometry.areas(&rest.positions);
        let diagonal = diagonal(&rest.positions);
        Self { samples: samples(geometry, &rest, (&areas, diagonal), (cloud, also)), diagonal }
    }

    /// Of a whole mesh, for fits to some of its points, ascending, by whose numbers spheres are carried: as the whole
    /// would have them.
    #[must_use]
    pub fn of_whole(geometry: &Geometry<'_>, some: &[u32]) -> Self {
        let mut all = Self::looked_at(geometry, CLOUD, some);
        let place = |point: u32| some.binary_search(&point).map_or(NO_CARRIER, |at| at as u32);
        all.samples.iter_mut().for_each(|sample| sample.carrier = place(sample.point));
        all
    }

    /// Members that may carry a cluster; one near it where it has none.
    fn carriers(&self, cluster: &[Sample]) -> Vec<Sample> {
        let carries = |sample: &&Sample| sample.carrier != NO_CARRIER;
        let own: Vec<Sample> = cluster.iter().filter(carries).copied().collect();
        if !own.is_empty() {
            return own;
        }
        let bone = cluster.first().map(|sample| sample.bone);
        let mean = mean_of(cluster, |sample| sample.position);
        let far = |sample: &Sample| {
            (Some(sample.bone) != bone, sample.position.distance_squared(mean).to_bits())
        };
        let all = self.samples.iter().filter(carries);
        all.min_by_key(|sample| far(sample)).copied().into_iter().collect()
    }
}

/// Cuts `count` spheres, or as many as the mesh allows; at least one for every bone.
pub(in crate::fit) fn cut(
    inscribed: &Inscribed,
    count: usize,
    proxy: Proxy,
) -> Result<Spheres, Error> {
    let diagonal = inscribed.diagonal;
    let mut spheres = Spheres::default();
    for cluster in clusters(&inscribed.samples, count)? {
        let area: f32 = cluster.iter().map(|s| s.area).sum();
        let centre = mean_of(&cluster, |s| s.ball_centre);
        let radius = cluster.iter().map(|s| s.area * s.ball_radius).sum::<f32>() / area;
        let anchors = spread(&inscribed.carriers(&cluster));
        // From one of them: far from the origin sums of places round by more than a limb is wide.
        let first = anchors[0].position;
        let carried: Vec3 =
            anchors.iter().map(|s| s.position - first).sum::<Vec3>() / ANCHORS as f32;
        spheres.anchors.extend(anchors.iter().map(|s| s.carrier));
        spheres.offsets.push((centre - first) - carried);
        if proxy == Proxy::Sphere {
            spheres.radii.push(INFLATION * radius);
            continue;
        }
        let (axes, spread) = spread_of(&cluster, |s| s.ball_centre, centre)?;
        let axis = |variance: f64| {
            let length = radius + ELONGATION * variance.max(0.0).sqrt() as f32;
            length.max(THINNEST * diagonal)
        };
        let lengths = Vec3::from_array(spread.map(axis));
        let shape = axes * Mat3::from_diagonal(lengths.recip()) * axes.transpose();
        let [x, y, z] = [shape.x_axis, shape.y_axis, shape.z_axis];
        spheres.shapes.extend([x.x, y.y, z.z, z.y, z.x, y.x]);
        spheres.radii.push(lengths.max_element());
    }
    Ok(spheres)
}

/// The mean of a value of a cluster's members, by area.
fn mean_of(cluster: &[Sample], value: impl Fn(&Sample) -> Vec3) -> Vec3 {
    let Some(first) = cluster.first().map(&value) else { return Vec3::ZERO };
    let area: f32 = cluster.iter().map(|s| s.area).sum();
    first + cluster.iter().map(|s| s.area * (value(s) - first)).sum::<Vec3>() / area
}

/// Principal axes and variances of a value of a cluster's members, by area; the axes are orthonormal,
/// whichever way they turn.
fn spread_of(
    cluster: &[Sample],
    value: impl Fn(&Sample) -> Vec3,
    mean: Vec3,
) -> Result<(Mat3, [f64; 3]), Error> {
    let area: f32 = cluster.iter().map(|s| s.area).sum();
    let mut covariance = Mat::<f64>::zeros(3, 3);
    for sample in cluster {
        let offset = (value(sample) - mean).as_dvec3();
        for i in 0..3 {
            for j in 0..3 {
                covariance[(i, j)] += f64::from(sample.area / area) * offset[i] * offset[j];
            }
        }
    }
    let (values, vectors) = symmetric_eigen(covariance.as_ref())?;
    let axis = |k: usize| Vec3::from_array(std::array::from_fn(|i| vectors[(i, k)] as f32));
    Ok((Mat3::from_cols(axis(0), axis(1), axis(2)), [values[0], values[1], values[2]]))
}

fn diagonal(positions: &[Vec3]) -> f32 {
    let first = positions.first().copied().unwrap_or_default();
    let (low, high) =
        positions.iter().fold((first, first), |(low, high), &p| (low.min(p), high.max(p)));
    (high - low).length().max(f32::MIN_POSITIVE)
}

fn samples(
    geometry: &Geometry<'_>,
    rest: &Deformed,
    (areas, diagonal): (&[f32], f32),
    (cloud, also): (usize, &[u32]),
) -> Vec<Sample> {
    let stride = rest.positions.len().div_ceil(cloud).max(1);
    let cloud: Vec<Vec3> = rest.positions.iter().copied().step_by(stride).collect();
    let cloud = Cloud::new(&cloud, diagonal);
    // A point without triangles still counts a little, so that no sum of areas is 0.
    let least = areas.iter().sum::<f32>().max(f32::MIN_POSITIVE) * 1e-6 / areas.len() as f32;
    let sample = |point: usize| {
        let (position, normal) = (rest.positions[point], rest.normals[point]);
        let ball_radius = cloud.ball(position, normal);
        Sample {
            point: point as u32,
            carrier: point as u32,
            bone: geometry.bones.of_point[point],
            position,
            normal: normal * (NORMAL_LENGTH * diagonal),
            area: areas[point].max(least),
            ball_centre: position - ball_radius * normal,
            ball_radius,
        }
    };
    use rayon::prelude::*;
    let strided = (0..rest.positions.len()).step_by(stride);
    let mut points: Vec<usize> = strided.chain(also.iter().map(|&point| point as usize)).collect();
    points.sort_unstable();
    points.dedup();
    points.into_par_iter().map(sample).collect()
}

/// A cluster with the way in which it would be split.
struct Cluster {
    members: Vec<Sample>,
    /// Of the balls' centres or of the normals, whichever vary more along their longest axis.
    value: fn(&Sample) -> Vec3,
    mean: Vec3,
    axis: Vec3,
    /// Variance along the axis times the root of the area: what splitting it would gain.
    urgency: f64,
}

impl Cluster {
    fn new(members: Vec<Sample>) -> Result<Self, Error> {
        let area: f32 = members.iter().map(|s| s.area).sum();
        let mut best = Self {
            members: Vec::new(),
            value: |s| s.ball_centre,
            mean: Vec3::ZERO,
            axis: Vec3::X,
            urgency: 0.0,
        };
        let values: [fn(&Sample) -> Vec3; 2] = [|s| s.ball_centre, |s| s.normal];
        for value in values.into_iter().take(if members.len() > 1 { 2 } else { 0 }) {
            let mean = mean_of(&members, value);
            let (axes, values) = spread_of(&members, value, mean)?;
            let urgency = values[0] * f64::from(area).sqrt();
            if urgency > best.urgency {
                best = Self { value, mean, axis: axes.x_axis, urgency, ..best };
            }
        }
        Ok(Self { members, ..best })
    }

    fn split(self) -> [Vec<Sample>; 2] {
        let Self { members, value, mean, axis, .. } = self;
        let (a, b) = members.into_iter().partition(|s| (value(s) - mean).dot(axis) > 0.0);
        [a, b]
    }
}

/// Splits the clusters of the bones, always the most urgent one, across its longest axis.
fn clusters(samples: &[Sample], count: usize) -> Result<Vec<Vec<Sample>>, Error> {
    let mut samples = samples.to_vec();
    samples.sort_by_key(|s| (s.bone, s.point));
    let of_bones = samples.chunk_by(|a, b| a.bone == b.bone).map(|s| Cluster::new(s.to_vec()));
    let mut clusters = of_bones.collect::<Result<Vec<_>, _>>()?;
    while clusters.len() < count {
        let urgency = |i: &usize| clusters[*i].urgency;
        // The first of equals, so that the order of clusters decides nothing by chance.
        let most = (0..clusters.len()).rev().max_by(|i, j| urgency(i).total_cmp(&urgency(j)));
        let Some(most) = most.filter(|i| urgency(i) > 0.0) else { break };
        let [a, b] = clusters.swap_remove(most).split();
        // Members that round-off keeps on one side of their mean are not split again.
        let is_split = !a.is_empty() && !b.is_empty();
        for part in [a, b] {
            if !part.is_empty() {
                let mut cluster = Cluster::new(part)?;
                cluster.urgency = if is_split { cluster.urgency } else { 0.0 };
                clusters.push(cluster);
            }
        }
    }
    Ok(clusters.into_iter().map(|cluster| cluster.members).collect())
}

/// [`ANCHORS`] members, each the farthest from those before; again from the start where there are
/// fewer. The first is the one farthest from the mean.
fn spread(cluster: &[Sample]) -> Vec<Sample> {
    let mean: Vec3 = cluster.iter().map(|s| s.position).sum::<Vec3>() / cluster.len() as f32;
    let mut distance: Vec<f32> =
        cluster.iter().map(|s| s.position.distance_squared(mean)).collect();
    let mut chosen: Vec<Sample> = Vec::with_capacity(ANCHORS);
    while chosen.len() < ANCHORS.min(cluster.len()) {
        let farthest =
            (0..cluster.len()).rev().max_by(|&i, &j| distance[i].total_cmp(&distance[j]));
        let next = cluster[farthest.unwrap_or(0)];
        if chosen.is_empty() {
            distance.fill(f32::INFINITY);
        }
        for (distance, sample) in distance.iter_mut().zip(cluster) {
            *distance = distance.min(sample.position.distance_squared(next.position));
        }
        chosen.push(next);
    }
    let fewer = chosen.len();
    (0..ANCHORS).map(|i| chosen[i % fewer]).collect()
}
