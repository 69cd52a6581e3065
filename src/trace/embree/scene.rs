//! A committed triangle mesh.

use std::ptr;
use std::sync::Arc;

use embree4_sys as sys;
use glam::Vec3;

use super::device::{Device, Handle};
use super::ffi;
use super::filter::{self, Filter};
use super::{nearest, occlusion};
use crate::trace::POSITION_LIMIT_M;
use crate::trace::error::{Code, Error};
use crate::trace::rays::{Hit, Rays, Width, words_of};

/// Triangles ready to be traced. It never changes, so threads share it freely.
#[derive(Debug)]
pub struct Scene {
    raw: sys::RTCScene,
    width: Width,
    triangles: usize,
    /// Of each geometry, the scene's number of every triangle; empty where there is no filter.
    numbers: Vec<Vec<u32>>,
    /// What Embree's callback points to: dropped after the scene is released, for fields drop after
    /// `Drop::drop`.
    _filter: Option<Arc<Filter>>,
    /// As above.
    _device: Arc<Handle>,
}

// SAFETY: the value owns its reference, and Embree lets any thread release a scene.
unsafe impl Send for Scene {}
// SAFETY: the scene is committed before a `Scene` exists and is never modified after; Embree
// allows any number of concurrent queries on a committed scene.
unsafe impl Sync for Scene {}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: the value owns one reference, given up exactly here.
        unsafe { sys::rtcReleaseScene(self.raw) };
    }
}

impl Scene {
    /// Builds the acceleration structure in the calling thread; the same input gives the same
    /// structure. Positions in metres; they are copied. Triangles of no area are never hit.
    /// Both sides of a triangle block.
    ///
    /// # Errors
    /// A triangle that names a missing vertex, a coordinate that is not finite or beyond
    /// [`POSITION_LIMIT_M`], more than 2³² − 1 vertices or triangles, or memory that runs out.
    pub fn build(
        device: &Device,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
    ) -> Result<Self, Error> {
        Self::build_filtered(device, positions, triangles, None)
    }

    /// As [`Self::build`], with triangles whose hits are asked about.
    ///
    /// # Errors
    /// As [`Self::build`]; a filter that names a triangle that does not exist.
    pub fn build_filtered(
        device: &Device,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        filter: Option<Filter>,
    ) -> Result<Self, Error> {
        check(positions, triangles)?;
        let filter = filter.filter(|filter| !filter.triangles.is_empty()).map(Arc::new);
        let numbers = match &filter {
            Some(filter) => parts(filter, triangles.len())?,
            None => Vec::new(),
        };
        let _ = ffi::take_error();
        let failed = |raw_error: Option<(Code, String)>| {
            let (code, message) = raw_error.unwrap_or((Code(0), String::new()));
            Error::Build { triangles: triangles.len(), code, message }
        };
        // SAFETY: the device is live.
        let raw = unsafe { sys::rtcNewScene(device.handle().raw()) };
        if raw.is_null() {
            return Err(failed(ffi::take_error()));
        }
        // From here on `Drop` releases the scene on every path.
        let scene = Self {
            raw,
            width: device.width(),
            triangles: triangles.len(),
            numbers,
            _filter: filter,
            _device: Arc::clone(device.handle()),
        };
        // SAFETY: the scene is live and not committed.
        unsafe { sys::rtcSetSceneBuildQuality(raw, sys::RTCBuildQuality::MEDIUM) };
        match (&scene._filter, scene.numbers.as_slice()) {
            (Some(filter), [solid, asked]) => {
                let of = |part: &[u32]| -> Vec<[u32; 3]> {
                    part.iter().map(|&number| triangles[number as usize]).collect()
                };
                attach(device, raw, positions, (&of(solid), None)).map_err(failed)?;
                let asked = of(asked);
                attach(device, raw, positions, (&asked, Some(filter))).map_err(failed)?;
            }
            _ => attach(device, raw, positions, (triangles, None)).map_err(failed)?,
        }
        commit(device, raw);
        match ffi::take_error() {
            None => Ok(scene),
            error => Err(failed(error)),
        }
    }

