//! Which signal, how finely, and in what surroundings: the checks of a recipe's `bake`.

use super::{RecipeError, error, require};
use crate::bake;
use crate::pipeline::recipe::subsurface::DEFAULT_REFRACTIVE_INDEX;
use crate::pipeline::recipe::surroundings::GroundRecipe;
use crate::pipeline::recipe::{BakeRecipe, FamilyName, NoiseGoalName, Recipe, SignalName};
use crate::pipeline::rounds::Noises;
use crate::sh::Order;

pub(super) fn checked_bake(recipe: &BakeRecipe) -> Result<bake::Settings, RecipeError> {
    let order = Order::new(recipe.order)
        .map_err(|_| error("bake.order", recipe.order, "spherical harmonics have order 1 to 10"))?;
    let rays = recipe.rays;
    require((1..=bake::MOST_RAYS).contains(&rays), "bake.rays", rays, "it must be 1 to 1000000")?;
    if let Some(distance) = recipe.max_distance_m {
        let sound = distance.is_finite() && distance > 0.0;
        require(sound, "bake.max_distance_m", distance, "it must be a positive number of metres")?;
    }
    checked_surroundings(recipe)?;
    checked_bounces(recipe)?;
    checked_fitting(recipe)?;
    for &more in &recipe.more_rays {
        let sound = (1..=bake::MOST_RAYS).contains(&more);
        require(sound, "bake.more_rays", more, "each round must have 1 to 1000000 rays")?;
    }
    let rounds = recipe.more_rays.len();
    require(rounds <= 64, "bake.more_rays", rounds, "there are at most 64 rounds")?;
    let signal = match recipe.signal {
        SignalName::Ao => bake::Signal::Ao,
        SignalName::Visibility => bake::Signal::Visibility,
        SignalName::Transfer => bake::Signal::Transfer,
    };
    Ok(bake::Settings {
        signal,
        order,
        rays,
        max_distance_m: recipe.max_distance_m,
        seed: recipe.seed,
    })
}

pub(super) fn checked_noises(recipe: &BakeRecipe) -> Result<Noises, RecipeError> {
    let goal = match recipe.noise_goal {
        None | Some(NoiseGoalName::Each) => bake::NoiseGoal::Each,
        Some(NoiseGoalName::Mean) => bake::NoiseGoal::Mean,
    };
    let to_noise = recipe.noise.is_some() || !recipe.more_noise.is_empty();
    if recipe.noise_goal.is_some() && !to_noise {
        return Err(error("bake.noise_goal", "given", "it means nothing without a noise"));
    }
    if let Some(noise) = recipe.noise {
        let sound = noise.is_finite() && noise > 0.0;
        require(sound, "bake.noise", noise, "it must be a positive standard error")?;
    }
    let (mut before, field) = (recipe.noise.unwrap_or(f32::INFINITY), "bake.more_noise");
    for &noise in &recipe.more_noise {
        let sound = noise > 0.0 && noise < before;
        let expected = "each must be a positive standard error below the one before it";
        require(sound, field, noise, expected)?;
        before = noise;
    }
    let rounds = recipe.more_noise.len();
    require(rounds <= 16, field, rounds, "there are at most 16 rounds")?;
    if let Some(most) = recipe.most_rays {
        let field = "bake.most_rays";
        require((1..=bake::MOST_RAYS).contains(&most), field, most, "it must be 1 to 1000000")?;
        require(rounds > 0, field, most, "it means nothing without further rounds to a noise")?;
    }
    Ok(Noises { first: recipe.noise, more: recipe.more_noise.clone(), goal })
}

fn checked_fitting(recipe: &BakeRecipe) -> Result<(), RecipeError> {
    let faceted = recipe.surroundings.faceted;
    let expected = "it means nothing without a vertex fit: at vertices facets and surface are one";
    let field = "bake.surroundings.faceted";
    require(!faceted || recipe.vertex_fit.is_some(), field, faceted, expected)?;
    let Some(samples) = recipe.vertex_fit else { return Ok(()) };
    let (field, sound) = ("bake.vertex_fit", (1..=bake::MOST_SITES).contains(&samples));
    require(sound, field, samples, "it must be 1 to 1024 samples per vertex")?;
    let to_noise = recipe.noise.is_some() || !recipe.more_noise.is_empty();
    let alone = recipe.bounces == 0 && !to_noise;
    require(alone, field, samples, "it takes neither bounces nor a target noise")
}

