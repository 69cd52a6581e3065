//! Meshes that tests trace.

use glam::Vec3;

/// A sphere of unit radius about the origin, from an octahedron split `levels` times; every
/// triangle counter-clockwise from outside.
pub(crate) fn sphere(levels: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions = vec![Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
    let mut triangles = vec![
        [0, 1, 2],
        [1, 3, 2],
        [3, 4, 2],
        [4, 0, 2],
        [1, 0, 5],
        [3, 1, 5],
        [4, 3, 5],
        [0, 4, 5],
    ];
    for _ in 0..levels {
        let mut next = Vec::new();
        for [a, b, c] in triangles {
            let [d, e, f] = [(a, b), (b, c), (c, a)].map(|(p, q): (u32, u32)| {
                positions.push((positions[p as usize] + positions[q as usize]).normalize());
                positions.len() as u32 - 1
            });
            next.extend([[a, d, f], [d, b, e], [f, e, c], [d, e, f]]);
        }
        triangles = next;
    }
    (positions, triangles)
}
