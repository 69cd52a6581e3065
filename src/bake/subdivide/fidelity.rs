//! The error that interpolation really makes: against transfer baked at places between vertices.

use std::sync::atomic::AtomicBool;

use super::{Leaf, Row, Source};
use crate::bake::{Error, Place};
use crate::num::random::{hash, unit};

/// Places spread over a surface, with their transfer: the truth that meshes are compared by.
#[derive(Debug, Clone, PartialEq)]
pub struct Probes {
    places: Vec<Place>,
    /// The area that each stands for.
    areas: Vec<f64>,
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

/// What one place finds, summed over its views.
#[derive(Debug, Clone, Copy)]
struct Found {
    /// The mesh's triangle, by index.
    triangle: usize,
    /// Σ ‖t − t'‖².
    squares: f64,
    /// What noise is expected to add to that.
    noise: f64,
    /// The largest ‖t − t'‖².
    most: f64,
}

/// Of so many places one is the pilot's.
const PILOT_SHARE: usize = 4;

/// The pilot's places in one stratum.
const PILOTS: usize = 8;

/// Keep the probes' random streams apart from those of vertices, and the pilot's from the others'.
const FIRST_NUMBER: u64 = 1 << 40;
const FIRST_PILOT: u64 = 1 << 41;

impl Probes {
    /// So many places of a surface whose input triangles have these `areas`, baked by `source`.
    ///
    /// A quarter is a pilot, even by area: it finds in which strata, stretches of equal area in the
    /// order of the triangles, the mesh as it is (`given`: its triangles, and what they interpolate)
    /// is wrong. The others, which alone are kept, go to the strata half evenly and half by that
    /// error, and each stands for its share of its stratum: whatever the pilot found, the mean over
    /// them is that over the surface.
    ///
    /// # Errors
    /// What the source objects to.
    pub fn new(
        areas: &[f32],
        given: (&[Leaf], &[Row]),
        (count, seed): (usize, u64),
        source: &dyn Source,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let strata = (count / PILOT_SHARE / PILOTS).max(1);
        let pilots = vec![PILOTS; strata];
        let pilot = Self::spread(areas, &pilots, (FIRST_PILOT, seed), source, stop)?;
        let wrong = |places: &[Found]| places.iter().map(|found| found.squares).sum::<f64>();
        let errors: Vec<f64> = pilot.found(given.0, given.1).chunks(PILOTS).map(wrong).collect();
        let rest = count.saturating_sub(strata * PILOTS).max(strata);
        Self::spread(areas, &shares(&errors, rest), (FIRST_NUMBER, seed), source, stop)
    }

    /// So many places in each stratum, evenly by area.
    fn spread(
        areas: &[f32],
        counts: &[usize],
        (first_number, seed): (u64, u64),
        source: &dyn Source,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let whole: f64 = areas.iter().copied().map(f64::from).sum();
        let stratum = whole / counts.len() as f64;
        let mut places = Vec::new();
        let mut stands_for = Vec::new();
        // The triangle that the running sum is in, and the sum before it.
        let (mut triangle, mut before) = (0, 0.0);
        for (index, &count) in counts.iter().enumerate() {
            for step in 0..count {
                let number = first_number + places.len() as u64;
                let within = (step as f64 + unit(hash(&[seed, number, 0]))) / count as f64;
                let at = (index as f64 + within) * stratum;
                while triangle + 1 < areas.len() && before + f64::from(areas[triangle]) <= at {
                    before += f64::from(areas[triangle]);
                    triangle += 1;
                }
                let weights = draw(seed, number);
                places.push(Place { triangle: triangle as u32, weights });
                stands_for.push(stratum / count as f64);
            }
        }
        let numbers: Vec<u64> = (first_number..).take(places.len()).collect();
        let rows = source.look(&places, &numbers, stop)?;
        Ok(Self { places, areas: stands_for, rows })
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
        let mut worst = (0.0, 0);
        let found = self.found(triangles, rows);
        for ((found, truth), &area) in found.iter().zip(&self.rows).zip(&self.areas) {
            squares += found.squares * area;
            noises += found.noise * area;
            areas += truth.normals.len() as f64 * area;
            if found.most > worst.0 {
                worst = (found.most, found.triangle);
            }
        }
        let areas = if areas > 0.0 { areas } else { 1.0 };
        Fidelity {
            // Where noise is all there is, its estimate may be the larger.
            rms: ((squares - noises).max(0.0) / areas).sqrt() as f32,
            with_noise: (squares / areas).sqrt() as f32,
            most: worst.0.sqrt() as f32,
            worst: worst.1,
        }
    }

