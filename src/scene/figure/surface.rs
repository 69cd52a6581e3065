//! A closed triangle mesh of the zero set of a distance field: surface nets, then relaxation.
//!
//! Every grid cell that the surface crosses gets one vertex and every grid edge that it crosses one
//! quad between its four cells, so neighbouring quads share vertices and nothing is left open. The
//! vertices are then evened out along the surface and pulled back onto it.

use glam::{DVec3, dvec3};

/// A box of cubic cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    /// The lowest corner, metres.
    pub(super) origin: DVec3,
    /// The edge of a cell, metres.
    pub(super) cell_m: f64,
    /// Corners along x, y, z.
    pub(super) corners: [usize; 3],
}

impl Grid {
    fn index(&self, corner: [usize; 3]) -> usize {
        (corner[2] * self.corners[1] + corner[1]) * self.corners[0] + corner[0]
    }

    fn position(&self, corner: [usize; 3]) -> DVec3 {
        self.origin + self.cell_m * dvec3(corner[0] as f64, corner[1] as f64, corner[2] as f64)
    }

    /// Every corner, x fastest.
    fn all(self) -> impl Iterator<Item = [usize; 3]> {
        let [nx, ny, nz] = self.corners;
        (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])))
    }
}

/// Triangles that share vertices, counter-clockwise seen from outside.
#[derive(Debug, Clone, Default)]
pub(super) struct Surface {
    pub(super) positions: Vec<DVec3>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// How often the vertices are evened out.
const RELAXATIONS: usize = 12;
/// Newton's steps that end on the surface; while relaxing, one at a time is enough.
const LAST_STEPS: usize = 3;

/// Meshes the zero set of `distance`, which must lie inside the grid with a cell to spare.
pub(super) fn mesh(grid: Grid, distance: impl Fn(DVec3) -> f64) -> Surface {
    let mut values: Vec<f64> = grid.all().map(|corner| distance(grid.position(corner))).collect();
    while part_diagonals(grid, &mut values) {}
    let (mut positions, vertex_of_cell) = vertices(grid, &values);
    let quads = quads(grid, &values, &vertex_of_cell);
    let neighbours = neighbours(&quads, positions.len());
    for _ in 0..RELAXATIONS {
        let average = |around: &Vec<u32>| {
            around.iter().map(|&v| positions[v as usize]).sum::<DVec3>() / around.len() as f64
        };
        let evened: Vec<DVec3> = neighbours.iter().map(average).collect();
        positions = evened.into_iter().map(|p| project(p, grid.cell_m, 1, &distance)).collect();
    }
    for position in &mut positions {
        *position = project(*position, grid.cell_m, LAST_STEPS, &distance);
    }
    let triangles = quads.iter().flat_map(|quad| split(quad, &positions)).collect();
    Surface { positions, triangles }
}

/// Pushes corners outside where a cell's face has its inner corners on one diagonal: there two
/// sheets of the surface would meet in an edge. True if a corner was pushed, which may make another
/// such face; inner corners only become fewer, so this ends.
fn part_diagonals(grid: Grid, values: &mut [f64]) -> bool {
    const BARELY_OUTSIDE: f64 = 1e-9;
    let mut pushed = false;
    for corner in grid.all() {
        for (u, v) in [(0, 1), (1, 2), (2, 0)] {
            if corner[u] + 1 >= grid.corners[u] || corner[v] + 1 >= grid.corners[v] {
                continue;
            }
            let at = |du: usize, dv: usize| {
                let mut other = corner;
                other[u] += du;
                other[v] += dv;
                grid.index(other)
            };
            for (a, b, c, d) in
                [(at(0, 0), at(1, 1), at(1, 0), at(0, 1)), (at(1, 0), at(0, 1), at(0, 0), at(1, 1))]
            {
                if values[a].max(values[b]) < 0.0 && values[c].min(values[d]) >= 0.0 {
                    let shallow = if values[a] > values[b] { a } else { b };
                    values[shallow] = BARELY_OUTSIDE;
                    pushed = true;
                }
            }
        }
    }
    pushed
}

/// The vertices, at the mean of each cell's edge crossings, and which cell has which.
fn vertices(grid: Grid, values: &[f64]) -> (Vec<DVec3>, Vec<Option<u32>>) {
    let mut positions = Vec::new();
    let mut vertex_of_cell = vec![None; values.len()];
    for cell in grid.all() {
        if (0..3).any(|axis| cell[axis] + 1 >= grid.corners[axis]) {
            continue;
        }
        let corner = |bits: usize| [0, 1, 2].map(|axis| cell[axis] + (bits >> axis & 1));
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for (from, axis) in (0..8).flat_map(|from| (0..3).map(move |axis| (from, axis))) {
            let to = from | 1 << axis;
            let (a, b) = (values[grid.index(corner(from))], values[grid.index(corner(to))]);
            if to != from && (a < 0.0) != (b < 0.0) {
                sum += grid.position(corner(from)).lerp(grid.position(corner(to)), a / (a - b));
                count += 1.0;
            }
        }
        if count > 0.0 {
            vertex_of_cell[grid.index(cell)] = Some(positions.len() as u32);
            positions.push(sum / count);
        }
    }
    (positions, vertex_of_cell)
}

/// One quad for every edge between an inner and an outer corner.
fn quads(grid: Grid, values: &[f64], vertex_of_cell: &[Option<u32>]) -> Vec<[u32; 4]> {
    let mut quads = Vec::new();
    for corner in grid.all() {
        for axis in 0..3 {
            let mut next = corner;
            next[axis] += 1;
            if next[axis] >= grid.corners[axis] {
                continue;
            }
            let inside = values[grid.index(corner)] < 0.0;
            if inside == (values[grid.index(next)] < 0.0) {
                continue;
            }
            // The four cells about the edge, counter-clockwise seen from its far end.
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let around = [(1, 1), (0, 1), (0, 0), (1, 0)].map(|(back_u, back_v)| {
                let mut cell = corner;
                cell[u] -= back_u;
                cell[v] -= back_v;
                vertex_of_cell[grid.index(cell)].expect("a crossed edge has four crossed cells")
            });
            let [a, b, c, d] = around;
            quads.push(if inside { around } else { [d, c, b, a] });
        }
    }
    quads
}

/// Vertex → the vertices at the other ends of its quads' sides.
fn neighbours(quads: &[[u32; 4]], vertices: usize) -> Vec<Vec<u32>> {
    let mut neighbours = vec![Vec::new(); vertices];
    for quad in quads {
        for side in 0..4 {
            // The mirrored side belongs to the neighbouring quad.
            neighbours[quad[side] as usize].push(quad[(side + 1) % 4]);
        }
    }
    neighbours
}

/// A point nearer to the surface, by Newton's steps along the gradient.
fn project(mut p: DVec3, cell_m: f64, steps: usize, distance: &impl Fn(DVec3) -> f64) -> DVec3 {
    let step = cell_m * 1e-3;
    for _ in 0..steps {
        let along = |axis: DVec3| distance(p + axis * step) - distance(p - axis * step);
        let gradient = dvec3(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)) / (2.0 * step);
        let steepness = gradient.length_squared();
        if steepness < 1e-4 {
            break;
        }
        p -= gradient * (distance(p) / steepness).clamp(-cell_m, cell_m);
    }
    p
}

