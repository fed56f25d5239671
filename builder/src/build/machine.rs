//! Resources of the machine and of this process: memory, processor time, disk space.
//!
//! Memory and times come from `/proc` and, where the process is in a control group with a limit, from that group. Where
//! the system has none of these, values are unknown, and the default budget is that of a small machine.

use std::path::Path;

/// Assumed where the system does not say: half of what a small machine has.
const UNKNOWN_MEMORY: u64 = 4 << 30;
/// The smallest budget that the default gives.
const MIN_MEMORY: u64 = 256 << 20;
/// Ticks a second of the times in `/proc`: fixed for all Linux programs.
const TICKS: f64 = 100.0;

/// Bytes of memory that this process may use: of the machine, or of the control group that limits it.
pub fn memory() -> Option<u64> {
    let info = std::fs::read_to_string("/proc/meminfo").ok()?;
    let machine = field_kib(&info, "MemTotal:")?;
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    Some(group_limit(&groups, Path::new("/sys/fs/cgroup")).map_or(machine, |limit| limit.min(machine)))
}

/// A quarter of the memory that this process may use.
pub fn default_budget() -> u64 {
    (memory().unwrap_or(UNKNOWN_MEMORY) / 4).max(MIN_MEMORY)
}

/// The most memory that this process has held so far, bytes.
pub fn peak_memory() -> Option<u64> {
    field_kib(&std::fs::read_to_string("/proc/self/status").ok()?, "VmHWM:")
}

/// Processor time that this process has used so far, all threads, seconds.
pub fn cpu_seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field is a name in brackets that may hold anything; utime and stime are the 14th and 15th.
    let mut fields = stat.get(stat.rfind(')')? + 1..)?.split_whitespace().skip(11);
    let (user, system): (f64, f64) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    Some((user + system) / TICKS)
}

/// Bytes free for this user on the disk that holds `folder`.
pub fn free_space(folder: &Path) -> Option<u64> {
    fs4::available_space(folder).ok()
}

/// Whether two folders are on one disk; assumed if the system does not report it.
pub fn same_disk(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        match (std::fs::metadata(a), std::fs::metadata(b)) {
            (Ok(a), Ok(b)) => a.dev() == b.dev(),
            _ => true,
        }
    }
    #[cfg(not(unix))]
    {
        let _ = (a, b);
        true
    }
}

/// The number after `name` in lines such as `MemTotal: 16384 kB`, in bytes.
fn field_kib(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|l| l.strip_prefix(name))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// The smallest limit of the control group of this process and those above it, version 2 and 1.
fn group_limit(groups: &str, mounted: &Path) -> Option<u64> {
    let mut min = None;
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (parts.next(), parts.next()) else { continue };
        let (root, file) = if controllers.is_empty() {
            (mounted.to_owned(), "memory.max")
        } else if controllers.split(',').any(|c| c == "memory") {
            (mounted.join("memory"), "memory.limit_in_bytes")
        } else {
            continue;
        };
        for above in Path::new(path.trim_start_matches('/')).ancestors() {
            let limit = std::fs::read_to_string(root.join(above).join(file)).ok();
            let limit = limit.and_then(|text| text.trim().parse::<u64>().ok());
            min = [min, limit].into_iter().flatten().min();
        }
    }
    min
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_limit_of_the_groups_counts() {
        let root = tempfile::tempdir().unwrap();
        let put = |path: &str, text: &str| {
            let path = root.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        assert_eq!(group_limit("0::/user/build\n", root.path()), None);
        put("user/build/memory.max", "max\n");
        assert_eq!(group_limit("0::/user/build\n", root.path()), None);
        put("user/memory.max", "1000\n");
        put("memory.max", "5000\n");
        assert_eq!(group_limit("0::/user/build\n", root.path()), Some(1000));
        put("memory/docker/a/memory.limit_in_bytes", "700\n");
        assert_eq!(group_limit("5:cpu,memory:/docker/a\n3:pids:/x\n", root.path()), Some(700));
    }

    #[test]
    fn memory_cpu_time_and_disk_space_of_this_machine_are_detected() {
        if !cfg!(target_os = "linux") {
            eprintln!("skipped: /proc is Linux's");
            return;
        }
        assert!(memory().unwrap() > 1 << 20);
        assert!(peak_memory().unwrap() > 1 << 16);
        assert!(cpu_seconds().unwrap() >= 0.0);
        assert!(free_space(&std::env::temp_dir()).is_some());
        assert!(same_disk(Path::new("/proc"), Path::new("/proc")));
    }
}
