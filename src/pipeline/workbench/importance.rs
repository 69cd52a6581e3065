//! How much each pose parameter matters to a model.

use super::Bench;
use crate::pipeline::recipe::Recipe;
use crate::pipeline::{Error, trim};

/// Poses that are looked at, at most.
const LOOKED_AT: usize = 12;

impl Bench<'_> {
    /// Names of parameters that go together, in ascending order of how much they change what a model
    /// says of some poses that it did not see: the mean square of the change where they are at the
    /// mean of the training poses.
    pub(in crate::pipeline) fn importance(
        &self,
        recipe: &Recipe,
    ) -> Result<Vec<Vec<String>>, Error> {
        let (encoding, training) = self.encoded(recipe)?;
        let model = self.fit(recipe, encoding, training)?.model;
        let groups = trim::groups(&encoding.rig.columns);
        let centre = &model.header().training.centre;
        let numbers = self.bench.base.points * self.bench.dataset.header().layout.row();
        let (mut plain, mut without) = (vec![0.0; numbers], vec![0.0; numbers]);
        let mut changes = vec![0.0; groups.len()];
        let step = self.left_out.len().div_ceil(LOOKED_AT).max(1);
        for &pose in self.left_out.iter().step_by(step) {
            let own = encoding.of(pose);
            self.predict_at(&model, own, pose, &mut plain)?;
            for (group, change) in groups.iter().zip(&mut changes) {
                let mut parameters = own.to_vec();
                group.iter().for_each(|&i| parameters[i] = centre.get(i).copied().unwrap_or(0.0));
                self.predict_at(&model, &parameters, pose, &mut without)?;
                let pairs = plain.iter().zip(&without);
                *change += pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            }
        }
        let mut order: Vec<usize> = (0..groups.len()).collect();
        order.sort_by(|&a, &b| changes[a].total_cmp(&changes[b]));
        let name = |&i: &usize| encoding.names[i].clone();
        Ok(order.into_iter().map(|group| groups[group].iter().map(name).collect()).collect())
    }
}
