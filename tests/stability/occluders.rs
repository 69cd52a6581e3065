//! The cases of the family `occluder`, evaluated: spheres and unions of ellipsoids at their extremes
//! against the documented formulas in f64, which see the same single-precision mesh.

use glam::{DMat3, DVec3, Quat, Vec3};
use poselight::fit::Family;
use poselight::model::occluder::ANCHORS;
use poselight::model::{Frame, Model, Occluders, PosedInput, Precision, Surface};
use poselight::num::random::Stream;
use poselight::sh::{Order, evaluate_f64};

use super::fixture::{Sizes, data, fitted, model, settings};
use super::suite::{F32, Row, row};

const POINTS: usize = 40;
const SPHERES: usize = 12;
const GROUPS: usize = 3;
/// Directions of a union.
const DIRECTIONS: usize = 256;
/// The signal where nothing blocks; what blocks is taken from it.
const FREE: f64 = 1.0;

/// A posed mesh, and what stands in the way of its points.
#[derive(Clone)]
struct Case {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    turn: Quat,
    occluders: Occluders,
}

impl Case {
    /// Points in a ball of 1 m, of which some are inside of spheres and one at a centre; two spheres are one.
    fn new(directions: usize) -> Self {
        let mut stream = Stream::new(51);
        let mut vector =
            |scale: f64| Vec3::from_array([(); 3].map(|()| (scale * stream.normal()) as f32));
        let positions: Vec<Vec3> = (0..POINTS).map(|_| vector(0.4)).collect();
        let normals = (0..POINTS).map(|_| vector(1.0).normalize()).collect();
        let mut offsets: Vec<f32> = (0..SPHERES).flat_map(|_| vector(0.2).to_array()).collect();
        let mut anchors: Vec<u32> =
            (0..SPHERES * ANCHORS).map(|i| (i * 7 % POINTS) as u32).collect();
        // The first sphere's centre is a point; the third is the second again.
        anchors[..ANCHORS].fill(5);
        offsets[..3].fill(0.0);
        anchors.copy_within(ANCHORS..2 * ANCHORS, 2 * ANCHORS);
        offsets.copy_within(3..6, 6);
        let mut radii: Vec<f32> = (0..SPHERES).map(|q| 0.05 + 0.02 * q as f32).collect();
        radii[2] = radii[1];
        let shapes = match directions {
            0 => Vec::new(),
            _ => {
                radii.iter().flat_map(|r| [1.0, 1.5, 2.0, 0.2, -0.3, 0.1].map(|x| x / r)).collect()
            }
        };
        let occluders = Occluders {
            anchors,
            offsets,
            radii,
            shapes,
            directions,
            group_of: (0..SPHERES).map(|q| (q % GROUPS) as u8).collect(),
            weights: (0..POINTS * GROUPS).map(|i| 0.1 + 0.05 * (i % 7) as f32).collect(),
        };
        // What a union leaves is in the bone's frame; that is turned nowhere here.
        let turn = if directions == 0 { Quat::from_rotation_y(0.7) } else { Quat::IDENTITY };
        Self { positions, normals, turn, occluders }
    }

    fn scaled(mut self, scale: f32) -> Self {
        self.positions.iter_mut().for_each(|p| *p *= scale);
        self.occluders.offsets.iter_mut().for_each(|x| *x *= scale);
        self.occluders.radii.iter_mut().for_each(|x| *x *= scale);
        self.occluders.shapes.iter_mut().for_each(|x| *x /= scale);
        self
    }

