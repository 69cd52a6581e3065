//! Transfer diffused over a posed surface (Nowrouzezahrai 2007, CSRG-560, figure 8):
//! t'(x) = Σ_q w(x, q) t(q), w = R_d(|x − q|) A_q over the integral of R_d over an infinite plane, q the
//! points with the areas of their surroundings.
//!
//! Far points are taken together: a tree holds for every node its area, where it lies, how it
//! spreads, and its mean transfer, and a node that is small beside its distance stands for all its
//! points (Jensen and Buhler 2002). Close ones stand for disks, over which the kernel is integrated, however much
//! narrower it is; points at one place, as along seams, share the disk of all their area. So coarse meshes keep
//! their total.
//!
//! Distances are straight: the far side of what is thinner than a mean free path shines through, as
//! ears do, and so does a surface that merely comes close. The sum of the weights of a point is near
//! 1 on flat ground and may lie above and below elsewhere.

use std::f64::consts::PI;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::posed::Stage;
use super::subsurface::{Dipole, Subsurface};
use super::surroundings::NO_POINT;
use super::{BakedPose, Error};

/// Points of a leaf.
const LEAF: usize = 8;

/// A node stands for its points where its radius is below this share of its distance.
const OPENING: f64 = 0.15;

/// A point stands for a disk where it is nearer than this many of the disk's radii.
const NEAR_RADII: f64 = 5.0;

/// Directions from a place along which the kernel over a disk is summed.
const SECTORS: usize = 8;

/// A node is left out where all its area at its nearest place would weigh less.
const NEGLIGIBLE: f64 = 1e-6;

/// Points per task.
const POINTS_PER_TASK: usize = 64;

/// Points with the areas that they stand for.
pub(super) struct Cloud {
    /// Metres.
    pub(super) places: Vec<DVec3>,
    /// Unit.
    pub(super) normals: Vec<DVec3>,
    /// Square metres.
    pub(super) areas: Vec<f64>,
    /// Square metres of all points at the same place.
    pub(super) shared: Vec<f64>,
}

/// A run of points, nearest to one another.
struct Node {
    /// Into `order`.
    range: std::ops::Range<usize>,
    /// The second child; the first follows its parent. 0 for a leaf.
    second: usize,
    centre: DVec3,
    /// Of the sphere about the centre that holds all points.
    radius: f64,
    /// How the area spreads about the centre, square metres.
    covariance: DMat3,
    area: f64,
}

/// The tree over a cloud with the sums of what its points carry.
struct Tree<'a> {
    cloud: &'a Cloud,
    order: Vec<u32>,
    nodes: Vec<Node>,
    /// `[node, width]`: Σ A t.
    sums: Vec<f64>,
    /// `[node]`: Σ (A · noise)².
    noise: Vec<f64>,
}

impl Cloud {
    /// The points of a posed mesh, shading normals by vertex; each has a third of its triangles.
    pub(super) fn new(stage: &Stage, positions: &[Vec3], normals: &[Vec3]) -> Self {
        let points = &stage.points;
        let mut areas = vec![0.0; points.vertex.len()];
        for triangle in &stage.triangles {
            let [a, b, c] = triangle.map(|corner| positions[corner as usize].as_dvec3());
            let third = (b - a).cross(c - a).length() / 6.0;
            for corner in triangle {
                let point = points.of_vertex[*corner as usize];
                if point != NO_POINT {
                    areas[point as usize] += third;
                }
            }
        }
        let place = |&vertex: &u32| positions[vertex as usize].as_dvec3();
        let normal = |&vertex: &u32| normals[vertex as usize].as_dvec3().normalize_or(DVec3::Y);
        let places = points.vertex.iter().map(place).collect();
        Self::of(places, points.vertex.iter().map(normal).collect(), areas)
    }

