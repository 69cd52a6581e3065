//! The arguments of `serve` and `token`. Every setting is a flag and an environment variable.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

#[derive(Debug, Args)]
pub(crate) struct ServeArgs {
    /// The folder that everything is kept in; made where there is none.
    #[arg(long, value_name = "DIR", env = "POSELIGHT_DATA", default_value = "poselight-data")]
    pub(crate) data: PathBuf,
    /// Where to listen. Other machines are let in once there is a token (`poselight token create`).
    #[arg(
        long,
        value_name = "ADDRESS",
        env = "POSELIGHT_LISTEN",
        default_value = "127.0.0.1:7878"
    )]
    pub(crate) listen: SocketAddr,
    /// Jobs that run at once; each uses all compute threads.
    #[arg(long, value_name = "N", env = "POSELIGHT_JOBS", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(crate) jobs: u32,
    /// Jobs that may wait.
    #[arg(long, value_name = "N", env = "POSELIGHT_MAX_QUEUED", default_value_t = 1000)]
    pub(crate) max_queued: u32,
    /// Size of one asset at most [default: 512].
    #[arg(long, value_name = "MIB", env = "POSELIGHT_MAX_ASSET_MIB")]
    pub(crate) max_asset_mib: Option<u32>,
    /// Size of all assets at most [default: 64].
    #[arg(long, value_name = "GIB", env = "POSELIGHT_MAX_ASSETS_GIB")]
    pub(crate) max_assets_gib: Option<u32>,
    /// Models kept ready to be evaluated.
    #[arg(long, value_name = "MIB", env = "POSELIGHT_CACHE_MIB", default_value_t = 1024)]
    pub(crate) cache_mib: u32,
    /// Connections at once.
    #[arg(long, value_name = "N", env = "POSELIGHT_MAX_CONNECTIONS", default_value_t = 16_384, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) max_connections: u32,
    /// Time for a request that is no upload, download or stream.
    #[arg(long, value_name = "SECONDS", env = "POSELIGHT_REQUEST_TIMEOUT", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) request_timeout: u32,
    /// Time for the head of a request.
    #[arg(long, value_name = "SECONDS", env = "POSELIGHT_HEAD_TIMEOUT", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) head_timeout: u32,
}

#[derive(Debug, Args)]
pub(crate) struct TokenArgs {
    /// The service's folder.
    #[arg(
        long,
        value_name = "DIR",
        env = "POSELIGHT_DATA",
        default_value = "poselight-data",
        global = true
    )]
    pub(crate) data: PathBuf,
    #[command(subcommand)]
    pub(crate) command: TokenCommand,
}

#[derive(Debug, Subcommand)]
pub(crate) enum TokenCommand {
    /// Make a token and print it, once; the service keeps only its hash. A running service that had
    /// no token asks for one from its next start on.
    Create {
        /// Who it is for; an earlier token of this name ends.
        name: String,
        /// What it allows (may be repeated).
        #[arg(long, value_enum, default_values_t = [Scope::Read, Scope::Write])]
        scope: Vec<Scope>,
        /// Days until it expires.
        #[arg(long, default_value_t = 90, value_parser = clap::value_parser!(u32).range(1..=3650))]
        days: u32,
    },
    /// Say which tokens there are.
    List,
    /// End a token.
    Revoke {
        /// Whose.
        name: String,
    },
}

/// What a token allows.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum Scope {
    /// Look, download, evaluate.
    Read,
    /// Upload, submit, cancel, delete.
    Write,
}

impl Scope {
    /// As it is kept.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
        }
    }
}

impl std::fmt::Display for Scope {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}
