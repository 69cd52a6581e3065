//! Rank 7. Ray queries: Embree behind safe types on plain slices.
