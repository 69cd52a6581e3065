//! Skins: joints with their inverse bind matrices, and the influences of vertices.

use glam::{Affine3A, Mat4};
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::mesh::{Primitive, Semantic};
use gltf::json::validation::Checked;

use super::File;
use super::accessor::Format;
use super::node::Graph;
use crate::rig::{Deformer, Influence};
use crate::scene::budget::Quantity;
use crate::scene::error::Error;

const MATRICES: Format = Format { kind: Type::Mat4, components: &[(ComponentType::F32, None)] };
const JOINTS: Format = Format {
    kind: Type::Vec4,
    components: &[(ComponentType::U8, Some(false)), (ComponentType::U16, Some(false))],
};
/// Weights are divided by their sum in any case, so plain integers do as well as normalised ones.
const WEIGHTS: Format = Format {
    kind: Type::Vec4,
    components: &[
        (ComponentType::F32, None),
        (ComponentType::U8, None),
        (ComponentType::U16, None),
    ],
};

/// Sums further than this from 1 are worth a notice; integers and short decimals stay below it.
const SUM_TOLERANCE: f64 = 2e-3;

/// Sets of four weights that are read: twice as many as tools commonly write.
const MOST_SETS: u32 = 4;

/// The deformers of all skins and rigid nodes so far, each made once.
#[derive(Debug)]
pub(super) struct Deformers {
    pub(super) all: Vec<Deformer>,
    /// Skin → where its joints start in `all`.
    of_skin: Vec<Option<u32>>,
}

impl Deformers {
    pub(super) fn new(skins: usize) -> Self {
        Self { all: Vec::new(), of_skin: vec![None; skins] }
    }

    /// The deformer of a rigid part.
    pub(super) fn rigid(&mut self, node: usize) -> u32 {
        self.all.push(Deformer { node, inverse_bind: Affine3A::IDENTITY });
        (self.all.len() - 1) as u32
    }

    /// The first deformer of a skin's joints, which follow one another in the skin's order.
    pub(super) fn skin(
        &mut self,
        file: &mut File,
        graph: &Graph,
        index: usize,
    ) -> Result<u32, Error> {
        if let Some(first) = self.of_skin[index] {
            return Ok(first);
        }
        let first = self.all.len() as u32;
        for (at, matrix) in inverse_binds(file, index)?.into_iter().enumerate() {
            let joint = file.root.skins[index].joints[at].value();
            let node = graph.of_file[joint].ok_or_else(|| {
                let fault = format!("nodes[{joint}] lies outside the scene");
                Error::invalid(format!("skins[{index}].joints[{at}]"), fault)
            })?;
            self.all.push(Deformer { node, inverse_bind: matrix });
        }
        self.of_skin[index] = Some(first);
        Ok(first)
    }
}

/// The inverse bind matrices of a skin, identity where the file has none.
pub(super) fn inverse_binds(file: &mut File, index: usize) -> Result<Vec<Affine3A>, Error> {
    let skin = &file.root.skins[index];
    let place = format!("skins[{index}]");
    let joints = skin.joints.len();
    if joints == 0 {
        return Err(Error::invalid(place, "it has no joints"));
    }
    file.budget.take(Quantity::Joints, joints as u64, &place)?;
    let Some(accessor) = skin.inverse_bind_matrices else {
        return Ok(vec![Affine3A::IDENTITY; joints]);
    };
    let purpose = format!("{place}.inverseBindMatrices");
    let elements = file.accessor(accessor.value(), &purpose, MATRICES)?;
    if elements.count < joints {
        let fault = format!("{} matrices for {joints} joints", elements.count);
        return Err(Error::invalid(purpose, fault));
    }
    let matrices = file.finite_floats::<16>(&elements)?;
    let affine = |m: &[f32; 16]| [m[3], m[7], m[11], m[15]] == [0.0, 0.0, 0.0, 1.0];
    if let Some(joint) = matrices.iter().take(joints).position(|matrix| !affine(matrix)) {
        file.notices.add(format!(
            "{purpose}, matrix {joint}: the last row is not 0, 0, 0, 1; it is taken as that"
        ));
    }
    let to_affine = |m: &[f32; 16]| Affine3A::from_mat4(Mat4::from_cols_array(m));
    Ok(matrices[..joints].iter().map(to_affine).collect())
}

/// Influences of a primitive's vertices: concatenated, and how many each vertex has.
pub(super) struct Influences {
    pub(super) all: Vec<Influence>,
    pub(super) counts: Vec<u32>,
}

/// Joints and weights of every vertex, of one set.
struct WeightSet {
    joints: Vec<[u32; 4]>,
    weights: Vec<[f32; 4]>,
}

/// The joints that a primitive's vertices may name.
#[derive(Debug, Clone, Copy)]
pub(super) struct Joints {
    pub(super) count: usize,
    pub(super) first_deformer: u32,
}

