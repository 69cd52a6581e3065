//! What is read off a point's coefficients: linear probes (ambient occlusion, shading under each
//! light) and the inner products whose cross form is free of the references' noise.

use std::f64::consts::PI;

use glam::{Quat, Vec3};

use super::{Signal, lights};
use crate::sh::{MAX_BANDS, Order, Rotation, evaluate_f64, hemisphere_gram_pole, zonal};

const MOST: usize = MAX_BANDS * MAX_BANDS;

/// The probes of a signal.
#[derive(Debug)]
pub(super) struct Probes {
    signal: Signal,
    order: Order,
    /// [light][coefficient]; none where a dot product is not shading.
    lights: Vec<Vec<f64>>,
    /// The entries of G(+Z) that are not zero: only equal m couple, and even l − l' only l = l'.
    gram: Vec<(usize, usize, f64)>,
    /// Per band √(4π/(2l+1)) A_l / π, A the clamped cosine: visibility to ambient occlusion.
    cosine: [f64; MAX_BANDS],
}

/// What a point's normal decides, shared by all that is compared at the point.
#[derive(Debug)]
pub(super) struct Site {
    /// Takes the normal to +Z.
    to_pole: Rotation,
    /// The row that reads ambient occlusion off the coefficients.
    ao: [f64; MOST],
}

impl Probes {
    pub(super) fn new(signal: Signal, order: Order) -> Self {
        let count = order.coefficients();
        let gram = hemisphere_gram_pole(order);
        let entry = |at: usize| (at / count, at % count, gram[at]);
        let mut cosine = zonal::clamped_cosine(order);
        for (l, c) in cosine.iter_mut().enumerate() {
            *c *= (4.0 * PI / (2 * l + 1) as f64).sqrt() / PI;
        }
        let lights = match signal {
            Signal::Transfer => lights().iter().map(|l| l.coefficients(order)).collect(),
            Signal::Ao | Signal::Visibility => Vec::new(),
        };
        let gram = (0..count * count).map(entry).filter(|e| e.2.abs() > 1e-12).collect();
        Self { signal, order, lights, gram, cosine }
    }

    /// Ambient occlusion and one per light.
    pub(super) fn count(&self) -> usize {
        1 + self.lights.len()
    }

    /// Coefficients of a row.
    pub(super) fn coefficients(&self) -> usize {
        self.order.coefficients()
    }

    /// Whether coefficients are those of a function over directions.
    pub(super) fn is_directional(&self) -> bool {
        self.signal != Signal::Ao
    }

    pub(super) fn site(&self, normal: Vec3) -> Site {
        let mut ao = [0.0; MOST];
        match self.signal {
            Signal::Ao => ao[0] = 1.0,
            Signal::Transfer => ao[0] = 2.0 * PI.sqrt(),
            Signal::Visibility => {
                let n = normal.as_dvec3().normalize();
                evaluate_f64(self.order, n.to_array(), &mut ao);
                for l in 0..self.order.bands() {
                    ao[l * l..(l + 1) * (l + 1)].iter_mut().for_each(|y| *y *= self.cosine[l]);
                }
            }
        }
        let to_pole = if self.is_directional() {
            Rotation::new(self.order, Quat::from_rotation_arc(normal.normalize(), Vec3::Z))
        } else {
            Rotation::identity(self.order)
        };
        Site { to_pole, ao }
    }

    /// Reads every probe off one row of coefficients.
    pub(super) fn read(&self, site: &Site, row: &[f64], out: &mut Vec<f64>) {
        out.push(dot(&site.ao, row));
        out.extend(self.lights.iter().map(|light| dot(light, row)));
    }

    /// aᵀ G(n) b, the integral of a·b over the normal's hemisphere.
    pub(super) fn hemisphere(&self, site: &Site, a: &[f64], b: &[f64]) -> f64 {
        let (mut at_pole_a, mut at_pole_b) = ([0.0; MOST], [0.0; MOST]);
        site.to_pole.apply_f64(a, &mut at_pole_a);
        site.to_pole.apply_f64(b, &mut at_pole_b);
        self.gram.iter().map(|&(i, j, g)| at_pole_a[i] * g * at_pole_b[j]).sum()
    }
}

