//! Settings that would change nothing: each is refused by one sentence, since whoever states one
//! expects something of it.
//!
//! Only new jobs are checked so: what an earlier program stored keeps loading. Fields that always
//! have a value are taken as stated where they differ from their default.

use std::fmt::Display;

use super::RecipeError;
use super::recipe::{
    BakeRecipe, ChooseName, FamilyName, FitRecipe, FrameName, OnName, Recipe, RidgeName,
    SignalName, TargetRecipe,
};

/// Refuses settings without effect in a job that bakes and fits as the recipe says.
///
/// # Errors
/// The first field that changes nothing, with the reason.
pub fn effective(recipe: &Recipe) -> Result<(), RecipeError> {
    bake(&recipe.bake)?;
    let mut fit = recipe.fit.clone();
    // Of a choice among all families it asks those that look at the mesh.
    fit.include_rest &= recipe.target.choose != ChooseName::Any;
    effective_fit(&fit, recipe.target.on)?;
    no_choice(&recipe.target)
}

/// Refuses sizes and options that the family of a fit does not have.
///
/// # Errors
/// The first field that changes nothing, with the reason.
pub fn effective_fit(fit: &FitRecipe, on: OnName) -> Result<(), RecipeError> {
    for Stated { field, found, families, .. } in stated(fit) {
        if !families.contains(&fit.family) {
            let found = format!("{found} with the family {}", fit.family);
            let expected = "that family has no such thing: leave it out, or name another";
            return Err(RecipeError { field, found, expected });
        }
    }
    sizes(fit)?;
    if fit.include_rest && !looks_at_mesh(fit) {
        let (field, found) = ("fit.include_rest", "true".to_owned());
        let expected = "only a model of the family occluder, an unshadowed one, or one in the tangent frame \
             looks at the mesh";
        return Err(RecipeError { field, found, expected });
    }
    regularisation(fit, on)
}

/// Whether evaluating the model takes the posed mesh.
pub(super) fn looks_at_mesh(fit: &FitRecipe) -> bool {
    fit.unshadowed.unwrap_or(fit.family == Occluder) || fit.frame == FrameName::Tangent
}

/// Puts every size and option that the recipe's family does not have back to its default: whoever
/// names another family means that family's own.
pub fn forget_other_sizes(fit: &mut FitRecipe) {
    let family = fit.family;
    let others: Vec<_> = stated(fit).filter(|s| !s.families.contains(&family)).collect();
    for other in others {
        (other.forget)(fit);
    }
}

/// A field that a recipe states, and the families that have it.
struct Stated {
    field: &'static str,
    found: String,
    families: &'static [FamilyName],
    forget: fn(&mut FitRecipe),
}

use FamilyName::{
    ClusteredLinear, ClusteredQuadratic, ClusteredTanh, Linear, Multilinear, Occluder, PcaLinear,
};

const CLUSTERED: [FamilyName; 3] = [ClusteredLinear, ClusteredQuadratic, ClusteredTanh];
const INPUTS: &[FamilyName] =
    &[PcaLinear, Multilinear, Occluder, CLUSTERED[0], CLUSTERED[1], CLUSTERED[2]];
const OUTPUTS: &[FamilyName] = &[PcaLinear, Occluder, CLUSTERED[0], CLUSTERED[1], CLUSTERED[2]];
const SHARES: &[FamilyName] = &[PcaLinear, CLUSTERED[0], CLUSTERED[1], CLUSTERED[2]];
const CLUSTERS: &[FamilyName] = &[Multilinear, CLUSTERED[0], CLUSTERED[1], CLUSTERED[2]];
const REACHES: &[FamilyName] =
    &[Linear, PcaLinear, Multilinear, Occluder, CLUSTERED[0], CLUSTERED[1], CLUSTERED[2]];
const RIDGES: &[FamilyName] =
    &[Linear, PcaLinear, Multilinear, Occluder, CLUSTERED[0], CLUSTERED[1]];

