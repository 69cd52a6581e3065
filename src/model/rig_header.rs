//! The rig as a model carries it: what turns a tool's joint rotations into parameters and bone
//! rotations without the scene's file.

use serde::{Deserialize, Serialize};

use super::Error;
use super::header::{check_finite, check_index, check_name, field, limits, within};

/// Nodes, bones and parametrisation, in the header of a model.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigHeader {
    /// Parents before children, names unique.
    pub nodes: Vec<NodeHeader>,
    /// The node whose rigid motion is the character's own; none where the scene is the frame.
    pub root_node: Option<u32>,
    /// Bone → node.
    pub bones: Vec<u32>,
    /// Morph weights in slot order.
    pub weights: Vec<WeightHeader>,
    /// One per pose parameter, in order.
    pub columns: Vec<ColumnHeader>,
    /// Length by which translations are divided, metres.
    pub size_m: f32,
    /// Degrees of freedom without variance in training, which have no column.
    pub dropped: Vec<String>,
    /// How much of the root node's motion the root frame takes out; not written where it is all.
    #[serde(default, skip_serializing_if = "RootMotionHeader::is_rigid")]
    pub root_motion: RootMotionHeader,
}

/// What of the root node's motion since rest is removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RootMotionHeader {
    /// All of it: nothing but the character occludes.
    #[default]
    Rigid,
    /// The turn about +Y and the motion in the plane: there is level ground.
    Upright,
}

impl RootMotionHeader {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
    fn is_rigid(&self) -> bool {
        *self == Self::Rigid
    }
}

/// One node at rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NodeHeader {
    /// Unique.
    pub name: String,
    /// A smaller index, or none at a root.
    pub parent: Option<u32>,
    /// Metres, in the parent's space.
    pub translation: [f32; 3],
    /// Unit quaternion x, y, z, w.
    pub rotation: [f32; 4],
    /// Per axis.
    pub scale: [f32; 3],
}

/// One morph weight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeightHeader {
    /// Unique.
    pub name: String,
    /// The value where a pose says nothing.
    pub default: f32,
}

/// One pose parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColumnHeader {
    /// For people.
    pub name: String,
    /// What it is computed from.
    pub source: SourceHeader,
}

/// What a pose parameter is computed from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum SourceHeader {
    /// Component `axis` of the rotation vector of mean⁻¹·q, radians.
    Rotation {
        /// Index into `nodes`.
        node: u32,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// Unit quaternion x, y, z, w.
        mean: [f32; 4],
    },
    /// (translation − `rest`) / `size_m`.
    Translation {
        /// Index into `nodes`.
        node: u32,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// Metres.
        rest: f32,
    },
    /// scale − `rest`.
    Scale {
        /// Index into `nodes`.
        node: u32,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// Without unit.
        rest: f32,
    },
    /// Where the point `offset` of the node is in the root frame, over `size_m`.
    Point {
        /// Index into `nodes`.
        node: u32,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// In the node's own space.
        offset: [f32; 3],
    },
    /// Component `axis` of the rotation vector of q·rest⁻¹, radians: q is the node's rotation in the
    /// root frame.
    Tilt {
        /// Index into `nodes`.
        node: u32,
        /// 0, 1, 2 for x, y, z.
        axis: u8,
        /// Unit quaternion x, y, z, w.
        rest: [f32; 4],
    },
    /// (height of the node in the root frame − `rest`) / `size_m`.
    Height {
        /// Index into `nodes`.
        node: u32,
        /// Metres.
        rest: f32,
    },
    /// A morph weight.
    Weight {
        /// Index into `weights`.
        slot: u32,
    },
    /// How far the triangles (a, b, c) and (b, a, d) are from flat, radians, less `mean` by the short
    /// way.
    Dihedral {
        /// a, b, c, d.
        points: [u32; 4],
        /// Radians.
        mean: f32,
    },
}

impl SourceHeader {
    /// The node that it is of, by its index into `nodes`.
    #[must_use]
    pub fn node(&self) -> Option<u32> {
        match *self {
            Self::Rotation { node, .. }
            | Self::Translation { node, .. }
            | Self::Scale { node, .. }
            | Self::Point { node, .. }
            | Self::Tilt { node, .. }
            | Self::Height { node, .. } => Some(node),
            Self::Weight { .. } | Self::Dihedral { .. } => None,
        }
    }
}

