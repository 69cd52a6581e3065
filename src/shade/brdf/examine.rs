//! Whether a reflectance is possible: reciprocity and the conservation of energy.

use std::f64::consts::TAU;

use super::{Reflectance, Rule};

/// Directions that are looked from: elevations and azimuths.
const VIEWS: [usize; 2] = [8, 6];

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Examination {
    /// The largest ∫ f cos θ_i dω_i over views and colours; above 1 energy is made.
    pub largest_albedo: f64,
    /// The largest distance of an albedo from that of two thirds as many nodes: what lobes too narrow
    /// for the nodes leave unknown of it, and of an operator by as many.
    pub albedo_uncertainty: f64,
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
        if self.albedo_uncertainty > 0.02 {
            out.push(format!(
                "the reflectance has lobes too narrow to be integrated: what comes back is known to \
                 {:.3} of the light only, and an operator of it is off by as much",
                self.albedo_uncertainty
            ));
        }
        if self.largest_albedo - self.albedo_uncertainty > 1.005 {
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
/// hemisphere of each by products of `nodes` Gauss–Legendre nodes and twice as many azimuths, gathered
/// as it asks for.
#[must_use]
pub fn examine(reflectance: &impl Reflectance, nodes: usize) -> Examination {
    let rules = [nodes, (2 * nodes).div_ceil(3)].map(|nodes| Rule::new(nodes, false));
    let views = views();
    let mut found = Examination {
        largest_albedo: 0.0,
        albedo_uncertainty: 0.0,
        reciprocity_error: 0.0,
        has_bad_values: false,
    };
    let (mut largest, mut apart) = (0.0_f64, 0.0_f64);
    for o in &views {
        let [fine, coarse] = rules.each_ref().map(|rule| {
            let mut albedo = [0.0; 3];
            rule.each(reflectance.sampling(), *o, |i, area| {
                let f = reflectance.reflect(i, *o);
                found.has_bad_values |= f.iter().any(|f| !(f.is_finite() && *f >= 0.0));
                albedo.iter_mut().zip(f).for_each(|(sum, f)| *sum += area * i[2] * f);
            });
            albedo
        });
        for (fine, coarse) in fine.iter().zip(coarse) {
            found.largest_albedo = found.largest_albedo.max(*fine);
            found.albedo_uncertainty = found.albedo_uncertainty.max((fine - coarse).abs());
        }
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

    /// Narrow lobes and those of a grain have the albedo of a slow sum over facets: 1 and no more of
    /// mirrors, less where facets hide one another or a lobe reaches below the surface; nothing is said
    /// against them.
    #[test]
    fn narrow_lobes_conserve_energy() {
        let white = [1.0; 3];
        let ggx = |alpha| Brdf::Ggx { normal_reflectance: white, alpha };
        let (diffuse, specular) = ([0.0; 3], white);
        let shirley = |exponents| Brdf::AshikhminShirley { diffuse, specular, exponents };
        for (brdf, slopes, largest) in [
            (ggx([0.02; 2]), [0.02; 2], 1.0),
            (ggx([0.01; 2]), [0.01; 2], 1.0),
            (ggx([0.001; 2]), [0.001; 2], 1.0),
            (ggx([0.05, 0.2]), [0.05, 0.2], 0.975),
            (shirley([100.0, 10_000.0]), [0.1, 0.01], 0.975),
            (Brdf::Phong { diffuse, specular, exponent: 1e5 }, [0.003; 2], 0.9375),
        ] {
            let found = examine(&brdf, 24);
            assert!(found.warnings().is_empty(), "{brdf:?}: {:?}", found.warnings());
            assert!((found.largest_albedo - largest).abs() < 5e-3, "{brdf:?}: {found:?}");
            let rule = Rule::new(24, false);
            for o in [[0.6, 0.0, 0.8], [0.48, 0.64, 0.6], [0.0, 0.8, 0.6]] {
                let mut albedo = 0.0;
                rule.each(brdf.sampling(), o, |i, area| {
                    albedo += area * i[2] * brdf.reflect(i, o)[0]
                });
                let slow = by_facets(&brdf, slopes, o);
                assert!((albedo - slow).abs() < 5e-3, "{brdf:?} {o:?}: {albedo} {slow}");
            }
        }
    }

    /// ∫ f cos dω by an even sum over the angles of facets, on a scale of tenfold widths.
    fn by_facets(brdf: &Brdf, [sx, sy]: [f64; 2], o: [f64; 3]) -> f64 {
        let (steps, around) = (200, 96);
        let (low, high) = (1e-3_f64.ln(), (1e3 / sx.min(sy).max(0.01)).ln());
        let (width, turn) = ((high - low) / f64::from(steps), TAU / f64::from(around));
        let mut sum = 0.0;
        for k in 0..steps {
            let t = (low + (f64::from(k) + 0.5) * width).exp();
            for j in 0..around {
                let (sin, cos) = (turn * f64::from(j)).sin_cos();
                let slope = [sx * t * cos, sy * t * sin];
                let length = (1.0 + slope[0].powi(2) + slope[1].powi(2)).sqrt();
                let along = (o[0] * slope[0] + o[1] * slope[1] + o[2]) / length;
                let i: [f64; 3] = std::array::from_fn(|c| {
                    2.0 * along * slope.get(c).unwrap_or(&1.0) / length - o[c]
                });
                if along > 0.0 && i[2] > 0.0 {
                    // Of slopes, of half vectors, of incoming directions.
                    let area = sx * sy * t * t * width * turn / length.powi(3) * 4.0 * along;
                    sum += area * i[2] * brdf.reflect(i, o)[0];
                }
            }
        }
        sum
    }

    /// A lobe that nobody tells of is too narrow for an even rule, which says so with a number, not
    /// that energy is made.
    #[test]
    fn what_cannot_be_integrated_is_told() {
        struct Untold(Brdf);
        impl Reflectance for Untold {
            fn reflect(&self, i: [f64; 3], o: [f64; 3]) -> [f64; 3] {
                self.0.reflect(i, o)
            }
            fn is_isotropic(&self) -> bool {
                true
            }
        }
        let found =
            examine(&Untold(Brdf::Ggx { normal_reflectance: [1.0; 3], alpha: [0.01; 2] }), 24);
        assert!(found.albedo_uncertainty > 0.1, "{found:?}");
        let told = found.warnings();
        assert!(told.len() == 1 && told[0].contains("too narrow"), "{told:?}");
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
