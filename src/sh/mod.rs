//! Rank 1. Real spherical harmonics: basis, index, rotation, zonal functions.
