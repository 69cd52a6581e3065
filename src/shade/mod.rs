//! Rank 4. What an engine needs to shade: lights as spherical harmonics of radiance or as
//! a few lobes, reflectances as product operators, shadows of spheres and of height
//! fields.
//!
//! Lights are RGB, in f64, in the convention of [`crate::sh`]: l_i = ∫ L(ω) y_i(ω) dω, with ω
//! pointing from the shaded point to where the light comes from, in the axes of glTF (+Y up).
//!
//! *Invariant:* no files, threads or picture formats; slices in, coefficients out.

mod brdf;
mod conventions;
mod environment_map;
mod error;
mod height_field;
mod light;
mod reflection;
mod sphere_shadow;
mod window;
mod words;
mod zonal_fit;

pub use brdf::{Brdf, Examination, Material, Merl, MerlError, Reflectance, Sampling, examine};
pub use conventions::{D3DX_BANDS, THREE_BANDS, d3dx, filament, three_js};
pub use environment_map::{EnvironmentMap, MapFacts};
pub use error::Error;
pub use height_field::{HeightField, HorizonShadows, MOST_AZIMUTHS};
pub use light::ShLight;
#[cfg(feature = "bake")]
pub use reflection::{Colours, Cosine, Factored, Factoring, factor, factor_by};
pub use reflection::{
    GlobalReflector, ReflectionOperator, Reflector, ReflectorError, ReflectorHeader, ShadedPoints,
};
pub use sphere_shadow::{Exponential, Sphere, SphereSet, SphereShadows};
pub use window::Window;
pub use words::{BRDF_WORDS, LIGHT_WORDS, WordsError, brdf_of_words, light_of_words};
pub use zonal_fit::{Lobe, MOST_LOBES, ZonalLight};
