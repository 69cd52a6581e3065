//! Closed forms.

use std::f64::consts::PI;

use super::{Error, Reflectance, Sampling};

/// A reflectance in closed form. Colours are red, green and blue, each from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Brdf {
    /// ρ/π.
    Lambert {
        /// ρ.
        albedo: [f64; 3],
    },
    /// ρ_d/π + ρ_s (e+2)/2π · cosᵉ α, with α between ω_o and the mirror image of ω_i: Phong's lobe as
    /// Lafortune and Willems (1994) normalise it, reciprocal and without gain for ρ_d + ρ_s ≤ 1.
    Phong {
        /// ρ_d.
        diffuse: [f64; 3],
        /// ρ_s.
        specular: [f64; 3],
        /// e.
        exponent: f64,
    },
    /// D G F / (4 cos θ_i cos θ_o): the distribution of Trowbridge and Reitz with Smith's
    /// height-correlated shadowing (Heitz 2014) and Schlick's Fresnel term.
    Ggx {
        /// Reflectance at normal incidence.
        normal_reflectance: [f64; 3],
        /// α along the tangent and along the bitangent, the square of what tools call roughness.
        alpha: [f64; 2],
    },
    /// The model of Ashikhmin and Shirley (2000), eqs. 4 and 5.
    AshikhminShirley {
        /// R_d.
        diffuse: [f64; 3],
        /// R_s, at normal incidence.
        specular: [f64; 3],
        /// n_u along the tangent and n_v along the bitangent.
        exponents: [f64; 2],
    },
}

impl Brdf {
    /// The reflectance, if its numbers are possible.
    ///
    /// # Errors
    /// [`Error::Reflectance`] names the number that is not.
    pub fn checked(self) -> Result<Self, Error> {
        let colour = |what, colour: [f64; 3]| range(what, &colour, 0.0, 1.0);
        match self {
            Self::Lambert { albedo } => colour("albedo", albedo)?,
            Self::Phong { diffuse, specular, exponent } => {
                colour("diffuse reflectance", diffuse)?;
                colour("specular reflectance", specular)?;
                range("exponent", &[exponent], 0.0, 1e6)?;
            }
            Self::Ggx { normal_reflectance, alpha } => {
                colour("reflectance at normal incidence", normal_reflectance)?;
                range("alpha", &alpha, 1e-3, 1.0)?;
            }
            Self::AshikhminShirley { diffuse, specular, exponents } => {
                colour("diffuse reflectance", diffuse)?;
                colour("specular reflectance", specular)?;
                range("exponent", &exponents, 0.0, 1e6)?;
            }
        }
        Ok(self)
    }
}

fn range(what: &'static str, values: &[f64], least: f64, most: f64) -> Result<(), Error> {
    match values.iter().find(|value| !(least..=most).contains(*value)) {
        Some(&found) => Err(Error::Reflectance { what, found, least, most }),
        None => Ok(()),
    }
}

impl Reflectance for Brdf {
    fn reflect(&self, i: [f64; 3], o: [f64; 3]) -> [f64; 3] {
        if i[2] <= 0.0 || o[2] <= 0.0 {
            return [0.0; 3];
        }
        match *self {
            Self::Lambert { albedo } => albedo.map(|rho| rho / PI),
            Self::Phong { diffuse, specular, exponent } => {
                let along = dot([-i[0], -i[1], i[2]], o).max(0.0);
                let lobe = (exponent + 2.0) / (2.0 * PI) * along.powf(exponent);
                std::array::from_fn(|c| diffuse[c] / PI + specular[c] * lobe)
            }
            Self::Ggx { normal_reflectance, alpha } => ggx(normal_reflectance, alpha, i, o),
            Self::AshikhminShirley { diffuse, specular, exponents } => {
                ashikhmin_shirley([diffuse, specular], exponents, i, o)
            }
        }
    }

    fn is_isotropic(&self) -> bool {
        match self {
            Self::Lambert { .. } | Self::Phong { .. } => true,
            Self::Ggx { alpha: [x, y], .. } | Self::AshikhminShirley { exponents: [x, y], .. } => {
                x == y
            }
        }
    }

    fn sampling(&self) -> Sampling {
        match *self {
            Self::Lambert { .. } => Sampling::Even,
            Self::Phong { exponent, .. } => Sampling::Mirror { exponent },
            Self::Ggx { alpha, .. } => Sampling::Facets { slopes: alpha },
            // cosⁿ θ is about exp(−n/2 · θ²).
            Self::AshikhminShirley { exponents, .. } => {
                Sampling::Facets { slopes: exponents.map(|n| (2.0 / (n + 2.0)).sqrt()) }
            }
        }
    }
}

