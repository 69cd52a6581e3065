//! What triangles reflect, as the file says it.

use std::io::Cursor;
use std::sync::Arc;

use image::{ImageFormat, RgbImage};

use super::*;

const PLAIN: f32 = 0.25;

fn surfaced(maker: &Maker) -> Result<Surface, Error> {
    surfaced_with(maker.sources())
}

fn surfaced_with(sources: Vec<Source>) -> Result<Surface, Error> {
    let content = Content::Surface { plain: PLAIN, transparency: true };
    let scene = import_sources_content(sources, &Limits::default(), content)?;
    Ok(scene.surface.unwrap())
}

/// Two by two texels: red, green over blue, white.
fn png() -> Vec<u8> {
    let texels = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255; 3]].concat();
    let picture = RgbImage::from_raw(2, 2, texels).unwrap();
    let mut out = Cursor::new(Vec::new());
    picture.write_to(&mut out, ImageFormat::Png).unwrap();
    out.into_inner()
}

/// A triangle with texture coordinates and this material.
fn dressed(material: Value) -> Maker {
    let mut maker = Maker::new();
    let positions = maker.accessor("VEC3", &TRIANGLE);
    let uv = maker.accessor("VEC2", &[0.25_f32, 0.25, 0.75, 0.25, 0.25, 0.75]);
    let material = maker.push("materials", material);
    let attributes = json!({"POSITION": positions, "TEXCOORD_0": uv});
    let mesh = maker.mesh(&json!({"attributes": attributes, "material": material}));
    maker.root(json!({"mesh": mesh}));
    maker
}

/// A triangle under this picture.
fn pictured(image: Value, info: &Value) -> Maker {
    let factor = [0.5, 0.5, 1.0, 1.0];
    let mut maker = dressed(json!({
        "pbrMetallicRoughness": {"baseColorFactor": factor, "baseColorTexture": info}
    }));
    maker.push("images", image);
    maker.push("textures", json!({"source": 0}));
    maker
}

/// Parts without a material have the plain reflectance; a factor is one's own; shape alone does
/// not even look for pictures.
#[test]
fn factors_and_the_lack_of_them() {
    let plain = surfaced(&Maker::triangle()).unwrap();
    assert_eq!(plain.albedo(0, 0.3, 0.3), [PLAIN; 3]);
    assert!(plain.is_grey());
    let red = dressed(json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.0, 0.0, 1.0]}}));
    let surface = surfaced(&red).unwrap();
    assert_eq!(surface.albedo(0, 0.3, 0.3), [0.5, 0.0, 0.0]);
    assert!(!surface.is_grey());
    let lost = pictured(json!({"uri": "lost.png"}), &json!({"index": 0}));
    assert!(lost.scene().surface.is_none());
}

/// The corners of a textured triangle have their texels' colours times the factor, whether the
/// picture lies in the buffer, in a file or in a `data:` URI; a transform moves them.
#[test]
fn textures_reach_the_corners() {
    let corners = [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0]]
        .map(|c: [f32; 3]| c.map(|value| value.min(MOST_ALBEDO)));
    let check = |surface: &Surface| {
        for (place, expected) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)].into_iter().zip(corners) {
            assert_eq!(surface.albedo(0, place.0, place.1), expected);
        }
    };
    let mut embedded = pictured(json!({}), &json!({"index": 0}));
    let view = embedded.view(&png());
    embedded.document["images"][0] = json!({"bufferView": view, "mimeType": "image/png"});
    check(&surfaced(&embedded).unwrap());

    let beside = pictured(json!({"uri": "a%20b.png"}), &json!({"index": 0}));
    let mut sources = beside.sources();
    sources.push(Source { name: "a b.png".into(), bytes: png() });
    check(&surfaced_with(sources).unwrap());

    let text: String = png().iter().map(|byte| format!("%{byte:02x}")).collect();
    let uri = format!("data:image/png,{text}");
    check(&surfaced(&pictured(json!({"uri": uri}), &json!({"index": 0}))).unwrap());

    let transform = json!({"KHR_texture_transform": {"offset": [0.5, 0.5]}});
    let info = json!({"index": 0, "extensions": transform});
    let moved = surfaced(&pictured(json!({"uri": uri}), &info)).unwrap();
    assert_eq!(moved.albedo(0, 0.0, 0.0), [0.5, 0.5, MOST_ALBEDO]);
}

