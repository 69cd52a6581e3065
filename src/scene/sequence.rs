//! Vertex sequences: an `.npz` archive with `positions` [frame, vertex, 3], `faces` [triangle, 3] and
//! perhaps `fps`, as simulations write them.
//!
//! The first frame is the rest shape, every further one a morph target with a weight of its own;
//! the clip `sequence` passes from one to the next. Normals are computed anew for each frame.

use std::io::{Cursor, Read};

use glam::{Affine3A, Vec3};
use npyz::{DType, NpyFile, Order, TypeChar};
use zip::ZipArchive;

use super::budget::{Budget, Notices, Quantity};
use super::{Channel, Clip, Error, Interpolation, Source, Target, normals};
use crate::rig::{Deformer, Influence, Mesh, MorphTarget, Node, Part, Skeleton, Transform};

/// Frames per second where the archive does not say.
const DEFAULT_FPS: f32 = 30.0;

/// Each frame has a weight, and each pose all weights: beyond this the table of keys alone outgrows
/// the positions.
const MOST_FRAMES: usize = 4096;

/// Entries of an archive that are looked at.
const MOST_ENTRIES: usize = 64;

/// What a sequence becomes.
pub(super) type Read3 = (Skeleton, Mesh, Vec<Clip>);

/// Reads an archive.
pub(super) fn read(
    source: &Source,
    budget: &mut Budget,
    notices: &mut Notices,
) -> Result<Read3, Error> {
    let mut archive = Archive::open(source)?;
    let (shape, positions) = archive.floats("positions", budget)?;
    let &[frames, vertices, 3] = shape.as_slice() else {
        return Err(invalid("positions", format!("shape {shape:?} is not [frame, vertex, 3]")));
    };
    if frames == 0 || vertices == 0 || frames > MOST_FRAMES {
        let fault = format!(
            "{frames} frames of {vertices} vertices; 1 to {MOST_FRAMES} frames of at least one vertex are read"
        );
        return Err(invalid("positions", fault));
    }
    budget.take(Quantity::Vertices, vertices as u64, "positions")?;
    budget.take(Quantity::MorphTargets, frames as u64, "positions")?;
    if let Some(at) = positions.iter().position(|value| !value.is_finite()) {
        let (frame, vertex) = (at / (3 * vertices), at / 3 % vertices);
        let place = format!("positions, frame {frame}, vertex {vertex}");
        return Err(Error::NotFinite { place, element: at });
    }
    let triangles = faces(&mut archive, vertices, budget)?;
    let fps = fps(&mut archive, budget, notices)?;
    let frames: Vec<Vec<Vec3>> = positions
        .chunks_exact(3 * vertices)
        .map(|frame| frame.chunks_exact(3).map(Vec3::from_slice).collect())
        .collect();
    let mesh = mesh(&frames, triangles);
    let clips = if frames.len() > 1 { vec![clip(frames.len(), fps)] } else { Vec::new() };
    let node = Node { name: "sequence".into(), parent: None, rest: Transform::IDENTITY };
    Ok((Skeleton { nodes: vec![node] }, mesh, clips))
}

fn mesh(frames: &[Vec<Vec3>], triangles: Vec<[u32; 3]>) -> Mesh {
    let shaded = |positions: &[Vec3]| {
        let mut normals = vec![Vec3::ZERO; positions.len()];
        normals::complete(positions, &triangles, 0, &mut normals);
        normals
    };
    let (rest, rest_normals) = (&frames[0], shaded(&frames[0]));
    let less = |now: &[Vec3], then: &[Vec3]| -> Vec<Vec3> {
        now.iter().zip(then).map(|(now, then)| now - then).collect()
    };
    let vertices = rest.len();
    let morph = |(weight, frame): (usize, &Vec<Vec3>)| MorphTarget {
        weight,
        vertices: (0..vertices as u32).collect(),
        position_deltas: less(frame, rest),
        normal_deltas: less(&shaded(frame), &rest_normals),
    };
    let part = Part {
        node: 0,
        source_node: 0,
        primitive: 0,
        name: "sequence".into(),
        vertices: 0..vertices,
        triangles: 0..triangles.len(),
    };
    Mesh {
        positions: rest.clone(),
        parts: vec![part],
        deformers: vec![Deformer { node: 0, inverse_bind: Affine3A::IDENTITY }],
        influences: vec![Influence { deformer: 0, weight: 1.0 }; vertices],
        influence_starts: (0..=vertices as u32).collect(),
        morphs: frames[1..].iter().enumerate().map(morph).collect(),
        weight_names: (1..frames.len()).map(|frame| format!("frame{frame}")).collect(),
        default_weights: vec![0.0; frames.len() - 1],
        normals: rest_normals,
        triangles,
    }
}

/// One key per frame, at which that frame's weight alone is 1.
fn clip(frames: usize, fps: f32) -> Clip {
    let slots = frames - 1;
    let mut values = vec![0.0; frames * slots];
    (1..frames).for_each(|frame| values[frame * slots + frame - 1] = 1.0);
    let times_s: Vec<f32> = (0..frames).map(|frame| frame as f32 / fps).collect();
    let channel = Channel {
        target: Target::Weights(0..slots),
        interpolation: Interpolation::Linear,
        times_s,
        values,
    };
    let duration_s = slots as f32 / fps;
    Clip { name: "sequence".into(), duration_s, channels: vec![channel] }
}

