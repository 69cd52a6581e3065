//! An instance of the library.

use std::ptr;
use std::sync::Arc;

use embree4_sys as sys;
use sys::RTCDeviceProperty as Property;

use super::ffi;
use crate::trace::error::{Code, Error};
use crate::trace::rays::Width;

/// One build thread, and no binding of threads to cores: builds are deterministic and leave the
/// cores to rayon.
const CONFIG: &std::ffi::CStr = c"threads=1,set_affinity=0";

/// An instance of Embree that builds each scene in the thread that asks for it; several threads
/// may build at the same time.
#[derive(Debug, Clone)]
pub struct Device {
    handle: Arc<Handle>,
    widths: Vec<Width>,
    version: u32,
    joins: bool,
}

/// Owns one reference of the library's own count.
#[derive(Debug)]
pub(super) struct Handle(sys::RTCDevice);

// SAFETY: Embree's devices are thread-safe: any thread may make, commit and release scenes of a
// device; the error callback writes to storage of its own thread only.
unsafe impl Send for Handle {}
// SAFETY: as above; a shared handle offers nothing that is not thread-safe.
unsafe impl Sync for Handle {}

impl Handle {
    pub(super) fn raw(&self) -> sys::RTCDevice {
        self.0
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: the handle owns one reference, given up exactly here. Scenes hold their own.
        unsafe { sys::rtcReleaseDevice(self.0) };
    }
}

impl Device {
    /// Starts the library.
    ///
    /// # Errors
    /// [`Error::Device`] where the CPU lacks what Embree needs, or memory is short.
    pub fn new() -> Result<Self, Error> {
        // SAFETY: the configuration ends with a NUL and is only read during the call.
        let raw = unsafe { sys::rtcNewDevice(CONFIG.as_ptr()) };
        if raw.is_null() {
            // SAFETY: null is the documented way to ask why `rtcNewDevice` failed.
            let code = unsafe { ffi::rtcGetDeviceError(ptr::null_mut()) };
            return Err(Error::Device { code: Code(code), message: String::new() });
        }
        let handle = Arc::new(Handle(raw));
        // SAFETY: the device is live, the function is `extern "C"`, never unwinds and uses no
        // user pointer.
        unsafe { ffi::rtcSetDeviceErrorFunction(raw, Some(ffi::keep_error), ptr::null_mut()) };
        let native = [
            (Width::Four, Property::NATIVE_RAY4_SUPPORTED),
            (Width::Eight, Property::NATIVE_RAY8_SUPPORTED),
            (Width::Sixteen, Property::NATIVE_RAY16_SUPPORTED),
        ];
        let supported = native.into_iter().filter(|&(_, name)| property(&handle, name) != 0);
        let widths = std::iter::once(Width::One).chain(supported.map(|(width, _)| width)).collect();
        let version = u32::try_from(property(&handle, Property::VERSION)).unwrap_or_default();
        let joins = property(&handle, Property::JOIN_COMMIT_SUPPORTED) != 0;
        Ok(Self { handle, widths, version, joins })
    }

    /// The packet widths that this machine traverses natively, narrow to wide.
    #[must_use]
    pub fn widths(&self) -> &[Width] {
        &self.widths
    }

    /// The widest native packet: measured fastest for sorted directions from one origin, on
    /// AVX-512 (16) and on AVX2 (8).
    #[must_use]
    pub fn width(&self) -> Width {
        self.widths.last().copied().unwrap_or(Width::One)
    }

    /// The library's version, such as 40400 for 4.4.0.
    #[must_use]
    pub fn version(&self) -> u32 {
        self.version
    }

    /// Whether builds can be joined, see [`super::Scene::build`].
    pub(super) fn joins(&self) -> bool {
        self.joins
    }

    pub(super) fn handle(&self) -> &Arc<Handle> {
        &self.handle
    }
}

fn property(handle: &Handle, name: Property) -> isize {
    // SAFETY: the device is live and the property is one of the header's.
    unsafe { sys::rtcGetDeviceProperty(handle.raw(), name) }
}