fn stated(fit: &FitRecipe) -> impl Iterator<Item = Stated> {
    let default = FitRecipe::default();
    let one = |field, found: Option<String>, families, forget| {
        found.map(|found| Stated { field, found, families, forget })
    };
    let text = |value: Option<u32>| value.map(|v| v.to_string());
    let share = |value: Option<f64>| value.map(|v| v.to_string());
    let exponent = Some(fit.blend_exponent).filter(|&e| e != default.blend_exponent);
    let published = fit.published.then(|| "true".to_owned());
    let fields = [
        one("fit.inputs", text(fit.inputs), INPUTS, |f| f.inputs = None),
        one("fit.outputs", text(fit.outputs), OUTPUTS, |f| f.outputs = None),
        one("fit.retain_inputs", share(fit.retain_inputs), SHARES, |f| f.retain_inputs = None),
        one("fit.retain_outputs", share(fit.retain_outputs), SHARES, |f| f.retain_outputs = None),
        one("fit.clusters", text(fit.clusters), CLUSTERS, |f| f.clusters = None),
        one("fit.point_clusters", text(fit.point_clusters), &[Multilinear], |f| {
            f.point_clusters = None;
        }),
        one("fit.point_threshold", share(fit.point_threshold), &[Multilinear], |f| {
            f.point_threshold = None;
        }),
        one("fit.published", published, &[Multilinear], |f| f.published = false),
        one("fit.blend_exponent", share(exponent), &[Multilinear], |f| {
            f.blend_exponent = FitRecipe::default().blend_exponent;
        }),
        one("fit.neurons", text(fit.neurons), &[ClusteredTanh], |f| f.neurons = None),
        one("fit.reach", fit.reach.map(|v| v.to_string()), REACHES, |f| f.reach = None),
        one("fit.spheres", text(fit.spheres), &[Occluder], |f| f.spheres = None),
        one("fit.groups", text(fit.groups), &[Occluder], |f| f.groups = None),
        one("fit.directions", text(fit.directions), &[Occluder], |f| f.directions = None),
        one("fit.local", share(fit.local), &[Linear], |f| f.local = None),
        one("fit.alpha", share(fit.alpha), RIDGES, |f| {
            (f.alpha, f.ridge) = (None, FitRecipe::default().ridge);
        }),
    ];
    fields.into_iter().flatten()
}

/// Sizes of a part that is not there.
fn sizes(fit: &FitRecipe) -> Result<(), RecipeError> {
    if fit.family == Occluder && fit.inputs.is_none() {
        absent("fit.outputs", fit.outputs, "without inputs the family occluder has no outputs")?;
    }
    Ok(())
}

fn regularisation(fit: &FitRecipe, on: OnName) -> Result<(), RecipeError> {
    if fit.ridge != RidgeName::Fixed {
        absent("fit.alpha", fit.alpha, "only the ridge `fixed` takes it")?;
    }
    if on == OnName::Trained {
        absent("fit.alpha", fit.alpha, "a model of the trained motion is not regularised")?;
    }
    Ok(())
}

fn bake(bake: &BakeRecipe) -> Result<(), RecipeError> {
    let stated = Some(bake.order).filter(|&order| order != BakeRecipe::default().order);
    match bake.signal {
        SignalName::Ao => {
            absent("bake.order", stated, "the signal ao is one number, which has no order")
        }
        SignalName::Visibility | SignalName::Transfer => Ok(()),
    }
}

/// A whole run makes the one model that its recipe names, unless it leaves it to the target.
fn no_choice(target: &TargetRecipe) -> Result<(), RecipeError> {
    if target.choose != ChooseName::Nothing {
        return Ok(());
    }
    let expected = "a run chooses a model by it only where `target.choose` says so";
    absent("target.max_bytes", target.max_bytes, expected)?;
    absent("target.max_us", target.max_us, expected)?;
    absent("target.max_fit_s", target.max_fit_s, expected)
}

