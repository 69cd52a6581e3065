//! How a surface turns from pose to pose where no skeleton says so (James and Twigg 2005, §4).

use glam::{Mat3, Vec3};

/// The rotation of every point since rest: the mean of its triangles' rotations, by their areas at rest; the
/// identity where there are none. A triangle's rotation takes its frame at rest (an edge, the normal and what is
/// square to both) to its posed one. `corners` are triangles by points.
///
/// # Panics
/// If a corner is no point of either pose.
#[must_use]
pub fn turns(corners: &[[u32; 3]], rest: &[Vec3], posed: &[Vec3]) -> Vec<Mat3> {
    let mut sums = vec![Mat3::ZERO; rest.len()];
    let mut areas = vec![0.0_f32; rest.len()];
    for corners in corners {
        let at = |places: &[Vec3]| corners.map(|point| places[point as usize]);
        let (Some((before, area)), Some((after, _))) = (frame(at(rest)), frame(at(posed))) else {
            continue;
        };
        let turn = after * before.transpose();
        for &point in corners {
            sums[point as usize] += turn * area;
            areas[point as usize] += area;
        }
    }
    let mean =
        |(sum, area): (Mat3, f32)| if area > 0.0 { sum * area.recip() } else { Mat3::IDENTITY };
    sums.into_iter().zip(areas).map(mean).collect()
}

/// A triangle's frame and area; nothing where it has none.
fn frame([a, b, c]: [Vec3; 3]) -> Option<(Mat3, f32)> {
    let (edge, across) = (b - a, (b - a).cross(c - a));
    let (x, z) = (edge.try_normalize()?, across.try_normalize()?);
    Some((Mat3::from_cols(x, z.cross(x), z), 0.5 * across.length()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    /// A rigid turn is every point's, whatever it is moved or scaled by; a fold is each side's own, and its
    /// mean on the crease; a point without triangles, or of none with an area, does not turn.
    #[test]
    fn turns_are_found() {
        let rest = [Vec3::ZERO, Vec3::X, Vec3::Y, -Vec3::X, Vec3::ONE, Vec3::ONE * 2.0];
        let corners = [[0, 1, 2], [0, 2, 3], [4, 4, 5]];
        let turn = Quat::from_rotation_x(0.7) * Quat::from_rotation_z(-1.1);
        let posed = rest.map(|p| 3.0 * (turn * p) + Vec3::new(5.0, 1.0, 2.0));
        let found = turns(&corners, &rest, &posed);
        assert!(found[..4].iter().all(|found| found.abs_diff_eq(Mat3::from_quat(turn), 1e-5)));
        assert_eq!((found[4], found[5]), (Mat3::IDENTITY, Mat3::IDENTITY));
        // The left half folds up about the y axis.
        let fold = Quat::from_rotation_y(0.8);
        let folded = rest.map(|p| if p.x < 0.0 { fold * p } else { p });
        let found = turns(&corners, &rest, &folded);
        assert!(found[1].abs_diff_eq(Mat3::IDENTITY, 1e-6));
        assert!(found[3].abs_diff_eq(Mat3::from_quat(fold), 1e-5));
        let mean = (Mat3::from_quat(fold) + Mat3::IDENTITY) * 0.5;
        assert!(found[0].abs_diff_eq(mean, 1e-5) && found[2].abs_diff_eq(mean, 1e-5));
    }
}
