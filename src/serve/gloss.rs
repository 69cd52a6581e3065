//! Reflection towards an eye: the `brdf` of an evaluation, beside its `light`.

use std::sync::Arc;

use glam::Vec3;
use serde::Deserialize;

use super::Service;
use super::answer::is_sha256;
use super::lights::LightRequest;
use super::poses::{EvaluateRequest, refused};
use super::problem::Problem;
use crate::model::{Model, Signal};
use crate::pipeline::{self, EvaluateError, Finish, FinishError, GLOSS_LOBES, GLOSS_TERMS, Gloss};
use crate::sh::Order;
use crate::shade::{
    BRDF_WORDS, Brdf, MOST_LOBES, Material, Merl, Reflector, ShLight, brdf_of_words,
};

/// The largest order that operators are made for here: beyond, they are megabytes, and the time to
/// make one is seconds.
const MOST_ORDER: u8 = 6;

/// Bytes of an operator of the largest order with all of its terms in three colours, and its header.
const MOST_OPERATOR_BYTES: u64 = 128 << 20;

/// Exactly one of `form` and `asset`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with `form` or `asset`, and `eye`")]
pub(super) struct BrdfRequest {
    /// A reflectance in words, such as `ggx:0.5,0.3`; one with a grain on models in the tangent frame.
    pub(super) form: Option<String>,
    /// SHA-256 of an uploaded operator, or of a measured reflectance in MERL's format.
    pub(super) asset: Option<String>,
    /// Where the eye is, in the root frame, metres.
    pub(super) eye: [f32; 3],
    /// Terms of the operator of a form or a measured reflectance.
    pub(super) terms: Option<usize>,
    /// Lobes that the light is fitted with.
    pub(super) lobes: Option<usize>,
}

impl EvaluateRequest {
    /// What the light is reflected by, and towards where.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn gloss(
        &self,
        service: &Service,
        id: &str,
        model: &Model,
    ) -> Result<Option<(Arc<Gloss>, Vec3)>, Problem> {
        let Some(brdf) = &self.brdf else { return Ok(None) };
        if self.parameters.is_some() || self.positions.is_some() {
            return Err(Problem::field("#/brdf", WANTS_POSES));
        }
        brdf.gloss(service, (id, model), self.light.as_ref()).map(Some)
    }
}

/// What a reflectance beside other poses is told.
pub(super) const WANTS_POSES: &str =
    "it stands beside `poses` or `clip`, which tell where the surface is";

impl BrdfRequest {
    /// What the light is reflected by, from the cache where it was met before, and towards where.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn gloss(
        &self,
        service: &Service,
        (id, model): (&str, &Model),
        light: Option<&LightRequest>,
    ) -> Result<(Arc<Gloss>, Vec3), Problem> {
        let Some(light) = light else {
            return Err(Problem::field("#/brdf", "it stands beside a `light`, which it reflects"));
        };
        let eye = Vec3::from(self.eye);
        if !eye.is_finite() {
            return Err(Problem::field("#/brdf/eye", "it is no place"));
        }
        if model.header().signal != Signal::Visibility {
            let signal = model.header().signal.name();
            return Err(refused("#/brdf".to_owned(), &EvaluateError::NeedsVisibility { signal }));
        }
        let lobes = self.lobes.unwrap_or(GLOSS_LOBES);
        if !(1..=MOST_LOBES).contains(&lobes) {
            return Err(Problem::field("#/brdf/lobes", format!("there are 1 to {MOST_LOBES}")));
        }
        let mut name = light.name();
        name.extend(format!(" {:?} {:?} {:?} {lobes}", self.form, self.asset, self.terms).bytes());
        let gloss = service.hot.gloss(id, &name, || {
            let colours = light.colours(service, model)?;
            let light = three(model.header().sh_order(), &colours)?;
            let (reflector, notices) = self.reflector(service, model.header().sh_order())?;
            let gloss = Gloss::new(model, &light, reflector, lobes);
            let gloss = gloss.map_err(|error| refused("#/brdf".to_owned(), &error))?;
            gloss.check_grain(model).map_err(|error| refused(self.source().to_owned(), &error))?;
            Ok(gloss.with_notices(notices))
        })?;
        Ok((gloss, eye))
    }
}

