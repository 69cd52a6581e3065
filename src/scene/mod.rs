//! Rank 5. Import of glTF, OBJ and vertex sequences, with validation and limits: bytes in, a [`Scene`] out.
//!
//! A scene is the rest mesh with its skeleton ([`crate::rig`]) and the clips that move it; where
//! they are asked for ([`Content`]), also what its triangles reflect. What a file holds beyond that
//! (cameras, lights) is not looked at.
//!
//! Triangles wind as in the file, also under nodes of negative scale: which side faces outwards
//! then is a matter of the pose, and [`crate::rig::deform`] answers it by the normals.
//!
//! *Invariant:* nothing from a file is believed before it is checked: no count, length, index or
//! number. Memory and time are bounded by [`Limits`], whatever the file claims.
//! *Invariant:* only the file that the caller names is opened, and buffers that lie in the same
//! folder or below it.
//! *Invariant:* the only user of the `gltf` crate.

mod attach;
mod budget;
mod container;
mod elements;
mod environment;
mod error;
pub mod figure;
mod gathered;
mod gltf;
mod limits;
mod normals;
mod obj;
mod picture;
mod refine;
mod sequence;
mod source;
mod surface;
mod uri;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

pub use attach::{Attribute, attach};
pub use environment::{EnvironmentPicture, MOST_TEXELS, environment, environment_bytes};
pub use error::Error;
pub use gathered::as_glb;
pub use limits::Limits;
pub use refine::{RefinedPart, primitives, refine};
pub use surface::{Alpha, MOST_ALBEDO, Material, Picture, Surface, Texture, Wrap};

use crate::rig::{Deformed, Mesh, Pose, RigidFrame, Skeleton, deform};
use budget::{Budget, Notices};

/// Everything of a file that moves or is lit.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Nodes of the chosen scene and every joint of its skins, parents before children.
    pub skeleton: Skeleton,
    /// All triangles, in the file's order: node, primitive, vertex.
    pub mesh: Mesh,
    /// In the file's order; empty for a static scene.
    pub clips: Vec<Clip>,
    /// Whether the morph weights number the frames of a vertex sequence, and so say nothing of how
    /// near two poses are.
    pub is_sequence: bool,
    /// What the triangles reflect, where that was asked for.
    pub surface: Option<Surface>,
    /// The bytes all of this came from: the main file first, then external buffers and pictures.
    pub sources: Vec<Source>,
    /// What was mended or left out, one sentence each, for the user.
    pub notices: Vec<String>,
}

/// What is read of a file.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Content {
    /// Shape and motion.
    #[default]
    Shape,
    /// Also base colours, their textures and vertex colours.
    Surface {
        /// The reflectance of parts without a material, 0 to 1.
        plain: f32,
        /// Whether alpha counts; else materials that would let light through are told of.
        transparency: bool,
    },
}

/// One file of a scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// Relative to the folder of the main file, with `/` between parts.
    pub name: String,
    /// The file's content.
    pub bytes: Vec<u8>,
}

/// One animation.
#[derive(Debug, Clone, PartialEq)]
pub struct Clip {
    /// Unique within the scene; an unnamed one is `clip` and its number in the file.
    pub name: String,
    /// The latest key of any channel, seconds from 0.
    pub duration_s: f32,
    /// At most one per target.
    pub channels: Vec<Channel>,
}

/// How one property of one node moves over a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// What moves.
    pub target: Target,
    /// How values between keys come about.
    pub interpolation: Interpolation,
    /// Key times, finite, not negative, strictly ascending, at least one.
    pub times_s: Vec<f32>,
    /// `[key, component]`, or `[key, in-tangent | value | out-tangent, component]` for
    /// [`Interpolation::CubicSpline`] (tangents per second). 3 components for a translation
    /// (metres) or scale, 4 for a rotation (x, y, z, w; unit length unless cubic, never zero),
    /// one per slot for weights. All finite.
    pub values: Vec<f32>,
}

impl Channel {
    /// Numbers per key value: 3, 4 or the number of weight slots.
    #[must_use]
    pub fn components(&self) -> usize {
        match &self.target {
            Target::Translation(_) | Target::Scale(_) => 3,
            Target::Rotation(_) => 4,
            Target::Weights(slots) => slots.len(),
        }
    }
}

