//! A posed mesh made ready for tracing.
//!
//! What is baked is moved to the origin and scaled by a power of two to a size between 1 and 2, so the
//! tracer meets the same numbers at every scale and place, whatever blocks from afar. What the original
//! coordinates could not resolve stays lost, and the ray's offset knows it.

use std::sync::Arc;

use glam::Vec3;

use crate::rig::Points;
use crate::trace;

use super::borders::Borders;
use super::least_squares::LeastSquares;
use super::sites::Site;
use super::surroundings::{NO_POINT, Surroundings, Trees};
use super::{Error, Openings, PosedMesh};

/// The offset in mean lengths of the adjoining edges: a thousand times what single precision loses
/// in intersecting a triangle of that size, and far below what an eye sees.
const OFFSET_IN_EDGES: f32 = 1e-4;

/// The offset in spacings of floating-point numbers at the point's largest coordinate: rounding
/// origin and vertices loses less than 2.
const OFFSET_IN_SPACINGS: f32 = 8.0;

/// The least cosine between a point's normal and that of its own triangles where its surface is flat: 0.8°,
/// as far as coarsely stored normals are off.
const UPRIGHT: f32 = 0.9999;

/// The least length of the sum of a point's triangles' normals, over the sum of their lengths, where they
/// are one plane.
const PLANE: f32 = 0.999_98;

/// The tracer takes coordinates up to 10¹⁸: what blocks may reach so many powers of two beyond what is baked.
const MOST_REACH: f32 = 40.0;

/// One pose ready for tracing; lengths in the scaled space.
#[derive(Debug)]
pub(super) struct Posed {
    scenes: Arc<[trace::Scene]>,
    /// Point → scene; empty where there is only one.
    scene_of_point: Arc<[u8]>,
    /// Where a point's rays start.
    pub(super) origins: Vec<Vec3>,
    /// Unit shading normals.
    pub(super) normals: Vec<Vec3>,
    /// How high each point is over the ground, where there is one.
    pub(super) heights: Option<Vec<f32>>,
    /// Nearer than this nothing blocks.
    pub(super) near: f32,
    /// Beyond this nothing blocks.
    pub(super) far: f32,
    pub(super) clip_key: u64,
    pub(super) time_bits: u32,
    /// Numbers of the origins in random streams; empty where they are those of the points.
    pub(super) numbers: Vec<u64>,
}

/// What is the same in all poses.
#[derive(Debug)]
pub(super) struct Stage {
    pub(super) device: trace::Device,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) points: Points,
    /// Where surfaces end.
    pub(super) borders: Borders,
    pub(super) trees: Trees,
    pub(super) surroundings: Surroundings,
    /// What lets rays through, where anything does.
    pub(super) openings: Option<Arc<Openings>>,
    /// Where rays start, where that is not at the points.
    pub(super) fit: Option<LeastSquares>,
    /// Metres; infinite where there is no limit.
    pub(super) max_distance_m: f32,
}

/// What the triangles around a point say of it.
#[derive(Debug, Clone, Copy, Default)]
struct Around {
    /// Twice the sum of the triangles' areas times their normals.
    normal: Vec3,
    /// The same of the lengths.
    area: f32,
    edge_sum: f32,
    edges: u32,
}

