//! A checked model in the layout that evaluates fastest.

use std::sync::Arc;

use super::distance::Subspace;
use super::evaluate::check_length;
use super::header::{check_index, field, limits, within};
use super::occluder::Seen;
use super::occluder::sky::Sky;
use super::rig::Rig;
use super::{
    Decoder, Error, Frame, Header, OccluderSizes, Occluders, Shape, Signal, clustered, multilinear,
};
use crate::num::panels::{Groups, Panels};
use crate::rig::{Mesh, Tangents};

/// A fitted model: pose parameters in, the signal at every point out.
///
/// *Invariant:* everything in it has been checked; no method panics on a value of a blob.
#[derive(Debug, Clone)]
pub struct Model {
    pub(super) header: Header,
    pub(super) shape: Shape,
    pub(super) core: Arc<Core>,
    pub(super) rig: Rig,
    pub(super) subspace: Subspace,
    pub(super) point_of_vertex: Vec<u32>,
    /// Empty but in the bone frame.
    pub(super) bone_of_point: Vec<u16>,
    pub(super) occluding: Option<Arc<Occluding>>,
    /// One vertex per point.
    pub(super) rest: Option<Arc<Mesh>>,
    /// Of the points at rest, in the scene's frame; empty but in the tangent frame.
    pub(super) tangents: Arc<Vec<[i8; 3]>>,
    /// The same as the rest mesh carries them.
    pub(super) carried: Option<Arc<Tangents>>,
}

/// Occluders and their layout for evaluation.
#[derive(Debug)]
pub(super) struct Occluding {
    pub(super) occluders: Occluders,
    pub(super) seen: Seen,
    /// Where they are ellipsoids.
    pub(super) sky: Option<Sky>,
}

/// The decoder's numbers as the kernels read them.
#[derive(Debug, Clone)]
pub(super) enum Core {
    /// `[point, width]`.
    Mean(Vec<f32>),
    /// Rows `[point, width]`, inner `[parameter…, 1]`: the mean is the last column.
    Linear(Panels),
    PcaLinear {
        /// `[parameter, d_in]`.
        projection: Vec<f32>,
        /// Rows `[d_out, width]`, inner d_in + 1.
        coefficients: Panels,
        /// Rows point, inner d_out.
        basis: Panels,
        /// Bones of the points, where the coefficients' axes turn with them.
        groups: Option<Groups>,
    },
    Multilinear(multilinear::Core),
    Clustered(clustered::Core),
}

impl Core {
    fn new(decoder: Decoder, shape: Shape, groups: Option<Groups>) -> Self {
        let Shape { points, width, parameters, inputs, outputs } = shape;
        match decoder {
            Decoder::Mean { mean } => Self::Mean(mean),
            Decoder::Linear { mean, weights } => {
                Self::Linear(Panels::new(points * width, parameters + 1, |row, j| {
                    if j == parameters { mean[row] } else { weights[row * parameters + j] }
                }))
            }
            Decoder::PcaLinear { projection, coefficients, basis } => Self::PcaLinear {
                projection,
                coefficients: Panels::new(outputs * width, inputs + 1, |row, k| {
                    let (j, c) = (row / width, row % width);
                    coefficients[(c * (inputs + 1) + k) * outputs + j]
                }),
                basis: Panels::new(points, outputs, |row, j| basis[row * outputs + j]),
                groups,
            },
            Decoder::Multilinear(parts) => Self::Multilinear(multilinear::Core::new(parts, shape)),
            Decoder::Clustered(parts) => Self::Clustered(clustered::Core::new(parts, shape)),
        }
    }
}

