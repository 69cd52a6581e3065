//! Light folding: contract the model with a light once, then every frame costs one number per
//! point and colour instead of n².

use glam::Quat;

use super::evaluate::{check_length, features};
use super::fitted::Core;
use super::header::check_finite;
use super::{Error, Model, Shape, Signal};
use crate::num::cpu::Isa;
use crate::num::kernels::{Layout, multiply, multiply_grouped};
use crate::num::panels::Panels;
use crate::sh::{MAX_COEFFICIENTS, Rotation};

/// A model contracted with a light that stands still in the model's frame.
#[derive(Debug, Clone)]
pub struct Folded {
    model: Model,
    colours: usize,
    factors: Factors,
}

/// What is left of a decoder under a light.
#[derive(Debug, Clone)]
enum Factors {
    /// `mean` and `linear`: rows `[point, colour]`, inner as in the model. `pca-linear`: rows
    /// `[d_out, colour]`, or `[colour, bone, d_out]` where the axes turn with bones; inner d_in+1.
    Panels(Panels),
    /// The family's own form with colours in place of coefficients.
    Core(Core),
}

/// The light of a colour at a point, times a vector over the width.
pub(super) type Dot<'a> = dyn Fn(usize, usize, &dyn Fn(usize) -> f32) -> f32 + 'a;

/// A light as the model meets it: in the frame of each bone, or once where nothing turns.
struct Lights {
    /// Numbers per point: the larger one of the model's channels and the light's colours.
    colours: usize,
    /// Colours of the light, 1 or 3.
    given: usize,
    /// Channels of the model, 1 or 3.
    channels: usize,
    /// n².
    count: usize,
    /// `[bone, colour given, coefficient]`.
    values: Vec<f32>,
}

impl Lights {
    /// The light of one colour dotted with a transfer vector, of which `value` tells entry
    /// `[channel, coefficient]`. One channel serves all colours, one colour lights all channels.
    fn dot(&self, bone: usize, colour: usize, value: impl Fn(usize) -> f32) -> f32 {
        let channel = self.channel(colour);
        let light = self.light(bone, colour).iter().enumerate();
        light.map(|(c, l)| l * value(channel + c)).sum()
    }

    /// [`dot`](Self::dot) with a transfer vector in memory, in eight sums side by side.
    fn dot_slice(&self, bone: usize, colour: usize, values: &[f32]) -> f32 {
        let light = self.light(bone, colour);
        let values = &values[self.channel(colour)..][..self.count];
        let ((a, a_rest), (b, b_rest)) = (light.as_chunks::<8>(), values.as_chunks::<8>());
        let mut sums = [0.0_f32; 8];
        for (a, b) in a.iter().zip(b) {
            for i in 0..8 {
                sums[i] += a[i] * b[i];
            }
        }
        let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
        sums.iter().sum::<f32>() + rest
    }

    fn light(&self, bone: usize, colour: usize) -> &[f32] {
        let first = (bone * self.given + colour.min(self.given - 1)) * self.count;
        &self.values[first..first + self.count]
    }

    /// Where the model's channel of a colour starts.
    fn channel(&self, colour: usize) -> usize {
        colour.min(self.channels - 1) * self.count
    }
}