    fn moved(mut self, by: Vec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p += by);
        self
    }

    /// Every other point a million metres off, in its own direction: a pose that is none.
    fn torn(mut self) -> Self {
        self.positions.iter_mut().step_by(2).for_each(|p| *p *= 1e6);
        self
    }

    fn model(&self, order: usize) -> Model {
        let sizes = Sizes { poses: 3, parameters: 1, points: POINTS, coefficients: order * order };
        let mut parts = data(sizes, 52);
        // The first harmonic alone, which no turn of the bone changes.
        parts.values.fill(0.0);
        parts.values.iter_mut().step_by(order * order).for_each(|y| *y = FREE as f32);
        let fitted = fitted(&parts, &settings(Family::Mean));
        let plain = model(&parts, &fitted, Frame::Bone);
        plain.with_occluders(self.occluders.clone()).expect("occluders of the model")
    }

    fn evaluate(&self, model: &Model) -> Vec<f32> {
        let surface = Surface { positions: &self.positions, normals: &self.normals, tangents: &[] };
        let input =
            PosedInput { parameters: &[0.0], bone_rotations: &[self.turn], surface: Some(surface) };
        let mut out = vec![f32::NAN; POINTS * model.header().width()];
        model.evaluate_posed(&input, &mut out).expect("evaluates");
        out
    }

    /// From a point to the centre of a sphere.
    fn away(&self, point: usize, sphere: usize) -> DVec3 {
        let anchors = &self.occluders.anchors[sphere * ANCHORS..(sphere + 1) * ANCHORS];
        let sum: DVec3 = anchors.iter().map(|&a| self.positions[a as usize].as_dvec3()).sum();
        let offset = [0, 1, 2].map(|k| f64::from(self.occluders.offsets[sphere * 3 + k]));
        let turned = self.turn.as_dquat().normalize() * DVec3::from_array(offset);
        sum / ANCHORS as f64 + turned - self.positions[point].as_dvec3()
    }

    fn weight(&self, point: usize, sphere: usize) -> f64 {
        let group = usize::from(self.occluders.group_of[sphere]);
        f64::from(self.occluders.weights[point * GROUPS + group])
    }

    /// What the model says, in f64.
    fn reference(&self, order: usize) -> Vec<f64> {
        let mut out = Vec::new();
        for point in 0..POINTS {
            let mut row = vec![0.0; order * order];
            row[0] = FREE;
            match self.occluders.directions {
                0 => self.take_spheres(point, order, &mut row),
                _ => self.take_union(point, order, &mut row),
            }
            out.extend(row);
        }
        if order == 1 {
            out.iter_mut().for_each(|y| *y = y.clamp(0.0, 1.0));
        }
        out
    }

    fn take_spheres(&self, point: usize, order: usize, row: &mut [f64]) {
        let normal = self.normals[point].as_dvec3();
        for q in 0..SPHERES {
            let (away, radius) = (self.away(point, q), f64::from(self.occluders.radii[q]));
            let distance = (away.length_squared() + 1e-8 * radius * radius).sqrt();
            let (s, c) = ((radius / distance).min(1.0), away.dot(normal) / distance);
            let soft = (c + s).clamp(0.0, 2.0 * s);
            let seen = self.weight(point, q) * s * (0.25 * soft * soft + s * (c - s).max(0.0));
            if order == 1 {
                row[0] -= seen;
                continue;
            }
            let x = (1.0 - s * s).sqrt();
            let (mut before, mut now, mut bands) = (1.0, 1.0, Vec::new());
            for l in 0..order {
                let l = l as f64;
                let next =
                    if l == 0.0 { x } else { ((2.0 * l + 1.0) * x * now - l * before) / (l + 1.0) };
                bands.push((before - next) / (2.0 * l + 1.0));
                (before, now) = (now, next);
            }
            let mut y = vec![0.0; order * order];
            evaluate_f64(order_of(order), (away / distance).to_array(), &mut y);
            for (i, (row, y)) in row.iter_mut().zip(y).enumerate() {
                *row -= seen * bands[i.isqrt()] / bands[0] * y;
            }
        }
    }

    /// In the frame of the bone.
    fn take_union(&self, point: usize, order: usize, row: &mut [f64]) {
        let into = DMat3::from_quat(self.turn.as_dquat().normalize()).transpose();
        let normal = into * self.normals[point].as_dvec3();
        let (n, soft) = (self.occluders.directions, 6.4 / self.occluders.directions as f64);
        for i in 0..n {
            let z = 1.0 - (2 * i + 1) as f64 / n as f64;
            let azimuth = std::f64::consts::PI * (1.0 + 5.0_f64.sqrt()) * (i as f64 + 0.5);
            let r = (1.0 - z * z).sqrt();
            let direction = DVec3::new(r * azimuth.cos(), r * azimuth.sin(), z);
            let (mut through, mut taken) = (1.0, 0.0);
            for q in 0..SPHERES {
                let away = into * self.away(point, q);
                if away.dot(normal) <= -f64::from(self.occluders.radii[q]) {
                    continue;
                }
                let shape: [f64; 6] =
                    std::array::from_fn(|k| f64::from(self.occluders.shapes[q * 6 + k]));
                // At rest in the root's axes, turned with the bone: in its frame as it is.
                let [xx, yy, zz, yz, xz, xy] = shape;
                let shape = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
                let p = shape * away;
                let length = (p.length_squared() + 1e-8).sqrt();
                let (u, sine) = ((shape * direction).normalize(), (1.0 / length).min(1.0));
                let cosine = (1.0 - sine * sine).sqrt();
                let (e, h) = (cosine.min(1.0 - soft / 2.0), (2.0 * (1.0 - cosine) / soft).min(1.0));
                let covered =
                    through * h * (((p / length).dot(u) - e) / soft + 0.5).clamp(0.0, 1.0);
                through -= covered;
                taken += covered * self.weight(point, q);
            }
            let mut y = vec![1.0; order * order];
            if order > 1 {
                evaluate_f64(order_of(order), direction.to_array(), &mut y);
            }
            let share = 4.0 / n as f64 * direction.dot(normal).max(0.0) * taken;
            row.iter_mut().zip(y).for_each(|(row, y)| *row -= share * y);
        }
    }

    /// Largest difference of the model's evaluation from f64, over the largest value.
    fn deviation(&self, order: usize) -> f64 {
        let found = self.evaluate(&self.model(order));
        let expected = self.reference(order);
        let most = expected.iter().fold(0.0_f64, |most, y| most.max(y.abs()));
        largest(&found, expected.into_iter()) / most
    }
}

