//! Bent normals.

use glam::Vec3;

/// The bent normal of radiance transfer: ∫ V (n·ω)₊ ω dω made unit, in the frame of the coefficients.
/// Band 1 of transfer holds it but for a factor: the coefficients of y, z and x. Zero where no light comes
/// in, and for a row of fewer than 4 coefficients.
#[must_use]
pub fn bent_normal(transfer: &[f32]) -> Vec3 {
    match transfer {
        &[_, y, z, x, ..] => Vec3::new(x, y, z).normalize_or_zero(),
        _ => Vec3::ZERO,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::{Order, zonal};

    /// The unshadowed transfer of a normal bends to that normal: y₁ = (y, z, x) is taken apart in the
    /// right order.
    #[test]
    fn nothing_blocked_bends_nothing() {
        let order = Order::new(2).unwrap();
        let normal = Vec3::new(0.6, -0.48, 0.64);
        let mut row = [0.0; 4];
        zonal::rotate(order, &zonal::unshadowed(order), normal, &mut row);
        assert!((bent_normal(&row) - normal).length() < 1e-5, "{}", bent_normal(&row));
        assert_eq!((bent_normal(&[0.0; 4]), bent_normal(&[1.0])), (Vec3::ZERO, Vec3::ZERO));
    }

    /// Where a wall takes the half of the sky with x > 0 from level ground, ∫ (n·ω) ω dω over the rest is
    /// (−2/3, π/3, 0); here by sums over 400² directions.
    #[test]
    fn half_a_sky_bends_to_its_centroid() {
        let order = Order::new(2).unwrap();
        let mut row = [0.0_f64; 4];
        let steps = 400;
        for i in 0..steps {
            for j in 0..steps {
                let theta = (i as f64 + 0.5) / f64::from(steps) * std::f64::consts::FRAC_PI_2;
                let phi = (j as f64 + 0.5) / f64::from(steps) * std::f64::consts::TAU;
                let omega = [theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()];
                if omega[0] > 0.0 {
                    continue;
                }
                let mut y = [0.0; crate::sh::MAX_COEFFICIENTS];
                crate::sh::evaluate_f64(order, omega, &mut y);
                let weight = theta.cos() * theta.sin();
                row.iter_mut().zip(y).for_each(|(sum, y)| *sum += weight * y);
            }
        }
        let bent = bent_normal(&row.map(|value| value as f32));
        let expected = Vec3::new(-2.0 / 3.0, std::f32::consts::FRAC_PI_3, 0.0).normalize();
        assert!((bent - expected).length() < 1e-3, "{bent}, expected {expected}");
    }
}