impl Posed {
    /// Checks, scales, and builds the scene in the calling thread.
    pub(super) fn new(stage: &Stage, pose: usize, mesh: &PosedMesh<'_>) -> Result<Self, Error> {
        let points = &stage.points;
        check(pose, mesh, points.of_vertex.len())?;
        let space = Space::around(points, mesh.positions);
        let positions: Vec<Vec3> = mesh.positions.iter().map(|&p| space.enter(p)).collect();
        let build = |(tree, triangles): (usize, &Vec<[u32; 3]>)| {
            let numbered = (0..).zip(triangles).map(|(i, &t)| (stage.trees.original(tree, i), t));
            let openings = stage.openings.as_ref();
            let filter =
                openings.map(|openings| openings.filter(numbered, &positions, mesh.normals));
            trace::Scene::build_filtered(&stage.device, &positions, triangles, filter)
                .map_err(|source| Error::Trace { pose, source })
        };
        let trees = stage.trees.triangles.iter().enumerate();
        let scenes = trees.map(build).collect::<Result<_, _>>()?;
        let around = surroundings(&stage.triangles, points, &positions);
        let normals: Vec<Vec3> = points
            .vertex
            .iter()
            .zip(&around)
            .map(|(&vertex, around)| shading_normal(mesh.normals[vertex as usize], around.normal))
            .collect();
        let inwards = stage.borders.inwards(points, &positions);
        let origin = |(point, &vertex): (usize, &u32)| {
            let vertex = vertex as usize;
            let length = around[point].offset(space.spacing(mesh.positions[vertex]));
            let outwards = around[point].outwards(normals[point]);
            // Bent triangles and leaning normals mean a round surface, which goes on at the border.
            let flat = around[point].is_plane() && outwards.dot(normals[point]) > UPRIGHT;
            let inwards = if flat { inwards[point] } else { Vec3::ZERO };
            positions[vertex] + length * (outwards + inwards)
        };
        let origins = points.vertex.iter().enumerate().map(origin).collect();
        let height =
            |ground: f32, vertex: u32| (mesh.positions[vertex as usize].y - ground) * space.scale;
        let heights = |ground| points.vertex.iter().map(|&v| height(ground, v)).collect();
        let at_points = Self {
            scenes,
            scene_of_point: Arc::clone(&stage.trees.of_point),
            origins,
            normals,
            heights: stage.surroundings.ground_m.map(heights),
            near: stage.surroundings.min_distance_m * space.scale,
            far: stage.max_distance_m * space.scale,
            clip_key: mesh.clip_key,
            time_bits: mesh.time_s.to_bits(),
            numbers: Vec::new(),
        };
        match &stage.fit {
            None => Ok(at_points),
            Some(fit) => Ok(at_points.at_sites(stage, mesh.positions, &fit.sites)),
        }
    }

    /// The same with rays that start at sites: everything between that of the corners.
    pub(super) fn at_sites(&self, stage: &Stage, positions: &[Vec3], sites: &[Site]) -> Self {
        let space = Space::around(&stage.points, positions);
        let corners = |site: &Site| stage.triangles[site.triangle as usize];
        let points = |site: &Site| {
            corners(site).map(|corner| stage.points.of_vertex[corner as usize] as usize)
        };
        let normal = |site: &Site| {
            let [a, b, c] = points(site).map(|point| self.normals[point]);
            unit(site.mix([a, b, c])).unwrap_or(a)
        };
        let height = |site: &Site, ground: f32| {
            let at = corners(site).map(|corner| positions[corner as usize]);
            (site.mix(at).y - ground) * space.scale
        };
        // Between vertices with smooth normals the facet lies below the surface that the normals
        // mean, and its neighbours would shadow it: each corner's tangent plane lifts the origin
        // (Hanika 2021, "Hacking the shadow terminator").
        let origin = |site: &Site| {
            let at = points(site);
            let flat = site.mix(at.map(|point| self.origins[point]));
            if stage.surroundings.faceted {
                return flat;
            }
            let lift = at.map(|point| {
                let below = (flat - self.origins[point]).dot(self.normals[point]).min(0.0);
                -below * self.normals[point]
            });
            flat + site.mix(lift)
        };
        let tree = |site: &Site| self.scene_of_point[points(site)[0]];
        let views = !self.scene_of_point.is_empty();
        let ground = stage.surroundings.ground_m;
        Self {
            scene_of_point: if views { sites.iter().map(tree).collect() } else { Arc::new([]) },
            origins: sites.iter().map(origin).collect(),
            normals: sites.iter().map(normal).collect(),
            heights: ground.map(|ground| sites.iter().map(|s| height(s, ground)).collect()),
            scenes: Arc::clone(&self.scenes),
            numbers: Vec::new(),
            ..*self
        }
    }
}

impl Posed {
    /// What a point's rays may meet.
    pub(super) fn scene(&self, point: usize) -> &trace::Scene {
        &self.scenes[self.tree(point)]
    }

    /// Which tree that is.
    pub(super) fn tree(&self, point: usize) -> usize {
        self.scene_of_point.get(point).map_or(0, |&tree| usize::from(tree))
    }
}

