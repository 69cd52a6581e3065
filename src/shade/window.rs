//! Windows against ringing: bands that fade out instead of stopping.

use std::f64::consts::PI;

use super::Error;

/// A factor for every band, 1 for the constant one: the light keeps its mean and loses contrast.
///
/// Cutting a bright light off after n bands leaves waves around it, negative ones included (Sloan
/// 2008, "Stupid spherical harmonics tricks"). Nothing is windowed unless it is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Window {
    /// (1 + cos(πl/w))/2 below band w, 0 from there.
    Hann {
        /// w, in bands.
        width: f64,
    },
    /// sin(πl/w)/(πl/w) below band w, 0 from there.
    Lanczos {
        /// w, in bands.
        width: f64,
    },
    /// 1/(1 + λ l²(l+1)²): the least squared Laplacian for its closeness to the original.
    Laplacian {
        /// λ.
        strength: f64,
    },
}

impl Window {
    /// The window, if its parameter is finite and above 0.
    ///
    /// # Errors
    /// [`Error::Window`].
    pub fn checked(self) -> Result<Self, Error> {
        let (what, found) = match self {
            Self::Hann { width } | Self::Lanczos { width } => ("width", width),
            Self::Laplacian { strength } => ("strength", strength),
        };
        if found.is_finite() && found > 0.0 { Ok(self) } else { Err(Error::Window { what, found }) }
    }

    /// The factor of band `l`.
    #[must_use]
    pub fn factor(self, l: usize) -> f64 {
        let band = l as f64;
        match self {
            _ if l == 0 => 1.0,
            Self::Hann { width } | Self::Lanczos { width } if band >= width => 0.0,
            Self::Hann { width } => 0.5 + 0.5 * (PI * band / width).cos(),
            Self::Lanczos { width } => {
                let x = PI * band / width;
                x.sin() / x
            }
            Self::Laplacian { strength } => 1.0 / (1.0 + strength * (band * (band + 1.0)).powi(2)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every window keeps the mean, falls from band to band and never turns a band over.
    #[test]
    fn windows_fall_from_one() {
        for window in [
            Window::Hann { width: 4.0 },
            Window::Lanczos { width: 6.5 },
            Window::Laplacian { strength: 0.01 },
        ] {
            let factors: Vec<f64> = (0..10).map(|l| window.checked().unwrap().factor(l)).collect();
            assert_eq!(factors[0], 1.0);
            assert!(factors.windows(2).all(|pair| pair[1] <= pair[0] && pair[1] >= 0.0));
            assert!(factors[1] < 1.0, "{window:?}");
        }
        assert_eq!(Window::Hann { width: 4.0 }.factor(4), 0.0);
        assert!((Window::Hann { width: 4.0 }.factor(2) - 0.5).abs() < 1e-15);
    }

    /// Parameters that make no window are refused by name.
    #[test]
    fn windows_without_width_are_refused() {
        for width in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = Window::Lanczos { width }.checked().unwrap_err();
            assert!(error.to_string().contains("width"), "{error}");
        }
        assert!(Window::Laplacian { strength: f64::NAN }.checked().is_err());
    }
}
