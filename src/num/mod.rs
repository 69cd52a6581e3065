//! Rank 0. Numbers: random streams, direction sets, statistics, linear algebra, minimisation, CPU
//! kernels.

pub mod cpu;
#[cfg(feature = "bake")]
pub mod directions;
pub mod kernels;
pub mod lbfgs;
#[cfg(feature = "bake")]
pub mod linalg;
pub mod panels;
pub mod random;
pub mod stats;
