//! The longest principal direction of places.

use glam::{Mat3, Vec3};

/// The unit direction along which places vary most, +Y where they do not vary. Its sign is that of its
/// component of largest magnitude.
pub(super) fn longest(places: &[Vec3]) -> Vec3 {
    let mean = places.iter().sum::<Vec3>() / places.len().max(1) as f32;
    let mut covariance = Mat3::ZERO;
    for place in places {
        let d = *place - mean;
        covariance += Mat3::from_cols(d * d.x, d * d.y, d * d.z);
    }
    let scale = covariance.to_cols_array().iter().fold(0.0_f32, |m, x| m.max(x.abs()));
    if scale <= 0.0 {
        return Vec3::Y;
    }
    // Squaring a matrix squares the ratios of its eigenvalues: twelve times is 2¹² steps of a power
    // iteration.
    let mut power = covariance * (1.0 / scale);
    for _ in 0..12 {
        power *= power;
        let largest = power.to_cols_array().iter().fold(f32::MIN_POSITIVE, |m, x| m.max(x.abs()));
        power *= 1.0 / largest;
    }
    let columns = [power.x_axis, power.y_axis, power.z_axis];
    let longest = columns.into_iter().max_by(|a, b| a.length().total_cmp(&b.length()));
    let axis = longest.unwrap_or(Vec3::Y).normalize_or(Vec3::Y);
    let strongest = axis.to_array().into_iter().max_by(|a, b| a.abs().total_cmp(&b.abs()));
    if strongest.unwrap_or(1.0) < 0.0 { -axis } else { axis }
}
