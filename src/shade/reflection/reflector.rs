//! Operators in single precision: what a frame runs.

use std::sync::OnceLock;

use glam::Vec3;

use super::file::{ReflectorHeader, VERSION, VERSION_SHARED};
use super::{MOST_TERMS, ReflectionOperator};
use crate::num::panels::Panels;
use crate::sh::{MAX_COEFFICIENTS, Order, evaluate};

/// The share of an operator's energy between different degrees that is rounding.
const MIXED: f64 = 1e-9;

/// A reflectance ready to shade: view factors of one colour or three, and product matrices that the
/// colours share or have each.
#[derive(Debug, Clone)]
pub struct Reflector {
    pub(super) header: ReflectorHeader,
    pub(super) order: Order,
    /// `[channel][b][i]`
    pub(super) view: Vec<f32>,
    /// `[set][b][j][i]`: transposed, so that sums run along memory.
    pub(super) matrices: Vec<f32>,
    /// The same for many points at once, made when first asked for.
    panels: OnceLock<(Panels, Vec<Panels>)>,
}

impl PartialEq for Reflector {
    fn eq(&self, other: &Self) -> bool {
        self.header == other.header && self.view == other.view && self.matrices == other.matrices
    }
}

/// Each of the square matrices transposed.
pub(super) fn transposed(matrices: &[f32], size: usize) -> Vec<f32> {
    let entry = |k: usize| {
        let (matrix, i) = (k / (size * size), k % (size * size));
        matrices[matrix * size * size + i % size * size + i / size]
    };
    (0..matrices.len()).map(entry).collect()
}

/// Σ_b s_b M_b v for several sets of strengths, the matrices transposed, their rows' length known to
/// the compiler.
fn transfer<const C: usize>(
    strengths: &[[f32; MOST_TERMS]],
    v: &[f32],
    matrices: &[f32],
    out: &mut [[f32; MAX_COEFFICIENTS]],
) {
    if let ([strengths], [out]) = (strengths, &mut *out) {
        let mut sums = [0.0; C];
        for (strength, matrix) in strengths.iter().zip(matrices.chunks_exact(C * C)) {
            for (row, v) in matrix.as_chunks::<C>().0.iter().zip(v) {
                let factor = strength * v;
                sums.iter_mut().zip(row).for_each(|(sum, m)| *sum += factor * m);
            }
        }
        out[..C].copy_from_slice(&sums);
        return;
    }
    let mut sums = [[0.0; C]; 3];
    for (b, matrix) in matrices.chunks_exact(C * C).enumerate() {
        let mut product = [0.0; C];
        for (row, v) in matrix.as_chunks::<C>().0.iter().zip(v) {
            product.iter_mut().zip(row).for_each(|(sum, m)| *sum += v * m);
        }
        for (sums, strengths) in sums.iter_mut().zip(strengths) {
            sums.iter_mut().zip(&product).for_each(|(sum, p)| *sum += strengths[b] * p);
        }
    }
    for (out, sums) in out.iter_mut().zip(&sums) {
        out[..C].copy_from_slice(sums);
    }
}

impl Reflector {
    /// The operators of red, green and blue as one; what is the same for all is kept once.
    ///
    /// # Panics
    /// If the operators differ in order or number of terms.
    #[must_use]
    pub fn new(name: &str, operators: &[ReflectionOperator; 3], errors: [f64; 3]) -> Self {
        let [red, green, blue] = operators;
        let order = red.order();
        let same = |a: &ReflectionOperator| (a.order(), a.terms()) == (order, red.terms());
        assert!(same(green) && same(blue), "operators of one reflectance");
        let shared = |a: &ReflectionOperator| a.matrices() == red.matrices();
        let sets = if shared(green) && shared(blue) { 1 } else { 3 };
        let channels = if red == green && red == blue { 1 } else { 3 };
        let collect = |count: usize, pick: fn(&ReflectionOperator) -> &[f64]| -> Vec<f32> {
            let all = operators[..count].iter().flat_map(|operator| pick(operator).iter());
            all.map(|&value| value as f32).collect()
        };
        let header = ReflectorHeader {
            format_version: if sets < channels { VERSION_SHARED } else { VERSION },
            order: order.get(),
            terms: red.terms(),
            channels,
            name: name.to_owned(),
            errors: errors[..channels].to_vec(),
            isotropic: false,
        };
        let matrices = collect(sets, ReflectionOperator::matrices);
        let matrices = transposed(&matrices, order.coefficients());
        let view = collect(channels, ReflectionOperator::view);
        let mut this = Self::of(header, order, view, matrices);
        this.header.isotropic = this.is_isotropic();
        this
    }

