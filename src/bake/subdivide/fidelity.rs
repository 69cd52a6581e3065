//! The error that interpolation really makes: against transfer baked at places between vertices.

use std::sync::atomic::AtomicBool;

use super::{Leaf, Row, Source};
use crate::bake::{Error, Place};
use crate::num::random::{hash, unit};

/// Places spread evenly over a surface, with their transfer: the truth that meshes are compared by.
#[derive(Debug, Clone, PartialEq)]
pub struct Probes {
    places: Vec<Place>,
    /// The area that each stands for.
    areas: Vec<f32>,
    rows: Vec<Row>,
}

/// How wrong interpolation is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fidelity {
    /// √ of the mean over the surface and the views of ‖t − t'‖² less what noise is expected to add to
    /// it, at the vertices Σ w² σ² and at the places σ²: the L² error of the interpolation alone.
    pub rms: f32,
    /// The same with the noise.
    pub with_noise: f32,
    /// The largest ‖t − t'‖, with its noise.
    pub most: f32,
    /// In which of the mesh's triangles that is, by index.
    pub worst: usize,
}

/// Keeps the probes' random streams apart from those of vertices.
const FIRST_NUMBER: u64 = 1 << 40;

impl Probes {
    /// About so many places by area (`areas` of the input's triangles), each triangle's number drawn,
    /// so that small ones are not counted too much; baked by `source`.
    ///
    /// # Errors
    /// What the source objects to.
    pub fn new(
        areas: &[f32],
        count: usize,
        seed: u64,
        source: &dyn Source,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let whole: f64 = areas.iter().copied().map(f64::from).sum();
        let each = whole / count.max(1) as f64;
        let mut places = Vec::with_capacity(count);
        // Stratified over the area: one place in each of `count` equal steps of its running sum.
        let (mut before, mut step) = (0.0, 0_u64);
        for (triangle, &area) in (0_u32..).zip(areas) {
            let after = before + f64::from(area);
            while (step as f64 + unit(hash(&[seed, step, 0]))) * each < after && step < count as u64
            {
                places.push(Place { triangle, weights: draw(seed, step) });
                step += 1;
            }
            before = after;
        }
        let areas = vec![each as f32; places.len()];
        let numbers: Vec<u64> = (FIRST_NUMBER..).take(places.len()).collect();
        let rows = source.look(&places, &numbers, stop)?;
        Ok(Self { places, areas, rows })
    }

    /// How many there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.places.len()
    }

    /// √ of the mean of Σ over the coefficients of the squares of their standard errors: no error below
    /// this can be told from noise.
    #[must_use]
    pub fn noise(&self) -> f32 {
        let all = || self.rows.iter().flat_map(|row| &row.variances);
        let sum: f64 = all().copied().map(f64::from).sum();
        (sum / all().count().max(1) as f64).sqrt() as f32
    }

    /// The error of a mesh whose triangles, by root, interpolate `rows`.
    #[must_use]
    pub fn compare(&self, triangles: &[Leaf], rows: &[Row]) -> Fidelity {
        let (mut squares, mut noises, mut areas) = (0.0, 0.0, 0.0);
        let mut fidelity = Fidelity { rms: 0.0, with_noise: 0.0, most: 0.0, worst: 0 };
        for ((place, truth), &area) in self.places.iter().zip(&self.rows).zip(&self.areas) {
            let first = triangles.partition_point(|leaf| leaf.root < place.triangle);
            let own = triangles[first..].iter().take_while(|leaf| leaf.root == place.triangle);
            let found = (first..).zip(own).map(|(i, leaf)| (i, leaf, within(leaf, place.weights)));
            // The one that it lies in most deeply: rounding leaves no place outside.
            let depth = |w: &[f32; 3]| w.iter().copied().fold(f32::INFINITY, f32::min);
            let Some((index, leaf, weights)) =
                found.max_by(|a, b| depth(&a.2).total_cmp(&depth(&b.2)))
            else {
                continue;
            };
            let corners = leaf.corners.map(|vertex| &rows[vertex as usize]);
            let ends = corners.map(|row| &row.transfer[..]);
            let views = truth.normals.len();
            let width = truth.transfer.len() / views.max(1);
            for view in 0..views {
                let square = |i: usize| {
                    let mixed: f32 = ends.iter().zip(weights).map(|(end, w)| w * end[i]).sum();
                    f64::from(mixed - truth.transfer[i]).powi(2)
                };
                let error: f64 = (view * width..(view + 1) * width).map(square).sum();
                let noise = |(row, w): (&Row, f32)| w * w * row.variances[view];
                let noise: f32 = corners.into_iter().zip(weights).map(noise).sum();
                noises += f64::from((noise + truth.variances[view]) * area);
                squares += error * f64::from(area);
                areas += f64::from(area);
                if error.sqrt() as f32 > fidelity.most {
                    (fidelity.most, fidelity.worst) = (error.sqrt() as f32, index);
                }
            }
        }
        if areas > 0.0 {
            fidelity.with_noise = (squares / areas).sqrt() as f32;
            // Where noise is all there is, its estimate may be the larger.
            fidelity.rms = ((squares - noises).max(0.0) / areas).sqrt() as f32;
        }
        fidelity
    }
}

