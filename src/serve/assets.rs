//! `/v1/assets/{sha256}`: files, uploaded once by their content.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{Path as PathPart, State};
use axum::http::{HeaderMap, Method, StatusCode};
use axum::response::Response;
use futures_util::StreamExt;
use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tokio::io::AsyncWriteExt;

use super::answer::{self, Params, blocking, content_length, is_sha256};
use super::problem::Problem;
use super::store::{Asset, hexadecimal};
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
    PathPart(sha256): PathPart<String>,
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
            drop(answer::bytes(&headers, body, READ_ANYWAY).await);
        }
        return again(&service, &asset).await;
    }
    check_room(&service, length).await?;
    let incoming = Arc::new(service.store.folder().incoming()?);
    let path = incoming.path().join(format!("asset.{}", extension.unwrap_or("bin")));
    let (bytes, found) = receive(body, &path, &service.settings.limits).await?;
    if bytes == 0 {
        return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "bad-asset", "it has no bytes"));
    }
    if found != sha256 {
        let detail = format!("the {bytes} bytes received have the SHA-256 {found}");
        return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "hash-mismatch", detail));
    }
    let worker = Arc::clone(&service);
    let shown = importing(&service, move || {
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
    let places = Arc::clone(&service.imports);
    let permit = places.acquire_owned().await.map_err(|error| Problem::internal(&error))?;
    blocking(move || {
        let _until_done = permit;
        work()
    })
    .await
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
    PathPart(sha256): PathPart<String>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let asset = lookup(&service, &sha256).await?.ok_or_else(|| Problem::not_found("asset"))?;
    let path = service.store.folder().asset(&sha256);
    files::immutable(&path, &sha256, "application/octet-stream", &method, &headers)
        .await
        .map(|response| files::with(response, "poselight-kind", &asset.kind))
}

async fn lookup(service: &Arc<Service>, sha256: &str) -> Result<Option<Asset>, Problem> {
    if !is_sha256(sha256) {
        return Ok(None);
    }
    let (service, sha256) = (Arc::clone(service), sha256.to_owned());
    blocking(move || Ok(service.store.asset(&sha256)?)).await
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

/// The extension of a file that the importer reads on its own.
fn extension(name: Option<&str>) -> Option<&'static str> {
    let extension = Path::new(name?).extension()?.to_str()?.to_ascii_lowercase();
    ["glb", "obj", "npz", "hdr", "exr", "zip"].into_iter().find(|known| *known == extension)
}

/// Refuses what is too large before it is sent.
async fn check_room(service: &Arc<Service>, length: Option<u64>) -> Result<(), Problem> {
    let limits = service.settings.limits;
    let length = length.unwrap_or(0);
    if length > limits.asset_bytes {
        return Err(too_large(limits.asset_bytes));
    }
    let worker = Arc::clone(service);
    let kept = blocking(move || Ok(worker.store.asset_bytes()?)).await?;
    if kept.saturating_add(length) > limits.assets_bytes {
        let detail = "all assets together would be over the limit";
        return Err(Problem::new(StatusCode::INSUFFICIENT_STORAGE, "storage-full", detail)
            .limit("assets_bytes", limits.assets_bytes));
    }
    Ok(())
}

pub(super) fn too_large(most: u64) -> Problem {
    let detail = format!("the asset has more than {most} bytes");
    Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "asset-too-large", detail)
        .limit("asset_bytes", most)
}

/// Streams a body to a file; its size and SHA-256.
async fn receive(body: Body, path: &PathBuf, limits: &Limits) -> Result<(u64, String), Problem> {
    let (most, idle_s) = (limits.asset_bytes, limits.idle_s);
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
        hasher.update(&chunk);
        file.write_all(&chunk).await.map_err(io)?;
    }
    file.flush().await.map_err(io)?;
    file.sync_all().await.map_err(io)?;
    Ok((bytes, hexadecimal(&hasher.finalize())))
}

/// Imports a scene, and moves a sound file to its place.
fn keep(
    service: &Service,
    path: &Path,
    sha256: &str,
    bytes: u64,
    is_bundle: bool,
) -> Result<Asset, Problem> {
    let kind = if is_bundle {
        BUNDLE
    } else if is_map(path) {
        check_map(path)?;
        "light"
    } else {
        match check(path) {
            None => "file",
            Some(Ok(_)) => "scene",
            Some(Err(error)) => return Err(bad_asset(&error)),
        }
    };
    store::settle(path, &service.store.folder().asset(sha256))?;
    service.store.add_asset(sha256, bytes, kind)?;
    tracing::info!(sha256, bytes, kind, "asset");
    let asset = service.store.asset(sha256)?;
    asset.ok_or_else(|| Problem::internal(&"an asset that was just kept is gone"))
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
