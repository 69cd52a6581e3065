//! The minimiser of the numbers, under the name that this stage knows it by.

pub(super) use crate::num::lbfgs::minimise;
