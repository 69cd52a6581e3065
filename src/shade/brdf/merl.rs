//! Measured isotropic reflectances in the binary format of MERL (Matusik et al. 2003).
//!
//! Three 32-bit counts (90, 90, 180), then f64 numbers: three tables, red, green and blue, over
//! θ_h, θ_d and φ_d of Rusinkiewicz's half-angle frame, φ_d fastest; θ_h is on a square-root scale.

use std::f64::consts::{FRAC_PI_2, PI};

use super::analytic::{dot, half};
use super::{Reflectance, Sampling};

/// θ_h, θ_d, φ_d.
const SIZE: [usize; 3] = [90, 90, 180];

/// Cells of one colour.
const CELLS: usize = SIZE[0] * SIZE[1] * SIZE[2];

/// What stored numbers are multiplied with, by colour.
const SCALES: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];

/// Why a file is not such a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MerlError {
    /// Too short or too long.
    #[error("a MERL file has {expected} bytes, this one has {found}")]
    Length {
        /// 12 + 3 · 90 · 90 · 180 · 8.
        expected: usize,
        /// Given.
        found: usize,
    },
    /// Other counts at its head.
    #[error("a MERL file begins with the counts 90, 90, 180, this one with {0:?}")]
    Size([u32; 3]),
    /// Numbers that are NaN or infinite.
    #[error("{count} numbers of the MERL file are not finite")]
    NotFinite {
        /// How many.
        count: usize,
    },
}

/// A measured reflectance. Negative cells mean that there is no measurement; they reflect nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct Merl {
    cells: Vec<[f32; 3]>,
    missing: usize,
    /// Of the facets that mirror most.
    slope: f64,
}

impl Merl {
    /// What every file begins with: its counts.
    pub const HEAD: [u8; 12] = [90, 0, 0, 0, 90, 0, 0, 0, 180, 0, 0, 0];

    /// The bytes of every file: 35 MB.
    pub const BYTES: usize = 12 + 3 * CELLS * 8;

    /// Reads a file's bytes.
    ///
    /// # Errors
    /// [`MerlError`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, MerlError> {
        let expected = Self::BYTES;
        let (head, body) = bytes.split_at(bytes.len().min(12));
        let counts: Vec<u32> =
            head.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect();
        if let [a, b, c] = counts[..]
            && [a, b, c].map(|n| n as usize) != SIZE
        {
            return Err(MerlError::Size([a, b, c]));
        }
        if bytes.len() != expected {
            return Err(MerlError::Length { expected, found: bytes.len() });
        }
        let values: Vec<f64> =
            body.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        let count = values.iter().filter(|value| !value.is_finite()).count();
        if count > 0 {
            return Err(MerlError::NotFinite { count });
        }
        let missing = (0..CELLS).filter(|&i| (0..3).any(|c| values[c * CELLS + i] < 0.0)).count();
        let cell =
            |i: usize| std::array::from_fn(|c| (SCALES[c] * values[c * CELLS + i]).max(0.0) as f32);
        let cells: Vec<[f32; 3]> = (0..CELLS).map(cell).collect();
        let slope = slope(&cells);
        Ok(Self { cells, missing, slope })
    }

    /// The file of a reflectance, sampled at the middle of every cell: for tests and exchange.
    #[must_use]
    pub fn bytes_of(reflectance: &impl Reflectance) -> Vec<u8> {
        let mut out: Vec<u8> = SIZE.iter().flat_map(|&n| (n as u32).to_le_bytes()).collect();
        let cells: Vec<[f64; 3]> = (0..CELLS)
            .map(|i| {
                let [h, d, p] = [i / (SIZE[1] * SIZE[2]), i / SIZE[2] % SIZE[1], i % SIZE[2]]
                    .map(|k| k as f64 + 0.5);
                let theta_h = FRAC_PI_2 * (h / SIZE[0] as f64).powi(2);
                let (theta_d, phi_d) = (FRAC_PI_2 * d / SIZE[1] as f64, PI * p / SIZE[2] as f64);
                let (i, o) = from_half_angles(theta_h, theta_d, phi_d);
                reflectance.reflect(i, o)
            })
            .collect();
        for (c, scale) in SCALES.iter().enumerate() {
            out.extend(cells.iter().flat_map(|cell| (cell[c] / scale).to_le_bytes()));
        }
        out
    }

    /// Cells without a measurement, of 1,458,000.
    #[must_use]
    pub fn missing(&self) -> usize {
        self.missing
    }

    /// Between the middles of cells along one axis: the lower cell and the share of the next.
    fn between(place: f64, count: usize) -> (usize, f64) {
        let x = (place - 0.5).clamp(0.0, (count - 1) as f64);
        let low = (x.floor() as usize).min(count - 2);
        (low, x - low as f64)
    }
}

