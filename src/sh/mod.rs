//! Rank 1. Real spherical harmonics: basis, index, rotation, products, zonal functions.
//!
//! Convention of the whole crate: real, orthonormal over the sphere, no Condon–Shortley sign, so
//! band 1 is 0.488603 · (y, z, x); flat index i = l(l+1)+m; the axes are glTF's, so m = 0 is about
//! +Z. A function of *order* n has the bands 0..n-1, which are n² coefficients.
//!
//! *Invariant:* pure arithmetic over slices, no allocation except where a matrix is returned.

mod basis;
mod bent;
mod hemisphere;
mod product;
mod quadrature;
mod rotation;
pub mod zonal;

pub use basis::{evaluate, evaluate_f64, evaluate_lanes};
pub use bent::bent_normal;
pub use hemisphere::{cosine_product, cosine_product_pole, hemisphere_gram, hemisphere_gram_pole};
pub use product::TripleProduct;
pub use quadrature::gauss_legendre;
pub use rotation::Rotation;

/// The largest supported number of bands.
pub const MAX_BANDS: usize = 10;

/// The largest supported number of coefficients, [`MAX_BANDS`]².
pub const MAX_COEFFICIENTS: usize = MAX_BANDS * MAX_BANDS;

/// What can be wrong with a request for spherical harmonics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The order is outside 1..=10.
    #[error("spherical-harmonic order {found} is not supported; choose an order from 1 to 10")]
    Order {
        /// What was asked for.
        found: u8,
    },
}

/// A number of bands from 1 to 10; order 6 is 36 coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Order(u8);

impl Order {
    /// The order of this many bands.
    ///
    /// # Errors
    /// [`Error::Order`] outside 1..=10.
    pub const fn new(bands: u8) -> Result<Self, Error> {
        if bands >= 1 && bands as usize <= MAX_BANDS {
            Ok(Self(bands))
        } else {
            Err(Error::Order { found: bands })
        }
    }

    /// The number of bands n, as it is written in recipes and headers.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }

    /// The number of bands n.
    #[must_use]
    pub const fn bands(self) -> usize {
        self.0 as usize
    }

    /// The number of coefficients n².
    #[must_use]
    pub const fn coefficients(self) -> usize {
        self.bands() * self.bands()
    }
}

/// The flat index l(l+1)+m of band l and degree m.
///
/// # Panics
/// If |m| > l.
#[must_use]
pub const fn index(l: usize, m: isize) -> usize {
    assert!(m.unsigned_abs() <= l, "|m| must not exceed l");
    (l * (l + 1)).checked_add_signed(m).expect("m is at least -l")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Orders 1 to 10 are accepted, their neighbours refused by name.
    #[test]
    fn order_is_bounded() {
        for bands in 1..=10 {
            let order = Order::new(bands).unwrap();
            assert_eq!(order.coefficients(), usize::from(bands).pow(2));
        }
        for found in [0, 11, 255] {
            assert_eq!(Order::new(found), Err(Error::Order { found }));
        }
    }

    /// The flat index enumerates (l, m) without gaps in the order of the convention.
    #[test]
    fn index_is_contiguous() {
        let mut expected = 0;
        for l in 0..10_usize {
            for m in -(l as isize)..=l as isize {
                assert_eq!(index(l, m), expected);
                expected += 1;
            }
        }
    }
}
