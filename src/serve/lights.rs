//! The light of an evaluation: as coefficients, as an uploaded map, or in words.

use std::sync::Arc;

use serde::Deserialize;

use super::answer::is_sha256;
use super::poses::refused;
use super::problem::Problem;
use super::{Service, few};
use crate::model::Model;
use crate::pipeline::{self, Light};
use crate::scene;
use crate::sh::{MAX_BANDS, Order};
use crate::shade::ShLight;

/// Answers of the largest size that there is room for.
const ROOM: u64 = super::held::LARGEST;

/// A map as a light of every band, and what is to be said of it.
#[derive(Debug)]
pub(super) struct MapLight {
    pub(super) light: ShLight,
    pub(super) notices: Vec<String>,
}

/// Colours of a light.
const MOST_COLOURS: usize = 3;

/// Exactly one of `coefficients`, `asset` and `form`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with `coefficients`, `asset` or `form`")]
pub(super) struct LightRequest {
    /// n² coefficients of incoming radiance in the root frame, for 1 or 3 colours.
    #[serde(default, deserialize_with = "few::maybe::<_, _, MOST_COLOURS>")]
    pub(super) coefficients: Option<Vec<Vec<f32>>>,
    /// SHA-256 of an uploaded map.
    pub(super) asset: Option<String>,
    /// A light in words, such as `cone:0,1,0,20`.
    pub(super) form: Option<String>,
    /// The map, or the light in words, is turned so far about +Y.
    #[serde(default)]
    pub(super) turn_degrees: f64,
}

impl LightRequest {
    /// The light on a model, from the cache where it was met before.
    pub(super) fn on(
        &self,
        service: &Service,
        id: &str,
        model: &Model,
    ) -> Result<Arc<Light>, Problem> {
        service.hot.light(id, &self.name(), || {
            let colours = self.colours(service, model)?;
            let given = self.coefficients.is_some();
            let pointer = if given { "#/light/coefficients" } else { "#/light" };
            Light::new(model, colours).map_err(|error| refused(pointer.to_owned(), &error))
        })
    }

    /// What tells lights apart.
    pub(super) fn name(&self) -> Vec<u8> {
        let mut name = Vec::new();
        for colour in self.coefficients.iter().flatten() {
            name.extend_from_slice(&(colour.len() as u64).to_le_bytes());
            name.extend(colour.iter().flat_map(|value| value.to_le_bytes()));
        }
        let turn = self.turn_degrees.to_bits();
        name.extend(format!("{:?} {:?} {turn}", self.asset, self.form).bytes());
        name
    }

    /// The coefficients by colour.
    pub(super) fn colours(
        &self,
        service: &Service,
        model: &Model,
    ) -> Result<Vec<Vec<f32>>, Problem> {
        match (&self.coefficients, &self.asset, &self.form) {
            (Some(colours), None, None) => Ok(colours.clone()),
            (None, Some(asset), None) => self.of_map(service, model, asset),
            (None, None, Some(form)) => self.of_words(model, form),
            _ => {
                let fault = "give one of `coefficients`, `asset` and `form`";
                Err(Problem::field("#/light", fault))
            }
        }
    }

    fn of_words(&self, model: &Model, form: &str) -> Result<Vec<Vec<f32>>, Problem> {
        pipeline::words_light(model, form, self.turn_degrees)
            .map_err(|error| Problem::field("#/light/form", error.to_string()))
    }

    fn of_map(
        &self,
        service: &Service,
        model: &Model,
        asset: &str,
    ) -> Result<Vec<Vec<f32>>, Problem> {
        let read = self.map(service, asset)?;
        pipeline::light_on(model, &read.light, self.turn_degrees)
            .map_err(|error| Problem::field("#/light", error.to_string()))
    }

    /// What is to be said of the light, in sentences.
    ///
    /// # Errors
    /// As [`LightRequest::on`].
    pub(super) fn notices(&self, service: &Service) -> Result<Vec<String>, Problem> {
        match &self.asset {
            Some(asset) => Ok(self.map(service, asset)?.notices.clone()),
            None => Ok(Vec::new()),
        }
    }

    /// A map of every band, decoded once and kept.
    fn map(&self, service: &Service, asset: &str) -> Result<Arc<MapLight>, Problem> {
        service.hot.map(asset, || Self::decoded(service, asset))
    }

    fn decoded(service: &Service, asset: &str) -> Result<MapLight, Problem> {
        let known = if is_sha256(asset) { service.store.asset(asset)? } else { None };
        let Some(known) = known else {
            return Err(Problem::field("#/light/asset", "it does not name an uploaded asset"));
        };
        let limit = service.settings.limits.answer_bytes;
        let mut held = service.answers.hold(known.bytes.min(limit))?;
        let path = service.store.folder().asset(asset);
        let bytes = pipeline::files::read(&path, known.bytes);
        let bytes = bytes.map_err(|error| Problem::internal(&error))?;
        let refuse = |error: &dyn std::fmt::Display| Problem::field("#/light", error.to_string());
        let needed = scene::environment_bytes(&bytes, "the map").map_err(|e| refuse(&e))?;
        // A map that takes more than all room is decoded when nothing else is there.
        service.answers.grow(&mut held, (known.bytes + needed).min(ROOM * limit))?;
        let most = Order::new(MAX_BANDS as u8).map_err(|error| Problem::internal(&error))?;
        let (light, facts, _) =
            pipeline::read_map(&bytes, "the map", most, 0.0).map_err(|error| refuse(&error))?;
        Ok(MapLight { light, notices: pipeline::map_notices(&facts) })
    }
}
