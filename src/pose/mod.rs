//! Rank 6. Clips sampled to poses.