fn check(pose: usize, mesh: &PosedMesh<'_>, vertices: usize) -> Result<(), Error> {
    let (positions, normals) = (mesh.positions.len(), mesh.normals.len());
    if positions != vertices || normals != vertices {
        return Err(Error::Shape { pose, positions, normals, vertices });
    }
    if let Some(vertex) = mesh.positions.iter().position(|p| !p.is_finite()) {
        let position = mesh.positions[vertex].to_array();
        return Err(Error::NotFinite { pose, vertex, position });
    }
    Ok(())
}

/// The scaled space: (p − centre) · scale.
struct Space {
    centre: Vec3,
    scale: f32,
}

impl Space {
    /// Around the points that are baked. What only blocks may lie far outside.
    fn around(points: &Points, positions: &[Vec3]) -> Self {
        let baked = positions.iter().zip(&points.of_vertex);
        let baked = || baked.clone().filter(|(_, point)| **point != NO_POINT).map(|(p, _)| *p);
        let first = baked().next().or(positions.first().copied()).unwrap_or_default();
        let (low, high) = baked().fold((first, first), |(low, high), p| (low.min(p), high.max(p)));
        // Halved first: the sum of two large coordinates may overflow.
        let half_extent = (high * 0.5 - low * 0.5).max_element();
        let centre = low * 0.5 + high * 0.5;
        let reach = positions.iter().map(|&p| (p * 0.5 - centre * 0.5).abs().max_element());
        let reach = reach.fold(half_extent, f32::max);
        // A power of two changes no digits. Bounded so that it and its products stay normal.
        let exponent = |size: f32| -size.max(f32::MIN_POSITIVE).log2().ceil();
        let exponent = exponent(half_extent).min(exponent(reach) + MOST_REACH);
        let scale = if reach > 0.0 { exponent.clamp(-120.0, 120.0).exp2() } else { 1.0 };
        Self { centre, scale }
    }

    fn enter(&self, position: Vec3) -> Vec3 {
        (position - self.centre) * self.scale
    }

    /// The distance between neighbouring numbers at the point's largest coordinate, original or
    /// moved, whichever is larger; scaled.
    fn spacing(&self, position: Vec3) -> f32 {
        let moved = (position - self.centre).abs().max_element();
        moved.max(position.abs().max_element()) * self.scale * f32::EPSILON
    }
}

fn surroundings(triangles: &[[u32; 3]], points: &Points, positions: &[Vec3]) -> Vec<Around> {
    let mut around = vec![Around::default(); points.vertex.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|corner| positions[corner as usize]);
        let normal = (b - a).cross(c - a);
        let [ab, bc, ca] = [b - a, c - b, a - c].map(Vec3::length);
        for (corner, edge_sum) in corners.iter().zip([ab + ca, ab + bc, bc + ca]) {
            let point = points.of_vertex[*corner as usize];
            if point == NO_POINT {
                continue;
            }
            let here = &mut around[point as usize];
            here.normal += normal;
            here.area += normal.length();
            here.edge_sum += edge_sum;
            here.edges += 2;
        }
    }
    around
}

impl Around {
    /// How far from all surfaces through the point its rays start.
    fn offset(&self, spacing: f32) -> f32 {
        let edge = if self.edges > 0 { self.edge_sum / self.edges as f32 } else { 0.0 };
        (OFFSET_IN_EDGES * edge).max(OFFSET_IN_SPACINGS * spacing)
    }

    fn is_plane(&self) -> bool {
        self.normal.length() > PLANE * self.area
    }

    /// The geometric normal on the shading side.
    fn outwards(&self, shading_normal: Vec3) -> Vec3 {
        let geometric = unit(self.normal).unwrap_or(shading_normal);
        let side = if geometric.dot(shading_normal) < 0.0 { -1.0 } else { 1.0 };
        geometric * side
    }
}

fn shading_normal(given: Vec3, geometric: Vec3) -> Vec3 {
    unit(given).or_else(|| unit(geometric)).unwrap_or(Vec3::Y)
}

/// `None` where there is no direction. Scaled first, so that tiny areas keep theirs.
fn unit(vector: Vec3) -> Option<Vec3> {
    let largest = vector.abs().max_element();
    if vector.is_finite() && largest >= f32::MIN_POSITIVE {
        Some((vector / largest).normalize())
    } else {
        None
    }
}