/// Σ a·b over the shorter of the two.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::{gauss_legendre, hemisphere_gram};

    fn wave(n: usize, k: f64) -> Vec<f64> {
        (0..n).map(|i| (i as f64 * k + 0.3).sin() / (1.0 + i as f64 * 0.1)).collect()
    }

    /// aᵀG(n)b by rotation and sparse G(+Z) agrees with the dense matrix of the normal, and with a
    /// plain quadrature over the hemisphere in the normal's own frame; for every order.
    #[test]
    fn hemisphere_product_agrees_with_matrix_and_integral() {
        for bands in 1..=10u8 {
            let order = Order::new(bands).unwrap();
            let count = order.coefficients();
            let probes = Probes::new(Signal::Transfer, order);
            let (a, b) = (wave(count, 1.1), wave(count, 0.7));
            for normal in [Vec3::Z, Vec3::NEG_Z, Vec3::new(0.6, -0.48, 0.64)] {
                let found = probes.hemisphere(&probes.site(normal), &a, &b);
                let gram = hemisphere_gram(order, normal);
                let dense: f64 = (0..count).map(|i| a[i] * dot(&gram[i * count..], &b)).sum();
                assert!((found - dense).abs() < 1e-6, "order {bands}, {normal}: {found} {dense}");
                let integral = integrate(order, normal, &a, &b);
                assert!((found - integral).abs() < 1e-6, "order {bands}: {found} {integral}");
            }
        }
    }

    /// ∫ a·b over the hemisphere of `normal`, by Gauss–Legendre in height and equal steps around.
    fn integrate(order: Order, normal: Vec3, a: &[f64], b: &[f64]) -> f64 {
        let n = normal.as_dvec3().normalize();
        let (x, y) = n.any_orthonormal_pair();
        let mut basis = vec![0.0; order.coefficients()];
        let mut sum = 0.0;
        for (t, weight) in gauss_legendre(16) {
            let height = (t + 1.0) / 2.0;
            for k in 0..40 {
                let (sin, cos) = (2.0 * PI * f64::from(k) / 40.0).sin_cos();
                let d = height * n + (1.0 - height * height).sqrt() * (cos * x + sin * y);
                evaluate_f64(order, d.to_array(), &mut basis);
                sum += weight / 2.0 * 2.0 * PI / 40.0 * dot(a, &basis) * dot(b, &basis);
            }
        }
        sum
    }

    /// An unoccluded point reads as ambient occlusion 1 in all three signals, and its shading
    /// under the constant light is 1 too.
    #[test]
    fn open_points_read_as_one() {
        let order = Order::new(6).unwrap();
        let normal = Vec3::new(0.48, 0.6, -0.64);
        let open_visibility: Vec<f64> =
            (0..36).map(|i| if i == 0 { (4.0 * PI).sqrt() } else { 0.0 }).collect();
        let mut transfer = [0f32; 36];
        zonal::rotate(order, &zonal::unshadowed(order), normal, &mut transfer);
        let open_transfer: Vec<f64> = transfer.iter().map(|&x| f64::from(x)).collect();
        let one = Order::new(1).unwrap();
        for (signal, order, row) in [
            (Signal::Ao, one, vec![1.0]),
            (Signal::Visibility, order, open_visibility),
            (Signal::Transfer, order, open_transfer),
        ] {
            let probes = Probes::new(signal, order);
            let mut read = Vec::new();
            probes.read(&probes.site(normal), &row, &mut read);
            assert_eq!(read.len(), probes.count());
            assert!((read[0] - 1.0).abs() < 1e-6, "{signal:?}: {}", read[0]);
            assert!(read.get(1).is_none_or(|x| (x - 1.0).abs() < 1e-6), "{read:?}");
        }
    }
}
