//! `/v1/assets/{sha256}`: files, uploaded once by their content.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, Method, StatusCode};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tokio::io::AsyncWriteExt;
use tokio::sync::OwnedSemaphorePermit;

use super::answer::{self, InPath, Params, blocking, content_length, is_sha256};
use super::problem::Problem;
use super::room::Place;
use super::store::{Asset, Forgotten, hexadecimal};
use super::{Limits, Service, StoreError, bundle, files, store};
use crate::pipeline;

/// How an upload says what its bytes are.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct UploadQuery {
    /// A file name; its extension tells a scene from other files.
    name: Option<String>,
}

/// The kind of an archive that was taken apart.
const BUNDLE: &str = "bundle";

/// Files of an archive: name → SHA-256.
type Parts = BTreeMap<String, String>;

/// A repeated upload up to this size is read to its end, so that a client that does not wait for
/// `100 Continue` gets its answer.
const READ_ANYWAY: u64 = 1 << 20;

pub(super) async fn put(
    State(service): State<Arc<Service>>,
    InPath(sha256): InPath<String>,
    Params(query): Params<UploadQuery>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    if !is_sha256(&sha256) {
        let fault = "an asset is named by 64 lower-case hexadecimal digits";
        return Err(Problem::field("sha256", fault));
    }
    let length = content_length(&headers);
    let known = lookup(&service, &sha256).await?;
    // Importing anew is asked for by naming a scene that first came without a name.
    let extension = extension(query.name.as_deref());
    if let Some(asset) = known.filter(|asset| asset.kind != "file" || extension.is_none()) {
        if length.is_some_and(|length| length <= READ_ANYWAY) {
            answer::drain(body, READ_ANYWAY).await;
        }
        return again(&service, &asset).await;
    }
    let place = room_for(&service, length).await?;
    let incoming = Arc::new(service.store.folder().incoming()?);
    let path = incoming.path().join(format!("asset.{}", extension.unwrap_or("bin")));
    let (bytes, found, place) = receive(&service, body, &path, place).await?;
    if bytes == 0 {
        return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "bad-asset", "it has no bytes"));
    }
    if found != sha256 {
        let detail = format!("the {bytes} bytes received have the SHA-256 {found}");
        return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "hash-mismatch", detail));
    }
    let worker = Arc::clone(&service);
    let shown = importing(&service, move || {
        let _until_kept = place;
        let parts = parts(&worker, &path, incoming.path())?;
        let asset = keep(&worker, &path, &sha256, bytes, parts.is_some())?;
        Ok(show(&asset, parts))
    });
    let shown = shown.await?;
    Ok(answer::json(StatusCode::CREATED, &shown))
}

/// Runs work that may take gigabytes when it is its turn. Its place is free again when it ends, whether
/// or not somebody still waits for it.
pub(super) async fn importing<T: Send + 'static>(
    service: &Service,
    work: impl FnOnce() -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    let permit = turn(service).await?;
    blocking(move || {
        let _until_done = permit;
        work()
    })
    .await
}

/// Waits until one more scene may be imported; another may when what this gives is dropped.
pub(super) async fn turn(service: &Service) -> Result<OwnedSemaphorePermit, Problem> {
    let places = Arc::clone(&service.imports);
    places.acquire_owned().await.map_err(|error| Problem::internal(&error))
}

/// An asset that was there. Files of an archive may have been removed since: they are there again.
async fn again(service: &Arc<Service>, asset: &Asset) -> Result<Response, Problem> {
    let mut parts = None;
    if asset.kind == BUNDLE {
        let (worker, sha256) = (Arc::clone(service), asset.sha256.clone());
        let unpacked = importing(service, move || {
            let incoming = worker.store.folder().incoming()?;
            bundle::unpack(&worker, &worker.store.folder().asset(&sha256), incoming.path())
        });
        parts = Some(unpacked.await?);
    }
    Ok(answer::json(StatusCode::OK, &show(asset, parts)))
}

