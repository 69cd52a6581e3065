//! Turning a data set's coefficients from the root frame into each point's bone frame.

use glam::Quat;
use rayon::prelude::*;

use super::Error;
use crate::dataset::Training;
use crate::num::linalg::{multiply, rows_of, rows_of_mut};
use crate::sh::{Order, Rotation};

/// Bytes of rotation matrices that are kept, at most; beyond that they are made anew for every
/// block of points.
const KEPT_BYTES: usize = 256 << 20;

/// The inverse rotation of every (pose, bone), for coefficients of one order.
#[derive(Debug)]
pub(super) struct BoneFrame<'a> {
    order: Order,
    /// `[pose, bone]`.
    rotations: &'a [Quat],
    bones: usize,
    point_bones: &'a [u16],
    /// `[pose, bone]`, each the bands' matrices one after another, transposed; empty where they
    /// would take too much memory.
    kept: Vec<f32>,
}

impl<'a> BoneFrame<'a> {
    /// `None` where turning changes nothing: scalars have no direction.
    pub(super) fn new(training: &'a Training<'_>) -> Result<Option<Self>, Error> {
        let found = training.coefficients();
        if found == 1 {
            return Ok(None);
        }
        let order = order_of(training)?;
        let (rotations, bones) = (training.bone_rotations(), training.bones());
        let broken = |q: &Quat| !(q.is_finite() && q.length_squared() > 0.0);
        if let Some(at) = rotations.iter().position(broken) {
            let (bone, pose) = (at % bones, at / bones);
            return Err(Error::Rotation { bone, pose, found: rotations[at].to_array() });
        }
        let point_bones = training.point_bones();
        let mut this = Self { order, rotations, bones, point_bones, kept: Vec::new() };
        let size = numbers_below(order.bands());
        if rotations.len() * size * size_of::<f32>() <= KEPT_BYTES {
            let mut kept = vec![0.0; rotations.len() * size];
            let pairs = kept.par_chunks_exact_mut(size).zip(rotations);
            pairs.for_each(|(out, rotation)| write_matrices(order, rotation.conjugate(), out));
            this.kept = kept;
        }
        Ok(Some(this))
    }

    /// Turns `values` `[pose, point, channel, coefficient]` of the points from `first` on.
    pub(super) fn turn(
        &self,
        first: usize,
        values: &mut [f32],
        points: usize,
        scratch: &mut Scratch,
    ) {
        let poses = self.rotations.len() / self.bones;
        let n = self.order.coefficients();
        let per_point = values.len() / (poses * points);
        let groups = self.points_by_bone(first, points);
        scratch.resize(n, points * per_point);
        let size = numbers_below(self.order.bands());
        let mut made = [0.0; MOST_NUMBERS];
        for (pose, values) in values.chunks_exact_mut(points * per_point).enumerate() {
            for (bone, members) in &groups {
                let pair = pose * self.bones + bone;
                let matrices = match self.kept.get(pair * size..(pair + 1) * size) {
                    Some(kept) => kept,
                    None => {
                        let inverse = self.rotations[pair].conjugate();
                        write_matrices(self.order, inverse, &mut made[..size]);
                        &made[..size]
                    }
                };
                scratch.expand(self.order, matrices);
                scratch.turn(values, members, per_point, n);
            }
        }
    }

    /// Indices of the points from `first` on, relative to it, by their bone.
    fn points_by_bone(&self, first: usize, points: usize) -> Vec<(usize, Vec<usize>)> {
        let bones = &self.point_bones[first..first + points];
        let mut groups: Vec<(usize, Vec<usize>)> = Vec::new();
        for (point, &bone) in bones.iter().enumerate() {
            let bone = usize::from(bone);
            match groups.iter_mut().find(|(other, _)| *other == bone) {
                Some((_, members)) => members.push(point),
                None => groups.push((bone, vec![point])),
            }
        }
        groups
    }
}

/// The order of the harmonics that the data are.
pub(super) fn order_of(training: &Training<'_>) -> Result<Order, Error> {
    let found = training.coefficients();
    let order = u8::try_from(found.isqrt()).ok().and_then(|bands| Order::new(bands).ok());
    order.filter(|order| order.coefficients() == found).ok_or(Error::Harmonics { found })
}

/// Numbers in the matrices of all bands below the `bands`-th, Σ (2l+1)².
fn numbers_below(bands: usize) -> usize {
    (4 * bands.pow(3) - bands) / 3
}

/// [`numbers_below`] of the highest order, 10.
const MOST_NUMBERS: usize = 1330;

/// The rotation's matrices, band after band, each transposed: its rows are the rotation's columns.
/// Bands do not mix, so column j of every band comes from one application to a vector that has a
/// 1 at j in each of them.
fn write_matrices(order: Order, rotation: Quat, out: &mut [f32]) {
    let rotation = Rotation::new(order, rotation);
    let n = order.coefficients();
    let (mut ones, mut column) = ([0.0; 100], [0.0; 100]);
    for j in 0..2 * order.bands() - 1 {
        ones[..n].fill(0.0);
        let bands = j.div_ceil(2)..order.bands();
        bands.clone().for_each(|l| ones[l * l + j] = 1.0);
        rotation.apply(&ones[..n], &mut column[..n]);
        for l in bands {
            let (width, start) = (2 * l + 1, numbers_below(l));
            out[start + j * width..][..width].copy_from_slice(&column[l * l..(l + 1) * (l + 1)]);
        }
    }
}

/// Memory that is used again for every pose and bone.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Transposed: column i of the rotation is row i.
    matrix: Vec<f32>,
    inputs: Vec<f32>,
    outputs: Vec<f32>,
}

impl Scratch {
    fn resize(&mut self, n: usize, values: usize) {
        self.matrix.clear();
        self.matrix.resize(n * n, 0.0);
        self.inputs.resize(values, 0.0);
        self.outputs.resize(values, 0.0);
    }

    /// Writes the bands' matrices into the dense one, whose other entries stay 0.
    fn expand(&mut self, order: Order, matrices: &[f32]) {
        let n = order.coefficients();
        let mut rest = matrices;
        for l in 0..order.bands() {
            for row in l * l..(l + 1) * (l + 1) {
                let (band, after) = rest.split_at(2 * l + 1);
                self.matrix[row * n + l * l..][..band.len()].copy_from_slice(band);
                rest = after;
            }
        }
    }

    fn turn(&mut self, values: &mut [f32], members: &[usize], per_point: usize, n: usize) {
        let count = members.len() * per_point;
        let (inputs, outputs) = (&mut self.inputs[..count], &mut self.outputs[..count]);
        for (input, &point) in inputs.chunks_exact_mut(per_point).zip(members) {
            input.copy_from_slice(&values[point * per_point..][..per_point]);
        }
        let rows = count / n;
        multiply(
            rows_of_mut(outputs, rows, n),
            rows_of(inputs, rows, n),
            rows_of(&self.matrix, n, n),
        );
        for (output, &point) in outputs.chunks_exact(per_point).zip(members) {
            values[point * per_point..][..per_point].copy_from_slice(output);
        }
    }
}
