//! Rank 8. Rays to signals at the points.