/// The files of an archive; none of what is no archive.
fn parts(service: &Service, path: &Path, incoming: &Path) -> Result<Option<Parts>, Problem> {
    if path.extension().is_none_or(|extension| extension != "zip") {
        return Ok(None);
    }
    let folder = incoming.join("files");
    store::create(&folder)?;
    bundle::unpack(service, path, &folder).map(Some)
}

pub(super) async fn get(
    State(service): State<Arc<Service>>,
    InPath(sha256): InPath<String>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let asset = lookup(&service, &sha256).await?.ok_or_else(|| Problem::not_found("asset"))?;
    let path = service.store.folder().asset(&sha256);
    files::immutable(&path, &sha256, "application/octet-stream", &method, &headers)
        .await
        .map(|response| files::with(response, "poselight-kind", &asset.kind))
}

pub(super) async fn delete(
    State(service): State<Arc<Service>>,
    InPath(sha256): InPath<String>,
) -> Result<Response, Problem> {
    if !is_sha256(&sha256) {
        return Err(Problem::not_found("asset"));
    }
    match blocking(move || Ok(service.store.delete_asset(&sha256)?)).await? {
        Forgotten::Yes => Ok(StatusCode::NO_CONTENT.into_response()),
        Forgotten::Needed(job) => {
            let detail = format!("the job {job} needs it and has not ended; cancel it first");
            Err(Problem::new(StatusCode::CONFLICT, "conflict", detail))
        }
        Forgotten::Unknown => Err(Problem::not_found("asset")),
    }
}

async fn lookup(service: &Arc<Service>, sha256: &str) -> Result<Option<Asset>, Problem> {
    if !is_sha256(sha256) {
        return Ok(None);
    }
    let (service, sha256) = (Arc::clone(service), sha256.to_owned());
    blocking(move || {
        let asset = service.store.asset(&sha256)?;
        // Who is told that it is there may name it in a job.
        if asset.is_some()
            && service.settings.limits.keep_days.is_some()
            && let Err(error) = service.store.renew_asset(&sha256)
        {
            tracing::warn!(%error, "an asset stays as old as it was");
        }
        Ok(asset)
    })
    .await
}

fn show(asset: &Asset, parts: Option<Parts>) -> Value {
    let mut shown = json!({
        "sha256": asset.sha256,
        "bytes": asset.bytes,
        "kind": asset.kind,
        "created_ms": asset.created_ms,
    });
    if let Some(parts) = parts {
        shown["files"] = json!(parts);
    }
    shown
}

/// The extension of a file that is looked at when it comes.
fn extension(name: Option<&str>) -> Option<&'static str> {
    let extension = Path::new(name?).extension()?.to_str()?.to_ascii_lowercase();
    ["glb", "gltf", "obj", "npz", "hdr", "exr", "zip"].into_iter().find(|known| *known == extension)
}

/// Refuses what is too large before it is sent, and takes its room.
async fn room_for(service: &Arc<Service>, length: Option<u64>) -> Result<Place, Problem> {
    let most = service.settings.limits.asset_bytes;
    let length = length.unwrap_or(0);
    if length > most {
        return Err(too_large(most));
    }
    let (worker, mut place) = (Arc::clone(service), Place::new(service));
    blocking(move || place.hold(&worker, length).map(|()| place)).await
}

pub(super) fn too_large(most: u64) -> Problem {
    let detail = format!("the asset has more than {most} bytes");
    Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "asset-too-large", detail)
        .limit("asset_bytes", most)
}