/// The property that a channel moves.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// Of a node, index into [`Skeleton::nodes`].
    Translation(usize),
    /// Of a node, index into [`Skeleton::nodes`].
    Rotation(usize),
    /// Of a node, index into [`Skeleton::nodes`].
    Scale(usize),
    /// Slots of [`crate::rig::Pose::weights`].
    Weights(Range<usize>),
}

/// How values between keys come about (glTF 2.0, appendix C).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// The earlier key's value.
    Step,
    /// Linear; along the shorter great circle for rotations.
    Linear,
    /// Cubic Hermite; rotations are normalised after.
    CubicSpline,
}

/// Reads a `.glb`, `.gltf`, `.obj` or `.npz` file, told apart by content where possible and else by
/// extension, together with its external buffers.
///
/// # Errors
/// See [`Error`]: each names the place in the file and what is wrong with it.
pub fn import(path: &Path, limits: &Limits) -> Result<Scene, Error> {
    import_content(path, limits, Content::Shape)
}

/// As [`import`], with a say in what is read.
///
/// # Errors
/// See [`Error`].
pub fn import_content(path: &Path, limits: &Limits, content: Content) -> Result<Scene, Error> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let bytes = source::read(path, limits)?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let main = Source { name, bytes };
    read(main, limits, content, |wanted| {
        let bytes = source::read_below(folder, &wanted, limits)?;
        Ok(Source { name: wanted, bytes })
    })
}

/// Finds what is wrong with a `.gltf` whose buffers are not at hand: its text, what it needs, and what
/// points nowhere in it. One that needs no other file is imported. Whether that was done.
///
/// # Errors
/// See [`Error`].
pub fn check_document(path: &Path, limits: &Limits) -> Result<bool, Error> {
    let bytes = source::read(path, limits)?;
    let (mut budget, mut notices) = (Budget::new(limits), Notices::default());
    let document = gltf::Document::parse(&bytes, &mut budget, &mut notices)?;
    let whole = gltf::check(&document, &mut budget, &mut notices)?;
    if whole {
        import(path, limits)?;
    }
    Ok(whole)
}

/// As [`import`], from memory: the main file first, external buffers found by name.
///
/// # Errors
/// See [`Error`].
pub fn import_sources(sources: Vec<Source>, limits: &Limits) -> Result<Scene, Error> {
    import_sources_content(sources, limits, Content::Shape)
}

/// As [`import_sources`], with a say in what is read.
///
/// # Errors
/// See [`Error`].
pub fn import_sources_content(
    sources: Vec<Source>,
    limits: &Limits,
    content: Content,
) -> Result<Scene, Error> {
    let mut sources = sources.into_iter();
    let main = sources
        .next()
        .ok_or_else(|| Error::UnknownFormat { file: "an empty list of sources".into() })?;
    for source in std::iter::once(&main).chain(sources.as_slice()) {
        source::check_size(&source.name, source.bytes.len() as u64, limits)?;
    }
    let mut others: BTreeMap<String, Vec<u8>> =
        sources.map(|source| (source.name, source.bytes)).collect();
    read(main, limits, content, |wanted| match others.remove(&wanted) {
        Some(bytes) => Ok(Source { name: wanted, bytes }),
        None => Err(format!("the file {wanted:?} is not among the scene's sources")),
    })
}

/// Reads the main file and what it draws on; `fetch` is asked once for each external buffer.
fn read(
    main: Source,
    limits: &Limits,
    content: Content,
    mut fetch: impl FnMut(String) -> Result<Source, String>,
) -> Result<Scene, Error> {
    let mut budget = Budget::new(limits);
    let mut notices = Notices::default();
    let mut sources = vec![main];
    let format = format(&sources[0])?;
    let (skeleton, mesh, clips, surface) = match format {
        Format::Sequence => {
            let (skeleton, mesh, clips) = sequence::read(&sources[0], &mut budget, &mut notices)?;
            let plain = |plain| Surface::plain([plain; 3], mesh.triangles.len());
            let surface = content.plain().map(plain);
            (skeleton, mesh, clips, surface)
        }
        Format::Obj => {
            let (skeleton, mesh) = obj::read(&sources[0], &mut budget, &mut notices)?;
            let plain = |plain| Surface::plain([plain; 3], mesh.triangles.len());
            let surface = content.plain().map(plain);
            (skeleton, mesh, Vec::new(), surface)
        }
        Format::Gltf => {
            let document = gltf::Document::parse(&sources[0].bytes, &mut budget, &mut notices)?;
            let mut missing = Vec::new();
            for name in gltf::external(&document, content, &mut budget)? {
                match fetch(name.clone()) {
                    Ok(source) => sources.push(source),
                    Err(fault) => missing.push((name, fault)),
                }
            }
            let found = sources[1..].iter().map(|s| (s.name.as_str(), Ok(s.bytes.as_slice())));
            let missing = missing.iter().map(|(name, fault)| (name.as_str(), Err(fault.clone())));
            let external = found.chain(missing).collect();
            let views = gltf::Sources { main: &sources[0].bytes, external };
            gltf::build(&document, &views, content, &mut budget, &mut notices)?
        }
    };
    check_extent(&mesh, &skeleton)?;
    count_degenerate(&mesh, &mut notices);
    let is_sequence = format == Format::Sequence;
    Ok(Scene { skeleton, mesh, clips, is_sequence, surface, sources, notices: notices.finish() })
}

