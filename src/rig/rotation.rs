//! Rotations out of matrices and out of sets of quaternions, in f64, by one eigenproblem each.
//!
//! Both the rotation nearest to a matrix A (the R that maximises tr(RᵀA), which is the polar factor
//! where det A > 0) and the mean of rotations (the q that maximises Σ (q·qᵢ)²) are the leading
//! eigenvector of a symmetric 4×4 matrix, so neither knows a sign, a singular case or an iteration
//! that fails to converge: what is ambiguous shows as a vanishing gap between two eigenvalues.

use glam::{DMat3, DQuat, Mat3A, Quat, Vec3};

/// The leading eigenvalues must differ by this much, relative to the largest one, for a rotation
/// to be called determined: far above f32 noise, far below any pose that an artist would make.
const LEAST_GAP: f64 = 1e-6;

/// The proper rotation nearest to `linear` in the Frobenius norm: the rotation of its polar
/// decomposition where the determinant is positive, the best one without mirroring elsewhere.
///
/// `None` where no rotation is nearest: a matrix of zeros, of rank 1, a mirror with equal scales,
/// or one that is not finite. The quaternion has w ≥ 0.
#[must_use]
pub fn nearest_rotation(linear: Mat3A) -> Option<Quat> {
    if !linear.is_finite() {
        return None;
    }
    let a = DMat3::from_cols_array(&linear.to_cols_array().map(f64::from));
    let (c0, c1, c2) = (a.x_axis, a.y_axis, a.z_axis);
    // K of Horn's closed form for Σ Rᵢⱼ Aᵢⱼ = qᵀ K q, in the order x, y, z, w.
    let (xy, xz, yz) = (c1.x + c0.y, c2.x + c0.z, c2.y + c1.z);
    let (xw, yw, zw) = (c1.z - c2.y, c2.x - c0.z, c0.y - c1.x);
    let matrix = [
        [c0.x - c1.y - c2.z, xy, xz, xw],
        [xy, c1.y - c0.x - c2.z, yz, yw],
        [xz, yz, c2.z - c0.x - c1.y, zw],
        [xw, yw, zw, c0.x + c1.y + c2.z],
    ];
    let leading = leading_eigenvector(matrix);
    if leading.gap <= LEAST_GAP * leading.magnitude {
        return None;
    }
    let q = DQuat::from_array(leading.vector);
    Some(if q.w < 0.0 { -q } else { q }.as_quat())
}

/// The mean rotation: the unit q that maximises Σ (q·qᵢ)², whatever the signs of the qᵢ.
///
/// Of two rotations it is the midpoint of the shorter arc. Where the maximum is not unique (a
/// joint that spins evenly through whole turns) it is one of the maxima, always the same one for
/// the same input. Has w ≥ 0; the identity for no rotations.
#[must_use]
pub fn mean_rotation(rotations: impl Iterator<Item = Quat>) -> Quat {
    let mut matrix = [[0.0_f64; 4]; 4];
    let mut count = 0_usize;
    for rotation in rotations {
        let q = rotation.as_dquat().normalize();
        if !q.is_finite() {
            continue;
        }
        count += 1;
        let q = q.to_array();
        for (row, &a) in matrix.iter_mut().zip(&q) {
            for (entry, &b) in row.iter_mut().zip(&q) {
                *entry += a * b;
            }
        }
    }
    if count == 0 {
        return Quat::IDENTITY;
    }
    let q = DQuat::from_array(leading_eigenvector(matrix).vector);
    if q.w < 0.0 { -q } else { q }.as_quat()
}

/// The rotation vector (axis × angle, radians, length at most π) of the rotation from `mean` to
/// `rotation`, in the frame of `mean`: log(mean⁻¹ · rotation) on the hemisphere of `mean`.
///
/// Continuous everywhere but half a turn from `mean`, and finite there too. `rotation` need not be
/// of unit length; one without direction counts as `mean`.
#[must_use]
pub fn rotation_vector(mean: Quat, rotation: Quat) -> Vec3 {
    let relative = mean.as_dquat().inverse() * rotation.as_dquat();
    let relative = if relative.w < 0.0 { -relative } else { relative };
    let vector = relative.xyz();
    let sine = vector.length();
    // atan2 is exact near 0 and near π, where the arc cosine of w loses half the digits.
    let angle = 2.0 * sine.atan2(relative.w);
    let factor = if sine > 0.0 { angle / sine } else { 0.0 };
    let out = (vector * factor).as_vec3();
    if out.is_finite() { out } else { Vec3::ZERO }
}

/// The eigenvector of the largest eigenvalue, with what tells how well it is determined.
struct Leading {
    /// Of unit length.
    vector: [f64; 4],
    /// Largest minus second largest eigenvalue.
    gap: f64,
    /// The largest absolute eigenvalue.
    magnitude: f64,
}

/// Cyclic Jacobi on a symmetric 4×4 matrix; quadratic convergence, a fixed bound on the sweeps.
fn leading_eigenvector(mut a: [[f64; 4]; 4]) -> Leading {
    const SWEEPS: usize = 24;
    let mut vectors = [[0.0_f64; 4]; 4];
    for (i, row) in vectors.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    for _ in 0..SWEEPS {
        let mut rotated = false;
        for p in 0..3 {
            for q in p + 1..4 {
                rotated |= eliminate(&mut a, &mut vectors, p, q);
            }
        }
        if !rotated {
            break;
        }
    }
    let values = [a[0][0], a[1][1], a[2][2], a[3][3]];
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&i, &j| values[j].total_cmp(&values[i]));
    let best = order[0];
    let vector = [vectors[0][best], vectors[1][best], vectors[2][best], vectors[3][best]];
    let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    Leading {
        vector: vector.map(|x| x / length),
        gap: values[best] - values[order[1]],
        magnitude: values.iter().fold(0.0, |most: f64, value| most.max(value.abs())),
    }
}

