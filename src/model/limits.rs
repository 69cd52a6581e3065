//! Bounds on what a header may claim; a blob may come from anybody.

/// Bytes of the safetensors header, which holds ours.
pub const HEADER_BYTES: u64 = 8 << 20;
/// Merged vertices, and vertices.
pub const POINTS: u64 = 1 << 26;
/// Pose parameters.
pub const PARAMETERS: u64 = 1 << 14;
/// Clusters of poses or of points.
pub const CLUSTERS: u64 = 1 << 12;
/// Output dimensions of `pca-linear`, or of a cluster.
pub const OUTPUTS: u64 = 1 << 12;
/// Nodes of the rig.
pub const NODES: u64 = 1 << 16;
/// Bones of a model in the bone frame.
pub const BONES: u64 = 1 << 16;
/// Bytes of any one name.
pub const NAME_BYTES: u64 = 1 << 10;
/// Parts of the mesh.
pub const PARTS: u64 = 1 << 16;
/// Spheres of a model with occluders.
pub const OCCLUDERS: u64 = 1 << 12;
/// Groups of spheres that a point tells apart.
pub const OCCLUDER_GROUPS: u64 = 1 << 8;
/// Directions in which the union of occluders is looked at.
pub const OCCLUDER_DIRECTIONS: u64 = 1 << 12;
