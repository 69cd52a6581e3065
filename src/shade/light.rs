//! A distant light as coefficients of its radiance.

use std::f64::consts::PI;

use glam::DQuat;

use super::{Error, Window};
use crate::sh::{MAX_COEFFICIENTS, Order, Rotation, evaluate_f64, zonal};

/// Radiance from every direction, as n² coefficients for each of red, green and blue.
///
/// Units are those of the source: radiance for everything but [`ShLight::directional`], which takes
/// irradiance. Reflection by a surface that nothing shades is albedo · (transfer · l).
#[derive(Debug, Clone, PartialEq)]
pub struct ShLight {
    order: Order,
    colours: [Vec<f64>; 3],
}

impl ShLight {
    /// No light.
    #[must_use]
    pub fn black(order: Order) -> Self {
        Self { order, colours: std::array::from_fn(|_| vec![0.0; order.coefficients()]) }
    }

    /// The same radiance from everywhere: l_0 = √4π · L.
    ///
    /// # Errors
    /// [`Error::Colour`].
    pub fn constant(order: Order, radiance: [f64; 3]) -> Result<Self, Error> {
        check_colour(radiance)?;
        let mut light = Self::black(order);
        for (colour, radiance) in light.colours.iter_mut().zip(radiance) {
            colour[0] = (4.0 * PI).sqrt() * radiance;
        }
        Ok(light)
    }

    /// A light from one direction, which need not be unit: l_i = E · y_i(d), with E the irradiance
    /// of a surface that faces it.
    ///
    /// # Errors
    /// [`Error::Direction`], [`Error::Colour`].
    pub fn directional(
        order: Order,
        direction: [f64; 3],
        irradiance: [f64; 3],
    ) -> Result<Self, Error> {
        check_colour(irradiance)?;
        let mut y = vec![0.0; order.coefficients()];
        evaluate_f64(order, unit(direction)?, &mut y);
        Ok(Self { order, colours: irradiance.map(|e| y.iter().map(|y| e * y).collect()) })
    }

    /// The same radiance from everywhere within a half angle (radians) of an axis, which need not
    /// be unit, and none from elsewhere.
    ///
    /// # Errors
    /// [`Error::Direction`], [`Error::HalfAngle`], [`Error::Colour`].
    pub fn cone(
        order: Order,
        axis: [f64; 3],
        half_angle: f64,
        radiance: [f64; 3],
    ) -> Result<Self, Error> {
        check_colour(radiance)?;
        if !(half_angle > 0.0 && half_angle <= PI) {
            return Err(Error::HalfAngle { degrees: half_angle.to_degrees() });
        }
        let mut along = vec![0.0; order.coefficients()];
        zonal::rotate_f64(order, &zonal::cap(order, half_angle), unit(axis)?, &mut along);
        Ok(Self { order, colours: radiance.map(|l| along.iter().map(|x| l * x).collect()) })
    }

    /// A sphere that shines with the same radiance all over, seen from the origin: a cone of half
    /// angle asin(r/d).
    ///
    /// # Errors
    /// [`Error::Sphere`], [`Error::Colour`].
    pub fn sphere(
        order: Order,
        centre: [f64; 3],
        radius: f64,
        radiance: [f64; 3],
    ) -> Result<Self, Error> {
        let distance = centre.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !(radius > 0.0 && radius < distance && distance.is_finite()) {
            return Err(Error::Sphere { radius, distance });
        }
        Self::cone(order, centre, (radius / distance).asin(), radiance)
    }

    /// A light given by its coefficients.
    ///
    /// # Panics
    /// If a colour has not n² of them.
    #[must_use]
    pub fn from_coefficients(order: Order, colours: [Vec<f64>; 3]) -> Self {
        let found = colours.each_ref().map(Vec::len);
        assert_eq!(found, [order.coefficients(); 3], "coefficients of a light");
        Self { order, colours }
    }

    /// The order.
    #[must_use]
    pub fn order(&self) -> Order {
        self.order
    }

    /// n² coefficients each of red, green and blue.
    #[must_use]
    pub fn colours(&self) -> &[Vec<f64>; 3] {
        &self.colours
    }

    /// The three colours of coefficient `i`, 0 beyond the order.
    #[must_use]
    pub fn coefficient(&self, i: usize) -> [f64; 3] {
        self.colours.each_ref().map(|colour| colour.get(i).copied().unwrap_or(0.0))
    }

