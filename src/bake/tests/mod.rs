//! Analytic truth, statistics with stated significance, byte identity, hostile input.

mod adaptive;
mod analytic;
mod bounces;
mod figure;
mod fitted;
mod hostile;
mod identity;
mod openings;
mod quality;
mod rooms;
mod statistics;
mod subsurface;
mod surrounded;

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::*;
use crate::rig::Points;

/// A mesh with one point per vertex, or only for the first few.
#[derive(Clone)]
pub(super) struct Body {
    /// All later vertices share one more point.
    pub(super) sensors: usize,
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Body {
    /// A sphere of radius 1, smooth normals.
    pub(super) fn sphere(levels: u32) -> Self {
        let (positions, triangles) = crate::trace::shapes::sphere(levels);
        Self { sensors: usize::MAX, normals: positions.clone(), positions, triangles }
    }

    pub(super) fn nothing() -> Self {
        Self { sensors: usize::MAX, positions: vec![], normals: vec![], triangles: vec![] }
    }

    /// A cube from -1 to 1 whose 24 vertices have their face's normal.
    pub(super) fn cube() -> Self {
        let mut body = Self::nothing();
        for axis in 0..6 {
            let pick = [Vec3::X, Vec3::Y, Vec3::Z][axis % 3];
            let normal = if axis < 3 { pick } else { -pick };
            let side = Vec3::new(pick.y, pick.z, pick.x);
            let up = normal.cross(side);
            body.quad([-side - up, side - up, side + up, -side + up].map(|c| c + normal));
        }
        body
    }

    /// Adds a flat quadrilateral, corners counter-clockwise seen from where its normals point.
    pub(super) fn quad(&mut self, corners: [Vec3; 4]) {
        let first = self.positions.len() as u32;
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        self.positions.extend(corners);
        self.normals.extend([normal; 4]);
        self.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i: u32| first + i)));
    }

    /// Adds another body.
    pub(super) fn append(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.normals.extend(&other.normals);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| first + i)));
    }

    pub(super) fn mapped(mut self, map: impl Fn(Vec3) -> Vec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p = map(*p));
        self
    }

    pub(super) fn points(&self) -> Points {
        let vertices = self.positions.len();
        let count = self.sensors.saturating_add(1).min(vertices);
        let point = |vertex: usize| vertex.min(self.sensors) as u32;
        Points {
            vertex: (0..count as u32).collect(),
            of_vertex: (0..vertices).map(point).collect(),
        }
    }

    pub(super) fn posed(&self, time_s: f32) -> PosedMesh<'_> {
        PosedMesh { positions: &self.positions, normals: &self.normals, clip_key: 7, time_s }
    }

    pub(super) fn baker(&self, settings: &Settings) -> Baker {
        Baker::new(&self.triangles, &self.points(), settings).unwrap()
    }

    pub(super) fn bake(&self, settings: &Settings, times_s: &[f32]) -> Vec<BakedPose> {
        let poses: Vec<PosedMesh<'_>> = times_s.iter().map(|&t| self.posed(t)).collect();
        self.baker(settings).bake(&poses, &AtomicBool::new(false)).unwrap()
    }
}

pub(super) fn settings(signal: Signal, rays: u32) -> Settings {
    let order = Order::new(6).unwrap();
    Settings { signal, order, rays, max_distance_m: None, seed: 1 }
}

pub(super) const SIGNALS: [Signal; 3] = [Signal::Ao, Signal::Visibility, Signal::Transfer];
