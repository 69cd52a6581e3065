//! Values at vertices whose interpolation over the triangles fits samples all over the surface
//! (Kavan, Bargteil and Sloan 2011, "Least squares vertex baking").
//!
//! min over x of Σ_s A_s (Σ_i w_si x_i − f_s)² + α Σ_e (A₁ + A₂) ℓ² ‖∇₁x − ∇₂x‖²: the first sum over
//! sites with their area and corner weights, the second over inner edges with the areas and the
//! gradients of the two triangles, which vanishes for every linear function; ℓ is the mean edge,
//! so that α has no unit. And β Σ_t A_t/n_t Σ (x_i − x_j)² over the sides of each triangle of n_t
//! sites: where few sites and no neighbour say how its corners differ, they agree. Sampling at vertices alone sees what lies between them not at all; this
//! sees it as far as the triangles can show it.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use super::Error;
use super::posed::Stage;
use super::sites::Site;
use super::surroundings::NO_POINT;

/// α: small beside the data wherever there are data, enough to decide where there are none.
const SMOOTHNESS: f64 = 0.05;

/// β: of no weight beside a few sites.
const FLATNESS: f64 = 0.002;

/// Conjugate gradients end where no point's residual is larger than this, relative to the largest
/// value on the right; both over the diagonal, so that small triangles count as large ones do.
const TOLERANCE: f64 = 1e-6;

/// Times that values are put back within their bounds.
const MOST_ROUNDS: usize = 4;

/// Or after so many steps: by then a mesh of this kind has always converged.
const MOST_STEPS: usize = 500;

/// The normal equations of a mesh and its sites.
#[derive(Debug)]
pub(super) struct LeastSquares {
    pub(super) sites: Vec<Site>,
    /// Site → its three points.
    corners: Vec<[u32; 3]>,
    /// Rows of the matrix: `columns[starts[p]..starts[p + 1]]`, the diagonal apart.
    starts: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
    diagonal: Vec<f64>,
}

impl LeastSquares {
    /// The equations of a mesh in this pose; they serve all poses.
    pub(super) fn new(
        stage: &Stage,
        positions: &[glam::Vec3],
        sites: Vec<Site>,
    ) -> Result<Self, Error> {
        if sites.is_empty() {
            return Err(Error::NoSurface);
        }
        let points = &stage.points;
        let of = |corner: u32| points.of_vertex[corner as usize];
        let corners: Vec<[u32; 3]> =
            sites.iter().map(|site| stage.triangles[site.triangle as usize].map(of)).collect();
        let mut entries: BTreeMap<(u32, u32), f64> = BTreeMap::new();
        for (site, at) in sites.iter().zip(&corners) {
            let weights = site.weights.map(f64::from);
            add_square(&mut entries, at, &weights, f64::from(site.area));
        }
        let mut start = 0;
        while start < sites.len() {
            let alike = |site: &Site| site.triangle == sites[start].triangle;
            let count = sites[start..].iter().take_while(|site| alike(site)).count();
            let area: f64 = sites[start..start + count].iter().map(|s| f64::from(s.area)).sum();
            let [a, b, c] = corners[start];
            for ends in [[a, b], [b, c], [c, a]] {
                add_square(&mut entries, &ends, &[1.0, -1.0], FLATNESS * area / count as f64);
            }
            start += count;
        }
        for edge in hinges(stage, positions) {
            add_square(&mut entries, &edge.points, &edge.weights, SMOOTHNESS * edge.strength);
        }
        let count = points.vertex.len();
        // A point without a triangle keeps 0.
        let mut diagonal = vec![1.0; count];
        let (mut starts, mut columns, mut values) = (vec![0; count + 1], Vec::new(), Vec::new());
        for (&(row, column), &value) in &entries {
            if row == column {
                diagonal[row as usize] = value;
            } else {
                starts[row as usize + 1] += 1;
                columns.push(column);
                values.push(value);
            }
        }
        for row in 0..count {
            starts[row + 1] += starts[row];
        }
        Ok(Self { sites, corners, starts, columns, values, diagonal })
    }