impl RigHeader {
    pub(super) fn check(&self) -> Result<(), Error> {
        within("rig nodes", self.nodes.len() as u64, limits::NODES)?;
        within("bones", self.bones.len() as u64, limits::NODES)?;
        within("morph weights", self.weights.len() as u64, limits::PARAMETERS)?;
        within("pose parameters", self.columns.len() as u64, limits::PARAMETERS)?;
        if !(self.size_m.is_finite() && self.size_m > 0.0) {
            return Err(field("rig.size_m", format!("{} is no length", self.size_m)));
        }
        for (i, node) in self.nodes.iter().enumerate() {
            node.check(&format!("rig.nodes[{i}]"), i)?;
        }
        check_unique("rig.nodes", self.nodes.iter().map(|node| node.name.as_str()))?;
        if let Some(root) = self.root_node {
            check_index("rig.root_node", root, self.nodes.len())?;
        }
        for (i, &bone) in self.bones.iter().enumerate() {
            check_index(&format!("rig.bones[{i}]"), bone, self.nodes.len())?;
        }
        for (i, weight) in self.weights.iter().enumerate() {
            check_name(&format!("rig.weights[{i}]"), &weight.name)?;
            check_finite(&format!("rig.weights[{i}].default"), &[weight.default])?;
        }
        check_unique("rig.weights", self.weights.iter().map(|weight| weight.name.as_str()))?;
        for (i, column) in self.columns.iter().enumerate() {
            let place = format!("rig.columns[{i}]");
            check_name(&place, &column.name)?;
            self.check_source(&place, &column.source)?;
        }
        for (i, name) in self.dropped.iter().enumerate() {
            check_name(&format!("rig.dropped[{i}]"), name)?;
        }
        Ok(())
    }

    /// Whether what the parameters look at is among so many points.
    pub(super) fn check_points(&self, count: u32) -> Result<(), Error> {
        for (i, column) in self.columns.iter().enumerate() {
            if let SourceHeader::Dihedral { points, .. } = column.source {
                for point in points {
                    check_index(&format!("rig.columns[{i}].points"), point, count as usize)?;
                }
            }
        }
        Ok(())
    }

    fn check_source(&self, place: &str, source: &SourceHeader) -> Result<(), Error> {
        match source {
            SourceHeader::Rotation { node, axis, mean } => {
                self.check_axis(place, *node, *axis)?;
                check_unit(&format!("{place}.mean"), *mean)
            }
            SourceHeader::Translation { node, axis, rest }
            | SourceHeader::Scale { node, axis, rest } => {
                self.check_axis(place, *node, *axis)?;
                check_finite(&format!("{place}.rest"), &[*rest])
            }
            SourceHeader::Point { node, axis, offset } => {
                self.check_axis(place, *node, *axis)?;
                check_finite(&format!("{place}.offset"), offset)
            }
            SourceHeader::Tilt { node, axis, rest } => {
                self.check_axis(place, *node, *axis)?;
                check_unit(&format!("{place}.rest"), *rest)
            }
            SourceHeader::Height { node, rest } => {
                check_index(&format!("{place}.node"), *node, self.nodes.len())?;
                check_finite(&format!("{place}.rest"), &[*rest])
            }
            SourceHeader::Weight { slot } => {
                check_index(&format!("{place}.slot"), *slot, self.weights.len())
            }
            SourceHeader::Dihedral { mean, .. } => check_finite(&format!("{place}.mean"), &[*mean]),
        }
    }

    fn check_axis(&self, place: &str, node: u32, axis: u8) -> Result<(), Error> {
        check_index(&format!("{place}.node"), node, self.nodes.len())?;
        check_index(&format!("{place}.axis"), u32::from(axis), 3)
    }
}

impl NodeHeader {
    fn check(&self, place: &str, index: usize) -> Result<(), Error> {
        check_name(place, &self.name)?;
        if let Some(parent) = self.parent
            && parent as usize >= index
        {
            let problem = format!("{parent} does not come before its child {index}");
            return Err(field(format!("{place}.parent"), problem));
        }
        check_finite(&format!("{place}.translation"), &self.translation)?;
        check_finite(&format!("{place}.scale"), &self.scale)?;
        check_unit(&format!("{place}.rotation"), self.rotation)
    }
}

/// A quaternion that is a rotation: its length is 1 up to f32 round-off of other tools.
fn check_unit(place: &str, q: [f32; 4]) -> Result<(), Error> {
    let square: f64 = q.iter().map(|&x| f64::from(x) * f64::from(x)).sum();
    if (square - 1.0).abs() < 1e-3 {
        Ok(())
    } else {
        Err(field(place, format!("its square length is {square}, not 1")))
    }
}

fn check_unique<'a>(place: &str, names: impl Iterator<Item = &'a str>) -> Result<(), Error> {
    let mut sorted: Vec<&str> = names.collect();
    sorted.sort_unstable();
    match sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(field(place, format!("two are named `{}`", pair[0]))),
        None => Ok(()),
    }
}
