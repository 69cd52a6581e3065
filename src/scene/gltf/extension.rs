//! Which glTF extensions are understood, harmless, or refused by name.

use gltf::json::{Root, buffer, mesh};

use super::instance::INSTANCING;
use crate::scene::budget::Notices;
use crate::scene::error::Error;

/// Extensions that say nothing about the surface or how it moves, by prefix.
const HARMLESS: &[&str] = &[
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "KHR_xmp",
    "KHR_audio",
    "EXT_texture_",
    "EXT_lights_",
    "MSFT_texture_dds",
    "MSFT_packing_",
    "ADOBE_materials_",
    "VRMC_materials_",
    "FB_geometry_metadata",
    "CESIUM_primitive_outline",
];

const QUANTIZATION: &str = "KHR_mesh_quantization";
const DRACO: &str = "KHR_draco_mesh_compression";
const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Pointers, which would add channels, and what chooses between nodes.
const IGNORED_IF_OPTIONAL: &[&str] = &["KHR_animation_pointer", "KHR_node_visibility", "MSFT_lod"];

/// Refuses what the file requires and we do not have; says what it could use and we leave out.
pub(super) fn check(root: &Root, notices: &mut Notices) -> Result<(), Error> {
    for (index, name) in root.extensions_required.iter().enumerate() {
        let harmless = HARMLESS.iter().any(|prefix| name.starts_with(prefix));
        if name != QUANTIZATION && name != INSTANCING && !harmless {
            let place = format!("extensionsRequired[{index}]");
            return Err(unsupported(name, place));
        }
    }
    for name in &root.extensions_used {
        if IGNORED_IF_OPTIONAL.contains(&name.as_str()) {
            notices.add(format!("the optional extension {name} was ignored"));
        }
    }
    Ok(())
}

/// Refuses a compressed view.
pub(super) fn check_view(view: &buffer::View, index: usize) -> Result<(), Error> {
    let held = view.extensions.as_ref().map(|extensions| &extensions.others);
    match held.and_then(|held| MESHOPT.iter().find(|&&name| held.contains_key(name))) {
        Some(name) => Err(unsupported(name, format!("bufferViews[{index}]"))),
        None => Ok(()),
    }
}

/// Whether a primitive's data lies in a compressed block. The uncompressed accessors beside it
/// are read where the file has them.
pub(super) fn check_primitive(
    root: &Root,
    primitive: &mesh::Primitive,
    place: &str,
) -> Result<(), Error> {
    let held = primitive.extensions.as_ref().map(|extensions| &extensions.others);
    if !held.is_some_and(|held| held.contains_key(DRACO)) {
        return Ok(());
    }
    let mut accessors = primitive.attributes.values().chain(&primitive.indices);
    let compressed = accessors.any(|index| {
        root.accessors.get(index.value()).is_some_and(|accessor| accessor.buffer_view.is_none())
    });
    if compressed { Err(unsupported(DRACO, place.to_owned())) } else { Ok(()) }
}

fn unsupported(name: &str, place: String) -> Error {
    let feature: String = name.chars().take(80).collect();
    let hint = if feature == DRACO || MESHOPT.contains(&name) {
        "; export the scene without mesh compression"
    } else {
        ""
    };
    Error::Unsupported { feature, place, hint }
}
