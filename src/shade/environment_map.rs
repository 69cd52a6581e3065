//! Equirectangular maps: every texel is a patch of the sphere with one radiance.
//!
//! Where a map points: its top row surrounds +Y, the middle of its width is +X, and to the right
//! follow +Z, −X and −Z (a viewer inside sees it the right way round; three.js and most viewers
//! place it so).

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DQuat;

use super::{Error, ShLight};
use crate::sh::{MAX_BANDS, MAX_COEFFICIENTS, Order, evaluate_f64, gauss_legendre};

/// Nodes for each panel of polar angle.
const NODES: usize = 8;

/// Panels that the polar angle from pole to pole is cut into at least: eight nodes each integrate
/// bands below 10, times the sine, to f64 round-off.
const PANELS: usize = 16;

/// A map in memory, row by row from the top.
#[derive(Debug, Clone, Copy)]
pub struct EnvironmentMap<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear radiance, red, green and blue; `width · height` of them.
    pub texels: &'a [[f32; 3]],
}

/// What was found in a map on the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapFacts {
    /// Texels with a negative colour, which was taken as 0.
    pub negative_texels: usize,
    /// The radiance that this added, averaged over the sphere.
    pub clamped_radiance: [f64; 3],
    /// Averaged over the sphere.
    pub mean_radiance: [f64; 3],
    /// The brightest texel of each colour.
    pub max_radiance: [f32; 3],
}

impl EnvironmentMap<'_> {
    /// l_i = Σ over texels of L · ∫ y_i dω over the texel: the exact projection of the map as a
    /// function that is constant on each texel, so the weights are exact solid angles and a map of
    /// one texel is the constant light. Negative colours, which some renderers' filters leave
    /// behind, count as 0 and are reported.
    ///
    /// # Errors
    /// [`Error::Texels`], [`Error::NotFinite`].
    pub fn project(&self, order: Order) -> Result<(ShLight, MapFacts), Error> {
        self.check()?;
        let columns = Columns::new(self.width, order.bands());
        let mut facts = MapFacts {
            negative_texels: 0,
            clamped_radiance: [0.0; 3],
            mean_radiance: [0.0; 3],
            max_radiance: [0.0; 3],
        };
        let mut colours: [Vec<f64>; 3] = std::array::from_fn(|_| vec![0.0; order.coefficients()]);
        for (row, texels) in self.texels.chunks_exact(self.width).enumerate() {
            facts.note(texels, band_of_sphere(row, self.height) / self.width as f64);
            let around = columns.sums(texels);
            let along = polar_integrals(order, row, self.height);
            for (colour, around) in colours.iter_mut().zip(&around) {
                for l in 0..order.bands() {
                    let centre = l * (l + 1);
                    colour[centre] += along[centre] * around[0][0];
                    for m in 1..=l {
                        colour[centre + m] += along[centre + m] * around[m][0];
                        colour[centre - m] += along[centre + m] * around[m][1];
                    }
                }
            }
        }
        // The map's own axes have its vertical as +Z; this takes +Z to +Y and −Y to +Z.
        let upright = DQuat::from_rotation_x(-FRAC_PI_2);
        Ok((ShLight::from_coefficients(order, colours).rotated(upright), facts))
    }

    fn check(&self) -> Result<(), Error> {
        let Self { width, height, texels } = *self;
        if texels.is_empty() || width.checked_mul(height) != Some(texels.len()) {
            return Err(Error::Texels { width, height, found: texels.len() });
        }
        let bad = |texel: &[f32; 3]| texel.iter().any(|c| !c.is_finite());
        let Some(first) = texels.iter().position(bad) else { return Ok(()) };
        let count = texels[first..].iter().filter(|texel| bad(texel)).count();
        Err(Error::NotFinite { count, column: first % width, row: first / width })
    }
}

impl MapFacts {
    /// Adds a row whose texels are each this share of the sphere.
    fn note(&mut self, texels: &[[f32; 3]], share: f64) {
        for texel in texels {
            self.negative_texels += usize::from(texel.iter().any(|c| *c < 0.0));
            for (c, &value) in texel.iter().enumerate() {
                self.mean_radiance[c] += share * f64::from(value.max(0.0));
                self.clamped_radiance[c] += share * f64::from((-value).max(0.0));
                self.max_radiance[c] = self.max_radiance[c].max(value);
            }
        }
    }
}