/// A place of a triangle, evenly by area.
fn draw(seed: u64, step: u64) -> [f32; 3] {
    let [u, v] = [1, 2].map(|axis| unit(hash(&[seed, step, axis])));
    let root = u.sqrt();
    [1.0 - root, root * (1.0 - v), root * v].map(|weight| weight as f32)
}

/// Weights of a leaf's corners at a place of its root.
fn within(leaf: &Leaf, at: [f32; 3]) -> [f32; 3] {
    let [a, b, c] = leaf.at;
    let cross = |p: [f32; 3], q: [f32; 3], r: [f32; 3]| {
        (q[1] - p[1]) * (r[2] - p[2]) - (q[2] - p[2]) * (r[1] - p[1])
    };
    let whole = cross(a, b, c);
    [cross(at, b, c) / whole, cross(a, at, c) / whole, cross(a, b, at) / whole]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Transfer that is a polynomial of the place.
    #[derive(Debug)]
    struct Field(fn([f32; 3]) -> f32);

    impl Source for Field {
        fn look(&self, places: &[Place], _: &[u64], _: &AtomicBool) -> Result<Vec<Row>, Error> {
            let one = |place: &Place| {
                let transfer = vec![(self.0)(place.weights)];
                Row { transfer, normals: vec![glam::Vec3::Z], variances: vec![0.0] }
            };
            Ok(places.iter().map(one).collect())
        }
    }

    fn leaf(at: [[f32; 3]; 3]) -> Leaf {
        Leaf { corners: [0, 1, 2], root: 0, at, depth: 0 }
    }

    const WHOLE: [[f32; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    fn compare(field: fn([f32; 3]) -> f32) -> Fidelity {
        let stop = AtomicBool::new(false);
        let probes = Probes::new(&[2.0], 20_000, 1, &Field(field), &stop).unwrap();
        assert_eq!(probes.count(), 20_000);
        let place = |weights| Place { triangle: 0, weights };
        let rows = Field(field).look(&WHOLE.map(place), &[0; 3], &stop).unwrap();
        probes.compare(&[leaf(WHOLE)], &rows)
    }

    /// A linear function is interpolated exactly; 4 λ₀ λ₁ lacks itself, whose mean square is
    /// 16 · 2! · 2! · 2 / 6! = 8/45 and whose largest value is 1.
    #[test]
    fn the_error_is_that_of_interpolation() {
        assert!(compare(|w| 3.0 * w[0] - w[1]).rms < 1e-6);
        let bubble = compare(|w| 4.0 * w[0] * w[1]);
        assert!((bubble.rms - (8.0_f32 / 45.0).sqrt()).abs() < 0.005, "{bubble:?}");
        assert!((0.99..=1.0).contains(&bubble.most), "{bubble:?}");
    }

    /// Constant transfer with noise of variance 1/100 in each of 400 numbers.
    #[derive(Debug)]
    struct Noisy;

    impl Source for Noisy {
        fn look(&self, _: &[Place], numbers: &[u64], _: &AtomicBool) -> Result<Vec<Row>, Error> {
            let one = |&number: &u64| {
                let mut random = crate::num::random::Stream::new(number);
                let transfer = (0..400).map(|_| 1.0 + 0.1 * random.normal() as f32).collect();
                Row { transfer, normals: vec![glam::Vec3::Z], variances: vec![4.0] }
            };
            Ok(numbers.iter().map(one).collect())
        }
    }

    /// Of noise alone nothing is left: its square is 400 (1 + ½) / 100, for the squares of the weights
    /// have the mean ½; what is taken off agrees with it to the few hundredths that 1,200 draws at the
    /// corners leave.
    #[test]
    fn noise_is_taken_off() {
        let stop = AtomicBool::new(false);
        let probes = Probes::new(&[1.0], 2000, 1, &Noisy, &stop).unwrap();
        let rows = Noisy.look(&[], &[0, 1, 2], &stop).unwrap();
        let found = probes.compare(&[leaf(WHOLE)], &rows);
        assert!((found.with_noise - 6.0_f32.sqrt()).abs() < 0.05, "{found:?}");
        assert!(found.rms < 0.5, "{found:?}");
    }

    /// A place has the weights of the triangle it lies in, turned triangles included.
    #[test]
    fn places_are_found_in_their_triangles() {
        let inner = leaf([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]]);
        let [a, b, c] = within(&inner, [1.0 / 3.0; 3]);
        assert!([a, b, c].iter().all(|w| (w - 1.0 / 3.0).abs() < 1e-6));
        assert!(within(&inner, [0.9, 0.05, 0.05])[1] < 0.0);
    }
}