    /// How many points there are.
    pub(super) fn points(&self) -> usize {
        self.diagonal.len()
    }

    /// `[site, width]` to `[point, width]`, within bounds where there are any: where light ends within
    /// a triangle, the best straight line would go on beyond them.
    pub(super) fn solve(
        &self,
        samples: &[f32],
        width: usize,
        bounds: Option<[f64; 2]>,
    ) -> Vec<f32> {
        let column = |column: usize| {
            let mut right = vec![0.0; self.points()];
            for (index, (site, at)) in self.sites.iter().zip(&self.corners).enumerate() {
                let value = f64::from(samples[index * width + column] * site.area);
                for (&point, &weight) in at.iter().zip(&site.weights) {
                    right[point as usize] += value * f64::from(weight);
                }
            }
            self.within(&right, bounds)
        };
        let columns: Vec<Vec<f64>> = (0..width).into_par_iter().map(column).collect();
        let value = |(point, column): (usize, usize)| columns[column][point] as f32;
        (0..self.points()).flat_map(|p| (0..width).map(move |c| (p, c))).map(value).collect()
    }

    /// The standard error of each point from those of the sites: that of their weighted mean, which
    /// leaves the correlation between neighbouring points aside.
    pub(super) fn noise(&self, noise: &[f32]) -> Vec<f32> {
        let mut sums = vec![(0.0, 0.0); self.points()];
        for ((site, at), noise) in self.sites.iter().zip(&self.corners).zip(noise) {
            for (&point, &weight) in at.iter().zip(&site.weights) {
                let weight = f64::from(weight * site.area);
                let (squares, whole) = &mut sums[point as usize];
                *squares += (weight * f64::from(*noise)).powi(2);
                *whole += weight;
            }
        }
        let of =
            |(squares, whole): (f64, f64)| if whole > 0.0 { squares.sqrt() / whole } else { 0.0 };
        sums.into_iter().map(|sum| of(sum) as f32).collect()
    }

    /// What is out of bounds is held at them, and the others are fitted again beside it.
    fn within(&self, right: &[f64], bounds: Option<[f64; 2]>) -> Vec<f64> {
        let mut held = vec![false; right.len()];
        let mut x = self.conjugate_gradients(right, vec![0.0; right.len()], &held);
        let Some([least, most]) = bounds else { return x };
        for _ in 0..MOST_ROUNDS {
            let outside = |x: f64| x < least - TOLERANCE || x > most + TOLERANCE;
            if !x.iter().any(|&x| outside(x)) {
                break;
            }
            for (x, held) in x.iter_mut().zip(&mut held).filter(|(x, _)| outside(**x)) {
                (*x, *held) = (x.clamp(least, most), true);
            }
            x = self.conjugate_gradients(right, x, &held);
        }
        x.iter().map(|x| x.clamp(least, most)).collect()
    }

    /// With the diagonal as preconditioner; what is held stays as it is.
    fn conjugate_gradients(&self, right: &[f64], mut x: Vec<f64>, held: &[bool]) -> Vec<f64> {
        let free = |image: Vec<f64>| -> Vec<f64> {
            image.into_iter().zip(held).map(|(x, &held)| if held { 0.0 } else { x }).collect()
        };
        let image = self.apply(&x);
        let mut residual = free(right.iter().zip(image).map(|(b, image)| b - image).collect());
        let scaled =
            |r: &[f64]| -> Vec<f64> { r.iter().zip(&self.diagonal).map(|(r, d)| r / d).collect() };
        let reach = TOLERANCE * largest(&scaled(right));
        let mut z = scaled(&residual);
        let mut direction = z.clone();
        let mut energy = dot(&residual, &z);
        for _ in 0..MOST_STEPS {
            if largest(&z) <= reach {
                break;
            }
            let image = free(self.apply(&direction));
            let step = energy / dot(&direction, &image);
            for i in 0..x.len() {
                x[i] += step * direction[i];
                residual[i] -= step * image[i];
            }
            z = scaled(&residual);
            let next = dot(&residual, &z);
            let keep = next / energy;
            energy = next;
            direction.iter_mut().zip(&z).for_each(|(d, z)| *d = z + keep * *d);
        }
        x
    }

