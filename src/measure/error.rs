//! What can be wrong with the figures that a measurement is fed.

/// Why a measurement cannot go on. Each variant carries the evidence.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// A slice has another length than the layout says.
    #[error("pose {pose}: {what} has {found} numbers, the layout asks for {expected}")]
    Length {
        /// Index of the pose in its data set.
        pose: usize,
        /// Which slice, such as `reference 1` or a candidate's name.
        what: String,
        /// Points × channels × coefficients, or points.
        expected: usize,
        /// What came.
        found: usize,
    },
    /// A coefficient is NaN or infinite.
    #[error(
        "pose {pose}: {what} is not finite at point {point}, coefficient {coefficient}; \
         the bake or the model that it came from is damaged"
    )]
    NotFinite {
        /// Index of the pose in its data set.
        pose: usize,
        /// Which slice.
        what: String,
        /// Index of the point.
        point: usize,
        /// Index among the point's channels and coefficients.
        coefficient: usize,
    },
    /// A normal has no direction.
    #[error("pose {pose}: the normal of point {point} has length {length}, not 1")]
    Normal {
        /// Index of the pose in its data set.
        pose: usize,
        /// Index of the point.
        point: usize,
        /// The length found; may be NaN.
        length: f32,
    },
    /// A pose came with other candidates than the settings announced.
    #[error("pose {pose}: candidates {found:?} were given where {expected:?} were announced")]
    Candidates {
        /// Index of the pose in its data set.
        pose: usize,
        /// Names in the settings' order.
        expected: Vec<String>,
        /// Names as they came.
        found: Vec<String>,
    },
    /// The settings name no model, several, or one name twice.
    #[error(
        "{models} candidates are marked as the model in {names:?}; exactly one must be, and every name must differ"
    )]
    Model {
        /// How many candidates have the kind `model`.
        models: usize,
        /// All names.
        names: Vec<String>,
    },
    /// The settings describe no signal: no points, no channels, or `ao` of an order above 1.
    #[error("{points} points of {channels} channels and order {order} make no {signal} signal")]
    Layout {
        /// Points announced.
        points: usize,
        /// Channels announced.
        channels: usize,
        /// SH order announced.
        order: usize,
        /// Signal's name.
        signal: &'static str,
    },
}
