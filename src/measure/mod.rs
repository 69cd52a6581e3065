//! Rank 11. Error metrics, costs and reports, independent of the fitter.
