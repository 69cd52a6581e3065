//! Rank 10. Model families fitted to a training set.
