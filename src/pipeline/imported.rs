//! A data set whose scene is imported once, however many fits look at it.

use std::cell::{OnceCell, RefCell};
use std::ops::Deref;
use std::rc::Rc;

use super::recipe::ParametrisationName;
use super::reference::job_for;
use super::valued::shapes;
use super::{Error, Job, recipe_of, surroundings};
use crate::dataset::Dataset;
use crate::scene::{self, Limits};

/// A data set, and what was imported from the scene in it.
pub(super) struct Imported<'a> {
    /// The data set itself, for what outlives this.
    pub(super) dataset: &'a Dataset,
    /// One for each parametrisation of the poses that was asked for.
    jobs: RefCell<Vec<(ParametrisationName, Rc<Job>)>>,
    /// Hashes of the scene's and of the receivers' vertices and triangles.
    shapes: OnceCell<[Option<String>; 2]>,
}

impl<'a> Imported<'a> {
    /// Nothing is imported before somebody asks.
    pub(super) fn new(dataset: &'a Dataset) -> Self {
        Self { dataset, jobs: RefCell::default(), shapes: OnceCell::new() }
    }

    /// The job that the data set was baked from.
    ///
    /// # Errors
    /// As [`job_for`].
    pub(super) fn job(&self) -> Result<Rc<Job>, Error> {
        self.job_as(None)
    }

    /// The same with its poses in another parametrisation than the data set's.
    ///
    /// # Errors
    /// As [`job_for`].
    pub(super) fn job_as(&self, asked: Option<ParametrisationName>) -> Result<Rc<Job>, Error> {
        let mut recipe = recipe_of(self.dataset)?;
        let name = asked.unwrap_or(recipe.poses.parametrisation);
        if let Some((_, job)) = self.jobs.borrow().iter().find(|(known, _)| *known == name) {
            return Ok(Rc::clone(job));
        }
        recipe.poses.parametrisation = name;
        let job = Rc::new(job_for(self.dataset, recipe)?);
        self.jobs.borrow_mut().push((name, Rc::clone(&job)));
        Ok(job)
    }

    /// What ties a model to the mesh of the scene, and to that of the receivers. Nothing where the scene
    /// does not read: a fit goes by what was baked, and a model may be without.
    pub(super) fn shapes(&self) -> [Option<String>; 2] {
        self.shapes.get_or_init(|| self.read_shapes().unwrap_or_default()).clone()
    }

    fn read_shapes(&self) -> Result<[Option<String>; 2], Error> {
        let around = recipe_of(self.dataset)?.bake.surroundings;
        let [own, _, receivers] = surroundings::part(self.dataset.sources()?);
        let import = |sources| {
            scene::import_sources(sources, &Limits::default()).map_err(|source| Error::Scene {
                file: self.dataset.path().join("source").display().to_string(),
                source,
            })
        };
        let receivers = (!receivers.is_empty()).then(|| import(receivers)).transpose()?;
        Ok(shapes(&import(own)?, receivers.as_ref(), &around))
    }
}

impl Deref for Imported<'_> {
    type Target = Dataset;

    fn deref(&self) -> &Dataset {
        self.dataset
    }
}