impl Model {
    /// A model from its parts.
    ///
    /// `point_of_vertex` has one entry per vertex; `bone_of_point` one per point in the bone
    /// frame, and is not kept in another one. `header.training.directions` belongs to families
    /// without a projection only.
    ///
    /// # Errors
    /// Whatever disagrees: sizes, ranges, numbers that are not finite, names that are not unique.
    pub fn new(
        header: Header,
        decoder: Decoder,
        point_of_vertex: Vec<u32>,
        bone_of_point: Vec<u16>,
    ) -> Result<Self, Error> {
        header.check()?;
        let shape = decoder.check(&header)?;
        let bone_of_point = check_maps(&header, &point_of_vertex, bone_of_point)?;
        let projection = match decoder.projection() {
            Some(projection) => {
                if !header.training.directions.is_empty() {
                    return Err(field("training.directions", "the family has its projection"));
                }
                projection
            }
            None => &header.training.directions,
        };
        let subspace = Subspace::new(&header.training, projection)?;
        let turns = header.frame == Frame::Bone && header.signal != Signal::Ao;
        let groups = turns.then(|| Groups::new(&bone_of_point));
        let core = Arc::new(Core::new(decoder, shape, groups));
        let rig = Rig::new(&header.rig);
        Ok(Self {
            header: Header { occluders: None, rest: None, ..header },
            shape,
            core,
            rig,
            subspace,
            point_of_vertex,
            bone_of_point,
            occluding: None,
            rest: None,
            tangents: Arc::default(),
            carried: None,
        })
    }

    /// The same model with the tangents of its points at rest, in the scene's frame, of which
    /// [`tangents_to_bytes`](crate::rig::tangents_to_bytes) makes bytes: a model of the tangent frame
    /// has one for each point.
    ///
    /// # Errors
    /// [`Error::Length`]; a model of another frame.
    pub fn with_tangents(mut self, tangents: Vec<[i8; 3]>) -> Result<Self, Error> {
        if !self.turns_with_tangents() {
            return Err(field("frame", "only a model of the tangent frame has tangents"));
        }
        check_length("tangents", tangents.len(), self.shape.points)?;
        self.tangents = Arc::new(tangents);
        self.carry_tangents();
        Ok(self)
    }

    /// The tangents of the points at rest, in the scene's frame; empty but in the tangent frame.
    #[must_use]
    pub fn tangents(&self) -> &[[i8; 3]] {
        &self.tangents
    }

    /// The same model with occluders, whose part is added to what its decoder gives.
    ///
    /// # Errors
    /// Lengths, indices and numbers that do not fit the model; a model of another frame than the
    /// bone frame, which does not know its points' bones.
    pub fn with_occluders(mut self, occluders: Occluders) -> Result<Self, Error> {
        if self.header.frame != Frame::Bone {
            return Err(field("frame", "occluders need the points' bones, so the bone frame"));
        }
        let groups = occluders.check(self.shape.points, self.header.rig.bones.len())?;
        self.header.occluders = Some(OccluderSizes {
            spheres: occluders.spheres() as u32,
            groups: groups as u32,
            directions: occluders.directions as u32,
        });
        let seen = Seen::new(&occluders, &self.bone_of_point);
        let kind = (self.header.signal, self.header.sh_order());
        let sky = (occluders.directions > 0).then(|| Sky::new(occluders.directions, kind));
        self.occluding = Some(Arc::new(Occluding { occluders, seen, sky }));
        Ok(self)
    }

    /// Its occluders, where it has any.
    #[must_use]
    pub fn occluders(&self) -> Option<&Occluders> {
        self.occluding.as_deref().map(|occluding| &occluding.occluders)
    }

    /// What it is, for people: its family, or its occluders and the family of what remains.
    #[must_use]
    pub fn kind(&self) -> String {
        match (self.occluders(), self.header.family) {
            (None, family) => family.name().to_owned(),
            (Some(_), super::Family::Mean) => "occluder".to_owned(),
            (Some(_), family) => format!("occluder with {family}"),
        }
    }

    /// Everything about it that is not a tensor.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Puts measured errors into the header.
    pub fn set_errors(&mut self, errors: std::collections::BTreeMap<String, serde_json::Value>) {
        self.header.errors = errors;
    }

    /// The sizes of its arrays.
    #[must_use]
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// How many numbers its tensors hold, scales and maps not counted.
    #[must_use]
    pub fn numbers(&self) -> u64 {
        self.shape.numbers(self.header.family).unwrap_or_else(|| self.decoder().numbers())
    }