/// One Jacobi rotation that makes a[p][q] zero; false where it already is, to rounding.
fn eliminate(a: &mut [[f64; 4]; 4], vectors: &mut [[f64; 4]; 4], p: usize, q: usize) -> bool {
    let off = a[p][q];
    if off.abs() <= f64::EPSILON * 1e-2 * (a[p][p].abs() + a[q][q].abs()) {
        return false;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * off);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let cosine = 1.0 / t.hypot(1.0);
    let sine = t * cosine;
    for row in a.iter_mut().chain(vectors.iter_mut()) {
        let (x, y) = (row[p], row[q]);
        row[p] = cosine * x - sine * y;
        row[q] = sine * x + cosine * y;
    }
    let (row_p, row_q) = (a[p], a[q]);
    a[p] = [0, 1, 2, 3].map(|k| cosine * row_p[k] - sine * row_q[k]);
    a[q] = [0, 1, 2, 3].map(|k| sine * row_p[k] + cosine * row_q[k]);
    a[p][q] = 0.0;
    a[q][p] = 0.0;
    true
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;

    fn turns() -> Vec<Quat> {
        let axes = [Vec3::X, Vec3::Y, Vec3::NEG_Z, Vec3::new(1.0, 2.0, -3.0).normalize()];
        let angles = [0.0, 1e-6, 0.3, 1.5, PI - 1e-4, PI];
        axes.iter()
            .flat_map(|&axis| angles.iter().map(move |&angle| Quat::from_axis_angle(axis, angle)))
            .collect()
    }

    fn same(a: Quat, b: Quat) -> bool {
        a.dot(b).abs() > 1.0 - 1e-6
    }

    /// Proves that a scaled and sheared matrix R·S (S symmetric, positive) gives back R, which is
    /// the definition of the polar decomposition.
    #[test]
    fn polar_factor_of_scaled_rotations() {
        let other = Quat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
        let sheared = Mat3A::from_quat(other)
            * Mat3A::from_diagonal(Vec3::new(3.0, 0.2, 1e-3))
            * Mat3A::from_quat(other.inverse());
        for rotation in turns() {
            for stretch in [Mat3A::IDENTITY, Mat3A::IDENTITY * 1e-8, sheared] {
                let found = nearest_rotation(Mat3A::from_quat(rotation) * stretch).unwrap();
                assert!(same(found, rotation), "{found} for {rotation}");
            }
        }
    }

    /// Proves that what has no nearest rotation says so, and that a mirror with a smallest axis
    /// gives the rotation of the two larger ones: flattening is harmless, collapse is named.
    #[test]
    fn singular_and_mirrored_matrices() {
        assert_eq!(nearest_rotation(Mat3A::ZERO), None);
        assert_eq!(nearest_rotation(Mat3A::from_diagonal(Vec3::X)), None);
        assert_eq!(nearest_rotation(Mat3A::from_diagonal(Vec3::new(-1.0, 1.0, 1.0))), None);
        assert_eq!(nearest_rotation(Mat3A::IDENTITY * f32::NAN), None);
        for rotation in turns() {
            for smallest in [0.0, -0.1] {
                let squashed = Mat3A::from_diagonal(Vec3::new(1.0, 2.0, smallest));
                let found = nearest_rotation(Mat3A::from_quat(rotation) * squashed).unwrap();
                assert!(same(found, rotation), "{found} for {rotation}");
            }
        }
    }

    /// Proves that the mean ignores signs, is the midpoint of two, and is a rotation's own self.
    #[test]
    fn mean_of_rotations() {
        for rotation in turns() {
            assert!(same(mean_rotation([rotation, -rotation].into_iter()), rotation));
            let step = Quat::from_rotation_y(0.7);
            let mean = mean_rotation([rotation, -(rotation * step)].into_iter());
            assert!(same(mean, rotation * Quat::from_rotation_y(0.35)));
        }
        assert_eq!(mean_rotation(std::iter::empty()), Quat::IDENTITY);
    }

    /// Proves that the logarithm inverts the exponential up to half a turn, is indifferent to sign
    /// and length of the quaternion, and stays finite where there is no direction.
    #[test]
    fn rotation_vector_inverts_axis_angle() {
        let mean = Quat::from_euler(glam::EulerRot::XYZ, 1.0, 0.2, -0.5);
        let axis = Vec3::new(2.0, -1.0, 0.5).normalize();
        for angle in [0.0_f32, 1e-7, 1e-3, 0.5, 2.0, PI - 1e-3] {
            let rotation = mean * Quat::from_axis_angle(axis, angle);
            for scaled in [rotation, -rotation, rotation * 3.0] {
                let vector = rotation_vector(mean, scaled);
                assert!((vector - axis * angle).length() < 2e-6, "{vector} at {angle}");
            }
        }
        let half_turn = rotation_vector(Quat::IDENTITY, Quat::from_xyzw(1.0, 0.0, 0.0, 0.0));
        assert!((half_turn.length() - PI).abs() < 1e-6);
        assert_eq!(rotation_vector(mean, Quat::from_xyzw(0.0, 0.0, 0.0, 0.0)), Vec3::ZERO);
    }
}