    /// Some of the points, with all that they stand for.
    pub(super) fn part(&self, points: &[u32]) -> Self {
        let of = |&point: &u32| point as usize;
        Self::of(
            points.iter().map(|p| self.places[of(p)]).collect(),
            points.iter().map(|p| self.normals[of(p)]).collect(),
            points.iter().map(|p| self.areas[of(p)]).collect(),
        )
    }

    /// Points with what they stand for.
    pub(super) fn of(places: Vec<DVec3>, normals: Vec<DVec3>, areas: Vec<f64>) -> Self {
        let mut order: Vec<usize> = (0..places.len()).collect();
        let key = |point: usize| places[point].to_array().map(f64::to_bits);
        order.sort_unstable_by_key(|&point| (key(point), point));
        let mut shared = vec![0.0; places.len()];
        for same in order.chunk_by(|&a, &b| places[a] == places[b]) {
            let area: f64 = same.iter().map(|&point| areas[point]).sum();
            same.iter().for_each(|&point| shared[point] = area);
        }
        Self { places, normals, areas, shared }
    }

    /// The weight of a point at another: the kernel over its disk.
    pub(super) fn weight(&self, dipole: &Dipole, at: usize, of: usize) -> f64 {
        let area = self.areas[of];
        let away = self.places[at] - self.places[of];
        let square = away.length_squared();
        if at == of || square == 0.0 {
            let shared = self.shared[of];
            let share = if shared > 0.0 { area / shared } else { 0.0 };
            return share * dipole.disk((shared / PI).sqrt());
        }
        if square > NEAR_RADII * NEAR_RADII * area / PI {
            return area * dipole.at(square);
        }
        let height = away.dot(self.normals[of]);
        let off = (square - height * height).max(0.0);
        // On one sheet what is nearer to the point is the point's own.
        let same = self.normals[at].dot(self.normals[of]) > 0.0;
        let taken = if same { (self.shared[at] / PI).min(off / 4.0) } else { 0.0 };
        let disk = Disk { height: height * height, off, radius: area / PI, taken };
        area * disk.mean(dipole).unwrap_or_else(|| dipole.at(square.max(taken)))
    }
}

/// A disk seen from a place near it; squares of metres.
struct Disk {
    /// Of the place over the disk's plane.
    height: f64,
    /// From the place's foot to the disk's middle.
    off: f64,
    radius: f64,
    /// Of a circle about the foot that does not count.
    taken: f64,
}

impl Disk {
    /// The mean of the kernel over what counts of the disk, if anything does: sector by sector about the
    /// foot, over each of which the kernel's integral is known.
    fn mean(&self, dipole: &Dipole) -> Option<f64> {
        let inside = self.off < self.radius;
        // Half the angle that the disk takes up.
        let half = if inside { PI } else { (self.radius / self.off).sqrt().min(1.0).asin() };
        let (mut sum, mut area) = (0.0, 0.0);
        for index in 0..SECTORS {
            let (sin, cos) = (half * ((2 * index + 1) as f64 / SECTORS as f64 - 1.0)).sin_cos();
            let reach = (self.radius - self.off * sin * sin).max(0.0).sqrt();
            let middle = self.off.sqrt() * cos;
            let near = if inside { 0.0 } else { (middle - reach).max(0.0).powi(2) };
            let (near, far) = (near.max(self.taken), (middle + reach).powi(2));
            if near < far {
                sum += dipole.beyond(self.height + near) - dipole.beyond(self.height + far);
                area += PI * (far - near);
            }
        }
        (area > 0.0).then(|| sum / area)
    }
}

impl Node {
    /// Two squared distances that stand for those of the node's area from a place x away from its
    /// centre: |x + ρ|² has the mean |x|² + tr C and, to second order, the variance 4 xᵀ C x.
    fn squares(&self, away: DVec3) -> [f64; 2] {
        let c = &self.covariance;
        let mean = away.length_squared() + c.x_axis.x + c.y_axis.y + c.z_axis.z;
        let deviation = 2.0 * away.dot(*c * away).max(0.0).sqrt();
        [(mean - deviation).max(0.0), mean + deviation]
    }
}