/// Reads `JOINTS_n` and `WEIGHTS_n`, drops zeros, and makes the weights of a vertex sum to 1.
/// `None` where the primitive has no such attributes.
pub(super) fn influences(
    file: &mut File,
    primitive: &Primitive,
    place: &str,
    vertices: usize,
    joints: Joints,
) -> Result<Option<Influences>, Error> {
    let sets = weight_sets(file, primitive, place, vertices)?;
    if sets.is_empty() {
        return Ok(None);
    }
    let mut all = Vec::with_capacity(vertices);
    let mut counts = Vec::with_capacity(vertices);
    let (mut off, mut low, mut high) = (0_usize, f64::INFINITY, f64::NEG_INFINITY);
    for vertex in 0..vertices {
        let start = all.len();
        gather(&sets, vertex, joints, &mut all)
            .map_err(|fault| Error::invalid(format!("{place}, vertex {vertex}"), fault))?;
        let sum = normalize(&mut all[start..])
            .map_err(|fault| Error::invalid(format!("{place}, vertex {vertex}"), fault))?;
        (low, high) = (low.min(sum), high.max(sum));
        off += usize::from((sum - 1.0).abs() > SUM_TOLERANCE);
        counts.push((all.len() - start) as u32);
    }
    if off > 0 {
        file.notices.add(format!(
            "{place}: the weights of {off} of {vertices} vertices do not sum to 1 (from {low:.4} \
             to {high:.4}); they were divided by their sum"
        ));
    }
    Ok(Some(Influences { all, counts }))
}

/// Appends the influences of one vertex, as they are in the file; a joint named twice counts once.
fn gather(
    sets: &[WeightSet],
    vertex: usize,
    joints: Joints,
    all: &mut Vec<Influence>,
) -> Result<(), String> {
    let start = all.len();
    for (set, values) in sets.iter().enumerate() {
        for (&joint, &weight) in values.joints[vertex].iter().zip(&values.weights[vertex]) {
            if weight == 0.0 {
                continue;
            }
            if let Some(fault) = weight_fault(joint, weight, joints.count) {
                return Err(format!("weight set {set}: {fault}"));
            }
            let deformer = joints.first_deformer + joint;
            match all[start..].iter_mut().find(|known| known.deformer == deformer) {
                Some(known) => known.weight += weight,
                None => all.push(Influence { deformer, weight }),
            }
        }
    }
    Ok(())
}

/// Divides a vertex's weights by their sum, and returns that.
fn normalize(influences: &mut [Influence]) -> Result<f64, String> {
    let weights = influences.iter().map(|influence| f64::from(influence.weight));
    let sum = weights.fold(0.0, |sum, weight| sum + weight);
    if sum <= 0.0 || !sum.is_finite() {
        return Err(format!("its weights sum to {sum}; every skinned vertex needs a joint"));
    }
    for influence in influences {
        // Positive also where the quotient underflows.
        let share = (f64::from(influence.weight) / sum) as f32;
        influence.weight = share.max(f32::MIN_POSITIVE);
    }
    Ok(sum)
}

fn weight_fault(joint: u32, weight: f32, joints: usize) -> Option<String> {
    if joint as usize >= joints {
        return Some(format!("joint {joint} of a skin with {joints} joints"));
    }
    let bad = !weight.is_finite() || weight < 0.0;
    bad.then(|| format!("weight {weight} is not a share"))
}

/// All weight sets, in their order.
fn weight_sets(
    file: &mut File,
    primitive: &Primitive,
    place: &str,
    vertices: usize,
) -> Result<Vec<WeightSet>, Error> {
    let mut sets = Vec::new();
    for set in 0..=MOST_SETS {
        let find = |semantic| primitive.attributes.get(&Checked::Valid(semantic));
        let (joints, weights) = (find(Semantic::Joints(set)), find(Semantic::Weights(set)));
        let (Some(joints), Some(weights)) = (joints, weights) else {
            if joints.is_some() || weights.is_some() {
                let fault = format!("JOINTS_{set} and WEIGHTS_{set} must come together");
                return Err(Error::invalid(place, fault));
            }
            break;
        };
        if set == MOST_SETS {
            let feature = format!("JOINTS_{set}, more than {} influences", 4 * MOST_SETS);
            return Err(Error::Unsupported { feature, place: place.to_owned(), hint: "" });
        }
        let purpose = format!("JOINTS_{set} of {place}");
        let joints = file.accessor(joints.value(), &purpose, JOINTS)?;
        super::mesh::check_count(&joints, vertices)?;
        let purpose = format!("WEIGHTS_{set} of {place}");
        let weights = file.accessor(weights.value(), &purpose, WEIGHTS)?;
        super::mesh::check_count(&weights, vertices)?;
        if set == 0 {
            weights.require_data("zeros name no joint")?;
        }
        let (joints, weights) = (file.unsigned(&joints)?, file.floats(&weights)?);
        sets.push(WeightSet { joints, weights });
    }
    Ok(sets)
}
