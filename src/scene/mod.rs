//! Rank 5. Import of glTF and OBJ, with validation and limits.
