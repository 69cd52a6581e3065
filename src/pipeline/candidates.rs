//! The models that a trade-off is measured over: every family at several sizes.

use super::effect::looks_at_mesh;
use super::recipe::{
    ChooseName, DEFAULT_SPHERES, FamilyName, FitRecipe, FrameName, OnName, ParametrisationName,
    Recipe, RidgeName, SignalName,
};

/// A fit with its name; precision is not part of it.
#[derive(Debug, Clone, PartialEq)]
pub struct CandidateRecipe {
    /// Family and sizes in words, unique.
    pub name: String,
    /// The data set's recipe with another `fit` and `target.on`.
    pub recipe: Recipe,
    /// The training poses that it is fitted to, by their indices among them, ascending; all when
    /// absent. For studies: [`super::search`] takes no notice.
    pub poses: Option<Vec<usize>>,
}

/// How far to look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Range {
    /// Every family at a few sizes.
    Quick,
    /// All, with the papers' own forms.
    Full,
}

/// Sizes of `pca-linear`, d_in and d_out.
const PCA: [(u32, u32); 8] =
    [(2, 8), (4, 11), (8, 22), (8, 44), (12, 33), (15, 50), (15, 100), (24, 150)];

/// Sizes of `multilinear`, pose clusters and dimensions.
const LOCAL: [(u32, u32); 5] = [(3, 5), (5, 5), (5, 10), (10, 5), (10, 10)];

/// Clusters of points of `multilinear` in per mille of the points: AO07's 10,000, 5,000 and 1,000
/// of about 37,600.
const SHARED: [u32; 3] = [266, 133, 27];

/// Neurons of each cluster of `clustered-tanh` where their number is not looked for.
const QUICK_NEURONS: u32 = 5;

/// Shares of the variance of each cluster of points that the clustered families keep.
const SHARES: [f64; 3] = [0.6, 0.8, 0.95];

/// How near a joint comes to the points that it matters to, in shares of the mesh's size.
const NEAR: [f64; 2] = [0.1, 0.3];

/// Ways to leave a part of the harmonics to the posed mesh: the points' own frames, and the unshadowed
/// signal, which in those is constant as it is and of visibility everywhere.
const LOOKING: [(FrameName, bool, &str); 2] =
    [(FrameName::Tangent, false, ", tangent frame"), (FrameName::Bone, true, ", shadows alone")];

/// Spheres of `occluder`.
const SPHERES: [u32; 3] = [40, 100, 200];

/// Groups of them that points weigh, where that is fewer than [`super::recipe::DEFAULT_GROUPS`]: a weight for each
/// is most of a model.
const GROUPS: [u32; 3] = [1, 3, 6];

/// The models to try over a data set of so many points, in a fixed order, simple ones first.
#[must_use]
pub fn candidates(base: &Recipe, points: usize, range: Range) -> Vec<CandidateRecipe> {
    let mut list = List { base, all: Vec::new() };
    let frames: &[FrameName] = match base.bake.signal {
        SignalName::Ao => &[FrameName::Root],
        SignalName::Visibility | SignalName::Transfer => &[FrameName::Bone, FrameName::Root],
    };
    for &frame in frames {
        let suffix = match (frame, frames.len()) {
            (FrameName::Root, 2) => ", root frame",
            _ => "",
        };
        list.pose_only(frame, suffix, points, range);
    }
    list.near_joints();
    let ways = match base.bake.signal {
        SignalName::Ao => 0,
        SignalName::Visibility => 1,
        SignalName::Transfer => 2,
    };
    for (frame, unshadowed, suffix) in LOOKING.into_iter().take(ways) {
        list.looking((frame, unshadowed), suffix);
    }
    // Spheres are cut from the posed mesh, of which receivers that block nothing are no part.
    if base.bake.surroundings.receivers.is_none() {
        list.occluders();
    }
    if range == Range::Full {
        list.published(points);
    }
    list.all
}

/// The ways in which the poses of reduced models become numbers, with what to call them: the data
/// set's own, and in the frame that such models do best in the other one too.
fn parametrisations(
    own: ParametrisationName,
    suffix: &str,
) -> Vec<(&'static str, Option<ParametrisationName>)> {
    let other = match own {
        ParametrisationName::Handles => (", joint angles", Some(ParametrisationName::JointAngles)),
        _ => (", handles", Some(ParametrisationName::Handles)),
    };
    if suffix.is_empty() { vec![("", None), other] } else { vec![("", None)] }
}

/// Motion between poses that were trained on asks for single poses to be left out, other motion
/// for clips.
fn ridge(base: &Recipe) -> RidgeName {
    match base.target.on {
        OnName::Trained => RidgeName::LeaveOneOut,
        OnName::Novel => RidgeName::LeaveOneClipOut,
    }
}

/// The candidates that a run's target chooses from.
pub(super) fn left_open(recipe: &Recipe, points: usize) -> Vec<CandidateRecipe> {
    let mut all = candidates(recipe, points, Range::Quick);
    if recipe.target.choose == ChooseName::Sizes {
        all.retain(|candidate| candidate.recipe.fit.family == recipe.fit.family);
    }
    all
}

