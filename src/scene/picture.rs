//! Pictures: PNG and JPEG, decoded within bounds.

use std::io::Cursor;

use image::{DynamicImage, ImageReader, Limits};

use super::Error;
use super::budget::{Budget, Quantity};
use super::surface::{Texture, Wrap};

/// No side of a picture is longer: larger ones come from an attacker or belong in tiles.
const MOST_SIDE: u32 = 16_384;

/// Decodes a picture to 8-bit sRGB. Its size is counted before anything is allocated.
pub(super) fn decode(bytes: &[u8], place: &str, budget: &mut Budget) -> Result<Texture, Error> {
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
    // What the decoder holds, and what we keep of it.
    let texels = u64::from(width) * u64::from(height);
    budget.take(Quantity::DecodedBytes, texels.saturating_mul(16), place)?;
    let picture = reader()?.decode().map_err(undecodable)?;
    Ok(texture(&picture, width, height))
}

fn texture(picture: &DynamicImage, width: u32, height: u32) -> Texture {
    let texels = picture.to_rgb8().pixels().map(|texel| texel.0).collect();
    let alpha = match picture.color().has_alpha() {
        true => picture.to_rgba8().pixels().map(|texel| texel.0[3]).collect(),
        false => Vec::new(),
    };
    Texture { width, height, texels, alpha, wrap: [Wrap::Repeat; 2] }
}
