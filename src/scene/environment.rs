//! Environment maps: Radiance HDR and OpenEXR pictures, decoded within bounds.

use std::io::Cursor;

use image::codecs::hdr::HdrDecoder;
use image::codecs::openexr::OpenExrDecoder;
use image::{DynamicImage, ImageDecoder, ImageError};

use super::Error;

/// The most texels of a map, 8192 × 4096: 400 MB as decoded. Ten bands of harmonics see no more of
/// a larger map than of the same one made smaller.
pub const MOST_TEXELS: u64 = 8192 * 4096;

/// A decoded map, linear.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvironmentPicture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green and blue, row by row from the top, as the file has them: an EXR may hold
    /// negative numbers, infinities and NaN.
    pub texels: Vec<[f32; 3]>,
}

/// Decodes a Radiance HDR or OpenEXR file; which one it is its first bytes tell. An `EXPOSURE` of
/// the former is divided out. `name` stands in messages.
///
/// # Errors
/// Other formats, damage, and maps of more than [`MOST_TEXELS`] texels, before they are decoded.
pub fn environment(bytes: &[u8], name: &str) -> Result<EnvironmentPicture, Error> {
    let (decoder, scale) = opened(bytes, name)?;
    picture(decoder, name, scale)
}

/// What decoding it takes in memory, at most: the decoder's texels, as many that are ready, and both.
///
/// # Errors
/// As [`environment`], for what the header tells.
pub fn environment_bytes(bytes: &[u8], name: &str) -> Result<u64, Error> {
    let (decoder, _) = opened(bytes, name)?;
    Ok(28 * texels(&*decoder, name)?)
}

/// A decoder, and what its texels are multiplied with.
fn opened<'a>(bytes: &'a [u8], name: &str) -> Result<(Box<dyn ImageDecoder + 'a>, f32), Error> {
    let undecodable =
        |fault: ImageError| Error::invalid(name, format!("the map cannot be decoded: {fault}"));
    if bytes.starts_with(b"#?") {
        let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(undecodable)?;
        let exposure = decoder.metadata().exposure.unwrap_or(1.0);
        if !(exposure.is_finite() && exposure > 0.0) {
            return Err(Error::invalid(name, format!("its EXPOSURE is {exposure}")));
        }
        Ok((Box::new(decoder), 1.0 / exposure))
    } else if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        let decoder = OpenExrDecoder::with_alpha_preference(Cursor::new(bytes), Some(false));
        Ok((Box::new(decoder.map_err(undecodable)?), 1.0))
    } else {
        let fault = "is neither Radiance HDR (.hdr) nor OpenEXR (.exr)";
        Err(Error::invalid(name, fault))
    }
}

/// How many there are, within the bound.
fn texels(decoder: &dyn ImageDecoder, name: &str) -> Result<u64, Error> {
    let (width, height) = decoder.dimensions();
    let texels = u64::from(width) * u64::from(height);
    if texels == 0 || texels > MOST_TEXELS {
        let fault = format!(
            "has {width} × {height} texels; a map has at least one and at most {MOST_TEXELS} \
             (8192 × 4096): make it smaller, the light is the same"
        );
        return Err(Error::invalid(name, fault));
    }
    Ok(texels)
}

fn picture(
    decoder: Box<dyn ImageDecoder + '_>,
    name: &str,
    scale: f32,
) -> Result<EnvironmentPicture, Error> {
    texels(&*decoder, name)?;
    let (width, height) = decoder.dimensions();
    let decoded = DynamicImage::from_decoder(decoder).map_err(|fault| {
        Error::invalid(name, format!("the map of {width} × {height} is damaged: {fault}"))
    })?;
    let values = decoded.into_rgb32f().into_raw();
    let texels = values.as_chunks::<3>().0.iter().map(|texel| texel.map(|c| c * scale)).collect();
    Ok(EnvironmentPicture { width: width as usize, height: height as usize, texels })
}

#[cfg(test)]
mod tests {
    use image::codecs::hdr::HdrEncoder;
    use image::{ImageFormat, Rgb, Rgb32FImage};

    use super::*;

    fn hdr(width: usize, height: usize, texels: &[Rgb<f32>]) -> Vec<u8> {
        let mut bytes = Vec::new();
        HdrEncoder::new(&mut bytes).encode(texels, width, height).unwrap();
        bytes
    }

    fn exr(width: u32, height: u32, values: Vec<f32>) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let picture = Rgb32FImage::from_raw(width, height, values).unwrap();
        DynamicImage::from(picture).write_to(&mut bytes, ImageFormat::OpenExr).unwrap();
        bytes.into_inner()
    }

    /// Both formats come back texel by texel, the smallest map included; an exposure is taken out.
    #[test]
    fn maps_are_read_back() {
        let texels = [[1.0, 0.5, 0.25], [8.0, 0.0, 2.0]];
        let bytes = hdr(2, 1, &texels.map(Rgb));
        let map = environment(&bytes, "a.hdr").unwrap();
        assert_eq!((map.width, map.height, map.texels.as_slice()), (2, 1, &texels[..]));
        let text = String::from_utf8_lossy(&bytes[..10]).into_owned();
        assert_eq!(text, "#?RADIANCE");
        let exposed = [b"#?RADIANCE\nEXPOSURE=2\n", &bytes[11..]].concat();
        assert_eq!(environment(&exposed, "b.hdr").unwrap().texels[1], [4.0, 0.0, 1.0]);
        assert_eq!(environment_bytes(&bytes, "a.hdr").unwrap(), 2 * 28);
        let one = environment(&exr(1, 1, vec![1.5, -2.0, f32::INFINITY]), "c.exr").unwrap();
        assert_eq!(one.texels, [[1.5, -2.0, f32::INFINITY]]);
    }

    /// A header that claims 16384 × 8192 texels is refused by its size, damage and other formats by
    /// name, and nothing panics wherever a file is cut off.
    #[test]
    fn bad_maps_are_refused() {
        let refused = |bytes: &[u8], word: &str| {
            let message = environment(bytes, "sky").unwrap_err().to_string();
            assert!(message.contains("sky") && message.contains(word), "{message}");
        };
        let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8192 +X 16384\n";
        refused(huge, "16384 × 8192");
        refused(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 0 +X 0\n", "");
        refused(b"#?RADIANCE\nEXPOSURE=0\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n", "EXPOSURE");
        refused(b"\x89PNG\r\n", "neither");
        refused(b"", "neither");
        let (hdr, exr) = (hdr(9, 3, &[Rgb([1.0; 3]); 27]), exr(9, 3, vec![1.0; 81]));
        for bytes in [hdr, exr] {
            for end in 0..bytes.len() {
                assert!(environment(&bytes[..end], "sky").is_err(), "cut at {end}");
            }
        }
    }
}
