//! What triangles reflect: base colour factor, base colour texture, vertex colours.

use std::sync::Arc;

use gltf::json::accessor::{ComponentType, Type};
use gltf::json::image::Image;
use gltf::json::material::{AlphaMode, Material as Json};
use gltf::json::mesh::{Primitive, Semantic};
use gltf::json::texture::{Info, WrappingMode};
use gltf::json::validation::Checked;

use super::File;
use super::accessor::Format;
use super::buffer::Sources;
use super::mesh::check_count;
use crate::rig::{Mesh, Part};
use crate::scene::budget::Quantity;
use crate::scene::error::Error;
use crate::scene::source::relative_name;
use crate::scene::surface::{Alpha, Material, Picture, Surface, Texture, Wrap};
use crate::scene::{picture, uri};

const FRACTIONS: &[(ComponentType, Option<bool>)] = &[
    (ComponentType::F32, None),
    (ComponentType::U8, Some(true)),
    (ComponentType::U16, Some(true)),
];
/// What files of before metallic-roughness have.
const GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";

const TEXCOORDS: Format = Format { kind: Type::Vec2, components: FRACTIONS };
const RGB: Format = Format { kind: Type::Vec3, components: FRACTIONS };
const RGBA: Format = Format { kind: Type::Vec4, components: FRACTIONS };

/// Where a texture's coordinates come from.
#[derive(Debug, Clone, Copy)]
struct Mapping {
    set: u32,
    offset: [f32; 2],
    /// Rows of rotation times scale.
    matrix: [[f32; 2]; 2],
}

/// The names of the external pictures that base colours use, each once.
pub(super) fn external(root: &gltf::json::Root) -> Vec<String> {
    let mut names = Vec::new();
    for material in &root.materials {
        let Some(info) = base(material).1 else { continue };
        let image = root.textures.get(info.index.value()).map(|texture| texture.source.value());
        let Some(uri) = image.and_then(|i| root.images.get(i)?.uri.as_ref()) else { continue };
        if uri::is_data(uri) {
            continue;
        }
        // A name that cannot be is told where a triangle needs it.
        if let Ok(name) = relative_name(uri)
            && !names.contains(&name)
        {
            names.push(name);
        }
    }
    names
}

/// Pictures, each decoded once however many textures show it.
struct Pictures<'a> {
    sources: &'a Sources<'a>,
    decoded: Vec<Option<Arc<Picture>>>,
}

/// The primitive that a part came from, and the number of its mesh.
fn primitive<'a>(root: &'a gltf::json::Root, part: &Part) -> Option<(usize, &'a Primitive)> {
    let mesh = root.nodes.get(part.source_node)?.mesh?.value();
    Some((mesh, root.meshes.get(mesh)?.primitives.get(part.primitive)?))
}

/// Reads what the mesh's triangles reflect. `plain` is the reflectance of parts without a material.
/// Pictures of materials that no part has are not looked at.
pub(super) fn read(
    file: &mut File,
    mesh: &Mesh,
    sources: &Sources,
    plain: f32,
) -> Result<Surface, Error> {
    let root = file.root;
    let parts = || mesh.parts.iter().filter_map(|part| Some((part, primitive(root, part)?)));
    let mut used = vec![false; root.materials.len()];
    for (part, (mesh, primitive)) in parts() {
        let Some(material) = primitive.material else { continue };
        let (index, count) = (material.value(), used.len());
        let Some(used) = used.get_mut(index) else {
            let place = format!("meshes[{mesh}].primitives[{}].material", part.primitive);
            return Err(Error::Reference { place, list: "materials", index, count });
        };
        *used = true;
    }
    let mut surface = Surface::plain([plain; 3], 0);
    let mut mappings = vec![None];
    let mut pictures = Pictures { sources, decoded: vec![None; root.images.len()] };
    for ((index, material), used) in root.materials.iter().enumerate().zip(used) {
        let (material, mapping) =
            read_material(file, (index, material), used.then_some(&mut pictures))?;
        surface.materials.push(material);
        mappings.push(mapping);
    }
    let textured = mappings.iter().any(Option::is_some);
    let (mut coloured, mut translucent) = (false, false);
    for (part, (_, primitive)) in parts() {
        let material = primitive.material.map_or(0, |material| material.value() + 1);
        surface.material.extend(part.triangles.clone().map(|_| material as u32));
        if textured {
            let uv = texture_coordinates(file, primitive, part, mappings[material])?;
            surface.uv.extend(corners(mesh, part, &uv));
        }
        let colours = colours(file, primitive, part)?;
        coloured |= colours.is_some();
        let colours = colours.unwrap_or_else(|| vec![[1.0; 4]; part.vertices.len()]);
        let rgb: Vec<[f32; 3]> = colours.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
        let alpha: Vec<f32> = colours.iter().map(|colour| colour[3]).collect();
        translucent |= alpha.iter().any(|&alpha| alpha < 1.0);
        surface.colour.extend(corners(mesh, part, &rgb));
        surface.alpha.extend(corners(mesh, part, &alpha));
    }
    if !coloured {
        surface.colour = Vec::new();
    }
    if !translucent {
        surface.alpha = Vec::new();
    }
    Ok(surface)
}

