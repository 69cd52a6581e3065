//! Rank 12. Stills: pictures of a posed mesh, and its shading by rays as the truth beside a model's.
//!
//! A [`Stage`] is a posed mesh that can be looked at and shaded; [`Picture`]s hold linear light and
//! become PNG in sRGB at the very end. Differences are shown through a perceptually uniform colour
//! map with a legend in units.
//!
//! *Invariant:* the truth shares no code with the bake that it is put beside, only the tracer.

mod animation;
mod camera;
mod colour_map;
mod glyphs;
mod panel;
mod picture;
mod stage;
mod tone;

pub use animation::{AnimationError, animated_png};
pub use camera::Camera;
pub use colour_map::colour;
pub use panel::{Panel, captioned, sheet};
pub use picture::{Picture, to_srgb};
pub use stage::{Image, Light, Stage};
pub use tone::Tone;
