//! Rank 9. The training set on disk.
