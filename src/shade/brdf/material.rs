//! A reflectance of either kind: in closed form or measured.

use std::sync::Arc;

use super::{Brdf, Merl, Reflectance, Sampling, examine};

/// Nodes by which energy is examined.
const EXAMINED_NODES: usize = 32;

/// What a surface reflects by.
#[derive(Debug, Clone, PartialEq)]
pub enum Material {
    /// A closed form.
    Analytic(Brdf),
    /// A measured table.
    Measured(Arc<Merl>),
}

impl Material {
    /// Nodes by which its integrals are taken, [`crate::shade::factor`]'s and [`examine`]'s: the work
    /// grows as their cube where only the difference of azimuths counts, else as their fourth power.
    #[must_use]
    pub fn nodes(&self) -> usize {
        if self.is_isotropic() { 64 } else { 24 }
    }

    /// What [`examine`] has against it, and what of its table was not measured; empty where nothing is
    /// wrong.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut told = examine(self, EXAMINED_NODES).warnings();
        if let Self::Measured(merl) = self
            && merl.missing() > 0
        {
            told.push(format!("{} cells of the table hold no measurement", merl.missing()));
        }
        told
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

    fn sampling(&self) -> Sampling {
        match self {
            Self::Analytic(brdf) => brdf.sampling(),
            Self::Measured(merl) => merl.sampling(),
        }
    }
}
