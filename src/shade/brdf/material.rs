//! A reflectance of either kind: in closed form or measured.

use std::sync::Arc;

use super::{Brdf, Merl, Reflectance};

/// What a surface reflects by.
#[derive(Debug, Clone, PartialEq)]
pub enum Material {
    /// A closed form.
    Analytic(Brdf),
    /// A measured table.
    Measured(Arc<Merl>),
}

impl Material {
    /// Elevations by which its integrals are taken, [`crate::shade::factor`]'s `nodes`: the work grows
    /// as their cube where only the difference of azimuths counts, else as their fourth power.
    #[must_use]
    pub fn nodes(&self) -> usize {
        if self.is_isotropic() { 96 } else { 32 }
    }
}

impl From<Brdf> for Material {
    fn from(brdf: Brdf) -> Self {
        Self::Analytic(brdf)
    }
}

impl Reflectance for Material {
    fn reflect(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Analytic(brdf) => brdf.reflect(incoming, outgoing),
            Self::Measured(merl) => merl.reflect(incoming, outgoing),
        }
    }

    fn is_isotropic(&self) -> bool {
        match self {
            Self::Analytic(brdf) => brdf.is_isotropic(),
            Self::Measured(merl) => merl.is_isotropic(),
        }
    }
}