/// The values at the corners of a part's triangles.
fn corners<'a, T: Copy>(
    mesh: &'a Mesh,
    part: &'a Part,
    values: &'a [T],
) -> impl Iterator<Item = [T; 3]> + 'a {
    let triangles = mesh.triangles[part.triangles.clone()].iter();
    triangles.map(|triangle| triangle.map(|corner| values[corner as usize - part.vertices.start]))
}

fn texture_coordinates(
    file: &mut File,
    primitive: &Primitive,
    part: &Part,
    mapping: Option<Mapping>,
) -> Result<Vec<[f32; 2]>, Error> {
    let none = vec![[0.0; 2]; part.vertices.len()];
    let Some(mapping) = mapping else { return Ok(none) };
    let semantic = Checked::Valid(Semantic::TexCoords(mapping.set));
    let Some(accessor) = primitive.attributes.get(&semantic) else {
        file.notices.add(format!(
            "mesh {:?}: its material has a texture, but there is no TEXCOORD_{}",
            part.name, mapping.set
        ));
        return Ok(none);
    };
    let purpose = format!("TEXCOORD_{} of mesh {:?}", mapping.set, part.name);
    let elements = file.accessor(accessor.value(), &purpose, TEXCOORDS)?;
    check_count(&elements, part.vertices.len())?;
    let values = file.floats::<2>(&elements)?;
    let place = |[u, v]: [f32; 2]| {
        let along =
            |i: usize| mapping.matrix[i][0] * u + mapping.matrix[i][1] * v + mapping.offset[i];
        [along(0), along(1)]
    };
    Ok(values.into_iter().map(place).collect())
}

fn colours(
    file: &mut File,
    primitive: &Primitive,
    part: &Part,
) -> Result<Option<Vec<[f32; 4]>>, Error> {
    let Some(accessor) = primitive.attributes.get(&Checked::Valid(Semantic::Colors(0))) else {
        return Ok(None);
    };
    let purpose = format!("COLOR_0 of mesh {:?}", part.name);
    let kind = file.root.accessors.get(accessor.value()).map(|accessor| accessor.type_);
    let four = matches!(kind, Some(Checked::Valid(Type::Vec4)));
    let elements = file.accessor(accessor.value(), &purpose, if four { RGBA } else { RGB })?;
    check_count(&elements, part.vertices.len())?;
    let colours: Vec<[f32; 4]> = if four {
        file.finite_floats::<4>(&elements)?
    } else {
        file.finite_floats::<3>(&elements)?.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect()
    };
    Ok(Some(colours.into_iter().map(|colour| colour.map(|c| c.clamp(0.0, 1.0))).collect()))
}

/// Says which materials would let light through, where nobody asked.
pub(super) fn tell_alpha(file: &mut File) {
    for (index, material) in file.root.materials.iter().enumerate() {
        let mode = match material.alpha_mode {
            Checked::Valid(AlphaMode::Mask) => "masked",
            Checked::Valid(AlphaMode::Blend) => "blended",
            _ => continue,
        };
        let primitives = file.root.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let own = |primitive: &Primitive| {
            primitive.material.is_some_and(|material| material.value() == index)
        };
        if primitives.into_iter().any(own) {
            file.notices.add(format!(
                "materials[{index}] is {mode}: its triangles block as a whole unless transparency is asked for"
            ));
        }
    }
}

/// What a material reflects diffusely, and its texture: the base colour, or where the file has the older
/// specular-glossiness, its diffuse part.
fn base(material: &Json) -> ([f32; 4], Option<Info>) {
    let pbr = &material.pbr_metallic_roughness;
    let held = material.extensions.as_ref().and_then(|all| all.others.get(GLOSSINESS));
    let Some(gloss) = held else {
        return (pbr.base_color_factor.0, pbr.base_color_texture.clone());
    };
    let factor = gloss.get("diffuseFactor").cloned();
    let factor = factor.and_then(|json| serde_json::from_value(json).ok()).unwrap_or([1.0; 4]);
    let texture = gloss.get("diffuseTexture").cloned();
    (factor, texture.and_then(|json| serde_json::from_value(json).ok()))
}

fn read_material(
    file: &mut File,
    (index, json): (usize, &Json),
    pictures: Option<&mut Pictures<'_>>,
) -> Result<(Material, Option<Mapping>), Error> {
    let place = format!("materials[{index}]");
    let ([r, g, b, opacity], info) = base(json);
    if [r, g, b, opacity].iter().any(|value| !(0.0..=1.0).contains(value)) {
        file.notices.add(format!("{place}: a base colour outside 0 to 1 was clamped"));
    }
    // JSON has no NaN.
    let factor = [r, g, b].map(|value| value.clamp(0.0, 1.0));
    let opacity = opacity.clamp(0.0, 1.0);
    let alpha = match json.alpha_mode {
        Checked::Valid(AlphaMode::Mask) => Alpha::Mask(json.alpha_cutoff.map_or(0.5, |c| c.0)),
        Checked::Valid(AlphaMode::Blend) => Alpha::Blend,
        _ => Alpha::Opaque,
    };
    let double_sided = json.double_sided;
    let plain = Material { factor, texture: None, alpha, opacity, double_sided };
    let (Some(info), Some(pictures)) = (&info, pictures) else {
        return Ok((plain, None));
    };
    let texture = Some(Arc::new(read_texture(file, info, &place, pictures)?));
    Ok((Material { texture, ..plain }, Some(mapping(info))))
}

