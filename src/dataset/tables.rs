//! What is written before the first block: pose tables and the rest mesh.

use std::borrow::Cow;
use std::path::Path;

use glam::{Quat, Vec3};

use super::values::{bytes_of, read_bytes, read_table};
use super::{Error, Layout, SPLIT_NAMES, arrays};
use crate::rig::RigidFrame;
use crate::scene::Source;

/// Everything of a data set but the baked blocks.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Static {
    /// One row per pose.
    pub poses: PoseTable,
    /// The mesh at rest.
    pub mesh: RestMesh,
    /// The scene's files, so that a data set needs nothing else.
    pub sources: Vec<Source>,
}

/// What each pose is. All tables have one row per pose.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PoseTable {
    /// `[pose, parameter]`, not centred; radians, lengths divided by the model's size.
    pub parameters: Vec<f32>,
    /// Index into [`super::Attributes::clip_names`], -1 for none.
    pub clips: Vec<i32>,
    /// Seconds from the clip's start.
    pub times_s: Vec<f32>,
    /// Index into [`SPLIT_NAMES`].
    pub splits: Vec<u8>,
    /// Root frame → scene.
    pub roots: Vec<RigidFrame>,
    /// `[pose, bone]`, relative to rest, in the root frame.
    pub bone_rotations: Vec<Quat>,
}

/// The mesh at rest, and how its vertices are merged to points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RestMesh {
    /// Metres, the scene at rest; one per vertex.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, one per vertex.
    pub normals: Vec<Vec3>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// The point that each vertex was merged into.
    pub point_of_vertex: Vec<u32>,
    /// A vertex of each point.
    pub vertex_of_point: Vec<u32>,
    /// The dominant bone of each point.
    pub bone_of_point: Vec<u16>,
}

/// Lengths and values of the tables of one data set.
pub(super) struct Tables<'a> {
    pub(super) poses: &'a PoseTable,
    pub(super) mesh: &'a RestMesh,
}

impl Tables<'_> {
    /// The bytes of each of [`arrays::tables`], in its order.
    pub(super) fn bytes(&self) -> [Cow<'_, [u8]>; 13] {
        let (poses, mesh) = (self.poses, self.mesh);
        let rotations: Vec<Quat> = poses.roots.iter().map(|root| root.rotation).collect();
        let translations: Vec<Vec3> = poses.roots.iter().map(|root| root.translation).collect();
        let bones: Vec<i32> = mesh.bone_of_point.iter().map(|&bone| i32::from(bone)).collect();
        [
            bytes_of(&poses.parameters),
            bytes_of(&poses.clips),
            bytes_of(&poses.times_s),
            Cow::Borrowed(&poses.splits),
            Cow::Owned(bytes_of(&rotations).into_owned()),
            Cow::Owned(bytes_of(&translations).into_owned()),
            bytes_of(&poses.bone_rotations),
            Cow::Owned(bytes_of(&bones).into_owned()),
            // Indices stay below 2²⁷, so the file's i32 has the same bytes.
            bytes_of(&mesh.vertex_of_point),
            bytes_of(&mesh.point_of_vertex),
            bytes_of(&mesh.positions),
            bytes_of(&mesh.normals),
            bytes_of(&mesh.triangles),
        ]
    }

    /// Whether all tables have the layout's lengths and values within their ranges.
    pub(super) fn check(&self, layout: &Layout, clips: usize) -> Result<(), Error> {
        self.check_lengths(layout)?;
        let (poses, mesh) = (self.poses, self.mesh);
        finite("parameters", &poses.parameters)?;
        finite("time_s", &poses.times_s)?;
        finite("root_translation", poses.roots.iter().flat_map(|root| root.translation.as_ref()))?;
        finite("position", mesh.positions.iter().flat_map(|position| position.as_ref()))?;
        finite("normal", mesh.normals.iter().flat_map(|normal| normal.as_ref()))?;
        unit("root_rotation", poses.roots.iter().map(|root| root.rotation))?;
        unit("bone_rotation", poses.bone_rotations.iter().copied())?;
        let clip = |&clip: &i32| i64::from(clip);
        range("clip", poses.clips.iter().map(clip), -1, clips)?;
        range("split", poses.splits.iter().map(|&split| split.into()), 0, SPLIT_NAMES.len())?;
        range(
            "bone_of_point",
            mesh.bone_of_point.iter().map(|&bone| bone.into()),
            0,
            layout.bones,
        )?;
        let index = |&index: &u32| i64::from(index);
        range("vertex_of_point", mesh.vertex_of_point.iter().map(index), 0, layout.vertices)?;
        range("point_of_vertex", mesh.point_of_vertex.iter().map(index), 0, layout.points)?;
        let corners = mesh.triangles.iter().flatten();
        range("vertices_of_triangle", corners.map(index), 0, layout.vertices)
    }

    fn check_lengths(&self, layout: &Layout) -> Result<(), Error> {
        let (poses, mesh) = (self.poses, self.mesh);
        for (array, found, expected) in [
            ("parameters", poses.parameters.len(), layout.poses * layout.parameters),
            ("clip", poses.clips.len(), layout.poses),
            ("time_s", poses.times_s.len(), layout.poses),
            ("split", poses.splits.len(), layout.poses),
            ("root_rotation", poses.roots.len(), layout.poses),
            ("bone_rotation", poses.bone_rotations.len(), layout.poses * layout.bones),
            ("bone_of_point", mesh.bone_of_point.len(), layout.points),
            ("vertex_of_point", mesh.vertex_of_point.len(), layout.points),
            ("point_of_vertex", mesh.point_of_vertex.len(), layout.vertices),
            ("position", mesh.positions.len(), layout.vertices),
            ("normal", mesh.normals.len(), layout.vertices),
            ("vertices_of_triangle", mesh.triangles.len(), layout.triangles),
        ] {
            if found != expected {
                return Err(Error::Length { array, expected, found });
            }
        }
        Ok(())
    }
}