/// The slope of facets, as GGX would have it: it falls to half of its peak at 0.64 α. What is as strong
/// at a half angle of 45° is diffuse and counts as nothing.
fn slope(cells: &[[f32; 3]]) -> f64 {
    // Away from grazing, where Fresnel's part is another.
    let of = |h: usize| -> f64 {
        let row = &cells[h * SIZE[1] * SIZE[2]..][..SIZE[1] / 3 * SIZE[2]];
        row.iter().flatten().map(|&value| f64::from(value)).sum()
    };
    let theta = |h: usize| FRAC_PI_2 * ((h as f64 + 0.5) / SIZE[0] as f64).powi(2);
    let diffuse = of((0..SIZE[0]).find(|&h| theta(h) > FRAC_PI_2 / 2.0).unwrap_or(SIZE[0] - 1));
    let peak = (0..SIZE[0]).map(of).fold(0.0, f64::max) - diffuse;
    let last = (0..SIZE[0]).rev().find(|&h| peak > 0.0 && of(h) - diffuse > 0.5 * peak);
    last.map_or(1.0, |h| (theta(h + 1).tan() / 0.64).clamp(1e-3, 1.0))
}

/// The two directions with these half-angle coordinates; the half vector lies over +X.
fn from_half_angles(theta_h: f64, theta_d: f64, phi_d: f64) -> ([f64; 3], [f64; 3]) {
    let (hs, hc) = theta_h.sin_cos();
    let (ds, dc) = theta_d.sin_cos();
    let (ps, pc) = phi_d.sin_cos();
    let turned = |[x, y, z]: [f64; 3]| [hc * x + hs * z, y, hc * z - hs * x];
    (turned([ds * pc, ds * ps, dc]), turned([-ds * pc, -ds * ps, dc]))
}

impl Reflectance for Merl {
    fn reflect(&self, i: [f64; 3], o: [f64; 3]) -> [f64; 3] {
        if i[2] <= 0.0 || o[2] <= 0.0 {
            return [0.0; 3];
        }
        let h = half(i, o);
        let theta_h = h[2].clamp(-1.0, 1.0).acos();
        let theta_d = dot(i, h).clamp(-1.0, 1.0).acos();
        // ω_i in the frame of the half vector: turned about the normal, then about the bitangent.
        let radius = h[0].hypot(h[1]);
        let (c, s) = if radius > 0.0 { (h[0] / radius, h[1] / radius) } else { (1.0, 0.0) };
        let (x, y) = (c * i[0] + s * i[1], c * i[1] - s * i[0]);
        let along = h[2] * x - radius * i[2];
        // φ_d and φ_d + π are the same by reciprocity.
        let phi_d = y.atan2(along).rem_euclid(PI);
        let (h0, hf) = Self::between((theta_h / FRAC_PI_2).sqrt() * SIZE[0] as f64, SIZE[0]);
        let (d0, df) = Self::between(theta_d / FRAC_PI_2 * SIZE[1] as f64, SIZE[1]);
        let around = phi_d / PI * SIZE[2] as f64 - 0.5;
        let (p0, pf) = (around.floor(), around - around.floor());
        let p0 = p0.rem_euclid(SIZE[2] as f64) as usize;
        let mut out = [0.0; 3];
        for (dh, wh) in [(0, 1.0 - hf), (1, hf)] {
            for (dd, wd) in [(0, 1.0 - df), (1, df)] {
                for (p, wp) in [(p0, 1.0 - pf), ((p0 + 1) % SIZE[2], pf)] {
                    let cell = self.cells[((h0 + dh) * SIZE[1] + d0 + dd) * SIZE[2] + p];
                    let weight = wh * wd * wp;
                    out.iter_mut().zip(cell).for_each(|(out, v)| *out += weight * f64::from(v));
                }
            }
        }
        out
    }