/// Streams a body to a file, with room taken as it comes; its size, its SHA-256 and its room.
async fn receive(
    service: &Arc<Service>,
    body: Body,
    path: &PathBuf,
    mut place: Place,
) -> Result<(u64, String, Place), Problem> {
    let Limits { asset_bytes: most, idle_s, .. } = service.settings.limits;
    let idle = |_| {
        let detail = format!("nothing came for {idle_s} s");
        Problem::new(StatusCode::REQUEST_TIMEOUT, "timeout", detail)
            .limit("idle_s", u64::from(idle_s))
    };
    let patience = Duration::from_secs(u64::from(idle_s));
    let io = |source| StoreError::Io { action: "write", path: path.clone(), source };
    let mut file = tokio::fs::File::create(path).await.map_err(io)?;
    let mut hasher = Sha256::new();
    let mut bytes = 0_u64;
    let mut stream = body.into_data_stream();
    while let Some(chunk) = tokio::time::timeout(patience, stream.next()).await.map_err(idle)? {
        let chunk = chunk.map_err(|_| answer::broken())?;
        bytes += chunk.len() as u64;
        if bytes > most {
            return Err(too_large(most));
        }
        if !place.holds(bytes) {
            let worker = Arc::clone(service);
            place = blocking(move || place.hold_more(&worker, bytes).map(|()| place)).await?;
        }
        hasher.update(&chunk);
        file.write_all(&chunk).await.map_err(io)?;
    }
    file.flush().await.map_err(io)?;
    file.sync_all().await.map_err(io)?;
    Ok((bytes, hexadecimal(&hasher.finalize()), place))
}

/// Imports a scene, and moves a sound file to its place.
fn keep(
    service: &Service,
    path: &Path,
    sha256: &str,
    bytes: u64,
    is_bundle: bool,
) -> Result<Asset, Problem> {
    let kind = if is_bundle { BUNDLE } else { kind(path)? };
    service.store.add_asset(sha256, bytes, kind, path)?;
    tracing::info!(sha256, bytes, kind, "asset");
    let asset = service.store.asset(sha256)?;
    asset.ok_or_else(|| Problem::internal(&"an asset that was just kept is gone"))
}

/// What a file is, once what it was named as is found sound.
fn kind(path: &Path) -> Result<&'static str, Problem> {
    if is_map(path) {
        check_map(path)?;
        return Ok("light");
    }
    if path.extension().is_some_and(|extension| extension == "gltf") {
        // Its buffers and pictures are files of their own, which may still be on their way.
        let whole = pipeline::check_document(path).map_err(|error| bad_asset(&error))?;
        return Ok(if whole { "scene" } else { "gltf" });
    }
    match check(path) {
        None => Ok("file"),
        Some(Ok(())) => Ok("scene"),
        Some(Err(error)) => Err(bad_asset(&error)),
    }
}

/// Whether a file was named as a map of light.
fn is_map(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "hdr" || extension == "exr")
}

/// What the reader of maps says of one.
fn check_map(path: &Path) -> Result<(), Problem> {
    let bytes = std::fs::read(path).map_err(|source| StoreError::Io {
        action: "read",
        path: path.to_path_buf(),
        source,
    })?;
    pipeline::check_map(&bytes, "the map").map_err(|error| {
        let status = StatusCode::UNPROCESSABLE_ENTITY;
        Problem::new(status, "bad-asset", error.to_string())
    })
}

/// What the importer says of a scene; nothing of other files.
fn check(path: &Path) -> Option<Result<(), pipeline::Error>> {
    let named = path.extension().is_some_and(|extension| extension != "bin");
    let starts = || {
        let mut start = [0; 4];
        let read = std::fs::File::open(path)
            .and_then(|mut file| std::io::Read::read_exact(&mut file, &mut start));
        read.is_ok() && &start == b"glTF"
    };
    (named || starts()).then(|| pipeline::import(path).map(drop))
}

/// The importer's place and fault, without the place of our own file.
pub(super) fn bad_asset(error: &pipeline::Error) -> Problem {
    let detail = match error {
        pipeline::Error::Scene { source, .. } => source.to_string(),
        other => other.to_string(),
    };
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "bad-asset", detail)
}
