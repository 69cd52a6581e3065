//! Where a picture is taken from.

use glam::Vec3;

/// The vertical field of view, radians: a long lens, so that bodies are not distorted.
const FIELD_OF_VIEW: f32 = 0.45;

/// Room around what is looked at.
const MARGIN: f32 = 1.06;

/// A pinhole camera with square pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    eye: Vec3,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    /// Half the picture's height at distance 1.
    half_height: f32,
    width: u32,
    height: u32,
}

impl Camera {
    /// Looks at a box from a yaw (radians about +Y, from +Z towards +X) and a pitch (radians
    /// upwards, below a right angle), from as near as keeps all of the box in the picture.
    #[must_use]
    pub fn around(
        [low, high]: [Vec3; 2],
        [yaw, pitch]: [f32; 2],
        [width, height]: [u32; 2],
    ) -> Self {
        let (centre, reach) = (low * 0.5 + high * 0.5, high * 0.5 - low * 0.5);
        let from = Vec3::new(yaw.sin() * pitch.cos(), pitch.sin(), yaw.cos() * pitch.cos());
        let forward = -from;
        let right = Vec3::new(yaw.cos(), 0.0, -yaw.sin());
        let up = right.cross(forward);
        let half_height = (FIELD_OF_VIEW / 2.0).tan();
        let half_width = half_height * width as f32 / height as f32;
        // A corner at (x, y, z) from the centre is inside from distances D with |x| ≤ (D + z) tan.
        let signs = [-1.0, 1.0];
        let corners = signs.iter().flat_map(|x| {
            signs.iter().flat_map(move |y| signs.map(|z| reach * Vec3::new(*x, *y, z)))
        });
        let needed = |corner: Vec3| {
            let across = corner.dot(right).abs() / half_width;
            across.max(corner.dot(up).abs() / half_height) - corner.dot(forward)
        };
        let distance = MARGIN * corners.map(needed).fold(f32::MIN_POSITIVE, f32::max);
        Self { eye: centre + from * distance, forward, right, up, half_height, width, height }
    }

    /// As [`Camera::around`], from as far as keeps the box in the picture from every yaw, so that a turn
    /// about it is steady.
    #[must_use]
    pub fn turning([low, high]: [Vec3; 2], view: [f32; 2], size: [u32; 2]) -> Self {
        let (centre, reach) = (low * 0.5 + high * 0.5, high * 0.5 - low * 0.5);
        let aside = reach.x.hypot(reach.z);
        let reach = Vec3::new(aside, reach.y, aside);
        let widened = [centre - reach, centre + reach];
        let steady = (Self::around(widened, [0.0, view[1]], size).eye - centre).length();
        let mut camera = Self::around(widened, view, size);
        camera.eye = centre - camera.forward * steady;
        camera
    }

    /// Pixels, across and down.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Where all rays start.
    #[must_use]
    pub fn eye(&self) -> Vec3 {
        self.eye
    }

    /// The unit direction through a point of the picture, in pixels from its top left corner.
    #[must_use]
    pub fn direction(&self, x: f32, y: f32) -> Vec3 {
        let unit = 2.0 * self.half_height / self.height as f32;
        let across = (x - self.width as f32 / 2.0) * unit;
        let down = (y - self.height as f32 / 2.0) * unit;
        (self.forward + self.right * across - self.up * down).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From the front, +X is to the right and +Y up; the middle of the picture is the middle of
    /// the box; every corner of the box is inside the picture, also in a narrow one.
    #[test]
    fn the_whole_box_is_seen() {
        let bounds = [Vec3::new(-1.0, 0.0, -0.5), Vec3::new(1.0, 3.0, 0.5)];
        for (size, yaw, pitch) in
            [([40, 40], 0.0, 0.0), ([20, 60], 0.7, 0.3), ([90, 30], 3.0, -1.2)]
        {
            let camera = Camera::around(bounds, [yaw, pitch], size);
            let [width, height] = size.map(|s| s as f32);
            let middle = (Vec3::new(0.0, 1.5, 0.0) - camera.eye()).normalize();
            assert!(camera.direction(width / 2.0, height / 2.0).dot(middle) > 0.999_99);
            for corner in 0..8 {
                let pick = |axis: usize| bounds[corner >> axis & 1][axis];
                let to = Vec3::new(pick(0), pick(1), pick(2)) - camera.eye();
                let depth = to.dot(camera.forward);
                let [x, y] = [to.dot(camera.right), to.dot(camera.up)].map(|c| (c / depth).abs());
                assert!(y < camera.half_height && x < camera.half_height * width / height);
            }
        }
        let front = Camera::around(bounds, [0.0, 0.0], [10, 10]);
        assert!(front.direction(9.0, 5.0).x > 0.0 && front.direction(5.0, 1.0).y > 0.0);
    }

    /// A turn keeps its distance, and the box in the picture from every side.
    #[test]
    fn turns_are_steady() {
        let bounds = [Vec3::new(-1.0, 0.0, -0.2), Vec3::new(1.0, 2.0, 0.2)];
        let middle = Vec3::new(0.0, 1.0, 0.0);
        let first = (Camera::turning(bounds, [0.0, 0.2], [30, 40]).eye() - middle).length();
        for step in 0..12 {
            let camera =
                Camera::turning(bounds, [step as f32 * std::f32::consts::FRAC_PI_6, 0.2], [30, 40]);
            assert!(((camera.eye() - middle).length() - first).abs() < 1e-4);
            for corner in 0..8 {
                let pick = |axis: usize| bounds[corner >> axis & 1][axis];
                let to = Vec3::new(pick(0), pick(1), pick(2)) - camera.eye();
                let depth = to.dot(camera.forward);
                let [x, y] = [to.dot(camera.right), to.dot(camera.up)].map(|c| (c / depth).abs());
                assert!(y < camera.half_height && x < camera.half_height * 0.75, "{step} {corner}");
            }
        }
    }
}