impl<'a> Tree<'a> {
    /// `values` are `[point, width]`.
    fn new(cloud: &'a Cloud, values: &[f32], noise: &[f32]) -> Self {
        let points = cloud.places.len();
        let width = values.len() / points.max(1);
        let order = (0..points as u32).collect();
        let (sums, nodes) = (Vec::new(), Vec::new());
        let mut tree = Self { cloud, order, nodes, sums, noise: Vec::new() };
        if points > 0 {
            tree.split(0..points);
        }
        tree.sums = vec![0.0; tree.nodes.len() * width];
        tree.noise = vec![0.0; tree.nodes.len()];
        for (node, sums) in tree.nodes.iter().zip(tree.sums.chunks_exact_mut(width.max(1))) {
            // Every node sums over its points: deterministic, and N log N like the tree.
            for &point in &tree.order[node.range.clone()] {
                let area = cloud.areas[point as usize];
                let own = &values[point as usize * width..][..width];
                sums.iter_mut().zip(own).for_each(|(sum, &value)| *sum += area * f64::from(value));
            }
        }
        for (node, sum) in tree.nodes.iter().zip(&mut tree.noise) {
            let square = |&point: &u32| {
                (cloud.areas[point as usize] * f64::from(noise[point as usize])).powi(2)
            };
            *sum = tree.order[node.range.clone()].iter().map(square).sum();
        }
        tree
    }

    /// Adds the node of a run of points, and all below it.
    fn split(&mut self, range: std::ops::Range<usize>) {
        let places = &self.cloud.places;
        let all = || self.order[range.clone()].iter().map(|&point| point as usize);
        let area: f64 = all().map(|point| self.cloud.areas[point]).sum();
        let mut centre = all().map(|point| places[point]).sum::<DVec3>() / range.len() as f64;
        if area > 0.0 {
            centre = all().map(|p| places[p] * self.cloud.areas[p]).sum::<DVec3>() / area;
        }
        let radius = all().map(|p| places[p].distance_squared(centre)).fold(0.0, f64::max).sqrt();
        let spread = |p: usize| {
            let away = places[p] - centre;
            let weight = if area > 0.0 { self.cloud.areas[p] / area } else { 0.0 };
            DMat3::from_cols(away * away.x, away * away.y, away * away.z) * weight
        };
        let covariance = all().map(spread).fold(DMat3::ZERO, |sum, one| sum + one);
        let low = all().map(|p| places[p]).fold(centre, DVec3::min);
        let extent = all().map(|p| places[p]).fold(centre, DVec3::max) - low;
        let node = self.nodes.len();
        self.nodes.push(Node { range: range.clone(), second: 0, centre, radius, covariance, area });
        if range.len() <= LEAF {
            return;
        }
        let axis = if extent.x >= extent.max_element() {
            0
        } else if extent.y >= extent.z {
            1
        } else {
            2
        };
        // Ties by number, so that the tree is the same for the same points.
        let key = |&point: &u32| (places[point as usize][axis], point);
        self.order[range.clone()].sort_unstable_by(|a, b| {
            let ((a, i), (b, j)) = (key(a), key(b));
            a.total_cmp(&b).then(i.cmp(&j))
        });
        let middle = range.start + range.len() / 2;
        self.split(range.start..middle);
        self.nodes[node].second = self.nodes.len();
        self.split(middle..range.end);
    }

