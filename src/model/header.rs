//! The JSON header of a model: the wire type of `proto/model.md`.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::Value;

pub(super) use super::limits;
use super::{Error, MeshIdentity, OccluderSizes, RestSizes, RigHeader};
use crate::sh::Order;

/// The version that this build writes, and the newest that it reads.
pub const FORMAT_VERSION: u32 = 1;

/// Gives an enum of unit variants its name in headers and messages.
macro_rules! named {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $text:literal),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub enum $name { $($(#[$variant_doc])* #[serde(rename = $text)] $variant),+ }

        impl $name {
            /// Every value, in order.
            pub const ALL: &[Self] = &[$(Self::$variant),+];

            /// The name in recipes, headers and messages.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $text),+ }
            }

            /// The value of this name.
            #[must_use]
            pub fn from_name(name: &str) -> Option<Self> {
                Self::ALL.iter().copied().find(|value| value.name() == name)
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}

named! {
    /// The form of the map from pose to signal.
    Family {
        /// The mean over the training poses.
        Mean = "mean",
        /// Ridge on all parameters.
        Linear = "linear",
        /// Ridge between principal components of poses and of outputs.
        PcaLinear = "pca-linear",
        /// Local ridges around several poses, blended.
        Multilinear = "multilinear",
        /// Clusters of points, each linear in the reduced pose.
        ClusteredLinear = "clustered-linear",
        /// Clusters of points, each quadratic in the reduced pose.
        ClusteredQuadratic = "clustered-quadratic",
        /// Clusters of points, each with tanh neurons.
        ClusteredTanh = "clustered-tanh",
    }
}

named! {
    /// What the numbers are. V(ω) is 1 where a ray escapes, n the shading normal.
    Signal {
        /// Ambient occlusion, (1/π) ∫ V (n·ω)₊ dω: one number from 0 to 1.
        Ao = "ao",
        /// vᵢ = ∫ V yᵢ dω, with V = 0 only where n·ω ≥ 0 and a ray is blocked; below the horizon V
        /// is 1. An unoccluded point is exactly (√4π, 0, …). (Nowrouzezahrai et al. 2009, eq. 1.)
        Visibility = "visibility",
        /// tᵢ = (1/π) ∫ V (n·ω)₊ yᵢ dω: albedo · (t · light) is the radiance that leaves a
        /// Lambertian surface; t₀·2√π is the ambient occlusion. (Nowrouzezahrai et al. 2007, §3.)
        Transfer = "transfer",
    }
}

impl Signal {
    /// Numbers per point and channel: 1 for ambient occlusion, n² else.
    #[must_use]
    pub fn coefficients(self, order: Order) -> usize {
        match self {
            Self::Ao => 1,
            Self::Visibility | Self::Transfer => order.coefficients(),
        }
    }
}

named! {
    /// The axes in which a model's coefficients are given.
    Frame {
        /// The character's root frame.
        Root = "root",
        /// The frame of each point's dominant bone: the root frame's axes, turned with the bone.
        Bone = "bone",
        /// The tangent frame of each point: +Z its posed normal, +X its posed tangent.
        Tangent = "tangent",
    }
}

named! {
    /// How a blob stores its numbers.
    Precision {
        /// 4 bytes.
        F32 = "f32",
        /// IEEE half, 2 bytes.
        F16 = "f16",
        /// 1 byte, and a scale per column.
        I8 = "i8",
    }
}

impl Precision {
    /// Bytes per number, scales not counted.
    #[must_use]
    pub const fn bytes(self) -> u64 {
        match self {
            Self::F32 => 4,
            Self::F16 => 2,
            Self::I8 => 1,
        }
    }
}

/// Everything about a model that is not a tensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// [`FORMAT_VERSION`] of the build that wrote it.
    pub format_version: u32,
    /// Which decoder the tensors are.
    pub family: Family,
    /// How the tensors are stored; set by `to_bytes`.
    pub precision: Precision,
    /// What the outputs are.
    pub signal: Signal,
    /// Number of harmonic bands, 1 to 10; 1 for `ao`, whose only coefficient is the value itself.
    pub order: u8,
    /// 1, or 3 for red, green, blue.
    pub channels: u8,
    /// Axes of the coefficients.
    pub frame: Frame,
    /// [`Header::conventions`]; a blob with others is refused.
    pub conventions: BTreeMap<String, String>,
    /// Whether the model says only what occlusion takes away: the unshadowed signal of the posed
    /// normal is then added to what the tensors give.
    #[serde(default, skip_serializing_if = "is_false")]
    pub unshadowed: bool,
    /// Sizes of the occluders, where the model has them; set by `Model::with_occluders`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub occluders: Option<OccluderSizes>,
    /// Sizes of the rest mesh, where the model carries it; set by `Model::with_rest`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest: Option<RestSizes>,
    /// What turns a tool's pose into parameters and bone rotations.
    pub rig: RigHeader,
    /// Which mesh the model belongs to.
    pub mesh: MeshIdentity,
    /// What the training poses were, for the distance to them.
    pub training: TrainingSummary,
    /// Measured errors by name, free in form.
    pub errors: BTreeMap<String, Value>,
    /// Where the model comes from.
    pub provenance: Provenance,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
fn is_false(flag: &bool) -> bool {
    !flag
}

/// The cloud of training poses in parameter space.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingSummary {
    /// How many poses.
    pub poses: u32,
    /// Mean of each parameter; what `linear` subtracts.
    pub centre: Vec<f32>,
    /// Standard deviation along each retained direction: the columns of the projection of
    /// `pca-linear`, of `directions` in the other families.
    pub deviations: Vec<f32>,
    /// Root mean square over the training poses of the distance to the retained subspace.
    pub residual_rms: f32,
    /// Mahalanobis distance ([`super::Distance`]) beyond which a pose is drawn towards the centre
    /// until it is no farther, so that a model does not say of far poses what it only knows of near
    /// ones: at least 0, which leaves the centre's values alone. Absent where poses are taken as
    /// they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<f32>,
    /// `[parameter, direction]`, for families without a projection; a tensor in the blob.
    #[serde(skip)]
    pub directions: Vec<f32>,
}

/// Lineage of a model.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Program and version, such as `poselight 0.1.0`.
    pub generator: String,
    /// The resolved recipe.
    pub recipe: Value,
    /// Stage → stable hash.
    pub hashes: BTreeMap<String, String>,
}

impl Header {
    /// What every number in this version means.
    #[must_use]
    pub fn conventions() -> BTreeMap<String, String> {
        [
            ("axes", "right-handed, +y up"),
            (
                "harmonics",
                "real, orthonormal, no Condon-Shortley sign, index l(l+1)+m, m=0 about +z",
            ),
            ("quaternions", "x, y, z, w"),
            ("transfer", "includes 1/pi"),
            ("units", "metres, radians"),
        ]
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .into()
    }

    /// Numbers per point and channel: n², or 1 for `ao`.
    #[must_use]
    pub fn coefficients(&self) -> usize {
        usize::from(self.order).pow(2)
    }

    /// Numbers per point: channels × coefficients.
    #[must_use]
    pub fn width(&self) -> usize {
        usize::from(self.channels) * self.coefficients()
    }

    /// The order as a checked type.
    ///
    /// # Panics
    /// If the header has not been checked.
    #[must_use]
    pub fn sh_order(&self) -> Order {
        Order::new(self.order).expect("a checked header has an order from 1 to 10")
    }

    /// Number of pose parameters.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.rig.columns.len()
    }

    /// Everything that can be checked without the tensors.
    pub(super) fn check(&self) -> Result<(), Error> {
        if self.format_version != FORMAT_VERSION {
            let found = self.format_version;
            return Err(Error::Version { found, supported: FORMAT_VERSION });
        }
        if self.conventions != Self::conventions() {
            return Err(field("conventions", "they are not those of this format version"));
        }
        if Order::new(self.order).is_err() {
            return Err(field("order", format!("{} is outside 1 to 10", self.order)));
        }
        if self.signal == Signal::Ao && self.order != 1 {
            return Err(field("order", "ambient occlusion has one coefficient, so order 1"));
        }
        if self.channels != 1 && self.channels != 3 {
            return Err(field("channels", format!("{} is neither 1 nor 3", self.channels)));
        }
        self.rig.check()?;
        self.mesh.check(self.rig.nodes.len())?;
        self.training.check(self.parameters())?;
        check_name("provenance.generator", &self.provenance.generator)
    }
}

