//! Pixels of linear light, and their way to a PNG.

use std::io::Cursor;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageError};

/// The sRGB transfer function (IEC 61966-2-1): linear light 0 to 1 to what a file holds.
#[must_use]
pub fn to_srgb(linear: f32) -> f32 {
    // NaN becomes 0 here.
    let linear = linear.max(0.0);
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.min(1.0).powf(1.0 / 2.4) - 0.055
    }
}

/// A picture of linear sRGB colours.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

impl Picture {
    /// One colour all over.
    #[must_use]
    pub fn new(width: usize, height: usize, colour: [f32; 3]) -> Self {
        Self { width, height, pixels: vec![colour; width * height] }
    }

    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Row by row from the top.
    #[must_use]
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// The pixels, to be changed.
    pub fn pixels_mut(&mut self) -> &mut [[f32; 3]] {
        &mut self.pixels
    }

    /// Sets a pixel; outside of the picture nothing happens.
    pub fn set(&mut self, x: usize, y: usize, colour: [f32; 3]) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = colour;
        }
    }

    /// Copies another picture to a place; what sticks out is cut.
    pub fn paste(&mut self, other: &Self, left: usize, top: usize) {
        for (row, line) in other.pixels.chunks_exact(other.width.max(1)).enumerate() {
            for (column, &colour) in line.iter().enumerate() {
                self.set(left + column, top + row, colour);
            }
        }
    }

    /// Three bytes a pixel in sRGB; what is not between 0 and 1 is clamped, NaN is black.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        let byte = |c: &f32| (to_srgb(*c) * 255.0).round() as u8;
        self.pixels.iter().flat_map(|pixel| pixel.iter().map(byte)).collect()
    }

    /// The picture as a PNG file.
    ///
    /// # Errors
    /// What the encoder says, such as of a picture without pixels.
    pub fn png(&self) -> Result<Vec<u8>, ImageError> {
        let mut out = Cursor::new(Vec::new());
        let (width, height) = (self.width as u32, self.height as u32);
        PngEncoder::new(&mut out).write_image(
            &self.bytes(),
            width,
            height,
            ExtendedColorType::Rgb8,
        )?;
        Ok(out.into_inner())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The transfer function has the standard's values, is continuous where its parts meet, and
    /// every byte comes back through the inverse.
    #[test]
    fn srgb_is_the_standard() {
        for (linear, expected) in [(0.0, 0), (1.0, 255), (0.214_041_14, 128), (0.5, 188)] {
            assert_eq!((to_srgb(linear) * 255.0).round() as u8, expected);
        }
        assert!((to_srgb(0.003_130_8) - to_srgb(0.003_130_9)).abs() < 1e-5);
        for byte in 0..=255_u8 {
            let s = f32::from(byte) / 255.0;
            let linear = if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) };
            assert_eq!((to_srgb(linear) * 255.0).round() as u8, byte);
        }
    }

    /// A PNG decodes to the bytes that went in; too bright, negative and NaN are clamped.
    #[test]
    fn pictures_survive_the_file() {
        let mut picture = Picture::new(3, 2, [0.0; 3]);
        picture.set(1, 1, [7.0, -1.0, f32::NAN]);
        picture.set(9, 9, [1.0; 3]);
        let mut frame = Picture::new(4, 4, [0.214_041_14; 3]);
        frame.paste(&picture, 1, 1);
        let read = image::load_from_memory(&frame.png().unwrap()).unwrap().to_rgb8();
        assert_eq!(read.as_raw(), &frame.bytes());
        assert_eq!(read.get_pixel(2, 2).0, [255, 0, 0]);
        assert_eq!(read.get_pixel(0, 0).0, [128; 3]);
        assert!(Picture::new(0, 0, [0.0; 3]).png().is_err());
    }
}
