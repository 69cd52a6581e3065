//! What memory there is for jobs: what the machine has free, within the bounds of a container.

use std::fs;

use super::Limits;

/// Figures of the system, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Machine {
    /// All there is.
    total: u64,
    /// What can be had without swapping.
    free: u64,
}

/// The most that any job may take.
pub(super) fn most(limits: &Limits) -> u64 {
    let total = machine().map_or(u64::MAX, |machine| machine.total);
    total.min(limits.memory_bytes.unwrap_or(u64::MAX))
}

/// What a job may take now that others are expected to take `reserved`, of which some may not be
/// in use yet.
pub(super) fn free(limits: &Limits, reserved: u64) -> u64 {
    let free = machine().map_or(u64::MAX, |machine| machine.free);
    free.min(most(limits).saturating_sub(reserved))
}

/// Nothing where the system does not say it as Linux does: then nothing is held back.
fn machine() -> Option<Machine> {
    let whole = of_meminfo(&fs::read_to_string("/proc/meminfo").ok()?)?;
    let read = |name: &str| fs::read_to_string(format!("/sys/fs/cgroup/{name}")).ok();
    let group = of_group(read("memory.max"), read("memory.current"), read("memory.stat"));
    Some(match group {
        Some(group) => {
            Machine { total: whole.total.min(group.total), free: whole.free.min(group.free) }
        }
        None => whole,
    })
}

fn of_meminfo(text: &str) -> Option<Machine> {
    let kib = |name: &str| -> Option<u64> {
        let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
        line.trim().strip_suffix(" kB")?.parse().ok()
    };
    Some(Machine { total: kib("MemTotal")? * 1024, free: kib("MemAvailable")? * 1024 })
}

/// The bounds of a control group; pages of files that nobody looks at count as free.
fn of_group(most: Option<String>, used: Option<String>, stat: Option<String>) -> Option<Machine> {
    let total: u64 = most?.trim().parse().ok()?;
    let used: u64 = used?.trim().parse().ok()?;
    let stat = stat.unwrap_or_default();
    let reclaimable = stat.lines().find_map(|line| line.strip_prefix("inactive_file "));
    let reclaimable: u64 = reclaimable.and_then(|bytes| bytes.trim().parse().ok()).unwrap_or(0);
    Some(Machine { total, free: total.saturating_sub(used.saturating_sub(reclaimable)) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The kernel's own words are read; what is not there bounds nothing.
    #[test]
    fn the_kernel_is_understood() {
        let text = "MemTotal:        2048 kB\nMemFree: 1 kB\nMemAvailable:    1024 kB\n";
        let expected = Machine { total: 2048 << 10, free: 1024 << 10 };
        assert_eq!(of_meminfo(text), Some(expected));
        assert_eq!(of_meminfo("MemTotal: 5 kB"), None);
        let some = |text: &str| Some(text.to_owned());
        let group = of_group(some("1000\n"), some("700\n"), some("anon 1\ninactive_file 200\n"));
        assert_eq!(group, Some(Machine { total: 1000, free: 500 }));
        assert_eq!(of_group(some("max\n"), some("700\n"), None), None);
        assert_eq!(of_group(None, None, None), None);
    }

    /// What running jobs are expected to take is not given out twice.
    #[test]
    fn reserved_memory_is_not_free() {
        let limits = Limits { memory_bytes: Some(1000), ..Limits::default() };
        assert_eq!(most(&limits), 1000);
        assert_eq!(free(&limits, 400), 600);
        assert_eq!(free(&limits, 2000), 0);
    }
}
