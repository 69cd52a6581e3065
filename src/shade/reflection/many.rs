//! Many points at once: a point in each lane of a vector, the same operations for all of them.

use glam::{Mat3, Vec3};

use super::Reflector;
use crate::num::cpu::Isa;
use crate::num::kernels::{Task, perform};
use crate::sh::{Order, evaluate_lanes};
use crate::shade::ZonalLight;

/// Points that are shaded together.
const LANES: usize = 16;

/// A number of each.
type Lanes = [f32; LANES];

/// Points to be shaded, each in its own tangent frame.
#[derive(Debug, Clone, Copy)]
pub struct ShadedPoints<'a> {
    /// From the light's frame into the point's.
    pub to_local: &'a [Mat3],
    /// Unit, towards the viewer, in the point's frame.
    pub outgoing: &'a [Vec3],
    /// `[point][coefficient]`, in the point's frame.
    pub visibility: &'a [f32],
}

/// What one block of points works in.
struct Scratch {
    y: Vec<Lanes>,
    light: [Vec<Lanes>; 3],
    visibility: Vec<Lanes>,
    transfer: Vec<Lanes>,
    strengths: Vec<Lanes>,
}

impl Reflector {
    /// Radiance of every point under a light of lobes: [`ZonalLight::in_frame`] and [`Reflector::shade`]
    /// to rounding, several times as fast.
    ///
    /// # Panics
    /// If the lengths do not agree, or the light is of another order.
    pub fn shade_points(
        &self,
        isa: Isa,
        lobes: &ZonalLight,
        points: ShadedPoints<'_>,
        out: &mut [[f32; 3]],
    ) {
        let count = self.order().coefficients();
        assert_eq!(lobes.order(), self.order(), "orders of light and operator");
        let lengths =
            [points.to_local.len(), points.outgoing.len(), points.visibility.len() / count];
        assert_eq!(lengths, [out.len(); 3], "points");
        let lanes = || vec![[0.0; LANES]; count];
        let mut scratch = Scratch {
            y: lanes(),
            light: [lanes(), lanes(), lanes()],
            visibility: lanes(),
            transfer: lanes(),
            strengths: vec![[0.0; LANES]; self.header().terms],
        };
        for (block, out) in out.chunks_mut(LANES).enumerate() {
            let range = block * LANES..block * LANES + out.len();
            let part = ShadedPoints {
                to_local: &points.to_local[range.clone()],
                outgoing: &points.outgoing[range.clone()],
                visibility: &points.visibility[range.start * count..range.end * count],
            };
            let scratch = &mut scratch;
            perform(isa, Block { reflector: self, lobes, points: part, scratch, out });
        }
    }
}

/// At most [`LANES`] points.
struct Block<'a> {
    reflector: &'a Reflector,
    lobes: &'a ZonalLight,
    points: ShadedPoints<'a>,
    scratch: &'a mut Scratch,
    out: &'a mut [[f32; 3]],
}

impl Task for Block<'_> {
    type Output = ();

    #[inline(always)]
    fn perform(self) {
        let Self { reflector, lobes, points, scratch, out } = self;
        let order = reflector.order();
        let count = order.coefficients();
        light_in_frames(lobes, points.to_local, scratch);
        for (i, lanes) in scratch.visibility.iter_mut().enumerate() {
            for (lane, row) in points.visibility.chunks_exact(count).enumerate() {
                lanes[lane] = row[i];
            }
        }
        let mut axes = [[0.0; LANES]; 3];
        for (lane, direction) in points.outgoing.iter().enumerate() {
            [axes[0][lane], axes[1][lane], axes[2][lane]] = direction.to_array();
        }
        evaluate_lanes(order, &axes, &mut scratch.y);
        let mut lit = [[0.0; LANES]; 3];
        for (c, lit) in lit.iter_mut().enumerate() {
            if let Some((view, matrices)) = reflector.channel(c) {
                strengths(view, &scratch.y, &mut scratch.strengths);
                transfer(matrices, scratch);
            }
            for (t, l) in scratch.transfer.iter().zip(&scratch.light[c]) {
                for lane in 0..LANES {
                    lit[lane] += t[lane] * l[lane];
                }
            }
        }
        for (lane, out) in out.iter_mut().enumerate() {
            let is_seen = axes[2][lane] > 0.0;
            *out = if is_seen { lit.map(|colour| colour[lane]) } else { [0.0; 3] };
        }
    }
}