/// Reads and checks every table of the data set at `root`.
pub(super) fn read(
    root: &Path,
    layout: &Layout,
    clips: usize,
) -> Result<(PoseTable, RestMesh), Error> {
    let [
        parameters,
        clip,
        time_s,
        split,
        root_rotation,
        root_translation,
        bone_rotation,
        bone_of_point,
        vertex_of_point,
        point_of_vertex,
        position,
        normal,
        triangles,
    ] = arrays::tables(layout);
    let rotations = quaternions(&read_table(root, &root_rotation)?);
    let translations: Vec<[f32; 3]> = rows(&read_table(root, &root_translation)?);
    let poses = PoseTable {
        parameters: read_table(root, &parameters)?,
        clips: read_table(root, &clip)?,
        times_s: read_table(root, &time_s)?,
        splits: read_bytes(root, &split)?,
        roots: (rotations.into_iter().zip(translations))
            .map(|(rotation, t)| RigidFrame { rotation, translation: t.into() })
            .collect(),
        bone_rotations: quaternions(&read_table(root, &bone_rotation)?),
    };
    let bones: Vec<i32> = read_table(root, &bone_of_point)?;
    range("bone_of_point", bones.iter().map(|&bone| bone.into()), 0, layout.bones)?;
    let mesh = RestMesh {
        positions: rows(&read_table(root, &position)?).into_iter().map(Vec3::from_array).collect(),
        normals: rows(&read_table(root, &normal)?).into_iter().map(Vec3::from_array).collect(),
        triangles: rows(&read_table(root, &triangles)?),
        point_of_vertex: read_table(root, &point_of_vertex)?,
        vertex_of_point: read_table(root, &vertex_of_point)?,
        // In range as found above, so nothing is cut off.
        bone_of_point: bones.into_iter().map(|bone| bone as u16).collect(),
    };
    Tables { poses: &poses, mesh: &mesh }.check(layout, clips)?;
    Ok((poses, mesh))
}

fn rows<T: bytemuck::Pod, const N: usize>(values: &[T]) -> Vec<[T; N]> {
    values.as_chunks::<N>().0.to_vec()
}

fn quaternions(values: &[f32]) -> Vec<Quat> {
    rows::<f32, 4>(values).into_iter().map(Quat::from_array).collect()
}

fn finite<'a>(array: &'static str, values: impl IntoIterator<Item = &'a f32>) -> Result<(), Error> {
    match values.into_iter().enumerate().find(|(_, value)| !value.is_finite()) {
        None => Ok(()),
        Some((index, value)) => Err(value_error(array, index, value, "a finite number")),
    }
}

fn unit(array: &'static str, rotations: impl Iterator<Item = Quat>) -> Result<(), Error> {
    // Wide enough for any rounding; what it must stop is zeros, NaN and other units.
    const TOLERANCE: f32 = 1e-3;
    let off = |rotation: &Quat| {
        !rotation.is_finite() || (rotation.length_squared() - 1.0).abs() > TOLERANCE
    };
    match rotations.enumerate().find(|(_, rotation)| off(rotation)) {
        None => Ok(()),
        Some((index, rotation)) => Err(value_error(array, index, rotation, "a unit quaternion")),
    }
}

fn range(
    array: &'static str,
    values: impl Iterator<Item = i64>,
    least: i64,
    end: usize,
) -> Result<(), Error> {
    let end = end as i64;
    match values.enumerate().find(|&(_, value)| value < least || value >= end) {
        None => Ok(()),
        Some((index, value)) => {
            Err(value_error(array, index, value, &format!("{least} to {}", end - 1)))
        }
    }
}

fn value_error(
    array: &'static str,
    index: usize,
    found: impl std::fmt::Display,
    expected: &str,
) -> Error {
    Error::Value { array, index, found: found.to_string(), expected: expected.to_owned() }
}
