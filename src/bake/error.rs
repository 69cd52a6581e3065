//! What can go wrong between posed meshes and their signals.

use crate::trace;

/// Why a bake could not be set up or finished.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The number of rays per point is out of range.
    #[error("{found} rays per point cannot be baked; choose 1 to {most}", most = super::MOST_RAYS)]
    Rays {
        /// What was asked for.
        found: u32,
    },
    /// The maximum distance is not a positive number.
    #[error("a maximum distance of {found} m blocks nothing; choose a positive number of metres")]
    MaxDistance {
        /// What was asked for.
        found: f32,
    },
    /// The minimum distance is no length below the maximum distance.
    #[error("a minimum distance of {found} m leaves nothing to block below {most} m")]
    MinDistance {
        /// What was asked for.
        found: f32,
        /// The maximum distance.
        most: f32,
    },
    /// The ground has no height.
    #[error("ground at {found} m is nowhere; give a finite height")]
    Ground {
        /// What was asked for.
        found: f32,
    },
    /// The exponent of the fall-off is not a positive number.
    #[error("a fall-off of {found} is no exponent; choose a positive number, such as 1 or 2")]
    Falloff {
        /// What was asked for.
        found: f32,
    },
    /// A fall-off without what it needs.
    #[error("a fall-off needs the signal ao and a maximum distance over which to fall")]
    FalloffOf,
    /// The target noise is not a positive number.
    #[error("a noise of {found} is not to be had; choose a positive standard error, such as 0.01")]
    Noise {
        /// What was asked for.
        found: f32,
    },
    /// There is nothing to spread sites on.
    #[error(
        "no triangle has an area and points on all corners: there is nothing to fit vertices to"
    )]
    NoSurface,
    /// Sites per point out of range.
    #[error("{found} samples per vertex cannot be fitted; choose 1 to {most}", most = super::MOST_SITES)]
    Sites {
        /// What was asked for.
        found: u32,
    },
    /// A fit of vertices with bounces or a target noise.
    #[error("a least-squares vertex fit takes neither bounces nor a target noise")]
    FitOf,
    /// Diffusion below the surface of a signal that has no light.
    #[error("the signal {signal} has no light to diffuse below the surface; transfer has")]
    SubsurfaceOf {
        /// What was asked for.
        signal: &'static str,
    },
    /// A mean free path that is no length.
    #[error("a mean free path of {found} m diffuses nothing; choose a positive number of metres")]
    MeanFreePath {
        /// What was asked for.
        found: f32,
    },
    /// More is absorbed than is met.
    #[error(
        "an absorption of {found} per metre is not from 0 to below {most}, the inverse of the mean \
         free path"
    )]
    Absorption {
        /// What was asked for.
        found: f32,
        /// The inverse of the mean free path.
        most: f32,
    },
    /// No such glass.
    #[error("a refractive index of {found} is none of a material below a surface; choose 1 to 3")]
    Refraction {
        /// What was asked for.
        found: f32,
    },
    /// Bounces out of range.
    #[error("{found} bounces cannot be baked; choose 1 to {most}", most = super::MOST_BOUNCES)]
    Bounces {
        /// What was asked for.
        found: u32,
    },
    /// Bounces of a signal that has none.
    #[error("the signal {signal} has no bounces; transfer has")]
    BouncesOf {
        /// What was asked for.
        signal: &'static str,
    },
    /// Neither grey nor coloured.
    #[error("a surface reflects 1 or 3 channels, not {found}")]
    Channels {
        /// What was asked for.
        found: usize,
    },
    /// More views than trees can be numbered.
    #[error("{found} groups of meshes that see differently are more than 255")]
    Views {
        /// How many.
        found: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {vertices} vertices")]
    Triangle {
        /// Index of the triangle.
        triangle: usize,
        /// What it names.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// The maps between points and vertices contradict their sizes.
    #[error("the {map} of {key} is {value}, but there are only {limit}")]
    Points {
        /// `vertex of point` or `point of vertex`.
        map: &'static str,
        /// The index into the map.
        key: usize,
        /// What the map says.
        value: u32,
        /// How many there are of those.
        limit: usize,
    },
    /// A pose does not have the mesh's number of vertices.
    #[error(
        "pose {pose} has {positions} positions and {normals} normals, but the mesh has {vertices} \
         vertices"
    )]
    Shape {
        /// Index into the poses given.
        pose: usize,
        /// How many positions it has.
        positions: usize,
        /// How many normals it has.
        normals: usize,
        /// How many of both it should have.
        vertices: usize,
    },
    /// A vertex has no finite place.
    #[error("in pose {pose}, vertex {vertex} is at {position:?}, which is not finite")]
    NotFinite {
        /// Index into the poses given.
        pose: usize,
        /// Index of the vertex.
        vertex: usize,
        /// Where it is.
        position: [f32; 3],
    },
    /// The tracer did not start.
    #[error("the tracer did not start: {source}")]
    Tracer {
        /// What it says.
        source: trace::Error,
    },
    /// The tracer failed.
    #[error("pose {pose} could not be traced: {source}")]
    Trace {
        /// Index into the poses given.
        pose: usize,
        /// What the tracer says.
        source: trace::Error,
    },
    /// Somebody asked to stop.
    #[error("the bake was cancelled")]
    Cancelled,
}

impl Error {
    /// The same with the caller's own number of the pose in place of its index.
    #[must_use]
    pub fn numbered(mut self, number: impl Fn(usize) -> usize) -> Self {
        if let Self::Shape { pose, .. } | Self::NotFinite { pose, .. } | Self::Trace { pose, .. } =
            &mut self
        {
            *pose = number(*pose);
        }
        self
    }
}