/// The light's coefficients in the frame of every lane.
#[inline(always)]
fn light_in_frames(lobes: &ZonalLight, to_local: &[Mat3], scratch: &mut Scratch) {
    let order: Order = lobes.order();
    scratch.light.iter_mut().for_each(|colour| colour.fill([0.0; LANES]));
    for lobe in lobes.lobes() {
        let axis = Vec3::from(lobe.axis.map(|x| x as f32));
        let mut axes = [[0.0; LANES]; 3];
        for (lane, frame) in to_local.iter().enumerate() {
            [axes[0][lane], axes[1][lane], axes[2][lane]] = (*frame * axis).to_array();
        }
        evaluate_lanes(order, &axes, &mut scratch.y);
        for (colour, bands) in scratch.light.iter_mut().zip(&lobe.bands) {
            for (l, z) in bands.iter().enumerate().take(order.bands()) {
                let (z, band) = (*z as f32, l * l..(l + 1) * (l + 1));
                for (sum, y) in colour[band.clone()].iter_mut().zip(&scratch.y[band]) {
                    sum.iter_mut().zip(y).for_each(|(sum, y)| *sum += z * y);
                }
            }
        }
    }
}

/// s_b = w_b · y(ω_o).
#[inline(always)]
fn strengths(view: &[f32], y: &[Lanes], out: &mut [Lanes]) {
    for (out, row) in out.iter_mut().zip(view.chunks_exact(y.len())) {
        let mut sum = [0.0; LANES];
        for (w, y) in row.iter().zip(y) {
            for lane in 0..LANES {
                sum[lane] += w * y[lane];
            }
        }
        *out = sum;
    }
}

/// t_i = Σ_j v_j Σ_b s_b M_b,ij, the matrices transposed.
#[inline(always)]
fn transfer(matrices: &[f32], scratch: &mut Scratch) {
    let count = scratch.y.len();
    scratch.transfer.fill([0.0; LANES]);
    for (j, v) in scratch.visibility.iter().enumerate() {
        for (i, t) in scratch.transfer.iter_mut().enumerate() {
            let mut sum = [0.0; LANES];
            let entries = matrices[j * count + i..].iter().step_by(count * count);
            for (m, s) in entries.zip(&scratch.strengths) {
                for lane in 0..LANES {
                    sum[lane] += m * s[lane];
                }
            }
            for lane in 0..LANES {
                t[lane] += v[lane] * sum[lane];
            }
        }
    }
}

#[cfg(all(test, feature = "bake"))]
mod tests {
    use glam::Quat;

    use super::super::factor;
    use super::*;
    use crate::shade::{Brdf, ShLight};

    /// Any number of points is shaded as each alone, in one colour and in three, at every instruction
    /// set; what is looked at from below is black.
    #[test]
    fn many_points_are_shaded_as_each_alone() {
        for (bands, reflectance) in [(4, [0.5; 3]), (3, [0.9, 0.5, 0.1])] {
            let n = Order::new(bands).unwrap();
            let brdf = Brdf::Ggx { normal_reflectance: reflectance, alpha: [0.5; 2] };
            let operators = factor(&brdf, n, 16).unwrap().map(|colour| colour.operator(5));
            let reflector = Reflector::new("ggx", &operators, [0.0; 3]);
            let mut light = ShLight::cone(n, [0.3, 1.0, 0.2], 0.4, [3.0, 2.5, 2.0]).unwrap();
            light.add(&ShLight::constant(n, [0.1, 0.2, 0.3]).unwrap());
            let lobes = ZonalLight::fit(&light, 3);
            let (count, number) = (n.coefficients(), 37);
            let frame = |k: usize| Mat3::from_quat(Quat::from_rotation_y(k as f32 * 0.7));
            let to_local: Vec<Mat3> = (0..number).map(frame).collect();
            let view = |k: usize| {
                let angle = k as f32 * 0.6;
                Vec3::new(angle.sin(), 0.3, 0.7 * (k as f32).cos() + 0.3).normalize()
            };
            let outgoing: Vec<Vec3> = (0..number).map(view).collect();
            let visibility: Vec<f32> =
                (0..count * number).map(|i| (i as f32 * 0.37).sin()).collect();
            let points =
                ShadedPoints { to_local: &to_local, outgoing: &outgoing, visibility: &visibility };
            for isa in Isa::available() {
                let mut found = vec![[0.0; 3]; number];
                reflector.shade_points(isa, &lobes, points, &mut found);
                for k in 0..number {
                    let mut own = [[0.0; 16]; 3];
                    let [r, g, b] = &mut own;
                    lobes.in_frame(to_local[k], [r, g, b]);
                    let v = &visibility[k * count..][..count];
                    let expected = reflector.shade(v, [&own[0], &own[1], &own[2]], outgoing[k]);
                    for (a, b) in found[k].iter().zip(expected) {
                        assert!((a - b).abs() < 2e-5, "{k}: {:?} {expected:?}", found[k]);
                    }
                }
            }
            assert!(outgoing.iter().any(|o| o.z <= 0.0));
        }
    }
}
