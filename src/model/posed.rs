//! A whole frame: the decoder's part, what occluders block in the pose, and the unshadowed signal.

use glam::{Quat, Vec3};

use super::evaluate::check_length;
use super::fitted::Occluding;
use super::{Error, Model, Signal, Surface};
use crate::sh::{Order, zonal};

/// The points of a posed mesh, root frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PosedPoints {
    /// Metres.
    pub positions: Vec<Vec3>,
    /// Unit shading normals.
    pub normals: Vec<Vec3>,
    /// Unit tangents; empty where nobody asks for them.
    pub tangents: Vec<Vec3>,
}

impl PosedPoints {
    /// As a model takes them.
    #[must_use]
    pub fn as_surface(&self) -> Surface<'_> {
        Surface { positions: &self.positions, normals: &self.normals, tangents: &self.tangents }
    }
}

/// A pose as [`Model::evaluate_posed`] takes it.
#[derive(Debug, Clone, Copy)]
pub struct PosedInput<'a> {
    /// The model's parameters.
    pub parameters: &'a [f32],
    /// One per bone, [`Model::bone_rotations_of`].
    pub bone_rotations: &'a [Quat],
    /// The posed mesh; only looked at where [`Model::needs_surface`].
    pub surface: Option<Surface<'a>>,
}

impl Model {
    /// Whether evaluation looks at the posed mesh.
    #[must_use]
    pub fn needs_surface(&self) -> bool {
        !self.decodes_alone() || self.turns_with_tangents()
    }

    /// Whether parameters alone give the whole signal, in the model's own frame.
    #[must_use]
    pub fn decodes_alone(&self) -> bool {
        !self.header.unshadowed && self.occluding.is_none()
    }

    /// The signal of all points in the root frame, `[point, channel, coefficient]`: the decoder's
    /// part, turned to the root frame; the unshadowed signal, where the model does without it;
    /// less what occluders block. `ao` stays within its bounds, 0 to 1.
    ///
    /// # Errors
    /// As [`evaluate_bounded`](Self::evaluate_bounded).
    pub fn evaluate_posed(&self, input: &PosedInput<'_>, out: &mut [f32]) -> Result<(), Error> {
        self.evaluate_bounded(input, out).map(drop)
    }

    /// [`evaluate_posed`](Self::evaluate_posed), telling how far outside its bounds the signal was
    /// before it was brought within them ([`bound`](Self::bound)).
    ///
    /// # Errors
    /// As [`evaluate`](Self::evaluate) and [`to_root_frame`](Self::to_root_frame);
    /// [`Error::NeedsSurface`]; [`Error::NotFinite`] positions or normals.
    pub fn evaluate_bounded(&self, input: &PosedInput<'_>, out: &mut [f32]) -> Result<f32, Error> {
        self.evaluate(input.parameters, None, out)?;
        if !self.needs_surface() {
            self.to_root_frame(input.bone_rotations, None, out)?;
            return Ok(self.bound(out));
        }
        let surface = input.surface.ok_or(Error::NeedsSurface { what: "this model" })?;
        self.check_surface(surface)?;
        let near = about_origin(surface.positions);
        let surface = match &near {
            Some(positions) => Surface { positions, ..surface },
            None => surface,
        };
        let kind = (self.header.signal, self.header.sh_order());
        let turns = input.bone_rotations;
        if self.occluding.is_some() {
            self.check_bone_rotations(turns)?;
        }
        if let Some(Occluding { occluders, seen, sky: Some(sky) }) = self.occluding.as_deref() {
            // Its directions are fixed in the frame of each bone, as in the fit.
            seen.subtract_union(occluders, surface, turns, sky, out);
        }
        if self.turns_with_tangents() {
            self.tangent_to_root(surface, out);
        } else {
            self.to_root_frame(turns, None, out)?;
        }
        if self.header.unshadowed {
            add_unshadowed(kind, surface.normals, out);
        }
        if let Some(Occluding { occluders, seen, sky: None }) = self.occluding.as_deref() {
            let centres = occluders.centres(surface.positions, &self.bone_of_point, turns);
            seen.subtract(occluders, &centres, surface, kind, out);
        }
        Ok(self.bound(out))
    }

    /// Brings values of the whole signal within its physical bounds, 0 to 1 for `ao` and none for
    /// harmonics, and tells how far the farthest was outside: 0 where all were within. A pose far
    /// from the training poses shows in it.
    pub fn bound(&self, values: &mut [f32]) -> f32 {
        if self.header.signal != Signal::Ao {
            return 0.0;
        }
        let mut outside = 0.0_f32;
        for value in values {
            let within = value.clamp(0.0, 1.0);
            outside = outside.max((*value - within).abs());
            *value = within;
        }
        outside
    }

    fn check_surface(&self, surface: Surface<'_>) -> Result<(), Error> {
        let mut all = vec![("positions", surface.positions), ("normals", surface.normals)];
        if self.turns_with_tangents() {
            all.push(("tangents", surface.tangents));
        }
        for (what, vectors) in all {
            check_length(what, vectors.len(), self.shape.points)?;
            if let Some(index) = vectors.iter().position(|vector| !vector.is_finite()) {
                return Err(Error::NotFinite { what: what.to_owned(), index });
            }
        }
        Ok(())
    }
}

/// A mesh that is farther from the origin than this many times its size is looked at about one of its points:
/// what blocks depends on differences of places alone, and places so far off round by a part of a limb.
const FAR: f32 = 64.0;

/// The positions less one of them, where they are far from the origin; `None` where they are not.
fn about_origin(positions: &[Vec3]) -> Option<Vec<Vec3>> {
    let first = *positions.first()?;
    let (low, high) =
        positions.iter().fold((first, first), |(low, high), &p| (low.min(p), high.max(p)));
    let is_far = first.abs().max_element() > FAR * (high - low).max_element();
    is_far.then(|| positions.iter().map(|&p| p - first).collect())
}

/// The signal where nothing occludes, n² numbers (1 for `ao`): the clamped cosine about the normal
/// over π for `transfer`; √4π, then zeros, for `visibility`; 1 for `ao`.
pub fn unshadowed((signal, order): (Signal, Order), normal: Vec3, out: &mut [f32]) {
    match signal {
        Signal::Ao => out[0] = 1.0,
        Signal::Visibility => {
            out.fill(0.0);
            out[0] = (4.0 * std::f32::consts::PI).sqrt();
        }
        Signal::Transfer => zonal::rotate(order, &zonal::unshadowed(order), normal, out),
    }
}

/// Adds the unshadowed signal to every channel of `[point, channel, coefficient]`.
fn add_unshadowed(kind: (Signal, Order), normals: &[Vec3], out: &mut [f32]) {
    let count = kind.0.coefficients(kind.1);
    let width = out.len() / normals.len().max(1);
    let mut free = vec![0.0; count];
    for (row, &normal) in out.chunks_exact_mut(width.max(1)).zip(normals) {
        unshadowed(kind, normal, &mut free);
        for channel in row.chunks_exact_mut(count) {
            channel.iter_mut().zip(&free).for_each(|(out, free)| *out += free);
        }
    }
}