struct List<'a> {
    base: &'a Recipe,
    all: Vec<CandidateRecipe>,
}

impl List<'_> {
    fn add(&mut self, name: String, on: OnName, edit: impl FnOnce(&mut FitRecipe)) {
        let mut recipe = self.base.clone();
        let ridge = ridge(self.base);
        recipe.fit = FitRecipe { seed: recipe.fit.seed, ridge, ..FitRecipe::default() };
        recipe.target.on = on;
        recipe.target.choose = ChooseName::Nothing;
        edit(&mut recipe.fit);
        // Whoever asks for it wants a model that joint rotations evaluate; the others are such models anyway.
        recipe.fit.include_rest = self.base.fit.include_rest && looks_at_mesh(&recipe.fit);
        self.all.push(CandidateRecipe { name, recipe, poses: None });
    }

    fn pose_only(&mut self, frame: FrameName, suffix: &str, points: usize, range: Range) {
        let novel = OnName::Novel;
        let handles = Some(ParametrisationName::Handles);
        self.add(format!("mean{suffix}"), novel, |fit| {
            fit.family = FamilyName::Mean;
            fit.frame = frame;
        });
        for (name, parametrisation) in
            [("joint angles", Some(ParametrisationName::JointAngles)), ("handles", handles)]
        {
            self.add(format!("linear, {name}{suffix}"), novel, |fit| {
                fit.family = FamilyName::Linear;
                (fit.frame, fit.parametrisation) = (frame, parametrisation);
            });
        }
        let ways = parametrisations(self.base.poses.parametrisation, suffix);
        for &(of, parametrisation) in &ways {
            for (inputs, outputs) in PCA {
                let name = format!("pca-linear {inputs}, {outputs}{of}{suffix}");
                self.add(name, novel, |fit| {
                    (fit.family, fit.frame) = (FamilyName::PcaLinear, frame);
                    (fit.inputs, fit.outputs) = (Some(inputs), Some(outputs));
                    fit.parametrisation = parametrisation;
                });
            }
        }
        for (clusters, inputs) in LOCAL {
            let edit = |fit: &mut FitRecipe| {
                (fit.family, fit.frame) = (FamilyName::Multilinear, frame);
                (fit.clusters, fit.inputs) = (Some(clusters), Some(inputs));
                fit.parametrisation = handles;
            };
            self.add(format!("multilinear {clusters}, {inputs}{suffix}"), novel, edit);
            for share in SHARED {
                let shared = (points as u64 * u64::from(share) / 1000).max(1) as u32;
                let name = format!("multilinear {clusters}, {inputs}, {shared}{suffix}");
                self.add(name, novel, |fit| {
                    edit(fit);
                    fit.point_clusters = Some(shared);
                });
            }
        }
        for &(of, parametrisation) in &ways {
            self.clustered((frame, suffix), (of, parametrisation), range);
        }
    }

    fn clustered(
        &mut self,
        (frame, suffix): (FrameName, &str),
        (of, parametrisation): (&str, Option<ParametrisationName>),
        range: Range,
    ) {
        for (name, family) in [
            ("clustered-linear", FamilyName::ClusteredLinear),
            ("clustered-quadratic", FamilyName::ClusteredQuadratic),
            ("clustered-tanh", FamilyName::ClusteredTanh),
        ] {
            for share in SHARES {
                // Numbers of neurons are tried one by one, which takes a hundred times as long.
                let neurons = (family == FamilyName::ClusteredTanh && range == Range::Quick)
                    .then_some(QUICK_NEURONS);
                let few = neurons.map_or(String::new(), |count| format!(" of {count} neurons"));
                let name = format!("{name} {share}{few}{of}{suffix}");
                self.add(name, OnName::Novel, |fit| {
                    (fit.family, fit.frame) = (family, frame);
                    (fit.retain_outputs, fit.neurons) = (Some(share), neurons);
                    fit.parametrisation = parametrisation;
                });
            }
        }
    }

    /// Linear models in which joints matter to near points alone.
    fn near_joints(&mut self) {
        for near in NEAR {
            self.add(format!("linear, joints within {near}"), OnName::Novel, |fit| {
                fit.family = FamilyName::Linear;
                fit.parametrisation = Some(ParametrisationName::JointAngles);
                fit.local = Some(near);
            });
        }
    }

    /// Spheres and unions of ellipsoids, with weights for all groups of them or for few.
    fn occluders(&mut self) {
        for spheres in SPHERES {
            // Unions take long to fit: one size of them tells whether they pay.
            let ways = [("", 0), (" in 256 directions", 256)];
            let many = if spheres == DEFAULT_SPHERES { 2 } else { 1 };
            for rest in [None, Some((4, 12)), Some((12, 40))] {
                let (inputs, outputs) = rest.unzip();
                let and = rest.map_or(String::new(), |(i, o)| format!(" and {i}, {o} of the rest"));
                for (how, directions) in ways.into_iter().take(many) {
                    self.add(format!("occluder {spheres}{how}{and}"), OnName::Novel, |fit| {
                        (fit.family, fit.spheres) = (FamilyName::Occluder, Some(spheres));
                        (fit.inputs, fit.outputs) = (inputs, outputs);
                        fit.directions = Some(directions);
                    });
                }
            }
            let few = if spheres > DEFAULT_SPHERES { &[][..] } else { &GROUPS };
            for (how, directions) in ways.into_iter().take(many) {
                for &groups in few {
                    let plural = if groups > 1 { "s" } else { "" };
                    let name = format!("occluder {spheres}{how}, {groups} group{plural}");
                    self.add(name, OnName::Novel, |fit| {
                        (fit.family, fit.spheres) = (FamilyName::Occluder, Some(spheres));
                        (fit.groups, fit.directions) = (Some(groups), Some(directions));
                    });
                }
            }
        }
    }

    /// The families without point features where the posed mesh tells part of the signal.
    fn looking(&mut self, (frame, unshadowed): (FrameName, bool), suffix: &str) {
        let mut add = |name: String, edit: &dyn Fn(&mut FitRecipe)| {
            self.add(format!("{name}{suffix}"), OnName::Novel, |fit| {
                (fit.frame, fit.unshadowed) = (frame, unshadowed.then_some(true));
                edit(fit);
            });
        };
        add("mean".to_owned(), &|fit| fit.family = FamilyName::Mean);
        for (inputs, outputs) in PCA {
            add(format!("pca-linear {inputs}, {outputs}"), &|fit| {
                (fit.inputs, fit.outputs) = (Some(inputs), Some(outputs));
            });
        }
        for share in SHARES {
            add(format!("clustered-linear {share}"), &|fit| {
                fit.family = FamilyName::ClusteredLinear;
                fit.retain_outputs = Some(share);
            });
        }
    }

    /// The forms that the papers print, without regularisation.
    fn published(&mut self, points: usize) {
        let trained = OnName::Trained;
        for (clusters, inputs) in [5, 10, 15].into_iter().flat_map(|c| [5, 10, 15].map(|d| (c, d)))
        {
            for share in [None, Some(266), Some(133), Some(27)] {
                let shared = share.map(|s: u64| (points as u64 * s / 1000).max(1) as u32);
                let rows = shared.map_or("all".to_owned(), |rows| rows.to_string());
                for published in [false, true] {
                    let form = if published { "as published" } else { "with intercepts" };
                    let name = format!("AO07 {clusters}, {inputs}, {rows}, {form}");
                    self.add(name, trained, |fit| {
                        fit.family = FamilyName::Multilinear;
                        fit.parametrisation = Some(ParametrisationName::Handles);
                        (fit.clusters, fit.inputs) = (Some(clusters), Some(inputs));
                        (fit.point_clusters, fit.published) = (shared, published);
                    });
                }
            }
        }
        self.add("linear, trained".to_owned(), trained, |fit| fit.family = FamilyName::Linear);
        self.add("PRT07 P(15, 500)".to_owned(), OnName::Novel, |fit| {
            fit.family = FamilyName::PcaLinear;
            (fit.inputs, fit.outputs) = (Some(15), Some(500));
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Checked;

    /// Every candidate has a name of its own and passes the recipe's check, and the full range
    /// holds the quick one.
    #[test]
    fn candidates_are_sound() {
        for signal in [SignalName::Ao, SignalName::Transfer] {
            let mut base = Recipe::default();
            base.bake.signal = signal;
            let full = candidates(&base, 1000, Range::Full);
            let mut names: Vec<&str> = full.iter().map(|c| c.name.as_str()).collect();
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), full.len());
            assert!(full.iter().all(|c| Checked::new(&c.recipe).is_ok()));
            let quick = candidates(&base, 1000, Range::Quick);
            let tanh = |c: &CandidateRecipe| c.recipe.fit.family == FamilyName::ClusteredTanh;
            assert!(quick.iter().all(|c| full.contains(c) || tanh(c)));
        }
    }

    /// Asked for, the mesh at rest goes with every candidate that looks at the mesh, and with no other.
    #[test]
    fn the_rest_mesh_goes_with_those_that_look_at_it() {
        let mut base = Recipe::default();
        let fits = |base: &Recipe| -> Vec<FitRecipe> {
            let all = candidates(base, 1000, Range::Full).into_iter();
            all.map(|candidate| candidate.recipe.fit).collect()
        };
        assert!(fits(&base).iter().all(|fit| !fit.include_rest));
        base.fit.include_rest = true;
        for fit in fits(&base) {
            let is_posed = fit.family == FamilyName::Occluder || fit.unshadowed == Some(true);
            let looks = is_posed || fit.frame == FrameName::Tangent;
            assert_eq!(fit.include_rest, looks, "{fit:?}");
        }
    }
}