    /// Adds another light of the same order.
    ///
    /// # Panics
    /// If the orders differ.
    pub fn add(&mut self, other: &Self) {
        assert_eq!(self.order, other.order, "orders of two lights");
        for (own, other) in self.colours.iter_mut().zip(&other.colours) {
            own.iter_mut().zip(other).for_each(|(own, other)| *own += other);
        }
    }

    /// Takes another light of the same order away; what is left may be negative.
    ///
    /// # Panics
    /// If the orders differ.
    pub fn subtract(&mut self, other: &Self) {
        assert_eq!(self.order, other.order, "orders of two lights");
        for (own, other) in self.colours.iter_mut().zip(&other.colours) {
            own.iter_mut().zip(other).for_each(|(own, other)| *own -= other);
        }
    }

    /// Its coefficients.
    #[must_use]
    pub fn into_colours(self) -> [Vec<f64>; 3] {
        self.colours
    }

    /// The light turned by `rotation`: what came from ω comes from Rω.
    ///
    /// # Panics
    /// If the quaternion is zero or not finite.
    #[must_use]
    pub fn rotated(&self, rotation: DQuat) -> Self {
        let mut turn = Rotation::identity(self.order);
        turn.set_f64(rotation.to_array());
        let turned = |colour: &Vec<f64>| {
            let mut out = vec![0.0; colour.len()];
            turn.apply_f64(colour, &mut out);
            out
        };
        Self { order: self.order, colours: self.colours.each_ref().map(turned) }
    }

    /// The light with every band scaled by the window's factor.
    #[must_use]
    pub fn windowed(&self, window: Window) -> Self {
        let mut out = self.clone();
        for colour in &mut out.colours {
            for (i, value) in colour.iter_mut().enumerate() {
                *value *= window.factor(i.isqrt());
            }
        }
        out
    }

    /// The light's first bands, or the same with zeros after them.
    #[must_use]
    pub fn resized(&self, order: Order) -> Self {
        let mut out = self.clone();
        out.order = order;
        out.colours.iter_mut().for_each(|colour| colour.resize(order.coefficients(), 0.0));
        out
    }

    /// The largest luminance (Rec. 709 weights) that a white Lambertian surface reflects where
    /// nothing shades it, over all normals: the best of 4,096 spread by the golden angle.
    #[must_use]
    pub fn brightest_reflection(&self) -> f64 {
        let cosine = zonal::clamped_cosine(self.order);
        let reflected: Vec<f64> = (0..self.order.coefficients())
            .map(|i| {
                let (l, [r, g, b]) = (i.isqrt(), self.coefficient(i));
                let scale = (4.0 / (PI * (2 * l + 1) as f64)).sqrt() * cosine[l];
                scale * (0.2126 * r + 0.7152 * g + 0.0722 * b)
            })
            .collect();
        let golden = PI * (3.0 - 5_f64.sqrt());
        let mut y = [0.0; MAX_COEFFICIENTS];
        let shaded = |i: u32| {
            let z = 1.0 - (f64::from(i) + 0.5) / 2048.0;
            let (r, angle) = ((1.0 - z * z).sqrt(), golden * f64::from(i));
            evaluate_f64(self.order, [r * angle.cos(), r * angle.sin(), z], &mut y);
            reflected.iter().zip(&y).map(|(a, b)| a * b).sum::<f64>()
        };
        (0..4096).map(shaded).fold(0.0, f64::max)
    }

    /// Radiance from a unit direction, as far as the bands tell it; it may be negative.
    #[must_use]
    pub fn radiance(&self, direction: [f64; 3]) -> [f64; 3] {
        let mut y = [0.0; MAX_COEFFICIENTS];
        evaluate_f64(self.order, direction, &mut y);
        self.colours.each_ref().map(|colour| colour.iter().zip(&y).map(|(l, y)| l * y).sum())
    }
}

/// The direction as a unit vector.
pub(super) fn unit(direction: [f64; 3]) -> Result<[f64; 3], Error> {
    let [x, y, z] = direction;
    let largest = x.abs().max(y.abs()).max(z.abs());
    if !(x.is_finite() && y.is_finite() && z.is_finite() && largest > 0.0) {
        return Err(Error::Direction { x, y, z });
    }
    let scaled = direction.map(|c| c / largest);
    let length = scaled.iter().map(|c| c * c).sum::<f64>().sqrt();
    Ok(scaled.map(|c| c / length))
}

fn check_colour(colour: [f64; 3]) -> Result<(), Error> {
    let [r, g, b] = colour;
    let is_light = colour.iter().all(|c| c.is_finite() && *c >= 0.0);
    if is_light { Ok(()) } else { Err(Error::Colour(r, g, b)) }
}

#[cfg(test)]
mod tests;