/// The share of the sphere that a row covers: half the difference of the cosines of its edges,
/// as a product that keeps its digits.
fn band_of_sphere(row: usize, height: usize) -> f64 {
    let step = PI / height as f64;
    ((row as f64 + 0.5) * step).sin() * (step / 2.0).sin()
}

/// ∫ over a row's polar angle of what y_lm depends on there, times the sine, at index l(l+1)+m for
/// m ≥ 0.
fn polar_integrals(order: Order, row: usize, height: usize) -> [f64; MAX_COEFFICIENTS] {
    let mut out = [0.0; MAX_COEFFICIENTS];
    let mut y = [0.0; MAX_COEFFICIENTS];
    let panels = PANELS.div_ceil(height);
    let half = PI / (2 * height * panels) as f64;
    for panel in row * panels..(row + 1) * panels {
        let middle = (2 * panel + 1) as f64 * half;
        for (x, weight) in gauss_legendre(NODES) {
            let (sin, cos) = (middle + half * x).sin_cos();
            evaluate_f64(order, [sin, 0.0, cos], &mut y);
            for (out, y) in out.iter_mut().zip(&y) {
                *out += half * weight * sin * y;
            }
        }
    }
    out
}

/// ∫ cos mφ and ∫ sin mφ over every column.
struct Columns {
    bands: usize,
    /// `[column][m]`
    integrals: Vec<[[f64; 2]; MAX_BANDS]>,
}

impl Columns {
    fn new(width: usize, bands: usize) -> Self {
        let step = TAU / width as f64;
        let column = |c: usize| {
            // The map turns the other way than azimuth does about its vertical.
            let middle = PI - (c as f64 + 0.5) * step;
            std::array::from_fn(|m| {
                let m = m as f64;
                let length = if m == 0.0 { step } else { 2.0 * (m * step / 2.0).sin() / m };
                let (sin, cos) = (m * middle).sin_cos();
                [length * cos, length * sin]
            })
        };
        Self { bands, integrals: (0..width).map(column).collect() }
    }

