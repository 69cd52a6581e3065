//! The primitives of a scene as one surface, and its transfer in every view.

use std::cell::RefCell;
use std::collections::{HashMap, HashSet};
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use crate::bake::subdivide::{Leaf, Row, Source, Tessellation};
use crate::bake::{self, Place, Standing};
use crate::rig::{Deformed, Mesh};

use super::together::move_alike;

/// More instances of one primitive are not looked at: the first ones stand for them.
const MOST_INSTANCES: usize = 16;

/// One primitive of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Primitive {
    /// The parts that show it, indices into [`Mesh::parts`].
    pub(super) parts: Vec<usize>,
    /// Its vertices and triangles in the surface.
    pub(super) first_vertex: usize,
    pub(super) vertices: usize,
    pub(super) first_triangle: usize,
    pub(super) triangles: usize,
}

/// All primitives, each once, however many nodes show it.
#[derive(Debug)]
pub(super) struct Surface {
    pub(super) primitives: Vec<Primitive>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Vertex → its place: equal where the rest positions within one mesh of the file are.
    pub(super) weld: Vec<u32>,
}

impl Surface {
    /// `origins`: for each part the first of the same primitive, and the file's mesh.
    pub(super) fn new(mesh: &Mesh, origins: &[(usize, usize)]) -> Self {
        let mut surface = Self { primitives: Vec::new(), triangles: Vec::new(), weld: Vec::new() };
        let mut of_part: HashMap<usize, usize> = HashMap::new();
        let mut welds: HashMap<(usize, [u32; 3]), u32> = HashMap::new();
        for (index, (part, &(first, file_mesh))) in mesh.parts.iter().zip(origins).enumerate() {
            if let Some(&primitive) = of_part.get(&first) {
                surface.primitives[primitive].parts.push(index);
                continue;
            }
            of_part.insert(first, surface.primitives.len());
            let (first_vertex, first_triangle) = (surface.weld.len(), surface.triangles.len());
            let shift = |v: u32| (v as usize - part.vertices.start + first_vertex) as u32;
            let own = &mesh.triangles[part.triangles.clone()];
            surface.triangles.extend(own.iter().map(|triangle| triangle.map(shift)));
            for position in &mesh.positions[part.vertices.clone()] {
                // Adding 0 turns −0 into 0.
                let place = position.to_array().map(|x| (x + 0.0).to_bits());
                let next = welds.len() as u32;
                surface.weld.push(*welds.entry((file_mesh, place)).or_insert(next));
            }
            surface.primitives.push(Primitive {
                parts: vec![index],
                first_vertex,
                vertices: part.vertices.len(),
                first_triangle,
                triangles: part.triangles.len(),
            });
        }
        surface
    }

    /// The surface with nothing split.
    pub(super) fn tessellation(&self, mesh: &Mesh) -> Tessellation {
        Tessellation::keeping(&self.triangles, self.weld.clone(), self.fillers(mesh))
    }

    /// Its triangles.
    pub(super) fn leaves(&self) -> Vec<Leaf> {
        (0..).zip(&self.triangles).map(|(root, &corners)| Leaf::root(root, corners)).collect()
    }

    /// Triangles of which two corners are one vertex in every pose: fillers of seams, without area.
    fn fillers(&self, mesh: &Mesh) -> HashSet<u32> {
        let mut fillers = HashSet::new();
        for (triangle, corners) in (0_u32..).zip(&self.triangles) {
            let sides = [[0, 1], [1, 2], [2, 0]].map(|side| side.map(|i| corners[i]));
            let primitive = &self.primitives[self.primitive_of(triangle)];
            let first = mesh.parts[primitive.parts[0]].vertices.start;
            let own = |vertex: u32| vertex as usize - primitive.first_vertex + first;
            let is_one = |[a, b]: [u32; 2]| {
                self.weld[a as usize] == self.weld[b as usize] && move_alike(mesh, own(a), own(b))
            };
            if sides.into_iter().any(is_one) {
                fillers.insert(triangle);
            }
        }
        fillers
    }

