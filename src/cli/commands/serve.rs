//! `poselight serve` and `poselight token`: the service and who may use it.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, ensure};
use serde_json::json;

use crate::cli::Answer;
use crate::cli::serve_args::{ServeArgs, TokenArgs, TokenCommand};
use crate::pipeline::files;
use crate::serve::{self, Authorities, Limits, Secret, Settings, Store, Webhooks};

pub(in crate::cli) fn serve(args: &ServeArgs, stop: &'static AtomicBool) -> anyhow::Result<Answer> {
    let defaults = Limits::default();
    let limits = Limits {
        asset_bytes: args.max_asset_mib.map_or(defaults.asset_bytes, |mib| u64::from(mib) << 20),
        assets_bytes: args.max_assets_gib.map_or(defaults.assets_bytes, |gib| u64::from(gib) << 30),
        queued_jobs: args.max_queued,
        running_jobs: args.jobs,
        request_s: args.request_timeout,
        head_s: args.head_timeout,
        idle_s: args.idle_timeout,
        connections: args.max_connections,
        hot_bytes: u64::from(args.cache_mib) << 20,
        memory_bytes: args.memory_mib.map(|mib| u64::from(mib) << 20),
        rate_hz: args.rate,
        keep_days: args.keep_days,
        keep_bytes: args.keep_gib.map(|gib| u64::from(gib) << 30),
        stalled_s: args.stalled,
        ..defaults
    };
    let secret = args.webhook_secret.as_deref().map(read_secret).transpose()?;
    let authorities = args.webhook_ca.as_deref().map(read_authorities).transpose()?;
    let authorities = authorities.unwrap_or_default();
    let webhooks = Webhooks { secret, private: args.webhook_private, authorities };
    let settings = Settings {
        folder: args.data.clone(),
        address: args.listen,
        limits,
        webhooks,
        origins: args.allow_origin.clone(),
    };
    if args.check {
        serve::check(&settings)?;
        let json =
            json!({ "address": args.listen.to_string(), "folder": args.data, "sound": true });
        return Ok(Answer::new("the service would start".to_owned(), json));
    }
    let mut bound = None;
    serve::serve(settings, stop, |address| {
        tracing::info!(%address, folder = %args.data.display(), "listening");
        bound = Some(address);
    })?;
    let address = bound.map(|address| address.to_string());
    Ok(Answer::new("stopped".to_owned(), json!({ "address": address, "stopped": true })))
}

/// Bytes of a file with a secret.
const MOST_SECRET_BYTES: u64 = 1024;

fn read_secret(path: &Path) -> anyhow::Result<Secret> {
    let bytes = files::read(path, MOST_SECRET_BYTES)?;
    let text = String::from_utf8_lossy(&bytes);
    Secret::read(&text).with_context(|| format!("the file {}", path.display()))
}

/// Bytes of a file with certificates; the public authorities together have 200 kB.
const MOST_AUTHORITIES_BYTES: u64 = 4 << 20;

fn read_authorities(path: &Path) -> anyhow::Result<Authorities> {
    let bytes = files::read(path, MOST_AUTHORITIES_BYTES)?;
    Authorities::read(&bytes).with_context(|| format!("the file {}", path.display()))
}

pub(in crate::cli) fn token(args: &TokenArgs) -> anyhow::Result<Answer> {
    let store = match &args.command {
        TokenCommand::Create { .. } => Store::visit(&args.data)?,
        TokenCommand::List | TokenCommand::Revoke { .. } => Store::visit_known(&args.data)?,
    };
    match &args.command {
        TokenCommand::Create { name, scope, days, replace } => {
            ensure!(
                !name.is_empty() && name.len() <= 100 && !name.contains(char::is_control),
                "a name has 1 to 100 characters"
            );
            let mut scopes: Vec<&str> = scope.iter().map(|scope| scope.name()).collect();
            scopes.sort_unstable();
            scopes.dedup();
            let made = store.create_token(name, &scopes.join(" "), *days, *replace)?;
            let json = json!({ "name": name, "token": made.secret, "scopes": scopes, "expires_ms": made.expires_ms });
            Ok(Answer::new(made.secret, json))
        }
        TokenCommand::List => {
            let tokens = store.tokens()?;
            let line = |token: &serve::Token| {
                format!("{}: {}, {}", token.name, token.scopes, expiry(token.left_ms()))
            };
            let text: Vec<String> = tokens.iter().map(line).collect();
            let shown: Vec<_> = tokens
                .iter()
                .map(|t| json!({ "name": t.name, "scopes": t.scopes, "expires_ms": t.expires_ms, "expired": t.left_ms() <= 0 }))
                .collect();
            Ok(Answer::new(text.join("\n"), json!({ "tokens": shown })))
        }
        TokenCommand::Revoke { name } => {
            let found = store.revoke_token(name)?;
            found.then_some(()).with_context(|| format!("there is no token `{name}`"))?;
            Ok(Answer::new(format!("{name} is revoked"), json!({ "revoked": name })))
        }
    }
}

/// How long a token is good for, in days.
fn expiry(left_ms: i64) -> String {
    const DAY_MS: i64 = 86_400_000;
    match (left_ms > 0, left_ms.abs() / DAY_MS) {
        (true, 0) => "expires within a day".to_owned(),
        (true, 1) => "expires in 1 day".to_owned(),
        (true, days) => format!("expires in {days} days"),
        (false, 0) => "expired less than a day ago".to_owned(),
        (false, 1) => "expired 1 day ago".to_owned(),
        (false, days) => format!("expired {days} days ago"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whole days, before and after; at the very moment it has expired.
    #[test]
    fn expiry_is_told_in_days() {
        let hours = |hours: i64| expiry(hours * 3_600_000);
        assert_eq!(hours(90 * 24), "expires in 90 days");
        assert_eq!(hours(47), "expires in 1 day");
        assert_eq!(
            (hours(1).as_str(), hours(0).as_str()),
            ("expires within a day", "expired less than a day ago")
        );
        assert_eq!(
            (hours(-25), hours(-72)),
            ("expired 1 day ago".into(), "expired 3 days ago".into())
        );
    }
}