    /// Whether no degree of the light meets another of the view. A grain makes them meet: what it sends
    /// towards one azimuth is not what it sends towards another, turned. A pair of terms of one degree
    /// that the number of terms cuts in two is none.
    pub(super) fn is_isotropic(&self) -> bool {
        let (count, terms) = (self.order.coefficients(), self.header.terms);
        let degree = |i: usize| i.abs_diff(i.isqrt() * (i.isqrt() + 1));
        let (mut all, mut mixed) = (0.0, 0.0);
        for (channel, view) in self.views().enumerate() {
            let set = if self.sets() == 1 { 0 } else { channel };
            let matrices = &self.matrices[set * self.set()..][..self.set()];
            for i in 0..count {
                for k in 0..count {
                    // The light factors, for a product with the constant is the function itself.
                    let first = |b: usize| matrices[(b * count + k) * count];
                    let met: f32 = (0..terms).map(|b| view[b * count + i] * first(b)).sum();
                    all += f64::from(met).powi(2);
                    if degree(i) != degree(k) {
                        mixed += f64::from(met).powi(2);
                    }
                }
            }
        }
        mixed <= MIXED * all
    }

    pub(super) fn of(
        header: ReflectorHeader,
        order: Order,
        view: Vec<f32>,
        matrices: Vec<f32>,
    ) -> Self {
        Self { header, order, view, matrices, panels: OnceLock::new() }
    }

    /// What is said of it.
    #[must_use]
    pub fn header(&self) -> &ReflectorHeader {
        &self.header
    }

    /// The order of visibility and light.
    #[must_use]
    pub fn order(&self) -> Order {
        self.order
    }

    /// Bytes of its numbers: 4 · k · n² for the view factors of each colour, 4 · k · n⁴ for each set of
    /// matrices.
    #[must_use]
    pub fn bytes(&self) -> usize {
        4 * (self.view.len() + self.matrices.len())
    }

    /// Radiance towards a unit direction, red, green and blue: visibility, light and direction in
    /// the tangent frame. Towards below the surface nothing is reflected.
    ///
    /// # Panics
    /// If a slice is shorter than n².
    #[must_use]
    pub fn shade(&self, visibility: &[f32], light: [&[f32]; 3], outgoing: Vec3) -> [f32; 3] {
        if outgoing.z <= 0.0 { [0.0; 3] } else { self.shade_any(visibility, light, outgoing) }
    }

    /// [`Reflector::shade`] without a look at where the surface is.
    pub(super) fn shade_any(
        &self,
        visibility: &[f32],
        light: [&[f32]; 3],
        outgoing: Vec3,
    ) -> [f32; 3] {
        let (count, channels) = (self.order.coefficients(), self.header.channels);
        let mut y = [0.0; MAX_COEFFICIENTS];
        evaluate(self.order, outgoing, &mut y);
        let mut strengths = [[0.0; MOST_TERMS]; 3];
        for (strengths, view) in strengths.iter_mut().zip(self.views()) {
            for (s, row) in strengths.iter_mut().zip(view.chunks_exact(count)) {
                *s = row.iter().zip(&y).map(|(w, y)| w * y).sum();
            }
        }
        let mut transfers = [[0.0; MAX_COEFFICIENTS]; 3];
        let per_set = channels / self.sets();
        let parts = strengths.chunks(per_set).zip(transfers.chunks_mut(per_set));
        for ((strengths, out), matrices) in parts.zip(self.matrices.chunks_exact(self.set())) {
            self.apply(strengths, &visibility[..count], matrices, out);
        }
        std::array::from_fn(|c| {
            let t = &transfers[c.min(channels - 1)];
            t[..count].iter().zip(&light[c][..count]).map(|(t, l)| t * l).sum()
        })
    }

    /// The view factors of every channel.
    pub(super) fn views(&self) -> impl Iterator<Item = &[f32]> {
        self.view.chunks_exact(self.header.terms * self.order.coefficients())
    }

    /// Sets of matrices: 1 where all channels share it.
    pub(super) fn sets(&self) -> usize {
        self.header.sets()
    }

    /// Numbers of a set.
    fn set(&self) -> usize {
        self.header.terms * self.order.coefficients().pow(2)
    }

