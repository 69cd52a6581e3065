//! The arguments of `serve` and `token`. Every setting is a flag and an environment variable.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

#[derive(Debug, Args)]
#[command(args_override_self = true)]
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
    /// A JSON object of settings by the names of these flags; flags and environment win over it.
    #[arg(long, value_name = "FILE", env = "POSELIGHT_CONFIG")]
    pub(crate) config: Option<PathBuf>,
    /// Only say whether the service would start with these settings.
    #[arg(long)]
    pub(crate) check: bool,
    /// Requests a second of each token [default: no limit].
    #[arg(long, value_name = "N", env = "POSELIGHT_RATE", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) rate: Option<u32>,
    /// Forget jobs, their data sets and unused assets after so many days; models stay [default:
    /// never].
    #[arg(long, value_name = "DAYS", env = "POSELIGHT_KEEP_DAYS", value_parser = clap::value_parser!(u32).range(1..=36500))]
    pub(crate) keep_days: Option<u32>,
    /// Forget the oldest jobs with their data sets where those are larger together [default: never].
    #[arg(long, value_name = "GIB", env = "POSELIGHT_KEEP_GIB", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) keep_gib: Option<u32>,
    /// Let pages of this origin ask, such as https://tools.example (may be repeated, or separated by
    /// commas).
    #[arg(long, value_name = "ORIGIN", env = "POSELIGHT_ALLOW_ORIGIN", value_delimiter = ',')]
    pub(crate) allow_origin: Vec<String>,
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
    /// Time that an upload may pause, and that a client may take nothing of what it is sent.
    #[arg(long, value_name = "SECONDS", env = "POSELIGHT_IDLE_TIMEOUT", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) idle_timeout: u32,
    /// File with the secret, `whsec_` and base64, that messages to webhooks are signed with; without
    /// it jobs cannot name one.
    #[arg(long, value_name = "FILE", env = "POSELIGHT_WEBHOOK_SECRET_FILE")]
    pub(crate) webhook_secret: Option<PathBuf>,
    /// Certificates in PEM of authorities that may vouch for webhooks by https, beside the public
    /// ones.
    #[arg(long, value_name = "FILE", env = "POSELIGHT_WEBHOOK_CA_FILE")]
    pub(crate) webhook_ca: Option<PathBuf>,
    /// Let webhooks be at private addresses too.
    #[arg(long, env = "POSELIGHT_WEBHOOK_PRIVATE")]
    pub(crate) webhook_private: bool,
    /// Memory that jobs may take together; one that needs more is refused, one that needs more than
    /// is free waits [default: what the machine has].
    #[arg(long, value_name = "MIB", env = "POSELIGHT_MEMORY_MIB")]
    pub(crate) memory_mib: Option<u32>,
    /// A running job that told nothing for so long is called stalled.
    #[arg(long, value_name = "SECONDS", env = "POSELIGHT_STALLED", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) stalled: u32,
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
        /// Who it is for.
        name: String,
        /// End an earlier token of this name, whose users then need the new one.
        #[arg(long)]
        replace: bool,
        /// What it allows (may be repeated).
        #[arg(long, value_enum, default_values_t = [Scope::Read, Scope::Write])]
        scope: Vec<Scope>,
        /// Days until it expires.
        #[arg(long, default_value_t = 90, value_parser = clap::value_parser!(u32).range(1..=3650))]
        days: u32,
    },
    /// Say which tokens there are, what they allow, and how long.
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
