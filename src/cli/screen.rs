//! What a person sees while a job runs: bars on a terminal; a line now and then where stderr is
//! piped, so that the log of a long job shows where it is.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::units;
use crate::pipeline::{Progress, Stage};

/// Between two lines where there is no terminal: a short job says nothing.
const BETWEEN_LINES: Duration = Duration::from_secs(15);

/// One bar per stage, the finished ones left standing.
#[derive(Debug, Default)]
pub(super) struct Screen {
    bar: Mutex<Option<Shown>>,
    lines: Mutex<Option<Told>>,
}

/// What the last line was about.
#[derive(Debug)]
struct Told {
    stage: Stage,
    there: u64,
    at: Instant,
}

impl Told {
    /// The line that is due `now`, if one is.
    fn line(slot: &mut Option<Self>, progress: Progress, now: Instant) -> Option<String> {
        let Progress { stage, done, total, .. } = progress;
        let told = slot.get_or_insert(Self { stage, there: done, at: now });
        if told.stage != stage {
            (told.stage, told.there) = (stage, done);
        }
        if now.duration_since(told.at) < BETWEEN_LINES {
            return None;
        }
        told.at = now;
        let message = message(progress, told.there);
        let colon = if message.is_empty() { "" } else { ": " };
        Some(format!("{} {done}/{total}{colon}{message}", stage.name()))
    }
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
            let Ok(mut slot) = self.lines.lock() else { return };
            if let Some(line) = Told::line(&mut slot, progress, Instant::now()) {
                let _ = writeln!(std::io::stderr(), "{line}");
            }
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
    /// Without a terminal a short job is silent, a long one tells where it is every quarter of a
    /// minute, and a new stage neither waits for less nor inherits the rate of the one before.
    #[test]
    fn a_log_gets_a_line_now_and_then() {
        let start = Instant::now();
        let mut slot = None;
        let mut at = |stage, done, rays, seconds: u64| {
            let elapsed_s = seconds as f64;
            let progress = Progress { stage, done, total: 100, rays, elapsed_s };
            Told::line(&mut slot, progress, start + Duration::from_secs(seconds))
        };
        assert_eq!(at(Stage::Bake, 40, 0, 0), None);
        assert_eq!(at(Stage::Bake, 45, 100_000_000, 14), None);
        let line = at(Stage::Bake, 50, 200_000_000, 20);
        assert_eq!(line.as_deref(), Some("bake 50/100: 10.0 Mray/s, 100.0 s left"));
        assert_eq!(at(Stage::Bake, 60, 400_000_000, 34), None);
        assert_eq!(at(Stage::Fit, 0, 0, 40).as_deref(), Some("fit 0/100"));
    }
}
