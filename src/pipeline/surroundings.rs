//! From what a recipe says of surroundings to what the baker needs: meshes that only block, the
//! ground's height, and which meshes see which.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use rayon::prelude::*;

use super::recipe::subsurface::SubsurfaceRecipe;
use super::recipe::surroundings::{GroundRecipe, SurroundingsRecipe};
use super::recipe::{BakeRecipe, Recipe};
use super::{Error, hash, receivers};
use crate::bake::{self, NO_POINT, View};
use crate::pose::{PoseSet, RootMotion};
use crate::rig::{self, Deformed, Mesh, Part, Points, Pose, RigidFrame, Skeleton};
use crate::scene::{Scene, Source, Surface};

/// Before the names of an occluder scene's files among a data set's sources. A scheme, so no file
/// of the scene itself can have such a name.
const PREFIX: &str = "occluders:";

/// Meshes that block and get no values.
#[derive(Debug, Clone, Default)]
pub struct Occluders {
    /// Moved by the scene's skeleton.
    moving: Mesh,
    /// In the scene.
    place: Deformed,
    triangles: Vec<[u32; 3]>,
    /// What the moving and the still part let through, where that is known.
    surfaces: [Option<Surface>; 2],
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
            let of = |moves: bool| {
                let carried = &carried;
                let parts = scene.mesh.parts.iter().filter(move |part| carried[part.node] == moves);
                parts.flat_map(|part| part.triangles.clone())
            };
            taken.surfaces[0] = scene.surface.as_ref().map(|surface| surface.select(of(true)));
            scene.surface = scene.surface.as_ref().map(|surface| surface.select(of(false)));
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
                let told = still.notices.iter().map(|notice| format!("occluders: {notice}"));
                scene.notices.extend(told);
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
        self.place = posed;
        self.triangles = still.mesh.triangles;
        self.surfaces[1] = still.surface;
        let name = |source: Source| Source { name: format!("{PREFIX}{}", source.name), ..source };
        self.sources = still.sources.into_iter().map(name).collect();
    }

    fn is_empty(&self) -> bool {
        self.place.positions.is_empty() && self.moving.positions.is_empty()
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
            out.normals.append(&mut moved.normals);
        }
        let to_root = root.inverse();
        let Deformed { positions, normals } = &self.place;
        out.positions.extend(positions.iter().map(|&p| to_root.transform_point3(p)));
        out.normals.extend(normals.iter().map(|&normal| to_root.transform_vector3(normal)));
    }

    /// The scene's triangles and points with the occluders'.
    pub(super) fn with(&self, mesh: &Mesh, points: &Points) -> (Vec<[u32; 3]>, Points) {
        let (mut triangles, mut points) = (mesh.triangles.clone(), points.clone());
        let (lit, moving) = (mesh.positions.len() as u32, self.moving.positions.len() as u32);
        triangles.extend(self.moving.triangles.iter().map(|t| t.map(|corner| lit + corner)));
        triangles.extend(self.triangles.iter().map(|t| t.map(|corner| lit + moving + corner)));
        let vertices = lit as usize + moving as usize + self.place.positions.len();
        points.of_vertex.resize(vertices, NO_POINT);
        (triangles, points)
    }

    /// What the triangles of [`Self::with`] let through: those of the scene's own, of its receivers, which come
    /// before `end`, and these.
    pub(super) fn surface_after(
        &self,
        own: Arc<Surface>,
        (receivers, end): (Option<&Surface>, usize),
    ) -> Arc<Surface> {
        let (lit, [moving, still]) = (own.material.len(), &self.surfaces);
        if end == lit && self.is_empty() {
            return own;
        }
        Arc::new(Surface::join(&[
            (Some(&own), lit),
            (receivers, end - lit),
            (moving.as_ref(), self.moving.triangles.len()),
            (still.as_ref(), self.triangles.len()),
        ]))
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
        match (self.place.positions.is_empty() && carried, around.ground) {
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

/// For each part of the mesh, of which those from `receivers` on receive, a number of how it is treated:
/// points of differently treated parts differ, wherever they lie.
pub(super) fn kinds(bake: &BakeRecipe, mesh: &Mesh, receivers: usize) -> Vec<u32> {
    let around = &bake.surroundings;
    let below = bake.subsurface.iter().flat_map(|below| &below.meshes);
    let named: HashSet<&String> =
        around.ignore.iter().flatten().chain(&around.ignore_self).chain(below).collect();
    let kind = |(index, part): (usize, &Part)| {
        let node = around.ignore_self.contains(&part.name).then_some(part.node);
        let name = named.contains(&part.name).then(|| part.name.clone());
        (index >= receivers, name, node)
    };
    let mut seen = HashMap::new();
    let mut number = |kind| {
        let next = seen.len() as u32;
        *seen.entry(kind).or_insert(next)
    };
    mesh.parts.iter().enumerate().map(|part| number(kind(part))).collect()
}

/// The points of what light travels in below the surface: of the named meshes, or of all but receivers.
pub(super) fn skin(
    below: &SubsurfaceRecipe,
    mesh: &Mesh,
    receivers: usize,
    points: &Points,
) -> Result<Vec<u32>, Error> {
    let own = &mesh.parts[..receivers];
    known_meshes(below.meshes.iter(), own)?;
    let of_it = own.iter().filter(|p| below.meshes.is_empty() || below.meshes.contains(&p.name));
    let skin: HashSet<u32> =
        of_it.flat_map(|part| &points.of_vertex[part.vertices.clone()]).copied().collect();
    Ok(skin.into_iter().collect())
}

/// Whether there are meshes of these names.
pub(super) fn known_meshes<'a>(
    mut names: impl Iterator<Item = &'a String>,
    parts: &[Part],
) -> Result<(), Error> {
    let unknown = names.find(|name| !parts.iter().any(|part| part.name == **name));
    unknown.map_or(Ok(()), |name| {
        let known: Vec<&str> = parts.iter().map(|part| part.name.as_str()).collect();
        let known = listed(&known);
        Err(Error::Surroundings(format!("there is no mesh {name:?}; there are {known}")))
    })
}

/// One view for each mesh that does not see everything, or for each node that shows it where it is itself
/// that it does not see: of two nodes with one mesh, each blocks the other.
fn views(around: &SurroundingsRecipe, mesh: &Mesh, points: &Points) -> Result<Vec<View>, Error> {
    let pairs = || around.ignore.iter().flat_map(|[a, b]| [(a, b), (b, a)]);
    let mut names: Vec<&String> = around.ignore_self.iter().collect();
    names.extend(pairs().map(|(seer, _)| seer));
    known_meshes(names.iter().copied(), &mesh.parts)?;
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
