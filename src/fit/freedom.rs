//! How many parameters a cluster of points takes from its data: what the noise of a bake leaves in the
//! model is σ² times as many over the poses.
//!
//! A cluster's m outputs over p poses, about their means, are B (p × m). The model of them is H B V Vᵀ,
//! with V the k principal directions of B and H the hat matrix of the features. B V Vᵀ is U Uᵀ B too
//! (U the k left singular vectors), and noise N moves it by UUᵀN + NVVᵀ − UUᵀNVVᵀ to first order, for
//! the directions follow it. Hence the trace of the map from N to the model's change,
//!
//!   m + k tr H + (m − k) tr(Uᵀ H U),
//!
//! the m of the means. With all directions kept (k = m) it is m (1 + tr H), that of a plain regression.
//! Points that later lose their directions are counted with them, as in the training error.

/// What a map from features to a cluster's directions says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Freedom {
    /// tr H, the intercept not counted. Of neurons an estimate: their weights, shared evenly by the
    /// directions.
    pub(super) of_features: f64,
    /// tr(Uᵀ H U): the shares of the directions that the features hold, summed.
    pub(super) held: f64,
}

impl Freedom {
    /// Of neurons: so many `weights` without the biases of the outputs, which the means have, and at
    /// most the poses but one for each direction; `held` is the share of all directions' energy.
    ///
    /// No bound from either side: a penalty takes some of them away, the search for the best neurons
    /// may add some.
    pub(super) fn of_neurons(
        weights: usize,
        held: f64,
        (poses, directions): (usize, usize),
    ) -> Self {
        let most = poses.saturating_sub(1) as f64;
        let of_features = (weights as f64 / directions.max(1) as f64).min(most);
        Self { of_features, held: held.clamp(0.0, 1.0) * directions as f64 }
    }

    /// All parameters of a cluster with so many outputs, of which so many directions are kept.
    pub(super) fn parameters(&self, outputs: usize, directions: usize) -> f64 {
        let (m, k) = (outputs as f64, directions as f64);
        m + k * self.of_features + (m - k).max(0.0) * self.held
    }
}
