//! Rank 0. Numbers: random streams, direction sets, statistics, linear algebra, CPU kernels.

pub mod cpu;
pub mod kernels;
pub mod panels;
pub mod random;
pub mod stats;