    fn apply(&self, x: &[f64]) -> Vec<f64> {
        let row = |point: usize| {
            let range = self.starts[point] as usize..self.starts[point + 1] as usize;
            let others = self.columns[range.clone()].iter().zip(&self.values[range]);
            let sum: f64 = others.map(|(&column, value)| value * x[column as usize]).sum();
            sum + self.diagonal[point] * x[point]
        };
        (0..x.len()).map(row).collect()
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, value| value.abs().max(most))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Adds `strength` · (Σ wᵢ xᵢ)² to the matrix.
fn add_square(
    entries: &mut BTreeMap<(u32, u32), f64>,
    points: &[u32],
    weights: &[f64],
    strength: f64,
) {
    for (&row, a) in points.iter().zip(weights) {
        for (&column, b) in points.iter().zip(weights) {
            *entries.entry((row, column)).or_default() += strength * a * b;
        }
    }
}

/// An inner edge: the difference of the gradients on its two sides as weights of four points.
struct Hinge {
    points: [u32; 4],
    weights: [f64; 4],
    strength: f64,
}

/// The edges that two triangles share.
fn hinges(stage: &Stage, positions: &[glam::Vec3]) -> Vec<Hinge> {
    let point = |corner: u32| stage.points.of_vertex[corner as usize];
    let place = |corner: u32| positions[corner as usize].as_dvec3();
    // Edge by points → the corners: its ends, and the one opposite.
    let mut sides: BTreeMap<(u32, u32), Vec<[u32; 3]>> = BTreeMap::new();
    let (mut area, mut lengths, mut count) = (0.0, 0.0, 0.0);
    for &[a, b, c] in &stage.triangles {
        if [a, b, c].map(point).contains(&NO_POINT) {
            continue;
        }
        area += (place(b) - place(a)).cross(place(c) - place(a)).length() / 2.0;
        for [from, to, opposite] in [[a, b, c], [b, c, a], [c, a, b]] {
            let (p, q) = (point(from), point(to));
            if p != q {
                let ends = if p < q { [from, to, opposite] } else { [to, from, opposite] };
                sides.entry((p.min(q), p.max(q))).or_default().push(ends);
            }
            lengths += (place(to) - place(from)).length();
            count += 1.0;
        }
    }
    let mean_edge = lengths / f64::max(count, 1.0);
    let mean_area = area / f64::max(count / 3.0, 1.0);
    let of = |pair: &Vec<[u32; 3]>| {
        let &[[a, b, c], [_, _, d]] = pair.as_slice() else { return None };
        let (height_c, along_c) = across(place(a), place(b), place(c))?;
        let (height_d, along_d) = across(place(a), place(b), place(d))?;
        let areas = (height_c + height_d) * (place(b) - place(a)).length() / 2.0;
        // The slope across the edge: (value − value at the foot) / height, on both sides outwards.
        let (ic, id) = (1.0 / height_c, 1.0 / height_d);
        let foot = |along: f64, inverse: f64| [(1.0 - along) * inverse, along * inverse];
        let ([ca, cb], [da, db]) = (foot(along_c, ic), foot(along_d, id));
        Some(Hinge {
            points: [point(a), point(b), point(c), point(d)],
            weights: [-ca - da, -cb - db, ic, id],
            strength: areas / mean_area * mean_edge * mean_edge,
        })
    };
    sides.values().filter_map(of).collect()
}

/// How far a corner is from an edge, and where along it its foot is, 0 to 1 from end to end.
fn across(a: DVec3, b: DVec3, corner: DVec3) -> Option<(f64, f64)> {
    let edge = b - a;
    let along = (corner - a).dot(edge) / edge.length_squared();
    let height = (corner - a - along * edge).length();
    // A sliver's gradient says nothing.
    (along.is_finite() && height > 1e-3 * edge.length()).then_some((height, along))
}
