//! From exposed light to what a screen shows.

/// How bright light is brought within the screen's range. Differences are never tone-mapped.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Tone {
    /// As it is, cut off at white: numbers can be read off.
    #[default]
    Linear,
    /// A film's curve, x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14): dark parts darker, highlights
    /// rolled off (Narkowicz 2016's fit of the ACES output).
    Filmic,
}

impl Tone {
    /// The name, as settings have it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Filmic => "filmic",
        }
    }

    /// Exposed light to 0 to 1, still linear; NaN and what is negative to 0.
    #[must_use]
    pub fn apply(self, light: f32) -> f32 {
        // Beyond 1e4 the curve is white.
        let x = if light.is_nan() { 0.0 } else { light.clamp(0.0, 1e4) };
        match self {
            Self::Linear => x.min(1.0),
            Self::Filmic => (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).min(1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both curves rise from black to white and take anything; the film's is the published one.
    #[test]
    fn curves_rise_from_black_to_white() {
        for tone in [Tone::Linear, Tone::Filmic] {
            let values: Vec<f32> = (0..200).map(|i| tone.apply(i as f32 * 0.1)).collect();
            assert!(values.windows(2).all(|pair| pair[0] <= pair[1]), "{tone:?}");
            assert_eq!((values[0], values[199]), (0.0, 1.0), "{tone:?}");
            assert_eq!([f32::NAN, -1.0, f32::INFINITY].map(|x| tone.apply(x)), [0.0, 0.0, 1.0]);
        }
        assert_eq!(Tone::Linear.apply(0.37), 0.37);
        assert!((Tone::Filmic.apply(1.0) - 0.803_797).abs() < 1e-5);
        assert!((Tone::Filmic.apply(0.18) - 0.266_88).abs() < 1e-3);
    }
}
