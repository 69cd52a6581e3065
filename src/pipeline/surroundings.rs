//! From what a recipe says of surroundings to what the baker needs: meshes that only block, the
//! ground's height, and which meshes see which.

use rayon::prelude::*;

use super::recipe::Recipe;
use super::recipe::surroundings::{GroundRecipe, SurroundingsRecipe};
use super::{Error, hash, receivers};
use crate::bake::{self, NO_POINT, View};
use crate::pose::{PoseSet, RootMotion};
use crate::rig::{self, Deformed, Mesh, Part, Points, Pose, RigidFrame, Skeleton};
use crate::scene::{Scene, Source};

/// Before the names of an occluder scene's files among a data set's sources. A scheme, so no file
/// of the scene itself can have such a name.
const PREFIX: &str = "occluders:";

/// Meshes that block and get no values.
#[derive(Debug, Clone, Default)]
pub struct Occluders {
    /// Moved by the scene's skeleton.
    moving: Mesh,
    /// Metres, in the scene.
    positions: Vec<glam::Vec3>,
    triangles: Vec<[u32; 3]>,
    /// The files that the still part came from.
    sources: Vec<Source>,
}

impl Occluders {
    /// Takes the nodes that the recipe names out of the scene's mesh, and the whole of `still`.
    pub(super) fn take(
        scene: &mut Scene,
        still: Option<Scene>,
        recipe: &mut Recipe,
    ) -> Result<Self, Error> {
        let around = &mut recipe.bake.surroundings;
        let mut taken = Self::default();
        if !around.occluder_nodes.is_empty() {
            let carried = carried(&scene.skeleton, &around.occluder_nodes)?;
            let (lit, moving) = scene.mesh.split(|part| carried[part.node]);
            if moving.parts.is_empty() || lit.parts.is_empty() {
                let what = if lit.parts.is_empty() { "every mesh" } else { "no mesh" };
                let nodes = around.occluder_nodes.join(", ");
                return Err(Error::Surroundings(format!(
                    "{what} of the scene is on or below {nodes}"
                )));
            }
            let lit_triangles = scene.mesh.parts.iter().filter(|part| !carried[part.node]);
            let lit_triangles = lit_triangles.flat_map(|part| part.triangles.clone());
            if let Some(surface) = &mut scene.surface {
                *surface = surface.select(lit_triangles);
            }
            scene.mesh = lit;
            taken.moving = moving;
        }
        match (&mut around.occluders, still) {
            (None, None) => {}
            (Some(named), Some(still)) => {
                let sha256 = hash::scene(&still.sources);
                if hash::same_contents(&still.sources, &scene.sources) {
                    let fault = "the occluders' file is the scene itself, so that every surface \
                                 would lie in its own double";
                    return Err(Error::Surroundings(fault.to_owned()));
                }
                named.file = still.sources.first().map(|s| s.name.clone()).unwrap_or_default();
                named.sha256 = Some(sha256);
                taken.add(still);
            }
            (Some(named), None) => {
                let fault = format!("the occluders' file {:?} was not read", named.file);
                return Err(Error::Surroundings(fault));
            }
            (None, Some(_)) => {
                let fault = "there are occluders that the recipe does not name";
                return Err(Error::Surroundings(fault.to_owned()));
            }
        }
        Ok(taken)
    }

    fn add(&mut self, still: Scene) {
        let rest = Pose::rest(&still.skeleton, &still.mesh.default_weights);
        let globals = still.skeleton.globals(&rest.local);
        let mut posed = Deformed::default();
        rig::deform(&still.mesh, &globals, &rest.weights, RigidFrame::IDENTITY, &mut posed);
        self.positions = posed.positions;
        self.triangles = still.mesh.triangles;
        let name = |source: Source| Source { name: format!("{PREFIX}{}", source.name), ..source };
        self.sources = still.sources.into_iter().map(name).collect();
    }

    fn is_empty(&self) -> bool {
        self.positions.is_empty() && self.moving.positions.is_empty()
    }

    /// The files of the still part, as they go into a data set.
    pub(super) fn sources(&self) -> &[Source] {
        &self.sources
    }