/// Vertex colours, of three or four components and of bytes, multiply.
#[test]
fn vertex_colours() {
    let with = |four: bool| {
        let mut maker = Maker::new();
        let positions = maker.accessor("VEC3", &TRIANGLE);
        let colours = if four {
            maker.normalized("VEC4", &[[255_u8, 0, 0, 9], [255, 255, 255, 9], [0; 4]].concat())
        } else {
            maker.accessor("VEC3", &[1.0_f32, 0., 0., 7., 1., 1., 0., 0., 0.])
        };
        let attributes = json!({"POSITION": positions, "COLOR_0": colours});
        let mesh = maker.mesh(&json!({"attributes": attributes}));
        maker.root(json!({"mesh": mesh}));
        surfaced(&maker).unwrap()
    };
    for four in [true, false] {
        let surface = with(four);
        assert_eq!(surface.albedo(0, 0.0, 0.0), [PLAIN, 0.0, 0.0]);
        assert_eq!(surface.albedo(0, 1.0, 0.0), [PLAIN; 3]);
        assert_eq!(surface.albedo(0, 0.0, 1.0), [0.0; 3]);
    }
}

/// A PNG that claims a size, without its data.
fn claimed(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = png();
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    // The chunk's CRC-32 over type and data.
    let crc = bytes[12..29].iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 }
        })
    });
    bytes[29..33].copy_from_slice(&(!crc).to_be_bytes());
    bytes
}

/// Pictures that are missing, broken, huge, or outside of their buffer are refused by name, before
/// anything of their size is allocated; so are indices that name nothing.
#[test]
fn hostile_pictures_are_refused() {
    let refusal = |bytes: &[u8]| {
        let maker = pictured(json!({"uri": "p.png"}), &json!({"index": 0}));
        let mut sources = maker.sources();
        sources.push(Source { name: "p.png".into(), bytes: bytes.to_vec() });
        surfaced_with(sources).expect_err("must be refused").to_string()
    };
    let whole = png();
    for cut in [0, 4, 20, whole.len() / 2] {
        let message = refusal(&whole[..cut]);
        assert!(message.starts_with("images[0]"), "{cut}: {message}");
    }
    assert!(refusal(&claimed(100_000, 2)).starts_with("images[0]"));
    let message = refusal(&claimed(16_000, 16_000));
    assert!(message.contains("`decoded_bytes`"), "{message}");

    let lost = pictured(json!({"uri": "lost.png"}), &json!({"index": 0}));
    let message = surfaced(&lost).unwrap_err().to_string();
    assert!(message.contains("lost.png"), "{message}");
    let escaping = pictured(json!({"uri": "../p.png"}), &json!({"index": 0}));
    assert!(surfaced(&escaping).is_err());
    let nothing = pictured(json!({}), &json!({"index": 0}));
    assert!(surfaced(&nothing).unwrap_err().to_string().contains("neither"));
    let astray = pictured(json!({"bufferView": 77}), &json!({"index": 0}));
    assert!(surfaced(&astray).is_err());
    let wrong = pictured(json!({"uri": "p.png"}), &json!({"index": 5}));
    assert!(surfaced(&wrong).is_err());
}

/// A square picture of this side, all red.
fn red(side: u32) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let picture = RgbImage::from_pixel(side, side, image::Rgb([255, 0, 0]));
    picture.write_to(&mut out, ImageFormat::Png).unwrap();
    out.into_inner()
}

/// Triangles of as many materials, each with its own texture, of these images.
fn wardrobe(images: &[String], textures: &[usize]) -> Maker {
    let mut maker = Maker::new();
    let positions = maker.accessor("VEC3", &TRIANGLE);
    let uv = maker.accessor("VEC2", &[0.25_f32, 0.25, 0.75, 0.25, 0.25, 0.75]);
    for uri in images {
        maker.push("images", json!({"uri": uri}));
    }
    for &image in textures {
        let texture = maker.push("textures", json!({"source": image}));
        let pbr = json!({"baseColorTexture": {"index": texture}});
        let material = maker.push("materials", json!({"pbrMetallicRoughness": pbr}));
        let attributes = json!({"POSITION": positions, "TEXCOORD_0": uv});
        let mesh = maker.mesh(&json!({"attributes": attributes, "material": material}));
        maker.root(json!({"mesh": mesh}));
    }
    maker
}

fn within(maker: &Maker, pictures: &[(String, Vec<u8>)], limit: u64) -> Result<Surface, Error> {
    let mut sources = maker.sources();
    let source =
        |(name, bytes): &(String, Vec<u8>)| Source { name: name.clone(), bytes: bytes.clone() };
    sources.extend(pictures.iter().map(source));
    let limits = Limits { decoded_bytes: limit, ..Limits::default() };
    let content = Content::Surface { plain: PLAIN, transparency: true };
    Ok(import_sources_content(sources, &limits, content)?.surface.unwrap())
}