fn faces(
    archive: &mut Archive<'_>,
    vertices: usize,
    budget: &mut Budget,
) -> Result<Vec<[u32; 3]>, Error> {
    let (shape, corners) = archive.integers("faces", budget)?;
    let &[count, 3] = shape.as_slice() else {
        return Err(invalid("faces", format!("shape {shape:?} is not [triangle, 3]")));
    };
    budget.take(Quantity::Triangles, count as u64, "faces")?;
    if count == 0 {
        return Err(Error::NoTriangles { place: "the sequence".into() });
    }
    let index = |(at, &corner): (usize, &i64)| {
        u32::try_from(corner).ok().filter(|&index| (index as usize) < vertices).ok_or_else(|| {
            invalid("faces", format!("entry {at} is {corner}, but there are {vertices} vertices"))
        })
    };
    let corners: Vec<u32> = corners.iter().enumerate().map(index).collect::<Result<_, _>>()?;
    Ok(corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect())
}

fn fps(
    archive: &mut Archive<'_>,
    budget: &mut Budget,
    notices: &mut Notices,
) -> Result<f32, Error> {
    if !archive.has("fps") {
        notices.add(format!("the sequence states no fps; {DEFAULT_FPS} was taken"));
        return Ok(DEFAULT_FPS);
    }
    let (_, values) = archive.floats("fps", budget)?;
    match values.as_slice() {
        [fps] if (0.1..=10_000.0).contains(fps) => Ok(*fps),
        found => Err(invalid("fps", format!("{found:?} is not one number from 0.1 to 10000"))),
    }
}

/// The arrays of an archive.
struct Archive<'a> {
    zip: ZipArchive<Cursor<&'a [u8]>>,
}

impl<'a> Archive<'a> {
    fn open(source: &'a Source) -> Result<Self, Error> {
        let zip = ZipArchive::new(Cursor::new(source.bytes.as_slice()))
            .map_err(|fault| invalid(&source.name, format!("it is no archive: {fault}")))?;
        if zip.len() > MOST_ENTRIES {
            let fault = format!("it has {} entries; at most {MOST_ENTRIES} are read", zip.len());
            return Err(invalid(&source.name, fault));
        }
        Ok(Self { zip })
    }

    fn has(&self, name: &str) -> bool {
        self.zip.index_for_name(&format!("{name}.npy")).is_some()
    }

    /// An array of floating-point numbers, f32 or f64.
    fn floats(&mut self, name: &str, budget: &mut Budget) -> Result<(Vec<usize>, Vec<f32>), Error> {
        self.array(name, budget, |file, kind, size| match (kind, size) {
            (TypeChar::Float, 4) => file.into_vec::<f32>().map(Some),
            (TypeChar::Float, 8) => {
                let values = file.into_vec::<f64>()?;
                Ok(Some(values.into_iter().map(|value| value as f32).collect()))
            }
            _ => Ok(None),
        })
    }

    /// An array of integers of 32 or 64 bits.
    fn integers(
        &mut self,
        name: &str,
        budget: &mut Budget,
    ) -> Result<(Vec<usize>, Vec<i64>), Error> {
        self.array(name, budget, |file, kind, size| {
            Ok(match (kind, size) {
                (TypeChar::Int, 4) => {
                    Some(file.into_vec::<i32>()?.into_iter().map(i64::from).collect())
                }
                (TypeChar::Int, 8) => Some(file.into_vec::<i64>()?),
                (TypeChar::Uint, 4) => {
                    Some(file.into_vec::<u32>()?.into_iter().map(i64::from).collect())
                }
                (TypeChar::Uint, 8) => {
                    let values = file.into_vec::<u64>()?;
                    Some(values.into_iter().map(|v| i64::try_from(v).unwrap_or(i64::MAX)).collect())
                }
                _ => None,
            })
        })
    }

    /// Reads an array whose type `read` knows, after counting what it claims to hold.
    fn array<T>(
        &mut self,
        name: &str,
        budget: &mut Budget,
        read: impl FnOnce(NpyFile<Cursor<Vec<u8>>>, TypeChar, u64) -> std::io::Result<Option<Vec<T>>>,
    ) -> Result<(Vec<usize>, Vec<T>), Error> {
        let wrong = |fault: String| invalid(name, fault);
        let entry = self
            .zip
            .by_name(&format!("{name}.npy"))
            .map_err(|fault| wrong(format!("the archive has no such array: {fault}")))?;
        let claimed = entry.size();
        budget.take(Quantity::DecodedBytes, claimed.saturating_mul(2), name)?;
        let mut bytes = Vec::new();
        entry
            .take(claimed)
            .read_to_end(&mut bytes)
            .map_err(|fault| wrong(format!("it cannot be unpacked: {fault}")))?;
        let held = bytes.len() as u64;
        let file = NpyFile::new(Cursor::new(bytes))
            .map_err(|fault| wrong(format!("it is no array: {fault}")))?;
        if file.order() != Order::C && file.shape().len() > 1 {
            return Err(wrong("it is in Fortran order; save it in C order".into()));
        }
        let DType::Plain(kind) = file.dtype() else {
            return Err(wrong("it is an array of records, not of numbers".into()));
        };
        let size = kind.size_field();
        let count = file.shape().iter().try_fold(1_u64, |all, &side| all.checked_mul(side));
        if count.and_then(|count| count.checked_mul(size)).is_none_or(|bytes| bytes > held) {
            return Err(wrong(format!("shape {:?} is more than it holds", file.shape())));
        }
        let shape = file.shape().iter().map(|&side| side as usize).collect();
        let values = read(file, kind.type_char(), size)
            .map_err(|fault| wrong(format!("it cannot be read: {fault}")))?;
        let values =
            values.ok_or_else(|| wrong(format!("numbers of type {kind} are not read there")))?;
        Ok((shape, values))
    }
}

fn invalid(array: &str, fault: String) -> Error {
    Error::invalid(format!("array `{array}`"), fault)
}