    /// How many triangles it was built from.
    #[must_use]
    pub fn triangles(&self) -> usize {
        self.triangles
    }

    /// Sets bit i % 64 of word i / 64 where anything blocks ray i, and clears it elsewhere; bits
    /// past the last ray are cleared too.
    ///
    /// # Panics
    /// If `blocked` is not [`words_of`] words long, or the rays' slices differ in length.
    pub fn occluded(&self, rays: &Rays<'_>, blocked: &mut [u64]) {
        self.occluded_by(self.width, rays, blocked);
    }

    /// As [`Self::occluded`] by packets of a given width, native or not. For tests and
    /// comparisons.
    ///
    /// # Panics
    /// As [`Self::occluded`].
    pub fn occluded_by(&self, width: Width, rays: &Rays<'_>, blocked: &mut [u64]) {
        assert_eq!(blocked.len(), words_of(rays.len()), "words for {} rays", rays.len());
        blocked.fill(0);
        match width {
            Width::One => occlusion::by_1(self, rays, blocked),
            Width::Four => occlusion::by_4(self, rays, blocked),
            Width::Eight => occlusion::by_8(self, rays, blocked),
            Width::Sixteen => occlusion::by_16(self, rays, blocked),
        }
    }

    /// Writes the nearest hit of each ray, or `None` where it escapes.
    ///
    /// # Panics
    /// If `hits` is not as long as the rays, or the rays' slices differ in length.
    pub fn nearest(&self, rays: &Rays<'_>, hits: &mut [Option<Hit>]) {
        self.nearest_by(self.width, rays, hits);
    }

    /// As [`Self::nearest`] by packets of a given width, native or not. For tests and
    /// comparisons.
    ///
    /// # Panics
    /// As [`Self::nearest`].
    pub fn nearest_by(&self, width: Width, rays: &Rays<'_>, hits: &mut [Option<Hit>]) {
        assert_eq!(hits.len(), rays.len(), "hits for {} rays", rays.len());
        match width {
            Width::One => nearest::by_1(self, rays, hits),
            Width::Four => nearest::by_4(self, rays, hits),
            Width::Eight => nearest::by_8(self, rays, hits),
            Width::Sixteen => nearest::by_16(self, rays, hits),
        }
    }

    /// The scene's number of a geometry's triangle.
    pub(super) fn number(&self, geometry: u32, triangle: u32) -> u32 {
        match self.numbers.get(geometry as usize) {
            Some(numbers) => numbers[triangle as usize],
            None => triangle,
        }
    }

    pub(super) fn raw(&self) -> sys::RTCScene {
        self.raw
    }
}

fn check(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), Error> {
    for (what, count) in [("vertices", positions.len()), ("triangles", triangles.len())] {
        if u32::try_from(count).is_err() {
            return Err(Error::TooMany { what, count });
        }
    }
    // Written so that NaN fails.
    let traceable = |p: &Vec3| p.abs().max_element() < POSITION_LIMIT_M && !p.is_nan();
    if let Some(vertex) = positions.iter().position(|p| !traceable(p)) {
        return Err(Error::Position { vertex, position: positions[vertex] });
    }
    let vertices = positions.len();
    for (triangle, corners) in triangles.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&corner| corner as usize >= vertices) {
            return Err(Error::Vertex { triangle, vertex, vertices });
        }
    }
    Ok(())
}

/// The triangles that are not asked about, and those that are.
fn parts(filter: &Filter, triangles: usize) -> Result<Vec<Vec<u32>>, Error> {
    if let Some(&triangle) = filter.triangles.iter().find(|&&t| t as usize >= triangles) {
        return Err(Error::Filter { triangle, triangles });
    }
    let asked = |triangle: &u32| filter.triangles.binary_search(triangle).is_ok();
    let solid = (0..triangles as u32).filter(|triangle| !asked(triangle)).collect();
    Ok(vec![solid, filter.triangles.clone()])
}

