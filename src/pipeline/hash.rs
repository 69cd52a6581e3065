//! Stage hashes: equal hash, equal bytes.
//!
//! Each stage is named by a SHA-256 over exactly what affects its bytes: *bake* over the scene's
//! files and the recipe's `subdivide`, `poses` and `bake`; *fit* over the bake's hash, `fit`, `target` and
//! `output`. Threads, block sizes and paths are in none.

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::recipe::subdivide::SubdivideRecipe;
use super::recipe::{BakeRecipe, Recipe};
use crate::rig::Part;
use crate::scene::{Scene, Source};

/// Changes whenever the same recipe begins to give other bytes, so that old results are not
/// mistaken for new ones.
const ALGORITHM: u32 = 2;

/// The same of fits: since models say which vertices and triangles they are of.
const FITTED: u32 = 1;

/// The same of refinements: since neighbours differ by one split at most, fillers stay whole, and both sides
/// of a seam get the same weights.
fn refining(bake: &BakeRecipe) -> u32 {
    ALGORITHM + 2 + u32::from(is_surrounded(bake))
}

/// The same, for recipes that alone have begun to give other bytes: rounds to a noise on top of stated
/// rays, and then what [`is_surrounded`].
fn algorithm(bake: &BakeRecipe) -> u32 {
    let stated = bake.noise.is_none() || !bake.more_rays.is_empty();
    let on_stated = stated && !bake.more_noise.is_empty();
    ALGORITHM + if is_surrounded(bake) { 2 } else { u32::from(on_stated) }
}

/// Whether something blocks beside the points, which rays' origins no longer go by; whether meshes ignore
/// themselves or one another, which share no points; whether there are receivers, which are no skin and block by
/// their materials.
fn is_surrounded(bake: &BakeRecipe) -> bool {
    let around = &bake.surroundings;
    let ignored = !around.ignore_self.is_empty() || !around.ignore.is_empty();
    let blocked = around.occluders.is_some() || !around.occluder_nodes.is_empty();
    ignored || blocked || around.receivers.is_some()
}

/// The hashes of a resolved recipe, lower-case hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hashes {
    /// Over the scene's files.
    pub scene: String,
    /// Over everything that affects the data set's bytes.
    pub bake: String,
    /// Over everything that affects the model's bytes.
    pub fit: String,
}

impl Hashes {
    /// The hashes of a recipe over a scene. A refined scene's bake is named by what it was refined from,
    /// so that its name is known before.
    #[must_use]
    pub fn of(scene: &str, recipe: &Recipe) -> Self {
        let number = algorithm(&recipe.bake);
        let bake = match &recipe.subdivide {
            None => stage("bake", &(number, scene, &recipe.poses, &recipe.bake)),
            Some(subdivide) => {
                let sized = sized(recipe, subdivide);
                let (scene, subdivide) = given(scene, subdivide);
                stage("bake", &(number, scene, &recipe.poses, &recipe.bake, subdivide, sized))
            }
        };
        let fit = stage("fit", &(FITTED, &bake, &recipe.fit, &recipe.target, &recipe.output));
        Self { scene: scene.to_owned(), bake, fit }
    }
}

/// What the bytes of a model follow from, where they say how far a mesh is refined.
fn sized<'a>(recipe: &'a Recipe, subdivide: &SubdivideRecipe) -> Option<impl Serialize + 'a> {
    subdivide.bytes.map(|_| (&recipe.fit, &recipe.target, &recipe.output))
}

/// The scene before it was refined, and how that is asked for.
fn given(scene: &str, subdivide: &SubdivideRecipe) -> (String, SubdivideRecipe) {
    let of = subdivide.of.clone().unwrap_or_else(|| scene.to_owned());
    (of, SubdivideRecipe { of: None, ..subdivide.clone() })
}

