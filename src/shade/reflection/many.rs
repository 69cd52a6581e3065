//! Many points at once: a point in each lane of a vector, the same operations for all of them.
//!
//! All M_b v of a block of points are one matrix product, which the model's kernels do; the rest are
//! plain loops over the lanes.

use glam::{Mat3, Vec3};

use super::Reflector;
use crate::num::cpu::Isa;
use crate::num::kernels::{Layout, Task, multiply, perform};
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
    /// `[b][i]`: M_b v.
    products: Vec<Lanes>,
    /// `[channel][b]`: w_b · y(ω_o).
    strengths: Vec<Lanes>,
}

impl Scratch {
    fn new(order: Order, terms: usize, channels: usize) -> Self {
        let lanes = |count: usize| vec![[0.0; LANES]; count];
        let count = order.coefficients();
        Self {
            y: lanes(count),
            light: [lanes(count), lanes(count), lanes(count)],
            visibility: lanes(count),
            products: lanes(terms * count),
            strengths: lanes(channels * terms),
        }
    }
}

impl Reflector {
    /// Radiance of every point under a light of lobes: [`ZonalLight::in_frame`] and [`Reflector::shade`]
    /// to rounding, many times as fast.
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
        let (terms, channels) = (self.header().terms, self.header().channels);
        let mut scratch = Scratch::new(self.order(), terms, channels);
        for (block, out) in out.chunks_mut(LANES).enumerate() {
            let range = block * LANES..block * LANES + out.len();
            let points = ShadedPoints {
                to_local: &points.to_local[range.clone()],
                outgoing: &points.outgoing[range.clone()],
                visibility: &points.visibility[range.start * count..range.end * count],
            };
            self.shade_block(isa, lobes, points, &mut scratch, out);
        }
    }

    /// At most [`LANES`] points.
    fn shade_block(
        &self,
        isa: Isa,
        lobes: &ZonalLight,
        points: ShadedPoints<'_>,
        scratch: &mut Scratch,
        out: &mut [[f32; 3]],
    ) {
        let Scratch { y, light, visibility, products, strengths } = scratch;
        perform(isa, Turn { lobes, points, y, light, visibility });
        let (view, sets) = self.panels();
        let flat = strengths.as_flattened_mut();
        multiply(isa, view, y.as_flattened(), LANES, Layout::Rows, flat);
        let terms = self.header().terms;
        let own = |colour: usize| colour.min(self.header().channels - 1) * terms;
        let strengths = [0, 1, 2].map(|colour| &strengths[own(colour)..][..terms]);
        let light = light.each_ref().map(Vec::as_slice);
        let mut lit = [[0.0; LANES]; 3];
        for (set, matrices) in sets.iter().enumerate() {
            let flat = products.as_flattened_mut();
            multiply(isa, matrices, visibility.as_flattened(), LANES, Layout::Rows, flat);
            if sets.len() == 1 {
                perform(isa, Sum { products, strengths, light, lit: &mut lit });
            } else {
                let (strengths, light) = ([strengths[set]], [light[set]]);
                let lit = std::array::from_mut(&mut lit[set]);
                perform(isa, Sum { products, strengths, light, lit });
            }
        }
        for (lane, (out, outgoing)) in out.iter_mut().zip(points.outgoing).enumerate() {
            *out = if outgoing.z > 0.0 { lit.map(|colour| colour[lane]) } else { [0.0; 3] };
        }
    }
}

/// Light, visibility and the harmonics of the view, a point in each lane and in its frame.
struct Turn<'a> {
    lobes: &'a ZonalLight,
    points: ShadedPoints<'a>,
    y: &'a mut [Lanes],
    light: &'a mut [Vec<Lanes>; 3],
    visibility: &'a mut [Lanes],
}

impl Task for Turn<'_> {
    type Output = ();

    #[inline(always)]
    fn perform(self) {
        let Self { lobes, points, y, light, visibility } = self;
        let (order, count) = (lobes.order(), y.len());
        for (lane, row) in points.visibility.chunks_exact(count).enumerate() {
            for (lanes, v) in visibility.iter_mut().zip(row) {
                lanes[lane] = *v;
            }
        }
        light.iter_mut().for_each(|colour| colour.fill([0.0; LANES]));
        let mut axes = [[0.0; LANES]; 3];
        for lobe in lobes.lobes() {
            let axis = Vec3::from(lobe.axis.map(|x| x as f32));
            for (lane, frame) in points.to_local.iter().enumerate() {
                [axes[0][lane], axes[1][lane], axes[2][lane]] = (*frame * axis).to_array();
            }
            evaluate_lanes(order, &axes, y);
            for (colour, bands) in light.iter_mut().zip(&lobe.bands) {
                for (l, z) in bands.iter().enumerate().take(order.bands()) {
                    for i in l * l..(l + 1) * (l + 1) {
                        add(&mut colour[i], *z as f32, &y[i]);
                    }
                }
            }
        }
        for (lane, direction) in points.outgoing.iter().enumerate() {
            [axes[0][lane], axes[1][lane], axes[2][lane]] = direction.to_array();
        }
        evaluate_lanes(order, &axes, y);
    }
}

/// sum += scale · values.
#[inline(always)]
fn add(sum: &mut Lanes, scale: f32, values: &Lanes) {
    for lane in 0..LANES {
        sum[lane] += scale * values[lane];
    }
}

/// sum += a · b.
#[inline(always)]
fn add_product(sum: &mut Lanes, a: &Lanes, b: &Lanes) {
    for lane in 0..LANES {
        sum[lane] += a[lane] * b[lane];
    }
}

/// Σ_b s_b l · (M_b v) of S colours that share their matrices.
struct Sum<'a, const S: usize> {
    products: &'a [Lanes],
    strengths: [&'a [Lanes]; S],
    light: [&'a [Lanes]; S],
    lit: &'a mut [Lanes; S],
}

impl<const S: usize> Task for Sum<'_, S> {
    type Output = ();

    #[inline(always)]
    fn perform(self) {
        let Self { products, strengths, light, lit } = self;
        let count = light[0].len();
        for (b, products) in products.chunks_exact(count).enumerate() {
            // A sum of its own for each colour, which stays in a register.
            let mut sums = [[0.0; LANES]; S];
            for (i, product) in products.iter().enumerate() {
                for c in 0..S {
                    add_product(&mut sums[c], product, &light[c][i]);
                }
            }
            for c in 0..S {
                add_product(&mut lit[c], &sums[c], &strengths[c][b]);
            }
        }
    }
}

#[cfg(all(test, feature = "bake"))]
mod tests {
    use glam::Quat;

    use super::super::{Colours, Factoring, factor_by};
    use super::*;
    use crate::shade::{Brdf, ShLight};

    /// Any number of points is shaded as each alone, in one colour and in three that share their
    /// matrices or do not, at every instruction set; what is looked at from below is black.
    #[test]
    fn many_points_are_shaded_as_each_alone() {
        let cases = [
            (4, [0.5; 3], Colours::Together),
            (3, [0.9, 0.5, 0.1], Colours::Together),
            (3, [0.9, 0.5, 0.1], Colours::Apart),
        ];
        for (bands, reflectance, colours) in cases {
            let n = Order::new(bands).unwrap();
            let brdf = Brdf::Ggx { normal_reflectance: reflectance, alpha: [0.5; 2] };
            let factoring = Factoring { colours, ..Factoring::default() };
            let factored = factor_by(&brdf, n, 16, factoring).unwrap();
            let operators = factored.map(|colour| colour.operator(5));
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
