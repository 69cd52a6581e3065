//! Settings that would change nothing: each is refused by one sentence, since whoever states one
//! expects something of it.
//!
//! Only new jobs are checked so: what an earlier program stored keeps loading. Fields that always
//! have a value are taken as stated where they differ from their default.

use std::fmt::Display;

use serde::Serialize;

use super::RecipeError;
use super::recipe::{
    BakeRecipe, ChooseName, FamilyName, FitRecipe, FrameName, OnName, ParametrisationName,
    PoseChoiceName, PosesRecipe, Recipe, RidgeName, SignalName, TargetRecipe,
};

/// Refuses settings without effect in a job that bakes and fits as the recipe says.
///
/// # Errors
/// The first field that changes nothing, with the reason.
pub fn effective(recipe: &Recipe) -> Result<(), RecipeError> {
    poses(&recipe.poses)?;
    bake(&recipe.bake)?;
    let mut asked = recipe.clone();
    // Of a choice among all families it asks those that look at the mesh.
    asked.fit.include_rest &= recipe.target.choose != ChooseName::Any;
    effective_fit(&asked)?;
    no_choice(&recipe.target)
}

/// Refuses sizes and options that the family or the signal of a recipe's fit does not have.
///
/// # Errors
/// The first field that changes nothing, with the reason.
pub fn effective_fit(recipe: &Recipe) -> Result<(), RecipeError> {
    let fit = &recipe.fit;
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
    if recipe.bake.signal == SignalName::Ao {
        // The root's is what models of it say of themselves.
        let stated = (fit.frame == FrameName::Tangent).then_some("tangent");
        absent("fit.frame", stated, "the signal ao is one number, which no frame turns")?;
    }
    regularisation(fit, recipe.target.on)
}

/// Refuses parameters that a sequence of meshes does not have, where somebody states them.
///
/// # Errors
/// `poses.parametrisation`.
pub fn effective_parametrisation(
    stated: Option<ParametrisationName>,
    is_sequence: bool,
) -> Result<(), RecipeError> {
    let stated = stated.filter(|&name| is_sequence && name != ParametrisationName::Dihedral);
    let expected =
        "a sequence of meshes has no joints, so that its folds are its parameters: leave it out";
    absent("poses.parametrisation", stated.map(name), expected)
}

/// A value as the recipe writes it.
fn name(value: impl Serialize) -> String {
    serde_json::to_string(&value).unwrap_or_default().trim_matches('"').to_owned()
}

/// Whether evaluating the model takes the posed mesh.
pub(super) fn looks_at_mesh(fit: &FitRecipe) -> bool {
    fit.unshadowed.unwrap_or(fit.family == Occluder) || fit.frame == FrameName::Tangent
}

/// Puts every size and option that the recipe's family does not have back to its default: whoever
/// names another family means that family's own. The mesh at rest goes with none that does not look at it.
pub fn forget_other_sizes(fit: &mut FitRecipe) {
    let family = fit.family;
    let others: Vec<_> = stated(fit).filter(|s| !s.families.contains(&family)).collect();
    for other in others {
        (other.forget)(fit);
    }
    fit.include_rest &= looks_at_mesh(fit);
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
    let ridge = Some(fit.ridge).filter(|&ridge| ridge != default.ridge).map(name);
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
        one("fit.ridge", ridge, RIDGES, |f| f.ridge = FitRecipe::default().ridge),
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
        let expected = "a model of the trained motion is not regularised";
        absent("fit.alpha", fit.alpha, expected)?;
        let stated = Some(fit.ridge).filter(|&ridge| ridge != FitRecipe::default().ridge);
        absent("fit.ridge", stated.map(name), expected)?;
    }
    Ok(())
}

fn poses(poses: &PosesRecipe) -> Result<(), RecipeError> {
    let stated = Some(poses.choice).filter(|&choice| choice != PoseChoiceName::Distance);
    let stated = stated.filter(|_| poses.most.is_none()).map(name);
    absent("poses.choice", stated, "only `poses.most` chooses among poses by it")
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

    fn fault(edit: &dyn Fn(&mut Recipe)) -> Option<&'static str> {
        let mut recipe = Recipe::default();
        edit(&mut recipe);
        effective(&recipe).err().map(|error| error.field)
    }

    fn family(family: FamilyName, edit: fn(&mut FitRecipe)) -> Option<&'static str> {
        fault(&move |r: &mut Recipe| {
            r.fit.family = family;
            edit(&mut r.fit);
        })
    }

    /// Each setting that would change nothing is named, and the one beside it that does is not.
    #[test]
    fn what_changes_nothing_is_refused() {
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

    /// So is a ridge of what has none, a frame of one number, and a way to choose poses that chooses none.
    #[test]
    fn ways_without_effect_are_refused() {
        let left_out = |f: &mut FitRecipe| f.ridge = RidgeName::LeaveOneOut;
        assert_eq!((family(Linear, left_out), family(ClusteredTanh, left_out)), {
            (None, Some("fit.ridge"))
        });
        assert_eq!(family(Mean, left_out), Some("fit.ridge"));
        let left_out = |r: &mut Recipe| {
            (r.fit.ridge, r.target.on) = (RidgeName::LeaveOneOut, OnName::Trained);
        };
        assert_eq!(fault(&left_out), Some("fit.ridge"));
        let frame = |signal, frame| fault(&move |r| (r.bake.signal, r.fit.frame) = (signal, frame));
        assert_eq!(frame(SignalName::Ao, FrameName::Tangent), Some("fit.frame"));
        assert_eq!(frame(SignalName::Ao, FrameName::Root), None);
        assert_eq!(frame(SignalName::Transfer, FrameName::Tangent), None);
        let choice = |most| {
            fault(&move |r| (r.poses.choice, r.poses.most) = (PoseChoiceName::PredictedError, most))
        };
        assert_eq!((choice(None), choice(Some(8))), (Some("poses.choice"), None));
    }

    /// Joints are parameters of what has some: of a sequence of meshes they are refused by name.
    #[test]
    fn a_sequence_has_no_joints() {
        use ParametrisationName::{Dihedral, Handles, JointAngles};
        for (stated, is_sequence, sound) in [
            (Some(JointAngles), true, false),
            (Some(Handles), true, false),
            (Some(Dihedral), true, true),
            (None, true, true),
            (Some(Handles), false, true),
        ] {
            let found = effective_parametrisation(stated, is_sequence);
            assert_eq!(found.is_ok(), sound, "{stated:?}: {found:?}");
        }
        let told = effective_parametrisation(Some(JointAngles), true).expect_err("no effect");
        assert!(told.to_string().contains("is joint-angles; a sequence of meshes has no joints"));
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
        fit.include_rest = true;
        forget_other_sizes(&mut fit);
        assert_eq!(fit, FitRecipe { family: Mean, ..FitRecipe::default() });
    }

    /// The sentence says what to do.
    #[test]
    fn the_sentence_can_be_acted_on() {
        let told = |fit: FitRecipe| {
            let recipe = Recipe { fit, ..Recipe::default() };
            effective_fit(&recipe).expect_err("no effect").to_string()
        };
        let told_alpha = told(FitRecipe { alpha: Some(3.0), ..FitRecipe::default() });
        assert_eq!(told_alpha, "recipe field `fit.alpha` is 3; only the ridge `fixed` takes it");
        let fit = FitRecipe { family: ClusteredTanh, spheres: Some(8), ..FitRecipe::default() };
        assert_eq!(
            told(fit),
            "recipe field `fit.spheres` is 8 with the family clustered-tanh; that family has no \
             such thing: leave it out, or name another"
        );
    }
}
