//! A mesh at rest, as far as vertices are told apart by it.

use std::collections::{HashMap, HashSet};

use glam::Vec3;

use crate::model::{self, JointPose, Model, PosedPoints};
use crate::rig::{Deformed, Mesh, Points, Pose, RigidFrame, Skeleton, deform};
use crate::scene::Scene;

/// Shares of the nodes that move a vertex, by their names.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Weights(Vec<(String, f32)>);

impl Weights {
    fn of(mesh: &Mesh, vertex: usize, name: &dyn Fn(usize) -> String) -> Self {
        let mut all: Vec<(String, f32)> = Vec::new();
        for influence in mesh.influences_of(vertex) {
            let name = name(mesh.deformers[influence.deformer as usize].node);
            match all.iter_mut().find(|(other, _)| *other == name) {
                Some((_, weight)) => *weight += influence.weight,
                None => all.push((name, influence.weight)),
            }
        }
        Self(all)
    }

    /// Σ |a − b| over the nodes.
    pub(super) fn distance(&self, other: &Self) -> f32 {
        let of = |all: &Self, name: &str| {
            all.0.iter().find(|(known, _)| known == name).map_or(0.0, |(_, weight)| *weight)
        };
        let own = self.0.iter().map(|(name, weight)| (weight - of(other, name)).abs());
        let beyond = other.0.iter().filter(|(name, _)| of(self, name) == 0.0);
        own.sum::<f32>() + beyond.map(|(_, weight)| weight).sum::<f32>()
    }
}

/// Vertices or points at rest, in the scene's space.
#[derive(Debug, Clone, Default)]
pub(super) struct Shape {
    /// Metres.
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) weights: Vec<Weights>,
    /// Both ways; empty where they are not known.
    pub(super) edges: HashSet<(u32, u32)>,
}

impl Shape {
    /// The vertices of a scene.
    pub(super) fn of_vertices(scene: &Scene) -> Self {
        let same = |vertex: u32| vertex;
        Self::of(&scene.skeleton, &scene.mesh, &scene.mesh.triangles, &same)
    }

    /// The points of a scene as a model of it has them.
    pub(super) fn of_points(scene: &Scene, model: &Model) -> Self {
        let mut points = Points::merge(&scene.mesh);
        if points.count() != model.shape().points {
            // Meshes that are not treated alike share none.
            points = Points::numbered(model.point_of_vertex());
        }
        let mesh = scene.mesh.subset(&points.vertex);
        let point = |vertex: u32| points.of_vertex[vertex as usize];
        Self::of(&scene.skeleton, &mesh, &scene.mesh.triangles, &point)
    }

    /// The points that a model carries.
    pub(super) fn of_model(model: &Model) -> Result<Option<Self>, model::Error> {
        let rest = model.pose_of(&JointPose::default())?;
        let (Some(mesh), Some(posed)) = (model.rest(), model.surface_of(&rest)?) else {
            return Ok(None);
        };
        let name = |node: usize| model.header().rig.nodes[node].name.clone();
        let weights = (0..posed.positions.len()).map(|v| Weights::of(mesh, v, &name)).collect();
        let PosedPoints { positions, normals, .. } = posed;
        Ok(Some(Self { positions, normals, weights, edges: HashSet::new() }))
    }

    fn of(
        skeleton: &Skeleton,
        mesh: &Mesh,
        triangles: &[[u32; 3]],
        index: &dyn Fn(u32) -> u32,
    ) -> Self {
        let rest = Pose::rest(skeleton, &mesh.default_weights);
        let mut out = Deformed::default();
        let globals = skeleton.globals(&rest.local);
        deform(mesh, &globals, &rest.weights, RigidFrame::IDENTITY, &mut out);
        let name = |node: usize| skeleton.nodes[node].name.clone();
        let weights = (0..out.positions.len()).map(|v| Weights::of(mesh, v, &name)).collect();
        let mut edges = HashSet::new();
        for triangle in triangles {
            let [a, b, c] = triangle.map(index);
            edges.extend([(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)]);
        }
        Self { positions: out.positions, normals: out.normals, weights, edges }
    }

    /// Whether two are one or have an edge.
    pub(super) fn joins(&self, a: u32, b: u32) -> bool {
        a == b || self.edges.contains(&(a, b))
    }

    /// Vertex → those that an edge joins it to, ascending.
    pub(super) fn neighbours(&self) -> Vec<Vec<u32>> {
        let mut all = vec![Vec::new(); self.positions.len()];
        self.edges.iter().for_each(|&(a, b)| all[a as usize].push(b));
        all.iter_mut().for_each(|some| some.sort_unstable());
        all
    }

    /// The nearest one to a place and how far it is, metres.
    pub(super) fn nearest(&self, place: Vec3) -> (u32, f32) {
        let away = self.positions.iter().map(|p| p.distance(place)).enumerate();
        let least = away.min_by(|a, b| a.1.total_cmp(&b.1));
        least.map_or((0, f32::INFINITY), |(point, away)| (point as u32, away))
    }
}

/// Points by the cell that they are in.
pub(super) struct Grid {
    cell_m: f32,
    cells: HashMap<[i64; 3], Vec<u32>>,
}

impl Grid {
    /// With cells as long as what is looked for may be away.
    pub(super) fn new(positions: &[Vec3], cell_m: f32) -> Self {
        let largest = positions.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
        // So that a cell's number is exact, however near the looked for is.
        let cell_m = cell_m.max(1e-6 * largest).max(f32::MIN_POSITIVE);
        let mut this = Self { cell_m, cells: HashMap::new() };
        for (point, &position) in (0_u32..).zip(positions) {
            let cell = this.cell(position);
            this.cells.entry(cell).or_default().push(point);
        }
        this
    }

    fn cell(&self, position: Vec3) -> [i64; 3] {
        position.to_array().map(|x| (f64::from(x) / f64::from(self.cell_m)).floor() as i64)
    }

    /// All points in the cells around a place.
    pub(super) fn near(&self, place: Vec3) -> impl Iterator<Item = u32> {
        let [x, y, z] = self.cell(place);
        let around = (0..27).map(move |i: i64| {
            [x, y, z]
                .into_iter()
                .zip([i % 3, i / 3 % 3, i / 9])
                .map(|(at, step)| at.saturating_add(step - 1))
                .collect::<Vec<_>>()
        });
        around.filter_map(|cell| self.cells.get(&[cell[0], cell[1], cell[2]])).flatten().copied()
    }
}