/// Builds in this thread.
///
/// Joining is what a thread does that lends itself to a build. A plain commit leaves TBB waiting
/// for a worker; when the next device comes or goes and thereby lifts the limit on workers for a
/// moment, one starts, and spins for the rest of the process: a core less for tracing.
fn commit(device: &Device, scene: sys::RTCScene) {
    if device.joins() {
        // SAFETY: the scene is live, no other thread knows of it, its geometry is committed.
        unsafe { sys::rtcJoinCommitScene(scene) };
    } else {
        // SAFETY: as above.
        unsafe { sys::rtcCommitScene(scene) };
    }
}

/// Copies triangles into buffers that Embree allocates (and pads) itself, and hands the geometry
/// over to the scene: under number 0, or 1 with a filter, which must outlive the scene. The error is
/// what Embree said, if anything.
fn attach(
    device: &Device,
    scene: sys::RTCScene,
    positions: &[Vec3],
    (triangles, filter): (&[[u32; 3]], Option<&Arc<Filter>>),
) -> Result<(), Option<(Code, String)>> {
    if triangles.is_empty() {
        return Ok(());
    }
    // SAFETY: the device is live.
    let raw = unsafe { sys::rtcNewGeometry(device.handle().raw(), sys::RTCGeometryType::TRIANGLE) };
    if raw.is_null() {
        return Err(ffi::take_error());
    }
    let geometry = Geometry(raw);
    let (vertex, index) = (sys::RTCBufferType::VERTEX, sys::RTCBufferType::INDEX);
    if let Some(filter) = filter {
        let pointer = Arc::as_ptr(filter).cast_mut().cast();
        // SAFETY: the geometry is live; Embree only hands the pointer back to the callback.
        unsafe { sys::rtcSetGeometryUserData(geometry.0, pointer) };
        // SAFETY: the geometry is live; the callback reads the filter behind the user pointer, which
        // the scene keeps until Embree has released it.
        unsafe { sys::rtcSetGeometryOccludedFilterFunction(geometry.0, Some(filter::ask)) };
        // SAFETY: as above.
        unsafe { sys::rtcSetGeometryIntersectFilterFunction(geometry.0, Some(filter::ask)) };
    }
    fill(&geometry, vertex, sys::RTCFormat::FLOAT3, bytemuck::cast_slice(positions))?;
    fill(&geometry, index, sys::RTCFormat::UINT3, bytemuck::cast_slice(triangles))?;
    // SAFETY: the geometry is live and both of its buffers are set.
    unsafe { sys::rtcCommitGeometry(geometry.0) };
    // SAFETY: both are live and belong to the same device; the scene takes its own reference.
    unsafe { sys::rtcAttachGeometryByID(scene, geometry.0, u32::from(filter.is_some())) };
    Ok(())
}

/// Owns one reference to a geometry until the scene has taken its own.
struct Geometry(sys::RTCGeometry);

impl Drop for Geometry {
    fn drop(&mut self) {
        // SAFETY: the value owns one reference, given up exactly here.
        unsafe { sys::rtcReleaseGeometry(self.0) };
    }
}

/// Gives the geometry a buffer of 12-byte elements with this content.
fn fill(
    geometry: &Geometry,
    kind: sys::RTCBufferType,
    format: sys::RTCFormat,
    content: &[[u8; 12]],
) -> Result<(), Option<(Code, String)>> {
    // SAFETY: the geometry is live and not committed; Embree allocates and owns the memory.
    let buffer =
        unsafe { sys::rtcSetNewGeometryBuffer(geometry.0, kind, 0, format, 12, content.len()) };
    if buffer.is_null() {
        return Err(ffi::take_error());
    }
    // SAFETY: not null; Embree has allocated at least stride × count bytes, nothing else refers to
    // them before the commit, bytes need no alignment, and the source cannot overlap them.
    unsafe { ptr::copy_nonoverlapping(content.as_ptr(), buffer.cast(), content.len()) };
    Ok(())
}
