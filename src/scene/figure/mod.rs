//! The bundled character: a skinned humanoid made by code, with four clips.
//!
//! One closed surface of about 7,000 vertices on 19 joints. `walk` and `jump` move through the
//! scene, `wave` and `crouch` stay in place; arms, legs and torso shade each other in all of them.
//! It exists so that everything can be tried without any file; `poselight sample figure` writes it.
//!
//! *Invariant:* the same bytes on every call.

mod body;
mod clips;
mod glb;
mod stance;
mod surface;
mod weights;

use glam::dvec3;
use surface::Grid;

/// The edge of a cell of the mesher, metres: sets the number of vertices.
const CELL_M: f64 = 0.0195;

/// The figure as the bytes of a GLB file: metres, +Y up, facing +Z, clips `walk`, `wave`, `crouch`
/// and `jump` at 30 Hz.
#[must_use]
pub fn figure() -> Vec<u8> {
    let joints = body::joints();
    let surface = surface::mesh(grid(), body::distance);
    let skins = weights::skin(&surface);
    let motions = clips::motions(&joints);
    glb::write(&joints, &surface, &skins, &motions)
}

/// The box around the figure, symmetric in x like the figure itself.
fn grid() -> Grid {
    const HALF_WIDTH: usize = 40;
    Grid {
        origin: dvec3(-(HALF_WIDTH as f64) * CELL_M, -2.3 * CELL_M, -0.22),
        cell_m: CELL_M,
        corners: [2 * HALF_WIDTH + 1, 96, 25],
    }
}

#[cfg(test)]
mod tests;