impl Model {
    /// Contracts the model with a light, once; then [`Folded::evaluate`] gives for every frame
    /// what `evaluate` and a dot product with the light would: outgoing radiance over albedo.
    ///
    /// `light` holds n² coefficients of incoming radiance for each of 1 or 3 colours,
    /// `[colour, coefficient]`, in the root frame; for `ao` that is the ambient colour itself.
    /// Where the coefficients' axes turn with bones, `bone_rotations` says how the bones are
    /// turned, and the result holds as long as the light stands still in the frame of each; a
    /// light that stands still in the scene while bones move is [`shade`](Self::shade)'s.
    /// Otherwise they are not looked at.
    ///
    /// Costs d_out · (d_in + 1) · c multiply-adds per bone for `pca-linear`, points · c · (a + 1)
    /// for `linear`, points · c for `mean`, every number of the decoder for the others.
    ///
    /// # Errors
    /// [`Error::CannotFold`] for `visibility`; [`Error::Length`], [`Error::NotFinite`],
    /// [`Error::NoRotation`].
    pub fn fold(&self, light: &[f32], bone_rotations: &[Quat]) -> Result<Folded, Error> {
        let lights = self.lights(light, bone_rotations)?;
        let Shape { points, width, inputs, outputs, .. } = self.shape;
        let colours = lights.colours;
        let bone = |point: usize| self.bone(point);
        let dot = |point: usize, colour: usize, value: &dyn Fn(usize) -> f32| {
            lights.dot(bone(point), colour, value)
        };
        let factors = match &*self.core {
            Core::Multilinear(core) => {
                let core = Core::Multilinear(core.fold(colours, &dot));
                return Ok(Folded { model: self.clone(), colours, factors: Factors::Core(core) });
            }
            Core::Clustered(core) => {
                let core = Core::Clustered(core.fold(colours, &dot));
                return Ok(Folded { model: self.clone(), colours, factors: Factors::Core(core) });
            }
            Core::Mean(mean) => Panels::new(points * colours, 1, |row, _| {
                let (point, colour) = (row / colours, row % colours);
                lights.dot(bone(point), colour, |c| mean[point * width + c])
            }),
            Core::Linear(panels) => Panels::new(points * colours, panels.inner(), |row, j| {
                let (point, colour) = (row / colours, row % colours);
                lights.dot(bone(point), colour, |c| panels.at(point * width + c, j))
            }),
            Core::PcaLinear { coefficients, .. } => {
                let count = self.light_count() * colours * outputs;
                Panels::new(count, inputs + 1, |row, k| {
                    let (bone, colour, j) = self.factor_row(row, colours);
                    lights.dot(bone, colour, |c| coefficients.at(j * width + c, k))
                })
            }
        };
        Ok(Folded { model: self.clone(), colours, factors: Factors::Panels(factors) })
    }

    /// One frame under a light that turns against the model's frame: `[point, colour]`, the same
    /// as `fold` and evaluate, in one step and at the least cost for a single frame.
    ///
    /// `pca-linear` contracts its reduced coefficients, d_out · c multiply-adds per bone; the
    /// other families evaluate all coefficients and dot them with their bone's light.
    ///
    /// # Errors
    /// As [`fold`](Self::fold) and [`evaluate`](Self::evaluate).
    pub fn shade(
        &self,
        parameters: &[f32],
        light: &[f32],
        bone_rotations: &[Quat],
        out: &mut [f32],
    ) -> Result<(), Error> {
        self.check_parameters(parameters)?;
        let lights = self.lights(light, bone_rotations)?;
        let (colours, width) = (lights.colours, self.shape.width);
        check_length("output", out.len(), self.shape.points * colours)?;
        if let Core::PcaLinear { .. } = &*self.core {
            let reduced = self.reduced(Isa::best(), &self.held(parameters));
            self.expand(&self.factors(&lights, &reduced), colours, out);
            return Ok(());
        }
        let mut coefficients = vec![0.0; self.shape.points * width];
        self.evaluate(parameters, None, &mut coefficients)?;
        for (i, out) in out.iter_mut().enumerate() {
            let (point, colour) = (i / colours, i % colours);
            let coefficients = &coefficients[point * width..(point + 1) * width];
            *out = lights.dot_slice(self.bone(point), colour, coefficients);
        }
        Ok(())
    }

    /// The reduced coefficients of one pose, `[d_out, width]`, contracted with the lights: the
    /// rows that [`factor_row`](Self::factor_row) counts.
    fn factors(&self, lights: &Lights, reduced: &[f32]) -> Vec<f32> {
        let (outputs, width, count) = (self.shape.outputs, self.shape.width, lights.count);
        let of = |j: usize| &reduced[j * width..(j + 1) * width];
        if !self.turns_with_bones() {
            let rows = (0..outputs).flat_map(|j| (0..lights.colours).map(move |c| (j, c)));
            return rows.map(|(j, colour)| lights.dot_slice(0, colour, of(j))).collect();
        }
        // One product for all bones, [bone, coefficient] · [coefficient, d_out].
        let bones = self.light_count();
        let mut factors = vec![0.0; lights.colours * bones * outputs];
        for (colour, factors) in factors.chunks_exact_mut(bones * outputs).enumerate() {
            let left = Panels::new(bones, count, |bone, c| lights.light(bone, colour)[c]);
            let first = lights.channel(colour);
            let right = (first..first + count).flat_map(|c| (0..outputs).map(move |j| of(j)[c]));
            let right: Vec<f32> = right.collect();
            multiply(Isa::best(), &left, &right, outputs, Layout::Rows, factors);
        }
        factors
    }

