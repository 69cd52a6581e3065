//! Points inside other geometry: they get no light, and whoever modelled them may not know.

use std::sync::atomic::AtomicBool;

use rayon::prelude::*;

use super::kernel::{Scratch, bake_point};
use super::plan::Plan;
use super::seen::Sink;
use super::{Baker, Error, PosedMesh, Settings, Signal};
use crate::sh::Order;

/// Rays that look around at each point.
const RAYS: u32 = 32;

/// At least this share of what a buried point sees is seen from behind: the walls about it face
/// outwards. A room's face inwards, and its points are dark but not buried.
const FROM_BEHIND: f64 = 0.5;

impl Baker {
    /// Which points lie inside other geometry in a pose: every ray is blocked, and most of what they
    /// meet is met from behind.
    ///
    /// # Errors
    /// As [`Self::bake`]; [`Error::FitOf`] for a baker whose rays do not start at points.
    pub fn buried(&self, pose: &PosedMesh<'_>) -> Result<Vec<bool>, Error> {
        if self.stage.fit.is_some() {
            return Err(Error::FitOf);
        }
        let seed = self.plan.seed;
        let order = Order::new(1).unwrap_or(self.plan.order);
        let settings =
            Settings { signal: Signal::Ao, order, rays: RAYS, max_distance_m: None, seed };
        let plan = Plan::new(&settings)?;
        let mut posed = self.prepare(std::slice::from_ref(pose), 0, &AtomicBool::new(false))?;
        // Between the nearest and the furthest distance that count: beyond, nothing takes light away.
        let Some(posed) = posed.pop() else { return Ok(Vec::new()) };
        let scratch = || {
            let sink = Sink::new(&self.stage, pose.normals, usize::MAX, plan.rays());
            (Scratch::new(&plan), sink)
        };
        let is_buried = |(scratch, sink): &mut (Scratch, Sink<'_>), point: usize| {
            let mut open = [0.0];
            bake_point(&plan, &posed, point, scratch, Some(sink), &mut open);
            let fronts: usize = sink.take().batches().map(<[_]>::len).sum();
            let behind = 1.0 - fronts as f64 / plan.rays() as f64;
            open[0] <= 0.0 && behind >= FROM_BEHIND
        };
        Ok((0..self.points()).into_par_iter().map_init(scratch, is_buried).collect())
    }
}