/// The hash of a refinement; `direct` is what it bakes by.
#[must_use]
pub(super) fn subdivision(
    scene: &str,
    direct: &Recipe,
    subdivide: Option<&SubdivideRecipe>,
) -> String {
    let sized = subdivide.and_then(|subdivide| sized(direct, subdivide));
    let subdivide = subdivide.map(|subdivide| given(scene, subdivide));
    let number = refining(&direct.bake);
    stage("subdivide", &(number, scene, &direct.poses, &direct.bake, subdivide, sized))
}

/// The hash of a scene's files: names and bytes, in order, each with its length before it.
#[must_use]
pub(super) fn scene(sources: &[Source]) -> String {
    let mut hasher = Sha256::new();
    for source in sources {
        for bytes in [source.name.as_bytes(), &source.bytes] {
            hasher.update((bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        }
    }
    hexadecimal(&hasher.finalize())
}

/// The hash of what ties a model to a mesh, which other files may hold as well: how many vertices some
/// parts of a scene have, where they are, each in its own mesh's space, and how triangles join them. A
/// sequence's first frame is one pose of many, so places are left out there.
#[must_use]
pub(super) fn shape<'a>(
    scene: &Scene,
    parts: impl IntoIterator<Item = &'a Part> + Clone,
) -> String {
    let mut hasher = Sha256::new();
    let vertices: usize = parts.clone().into_iter().map(|part| part.vertices.len()).sum();
    hasher.update((vertices as u64).to_le_bytes());
    if !scene.is_sequence {
        for part in parts.clone() {
            let places = scene.mesh.positions[part.vertices.clone()].iter();
            // Adding 0 makes −0 the 0 that it is equal to.
            let numbers = places.flat_map(|place| place.to_array()).map(|number| number + 0.0);
            hasher.update(numbers.flat_map(f32::to_le_bytes).collect::<Vec<u8>>());
        }
    }
    let mut first = 0;
    for part in parts {
        let moved = |corner: &u32| first + corner - part.vertices.start as u32;
        let corners = scene.mesh.triangles[part.triangles.clone()].as_flattened().iter().map(moved);
        hasher.update(corners.flat_map(u32::to_le_bytes).collect::<Vec<u8>>());
        first += part.vertices.len() as u32;
    }
    hexadecimal(&hasher.finalize())
}

/// Whether two scenes are of the same files, whatever those are called. Pictures come last among the
/// files, and a scene may have been read without them.
#[must_use]
pub(super) fn same_contents(one: &[Source], other: &[Source]) -> bool {
    let pairs = one.iter().zip(other);
    !one.is_empty() && !other.is_empty() && pairs.into_iter().all(|(a, b)| a.bytes == b.bytes)
}

/// The hash of a data set's references.
#[must_use]
pub(super) fn reference(bake: &str, rays: u32, seeds: [u64; 2], poses: &[usize]) -> String {
    stage("reference", &(ALGORITHM, bake, rays, seeds, poses))
}

/// JSON of the parts in declaration order is canonical: no map in it has an order of its own.
/// Parts that are no JSON are a bug: hashed as nothing, different recipes would be taken as one.
fn stage(name: &str, parts: &impl Serialize) -> String {
    let json = serde_json::to_vec(parts)
        .unwrap_or_else(|error| panic!("the parts of stage {name} are no JSON: {error}"));
    let mut hasher = Sha256::new();
    hasher.update(name.as_bytes());
    hasher.update([0]);
    hasher.update(json);
    hexadecimal(&hasher.finalize())
}

/// The SHA-256 of a file's bytes, lower-case hexadecimal.
pub(super) fn sha256(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(name: &str, bytes: &[u8]) -> Source {
        Source { name: name.into(), bytes: bytes.to_vec() }
    }

    /// A stage's hash moves with what affects it and with nothing else.
    #[test]
    fn each_stage_depends_on_its_own_parts_only() {
        let base = Recipe::default();
        let before = Hashes::of("s", &base);

        let mut other_fit = base.clone();
        other_fit.fit.outputs = Some(5);
        let after = Hashes::of("s", &other_fit);
        assert_eq!(before.bake, after.bake);
        assert_ne!(before.fit, after.fit);

        let mut other_bake = base.clone();
        other_bake.bake.rays += 1;
        let after = Hashes::of("s", &other_bake);
        assert_ne!(before.bake, after.bake);
        assert_ne!(before.fit, after.fit);

        let mut other_path = base;
        other_path.scene.file = "elsewhere.glb".into();
        assert_eq!(before, Hashes::of("s", &other_path));
    }

    /// What alone began to give other bytes has another number; everything else keeps its name.
    #[test]
    fn numbers_are_of_what_changed() {
        let of = |edit: fn(&mut BakeRecipe)| {
            let mut bake = BakeRecipe::default();
            edit(&mut bake);
            algorithm(&bake)
        };
        assert_eq!(of(|_| ()), 2);
        assert_eq!(of(|bake| bake.surroundings.transparency = true), 2);
        assert_eq!(of(|bake| bake.more_noise = vec![0.1]), 3);
        let edits: [fn(&mut BakeRecipe); 5] = [
            |bake| bake.surroundings.occluders = Some(Default::default()),
            |bake| bake.surroundings.occluder_nodes = vec!["sword".into()],
            |bake| bake.surroundings.ignore = vec![["shirt".into(), "skin".into()]],
            |bake| bake.surroundings.ignore_self = vec!["hair".into()],
            |bake| bake.surroundings.receivers = Some(Default::default()),
        ];
        assert!(edits.into_iter().all(|edit| of(edit) == 4));
    }

    /// A refined scene's bake has the name that it had before the scene was refined; other settings of
    /// the refinement, and none, make other names.
    #[test]
    fn a_refined_scene_is_named_by_what_it_was_made_from() {
        let with = |subdivide| Recipe { subdivide, ..Recipe::default() };
        let asked = SubdivideRecipe::default();
        let before = Hashes::of("s", &with(Some(asked.clone())));
        let done = SubdivideRecipe { of: Some("s".into()), ..asked.clone() };
        let after = Hashes::of("refined", &with(Some(done)));
        assert_eq!((&before.bake, &before.fit), (&after.bake, &after.fit));
        assert_ne!(before.bake, Hashes::of("s", &with(None)).bake);
        let other = SubdivideRecipe { depth: 3, ..asked };
        assert_ne!(before.bake, Hashes::of("s", &with(Some(other))).bake);
    }

    /// What cannot be written down is not hashed as if it were nothing. JSON's keys are strings.
    #[test]
    #[should_panic(expected = "the parts of stage fit are no JSON")]
    fn parts_that_are_no_json_have_no_hash() {
        stage("fit", &std::collections::BTreeMap::from([((1, 2), 3)]));
    }

    /// Names say nothing of what is in a file; pictures that one side was read without say nothing either.
    #[test]
    fn contents_are_compared_without_names() {
        let scene = [source("a.gltf", b"a"), source("b.bin", b"b"), source("c.png", b"c")];
        let renamed = [source("x.gltf", b"a"), source("y.bin", b"b")];
        assert!(same_contents(&scene, &renamed) && same_contents(&renamed, &scene));
        assert!(!same_contents(&scene, &[source("a.gltf", b"b")]));
        assert!(!same_contents(&scene, &[source("a.gltf", b"a"), source("b.bin", b"c")]));
        assert!(!same_contents(&scene, &[]));
    }

    /// Bytes cannot move between a name and a body, or between files, without a new hash.
    #[test]
    fn a_scene_hash_sees_boundaries() {
        let joined = scene(&[source("a", b"bc")]);
        assert_ne!(joined, scene(&[source("ab", b"c")]));
        assert_ne!(joined, scene(&[source("a", b"b"), source("", b"c")]));
    }
}