    /// Appends the occluders of a pose.
    pub(super) fn append(
        &self,
        globals: &[glam::Affine3A],
        weights: &[f32],
        root: RigidFrame,
        out: &mut Deformed,
    ) {
        if self.is_empty() {
            return;
        }
        if !self.moving.positions.is_empty() {
            let mut moved = Deformed::default();
            rig::deform(&self.moving, globals, weights, root, &mut moved);
            out.positions.append(&mut moved.positions);
        }
        let to_root = root.inverse();
        out.positions.extend(self.positions.iter().map(|&p| to_root.transform_point3(p)));
        out.normals.resize(out.positions.len(), glam::Vec3::ZERO);
    }

    /// The scene's triangles and points with the occluders'.
    pub(super) fn with(&self, mesh: &Mesh, points: &Points) -> (Vec<[u32; 3]>, Points) {
        let (mut triangles, mut points) = (mesh.triangles.clone(), points.clone());
        let (lit, moving) = (mesh.positions.len() as u32, self.moving.positions.len() as u32);
        triangles.extend(self.moving.triangles.iter().map(|t| t.map(|corner| lit + corner)));
        triangles.extend(self.triangles.iter().map(|t| t.map(|corner| lit + moving + corner)));
        let vertices = lit as usize + moving as usize + self.positions.len();
        points.of_vertex.resize(vertices, NO_POINT);
        (triangles, points)
    }

    /// What of the character's motion these and the ground leave without effect.
    pub(super) fn root_motion(&self, scene: &Scene, around: &SurroundingsRecipe) -> RootMotion {
        let root = rig::root_node(&scene.skeleton, &scene.mesh);
        let below = |mut node: usize| loop {
            match (Some(node) == root, scene.skeleton.nodes[node].parent) {
                (true, _) => return true,
                (_, Some(parent)) => node = parent,
                (_, None) => return false,
            }
        };
        let used =
            self.moving.influences.iter().map(|i| self.moving.deformers[i.deformer as usize]);
        let carried = root.is_none() || used.map(|deformer| deformer.node).all(below);
        match (self.positions.is_empty() && carried, around.ground) {
            (false, _) => RootMotion::Fixed,
            (true, Some(_)) => RootMotion::Upright,
            (true, None) => RootMotion::Rigid,
        }
    }
}

/// Splits a data set's sources into the scene's own, the occluders' and the receivers', with their own
/// names.
pub(super) fn part(sources: Vec<Source>) -> [Vec<Source>; 3] {
    let mut parts = [(); 3].map(|()| Vec::new());
    for Source { name, bytes } in sources {
        let prefixes = [PREFIX, receivers::PREFIX];
        let found = (1..).zip(prefixes).find(|(_, prefix)| name.starts_with(prefix));
        let (part, prefix) = found.unwrap_or((0, ""));
        parts[part].push(Source { name: name[prefix.len()..].to_owned(), bytes });
    }
    parts
}

/// Which nodes are among the named ones or below them.
pub(super) fn carried(skeleton: &Skeleton, names: &[String]) -> Result<Vec<bool>, Error> {
    let mut carried = vec![false; skeleton.nodes.len()];
    for name in names {
        let node = skeleton.find(name).ok_or_else(|| {
            let known: Vec<&str> = skeleton.nodes.iter().map(|node| node.name.as_str()).collect();
            Error::Surroundings(format!("there is no node {name:?}; there are {}", listed(&known)))
        })?;
        carried[node] = true;
    }
    for (index, node) in skeleton.nodes.iter().enumerate() {
        carried[index] |= node.parent.is_some_and(|parent| carried[parent]);
    }
    Ok(carried)
}

/// The first names of a list that may be long.
fn listed(names: &[&str]) -> String {
    const MOST: usize = 30;
    let more = names.len().saturating_sub(MOST);
    let mut text = names[..names.len().min(MOST)].join(", ");
    if more > 0 {
        text += &format!(" and {more} more");
    }
    text
}

