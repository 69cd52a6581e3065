//! Level ground: a solid half-space that rays meet without a tree.

use crate::trace::Rays;

/// Sets the bits of rays that the ground blocks; `height` is that of the point over the ground, in
/// the rays' lengths, negative in the ground.
pub(super) fn block(rays: &Rays<'_>, height: f32, blocked: &mut [u64]) {
    // What is never met is at no distance, not at an infinite one.
    let far = rays.far.min(f32::MAX);
    for (word, lanes) in blocked.iter_mut().zip(rays.y.chunks(64)) {
        for (lane, &y) in lanes.iter().enumerate() {
            let distance = distance(y, height, rays.near);
            *word |= u64::from(distance <= far) << lane;
        }
    }
}

/// Where a ray of unit direction with vertical part `y` first is in the ground, not nearer than
/// `near`; infinite where it never is.
#[inline]
pub(super) fn distance(y: f32, height: f32, near: f32) -> f32 {
    if y < 0.0 {
        // Downwards it stays in there once it is in.
        (height.max(0.0) / -y).max(near)
    } else if height < 0.0 && (y == 0.0 || height / -y > near) {
        near
    } else {
        f32::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Proves where rays meet the ground: from above at height / cosine, on the ground at once and
    /// only downwards, inside always, and inside with a least distance only as far as the ground
    /// reaches.
    #[test]
    fn rays_meet_the_half_space() {
        assert_eq!(distance(-0.5, 2.0, 0.0), 4.0);
        assert_eq!(distance(-0.5, 2.0, 5.0), 5.0);
        assert_eq!(distance(0.5, 2.0, 0.0), f32::INFINITY);
        assert_eq!(distance(-1.0, 0.0, 0.0), 0.0);
        for y in [0.0, 0.5] {
            assert_eq!(distance(y, 0.0, 0.0), f32::INFINITY, "on the ground");
        }
        for y in [-1.0, 0.0, 0.5, 1.0] {
            assert_eq!(distance(y, -0.25, 0.0), 0.0, "in the ground");
        }
        assert_eq!(distance(0.5, -1.0, 1.5), 1.5);
        assert_eq!(distance(0.5, -1.0, 2.5), f32::INFINITY);
    }

    /// Proves that bits land where rays are and that the far end cuts.
    #[test]
    fn bits_are_those_of_single_rays() {
        let y: Vec<f32> = (0..100).map(|i| i as f32 / 50.0 - 1.0).collect();
        let zero = vec![0.0; 100];
        let (x, z) = (&zero, &zero);
        let rays = Rays { origin: glam::Vec3::ZERO, x, y: &y, z, near: 0.0, far: 3.0 };
        let mut blocked = vec![0; 2];
        block(&rays, 1.0, &mut blocked);
        for (i, &y) in y.iter().enumerate() {
            let expected = y < 0.0 && 1.0 / -y <= 3.0;
            assert_eq!(blocked[i / 64] >> (i % 64) & 1 == 1, expected, "{y}");
        }
    }
}
