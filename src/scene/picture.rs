//! Pictures: PNG and JPEG, decoded within bounds.

use std::io::Cursor;

use image::{DynamicImage, ImageReader, Limits};

use super::Error;
use super::budget::{Budget, Quantity};
use super::surface::Picture;

/// No side of a picture is longer: larger ones come from an attacker or belong in tiles.
const MOST_SIDE: u32 = 16_384;

/// Bytes of a texel while a picture is decoded: sixteen bits of four channels at most, eight bits of
/// them, and what is kept.
const DECODING_BYTES: u64 = 16;

/// Decodes a picture to 8-bit sRGB. Its size is counted before anything is allocated.
pub(super) fn decode(bytes: &[u8], place: &str, budget: &mut Budget) -> Result<Picture, Error> {
    let reader = || {
        let mut reader = ImageReader::new(Cursor::new(bytes));
        let mut limits = Limits::default();
        limits.max_image_width = Some(MOST_SIDE);
        limits.max_image_height = Some(MOST_SIDE);
        reader.limits(limits);
        reader.with_guessed_format().map_err(|fault| Error::invalid(place, fault.to_string()))
    };
    let undecodable = |fault: image::ImageError| {
        Error::invalid(place, format!("the picture cannot be decoded: {fault}"))
    };
    let (width, height) = reader()?.into_dimensions().map_err(undecodable)?;
    let texels = u64::from(width) * u64::from(height);
    budget.pass(Quantity::DecodedBytes, texels.saturating_mul(DECODING_BYTES), place)?;
    let decoded = reader()?.decode().map_err(undecodable)?;
    let picture = picture(decoded, width, height);
    budget.take(Quantity::DecodedBytes, picture.bytes(), place)?;
    Ok(picture)
}

fn picture(decoded: DynamicImage, width: u32, height: u32) -> Picture {
    let (texels, alpha) = if decoded.color().has_alpha() {
        let decoded = decoded.into_rgba8();
        let colour = |[r, g, b, _]: [u8; 4]| [r, g, b];
        let texels = decoded.pixels().map(|texel| colour(texel.0)).collect();
        (texels, decoded.pixels().map(|texel| texel.0[3]).collect())
    } else {
        (decoded.into_rgb8().pixels().map(|texel| texel.0).collect(), Vec::new())
    };
    Picture { width, height, texels, alpha }
}
