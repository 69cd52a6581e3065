//! What several fits of one training set have in common, computed once: the factored poses, what
//! leaving clips out needs of them, the outputs' basis, clusters, and occluders with their weights.
//! A family of any size takes its part of them.

use std::sync::{Arc, Mutex, PoisonError};

use super::clustered::Kept;
use super::design::Design;
use super::folds::Folds;
use super::geometry::Geometry;
use super::multilinear::Local;
use super::occluder::{Inscribed, Placed, Sight};
use super::output_basis::{OutputBasis, Projected};
use super::output_parts::Part;
use super::source::Rest;
use super::{Error, Frame, OccluderReport, On, Ridge, Settings};

/// The largest sizes that will be asked for: what is computed once is computed so large.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Largest {
    /// Output dimensions of `pca-linear`.
    pub outputs: usize,
    /// Outputs of each cluster of points.
    pub cluster_outputs: Kept,
    /// Groups of occluders of each bone.
    pub groups: usize,
}

/// The common parts of fits, kept from one to the next.
///
/// It belongs to one training set, in any number of parametrisations that differ in the names of
/// their parameters, and to one seed. Whoever gives it to fits of other data gets nonsense.
#[derive(Debug, Default)]
pub struct Shared {
    largest: Option<Largest>,
    inscribed: Kind<(), Inscribed>,
    designs: Kind<Vec<String>, Design>,
    folds: Kind<FoldKey, Option<Folds>>,
    bases: Kind<Outputs, Basis>,
    labels: Kind<Option<usize>, Vec<usize>>,
    parts: Kind<(Outputs, Option<usize>), Vec<Part>>,
    locals: Kind<(Vec<String>, usize), Vec<Local>>,
    seen: Kind<Outputs, Sight>,
    placed: Kind<Outputs, (Placed, OccluderReport)>,
    kept: Kind<Outputs, Option<Arc<Rest>>>,
}

/// The outputs in a basis that they share.
#[derive(Debug)]
pub(super) struct Basis {
    pub(super) basis: OutputBasis,
    pub(super) projected: Projected,
}

/// Which outputs a family sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Outputs {
    frame: Frame,
    unshadowed: bool,
    spheres: Option<usize>,
    groups: usize,
    directions: usize,
    on: On,
    ridge: Ridge,
}

impl Outputs {
    pub(super) fn of(settings: &Settings) -> Self {
        let Settings { frame, unshadowed, spheres, groups, directions, on, ridge, .. } = *settings;
        Self { frame, unshadowed, spheres, groups, directions, on, ridge }
    }
}

type FoldKey = (Vec<String>, Ridge);

impl Shared {
    /// For fits up to these sizes.
    #[must_use]
    pub fn new(largest: Largest) -> Self {
        Self { largest: Some(largest), ..Self::default() }
    }

    /// For fits to some points of a mesh whose inscribed balls are known.
    #[must_use]
    pub fn with_inscribed(self, inscribed: Option<Arc<Inscribed>>) -> Self {
        let known = inscribed.into_iter().map(|inscribed| ((), inscribed)).collect();
        Self { inscribed: Kind(Mutex::new(known)), ..self }
    }

    pub(super) fn inscribed(&self, geometry: &Geometry<'_>) -> Result<Arc<Inscribed>, Error> {
        self.inscribed.get(&(), || Ok(Inscribed::new(geometry)))
    }

    pub(super) fn largest(&self) -> Option<Largest> {
        self.largest
    }

    pub(super) fn design(
        &self,
        names: &[String],
        make: impl FnOnce() -> Result<Design, Error>,
    ) -> Result<Arc<Design>, Error> {
        self.designs.get(&names.to_vec(), make)
    }

    pub(super) fn folds(
        &self,
        names: &[String],
        ridge: Ridge,
        make: impl FnOnce() -> Option<Folds>,
    ) -> Result<Arc<Option<Folds>>, Error> {
        self.folds.get(&(names.to_vec(), ridge), || Ok(make()))
    }

    /// `make` must not depend on sizes beyond [`Shared::largest`].
    pub(super) fn basis(
        &self,
        key: Outputs,
        make: impl FnOnce() -> Result<Basis, Error>,
    ) -> Result<Arc<Basis>, Error> {
        self.bases.get(&key, make)
    }

    pub(super) fn labels(
        &self,
        clusters: Option<usize>,
        make: impl FnOnce() -> Vec<usize>,
    ) -> Result<Arc<Vec<usize>>, Error> {
        self.labels.get(&clusters, || Ok(make()))
    }

    pub(super) fn parts(
        &self,
        key: (Outputs, Option<usize>),
        make: impl FnOnce() -> Result<Vec<Part>, Error>,
    ) -> Result<Arc<Vec<Part>>, Error> {
        self.parts.get(&key, make)
    }

    pub(super) fn locals(
        &self,
        names: &[String],
        clusters: usize,
        make: impl FnOnce() -> Result<Vec<Local>, Error>,
    ) -> Result<Arc<Vec<Local>>, Error> {
        self.locals.get(&(names.to_vec(), clusters), make)
    }

    pub(super) fn seen(
        &self,
        key: Outputs,
        make: impl FnOnce() -> Result<Sight, Error>,
    ) -> Result<Arc<Sight>, Error> {
        self.seen.get(&key, make)
    }

    pub(super) fn placed(
        &self,
        key: Outputs,
        make: impl FnOnce() -> Result<(Placed, OccluderReport), Error>,
    ) -> Result<Arc<(Placed, OccluderReport)>, Error> {
        self.placed.get(&key, make)
    }

    pub(super) fn kept(
        &self,
        key: Outputs,
        make: impl FnOnce() -> Result<Option<Rest>, Error>,
    ) -> Result<Option<Arc<Rest>>, Error> {
        Ok((*self.kept.get(&key, || Ok(make()?.map(Arc::new)))?).clone())
    }
}

/// What was made, by what it was made for.
#[derive(Debug)]
struct Kind<K, V>(Mutex<Vec<(K, Arc<V>)>>);

impl<K, V> Default for Kind<K, V> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: Clone + PartialEq, V> Kind<K, V> {
    /// What is there under the key, or what `make` makes; the lock is not held meanwhile, since
    /// `make` may wait for other threads.
    fn get(&self, key: &K, make: impl FnOnce() -> Result<V, Error>) -> Result<Arc<V>, Error> {
        let known = |all: &[(K, Arc<V>)]| {
            all.iter().find(|(other, _)| other == key).map(|(_, value)| Arc::clone(value))
        };
        let all = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(value) = known(&all()) {
            return Ok(value);
        }
        let made = Arc::new(make()?);
        let mut all = all();
        if let Some(value) = known(&all) {
            return Ok(value);
        }
        all.push((key.clone(), Arc::clone(&made)));
        Ok(made)
    }
}
