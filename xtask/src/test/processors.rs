//! How busy the machine's processors were during a stage, with everything else that ran on it (Linux only). A stage that leaves them idle waits for something.

use std::fs;

/// Ticks of all processors since the machine was started.
#[derive(Clone, Copy)]
pub(super) struct Ticks {
    busy: u64,
    all: u64,
}

impl Ticks {
    /// `None` if the system does not tell.
    pub(super) fn now() -> Option<Self> {
        Self::of(&fs::read_to_string("/proc/stat").ok()?)
    }

    /// From the first line of `/proc/stat` (proc_stat(5)): user, nice, system, idle, iowait, irq, softirq, steal; the rest is contained in user and nice.
    fn of(stat: &str) -> Option<Self> {
        let numbers = stat.lines().next()?.strip_prefix("cpu ")?.split_whitespace().take(8);
        let ticks: Vec<u64> = numbers.map(str::parse).collect::<Result<_, _>>().ok()?;
        let all: u64 = ticks.iter().sum();
        let idle = ticks.get(3)? + ticks.get(4)?;
        Some(Self { busy: all - idle, all })
    }

    /// Percent of the time since `earlier` in which the processors were busy.
    pub(super) fn percent_busy_since(self, earlier: Self) -> Option<u64> {
        let all = self.all.checked_sub(earlier.all).filter(|&all| all > 0)?;
        Some(self.busy.saturating_sub(earlier.busy) * 100 / all)
    }
}

#[cfg(test)]
mod tests {
    use super::Ticks;

    #[test]
    fn waiting_for_disks_counts_as_idle() {
        let earlier = Ticks::of("cpu  100 0 50 800 50 0 0 0 0 0\ncpu0 1 2 3\n").unwrap();
        let later = Ticks::of("cpu  160 10 55 815 60 0 0 0 7 0\n").unwrap();
        assert_eq!(later.percent_busy_since(earlier), Some(75));
        assert_eq!(earlier.percent_busy_since(earlier), None);
        assert!(Ticks::of("intr 1 2 3\n").is_none());
    }
}
