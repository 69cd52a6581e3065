//! Is anything in the way: one function per packet width.

use std::ptr;

use embree4_sys as sys;

use super::scene::Scene;
use super::{Aligned, mask};
use crate::trace::rays::Rays;

/// Single rays.
pub(super) fn by_1(scene: &Scene, rays: &Rays<'_>, blocked: &mut [u64]) {
    for lane in 0..rays.len() {
        let mut ray = Aligned(sys::RTCRay {
            org_x: rays.origin.x,
            org_y: rays.origin.y,
            org_z: rays.origin.z,
            tnear: rays.near,
            dir_x: rays.x[lane],
            dir_y: rays.y[lane],
            dir_z: rays.z[lane],
            tfar: rays.far,
            ..sys::RTCRay::default()
        });
        // SAFETY: the scene is committed and live, the ray is aligned and ours alone, and null
        // arguments are the documented way to ask for the defaults.
        unsafe { sys::rtcOccluded1(scene.raw(), &raw mut ray.0, ptr::null_mut()) };
        blocked[lane / 64] |= u64::from(is_blocked(ray.0.tfar)) << (lane % 64);
    }
}

/// Embree marks a blocked ray by an infinitely negative far end.
fn is_blocked(far: f32) -> bool {
    far == f32::NEG_INFINITY
}

/// One function that traces a block by packets: `$name`, of `$width` rays of type `$packet` by
/// Embree's `$query`.
macro_rules! by_packets {
    ($name:ident, $width:literal, $packet:ident, $query:ident) => {
        #[doc = concat!("Packets of ", stringify!($width), ".")]
        pub(super) fn $name(scene: &Scene, rays: &Rays<'_>, blocked: &mut [u64]) {
            const WIDTH: usize = $width;
            let mut packet = Aligned(sys::$packet {
                org_x: [rays.origin.x; WIDTH],
                org_y: [rays.origin.y; WIDTH],
                org_z: [rays.origin.z; WIDTH],
                tnear: [rays.near; WIDTH],
                ..sys::$packet::default()
            });
            let mut valid = mask::<WIDTH>(WIDTH);
            for start in (0..rays.len()).step_by(WIDTH) {
                let active = WIDTH.min(rays.len() - start);
                if active < WIDTH {
                    valid = mask(active);
                }
                let range = start..start + active;
                packet.0.dir_x[..active].copy_from_slice(&rays.x[range.clone()]);
                packet.0.dir_y[..active].copy_from_slice(&rays.y[range.clone()]);
                packet.0.dir_z[..active].copy_from_slice(&rays.z[range]);
                packet.0.tfar = [rays.far; WIDTH];
                // SAFETY: the scene is committed and live; packet and mask are aligned to 64
                // bytes, have the width of the function called and are ours alone; null arguments
                // are the documented way to ask for the defaults.
                unsafe {
                    sys::$query(valid.0.as_ptr(), scene.raw(), &raw mut packet.0, ptr::null_mut());
                }
                let mut bits = 0;
                for (lane, &far) in packet.0.tfar.iter().enumerate() {
                    bits |= u64::from(is_blocked(far)) << lane;
                }
                // The width divides 64, so a packet never straddles two words.
                blocked[start / 64] |= bits << (start % 64);
            }
        }
    };
}

by_packets!(by_4, 4, RTCRay4, rtcOccluded4);
by_packets!(by_8, 8, RTCRay8, rtcOccluded8);
by_packets!(by_16, 16, RTCRay16, rtcOccluded16);
