//! Rank 16. The command line: arguments to recipe, progress, output.
