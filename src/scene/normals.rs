//! Normals where a file has none.

use glam::Vec3;

/// Fills the normals that are zero or not finite by the area-weighted mean of the triangles that
/// share the vertex *by index*: smooth over an indexed mesh, flat where triangles share no
/// vertices. (glTF asks for flat normals everywhere; splitting the vertices of an indexed mesh
/// for that would break the order that results are returned in.) A vertex without a proper
/// triangle gets +Y.
///
/// `triangles` index into `positions` after subtracting `first`. Returns how many were filled.
pub(super) fn complete(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    first: u32,
    normals: &mut [Vec3],
) -> usize {
    assert_eq!(positions.len(), normals.len(), "one normal per position");
    let missing: Vec<bool> = normals.iter().map(|normal| unit(*normal).is_none()).collect();
    let count = missing.iter().filter(|&&missing| missing).count();
    for normal in normals.iter_mut() {
        *normal = unit(*normal).unwrap_or(Vec3::Y);
    }
    if count == 0 {
        return 0;
    }
    let mut sums = vec![glam::DVec3::ZERO; positions.len()];
    for triangle in triangles {
        let at = triangle.map(|vertex| (vertex - first) as usize);
        let [a, b, c] = at.map(|vertex| positions[vertex].as_dvec3());
        let area = (b - a).cross(c - a);
        at.iter().for_each(|&vertex| sums[vertex] += area);
    }
    for ((normal, sum), missing) in normals.iter_mut().zip(&sums).zip(&missing) {
        if *missing && let Some(unit) = sum.try_normalize() {
            *normal = unit.as_vec3();
        }
    }
    count
}

/// Normalised in f64, so that neither tiny nor huge vectors lose their direction.
fn unit(normal: Vec3) -> Option<Vec3> {
    if !normal.is_finite() {
        return None;
    }
    normal.as_dvec3().try_normalize().map(|unit| unit.as_vec3())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles of areas 1 : 3 meeting at a right angle share an edge: its normal is their
    /// area-weighted mean, a corner of one alone has that one's, a given normal is only
    /// normalised, and an unused vertex gets +Y.
    #[test]
    fn missing_normals_are_area_weighted() {
        let at = |x, y, z| Vec3::new(x, y, z);
        let positions =
            [at(0., 0., 0.), at(0., 1., 0.), at(1., 0., 0.), at(0., 0., 3.), at(9., 9., 9.)];
        let triangles = [[10, 12, 11], [10, 11, 13]];
        let mut normals = [Vec3::ZERO; 5];
        normals[2] = at(0., 0., 2e-30);
        assert_eq!(complete(&positions, &triangles, 10, &mut normals), 4);
        let expected = at(3., 0., 1.).normalize();
        assert!((normals[0] - expected).length() < 1e-6, "{}", normals[0]);
        assert!((normals[3] - Vec3::X).length() < 1e-6);
        assert_eq!(normals[2], Vec3::Z);
        assert_eq!(normals[4], Vec3::Y);
    }
}