/// Infinite where a number is none.
fn largest(found: &[f32], expected: impl Iterator<Item = f64>) -> f64 {
    let differences = found.iter().zip(expected).map(|(&y, truth)| (f64::from(y) - truth).abs());
    differences.fold(0.0, |worst, x| if x.is_finite() { x.max(worst) } else { f64::INFINITY })
}

fn order_of(order: usize) -> Order {
    Order::new(order as u8).expect("an order")
}

/// A cap that all but fills the sky has an edge whose cosine is the root of a difference of 1 and nearly 1.
const BOUND: f64 = 1e-4;

pub(crate) fn evaluated() -> Vec<Row> {
    let mut rows = Vec::new();
    for (kind, directions) in [("spheres", 0), ("a union of ellipsoids", DIRECTIONS)] {
        let case = Case::new(directions);
        for (signal, order) in [("ao", 1), ("order 3", 3)] {
            let mut add = |name: &str, case: &Case| {
                let bound = if order == 1 && directions == 0 { 2e-5 } else { BOUND };
                let case_name = format!("{kind}, {signal}, {name}");
                rows.push(row(case_name, F32, case.deviation(order), bound));
            };
            add("points inside and two in one place", &case);
            for scale in [1e-6, 1e6] {
                add(&format!("lengths × {scale:e}"), &case.clone().scaled(scale));
            }
            for far in [1e3, 1e6] {
                add(&format!("{far:e} m from the origin"), &case.clone().moved(Vec3::splat(far)));
            }
            let far = case.clone().scaled(1e-6).moved(Vec3::X);
            add("lengths × 1e-6, 1 m from the origin", &far);
            add("half of the points 1e6 m away", &case.clone().torn());
        }
        let case_name = format!("{kind}, order 10");
        rows.push(row(case_name, F32, case.deviation(10), BOUND));
        rows.extend(blobs(kind, &case));
    }
    rows
}

/// What storing adds, at every size of the mesh: weights are rounded, lengths are not.
fn blobs(kind: &str, case: &Case) -> Vec<Row> {
    let mut rows = Vec::new();
    for scale in [1.0, 1e-6, 1e6] {
        let case = case.clone().scaled(scale);
        let exact = case.model(3);
        let before = case.evaluate(&exact);
        for (precision, bound) in [(Precision::F16, 2e-3), (Precision::I8, 2e-2)] {
            let bytes = exact.to_bytes(precision).expect("a blob");
            let after = case.evaluate(&Model::from_bytes(&bytes).expect("a model"));
            let added = largest(&after, before.iter().map(|&y| f64::from(y)));
            let name = format!("{kind}, {precision}, lengths × {scale:e}");
            rows.push(row(name, "largest error that storing adds", added, bound));
        }
    }
    rows
}
