//! Threads that compute give way to those that answer.

/// How little a computing thread weighs: Linux gives it the processor where nobody else wants it.
#[cfg(target_os = "linux")]
const NICE: i32 = 19;

/// Lowers the threads that bake and fit.
pub(super) fn lower_compute_threads() {
    rayon::broadcast(|_| lower_this_thread());
}

/// Lowers the calling thread, for good. On Linux a priority belongs to a thread, elsewhere to the
/// process: there nothing is changed.
pub(super) fn lower_this_thread() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::setpriority_process(Some(rustix::thread::gettid()), NICE) {
        tracing::debug!(%error, "a thread keeps its priority");
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    fn nice() -> i32 {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").expect("a thread");
        let fields = stat.rsplit(')').next().expect("fields after the name");
        fields.split_whitespace().nth(16).and_then(|nice| nice.parse().ok()).expect("a number")
    }

    /// Only the thread that asks is lowered.
    #[test]
    fn one_thread_gives_way() {
        let before = nice();
        let lowered = std::thread::spawn(|| {
            lower_this_thread();
            nice()
        });
        assert_eq!(lowered.join().expect("ended"), NICE);
        assert_eq!(nice(), before);
    }
}