fn mapping(info: &Info) -> Mapping {
    let extension =
        info.extensions.as_ref().and_then(|all| all.others.get("KHR_texture_transform"));
    let field = |name: &str| extension.and_then(|json| json.get(name));
    let number = |json: Option<&serde_json::Value>, default: f32| {
        let value = json.and_then(serde_json::Value::as_f64).map(|value| value as f32);
        value.filter(|value| value.is_finite()).unwrap_or(default)
    };
    let pair = |name: &str, default: f32| {
        [0, 1].map(|i| number(field(name).and_then(|list| list.get(i)), default))
    };
    let (offset, scale) = (pair("offset", 0.0), pair("scale", 1.0));
    let (sin, cos) = number(field("rotation"), 0.0).sin_cos();
    let set = field("texCoord").and_then(serde_json::Value::as_u64);
    Mapping {
        set: set.and_then(|set| u32::try_from(set).ok()).unwrap_or(info.tex_coord),
        offset,
        matrix: [[cos * scale[0], sin * scale[1]], [-sin * scale[0], cos * scale[1]]],
    }
}

fn read_texture(
    file: &mut File,
    info: &Info,
    place: &str,
    pictures: &mut Pictures<'_>,
) -> Result<Texture, Error> {
    let root = file.root;
    let missing = |list, index, count| {
        let place = place.to_owned();
        Error::Reference { place, list, index, count }
    };
    let at = info.index.value();
    let texture =
        root.textures.get(at).ok_or_else(|| missing("textures", at, root.textures.len()))?;
    let source = texture.source.value();
    // The parser's word for none.
    if source == u32::MAX as usize {
        let held = texture.extensions.iter().flat_map(|extensions| extensions.others.keys()).next();
        let fault = held.map_or("it names no image".to_owned(), |name| {
            format!("its image is one of {name} alone, which is not read: export it as PNG or JPEG, at least beside")
        });
        return Err(Error::invalid(format!("textures[{at}], which {place} names"), fault));
    }
    let image =
        root.images.get(source).ok_or_else(|| missing("images", source, root.images.len()))?;
    let picture = if let Some(picture) = &pictures.decoded[source] {
        Arc::clone(picture)
    } else {
        let place = format!("images[{source}]");
        let bytes = image_bytes(file, image, &place, pictures.sources)?;
        let picture = Arc::new(picture::decode(&bytes, &place, file.budget)?);
        pictures.decoded[source] = Some(Arc::clone(&picture));
        picture
    };
    let sampler = texture.sampler.and_then(|sampler| root.samplers.get(sampler.value()));
    let wrap = |mode: Checked<WrappingMode>| match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        _ => Wrap::Repeat,
    };
    let wrap = sampler.map_or([Wrap::Repeat; 2], |s| [s.wrap_s, s.wrap_t].map(wrap));
    Ok(Texture { picture, wrap })
}

/// The encoded picture.
fn image_bytes(
    file: &mut File,
    image: &Image,
    place: &str,
    sources: &Sources,
) -> Result<Vec<u8>, Error> {
    let invalid = |fault: String| Error::invalid(place, fault);
    match (&image.uri, image.buffer_view) {
        (Some(uri), _) if uri::is_data(uri) => {
            file.budget.take(Quantity::DecodedBytes, uri.len() as u64, place)?;
            uri::decode_data(uri).map_err(invalid)
        }
        (Some(uri), _) => {
            let name = relative_name(uri).map_err(invalid)?;
            let found = sources.external.iter().find(|(known, _)| *known == name);
            match found {
                Some((_, Ok(bytes))) => Ok(bytes.to_vec()),
                Some((_, Err(fault))) => Err(invalid(fault.clone())),
                None => {
                    Err(invalid(format!("the picture {name:?} is not among the scene's files")))
                }
            }
        }
        (None, Some(view)) => {
            let (index, list) = (view.value(), &file.root.buffer_views);
            let view = list.get(index).ok_or_else(|| Error::Reference {
                place: place.to_owned(),
                list: "bufferViews",
                index,
                count: list.len(),
            })?;
            let bytes = file.buffers.get(view.buffer.value())?;
            let start = view.byte_offset.map_or(0, |offset| offset.0);
            let range = usize::try_from(start).ok().zip(
                start.checked_add(view.byte_length.0).and_then(|end| usize::try_from(end).ok()),
            );
            let found = range.and_then(|(start, end)| bytes.get(start..end));
            found
                .map(<[u8]>::to_vec)
                .ok_or_else(|| invalid("its bytes lie outside the buffer".into()))
        }
        (None, None) => Err(invalid("it has neither a uri nor a bufferView".into())),
    }
}
