//! The node graph: from the file's list to a skeleton with parents before children.

use std::collections::{HashMap, HashSet};

use glam::{DMat3, DQuat, DVec3, Quat, Vec3};
use gltf::json::{Root, scene as json};

use super::{File, instance};
use crate::rig::{Node, Skeleton, Transform};
use crate::scene::budget::Quantity;
use crate::scene::error::Error;

/// The nodes of the chosen scene.
#[derive(Debug)]
pub(super) struct Graph {
    pub(super) skeleton: Skeleton,
    /// The file's node → index in the skeleton.
    pub(super) of_file: Vec<Option<usize>>,
    /// The file's node → the nodes of the skeleton that show its mesh: itself, or its instances.
    pub(super) carriers: Vec<Vec<usize>>,
    /// Whether the file's node is shown by the chosen scene, not only a joint from elsewhere.
    pub(super) shown: Vec<bool>,
    /// The chosen scene, for messages.
    pub(super) scene: String,
}

/// Longer names are cut here, at a character boundary.
const MOST_NAME_BYTES: usize = 200;

/// Chooses the scene, checks the hierarchy, and orders it depth first.
pub(super) fn read(file: &mut File) -> Result<Graph, Error> {
    let root = file.root;
    file.budget.take(Quantity::Nodes, root.nodes.len() as u64, "nodes")?;
    let parents = parents(root)?;
    check_cycles(root, &parents)?;
    let (roots, scene) = scene_roots(file, &parents)?;
    let mut order = depth_first(root, &roots, &mut vec![false; root.nodes.len()]);
    let mut shown = vec![false; root.nodes.len()];
    order.iter().for_each(|&node| shown[node] = true);
    order.extend(stray_joints(root, &parents, &shown));
    let mut of_file = vec![None; root.nodes.len()];
    order.iter().enumerate().for_each(|(index, &node)| of_file[node] = Some(index));
    let mut names = UniqueNames::default();
    let mut nodes = Vec::with_capacity(order.len());
    for &index in &order {
        let node = &root.nodes[index];
        let mesh_name = || node.mesh.and_then(|mesh| root.meshes[mesh.value()].name.as_deref());
        let name = node.name.as_deref().filter(|name| !name.is_empty()).or_else(mesh_name);
        let name = names.choose(name, || format!("node{index}"));
        let parent = parents[index].and_then(|parent| of_file[parent]);
        let rest = transform(file, node, index)?;
        nodes.push(Node { name, parent, rest });
    }
    let mut carriers: Vec<Vec<usize>> =
        of_file.iter().map(|own| own.iter().copied().collect()).collect();
    for (index, carriers) in carriers.iter_mut().enumerate() {
        let (true, Some(own), Some(_)) = (shown[index], of_file[index], root.nodes[index].mesh)
        else {
            continue;
        };
        let Some(instances) = instance::read(file, index)? else { continue };
        carriers.clear();
        for rest in instances {
            let name = Some(nodes[own].name.clone());
            let name = names.choose(name.as_deref(), String::new);
            carriers.push(nodes.len());
            nodes.push(Node { name, parent: Some(own), rest });
        }
    }
    Ok(Graph { skeleton: Skeleton { nodes }, of_file, carriers, shown, scene })
}

/// The parent of every node; a node has one at most.
fn parents(root: &Root) -> Result<Vec<Option<usize>>, Error> {
    let mut parents = vec![None; root.nodes.len()];
    for (index, node) in root.nodes.iter().enumerate() {
        for child in node.children.iter().flatten() {
            let parent = &mut parents[child.value()];
            if let Some(first) = *parent {
                let place = format!("nodes[{}]", child.value());
                let fault = format!("it is a child of nodes[{first}] and again of nodes[{index}]");
                return Err(Error::invalid(place, fault));
            }
            *parent = Some(index);
        }
    }
    Ok(parents)
}