    /// The integrals of a row's radiance times cos mφ and sin mφ, `[colour][m]`.
    fn sums(&self, texels: &[[f32; 3]]) -> [[[f64; 2]; MAX_BANDS]; 3] {
        let mut sums = [[[0.0; 2]; MAX_BANDS]; 3];
        for (texel, integrals) in texels.iter().zip(&self.integrals) {
            for (sums, value) in sums.iter_mut().zip(texel) {
                let value = f64::from(value.max(0.0));
                for (sum, [cos, sin]) in sums.iter_mut().zip(&integrals[..self.bands]) {
                    sum[0] += value * cos;
                    sum[1] += value * sin;
                }
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(bands: u8) -> Order {
        Order::new(bands).unwrap()
    }

    fn noise(count: usize) -> Vec<[f32; 3]> {
        let value = |i: usize| ((i * 7919 + 13) % 101) as f32 / 20.0;
        (0..count).map(|i| [value(3 * i), value(3 * i + 1), value(3 * i + 2)]).collect()
    }

    /// The direction that three.js looks a texture coordinate up for, inverted:
    /// u = atan2(z, x)/2π + 1/2, and v = 1 at the top.
    fn direction(u: f64, from_top: f64) -> [f64; 3] {
        let (azimuth, polar) = (TAU * (u - 0.5), PI * from_top);
        [polar.sin() * azimuth.cos(), polar.cos(), polar.sin() * azimuth.sin()]
    }

    /// A map of random texels of any shape is what plain integration over every texel, in the
    /// directions that the convention states, gives to 1e-11 at order 10.
    #[test]
    fn projection_agrees_with_integration_over_texels() {
        for (width, height) in [(1, 1), (1, 2), (3, 1), (7, 4)] {
            let texels = noise(width * height);
            let map = EnvironmentMap { width, height, texels: &texels };
            let (light, _) = map.project(order(10)).unwrap();
            let mut expected = [0.0; 100];
            let mut y = [0.0; 100];
            let nodes = gauss_legendre(32);
            for (i, texel) in texels.iter().enumerate() {
                for (a, wa) in &nodes {
                    for (b, wb) in &nodes {
                        let u = ((i % width) as f64 + 0.5 + 0.5 * a) / width as f64;
                        let v = ((i / width) as f64 + 0.5 + 0.5 * b) / height as f64;
                        let area = wa * wb * 0.25 * TAU * PI / (width * height) as f64;
                        evaluate_f64(order(10), direction(u, v), &mut y);
                        let value = area * (PI * v).sin() * f64::from(texel[1]);
                        expected.iter_mut().zip(&y).for_each(|(e, y)| *e += value * y);
                    }
                }
            }
            for (k, (a, b)) in light.colours()[1].iter().zip(&expected).enumerate() {
                assert!((a - b).abs() < 1e-11, "{width}x{height}, {k}: {a} {b}");
            }
        }
    }

    /// A map of one value is the constant light to round-off, whatever its size, and says its mean.
    #[test]
    fn even_maps_are_constant_light() {
        for (width, height) in [(1, 1), (64, 32), (5, 3)] {
            let texels = vec![[0.5, 1.0, 2.0]; width * height];
            let map = EnvironmentMap { width, height, texels: &texels };
            let (light, facts) = map.project(order(10)).unwrap();
            let expected = ShLight::constant(order(10), [0.5, 1.0, 2.0]).unwrap();
            for (found, expected) in light.colours().iter().zip(expected.colours()) {
                assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12));
            }
            assert!((facts.mean_radiance[2] - 2.0).abs() < 1e-12, "{facts:?}");
            assert_eq!((facts.negative_texels, facts.max_radiance), (0, [0.5, 1.0, 2.0]));
        }
    }

    /// One bright texel is a light from its direction: up, ahead, right and left in turn.
    #[test]
    fn a_bright_texel_lights_from_where_it_stands() {
        let (width, height) = (64, 32);
        for (column, row, towards) in [
            (31, 16, [1.0, 0.0, 0.0]),
            (47, 15, [0.0, 0.0, 1.0]),
            (63, 16, [-1.0, 0.0, 0.0]),
            (15, 16, [0.0, 0.0, -1.0]),
            (20, 0, [0.0, 1.0, 0.0]),
            (3, 31, [0.0, -1.0, 0.0]),
        ] {
            let mut texels = vec![[0.0; 3]; width * height];
            texels[row * width + column] = [100.0; 3];
            let map = EnvironmentMap { width, height, texels: &texels };
            let (light, facts) = map.project(order(4)).unwrap();
            let irradiance = 4.0 * PI * facts.mean_radiance[0];
            let sun = ShLight::directional(order(4), towards, [irradiance; 3]).unwrap();
            let off: f64 = light.colours()[0]
                .iter()
                .zip(&sun.colours()[0])
                .map(|(a, b)| (a - b).powi(2))
                .sum();
            let all: f64 = sun.colours()[0].iter().map(|x| x * x).sum();
            assert!(off < 0.02 * all, "{towards:?}: {off} of {all}");
        }
    }

    /// NaN and infinity are refused with their place and number, wrong sizes with theirs; negative
    /// texels count as 0 and are told; a black map is no light.
    #[test]
    fn bad_maps_are_refused_or_clamped() {
        let mut texels = vec![[1.0; 3]; 8];
        texels[5][1] = f32::NAN;
        texels[6][0] = f32::INFINITY;
        let project = |width, texels: &[[f32; 3]]| {
            EnvironmentMap { width, height: 2, texels }.project(order(3))
        };
        let found = project(4, &texels).unwrap_err();
        assert_eq!(found, Error::NotFinite { count: 2, column: 1, row: 1 });
        assert_eq!(
            project(3, &texels).unwrap_err(),
            Error::Texels { width: 3, height: 2, found: 8 }
        );
        assert!(project(0, &[]).is_err());
        let (light, facts) = project(1, &[[-2.0, 1.0, 1.0], [4.0, 1.0, 1.0]]).unwrap();
        assert_eq!(facts.negative_texels, 1);
        assert!((facts.clamped_radiance[0] - 1.0).abs() < 1e-12, "{facts:?}");
        assert!((light.coefficient(0)[0] - 2.0 * (4.0 * PI).sqrt()).abs() < 1e-12);
        let (black, facts) = project(2, &[[0.0; 3]; 4]).unwrap();
        assert_eq!(black, ShLight::black(order(3)));
        assert_eq!(facts.mean_radiance, [0.0; 3]);
    }
}
