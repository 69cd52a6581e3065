//! Zonal functions: those that are symmetric about an axis, one number per band.

use glam::Vec3;

use super::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate, evaluate_f64};

/// The zonal coefficients ∫ (cos θ)₊ y_l0 dω of the clamped cosine about +Z, one per band,
/// for the first n bands; the rest are zero.
///
/// √π/2, √(π/3), then 0 for odd l and, for even l,
/// 2π √((2l+1)/4π) · (−1)^{l/2−1} / ((l+2)(l−1)) · l! / (2^l (l/2)!²)
/// (Ramamoorthi and Hanrahan 2001).
#[must_use]
pub fn clamped_cosine(order: Order) -> [f64; MAX_BANDS] {
    let mut out = [0.0; MAX_BANDS];
    // l! / (2^l (l/2)!²), for even l: the product of (k−1)/k over even k ≤ l.
    let mut central = 1.0;
    for (l, out) in out.iter_mut().enumerate().take(order.bands()) {
        let lf = l as f64;
        let scale = (std::f64::consts::PI * (2.0 * lf + 1.0)).sqrt();
        if l > 0 && l % 2 == 0 {
            central *= (lf - 1.0) / lf;
        }
        *out = match l {
            0 => scale / 2.0,
            1 => scale / 3.0,
            _ if l % 2 == 1 => 0.0,
            _ => {
                let sign = if l % 4 == 2 { 1.0 } else { -1.0 };
                scale * sign * central / ((lf + 2.0) * (lf - 1.0))
            }
        };
    }
    out
}

/// The zonal coefficients of unoccluded `transfer`: [`clamped_cosine`] over π.
#[must_use]
pub fn unshadowed(order: Order) -> [f32; MAX_BANDS] {
    clamped_cosine(order).map(|x| (x / std::f64::consts::PI) as f32)
}

/// The zonal coefficients of a cap, 1 within `half_angle` (radians, 0 to π) of +Z and 0 elsewhere:
/// √π (1 − cos α) and, for l > 0, √(π/(2l+1)) · (P_{l−1}(cos α) − P_{l+1}(cos α)).
///
/// The difference of Legendre polynomials is taken as (2l+1)/(l(l+1)) · sin² α · P_l'(cos α),
/// which keeps its digits where the cap is small.
#[must_use]
pub fn cap(order: Order, half_angle: f64) -> [f64; MAX_BANDS] {
    let mut out = [0.0; MAX_BANDS];
    let (sin, cos) = half_angle.sin_cos();
    // P_l' by its own recurrence: l P'_{l+1} = (2l+1) x P'_l − (l+1) P'_{l−1}.
    let (mut before, mut slope) = (0.0, 1.0);
    for (l, out) in out.iter_mut().enumerate().take(order.bands()) {
        let lf = l as f64;
        *out = if l == 0 {
            2.0 * std::f64::consts::PI.sqrt() * (half_angle / 2.0).sin().powi(2)
        } else {
            let scale = (std::f64::consts::PI * (2.0 * lf + 1.0)).sqrt() / (lf * (lf + 1.0));
            let value = scale * sin * sin * slope;
            let next = ((2.0 * lf + 1.0) * cos * slope - (lf + 1.0) * before) / lf;
            (before, slope) = (slope, next);
            value
        };
    }
    out
}

/// [`rotate`] in f64.
///
/// # Panics
/// If `zonal` is shorter than n or `out` shorter than n².
pub fn rotate_f64(order: Order, zonal: &[f64], axis: [f64; 3], out: &mut [f64]) {
    let out = &mut out[..order.coefficients()];
    evaluate_f64(order, axis, out);
    for (l, zonal) in zonal[..order.bands()].iter().enumerate() {
        let scale = (4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt() * zonal;
        out[l * l..(l + 1) * (l + 1)].iter_mut().for_each(|y| *y *= scale);
    }
}

/// The n² coefficients of a zonal function about the unit vector `axis` instead of +Z:
/// f_lm = √(4π/(2l+1)) · `zonal[l]` · y_lm(axis).
///
/// # Panics
/// If `zonal` is shorter than n or `out` shorter than n².
pub fn rotate(order: Order, zonal: &[f32], axis: Vec3, out: &mut [f32]) {
    let mut y = [0.0; MAX_COEFFICIENTS];
    evaluate(order, axis, &mut y);
    let out = &mut out[..order.coefficients()];
    for (l, zonal) in zonal[..order.bands()].iter().enumerate() {
        let scale = (4.0 * std::f32::consts::PI / (2 * l + 1) as f32).sqrt() * zonal;
        for i in l * l..(l + 1) * (l + 1) {
            out[i] = scale * y[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::quadrature::zone;
    use super::super::{Rotation, index};
    use super::*;

    /// The closed form agrees with quadrature of (cos θ)₊ y_l0 over the upper hemisphere, which is
    /// exact because both are polynomials there.
    #[test]
    fn clamped_cosine_is_its_projection() {
        let order = Order::new(10).unwrap();
        let mut sums = [0.0; 100];
        let mut y = [0.0; 100];
        for (direction, weight) in zone(12, 0.0, 1.0) {
            evaluate_f64(order, direction, &mut y);
            for (sum, y) in sums.iter_mut().zip(&y) {
                *sum += weight * direction[2] * y;
            }
        }
        for (l, expected) in clamped_cosine(order).iter().enumerate() {
            assert!((sums[index(l, 0)] - expected).abs() < 1e-13, "band {l}");
        }
    }

    /// Unoccluded transfer under the constant light 1, whose only coefficient is √4π, is 1.
    #[test]
    fn unshadowed_constant_light_is_one() {
        let constant = unshadowed(Order::new(3).unwrap())[0] * (4.0 * std::f32::consts::PI).sqrt();
        assert!((constant - 1.0).abs() < 1e-6);
    }

    /// Moving the axis agrees with rotating the coefficients by a rotation that moves it so.
    #[test]
    fn rotate_agrees_with_the_rotation() {
        let order = Order::new(8).unwrap();
        let zonal: Vec<f32> = clamped_cosine(order).iter().map(|&x| x as f32).collect();
        let mut input = [0.0; 64];
        for l in 0..8 {
            input[index(l, 0)] = zonal[l];
        }
        let q = glam::Quat::from_xyzw(0.5, -0.1, 0.3, 0.7).normalize();
        let (mut rotated, mut direct) = ([0.0; 64], [0.0; 64]);
        Rotation::new(order, q).apply(&input, &mut rotated);
        rotate(order, &zonal, q * Vec3::Z, &mut direct);
        for (a, b) in rotated.iter().zip(&direct) {
            assert!((a - b).abs() < 2e-6);
        }
    }
}
