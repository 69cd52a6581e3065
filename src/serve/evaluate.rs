//! `POST /v1/models/{id}/evaluate`: values at poses, as JSON or as raw little-endian f32.

use std::sync::Arc;
use std::time::Instant;

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use glam::Vec3;

use super::Service;
use super::answer::{InPath, blocking, bytes, is_sha256};
use super::jobs::accepts;
use super::poses::{EvaluateRequest, refused};
use super::problem::Problem;
use super::values::{RAW, Values, as_bytes, as_json};
use crate::model::{Distance, Frame, Model};
use crate::pipeline::{Gloss, Light, Query};

/// What is evaluated at poses.
pub(super) struct Asked<'a> {
    pub(super) model: &'a Model,
    /// Shading under this light in place of coefficients.
    pub(super) light: Option<&'a Light>,
    /// Reflection towards an eye in place of both; the poses then have their mesh.
    pub(super) gloss: Option<(&'a Gloss, Vec3)>,
    /// Where the light stands in the request.
    pub(super) light_at: &'static str,
    /// Only these vertices; all when absent.
    pub(super) vertices: Option<&'a [u32]>,
}

pub(super) async fn post(
    State(service): State<Arc<Service>>,
    InPath(id): InPath<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    if !is_sha256(&id) {
        return Err(Problem::not_found("model"));
    }
    let body = bytes(&service, &headers, body).await?;
    let raw = accepts(&headers, RAW);
    let worker = Arc::clone(&service);
    let start = Instant::now();
    let answer = blocking(move || {
        let request = EvaluateRequest::read(&body)?;
        let model = worker.hot.model(&worker, &id)?.ok_or_else(|| Problem::not_found("model"))?;
        let values = evaluate(&worker, &id, &model, &request)?;
        Ok(if raw { as_bytes(values) } else { as_json(values) })
    })
    .await;
    service.metrics.evaluated(start.elapsed());
    answer
}

fn evaluate(
    service: &Service,
    id: &str,
    model: &Model,
    request: &EvaluateRequest,
) -> Result<Values, Problem> {
    let gloss = request.gloss(service, id, model)?;
    let light = if gloss.is_none() { request.light(service, id, model)? } else { None };
    let vertices = request.vertices.as_deref();
    let gloss = gloss.as_ref().map(|(gloss, eye)| (gloss.as_ref(), *eye));
    let asked = Asked { model, light: light.as_deref(), light_at: "#/light", gloss, vertices };
    let queries = request.queries(service, id, model)?;
    let mut values = asked.values(service, &queries, |index| request.place(index))?;
    values.notices =
        request.light.as_ref().map_or(Ok(Vec::new()), |light| light.notices(service))?;
    values.notices.extend(gloss.iter().flat_map(|(gloss, _)| gloss.notices().iter().cloned()));
    Ok(values)
}