fn ggx(f0: [f64; 3], [ax, ay]: [f64; 2], i: [f64; 3], o: [f64; 3]) -> [f64; 3] {
    let h = half(i, o);
    let stretched = (h[0] / ax).powi(2) + (h[1] / ay).powi(2) + h[2] * h[2];
    let distribution = 1.0 / (PI * ax * ay * stretched * stretched);
    // Λ + ½ of each direction, times its cosine: G / (4 cos cos) = ½ / (their mixed sum).
    let length = |w: [f64; 3]| ((ax * w[0]).powi(2) + (ay * w[1]).powi(2) + w[2] * w[2]).sqrt();
    let shadowing = 0.5 / (o[2] * length(i) + i[2] * length(o));
    let grazing = (1.0 - dot(i, h)).clamp(0.0, 1.0).powi(5);
    f0.map(|f0| distribution * shadowing * (f0 + (1.0 - f0) * grazing))
}

fn ashikhmin_shirley(
    [diffuse, specular]: [[f64; 3]; 2],
    [nu, nv]: [f64; 2],
    i: [f64; 3],
    o: [f64; 3],
) -> [f64; 3] {
    let h = half(i, o);
    let across = 1.0 - h[2] * h[2];
    let exponent = if across > 0.0 { (nu * h[0] * h[0] + nv * h[1] * h[1]) / across } else { 0.0 };
    let along = dot(i, h).max(f64::MIN_POSITIVE);
    let lobe = ((nu + 1.0) * (nv + 1.0)).sqrt() / (8.0 * PI) * h[2].max(0.0).powf(exponent)
        / (along * i[2].max(o[2]));
    let grazing = (1.0 - along).clamp(0.0, 1.0).powi(5);
    let open = |cosine: f64| 1.0 - (1.0 - cosine / 2.0).powi(5);
    let below = 28.0 / (23.0 * PI) * open(i[2]) * open(o[2]);
    std::array::from_fn(|c| {
        let (rd, rs) = (diffuse[c], specular[c]);
        below * rd * (1.0 - rs) + lobe * (rs + (1.0 - rs) * grazing)
    })
}

/// The unit vector half-way between two.
pub(super) fn half(i: [f64; 3], o: [f64; 3]) -> [f64; 3] {
    let sum: [f64; 3] = std::array::from_fn(|k| i[k] + o[k]);
    let length = dot(sum, sum).sqrt();
    if length > 0.0 { sum.map(|c| c / length) } else { [0.0, 0.0, 1.0] }
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers out of their range are refused by name.
    #[test]
    fn impossible_numbers_are_refused() {
        let refused = |brdf: Brdf, word: &str| {
            let message = brdf.checked().unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        };
        refused(Brdf::Lambert { albedo: [0.5, 1.2, 0.0] }, "albedo");
        refused(Brdf::Ggx { normal_reflectance: [0.5; 3], alpha: [0.0, 0.5] }, "alpha");
        refused(
            Brdf::Ggx { normal_reflectance: [f64::NAN; 3], alpha: [0.5; 2] },
            "normal incidence",
        );
        let phong = Brdf::Phong { diffuse: [0.0; 3], specular: [1.0; 3], exponent: -1.0 };
        refused(phong, "exponent");
        let (diffuse, specular) = ([0.1; 3], [-0.1; 3]);
        refused(Brdf::AshikhminShirley { diffuse, specular, exponents: [9.0; 2] }, "specular");
    }

    /// GGX's distribution of facets covers the surface once: ∫ D cos θ dω = 1, seen through the
    /// reflectance at normal incidence, where f = D/4 · G₂ with G₂ = 1/(1 + Λ(ω_o)).
    #[test]
    fn ggx_has_its_closed_form_at_normal_incidence() {
        let brdf = Brdf::Ggx { normal_reflectance: [1.0; 3], alpha: [0.3, 0.3] };
        for degrees in [0.0_f64, 10.0, 40.0, 70.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let (hs, hc) = (degrees / 2.0).to_radians().sin_cos();
            let d = 0.09 / (PI * (hc * hc * (0.09 - 1.0) + 1.0).powi(2));
            let lambda = ((1.0 + 0.09 * (sin / cos).powi(2)).sqrt() - 1.0) / 2.0;
            let expected = d / (4.0 * cos * (1.0 + lambda));
            let found = brdf.reflect([0.0, 0.0, 1.0], [sin, 0.0, cos])[1];
            assert!((found / expected - 1.0).abs() < 1e-12, "{degrees}: {found} {expected} {hs}");
        }
    }
}
