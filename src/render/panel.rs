//! Values to pixels: panels with captions and legends, side by side.

use super::{Image, Picture, Tone, colour, glyphs};

/// Behind the surface, linear.
const BACKGROUND: [f32; 3] = [0.18, 0.18, 0.18];

/// Behind captions, linear.
const PAPER: [f32; 3] = [0.9, 0.9, 0.9];

const INK: [f32; 3] = [0.02, 0.02, 0.02];

/// What is shown of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Panel<'a> {
    /// The values as light, times an exposure.
    Light {
        /// What is shown.
        image: &'a Image,
        /// What values are multiplied with before they are brought within the screen's range.
        exposure: f32,
        /// How they are.
        tone: Tone,
    },
    /// How far one image is from another in the colour map: the root mean square over the colours,
    /// times an exposure; 1/gain and more is the last colour.
    Difference {
        /// A model's, say.
        image: &'a Image,
        /// The truth.
        truth: &'a Image,
        /// As for [`Panel::Light`].
        exposure: f32,
        /// 4 or 10, say.
        gain: f32,
    },
}

impl Panel<'_> {
    /// The pixels.
    ///
    /// # Panics
    /// If the two images of a difference are not of one size.
    #[must_use]
    pub fn picture(&self) -> Picture {
        let (Self::Light { image, .. } | Self::Difference { image, .. }) = self;
        let [width, height] = image.size.map(|s| s as usize);
        let mut picture = Picture::new(width, height, BACKGROUND);
        for (i, pixel) in picture.pixels_mut().iter_mut().enumerate() {
            let front = match *self {
                Self::Light { image, exposure, tone } => {
                    image.values[i].map(|value| tone.apply(value * exposure))
                }
                Self::Difference { image, truth, exposure, gain } => {
                    assert_eq!(image.size, truth.size, "images that are compared");
                    colour(gain * exposure * apart(image.values[i], truth.values[i]))
                }
            };
            let coverage = image.coverage[i];
            for (behind, front) in pixel.iter_mut().zip(front) {
                *behind = *behind * (1.0 - coverage) + front * coverage;
            }
        }
        picture
    }
}

/// The root mean square of the colours' differences.
fn apart(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>() / 3.0).sqrt()
}

impl Image {
    /// The root mean square difference of two images over what both show, each pixel by its
    /// coverage; 0 where there is nothing.
    ///
    /// # Panics
    /// If they are not of one size.
    #[must_use]
    pub fn rms_difference(&self, other: &Self) -> f32 {
        assert_eq!(self.size, other.size, "images that are compared");
        let (mut sum, mut weight) = (0.0_f64, 0.0_f64);
        for (i, (a, b)) in self.values.iter().zip(&other.values).enumerate() {
            let share = f64::from(self.coverage[i].min(other.coverage[i]));
            sum += share * f64::from(apart(*a, *b)).powi(2);
            weight += share;
        }
        if weight > 0.0 { (sum / weight).sqrt() as f32 } else { 0.0 }
    }
}

/// A panel with a line of text over it, and for a difference a legend below: the colour map from 0
/// to 1/gain with its ends and middle in `unit`. Panels of one sheet are of one height if they are
/// all captioned so, with room for a legend where any has one.
#[must_use]
pub fn captioned(panel: &Panel<'_>, caption: &str, unit: &str, legend_room: bool) -> Picture {
    let body = panel.picture();
    let scale = if body.width() < 240 { 1 } else { 2 };
    let line = (glyphs::LINE + 2) * scale;
    let legend = if legend_room { 2 * line + line / 2 } else { 0 };
    let mut out = Picture::new(body.width(), body.height() + line + legend, PAPER);
    glyphs::write(&mut out, caption, [2 * scale, 2 * scale], scale, INK);
    out.paste(&body, 0, line);
    if let (Panel::Difference { gain, .. }, true) = (panel, legend_room) {
        write_legend(&mut out, line + body.height(), scale, (*gain, unit));
    }
    out
}

