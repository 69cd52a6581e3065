//! What a person sees while a job runs: bars on a terminal, nothing where stderr is piped.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::units;
use crate::pipeline::{Progress, Stage};

/// One bar per stage, the finished ones left standing.
#[derive(Debug, Default)]
pub(super) struct Screen {
    bar: Mutex<Option<Shown>>,
}

/// The bar of the stage at work.
#[derive(Debug)]
struct Shown {
    stage: Stage,
    /// Work that was there when the stage began, and says nothing of its speed.
    there: u64,
    bar: ProgressBar,
}

impl Screen {
    /// Shows progress.
    pub(super) fn show(&self, progress: Progress) {
        if !std::io::stderr().is_terminal() {
            return;
        }
        let Ok(mut slot) = self.bar.lock() else { return };
        if slot.as_ref().is_none_or(|shown| shown.stage != progress.stage) {
            if let Some(old) = slot.take() {
                old.bar.finish();
            }
            *slot =
                Some(Shown { stage: progress.stage, there: progress.done, bar: new_bar(progress) });
        }
        if let Some(Shown { there, bar, .. }) = slot.as_ref() {
            bar.set_position(progress.done);
            bar.set_message(message(progress, *there));
            if progress.done >= progress.total {
                bar.finish();
            }
        }
    }

    /// Leaves the last bar as it stands, so that a message can follow it.
    pub(super) fn release(&self) {
        if let Ok(mut slot) = self.bar.lock()
            && let Some(shown) = slot.take()
        {
            shown.bar.abandon();
        }
    }
}

fn new_bar(progress: Progress) -> ProgressBar {
    let style = ProgressStyle::with_template("{prefix:>10} {bar:32} {pos}/{len} {msg} ")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(progress.total).with_style(style);
    bar.set_prefix(progress.stage.name());
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

/// Rays per second, and the time that is left: neither before it is known.
fn message(progress: Progress, there: u64) -> String {
    let Progress { done, total, rays, elapsed_s, .. } = progress;
    let mut parts = Vec::new();
    if rays > 0 && elapsed_s > 0.0 {
        parts.push(format!("{:.1} Mray/s", rays as f64 / elapsed_s / 1e6));
    }
    let now = done.saturating_sub(there);
    if now > 0 && done < total {
        let left_s = elapsed_s * (total - done) as f64 / now as f64;
        parts.push(format!("{} left", units::seconds(left_s)));
    }
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nothing is said of the time that is left before anything was done by this run, whatever was
    /// there already; then it is what the rest takes at the rate so far.
    #[test]
    fn time_left_waits_for_a_rate() {
        let at = |done, rays, elapsed_s| {
            let progress = Progress { stage: Stage::Bake, done, total: 100, rays, elapsed_s };
            message(progress, 40)
        };
        assert_eq!(at(40, 0, 3.0), "");
        assert_eq!(at(50, 20_000_000, 2.0), "10.0 Mray/s, 10.0 s left");
        assert_eq!(at(100, 120_000_000, 12.0), "10.0 Mray/s");
    }
}