    fn is_isotropic(&self) -> bool {
        true
    }

    fn sampling(&self) -> Sampling {
        // Wider ones need no other directions than a diffuse surface.
        if self.slope > 0.5 {
            return Sampling::Even;
        }
        Sampling::Facets { slopes: [self.slope; 2] }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Brdf;
    use super::*;

    /// A file that is written from a closed form reflects like it, between the cells too, in every
    /// colour and for directions on all sides.
    #[test]
    fn written_tables_reflect_like_their_source() {
        let source =
            Brdf::Phong { diffuse: [0.4, 0.2, 0.1], specular: [0.2, 0.3, 0.5], exponent: 6.0 };
        let merl = Merl::from_bytes(&Merl::bytes_of(&source)).unwrap();
        let direction =
            |theta: f64, phi: f64| [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        let mut worst = 0.0_f64;
        for k in 0..200 {
            let k = f64::from(k);
            let i = direction((k * 0.37) % 1.3, k * 1.1);
            let o = direction((k * 0.53 + 0.1) % 1.3, k * 2.3);
            for (a, b) in merl.reflect(i, o).iter().zip(source.reflect(i, o)) {
                worst = worst.max((a - b).abs());
            }
        }
        assert!(worst < 5e-3, "{worst}");
        assert!(merl.is_isotropic());
        assert_eq!(merl.reflect([0.0, 0.0, -1.0], [0.0, 0.0, 1.0]), [0.0; 3]);
    }

    /// The slope of a table's facets is about that of its source, beside diffuse light and without; a
    /// diffuse table has none.
    #[test]
    fn tables_tell_their_lobe() {
        let of = |brdf: Brdf| Merl::from_bytes(&Merl::bytes_of(&brdf)).unwrap().sampling();
        for alpha in [0.02, 0.2] {
            let ggx = Brdf::Ggx { normal_reflectance: [0.9; 3], alpha: [alpha; 2] };
            let Sampling::Facets { slopes: [x, y] } = of(ggx) else { panic!("no lobe") };
            assert!(x == y && (0.6..1.6).contains(&(x / alpha)), "{alpha}: {x}");
        }
        let (diffuse, specular) = ([0.5; 3], [0.3; 3]);
        let plastic = Brdf::AshikhminShirley { diffuse, specular, exponents: [500.0; 2] };
        let Sampling::Facets { slopes: [x, _] } = of(plastic) else { panic!("no lobe") };
        assert!((0.03..0.13).contains(&x), "{x}");
        assert_eq!(of(Brdf::Lambert { albedo: [0.5; 3] }), Sampling::Even);
    }

    /// Cut files, other counts and NaN are refused with their numbers; negative cells are counted
    /// and reflect nothing.
    #[test]
    fn bad_files_are_refused() {
        let mut bytes = Merl::bytes_of(&Brdf::Lambert { albedo: [0.5; 3] });
        let length = bytes.len();
        for end in [0, 5, 12, 100, length - 1] {
            let found = Merl::from_bytes(&bytes[..end]).unwrap_err();
            assert_eq!(found, MerlError::Length { expected: length, found: end });
        }
        bytes[12..20].copy_from_slice(&(-1.0_f64).to_le_bytes());
        assert_eq!(Merl::from_bytes(&bytes).unwrap().missing(), 1);
        bytes[20..28].copy_from_slice(&f64::NAN.to_le_bytes());
        assert_eq!(Merl::from_bytes(&bytes).unwrap_err(), MerlError::NotFinite { count: 1 });
        bytes[0] = 91;
        assert_eq!(Merl::from_bytes(&bytes).unwrap_err(), MerlError::Size([91, 90, 180]));
    }
}
