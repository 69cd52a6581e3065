//! Triangles from lists, strips and fans (glTF 2.0 §3.7.2.1).

use gltf::json::mesh::Mode;

/// How many triangles a primitive of so many corners has; `None` for points and lines.
pub(super) fn triangle_count(mode: Mode, corners: usize) -> Option<usize> {
    match mode {
        Mode::Triangles => Some(corners / 3),
        Mode::TriangleStrip | Mode::TriangleFan => Some(corners.saturating_sub(2)),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => None,
    }
}

/// The triangles of a primitive; every second one of a strip is turned so that all wind alike.
pub(super) fn triangles(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    let count = triangle_count(mode, corners.len()).unwrap_or(0);
    let triangle = |i: usize| match mode {
        Mode::TriangleStrip => {
            let odd = i % 2;
            [corners[i], corners[i + 1 + odd], corners[i + 2 - odd]]
        }
        Mode::TriangleFan => [corners[i + 1], corners[i + 2], corners[0]],
        _ => [corners[3 * i], corners[3 * i + 1], corners[3 * i + 2]],
    };
    (0..count).map(triangle).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Strips and fans of a planar quad wind as the specification's formulas say, short ones are
    /// empty, and an incomplete last triangle is left out.
    #[test]
    fn topologies_follow_the_specification() {
        let corners = [0, 1, 2, 3, 4];
        assert_eq!(triangles(Mode::TriangleStrip, &corners), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(triangles(Mode::TriangleFan, &corners), [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
        assert_eq!(triangles(Mode::Triangles, &corners), [[0, 1, 2]]);
        assert!(triangles(Mode::TriangleStrip, &[0, 1]).is_empty());
        assert!(triangles(Mode::TriangleFan, &[]).is_empty());
        assert_eq!(triangle_count(Mode::LineLoop, 9), None);
    }
}
