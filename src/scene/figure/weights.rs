//! Smooth skin weights: each vertex starts on its nearest limb, then weight diffuses over the
//! surface. Diffusion follows the skin, so a thigh never grips the other thigh beside it.

use glam::DVec3;

use super::body::{JOINTS, nearest_joint};
use super::surface::Surface;

/// Steps of diffusion: weight spreads over about the square root of this many edges.
const STEPS: usize = 14;
/// Weights below this are dropped before the four largest are kept.
const LEAST: f64 = 0.004;

/// The joints that move a vertex, heaviest first, with weights that sum to 1; unused ones are 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Skin {
    pub(super) joints: [u8; 4],
    pub(super) weights: [f32; 4],
}

/// The skin of every vertex.
pub(super) fn skin(surface: &Surface) -> Vec<Skin> {
    let edges = surface.edges();
    let start = |p: &DVec3| {
        let mut row = [0.0; JOINTS];
        row[nearest_joint(*p)] = 1.0;
        row
    };
    let mut rows: Vec<[f64; JOINTS]> = surface.positions.iter().map(start).collect();
    for _ in 0..STEPS {
        rows = edges.iter().enumerate().map(|(v, around)| diffuse(&rows, v, around)).collect();
    }
    rows.iter().map(strongest).collect()
}

/// Half of a vertex's own weights and half of its neighbours' mean.
fn diffuse(rows: &[[f64; JOINTS]], vertex: usize, around: &[u32]) -> [f64; JOINTS] {
    let mut row = rows[vertex].map(|weight| 0.5 * weight);
    let share = 0.5 / around.len() as f64;
    for &neighbour in around {
        for (sum, weight) in row.iter_mut().zip(&rows[neighbour as usize]) {
            *sum += share * weight;
        }
    }
    row
}

/// The four largest weights, made to sum to 1 in f32.
fn strongest(row: &[f64; JOINTS]) -> Skin {
    let mut order: Vec<usize> = (0..JOINTS).filter(|&joint| row[joint] > LEAST).collect();
    order.sort_by(|&a, &b| row[b].total_cmp(&row[a]));
    order.truncate(4);
    let total: f64 = order.iter().map(|&joint| row[joint]).sum();
    let mut skin = Skin { joints: [0; 4], weights: [0.0; 4] };
    for (slot, &joint) in order.iter().enumerate() {
        skin.joints[slot] = joint as u8;
        skin.weights[slot] = (row[joint] / total) as f32;
    }
    skin.weights[0] = 1.0 - skin.weights[1..].iter().sum::<f32>();
    skin
}
