//! How surfaces reflect: f(ω_i, ω_o) per steradian in the tangent frame (+Z normal, +X tangent).

mod analytic;
mod examine;
mod material;
mod merl;
mod rule;

pub use analytic::Brdf;
pub use examine::{Examination, examine};
pub use material::Material;
pub use merl::{Merl, MerlError};
pub(in crate::shade) use rule::Rule;
pub use rule::Sampling;

use super::Error;

/// A reflectance that operators can be made of.
pub trait Reflectance: Sync {
    /// f(ω_i, ω_o) for red, green and blue, without the cosine; 0 where either unit direction is
    /// not above the surface.
    fn reflect(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3];

    /// Whether only the difference of the azimuths counts, and not its sign.
    fn is_isotropic(&self) -> bool;

    /// Where integrals take their directions from.
    fn sampling(&self) -> Sampling {
        Sampling::Even
    }
}
