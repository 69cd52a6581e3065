//! The `poselight` command.

fn main() {}