    /// For many points at once: view factors, rows `[channel][b]`, and sets of matrices, rows `[b][i]`.
    pub(super) fn panels(&self) -> (&Panels, &[Panels]) {
        let (view, sets) = self.panels.get_or_init(|| {
            let count = self.order.coefficients();
            let view = |row, i| self.view[row * count + i];
            let matrices = |set: &[f32]| {
                Panels::new(self.header.terms * count, count, |row, j| {
                    set[(row / count * count + j) * count + row % count]
                })
            };
            let sets = self.matrices.chunks_exact(self.set()).map(matrices).collect();
            (Panels::new(self.header.channels * self.header.terms, count, view), sets)
        });
        (view, sets)
    }

    fn apply(
        &self,
        strengths: &[[f32; MOST_TERMS]],
        v: &[f32],
        matrices: &[f32],
        out: &mut [[f32; MAX_COEFFICIENTS]],
    ) {
        match self.order.bands() {
            1 => transfer::<1>(strengths, v, matrices, out),
            2 => transfer::<4>(strengths, v, matrices, out),
            3 => transfer::<9>(strengths, v, matrices, out),
            4 => transfer::<16>(strengths, v, matrices, out),
            5 => transfer::<25>(strengths, v, matrices, out),
            6 => transfer::<36>(strengths, v, matrices, out),
            7 => transfer::<49>(strengths, v, matrices, out),
            8 => transfer::<64>(strengths, v, matrices, out),
            9 => transfer::<81>(strengths, v, matrices, out),
            _ => transfer::<100>(strengths, v, matrices, out),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    fn numbers(count: usize, step: f64, phase: f64) -> Vec<f64> {
        (0..count).map(|i| (i as f64 * step + phase).sin()).collect()
    }

    /// One colour, three that share their matrices, three that do not.
    pub(in crate::shade::reflection) fn reflectors() -> [(Reflector, [ReflectionOperator; 3]); 3] {
        let (order, light) = (Order::new(4).unwrap(), Order::new(7).unwrap());
        let operator = |light_phase: f64, view_phase: f64| {
            let (u, w) = (numbers(8 * 49, 1.3, light_phase), numbers(8 * 16, 0.7, view_phase));
            ReflectionOperator::new(order, light, &u, &w)
        };
        [[[0.2; 3]; 2], [[0.2; 3], [0.0, 0.5, 1.0]], [[0.0, 0.5, 1.0]; 2]].map(|[light, view]| {
            let operators = [0, 1, 2].map(|c| operator(light[c], view[c]));
            (Reflector::new("test", &operators, [0.1, 0.2, 0.3]), operators)
        })
    }

    /// f32 shades as the f64 operators do, in every colour, whether colours share their matrices or
    /// not; nothing goes below the surface; eight terms of order 4 are 8,704 bytes, two more colours
    /// that share them 1,024.
    #[test]
    fn f32_follows_f64() {
        let bytes = [8704, 8704 + 2 * 512, 3 * 8704];
        for ((reflector, operators), bytes) in reflectors().into_iter().zip(bytes) {
            assert_eq!(reflector.bytes(), bytes);
            let v: Vec<f64> = (0..16).map(|i| (f64::from(i) * 0.9).cos()).collect();
            let lights: [Vec<f64>; 3] =
                [0.1, 0.4, 2.0].map(|p| (0..16).map(|i| (f64::from(i) * p).sin()).collect());
            let single = |values: &[f64]| values.iter().map(|&x| x as f32).collect::<Vec<f32>>();
            let [r, g, b] = lights.each_ref().map(|light| single(light));
            let outgoing = Vec3::new(0.36, -0.48, 0.8);
            let found = reflector.shade(&single(&v), [&r, &g, &b], outgoing);
            let mut t = vec![0.0; 16];
            for c in 0..3 {
                operators[c].transfer(&v, outgoing.as_dvec3().normalize().to_array(), &mut t);
                let expected: f64 = t.iter().zip(&lights[c]).map(|(t, l)| t * l).sum();
                let size: f64 = t.iter().map(|t| t.abs()).sum::<f64>().max(1.0);
                assert!(
                    (f64::from(found[c]) - expected).abs() < 1e-5 * size,
                    "{found:?} {expected}"
                );
            }
            assert_eq!(reflector.shade(&single(&v), [&r, &g, &b], Vec3::NEG_Z), [0.0; 3]);
        }
    }
}
