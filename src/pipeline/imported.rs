//! A data set whose scene is imported once, however many fits look at it.

use std::cell::RefCell;
use std::ops::Deref;
use std::rc::Rc;

use super::recipe::ParametrisationName;
use super::reference::job_for;
use super::{Error, Job, recipe_of};
use crate::dataset::Dataset;

/// A data set, and what was imported from the scene in it.
pub(super) struct Imported<'a> {
    /// The data set itself, for what outlives this.
    pub(super) dataset: &'a Dataset,
    /// One for each parametrisation of the poses that was asked for.
    jobs: RefCell<Vec<(ParametrisationName, Rc<Job>)>>,
}

impl<'a> Imported<'a> {
    /// Nothing is imported before somebody asks.
    pub(super) fn new(dataset: &'a Dataset) -> Self {
        Self { dataset, jobs: RefCell::default() }
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
}

impl Deref for Imported<'_> {
    type Target = Dataset;

    fn deref(&self) -> &Dataset {
        self.dataset
    }
}
