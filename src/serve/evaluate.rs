//! `POST /v1/models/{id}/evaluate`: values at poses, as JSON or as raw little-endian f32.

use std::sync::Arc;
use std::time::Instant;

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::Response;
use glam::Vec3;

use super::Service;
use super::answer::{blocking, bytes, document, is_sha256};
use super::jobs::accepts;
use super::poses::{EvaluateRequest, refused};
use super::problem::Problem;
use super::values::{RAW, Values, as_bytes, as_json};
use crate::model::Model;
use crate::pipeline::{Gloss, Light, Query};

/// What is evaluated at poses.
pub(super) struct Asked<'a> {
    pub(super) model: &'a Model,
    /// Shading under this light in place of coefficients.
    pub(super) light: Option<&'a Light>,
    /// Reflection towards an eye in place of both; the poses then have their mesh.
    pub(super) gloss: Option<(&'a Gloss, Vec3)>,
    /// Only these vertices; all when absent.
    pub(super) vertices: Option<&'a [u32]>,
}

pub(super) async fn post(
    State(service): State<Arc<Service>>,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    if !is_sha256(&id) {
        return Err(Problem::not_found("model"));
    }
    let body = bytes(&headers, body, service.settings.limits.body_bytes).await?;
    let raw = accepts(&headers, RAW);
    let worker = Arc::clone(&service);
    let start = Instant::now();
    let answer = blocking(move || {
        let request: EvaluateRequest = document(&body)?;
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
    let asked = Asked { model, light: light.as_deref(), gloss, vertices };
    asked.values(service, &request.queries(service, id, model)?)
}

impl Asked<'_> {
    /// The values at some poses.
    ///
    /// # Errors
    /// `answer_bytes`; what the model objects to.
    pub(super) fn values(&self, service: &Service, queries: &[Query]) -> Result<Values, Problem> {
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
        for query in queries {
            let refuse = |error| refused("#".to_owned(), &error);
            distances.push(query.distance(model).map_err(refuse)?);
            match self.gloss {
                Some((gloss, eye)) => {
                    query.reflected(model, (gloss, eye, None), self.vertices, &mut values)
                }
                None => query.values(model, self.light, self.vertices, &mut values).map(drop),
            }
            .map_err(refuse)?;
        }
        let turned = queries.iter().all(|query| query.is_turned(model));
        let frame = if turned { "root" } else { "bone" };
        let residual_rms = header.training.residual_rms;
        Ok(Values { shape, values, frame, distances, residual_rms, held: Some(held) })
    }
}