/// Ten materials that share a picture share what it was decoded to, and count it once: a limit that one
/// picture just passes while it is decoded lets all of them through. Eight pictures of 1/64 of a side of
/// 4,096 fit into 1/4096 of the default limit, as eight whole ones fit into all of it.
#[test]
fn pictures_are_decoded_once() {
    let name = "p.png".to_owned();
    let maker = wardrobe(std::slice::from_ref(&name), &[0; 10]);
    let pictures = [(name, red(64))];
    // Ten parts of three vertices take a little, too.
    let surface = within(&maker, &pictures, 64 * 64 * 16 + 4096).unwrap();
    let of = |material: usize| {
        Arc::as_ptr(&surface.materials[material].texture.as_ref().unwrap().picture)
    };
    assert!((2..=10).all(|material| of(material) == of(1)));
    assert_eq!(surface.albedo(9, 0.2, 0.2), [MOST_ALBEDO, 0.0, 0.0]);
    assert!(within(&maker, &pictures, 64 * 64 * 16 - 1).is_err());

    let pictures: Vec<(String, Vec<u8>)> = (0..8).map(|i| (format!("{i}.png"), red(64))).collect();
    let names: Vec<String> = pictures.iter().map(|(name, _)| name.clone()).collect();
    let maker = wardrobe(&names, &[0, 1, 2, 3, 4, 5, 6, 7]);
    assert!(within(&maker, &pictures, Limits::default().decoded_bytes / 4096).is_ok());
}

/// A material that no triangle has may lack its picture, or name one outside of the folder; one that a
/// triangle has may not.
#[test]
fn unused_materials_need_no_picture() {
    for uri in ["lost.png", "../lost.png"] {
        let mut maker = Maker::triangle();
        maker.push("images", json!({"uri": uri}));
        maker.push("textures", json!({"source": 0}));
        let pbr = json!({"baseColorTexture": {"index": 0}});
        maker.push("materials", json!({"pbrMetallicRoughness": pbr}));
        assert_eq!(surfaced(&maker).unwrap().albedo(0, 0.3, 0.3), [PLAIN; 3]);
        maker.document["meshes"][0]["primitives"][0]["material"] = json!(0);
        let told = surfaced(&maker).unwrap_err().to_string();
        assert!(told.contains("lost.png"), "{told}");
    }
}

/// Files of before metallic-roughness say their colour and its picture as specular-glossiness, which comes
/// before what stands beside it; what it leaves out is white.
#[test]
fn specular_glossiness_has_a_diffuse_part() {
    let old = |diffuse: Value| {
        json!({
            "pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.0, 0.0, 1.0]},
            "extensions": {"KHR_materials_pbrSpecularGlossiness": diffuse},
        })
    };
    let grey = surfaced(&dressed(old(json!({"diffuseFactor": [0.1, 0.1, 0.1, 1.0]})))).unwrap();
    assert_eq!(grey.albedo(0, 0.3, 0.3), [0.1; 3]);
    assert_eq!(surfaced(&dressed(old(json!({})))).unwrap().albedo(0, 0.3, 0.3), [MOST_ALBEDO; 3]);
    let mut maker = dressed(old(json!({"diffuseTexture": {"index": 0}})));
    maker.push("images", json!({"uri": "old.png"}));
    maker.push("textures", json!({"source": 0}));
    let mut sources = maker.sources();
    sources.push(Source { name: "old.png".into(), bytes: png() });
    assert_eq!(surfaced_with(sources).unwrap().albedo(0, 0.0, 0.0), [MOST_ALBEDO, 0.0, 0.0]);
}

/// A texture whose only picture is of a format that is not read names the format and what to do, not a number
/// that no file has; with a picture beside it that one is taken.
#[test]
fn pictures_of_extensions_alone_are_named() {
    let with = |texture: Value| {
        let mut maker =
            dressed(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
        maker.push("images", json!({"uri": "a.png"}));
        maker.push("textures", texture);
        let mut sources = maker.sources();
        sources.push(Source { name: "a.png".into(), bytes: png() });
        surfaced_with(sources)
    };
    let webp = json!({"EXT_texture_webp": {"source": 0}});
    let fault = with(json!({"extensions": webp})).expect_err("refused").to_string();
    assert!(fault.contains("EXT_texture_webp") && fault.contains("PNG or JPEG"), "{fault}");
    assert!(with(json!({"extensions": webp, "source": 0})).is_ok());
    assert!(with(json!({})).expect_err("refused").to_string().contains("names no image"));
}
