//! What is hit first: one function per packet width.

use std::ptr;

use embree4_sys as sys;
use glam::Vec3;

use super::scene::Scene;
use super::{Aligned, mask};
use crate::trace::rays::{Hit, Rays};

/// Ray and hit with room behind: since version 4.3 the library writes a further `instPrimID` per
/// ray and instance level after what the 4.2 headers know.
#[repr(C)]
struct Roomy<T, const N: usize> {
    packet: T,
    room: [[u32; N]; 16],
}

/// Single rays.
pub(super) fn by_1(scene: &Scene, rays: &Rays<'_>, hits: &mut [Option<Hit>]) {
    for (lane, out) in hits.iter_mut().enumerate() {
        let ray = sys::RTCRay {
            org_x: rays.origin.x,
            org_y: rays.origin.y,
            org_z: rays.origin.z,
            tnear: rays.near,
            dir_x: rays.x[lane],
            dir_y: rays.y[lane],
            dir_z: rays.z[lane],
            tfar: rays.far,
            ..sys::RTCRay::default()
        };
        let packet = sys::RTCRayHit { ray, hit: sys::RTCHit::default() };
        let mut query = Aligned(Roomy { packet, room: [[0; 1]; 16] });
        let pointer = (&raw mut query.0).cast();
        // SAFETY: the scene is committed and live, the ray is aligned and ours alone, with room
        // for what newer libraries append (the pointer spans it); null arguments are the
        // documented defaults.
        unsafe { sys::rtcIntersect1(scene.raw(), pointer, ptr::null_mut()) };
        let (ray, hit) = (query.0.packet.ray, query.0.packet.hit);
        *out = (hit.geomID != sys::RTC_INVALID_GEOMETRY_ID).then(|| Hit {
            distance: ray.tfar,
            triangle: scene.number(hit.geomID, hit.primID),
            u: hit.u,
            v: hit.v,
            normal: Vec3::new(hit.Ng_x, hit.Ng_y, hit.Ng_z),
        });
    }
}

/// One function that traces a block by packets: `$name`, of `$width` rays of type `$ray`, hits of
/// type `$hit`, both in `$packet`, by Embree's `$query`.
macro_rules! by_packets {
    ($name:ident, $width:literal, $ray:ident, $hit:ident, $packet:ident, $query:ident) => {
        #[doc = concat!("Packets of ", stringify!($width), ".")]
        pub(super) fn $name(scene: &Scene, rays: &Rays<'_>, hits: &mut [Option<Hit>]) {
            const WIDTH: usize = $width;
            let ray = sys::$ray {
                org_x: [rays.origin.x; WIDTH],
                org_y: [rays.origin.y; WIDTH],
                org_z: [rays.origin.z; WIDTH],
                tnear: [rays.near; WIDTH],
                ..sys::$ray::default()
            };
            let packet = sys::$packet { ray, hit: sys::$hit::default() };
            let mut query = Aligned(Roomy { packet, room: [[0; WIDTH]; 16] });
            for (block, out) in hits.chunks_mut(WIDTH).enumerate() {
                let active = out.len();
                let range = block * WIDTH..block * WIDTH + active;
                let valid = mask::<WIDTH>(active);
                let ray = &mut query.0.packet.ray;
                ray.dir_x[..active].copy_from_slice(&rays.x[range.clone()]);
                ray.dir_y[..active].copy_from_slice(&rays.y[range.clone()]);
                ray.dir_z[..active].copy_from_slice(&rays.z[range]);
                ray.tfar = [rays.far; WIDTH];
                query.0.packet.hit.geomID = [sys::RTC_INVALID_GEOMETRY_ID; WIDTH];
                let pointer = (&raw mut query.0).cast();
                // SAFETY: the scene is committed and live; packet and mask are aligned to 64
                // bytes, have the width of the function called and are ours alone, with room for
                // what newer libraries append (the pointer spans it); null arguments are the
                // documented defaults.
                unsafe {
                    sys::$query(valid.0.as_ptr(), scene.raw(), pointer, ptr::null_mut());
                }
                let sys::$packet { ray, hit } = &query.0.packet;
                for (lane, out) in out.iter_mut().enumerate() {
                    *out = (hit.geomID[lane] != sys::RTC_INVALID_GEOMETRY_ID).then(|| Hit {
                        distance: ray.tfar[lane],
                        triangle: scene.number(hit.geomID[lane], hit.primID[lane]),
                        u: hit.u[lane],
                        v: hit.v[lane],
                        normal: Vec3::new(hit.Ng_x[lane], hit.Ng_y[lane], hit.Ng_z[lane]),
                    });
                }
            }
        }
    };
}

by_packets!(by_4, 4, RTCRay4, RTCHit4, RTCRayHit4, rtcIntersect4);
by_packets!(by_8, 8, RTCRay8, RTCHit8, RTCRayHit8, rtcIntersect8);
by_packets!(by_16, 16, RTCRay16, RTCHit16, RTCRayHit16, rtcIntersect16);