    /// Calls `take` with every run of points that matters at a point: the node or the point, and
    /// its weight by dipole, per area for nodes.
    fn visit(&self, dipoles: &[Dipole], at: usize, mut take: impl FnMut(Run, [f64; 3])) {
        let place = self.cloud.places[at];
        let weights = |weight: &dyn Fn(&Dipole) -> f64| {
            let mut all = [0.0; 3];
            all.iter_mut().zip(dipoles).for_each(|(all, dipole)| *all = weight(dipole));
            all
        };
        let mut open = vec![0];
        while let Some(index) = open.pop() {
            let node: &Node = &self.nodes[index];
            let square = place.distance_squared(node.centre);
            let nearest = (square.sqrt() - node.radius).max(0.0);
            let most = |dipole: &Dipole| node.area * dipole.at(nearest * nearest);
            if dipoles.iter().all(|dipole| most(dipole) < NEGLIGIBLE) {
                continue;
            }
            if node.radius < OPENING * square.sqrt() && node.range.len() > 1 {
                let [low, high] = node.squares(place - node.centre);
                take(Run::Node(index), weights(&|d| f64::midpoint(d.at(low), d.at(high))));
            } else if node.second > 0 {
                open.extend([node.second, index + 1]);
            } else {
                for &point in &self.order[node.range.clone()] {
                    let point = point as usize;
                    take(
                        Run::Point(point),
                        weights(&|dipole| self.cloud.weight(dipole, at, point)),
                    );
                }
            }
        }
    }
}

/// What one weight belongs to.
enum Run {
    Node(usize),
    Point(usize),
}

/// Diffuses a pose: `[point, channel, coefficient]` of the given number of channels.
pub(super) fn diffuse(
    subsurface: &Subsurface,
    cloud: &Cloud,
    pose: &BakedPose,
    channels: usize,
    cancelled: &AtomicBool,
) -> Result<BakedPose, Error> {
    let points = pose.noise.len();
    let width = pose.coefficients.len() / points.max(1);
    let (count, out_channels) = (width / channels, subsurface.channels(channels));
    let tree = Tree::new(cloud, &pose.coefficients, &pose.noise);
    let all = subsurface.dipoles();
    // Colours that spread alike are weighed once.
    let dipoles = if subsurface.channels(1) == 1 { &all[..1] } else { &all[..] };
    let of = |channel: usize| channel.min(dipoles.len() - 1);
    let mut coefficients = vec![0.0; points * out_channels * count];
    let mut noise = vec![0.0; points];
    let tasks = coefficients.par_chunks_mut(POINTS_PER_TASK * out_channels * count);
    let tasks = tasks.zip(noise.par_chunks_mut(POINTS_PER_TASK)).enumerate();
    tasks.try_for_each(|(task, (out, noise))| {
        if cancelled.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        let mut sums = vec![0.0_f64; out_channels * count];
        let rows = out.chunks_exact_mut(out_channels * count).zip(noise);
        for (at, (out, noise)) in (task * POINTS_PER_TASK..).zip(rows) {
            sums.fill(0.0);
            let mut square = 0.0;
            tree.visit(dipoles, at, |run, weights| {
                let mean = weights[..dipoles.len()].iter().sum::<f64>() / dipoles.len() as f64;
                for (channel, sums) in sums.chunks_exact_mut(count).enumerate() {
                    let (weight, source) =
                        (weights[of(channel)], channel.min(channels - 1) * count);
                    match run {
                        Run::Node(node) => {
                            let from = &tree.sums[node * width + source..][..count];
                            sums.iter_mut().zip(from).for_each(|(sum, v)| *sum += weight * v);
                        }
                        Run::Point(point) => {
                            let from = &pose.coefficients[point * width + source..][..count];
                            let value = |(sum, &v): (&mut f64, &f32)| *sum += weight * f64::from(v);
                            sums.iter_mut().zip(from).for_each(value);
                        }
                    }
                }
                square += mean
                    * mean
                    * match run {
                        Run::Node(node) => tree.noise[node],
                        Run::Point(point) => f64::from(pose.noise[point]).powi(2),
                    };
            });
            out.iter_mut().zip(&sums).for_each(|(out, &sum)| *out = sum as f32);
            *noise = square.sqrt() as f32;
        }
        Ok(())
    })?;
    Ok(BakedPose { coefficients, noise, rays: pose.rays.clone() })
}
