//! The binding to Embree 4: the only folder with `unsafe`.
//!
//! `embree4-sys` declares the functions after headers of version 4.2, the library may be newer.
//! Three things follow. Values that C chooses are integers here, never Rust enums (`ffi`). The
//! hit structures have room behind them, for newer libraries append a field (`nearest`). And no
//! argument structure is passed to queries: a null pointer means the library's own defaults, which
//! are what we want (incoherent rays). The one callback (`filter`) is that of a geometry.
#![allow(unsafe_code, reason = "the folder that calls C; each block states why it is sound")]

mod device;
mod ffi;
mod filter;
mod nearest;
mod occlusion;
mod scene;

pub use device::Device;
pub use filter::{Candidate, Filter};
pub use scene::Scene;

/// Fixed by `RTC_ALIGN` in the headers: a packet of n rays and its mask start at a multiple of
/// 4·n bytes. The largest serves all.
#[repr(C, align(64))]
struct Aligned<T>(T);

/// A packet's mask: all bits set where the ray takes part.
type Mask<const N: usize> = Aligned<[i32; N]>;

/// The first `active` of N rays take part.
fn mask<const N: usize>(active: usize) -> Mask<N> {
    Aligned(std::array::from_fn(|lane| if lane < active { -1 } else { 0 }))
}
