//! The `poselight` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    poselight::cli::main()
}