    /// What each place finds of a mesh.
    fn found(&self, triangles: &[Leaf], rows: &[Row]) -> Vec<Found> {
        let one = |(place, truth): (&Place, &Row)| {
            let (triangle, weights) = leaf_at(triangles, place);
            let corners = triangles[triangle].corners.map(|vertex| &rows[vertex as usize]);
            let ends = corners.map(|row| &row.transfer[..]);
            let views = truth.normals.len();
            let width = truth.transfer.len() / views.max(1);
            let mut found = Found { triangle, squares: 0.0, noise: 0.0, most: 0.0 };
            for view in 0..views {
                let square = |i: usize| {
                    let mixed: f32 = ends.iter().zip(weights).map(|(end, w)| w * end[i]).sum();
                    f64::from(mixed - truth.transfer[i]).powi(2)
                };
                let error: f64 = (view * width..(view + 1) * width).map(square).sum();
                let noise = |(row, w): (&Row, f32)| w * w * row.variances[view];
                let noise: f32 = corners.into_iter().zip(weights).map(noise).sum();
                found.squares += error;
                found.noise += f64::from(noise + truth.variances[view]);
                found.most = found.most.max(error);
            }
            found
        };
        self.places.iter().zip(&self.rows).map(one).collect()
    }
}

/// So many places dealt to strata, half evenly and half by their errors; each has one at least.
fn shares(errors: &[f64], count: usize) -> Vec<usize> {
    let sum: f64 = errors.iter().sum();
    let even = 1.0 / errors.len() as f64;
    let one = |error: &f64| {
        let own = if sum > 0.0 { error / sum } else { even };
        ((count as f64 * (even + own) / 2.0).round() as usize).max(1)
    };
    errors.iter().map(one).collect()
}

/// The triangle that a place lies in, of those that come by root, and its weights there.
fn leaf_at(triangles: &[Leaf], place: &Place) -> (usize, [f32; 3]) {
    let first = triangles.partition_point(|leaf| leaf.root < place.triangle);
    let own = triangles[first..].iter().take_while(|leaf| leaf.root == place.triangle);
    let found = (first..).zip(own).map(|(i, leaf)| (i, within(leaf, place.weights)));
    // The one that it lies in most deeply: rounding leaves no place outside.
    let depth = |w: &[f32; 3]| w.iter().copied().fold(f32::INFINITY, f32::min);
    let deepest = found.max_by(|a, b| depth(&a.1).total_cmp(&depth(&b.1)));
    deepest.expect("each triangle of the input has its parts")
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
        let place = |weights| Place { triangle: 0, weights };
        let rows = Field(field).look(&WHOLE.map(place), &[0; 3], &stop).unwrap();
        let given = (&[leaf(WHOLE)][..], &rows[..]);
        let probes = Probes::new(&[2.0], given, (40_000, 1), &Field(field), &stop).unwrap();
        assert!((29_000..=31_000).contains(&probes.count()), "{}", probes.count());
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
        let rows = Noisy.look(&[], &[0, 1, 2], &stop).unwrap();
        let given = (&[leaf(WHOLE)][..], &rows[..]);
        let probes = Probes::new(&[1.0], given, (2000, 1), &Noisy, &stop).unwrap();
        let found = probes.compare(&[leaf(WHOLE)], &rows);
        assert!((found.with_noise - 6.0_f32.sqrt()).abs() < 0.05, "{found:?}");
        assert!(found.rms < 0.5, "{found:?}");
    }

    /// 1 in the first of a hundred triangles, but 0 at its corners; 0 in the others.
    #[derive(Debug)]
    struct Spike;

    impl Source for Spike {
        fn look(&self, places: &[Place], _: &[u64], _: &AtomicBool) -> Result<Vec<Row>, Error> {
            let one = |place: &Place| {
                let within = place.triangle == 0 && place.weights.iter().all(|&w| w < 1.0);
                let transfer = vec![if within { 1.0 } else { 0.0 }];
                Row { transfer, normals: vec![glam::Vec3::Z], variances: vec![0.0] }
            };
            Ok(places.iter().map(one).collect())
        }
    }

    /// An error in a hundredth of the surface gets near half of the places, and is weighed by its area all
    /// the same: √(1/100), within a few hundredths where even places would be off by a fifth.
    #[test]
    fn places_go_where_the_error_is_and_stay_unbiased() {
        let stop = AtomicBool::new(false);
        let triangles: Vec<Leaf> = (0..100)
            .map(|root| Leaf {
                corners: [3 * root, 3 * root + 1, 3 * root + 2],
                root,
                ..leaf(WHOLE)
            })
            .collect();
        let corners = triangles
            .iter()
            .flat_map(|leaf| WHOLE.map(|weights| Place { triangle: leaf.root, weights }));
        let rows = Spike.look(&corners.collect::<Vec<_>>(), &[], &stop).unwrap();
        for seed in 0..10 {
            let given = (&triangles[..], &rows[..]);
            let probes = Probes::new(&[1.0; 100], given, (2000, seed), &Spike, &stop).unwrap();
            let there = probes.places.iter().filter(|place| place.triangle == 0).count();
            assert!(there > probes.count() / 5, "{there} of {}", probes.count());
            let found = probes.compare(&triangles, &rows).rms;
            assert!((found - 0.1).abs() < 0.01, "{found}");
        }
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