fn absent(
    field: &'static str,
    found: Option<impl Display>,
    expected: &'static str,
) -> Result<(), RecipeError> {
    match found {
        None => Ok(()),
        Some(found) => Err(RecipeError { field, found: found.to_string(), expected }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use FamilyName::Mean;

    /// Each setting that would change nothing is named, and the one beside it that does is not.
    #[test]
    fn what_changes_nothing_is_refused() {
        let fault = |edit: &dyn Fn(&mut Recipe)| {
            let mut recipe = Recipe::default();
            edit(&mut recipe);
            effective(&recipe).err().map(|error| error.field)
        };
        let family = |family, edit: fn(&mut FitRecipe)| {
            fault(&move |r: &mut Recipe| {
                r.fit.family = family;
                edit(&mut r.fit);
            })
        };
        assert_eq!(fault(&|_| ()), None);
        let order =
            |signal, order| fault(&move |r| (r.bake.signal, r.bake.order) = (signal, order));
        assert_eq!(order(SignalName::Ao, 9), Some("bake.order"));
        assert_eq!((order(SignalName::Ao, 6), order(SignalName::Visibility, 9)), (None, None));
        assert_eq!(fault(&|r| r.fit.alpha = Some(1.0)), Some("fit.alpha"));
        let fixed = |f: &mut FitRecipe| (f.ridge, f.alpha) = (RidgeName::Fixed, Some(1.0));
        assert_eq!((family(PcaLinear, fixed), family(Mean, fixed)), (None, Some("fit.alpha")));
        let trained = |r: &mut Recipe| {
            fixed(&mut r.fit);
            r.target.on = OnName::Trained;
        };
        assert_eq!(fault(&trained), Some("fit.alpha"));
        let inputs = |f: &mut FitRecipe| f.inputs = Some(8);
        assert_eq!((family(Mean, inputs), family(Linear, inputs)), {
            (Some("fit.inputs"), Some("fit.inputs"))
        });
        assert_eq!(family(Multilinear, inputs), None);
        assert_eq!(family(Multilinear, |f| f.outputs = Some(4)), Some("fit.outputs"));
        assert_eq!(family(Occluder, |f| f.outputs = Some(4)), Some("fit.outputs"));
        assert_eq!(family(PcaLinear, |f| f.clusters = Some(4)), Some("fit.clusters"));
        assert_eq!(family(ClusteredLinear, |f| f.neurons = Some(4)), Some("fit.neurons"));
        assert_eq!(family(PcaLinear, |f| f.spheres = Some(4)), Some("fit.spheres"));
        assert_eq!(family(PcaLinear, |f| f.groups = Some(4)), Some("fit.groups"));
        assert_eq!(family(PcaLinear, |f| f.published = true), Some("fit.published"));
        assert_eq!(family(Linear, |f| f.blend_exponent = 4.0), Some("fit.blend_exponent"));
        let mixed = |f: &mut FitRecipe| (f.inputs, f.retain_outputs) = (Some(8), Some(0.9));
        assert_eq!((family(PcaLinear, mixed), family(ClusteredLinear, mixed)), { (None, None) });
        let rest = |f: &mut FitRecipe| f.include_rest = true;
        let turned = |f: &mut FitRecipe| (f.include_rest, f.frame) = (true, FrameName::Tangent);
        assert_eq!(family(Linear, turned), None);
        assert_eq!((family(Occluder, rest), family(Linear, rest)), {
            (None, Some("fit.include_rest"))
        });
        let chosen = |choose| {
            fault(&move |r: &mut Recipe| {
                (r.target.choose, r.target.max_bytes) = (choose, Some(1));
                r.fit.include_rest = true;
            })
        };
        assert_eq!((chosen(ChooseName::Any), chosen(ChooseName::Sizes)), {
            (None, Some("fit.include_rest"))
        });
        assert_eq!(fault(&|r| r.target.max_bytes = Some(1)), Some("target.max_bytes"));
    }

    /// Another family forgets what it does not have, and nothing else.
    #[test]
    fn another_family_has_its_own_sizes() {
        let mut fit = FitRecipe { inputs: Some(8), outputs: Some(22), ..FitRecipe::default() };
        fit.family = Multilinear;
        forget_other_sizes(&mut fit);
        assert_eq!((fit.inputs, fit.outputs), (Some(8), None));
        fit.family = Mean;
        (fit.ridge, fit.alpha) = (RidgeName::Fixed, Some(2.0));
        forget_other_sizes(&mut fit);
        assert_eq!(fit, FitRecipe { family: Mean, ..FitRecipe::default() });
    }

    /// The sentence says what to do.
    #[test]
    fn the_sentence_can_be_acted_on() {
        let fit = FitRecipe { alpha: Some(3.0), ..FitRecipe::default() };
        let told = effective_fit(&fit, OnName::Novel).expect_err("no effect").to_string();
        assert_eq!(told, "recipe field `fit.alpha` is 3; only the ridge `fixed` takes it");
        let fit = FitRecipe { family: ClusteredTanh, spheres: Some(8), ..FitRecipe::default() };
        let told = effective_fit(&fit, OnName::Novel).expect_err("no effect").to_string();
        assert_eq!(
            told,
            "recipe field `fit.spheres` is 8 with the family clustered-tanh; that family has no \
             such thing: leave it out, or name another"
        );
    }
}
