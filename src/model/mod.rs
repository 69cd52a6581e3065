//! Rank 3. The fitted model: encoder, linear decoder, evaluation, light folding, blob.
