//! From what a recipe says of a refinement to checked settings.

use std::time::Instant;

use crate::bake::MOST_RAYS;
use crate::bake::subdivide::{ErrorMeasure, Goal};
use crate::pipeline::checked::require;
use crate::pipeline::{Error, Job, Progress, RecipeError, Stage};
use crate::scene::Limits;

use super::budget::vertices_within;
use crate::pipeline::recipe::subdivide::{
    DEFAULT_CURVATURE, DEFAULT_GROWTH, MOST_GROWTH, MOST_RAYS_TO_REFINE, MeasureName,
    SubdivideRecipe,
};
use crate::pipeline::recipe::{BakeRecipe, Recipe};

/// What to refine, and how far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refinement {
    /// When to stop.
    pub goal: Goal,
    /// What orders the queue.
    pub measure: ErrorMeasure,
    /// Key poses, chosen by coverage of the job's poses.
    pub key_poses: usize,
    /// How far skinning may take a new vertex off its triangle, in sizes of the character.
    pub bound: f32,
    /// Whether edges that cannot meet the bound stay whole.
    pub keep_bound: bool,
    /// Whether new vertices lie on the smooth surface that the normals mean.
    pub smooth: bool,
}

impl Refinement {
    /// The refinement of a mesh of so many triangles and this size.
    ///
    /// # Errors
    /// The first field that cannot run.
    pub fn new(
        recipe: &SubdivideRecipe,
        triangles: usize,
        size_m: f32,
    ) -> Result<Self, RecipeError> {
        check(recipe)?;
        let limits = Limits::default();
        let grown = |times| Some((triangles as u64).saturating_mul(times).min(limits.triangles));
        let foreseen = match (recipe.vertices.or(recipe.bytes), recipe.error) {
            (Some(_), _) => None,
            (None, Some(_)) => grown(MOST_GROWTH),
            (None, None) => grown(DEFAULT_GROWTH),
        };
        let goal = Goal {
            triangles: recipe.triangles.or(foreseen).unwrap_or(limits.triangles) as usize,
            vertices: recipe.vertices.unwrap_or(limits.vertices) as usize,
            error: recipe.error.unwrap_or(0.0),
            depth: recipe.depth,
            area: recipe
                .min_edge
                .map_or(0.0, |edge| 3.0_f32.sqrt() / 4.0 * (edge * size_m).powi(2)),
        };
        let a = recipe.curvature.unwrap_or(DEFAULT_CURVATURE);
        let curvature = |printed, by_area| ErrorMeasure::Curvature { a, printed, by_area };
        let measure = match recipe.measure {
            MeasureName::Surplus => ErrorMeasure::Surplus,
            MeasureName::Midpoint => ErrorMeasure::Midpoint,
            MeasureName::Curvature => curvature(false, false),
            MeasureName::CurvaturePrinted => curvature(true, false),
            MeasureName::CurvatureByArea => curvature(false, true),
            MeasureName::Distance => ErrorMeasure::Distance,
            MeasureName::Contrast => ErrorMeasure::Contrast,
            MeasureName::Uniform => ErrorMeasure::Uniform,
        };
        let key_poses = usize::from(recipe.key_poses);
        let SubdivideRecipe { bound, keep_bound, smooth, .. } = *recipe;
        Ok(Self { goal, measure, key_poses, bound, keep_bound, smooth })
    }

    /// What the recipe of a job asks for.
    ///
    /// # Errors
    /// The first field that cannot run with the job's mesh and model.
    pub fn of(job: &Job, recipe: &SubdivideRecipe) -> Result<Self, Error> {
        let mesh = &job.scene.mesh;
        let mut all = Self::new(recipe, mesh.triangles.len(), job.poses.size_m)?;
        if let Some(bytes) = recipe.bytes {
            let room = vertices_within(job, bytes)?;
            if room < mesh.positions.len() {
                let given = mesh.positions.len();
                let found = format!("{bytes}, room for {room} vertices of the scene's {given}");
                let expected =
                    "a refined mesh has all that it is made from: a smaller model has room";
                return Err(RecipeError { field: "subdivide.bytes", found, expected }.into());
            }
            all.goal.vertices = all.goal.vertices.min(room);
        }
        Ok(all)
    }

    /// Triangles so far, of those that there is room for beside the given ones; where vertices bound
    /// them, nobody knows how many are to come.
    #[must_use]
    pub fn progress(&self, given: usize, triangles: usize, start: Instant) -> Progress {
        let done = triangles.saturating_sub(given) as u64;
        let most = self.goal.triangles;
        let bounded = (most as u64) < Limits::default().triangles;
        let total = if bounded { most.saturating_sub(given) as u64 } else { done };
        let elapsed_s = start.elapsed().as_secs_f64();
        Progress { stage: Stage::Subdivide, done, total, rays: 0, elapsed_s }
    }

    /// Refuses budgets that the mesh exceeds as it is.
    pub(super) fn check_room(&self, triangles: usize, vertices: usize) -> Result<(), RecipeError> {
        for (field, goal, found) in [
            ("subdivide.triangles", self.goal.triangles, triangles),
            ("subdivide.vertices", self.goal.vertices, vertices),
        ] {
            if goal < found {
                let found = format!("{goal}, less than the {found} of the scene as it is");
                let expected = "a refined mesh has what it is made from, and more";
                return Err(RecipeError { field, found, expected });
            }
        }
        Ok(())
    }
}