/// The resolved surroundings, and what there is to say of them.
pub(super) fn resolve(
    around: &SurroundingsRecipe,
    mesh: &Mesh,
    poses: &PoseSet,
    posed: impl Fn(usize) -> Deformed + Sync,
) -> Result<(bake::Surroundings, Vec<String>), Error> {
    let mut notices = Vec::new();
    let ground_m = match around.ground {
        Some(ground) => Some(ground_m(ground, poses, posed, &mut notices)?),
        None => None,
    };
    let resolved = bake::Surroundings {
        ground_m,
        min_distance_m: around.min_distance_m.unwrap_or(0.0),
        falloff: around.falloff,
        faceted: around.faceted,
        views: views(around, mesh, &poses.points)?,
    };
    Ok((resolved, notices))
}

fn ground_m(
    ground: GroundRecipe,
    poses: &PoseSet,
    posed: impl Fn(usize) -> Deformed + Sync,
    notices: &mut Vec<String>,
) -> Result<f32, Error> {
    let extent = |pose: usize| {
        let heights = posed(pose).positions.into_iter().map(|p| p.y);
        heights.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)))
    };
    // Minima and maxima do not depend on the order.
    let (low, high) = (0..poses.samples.len())
        .into_par_iter()
        .map(extent)
        .reduce(|| (f32::INFINITY, f32::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let height = match ground {
        GroundRecipe::Lowest => low,
        GroundRecipe::HeightM(height) if height >= high => {
            return Err(Error::Surroundings(format!(
                "the ground at {height} m is above the character, which reaches from {low:.3} m to \
                 {high:.3} m over all poses"
            )));
        }
        GroundRecipe::HeightM(height) => height,
    };
    notices.push(format!(
        "level ground at {height} m: tilt and height of the character are parameters"
    ));
    if low < height {
        notices.push(format!(
            "the character reaches {:.3} m below the ground in some pose; what is there is dark",
            height - low
        ));
    }
    Ok(height)
}

/// One view for each mesh that does not see everything, or for each node that shows it where it is itself
/// that it does not see: of two nodes with one mesh, each blocks the other.
fn views(around: &SurroundingsRecipe, mesh: &Mesh, points: &Points) -> Result<Vec<View>, Error> {
    let pairs = || around.ignore.iter().flat_map(|[a, b]| [(a, b), (b, a)]);
    let mut names: Vec<&String> = around.ignore_self.iter().collect();
    names.extend(pairs().map(|(seer, _)| seer));
    for name in &names {
        if !mesh.parts.iter().any(|part| part.name == **name) {
            let known: Vec<&str> = mesh.parts.iter().map(|part| part.name.as_str()).collect();
            return Err(Error::Surroundings(format!(
                "there is no mesh {name:?}; there are {}",
                listed(&known)
            )));
        }
    }
    let mut views = Vec::new();
    names.sort_unstable();
    names.dedup();
    for name in names {
        let unseen: Vec<&String> =
            pairs().filter(|(seer, _)| *seer == name).map(|(_, unseen)| unseen).collect();
        let named = || mesh.parts.iter().filter(|part| part.name == *name);
        let mut nodes: Vec<Option<usize>> = named().map(|part| Some(part.node)).collect();
        nodes.sort_unstable();
        nodes.dedup();
        if !around.ignore_self.contains(name) {
            nodes = vec![None];
        }
        for node in nodes {
            let of_node = |part: &&Part| node.is_none_or(|node| part.node == node);
            let itself = |part: &&Part| node.is_some() && part.name == *name && of_node(part);
            let mut seen_by: Vec<u32> = named()
                .filter(of_node)
                .flat_map(|part| &points.of_vertex[part.vertices.clone()])
                .copied()
                .collect();
            seen_by.sort_unstable();
            seen_by.dedup();
            let hidden =
                mesh.parts.iter().filter(|part| unseen.contains(&&part.name) || itself(part));
            let hidden = hidden.map(|part| part.triangles.clone()).collect();
            views.push(View { points: seen_by, hidden });
        }
    }
    Ok(views)
}

#[cfg(test)]
#[path = "surroundings_tests.rs"]
mod tests;
