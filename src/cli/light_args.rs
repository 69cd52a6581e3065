//! The arguments of `poselight light` and `poselight brdf`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// What a light may be, for every command that takes one.
pub(super) const LIGHT_HELP: &str = "A map (.hdr, .exr), or `constant`, `directional:X,Y,Z`, \
    `cone:X,Y,Z,DEGREES` (half angle) or `sphere:X,Y,Z,RADIUS`, each with `:R,G,B` after it or \
    white; or coefficients [n²] or [n², 3] (.npy). Directions point to the light, +Y is up. The middle \
    of a map is +X, +Z to its right.";

#[derive(Debug, Args)]
pub(crate) struct LightArgs {
    #[arg(value_name = "LIGHT", help = LIGHT_HELP)]
    pub(crate) source: String,
    /// Order of the spherical harmonics, 1 to 10.
    #[arg(long, value_name = "N", default_value_t = 6)]
    pub(crate) order: u8,
    /// Degrees to turn the light by about +Y, counter-clockwise seen from above.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) turn: f64,
    /// Let the bands fade out, against ringing [default: they stop].
    #[arg(long, value_enum)]
    pub(crate) window: Option<WindowArg>,
    /// Bands until the window is closed [default: the order], or the strength of `laplacian`
    /// [default: 0.01].
    #[arg(long, value_name = "SIZE", requires = "window")]
    pub(crate) window_size: Option<f64>,
    /// Also fit this many zonal lobes, 1 to 8, one after the other: light that turns into any frame for
    /// the price of an evaluation.
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u8).range(1..=8))]
    pub(crate) lobes: Option<u8>,
    /// Also write the coefficients as an array [n², 3] of f32, as `evaluate --light` takes it.
    #[arg(short, long, value_name = "LIGHT.npy")]
    pub(crate) output: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum WindowArg {
    /// (1 + cos(πl/size))/2.
    Hann,
    /// sin(πl/size)/(πl/size).
    Lanczos,
    /// 1/(1 + size·l²(l+1)²).
    Laplacian,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum CosineArg {
    /// Into the reflectance, before it is factored.
    Inside,
    /// Into a product matrix of its own, which visibility meets first.
    Matrix,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum ColoursArg {
    /// By factors of the light that all share: a third of the bytes and of the time.
    Together,
    /// By its own each.
    Apart,
}

#[derive(Debug, Args)]
pub(crate) struct BrdfArgs {
    /// `lambert:ALBEDO` (one or three), `phong:DIFFUSE,SPECULAR,EXPONENT`, `ggx:F0,ALPHA` with a
    /// second alpha along the bitangent or without, `ashikhmin-shirley:DIFFUSE,SPECULAR,NU,NV`, or a
    /// file in the binary format of MERL.
    #[arg(value_name = "BRDF")]
    pub(crate) source: String,
    /// Order of the visibility and light that it meets, 1 to 10.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub(crate) order: u8,
    /// Terms that are kept, 1 to the square of the order.
    #[arg(long, value_name = "K", default_value_t = 8)]
    pub(crate) terms: usize,
    /// Where the cosine goes.
    #[arg(long, value_enum, default_value_t = CosineArg::Inside)]
    pub(crate) cosine: CosineArg,
    /// How colours that reflect differently are factored.
    #[arg(long, value_enum, default_value_t = ColoursArg::Together)]
    pub(crate) colours: ColoursArg,
    /// Also state the error of every number of terms at every order.
    #[arg(long)]
    pub(crate) curve: bool,
    /// The operator to write.
    #[arg(short, long, value_name = "OUT.safetensors")]
    pub(crate) output: PathBuf,
}
