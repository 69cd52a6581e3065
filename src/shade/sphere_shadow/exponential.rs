//! The exponential of a sum of logarithms.

use std::f64::consts::{FRAC_PI_2, PI};

use super::logarithm::Zonal;
use crate::sh::{MAX_BANDS, MAX_COEFFICIENTS, Order, TripleProduct, zonal};

/// The largest norm at which a linear approximation is taken; what is larger is halved first.
const LARGEST: f64 = 1.5;

/// Steps of the table over the norm.
const STEPS: usize = 64;

/// Angles of single spheres whose exponentials the linear approximation is the best for.
const ANGLES: usize = 12;

/// The most halvings: norms of a million and more are darkness.
const MOST_HALVINGS: i32 = 20;

/// exp of functions of an order, by the hybrid of optimal linear approximation and scaling and
/// squaring (Ren et al. 2006 §4.3): the constant part is taken out exactly, the rest halved p times
/// until its norm is small, replaced by a + b·f, and squared p times.
#[derive(Debug, Clone)]
pub struct Exponential {
    order: Order,
    /// a and b by norm from 0 to [`LARGEST`].
    linear: Vec<[f32; 2]>,
    gamma: TripleProduct,
}

impl Exponential {
    /// Tables for an order.
    #[must_use]
    pub fn new(order: Order) -> Self {
        let products = Zonal::new(order);
        let shapes: Vec<[f64; MAX_BANDS]> = (1..=ANGLES)
            .filter_map(|i| shape(order, &products, FRAC_PI_2 * i as f64 / (ANGLES + 1) as f64))
            .collect();
        let entry = |step: usize| linear(&products, &shapes, LARGEST * step as f64 / STEPS as f64);
        Self {
            order,
            linear: (0..=STEPS).map(entry).collect(),
            gamma: TripleProduct::new(order, order, order),
        }
    }

    /// The exponential of n² coefficients.
    ///
    /// # Panics
    /// If a slice is shorter than n².
    pub fn apply(&self, log: &[f32], out: &mut [f32]) {
        let count = self.order.coefficients();
        let out = &mut out[..count];
        let mut rest = [0.0; MAX_COEFFICIENTS];
        rest[1..count].copy_from_slice(&log[1..count]);
        let norm = rest.iter().map(|x| x * x).sum::<f32>().sqrt();
        let constant = (log[0] / (4.0 * std::f32::consts::PI).sqrt()).exp();
        let halvings = (norm / LARGEST as f32).log2().ceil().max(0.0) as i32;
        let halvings = halvings.min(MOST_HALVINGS);
        let scale = 0.5_f32.powi(halvings);
        let place = (norm * scale / LARGEST as f32 * STEPS as f32).min(STEPS as f32);
        let low = (place as usize).min(STEPS - 1);
        let mix = place - low as f32;
        let [a, b] = [0, 1]
            .map(|k| self.linear[low][k] + mix * (self.linear[low + 1][k] - self.linear[low][k]));
        for (out, rest) in out.iter_mut().zip(&rest) {
            *out = b * scale * rest;
        }
        out[0] += a * (4.0 * std::f32::consts::PI).sqrt();
        let mut square = [0.0; MAX_COEFFICIENTS];
        for _ in 0..halvings {
            self.gamma.product(out, out, &mut square);
            out.copy_from_slice(&square[..count]);
        }
        out.iter_mut().for_each(|value| *value *= constant);
    }
}

/// The logarithm of one sphere's visibility without its constant part, of norm 1; none where there
/// is nothing else, as at order 1.
fn shape(order: Order, products: &Zonal, half_angle: f64) -> Option<[f64; MAX_BANDS]> {
    let mut visible = zonal::cap(order, half_angle).map(|c| -c);
    visible[0] += (4.0 * PI).sqrt();
    let mut log = products.log(&visible);
    log[0] = 0.0;
    let norm = log.iter().map(|x| x * x).sum::<f64>().sqrt();
    (norm > 0.0).then(|| log.map(|x| x / norm))
}

/// The a and b that leave least of exp(x·f) − a − b·x·f, averaged over the shapes: a its mean value,
/// b its share along f.
fn linear(products: &Zonal, shapes: &[[f64; MAX_BANDS]], norm: f64) -> [f32; 2] {
    if norm == 0.0 || shapes.is_empty() {
        return [1.0, 1.0];
    }
    let (mut a, mut b) = (0.0, 0.0);
    for shape in shapes {
        let f = shape.map(|x| norm * x);
        let exponential = products.exp(&f);
        a += exponential[0] / (4.0 * PI).sqrt();
        b += exponential.iter().zip(f).map(|(e, f)| e * f).sum::<f64>() / (norm * norm);
    }
    [a, b].map(|sum| (sum / shapes.len() as f64) as f32)
}
