//! Whether a reflectance is possible: reciprocity and the conservation of energy.

use std::f64::consts::TAU;

use super::Reflectance;
use crate::sh::gauss_legendre;

/// Directions that are looked from: elevations and azimuths.
const VIEWS: [usize; 2] = [8, 6];

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Examination {
    /// The largest ∫ f cos θ_i dω_i over views and colours; above 1 energy is made.
    pub largest_albedo: f64,
    /// The largest |f(a, b) − f(b, a)| over pairs of directions, in units of the largest f there.
    pub reciprocity_error: f64,
    /// Whether a value was negative or not finite.
    pub has_bad_values: bool,
}

impl Examination {
    /// What is wrong, in sentences with the numbers; empty where nothing is.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut out = Vec::new();
        if self.largest_albedo > 1.005 {
            out.push(format!(
                "the reflectance makes energy: {:.4} of the light comes back in one direction",
                self.largest_albedo
            ));
        }
        if self.reciprocity_error > 1e-3 {
            out.push(format!(
                "the reflectance is not reciprocal: exchanged directions differ by {:.2} % of its \
                 largest value",
                100.0 * self.reciprocity_error
            ));
        }
        if self.has_bad_values {
            out.push("the reflectance has values that are negative or not finite".to_owned());
        }
        out
    }
}

/// Looks at a reflectance from 48 directions, down to 3.6° over the surface, and integrates over the
/// hemisphere of each by a product of `nodes` Gauss–Legendre elevations and eight times as many
/// azimuths: lobes near the horizon are narrow sideways.
#[must_use]
pub fn examine(reflectance: &impl Reflectance, nodes: usize) -> Examination {
    let lights = directions(nodes, 8 * nodes);
    let views = views();
    let mut found =
        Examination { largest_albedo: 0.0, reciprocity_error: 0.0, has_bad_values: false };
    let (mut largest, mut apart) = (0.0_f64, 0.0_f64);
    for o in &views {
        let mut albedo = [0.0; 3];
        for (i, area) in &lights {
            let f = reflectance.reflect(*i, *o);
            found.has_bad_values |= f.iter().any(|f| !(f.is_finite() && *f >= 0.0));
            albedo.iter_mut().zip(f).for_each(|(sum, f)| *sum += area * i[2] * f);
        }
        found.largest_albedo = albedo.iter().copied().fold(found.largest_albedo, f64::max);
        for i in &views {
            let (there, back) = (reflectance.reflect(*i, *o), reflectance.reflect(*o, *i));
            for (a, b) in there.iter().zip(back) {
                largest = largest.max(a.abs());
                apart = apart.max((a - b).abs());
            }
        }
    }
    if largest > 0.0 {
        found.reciprocity_error = apart / largest;
    }
    found
}

/// Directions to look from, evenly over the cosine of the elevation.
fn views() -> Vec<[f64; 3]> {
    let [elevations, azimuths] = VIEWS;
    let view = |k: usize| {
        let z = (0.5 + (k / azimuths) as f64) / elevations as f64;
        let (sin, cos) = (TAU * (k % azimuths) as f64 / azimuths as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * cos, r * sin, z]
    };
    (0..elevations * azimuths).map(view).collect()
}

/// Directions over the upper hemisphere with their solid angles.
fn directions(elevations: usize, azimuths: usize) -> Vec<([f64; 3], f64)> {
    let mut out = Vec::with_capacity(elevations * azimuths);
    for (x, weight) in gauss_legendre(elevations) {
        let z = 0.5 + 0.5 * x;
        let r = (1.0 - z * z).sqrt();
        for k in 0..azimuths {
            let (sin, cos) = (TAU * (k as f64 + 0.25) / azimuths as f64).sin_cos();
            out.push(([r * cos, r * sin, z], 0.5 * weight * TAU / azimuths as f64));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::Brdf;
    use super::*;

    struct Twisted;

    impl Reflectance for Twisted {
        fn reflect(&self, i: [f64; 3], o: [f64; 3]) -> [f64; 3] {
            [0.9 * i[2] * i[2] * (1.0 + 0.0 * o[2]), -0.1, f64::NAN]
        }

        fn is_isotropic(&self) -> bool {
            true
        }
    }

    /// The white furnace: no closed form gives back more than it takes, all are reciprocal, and
    /// Lambert's albedo is exactly its own.
    #[test]
    fn closed_forms_conserve_energy_and_are_reciprocal() {
        let white = [1.0; 3];
        let half = [0.5; 3];
        for brdf in [
            Brdf::Lambert { albedo: white },
            Brdf::Phong { diffuse: half, specular: half, exponent: 20.0 },
            Brdf::Ggx { normal_reflectance: white, alpha: [0.3; 2] },
            Brdf::Ggx { normal_reflectance: half, alpha: [0.2, 0.6] },
            Brdf::AshikhminShirley { diffuse: half, specular: half, exponents: [10.0, 40.0] },
        ] {
            let found = examine(&brdf, 24);
            assert!(found.warnings().is_empty(), "{brdf:?}: {found:?}");
            assert!(found.largest_albedo > 0.5 && found.reciprocity_error < 1e-12, "{found:?}");
        }
        let found = examine(&Brdf::Lambert { albedo: [0.2, 0.7, 0.3] }, 8);
        assert!((found.largest_albedo - 0.7).abs() < 1e-12, "{found:?}");
    }

    /// Gain, one-sidedness, and numbers that are none are each told.
    #[test]
    fn faults_are_told() {
        let gain =
            examine(&Brdf::Phong { diffuse: [1.0; 3], specular: [0.5; 3], exponent: 2.0 }, 16);
        assert!(gain.warnings()[0].contains("makes energy"), "{gain:?}");
        let twisted = examine(&Twisted, 8);
        assert!(twisted.has_bad_values && twisted.reciprocity_error > 0.5, "{twisted:?}");
        assert_eq!(twisted.warnings().len(), 3);
    }
}
