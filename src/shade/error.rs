//! Why a light cannot be made.

/// One reason, with the number at fault.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A map without texels, or with more or fewer than its size says.
    #[error("a map of {width} × {height} has {found} texels")]
    Texels {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Texels given.
        found: usize,
    },
    /// Texels that are NaN or infinite.
    #[error(
        "{count} texels of the map are NaN or infinite, the first in column {column}, row {row} \
         (counted from 0 at the top left); repaint or clamp them, since any value in their place \
         would be a guess"
    )]
    NotFinite {
        /// How many.
        count: usize,
        /// Of the first.
        column: usize,
        /// Of the first.
        row: usize,
    },
    /// A direction of no length.
    #[error("({x}, {y}, {z}) is no direction")]
    Direction {
        /// Towards +X.
        x: f64,
        /// Towards +Y.
        y: f64,
        /// Towards +Z.
        z: f64,
    },
    /// A colour that is not finite or negative.
    #[error("the colour ({0}, {1}, {2}) is not one of light: it must be finite and not negative")]
    Colour(f64, f64, f64),
    /// A cone that is not one.
    #[error("a cone's half angle is above 0° and at most 180°, not {degrees}°")]
    HalfAngle {
        /// Given.
        degrees: f64,
    },
    /// A sphere that has no size, or that surrounds the point.
    #[error(
        "a sphere of radius {radius} at distance {distance} has no closed form here: the radius \
         must be above 0 and below the distance"
    )]
    Sphere {
        /// Given.
        radius: f64,
        /// From the shaded point to the centre.
        distance: f64,
    },
    /// A window that scales no band, or all of them to nothing.
    #[error("the window's {what} must be finite and above 0, not {found}")]
    Window {
        /// Which parameter.
        what: &'static str,
        /// Given.
        found: f64,
    },
    /// A height field that is none.
    #[error(
        "a height field of {width} × {height} with {found} heights, {bad} of them not finite or \
         beyond ±1,000,000,000 m, {cell_m} m apart: it needs as many heights within that as its size \
         says, up to 67,108,864, and a distance of 0.000001 to 1,000,000,000 m"
    )]
    Heights {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Heights given.
        found: usize,
        /// Of these NaN, infinite or too far from 0.
        bad: usize,
        /// Metres between neighbours.
        cell_m: f32,
    },
    /// A number that no surface has.
    #[error("the {what} of a reflectance is from {least} to {most}, not {found}")]
    Reflectance {
        /// Which.
        what: &'static str,
        /// Given.
        found: f64,
        /// Allowed.
        least: f64,
        /// Allowed.
        most: f64,
    },
}