    /// The primitive of a triangle.
    pub(super) fn primitive_of(&self, triangle: u32) -> usize {
        self.primitives.partition_point(|p| p.first_triangle <= triangle as usize) - 1
    }

    /// Areas of the triangles at their first instance in one pose.
    pub(super) fn areas(&self, mesh: &Mesh, posed: &Deformed) -> Vec<f32> {
        let mut areas = Vec::with_capacity(self.triangles.len());
        for primitive in &self.primitives {
            let part = &mesh.parts[primitive.parts[0]];
            areas.extend(mesh.triangles[part.triangles.clone()].iter().map(|triangle| {
                let [a, b, c]: [Vec3; 3] = triangle.map(|v| posed.positions[v as usize]);
                (b - a).cross(c - a).length() / 2.0
            }));
        }
        areas
    }
}

/// Every view of a surface: the key poses, and in each the instances.
#[derive(Debug)]
pub(super) struct Views<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) surface: &'a Surface,
    pub(super) poses: Vec<Standing<'a>>,
}

impl Source for Views<'_> {
    fn look(
        &self,
        places: &[Place],
        numbers: &[u64],
        stop: &AtomicBool,
    ) -> Result<Vec<Row>, bake::Error> {
        let mut rows = vec![Row::default(); places.len()];
        let of: Vec<&Primitive> = places
            .iter()
            .map(|place| &self.surface.primitives[self.surface.primitive_of(place.triangle)])
            .collect();
        let most = of.iter().map(|primitive| primitive.parts.len()).max().unwrap_or(0);
        for instance in 0..most.min(MOST_INSTANCES) {
            let shown: Vec<usize> =
                (0..places.len()).filter(|&i| instance < of[i].parts.len()).collect();
            let here = |&i: &usize| {
                let first = self.mesh.parts[of[i].parts[instance]].triangles.start;
                let own = places[i].triangle as usize - of[i].first_triangle;
                Place { triangle: (first + own) as u32, ..places[i] }
            };
            let placed: Vec<Place> = shown.iter().map(here).collect();
            let numbered: Vec<u64> = shown.iter().map(|&i| numbers[i]).collect();
            for pose in &self.poses {
                let seen = pose.bake(&placed, &numbered, stop)?;
                let width = seen.baked.coefficients.len() / placed.len().max(1);
                let values = seen.baked.coefficients.chunks_exact(width.max(1));
                let noise = seen.baked.noise.iter().zip(seen.normals);
                for ((&i, values), (noise, normal)) in shown.iter().zip(values).zip(noise) {
                    rows[i].transfer.extend_from_slice(values);
                    rows[i].normals.push(normal);
                    rows[i].variances.push(noise * noise * width as f32);
                }
            }
        }
        Ok(rows)
    }
}

/// What was baked before is not baked again: a surface is refined anew where a part of it must stay.
#[derive(Debug)]
pub(super) struct Remembered<'a> {
    views: &'a Views<'a>,
    rows: RefCell<HashMap<(u32, [u32; 3]), Row>>,
}

impl<'a> Remembered<'a> {
    pub(super) fn new(views: &'a Views<'a>) -> Self {
        Self { views, rows: RefCell::default() }
    }
}

impl Source for Remembered<'_> {
    fn look(
        &self,
        places: &[Place],
        numbers: &[u64],
        stop: &AtomicBool,
    ) -> Result<Vec<Row>, bake::Error> {
        let key = |place: &Place| (place.triangle, place.weights.map(f32::to_bits));
        let mut known = self.rows.borrow_mut();
        let unknown = |&i: &usize| !known.contains_key(&key(&places[i]));
        let open: Vec<usize> = (0..places.len()).filter(unknown).collect();
        let asked: Vec<Place> = open.iter().map(|&i| places[i]).collect();
        let numbered: Vec<u64> = open.iter().map(|&i| numbers[i]).collect();
        let found = self.views.look(&asked, &numbered, stop)?;
        known.extend(asked.iter().map(key).zip(found));
        Ok(places.iter().map(|place| known[&key(place)].clone()).collect())
    }
}
