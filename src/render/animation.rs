//! Pictures one after another in one file.

use super::Picture;

/// Why frames make no animation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AnimationError {
    /// No frame, or frames of different sizes.
    #[error("{frames} frames make no animation: there must be at least one, and all of one size")]
    Frames {
        /// Given.
        frames: usize,
    },
    /// A speed that is none.
    #[error("{0} frames per second is no speed; it must be 0.1 to 100")]
    Speed(f32),
    /// The encoder's objection.
    #[error("the animation could not be written: {0}")]
    Encode(#[from] png::EncodingError),
}

/// An animated PNG in sRGB that repeats for ever; programs that know no animation show the first
/// frame.
///
/// # Errors
/// [`AnimationError`].
pub fn animated_png(frames: &[Picture], per_second: f32) -> Result<Vec<u8>, AnimationError> {
    let count = frames.len();
    let size = frames.first().map(|frame| (frame.width(), frame.height()));
    let Some((width, height)) =
        size.filter(|_| frames.iter().all(|frame| Some((frame.width(), frame.height())) == size))
    else {
        return Err(AnimationError::Frames { frames: count });
    };
    if !(0.1..=100.0).contains(&per_second) {
        return Err(AnimationError::Speed(per_second));
    }
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_animated(count as u32, 0)?;
    encoder.set_frame_delay((1000.0 / per_second).round() as u16, 1000)?;
    let mut writer = encoder.write_header()?;
    for frame in frames {
        writer.write_image_data(&frame.bytes())?;
    }
    writer.finish()?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every frame is in the file with its delay, and readers of still pictures see the first one;
    /// other frames are refused.
    #[test]
    fn frames_survive_the_file() {
        let frame = |level: f32| Picture::new(5, 3, [level, 0.2, 0.9]);
        let frames: Vec<Picture> = [0.1, 0.5, 0.9].map(frame).to_vec();
        let file = animated_png(&frames, 12.5).unwrap();
        let first = image::load_from_memory(&file).unwrap().to_rgb8();
        assert_eq!(first.as_raw(), &frames[0].bytes());
        let mut reader = png::Decoder::new(std::io::Cursor::new(&file)).read_info().unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, 3);
        let mut buffer = vec![0; 45];
        for frame in &frames {
            reader.next_frame(&mut buffer).unwrap();
            assert_eq!(buffer, frame.bytes());
            let control = reader.info().frame_control().unwrap();
            assert_eq!((control.delay_num, control.delay_den), (80, 1000));
        }
        assert!(animated_png(&[], 10.0).is_err());
        assert!(animated_png(&[frame(0.1), Picture::new(4, 3, [0.0; 3])], 10.0).is_err());
        for speed in [0.0, f32::NAN, 1e9] {
            assert!(matches!(animated_png(&frames, speed), Err(AnimationError::Speed(_))));
        }
    }
}