/// Two triangles along the shorter diagonal.
fn split(&[a, b, c, d]: &[u32; 4], positions: &[DVec3]) -> [[u32; 3]; 2] {
    let length = |i: u32, j: u32| positions[i as usize].distance_squared(positions[j as usize]);
    if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
}

impl Surface {
    /// Unit vertex normals: face normals weighted by the angle at the vertex.
    pub(super) fn normals(&self) -> Vec<DVec3> {
        let mut normals = vec![DVec3::ZERO; self.positions.len()];
        for triangle in &self.triangles {
            let corners = triangle.map(|v| self.positions[v as usize]);
            let face = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            for i in 0..3 {
                let to_next = corners[(i + 1) % 3] - corners[i];
                let to_last = corners[(i + 2) % 3] - corners[i];
                normals[triangle[i] as usize] += face * to_next.angle_between(to_last);
            }
        }
        normals.into_iter().map(|normal| normal.normalize_or(DVec3::Y)).collect()
    }

    /// Vertex → vertices that share an edge with it, ascending.
    pub(super) fn edges(&self) -> Vec<Vec<u32>> {
        let mut edges = vec![Vec::new(); self.positions.len()];
        for &[a, b, c] in &self.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges[from as usize].push(to);
            }
        }
        edges.iter_mut().for_each(|list| list.sort_unstable());
        edges
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Proves on a sphere that the mesh is closed and oriented outwards: every directed edge occurs
    /// once and its opposite once, χ = 2, and the volume is the ball's to the grid's precision.
    #[test]
    fn a_sphere_is_closed() {
        let grid = Grid { origin: DVec3::splat(-1.2), cell_m: 0.1, corners: [25; 3] };
        let surface = mesh(grid, |p| p.length() - 1.0);
        crate::scene::figure::tests::assert_closed(&surface);
        let volume: f64 = surface
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| surface.positions[v as usize]);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        assert!((volume / (4.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{volume}");
        for (position, normal) in surface.positions.iter().zip(surface.normals()) {
            assert!((position.length() - 1.0).abs() < 1e-6);
            assert!(position.dot(normal) > 0.99);
        }
    }
}