/// With one parent each, a node is on or below a cycle if no root leads to it.
fn check_cycles(root: &Root, parents: &[Option<usize>]) -> Result<(), Error> {
    let roots: Vec<usize> = (0..parents.len()).filter(|&node| parents[node].is_none()).collect();
    let mut reached = vec![false; parents.len()];
    let order = depth_first(root, &roots, &mut reached);
    if order.len() == parents.len() {
        return Ok(());
    }
    // Climbing from any unreached node ends in the cycle.
    let mut node = reached.iter().position(|reached| !reached).unwrap_or_default();
    let mut seen = HashSet::new();
    while let (true, Some(parent)) = (seen.insert(node), parents[node]) {
        node = parent;
    }
    Err(Error::invalid(format!("nodes[{node}]"), "it is its own ancestor: the graph is cyclic"))
}

/// Nodes below `roots`, parents first, children in the file's order; marks what it meets.
fn depth_first(root: &Root, roots: &[usize], met: &mut [bool]) -> Vec<usize> {
    let mut order = Vec::new();
    let mut pending: Vec<usize> = roots.iter().rev().copied().collect();
    while let Some(node) = pending.pop() {
        if std::mem::replace(&mut met[node], true) {
            continue;
        }
        order.push(node);
        let children = root.nodes[node].children.as_deref().unwrap_or_default();
        pending.extend(children.iter().rev().map(|child| child.value()));
    }
    order
}

/// The root nodes of the default scene, else of the first, else all roots.
fn scene_roots(file: &mut File, parents: &[Option<usize>]) -> Result<(Vec<usize>, String), Error> {
    let root = file.root;
    let chosen = root.scene.map_or(0, |scene| scene.value());
    let Some(scene) = root.scenes.get(chosen) else {
        if !root.nodes.is_empty() {
            file.notices.add("the file has no scene; all of its nodes are taken");
        }
        let roots = (0..parents.len()).filter(|&node| parents[node].is_none()).collect();
        return Ok((roots, "the file".into()));
    };
    if root.scenes.len() > 1 {
        let why = if root.scene.is_some() { "the default" } else { "the first" };
        file.notices
            .add(format!("of {} scenes, scenes[{chosen}] ({why}) is taken", root.scenes.len()));
    }
    let place = format!("scenes[{chosen}]");
    let roots: Vec<usize> = scene.nodes.iter().map(|node| node.value()).collect();
    for (at, &node) in roots.iter().enumerate() {
        if let Some(parent) = parents[node] {
            let fault = format!("nodes[{node}] is no root: it is a child of nodes[{parent}]");
            return Err(Error::invalid(format!("{place}.nodes[{at}]"), fault));
        }
    }
    Ok((roots, place))
}

/// Joints of shown skins that lie outside the chosen scene, with all of their trees.
fn stray_joints(root: &Root, parents: &[Option<usize>], shown: &[bool]) -> Vec<usize> {
    let mut used = vec![false; root.skins.len()];
    for (node, _) in root.nodes.iter().zip(shown).filter(|(_, shown)| **shown) {
        if let Some(skin) = node.skin {
            used[skin.value()] = true;
        }
    }
    let mut met = shown.to_vec();
    let mut order = Vec::new();
    for (skin, _) in root.skins.iter().zip(&used).filter(|(_, used)| **used) {
        for joint in &skin.joints {
            let mut top = joint.value();
            while let (false, Some(parent)) = (met[top], parents[top]) {
                top = parent;
            }
            order.extend(depth_first(root, &[top], &mut met));
        }
    }
    order
}

/// Hands out names that differ: the second `arm` becomes `arm_2`.
#[derive(Debug, Default)]
pub(super) struct UniqueNames {
    taken: HashSet<String>,
    next: HashMap<String, u32>,
}

impl UniqueNames {
    /// The wanted name, cut to a bounded length and numbered if it is taken.
    pub(super) fn choose(
        &mut self,
        wanted: Option<&str>,
        otherwise: impl FnOnce() -> String,
    ) -> String {
        let wanted = wanted.filter(|name| !name.is_empty());
        let base = wanted.map_or_else(otherwise, |name| shorten(name).to_owned());
        let mut name = base.clone();
        while self.taken.contains(&name) {
            let next = self.next.entry(base.clone()).or_insert(2);
            name = format!("{base}_{next}");
            *next += 1;
        }
        self.taken.insert(name.clone());
        name
    }
}

