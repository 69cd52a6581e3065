//! What a person sees while a job runs: bars on a terminal, nothing where stderr is piped.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::pipeline::{Progress, Stage};

/// One bar per stage, the finished ones left standing.
#[derive(Debug, Default)]
pub(super) struct Screen {
    bar: Mutex<Option<(Stage, ProgressBar)>>,
}

impl Screen {
    /// Shows progress.
    pub(super) fn show(&self, progress: Progress) {
        if !std::io::stderr().is_terminal() {
            return;
        }
        let Ok(mut slot) = self.bar.lock() else { return };
        if slot.as_ref().is_none_or(|(stage, _)| *stage != progress.stage) {
            if let Some((_, old)) = slot.take() {
                old.finish();
            }
            *slot = Some((progress.stage, new_bar(progress)));
        }
        if let Some((_, bar)) = slot.as_ref() {
            bar.set_position(progress.done);
            bar.set_message(rate(progress));
            if progress.done >= progress.total {
                bar.finish();
            }
        }
    }

    /// Leaves the last bar as it stands, so that a message can follow it.
    pub(super) fn release(&self) {
        if let Ok(mut slot) = self.bar.lock()
            && let Some((_, bar)) = slot.take()
        {
            bar.abandon();
        }
    }
}

fn new_bar(progress: Progress) -> ProgressBar {
    let style = ProgressStyle::with_template("{prefix:>10} {bar:32} {pos}/{len} {msg} {eta} left ")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(progress.total).with_style(style);
    bar.set_prefix(progress.stage.name());
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

fn rate(progress: Progress) -> String {
    if progress.rays == 0 || progress.elapsed_s <= 0.0 {
        return String::new();
    }
    format!("{:.1} Mray/s", progress.rays as f64 / progress.elapsed_s / 1e6)
}