impl Content {
    /// Whether materials that would let light through block as a whole.
    fn blocks_whole(self) -> bool {
        !matches!(self, Self::Surface { transparency: true, .. })
    }

    /// The reflectance of parts without a material, where reflectance is asked for.
    fn plain(self) -> Option<f32> {
        match self {
            Self::Shape => None,
            Self::Surface { plain, .. } => Some(plain),
        }
    }
}

/// The formats that are read.
#[derive(PartialEq)]
enum Format {
    Gltf,
    Obj,
    Sequence,
}

/// Told by content, and where that says nothing, by extension.
fn format(main: &Source) -> Result<Format, Error> {
    let text = main.bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&main.bytes);
    let starts_with = |byte| text.trim_ascii_start().first() == Some(&byte);
    if main.bytes.starts_with(b"PK\x03\x04") {
        return Ok(Format::Sequence);
    }
    if main.bytes.starts_with(b"glTF") || starts_with(b'{') {
        return Ok(Format::Gltf);
    }
    let extension = Path::new(&main.name).extension().unwrap_or_default().to_ascii_lowercase();
    match extension.to_str() {
        Some("obj") => Ok(Format::Obj),
        Some("gltf") => Ok(Format::Gltf),
        Some("glb") => {
            Err(Error::Glb { offset: 0, fault: "the file does not start with `glTF`".into() })
        }
        _ => Err(Error::UnknownFormat { file: main.name.clone() }),
    }
}

/// A character of no size, or beyond what single precision can trace, is refused.
fn check_extent(mesh: &Mesh, skeleton: &Skeleton) -> Result<(), Error> {
    let size_m = size_m(mesh, skeleton);
    if (1e-9..=1e9).contains(&size_m) { Ok(()) } else { Err(Error::Extent { size_m }) }
}

/// Triangles without area are kept, since vertex and triangle numbers are the file's, but said.
fn count_degenerate(mesh: &Mesh, notices: &mut Notices) {
    let flat = |triangle: &&[u32; 3]| {
        let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize].as_dvec3());
        (b - a).cross(c - a) == glam::DVec3::ZERO
    };
    let count = mesh.triangles.iter().filter(flat).count();
    if count > 0 {
        let all = mesh.triangles.len();
        notices.add(format!("{count} of {all} triangles have no area; they were kept"));
    }
}

/// The size of a character: the diagonal of its rest pose's bounding box, metres.
///
/// 0 for an empty mesh, infinite where a vertex of the rest pose is not finite.
#[must_use]
pub fn size_m(mesh: &Mesh, skeleton: &Skeleton) -> f32 {
    let rest = Pose::rest(skeleton, &mesh.default_weights);
    let globals = skeleton.globals(&rest.local);
    let mut posed = Deformed::default();
    deform(mesh, &globals, &rest.weights, RigidFrame::IDENTITY, &mut posed);
    if posed.positions.iter().any(|position| !position.is_finite()) {
        return f32::INFINITY;
    }
    let (mut low, mut high) = (glam::DVec3::INFINITY, glam::DVec3::NEG_INFINITY);
    for position in &posed.positions {
        low = low.min(position.as_dvec3());
        high = high.max(position.as_dvec3());
    }
    if posed.positions.is_empty() { 0.0 } else { (high - low).length() as f32 }
}

#[cfg(test)]
pub(crate) mod tests;