    /// Multiply-adds of one evaluation of all points and coefficients; where pose clusters are
    /// blended, with all of them.
    #[must_use]
    pub fn multiply_adds(&self) -> u64 {
        match &*self.core {
            Core::Multilinear(core) => core.multiply_adds(),
            Core::Clustered(core) => core.multiply_adds(self.shape.parameters),
            _ => self.shape.multiply_adds(self.header.family).unwrap_or(0),
        }
    }

    /// Which point each vertex of the scene takes its values from.
    #[must_use]
    pub fn point_of_vertex(&self) -> &[u32] {
        &self.point_of_vertex
    }

    /// Whether the points are the vertices, one by one, so that a blob needs no map.
    pub(super) fn points_are_vertices(&self) -> bool {
        self.point_of_vertex.len() == self.header.mesh.points as usize
            && self.point_of_vertex.iter().enumerate().all(|(i, &point)| point as usize == i)
    }

    /// Which bone's frame each point's coefficients are in; empty in another frame.
    #[must_use]
    pub fn bone_of_point(&self) -> &[u16] {
        &self.bone_of_point
    }

    /// The numbers in plain row order, as [`Model::new`] took them.
    #[must_use]
    pub fn decoder(&self) -> Decoder {
        let Shape { points, width, parameters, inputs, outputs } = self.shape;
        match &*self.core {
            Core::Mean(mean) => Decoder::Mean { mean: mean.clone() },
            Core::Linear(panels) => Decoder::Linear {
                mean: (0..points * width).map(|row| panels.at(row, parameters)).collect(),
                weights: unpack(panels, points * width, parameters),
            },
            Core::PcaLinear { projection, coefficients, basis, .. } => {
                let mut plain = Vec::with_capacity(width * (inputs + 1) * outputs);
                for c in 0..width {
                    for k in 0..=inputs {
                        plain.extend((0..outputs).map(|j| coefficients.at(j * width + c, k)));
                    }
                }
                Decoder::PcaLinear {
                    projection: projection.clone(),
                    coefficients: plain,
                    basis: unpack(basis, points, outputs),
                }
            }
            Core::Multilinear(core) => Decoder::Multilinear(core.parts()),
            Core::Clustered(core) => Decoder::Clustered(core.parts()),
        }
    }
}

/// The first `columns` of each row.
fn unpack(panels: &Panels, rows: usize, columns: usize) -> Vec<f32> {
    (0..rows).flat_map(|row| (0..columns).map(move |j| panels.at(row, j))).collect()
}

/// A frame that the signal has; both maps within their ranges, the bones only where the frame needs
/// them.
fn check_maps(
    header: &Header,
    point_of_vertex: &[u32],
    bone_of_point: Vec<u16>,
) -> Result<Vec<u16>, Error> {
    if header.signal == Signal::Ao && header.frame == Frame::Tangent {
        return Err(field("frame", "ambient occlusion has no direction to turn with tangents"));
    }
    let (points, vertices) = (header.mesh.points as usize, header.mesh.vertices as usize);
    if point_of_vertex.len() != vertices {
        let (what, found) = ("point_of_vertex".to_owned(), point_of_vertex.len());
        return Err(Error::Length { what, found, expected: vertices });
    }
    for (vertex, &point) in point_of_vertex.iter().enumerate() {
        if point as usize >= points {
            check_index(&format!("point of vertex {vertex}"), point, points)?;
        }
    }
    if header.frame != Frame::Bone {
        return Ok(Vec::new());
    }
    if bone_of_point.len() != points {
        let (what, found) = ("bone_of_point".to_owned(), bone_of_point.len());
        return Err(Error::Length { what, found, expected: points });
    }
    let bones = header.rig.bones.len();
    within("bones", bones as u64, limits::BONES)?;
    for (point, &bone) in bone_of_point.iter().enumerate() {
        if usize::from(bone) >= bones {
            check_index(&format!("bone of point {point}"), u32::from(bone), bones)?;
        }
    }
    Ok(bone_of_point)
}