/// Checks every field.
fn check(recipe: &SubdivideRecipe) -> Result<(), RecipeError> {
    let SubdivideRecipe { depth, key_poses, bound, .. } = *recipe;
    require((1..=12).contains(&depth), "subdivide.depth", depth, "it must be 1 to 12")?;
    let sound = (1..=256).contains(&key_poses);
    require(sound, "subdivide.key_poses", key_poses, "it must be 1 to 256")?;
    let limits = Limits::default();
    for (field, goal, most) in [
        ("subdivide.triangles", recipe.triangles, limits.triangles),
        ("subdivide.vertices", recipe.vertices, limits.vertices),
    ] {
        let expected = "a scene has at most 8000000 triangles of 4000000 vertices";
        require(goal.is_none_or(|goal| goal <= most), field, goal.unwrap_or(0), expected)?;
    }
    let positive = |number: f32| number.is_finite() && number > 0.0;
    let expected = "it must be a positive number of sizes";
    require(positive(bound), "subdivide.bound", bound, expected)?;
    if let Some(error) = recipe.error {
        require(positive(error), "subdivide.error", error, "it must be a positive number")?;
    }
    if let Some(edge) = recipe.min_edge {
        require(positive(edge), "subdivide.min_edge", edge, expected)?;
    }
    if let Some(rays) = recipe.rays {
        let sound = (1..=MOST_RAYS).contains(&rays);
        require(sound, "subdivide.rays", rays, "it must be 1 to 1000000")?;
    }
    if let Some(a) = recipe.curvature {
        let field = "subdivide.curvature";
        use MeasureName::{Curvature, CurvatureByArea, CurvaturePrinted};
        let has = matches!(recipe.measure, Curvature | CurvaturePrinted | CurvatureByArea);
        let expected = "it means nothing with this measure: use `curvature`, or leave it out";
        require(has, field, a, expected)?;
        require(a.is_finite() && a >= 0.0, field, a, "it must be zero or a positive number")?;
    }
    Ok(())
}

/// Checks a recipe's refinement beside what it bakes.
pub(in crate::pipeline) fn checked(recipe: &Recipe) -> Result<(), RecipeError> {
    let Some(subdivide) = &recipe.subdivide else { return Ok(()) };
    check(subdivide)?;
    let receivers = recipe.bake.surroundings.receivers.as_ref();
    let expected = "receivers are not refined: refine their file on its own, or leave them out";
    require(receivers.is_none(), "bake.surroundings.receivers", "given", expected)
}

/// The recipe that a refinement bakes by: direct light alone, equal rays everywhere.
pub(super) fn direct(recipe: &Recipe) -> Recipe {
    let subdivide = recipe.subdivide.as_ref();
    let rays = subdivide.and_then(|subdivide| subdivide.rays);
    let mut direct = Recipe { subdivide: None, ..recipe.clone() };
    direct.bake = BakeRecipe {
        rays: rays.unwrap_or(recipe.bake.rays.min(MOST_RAYS_TO_REFINE)),
        bounces: 0,
        albedo: None,
        noise: None,
        noise_goal: None,
        more_rays: Vec::new(),
        more_noise: Vec::new(),
        vertex_fit: None,
        subsurface: None,
        ..direct.bake
    };
    direct.bake.surroundings.faceted = false;
    direct
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every bound refuses what lies just outside it by the field's name; the defaults run, and grow
    /// a mesh to four times its triangles where no other goal is stated.
    #[test]
    fn each_bound_names_its_field() {
        let fault = |edit: fn(&mut SubdivideRecipe)| {
            let mut recipe = SubdivideRecipe::default();
            edit(&mut recipe);
            Refinement::new(&recipe, 100, 1.0).expect_err("must be refused").field
        };
        assert_eq!(fault(|r| r.depth = 0), "subdivide.depth");
        assert_eq!(fault(|r| r.depth = 13), "subdivide.depth");
        assert_eq!(fault(|r| r.key_poses = 0), "subdivide.key_poses");
        assert_eq!(fault(|r| r.bound = 0.0), "subdivide.bound");
        assert_eq!(fault(|r| r.error = Some(f32::NAN)), "subdivide.error");
        assert_eq!(fault(|r| r.min_edge = Some(-1.0)), "subdivide.min_edge");
        assert_eq!(fault(|r| r.rays = Some(0)), "subdivide.rays");
        assert_eq!(fault(|r| r.curvature = Some(1.0)), "subdivide.curvature");
        let negative = |r: &mut SubdivideRecipe| {
            (r.measure, r.curvature) = (MeasureName::Curvature, Some(-1.0));
        };
        assert_eq!(fault(negative), "subdivide.curvature");
        let goal = |recipe| Refinement::new(&recipe, 100, 1.0).expect("sound").goal;
        assert_eq!(goal(SubdivideRecipe::default()).triangles, 400);
        let until = SubdivideRecipe { error: Some(0.1), ..SubdivideRecipe::default() };
        assert_eq!(goal(until).triangles, 1600);
        let most = SubdivideRecipe { vertices: Some(200), ..SubdivideRecipe::default() };
        assert_eq!(goal(most).vertices, 200);
        assert_eq!(fault(|r| r.triangles = Some(8_000_001)), "subdivide.triangles");
        assert_eq!(fault(|r| r.vertices = Some(1 << 40)), "subdivide.vertices");
    }

    /// Budgets below what there is are refused with both numbers.
    #[test]
    fn a_budget_below_the_input_is_refused() {
        let recipe = SubdivideRecipe { vertices: Some(10), ..SubdivideRecipe::default() };
        let refinement = Refinement::new(&recipe, 100, 1.0).expect("sound");
        let told = refinement.check_room(100, 11).expect_err("too few").to_string();
        assert!(told.contains("`subdivide.vertices` is 10, less than the 11"), "{told}");
        refinement.check_room(100, 10).expect("as many");
    }
}
