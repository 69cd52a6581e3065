//! Figures of the running service, in the text form that Prometheus reads.

use std::fmt::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::hot::HotFigures;

/// Upper bounds of the latency histogram, microseconds.
const BOUNDS_US: [u64; 10] =
    [250, 500, 1000, 2500, 5000, 10_000, 50_000, 250_000, 1_000_000, 10_000_000];

/// Counters since the start.
#[derive(Debug, Default)]
pub(super) struct Metrics {
    rays: AtomicU64,
    /// By hundreds: 1xx to 5xx.
    answers: [AtomicU64; 5],
    /// Evaluations by latency; the last are beyond every bound.
    evaluations: [AtomicU64; BOUNDS_US.len() + 1],
    evaluation_us: AtomicU64,
    /// Connections that are open now.
    connections: Arc<AtomicU64>,
}

impl Metrics {
    /// Rays that a finished job cast.
    pub(super) fn rays(&self, count: u64) {
        self.rays.fetch_add(count, Ordering::Relaxed);
    }

    /// The count of open connections, which goes up and down.
    pub(super) fn connections(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.connections)
    }

    pub(super) fn answered(&self, status: u16) {
        let class = usize::from(status / 100).clamp(1, 5) - 1;
        self.answers[class].fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn evaluated(&self, took: Duration) {
        let us = u64::try_from(took.as_micros()).unwrap_or(u64::MAX);
        let bin = BOUNDS_US.iter().position(|&bound| us <= bound).unwrap_or(BOUNDS_US.len());
        self.evaluations[bin].fetch_add(1, Ordering::Relaxed);
        self.evaluation_us.fetch_add(us, Ordering::Relaxed);
    }

    /// Everything, with what store and cache say.
    pub(super) fn text<'a>(
        &self,
        jobs: impl Iterator<Item = (&'a str, i64)>,
        rays_per_s: f64,
        hot: HotFigures,
    ) -> String {
        let mut out = String::new();
        let head = |out: &mut String, name: &str, kind: &str, help: &str| {
            let _ = writeln!(out, "# HELP poselight_{name} {help}\n# TYPE poselight_{name} {kind}");
        };
        head(
            &mut out,
            "jobs",
            "gauge",
            "Jobs by state; those that are queued are the queue's depth.",
        );
        for (state, count) in jobs {
            let _ = writeln!(out, "poselight_jobs{{state=\"{state}\"}} {count}");
        }
        head(&mut out, "rays_per_second", "gauge", "Rays cast by jobs that run.");
        let _ = writeln!(out, "poselight_rays_per_second {rays_per_s}");
        head(&mut out, "rays_total", "counter", "Rays cast by jobs that ended.");
        let _ = writeln!(out, "poselight_rays_total {}", self.rays.load(Ordering::Relaxed));
        head(&mut out, "answers_total", "counter", "Answers by class of status.");
        for (class, count) in self.answers.iter().enumerate() {
            let (class, count) = (class + 1, count.load(Ordering::Relaxed));
            let _ = writeln!(out, "poselight_answers_total{{status=\"{class}xx\"}} {count}");
        }
        head(&mut out, "connections", "gauge", "Connections that are open.");
        let open = self.connections.load(Ordering::Relaxed);
        let _ = writeln!(out, "poselight_connections {open}");
        head(&mut out, "hot_models", "gauge", "Models ready to be evaluated.");
        let _ = writeln!(out, "poselight_hot_models {}", hot.models);
        head(&mut out, "hot_bytes", "gauge", "Bytes of those models' blobs.");
        let _ = writeln!(out, "poselight_hot_bytes {}", hot.bytes);
        head(&mut out, "hot_lookups_total", "counter", "Lookups of models by outcome.");
        let _ = writeln!(out, "poselight_hot_lookups_total{{outcome=\"hit\"}} {}", hot.hits);
        let _ = writeln!(out, "poselight_hot_lookups_total{{outcome=\"miss\"}} {}", hot.misses);
        head(&mut out, "evaluation_seconds", "histogram", "Time of an evaluation.");
        self.histogram(&mut out);
        out
    }

    fn histogram(&self, out: &mut String) {
        let name = "poselight_evaluation_seconds";
        let mut sum = 0;
        for (bin, count) in self.evaluations.iter().enumerate() {
            sum += count.load(Ordering::Relaxed);
            let bound =
                BOUNDS_US.get(bin).map_or("+Inf".to_owned(), |us| (*us as f64 / 1e6).to_string());
            let _ = writeln!(out, "{name}_bucket{{le=\"{bound}\"}} {sum}");
        }
        let seconds = self.evaluation_us.load(Ordering::Relaxed) as f64 / 1e6;
        let _ = writeln!(out, "{name}_sum {seconds}\n{name}_count {sum}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Buckets are cumulative, and every sample has its help and type before it.
    #[test]
    fn the_text_is_what_prometheus_reads() {
        let metrics = Metrics::default();
        metrics.evaluated(Duration::from_micros(300));
        metrics.evaluated(Duration::from_secs(100));
        metrics.answered(204);
        let hot = HotFigures { models: 1, bytes: 2, hits: 3, misses: 4 };
        let text = metrics.text([("queued", 7)].into_iter(), 1.5, hot);
        for line in [
            "poselight_jobs{state=\"queued\"} 7",
            "poselight_rays_per_second 1.5",
            "poselight_answers_total{status=\"2xx\"} 1",
            "poselight_evaluation_seconds_bucket{le=\"0.00025\"} 0",
            "poselight_evaluation_seconds_bucket{le=\"0.0005\"} 1",
            "poselight_evaluation_seconds_bucket{le=\"+Inf\"} 2",
            "poselight_evaluation_seconds_count 2",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} is not in\n{text}");
        }
    }
}