impl Asked<'_> {
    /// The values at some poses, each of which stands somewhere in the request.
    ///
    /// # Errors
    /// `answer_bytes`; what the model objects to; numbers so large that the values are none.
    pub(super) fn values(
        &self,
        service: &Service,
        queries: &[Query],
        place: impl Fn(usize) -> String,
    ) -> Result<Values, Problem> {
        let (model, header) = (self.model, self.model.header());
        let rows = self.vertices.map_or(header.mesh.vertices as usize, <[u32]>::len);
        let mut shape = vec![queries.len(), rows];
        match (self.light, self.gloss) {
            (_, Some(_)) => shape.push(3),
            (Some(light), None) => shape.push(light.colours(model)),
            (None, None) => shape.extend([usize::from(header.channels), header.coefficients()]),
        }
        let most = service.settings.limits.answer_bytes;
        let wanted = shape.iter().fold(4_u64, |bytes, &n| bytes.saturating_mul(n as u64));
        if wanted > most {
            let fault = format!(
                "the values of {shape:?} have {wanted} bytes; at most {most} are sent at once"
            );
            return Err(Problem::field("#", fault).limit("answer_bytes", most));
        }
        let held = service.answers.hold(wanted)?;
        let mut values = Vec::with_capacity(wanted as usize / 4);
        let mut distances = Vec::with_capacity(queries.len());
        for (index, query) in queries.iter().enumerate() {
            let refuse = |error| refused("#".to_owned(), &error);
            let (first, distance) = (values.len(), query.distance(model).map_err(refuse)?);
            match self.gloss {
                Some((gloss, eye)) => {
                    query.reflected(model, (gloss, eye, None), self.vertices, &mut values)
                }
                None => query.values(model, self.light, self.vertices, &mut values).map(drop),
            }
            .map_err(refuse)?;
            if !(is_sound(&distance) && are_finite(&values[first..])) {
                return Err(self.beyond(query, &distance, place(index)));
            }
            distances.push(distance);
        }
        let turned = queries.iter().all(|query| query.is_turned(model));
        let frame = if turned { Frame::Root } else { header.frame }.name();
        let residual_rms = header.training.residual_rms;
        let notices = Vec::new();
        Ok(Values { shape, values, frame, distances, residual_rms, notices, held: Some(held) })
    }

    /// Finite numbers that lead to values which are not: those of the light, where the values are
    /// finite without it, or else those of the pose.
    fn beyond(&self, query: &Query, distance: &Distance, place: String) -> Problem {
        let mut plain = Vec::new();
        let without = query.values(self.model, None, self.vertices, &mut plain);
        let by_light = is_sound(distance) && without.is_ok() && are_finite(&plain);
        let (pointer, what) = match by_light {
            true => (self.light_at.to_owned(), "under this light"),
            false => (place, "or the distance to training at this pose"),
        };
        let fault = format!("the values {what} are beyond the range of f32; give smaller numbers");
        Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid-pose", fault.clone())
            .at(pointer, fault)
    }
}

fn is_sound(distance: &Distance) -> bool {
    distance.mahalanobis.is_finite() && distance.residual.is_finite()
}

/// By the largest of their bits without the sign, which takes no branch for each.
fn are_finite(values: &[f32]) -> bool {
    let largest = values.iter().fold(0, |most: u32, value| most.max(value.abs().to_bits()));
    largest < f32::INFINITY.to_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Infinities and what is no number are found wherever they stand; the largest number is one.
    #[test]
    fn what_is_not_finite_is_found() {
        assert!(are_finite(&[]) && are_finite(&[0.0, -0.0, f32::MAX, f32::MIN, 1e-45]));
        for odd in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for at in 0..9 {
                let mut values = [1.0; 9];
                values[at] = odd;
                assert!(!are_finite(&values), "{odd} at {at}");
            }
        }
    }

    /// Values that are no numbers are the fault of the light where they are numbers without it, of the
    /// pose where they or its distance are not.
    #[test]
    fn what_is_beyond_numbers_is_told_at_its_place() {
        let blob = include_bytes!("../model/blob/golden_v1.safetensors");
        let model = Model::from_bytes(blob).expect("golden");
        let light = Light::new(&model, vec![vec![f32::MAX; model.header().coefficients()]]);
        let light = light.expect("finite");
        let asked = Asked {
            model: &model,
            light: Some(&light),
            light_at: "#/light",
            gloss: None,
            vertices: None,
        };
        let row = vec![0.0; model.header().rig.columns.len()];
        let query = Query::from_parameters(&model, &row).expect("a pose");
        let at = |distance: &Distance| {
            let problem = asked.beyond(&query, distance, "#/parameters/7".to_owned());
            assert_eq!(problem.status, StatusCode::UNPROCESSABLE_ENTITY);
            problem.fault().map(|(pointer, _)| pointer.to_owned()).expect("a place")
        };
        assert_eq!(at(&Distance { mahalanobis: 1.0, residual: 1.0 }), "#/light");
        for (mahalanobis, residual) in [(f32::INFINITY, 1.0), (1.0, f32::NAN)] {
            assert_eq!(at(&Distance { mahalanobis, residual }), "#/parameters/7");
        }
    }
}