fn write_legend(out: &mut Picture, top: usize, scale: usize, (gain, unit): (f32, &str)) {
    let line = (glyphs::LINE + 2) * scale;
    let margin = 4 * scale;
    let length = out.width().saturating_sub(2 * margin);
    for x in 0..length {
        let shade = colour(x as f32 / (length - 1).max(1) as f32);
        for y in 0..line - scale {
            out.set(margin + x, top + scale + y, shade);
        }
    }
    let text_top = top + line + 2 * scale;
    glyphs::write(out, "0", [margin, text_top], scale, INK);
    let end = format!("{} {unit}", number(1.0 / gain));
    let right = (margin + length).saturating_sub(glyphs::width(&end, scale));
    glyphs::write(out, &end, [right, text_top], scale, INK);
    let middle = number(0.5 / gain);
    let width = glyphs::width(&middle, scale);
    let left = (margin + length / 2).saturating_sub(width / 2);
    // Where a narrow panel leaves no room, the ends say enough.
    if left > margin + glyphs::width("0", scale) && left + width < right {
        glyphs::write(out, &middle, [left, text_top], scale, INK);
    }
}

/// As few digits as tell the number.
fn number(value: f32) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Pictures in rows of `columns`, with a gap between them.
///
/// # Panics
/// If `columns` is 0.
#[must_use]
pub fn sheet(pictures: &[Picture], columns: usize) -> Picture {
    const GAP: usize = 4;
    assert!(columns > 0, "a sheet has columns");
    let largest = |of: fn(&Picture) -> usize| pictures.iter().map(of).max().unwrap_or(0);
    let (width, height) = (largest(Picture::width), largest(Picture::height));
    let (across, down) = (columns.min(pictures.len()), pictures.len().div_ceil(columns));
    let size = |cells: usize, length: usize| cells * (length + GAP) + GAP;
    let mut out = Picture::new(size(across, width), size(down, height), PAPER);
    for (i, picture) in pictures.iter().enumerate() {
        let (column, row) = (i % columns, i / columns);
        out.paste(picture, size(column, width), size(row, height));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(values: &[f32], coverage: &[f32]) -> Image {
        let values = values.iter().map(|&v| [v; 3]).collect();
        Image { size: [coverage.len() as u32, 1], values, coverage: coverage.to_vec() }
    }

    /// Light is exposed and laid over the background by coverage; a difference of half the scale is
    /// the middle of the colour map, whatever its sign.
    #[test]
    fn panels_show_values() {
        let (model, truth) = (
            image(&[0.25, 9.0, 0.5], &[1.0, 1.0, 0.0]),
            image(&[0.375, 8.0, 0.5], &[1.0, 1.0, 0.0]),
        );
        let light = Panel::Light { image: &model, exposure: 2.0, tone: Tone::Linear }.picture();
        assert_eq!(light.pixels(), [[0.5; 3], [1.0; 3], BACKGROUND]);
        let difference =
            Panel::Difference { image: &model, truth: &truth, exposure: 1.0, gain: 4.0 };
        let pixels = difference.picture();
        assert_eq!(pixels.pixels(), [colour(0.5), colour(1.0), BACKGROUND]);
        let rms = model.rms_difference(&truth);
        assert!((rms - ((0.125_f32.powi(2) + 1.0) / 2.0).sqrt()).abs() < 1e-6);
        assert_eq!(image(&[0.0], &[0.0]).rms_difference(&image(&[1.0], &[0.0])), 0.0);
    }

    /// Captions and legends add the same room to every panel; the legend runs through the map and
    /// its numbers are as short as they can be.
    #[test]
    fn legends_and_sheets_have_their_places() {
        let flat = image(&[0.5; 60], &[1.0; 60]);
        let light = Panel::Light { image: &flat, exposure: 1.0, tone: Tone::Linear };
        let difference = Panel::Difference { image: &flat, truth: &flat, exposure: 1.0, gain: 4.0 };
        let with = captioned(&difference, "difference x4", "ao", true);
        let beside = captioned(&light, "model", "ao", true);
        assert_eq!((with.width(), with.height()), (beside.width(), beside.height()));
        assert!(captioned(&light, "model", "ao", false).height() < beside.height());
        assert!(with.pixels().contains(&colour(1.0)) && !beside.pixels().contains(&colour(1.0)));
        assert_eq!(
            [0.25, 0.125, 0.1, 0.05, 1.0].map(number),
            ["0.25", "0.125", "0.1", "0.05", "1"]
        );
        let all = sheet(&[with.clone(), beside.clone(), with], 2);
        assert_eq!((all.width(), all.height()), (2 * 64 + 4, 2 * (beside.height() + 4) + 4));
    }
}