impl TrainingSummary {
    fn check(&self, parameters: usize) -> Result<(), Error> {
        if self.centre.len() != parameters {
            let problem = format!("{} numbers for {parameters} parameters", self.centre.len());
            return Err(field("training.centre", problem));
        }
        if self.deviations.len() > parameters {
            return Err(field("training.deviations", "there are more than parameters"));
        }
        check_finite("training.centre", &self.centre)?;
        check_finite("training.deviations", &self.deviations)?;
        if self.deviations.iter().any(|&deviation| deviation <= 0.0) {
            return Err(field("training.deviations", "each must be positive"));
        }
        if !(self.residual_rms.is_finite() && self.residual_rms >= 0.0) {
            return Err(field("training.residual_rms", "it must be finite and not negative"));
        }
        if self.reach.is_some_and(|reach| !(reach.is_finite() && reach >= 0.0)) {
            return Err(field("training.reach", "it must be finite and not negative"));
        }
        check_finite("training.directions", &self.directions)
    }
}

pub(super) fn field(field: impl Into<String>, problem: impl Into<String>) -> Error {
    Error::Field { field: field.into(), problem: problem.into() }
}

pub(super) fn within(what: &'static str, found: u64, limit: u64) -> Result<(), Error> {
    if found > limit { Err(Error::Limit { what, found, limit }) } else { Ok(()) }
}

pub(super) fn check_name(place: &str, name: &str) -> Result<(), Error> {
    if name.len() as u64 > limits::NAME_BYTES {
        return Err(field(place, format!("a name of {} bytes", name.len())));
    }
    Ok(())
}

pub(super) fn check_index(place: &str, index: u32, count: usize) -> Result<(), Error> {
    if index as usize >= count {
        let (found, count) = (u64::from(index), count as u64);
        return Err(Error::OutOfRange { what: place.to_owned(), found, count });
    }
    Ok(())
}

pub(super) fn check_finite(what: &str, values: &[f32]) -> Result<(), Error> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(Error::NotFinite { what: what.to_owned(), index }),
        None => Ok(()),
    }
}