    /// The number of frames in which a light is needed: one per bone, or one.
    fn light_count(&self) -> usize {
        if self.turns_with_bones() { self.rig.bones.nodes.len() } else { 1 }
    }

    /// Index of the light that a point meets.
    fn bone(&self, point: usize) -> usize {
        if self.turns_with_bones() { usize::from(self.bone_of_point[point]) } else { 0 }
    }

    /// Bone, colour and output dimension of a row of `pca-linear`'s factors.
    fn factor_row(&self, row: usize, colours: usize) -> (usize, usize, usize) {
        let outputs = self.shape.outputs;
        if self.turns_with_bones() {
            let (group, j) = (row / outputs, row % outputs);
            (group % self.light_count(), group / self.light_count(), j)
        } else {
            (0, row % colours, row / colours)
        }
    }

    /// The vertex basis of `pca-linear` times its folded factors: `[point, colour]`.
    fn expand(&self, factors: &[f32], colours: usize, out: &mut [f32]) {
        let Core::PcaLinear { basis, groups, .. } = &*self.core else { return };
        let isa = Isa::best();
        let Some(groups) = groups else {
            return multiply(isa, basis, factors, colours, Layout::Rows, out);
        };
        let per_colour = factors.len() / colours;
        if colours == 1 {
            return multiply_grouped(isa, basis, groups, factors, out);
        }
        let mut plane = vec![0.0; self.shape.points];
        for (colour, factors) in factors.chunks_exact(per_colour).enumerate() {
            multiply_grouped(isa, basis, groups, factors, &mut plane);
            for (out, &value) in out.iter_mut().skip(colour).step_by(colours).zip(&plane) {
                *out = value;
            }
        }
    }

    fn lights(&self, light: &[f32], bone_rotations: &[Quat]) -> Result<Lights, Error> {
        if self.header.signal == Signal::Visibility {
            return Err(Error::CannotFold { signal: self.header.signal });
        }
        if self.turns_with_tangents() {
            return Err(Error::NeedsSurface { what: "a light on a model of the tangent frame" });
        }
        if self.needs_surface() {
            return Err(Error::NeedsSurface { what: "a light on this model" });
        }
        let count = self.header.coefficients();
        let given = if light.len() == 3 * count { 3 } else { 1 };
        check_length("light", light.len(), given * count)?;
        check_finite("light", light)?;
        let channels = usize::from(self.header.channels);
        let mut lights =
            Lights { colours: given.max(channels), given, channels, count, values: light.to_vec() };
        if self.turns_with_bones() {
            self.check_bone_rotations(bone_rotations)?;
            lights.values.clear();
            let mut rotation = Rotation::identity(self.header.sh_order());
            let mut turned = [0.0; MAX_COEFFICIENTS];
            for bone in bone_rotations {
                rotation.set(bone.conjugate());
                for colour in light.chunks_exact(count) {
                    rotation.apply(colour, &mut turned);
                    lights.values.extend_from_slice(&turned[..count]);
                }
            }
        }
        Ok(lights)
    }
}

impl Folded {
    /// Numbers per point: 1, or 3 where light or model has colours.
    #[must_use]
    pub fn colours(&self) -> usize {
        self.colours
    }

    /// Outgoing radiance over albedo, `[point, colour]`, of all points.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::NotFinite`] parameters.
    pub fn evaluate(&self, parameters: &[f32], out: &mut [f32]) -> Result<(), Error> {
        self.model.check_parameters(parameters)?;
        let held = self.model.held(parameters);
        let parameters = &*held;
        check_length("output", out.len(), self.model.shape.points * self.colours)?;
        let (isa, centre) = (Isa::best(), &self.model.header.training.centre);
        let panels = match &self.factors {
            Factors::Panels(panels) => panels,
            Factors::Core(core) => {
                core.rows(isa, centre, parameters, out);
                return Ok(());
            }
        };
        let features = match &*self.model.core {
            Core::Mean(_) => vec![1.0],
            core => features(core, centre, parameters),
        };
        if let Core::PcaLinear { .. } = &*self.model.core {
            let mut factors = vec![0.0; panels.rows()];
            multiply(isa, panels, &features, 1, Layout::Rows, &mut factors);
            self.model.expand(&factors, self.colours, out);
        } else {
            multiply(isa, panels, &features, 1, Layout::Rows, out);
        }
        Ok(())
    }
}