/// What looks at the posed mesh would take receivers for a part of the character.
pub(super) fn checked_receivers(recipe: &Recipe) -> Result<(), RecipeError> {
    let looks = recipe.fit.family == FamilyName::Occluder || recipe.fit.unshadowed == Some(true);
    let sound = !looks || recipe.bake.surroundings.receivers.is_none();
    let expected = "models that look at the posed mesh, `occluder` and `unshadowed`, take none";
    require(sound, "bake.surroundings.receivers", "given", expected)
}

pub(super) fn checked_subsurface(
    recipe: &BakeRecipe,
) -> Result<Option<bake::Subsurface>, RecipeError> {
    let Some(below) = &recipe.subsurface else { return Ok(None) };
    let field = "bake.subsurface";
    let signal = recipe.signal;
    let expected = "only the signal transfer has light to diffuse";
    require(signal == SignalName::Transfer, field, format!("of {signal:?}"), expected)?;
    let own = [below.absorption_per_m.is_some(), below.refractive_index.is_some()];
    let (name, path) = match (&below.material, below.mean_free_path_m) {
        (Some(name), None) if own == [false; 2] => (name, None),
        (None, Some(path)) => (&String::new(), Some(path)),
        _ => {
            let expected = "it must have either a material, or mean free paths";
            return Err(error(field, "neither or both", expected));
        }
    };
    let Some(mean_free_path_m) = path else {
        let known = bake::Subsurface::named(name);
        let expected = "there are skin, pale-skin, marble, milk, potato and apple";
        let field = "bake.subsurface.material";
        return known.map(Some).ok_or_else(|| error(field, name, expected));
    };
    let absorption_per_m = below.absorption_per_m.unwrap_or_default();
    for (path, absorption) in mean_free_path_m.into_iter().zip(absorption_per_m) {
        let expected = "it must be a positive number of metres";
        let field = "bake.subsurface.mean_free_path_m";
        require(path.is_finite() && path > 0.0, field, path, expected)?;
        let expected = "it must be from 0 to below the inverse of the mean free path";
        let sound = absorption >= 0.0 && absorption * path < 1.0;
        require(sound, "bake.subsurface.absorption_per_m", absorption, expected)?;
    }
    let refractive_index = below.refractive_index.unwrap_or(DEFAULT_REFRACTIVE_INDEX);
    let sound = (1.0..=3.0).contains(&refractive_index);
    require(sound, "bake.subsurface.refractive_index", refractive_index, "it must be 1 to 3")?;
    Ok(Some(bake::Subsurface { mean_free_path_m, absorption_per_m, refractive_index }))
}

fn checked_bounces(recipe: &BakeRecipe) -> Result<(), RecipeError> {
    let (bounces, field) = (recipe.bounces, "bake.bounces");
    require(bounces <= bake::MOST_BOUNCES, field, bounces, "it must be 0 to 8")?;
    let carries = bounces == 0 || recipe.signal == SignalName::Transfer;
    require(carries, field, bounces, "only the signal transfer has bounces")?;
    if let Some(albedo) = recipe.albedo {
        let field = "bake.albedo";
        require((0.0..=1.0).contains(&albedo), field, albedo, "it must be 0 to 1")?;
        require(bounces > 0, field, albedo, "it means nothing without bounces")?;
    }
    Ok(())
}

fn checked_surroundings(recipe: &BakeRecipe) -> Result<(), RecipeError> {
    let around = &recipe.surroundings;
    if let Some(GroundRecipe::HeightM(height)) = around.ground {
        let field = "bake.surroundings.ground";
        require(height.is_finite(), field, height, "it must be `lowest` or a height in metres")?;
    }
    if let Some(near) = around.min_distance_m {
        let far = recipe.max_distance_m.unwrap_or(f32::INFINITY);
        let expected = "it must be 0 or more, finite, and below the maximum distance";
        let field = "bake.surroundings.min_distance_m";
        require(near.is_finite() && near >= 0.0 && near < far, field, near, expected)?;
    }
    if let Some(falloff) = around.falloff {
        let field = "bake.surroundings.falloff";
        let sound = falloff.is_finite() && falloff > 0.0;
        require(sound, field, falloff, "it must be a positive exponent, such as 1 or 2")?;
        let whole = recipe.signal == SignalName::Ao && recipe.max_distance_m.is_some();
        require(whole, field, falloff, "it needs the signal ao and a maximum distance")?;
    }
    Ok(())
}