/// One colour or three as a light.
fn three(order: Order, colours: &[Vec<f32>]) -> Result<ShLight, Problem> {
    let count = order.coefficients();
    let sound = matches!(colours.len(), 1 | 3) && colours.iter().all(|c| c.len() == count);
    if !sound || colours.iter().flatten().any(|value| !value.is_finite()) {
        let fault = format!("it is 1 or 3 colours of {count} finite numbers");
        return Err(Problem::field("#/light/coefficients", fault));
    }
    let colour = |c: usize| colours[c % colours.len()].iter().map(|&x| f64::from(x)).collect();
    Ok(ShLight::from_coefficients(order, [0, 1, 2].map(colour)))
}

/// An operator, and what is to be said of its reflectance.
type Told = (Reflector, Vec<String>);

impl BrdfRequest {
    /// The field that says which reflectance it is.
    fn source(&self) -> &'static str {
        if self.form.is_some() { "#/brdf/form" } else { "#/brdf/asset" }
    }

    fn reflector(&self, service: &Service, order: Order) -> Result<Told, Problem> {
        match (&self.form, &self.asset) {
            (Some(form), None) => self.of_form(form, order),
            (None, Some(asset)) => self.of_asset(service, asset, order),
            _ => Err(Problem::field("#/brdf", "give one of `form` and `asset`")),
        }
    }

    fn of_form(&self, form: &str, order: Order) -> Result<Told, Problem> {
        let refuse = |told: String| Problem::field("#/brdf/form", told);
        let brdf: Brdf = match brdf_of_words(form) {
            Some(read) => read.map_err(|error| refuse(format!("`{form}` {error}")))?,
            None => return Err(refuse(format!("it is none of {BRDF_WORDS}"))),
        };
        self.operator(form, Material::from(brdf), order)
    }

    fn operator(&self, name: &str, material: Material, order: Order) -> Result<Told, Problem> {
        if order.get() > MOST_ORDER {
            let fault = format!(
                "operators of order {} are not made here, up to {MOST_ORDER} they are: upload one",
                order.get()
            );
            return Err(Problem::field(self.source(), fault));
        }
        let finish = Finish::from(material);
        let made = finish.operator(name, order, self.terms.unwrap_or(GLOSS_TERMS));
        made.map(|made| (made, finish.warnings())).map_err(|error| match error {
            FinishError::Terms { most, .. } => {
                Problem::field("#/brdf/terms", format!("there are 1 to {most}"))
            }
            other => Problem::internal(&other),
        })
    }

    /// An operator that was uploaded, or that of a measured reflectance that was.
    fn of_asset(&self, service: &Service, asset: &str, order: Order) -> Result<Told, Problem> {
        let refuse = |told: String| Problem::field("#/brdf/asset", told);
        let known = if is_sha256(asset) { service.store.asset(asset)? } else { None };
        let known = known.ok_or_else(|| refuse("it does not name an uploaded asset".to_owned()))?;
        if known.bytes > MOST_OPERATOR_BYTES {
            return Err(refuse(format!("it has {} bytes: it is no operator", known.bytes)));
        }
        // The bytes, and what is read out of them.
        let _held = service.answers.hold(2 * known.bytes)?;
        let path = service.store.folder().asset(asset);
        let bytes = pipeline::files::read(&path, known.bytes);
        let bytes = bytes.map_err(|error| Problem::internal(&error))?;
        if bytes.starts_with(&Merl::HEAD) {
            let merl = Merl::from_bytes(&bytes).map_err(|error| refuse(error.to_string()))?;
            drop(bytes);
            return self.operator(asset, Material::Measured(Arc::new(merl)), order);
        }
        if self.terms.is_some() {
            let fault = "an uploaded operator has its own: leave it out";
            return Err(Problem::field("#/brdf/terms", fault));
        }
        let read = Reflector::from_bytes(&bytes).map_err(|error| refuse(error.to_string()))?;
        Ok((read, Vec::new()))
    }
}
