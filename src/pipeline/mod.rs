//! Rank 14. Recipe, plan, run and resume: the only code that joins stages.