/// Cuts an overlong name: names are copied, and nothing may grow with their number times length.
pub(super) fn shorten(name: &str) -> &str {
    let mut end = name.len().min(MOST_NAME_BYTES);
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    &name[..end]
}

/// The rest transform of a node, from its matrix or from translation, rotation and scale.
fn transform(file: &mut File, node: &json::Node, index: usize) -> Result<Transform, Error> {
    let finite = |values: &[f32], member: &str| {
        let ok = values.iter().all(|value| value.is_finite());
        let place = || format!("nodes[{index}].{member}");
        if ok { Ok(()) } else { Err(Error::invalid(place(), "it is not finite")) }
    };
    if let Some(matrix) = node.matrix {
        finite(&matrix, "matrix")?;
        let (transform, lost) = decompose(&matrix);
        if lost > 1e-3 {
            file.notices.add(format!(
                "nodes[{index}].matrix is no translation, rotation and scale; {:.1} % of it \
                 (shear or projection) was dropped",
                100.0 * lost
            ));
        }
        return Ok(transform);
    }
    let translation = node.translation.unwrap_or_default();
    let scale = node.scale.unwrap_or([1.0; 3]);
    let rotation = node.rotation.unwrap_or_default().0;
    finite(&translation, "translation")?;
    finite(&scale, "scale")?;
    finite(&rotation, "rotation")?;
    let quaternion = DQuat::from_array(rotation.map(f64::from));
    let length = quaternion.length();
    if length == 0.0 {
        return Err(Error::invalid(format!("nodes[{index}].rotation"), "the quaternion is zero"));
    }
    if (length - 1.0).abs() > 1e-3 {
        file.notices
            .add(format!("nodes[{index}].rotation has length {length:.4}; it was normalised"));
    }
    Ok(Transform {
        translation: Vec3::from_array(translation),
        rotation: (quaternion / length).as_quat(),
        scale: Vec3::from_array(scale),
    })
}

/// A column-major matrix as translation, rotation, scale, and the share of it that these cannot
/// express (Frobenius norms of the 3×3 block and the last row). A mirroring matrix gets a
/// negative x scale.
fn decompose(matrix: &[f32; 16]) -> (Transform, f64) {
    let at = |column: usize| {
        DVec3::new(
            f64::from(matrix[4 * column]),
            f64::from(matrix[4 * column + 1]),
            f64::from(matrix[4 * column + 2]),
        )
    };
    let block = DMat3::from_cols(at(0), at(1), at(2));
    let mut scale = DVec3::new(at(0).length(), at(1).length(), at(2).length());
    let mut x = at(0).try_normalize().unwrap_or(DVec3::ZERO);
    if block.determinant() < 0.0 {
        scale.x = -scale.x;
        x = -x;
    }
    // An axis that the matrix flattens, or that shear leans, comes from the others.
    if x == DVec3::ZERO {
        let other = at(1).cross(at(2));
        x = other.try_normalize().unwrap_or_else(|| {
            at(1).try_normalize().map_or_else(
                || at(2).try_normalize().map_or(DVec3::X, DVec3::any_orthonormal_vector),
                DVec3::any_orthonormal_vector,
            )
        });
    }
    let lean = at(1) - x * x.dot(at(1));
    let third = |v: DVec3| v.cross(x).try_normalize();
    let y = lean.try_normalize().or_else(|| third(at(2))).unwrap_or(x.any_orthonormal_vector());
    let rotation = DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y))).normalize();
    let expressed = DMat3::from_quat(rotation) * DMat3::from_diagonal(scale);
    let norm = |m: DMat3| m.to_cols_array().iter().map(|v| v * v).sum::<f64>();
    let row = [matrix[3], matrix[7], matrix[11], matrix[15] - 1.0];
    let projective: f64 = row.iter().map(|&v| f64::from(v) * f64::from(v)).sum();
    let whole = norm(block) + projective;
    let lost = (norm(block - expressed) + projective) / if whole > 0.0 { whole } else { 1.0 };
    let transform = Transform {
        translation: at(3).as_vec3(),
        rotation: Quat::from_array(rotation.to_array().map(|v| v as f32)),
        scale: scale.as_vec3(),
    };
    (transform, lost.sqrt())
}
