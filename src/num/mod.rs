//! Rank 0. Numbers: random streams, direction sets, statistics, linear algebra, CPU kernels.

pub mod random;
