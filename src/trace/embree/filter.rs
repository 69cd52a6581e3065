//! Hits that are asked about: cut-out materials, surfaces that block on one side.

use std::fmt;
use std::slice;
use std::sync::Arc;

use embree4_sys as sys;
use glam::Vec3;

/// A hit that may not count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Index into [`Filter::triangles`].
    pub index: usize,
    /// Weights of the triangle's second and third vertex.
    pub u: f32,
    /// As above.
    pub v: f32,
    /// (p₁ − p₀) × (p₂ − p₀), not unit.
    pub normal: Vec3,
    /// Of the ray, as given.
    pub direction: Vec3,
}

/// What says of a hit whether it counts.
type Counts = dyn Fn(&Candidate) -> bool + Send + Sync;

/// Triangles whose hits are asked about, and what answers. It is asked from any thread, in any order
/// and more than once, so it must be a function of the candidate alone, and must not panic: a panic
/// ends the process.
#[derive(Clone)]
pub struct Filter {
    /// Which triangles, ascending, each once.
    pub triangles: Vec<u32>,
    /// Whether the hit counts; a ray goes on through one that does not.
    pub counts: Arc<Counts>,
}

impl fmt::Debug for Filter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Filter").field("triangles", &self.triangles.len()).finish_non_exhaustive()
    }
}

/// Floats of a hit packet for each ray before the geometry's number: normal, u, v, triangle.
const HIT_FIELDS: usize = 6;

/// Floats of a ray packet for each ray up to the direction: origin, near, direction.
const RAY_FIELDS: usize = 7;

/// Asks the filter about each ray of a packet and clears the lanes of hits that do not count.
///
/// # Safety
/// Called by Embree with its own arguments, for a geometry whose user pointer is a live [`Filter`].
pub(super) unsafe extern "C" fn ask(arguments: *const sys::RTCFilterFunctionNArguments) {
    // SAFETY: Embree passes a pointer that is valid during the call.
    let arguments = unsafe { &*arguments };
    // SAFETY: the user pointer is that of the filter that the scene keeps alive; nothing changes it.
    let filter = unsafe { &*arguments.geometryUserPtr.cast::<Filter>().cast_const() };
    let lanes = arguments.N as usize;
    // SAFETY: a ray packet begins with 7 arrays of one float for each ray, and nobody writes to them
    // during the call.
    let ray = unsafe { slice::from_raw_parts(arguments.ray.cast::<f32>(), RAY_FIELDS * lanes) };
    // SAFETY: a hit packet begins with 6 arrays of one 32-bit word for each ray, as above.
    let hit = unsafe { slice::from_raw_parts(arguments.hit.cast::<f32>(), HIT_FIELDS * lanes) };
    // SAFETY: there is one integer for each ray, ours to change during the call.
    let valid = unsafe { slice::from_raw_parts_mut(arguments.valid, lanes) };
    let vector = |of: &[f32], first: usize, lane: usize| {
        Vec3::from_array([0, 1, 2].map(|axis| of[(first + axis) * lanes + lane]))
    };
    for (lane, valid) in valid.iter_mut().enumerate().filter(|(_, valid)| **valid == -1) {
        let candidate = Candidate {
            index: hit[5 * lanes + lane].to_bits() as usize,
            u: hit[3 * lanes + lane],
            v: hit[4 * lanes + lane],
            normal: vector(hit, 0, lane),
            direction: vector(ray, 4, lane),
        };
        if !(filter.counts)(&candidate) {
            *valid = 0;
        }
    }
}
