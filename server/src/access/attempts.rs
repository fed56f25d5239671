//! Rate limits on guessing: after some failures further attempts must wait, twice as long each time.
//!
//! Counted by address and by name, so that neither one address trying many names nor many addresses trying one name gets far. Memory is
//! bounded: the longest idle is forgotten first. Times are seconds since any beginning, handed in.

use std::collections::HashMap;

/// Failures that cost nothing.
const FREE: u32 = 5;
/// Longest wait of an address, seconds.
const LONGEST: u64 = 900;
/// Longest wait of a name: whoever guesses at it must not keep its owner out for long.
const LONGEST_OF_NAME: u64 = 30;
/// After so long without a failure all is forgiven, seconds.
const FORGIVEN: u64 = 3600;
/// How many are remembered at most.
const REMEMBERED: usize = 16_384;

/// What is remembered of an address or a name.
#[derive(Debug, Clone, Copy)]
struct Failures {
    count: u32,
    last: u64,
}

/// Failures by whatever they are counted by.
#[derive(Debug)]
pub struct Attempts {
    failures: HashMap<String, Failures>,
    longest: u64,
}

impl Attempts {
    /// By address.
    pub fn of_addresses() -> Self {
        Self { failures: HashMap::new(), longest: LONGEST }
    }

    /// By name.
    pub fn of_names() -> Self {
        Self { failures: HashMap::new(), longest: LONGEST_OF_NAME }
    }

    /// Begin an attempt at `now`: it counts as failed until [`Attempts::succeeded`] or [`Attempts::forgiven`] is called, so that many at once are
    /// not all free.
    ///
    /// # Errors
    /// Seconds to wait.
    pub fn begin(&mut self, who: &str, now: u64) -> Result<(), u64> {
        match self.wait(who, now) {
            0 => {
                self.failed(who, now);
                Ok(())
            }
            wait => Err(wait),
        }
    }

    /// The last attempt of `who` was none.
    pub fn forgiven(&mut self, who: &str) {
        if let Some(f) = self.failures.get_mut(who) {
            f.count = f.count.saturating_sub(1);
        }
    }

    /// Seconds that `who` has to wait at `now`; 0 where it may try.
    pub fn wait(&self, who: &str, now: u64) -> u64 {
        let Some(f) = self.failures.get(who) else { return 0 };
        let over = f.count.saturating_sub(FREE);
        if over == 0 || now.saturating_sub(f.last) >= FORGIVEN {
            return 0;
        }
        let wait = 1u64.checked_shl(over.min(20)).unwrap_or(self.longest).min(self.longest);
        // A clock that was set back must not lock anybody out for long.
        f.last.min(now).saturating_add(wait).saturating_sub(now)
    }

    /// `who` failed at `now`.
    pub fn failed(&mut self, who: &str, now: u64) {
        if self.failures.len() >= REMEMBERED && !self.failures.contains_key(who) {
            self.forget(now);
        }
        let f = self.failures.entry(who.to_owned()).or_insert(Failures { count: 0, last: now });
        if now.saturating_sub(f.last) >= FORGIVEN {
            f.count = 0;
        }
        *f = Failures { count: f.count.saturating_add(1), last: now };
    }

    /// `who` succeeded.
    pub fn succeeded(&mut self, who: &str) {
        self.failures.remove(who);
    }

    /// Forget what is forgiven, or else the half that failed longest ago.
    fn forget(&mut self, now: u64) {
        self.failures.retain(|_, f| now.saturating_sub(f.last) < FORGIVEN);
        if self.failures.len() >= REMEMBERED {
            let mut times: Vec<u64> = self.failures.values().map(|f| f.last).collect();
            times.sort_unstable();
            let middle = times.get(times.len() / 2).copied().unwrap_or(now);
            self.failures.retain(|_, f| f.last > middle);
            if self.failures.len() >= REMEMBERED {
                self.failures.clear();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_few_free_failures_each_doubles_the_wait() {
        let mut a = Attempts::of_addresses();
        let mut now = 1000;
        for _ in 0..FREE {
            a.failed("x", now);
            assert_eq!(a.wait("x", now), 0);
        }
        let mut waits = Vec::new();
        for _ in 0..12 {
            a.failed("x", now);
            waits.push(a.wait("x", now));
            now += a.wait("x", now);
            assert_eq!(a.wait("x", now), 0, "after the wait there is a try");
        }
        assert_eq!(waits[..5], [2, 4, 8, 16, 32]);
        assert!(waits.windows(2).all(|w| w[0] <= w[1]) && waits.last() == Some(&LONGEST));
        assert_eq!(a.wait("y", now), 0, "others do not wait");
        a.succeeded("x");
        assert_eq!(a.wait("x", now), 0);
        let mut names = Attempts::of_names();
        (0..40).for_each(|_| names.failed("x", now));
        assert_eq!(names.wait("x", now), LONGEST_OF_NAME, "a name is not kept from its owner for long");
    }

    #[test]
    fn failures_expire_after_an_hour_and_a_clock_set_back_locks_nobody_out() {
        let mut a = Attempts::of_addresses();
        (0..20).for_each(|_| a.failed("x", 10_000));
        assert!(a.wait("x", 10_001) > 0 && a.wait("x", 10_000 + FORGIVEN) == 0);
        assert!(a.wait("x", 5) <= LONGEST);
        a.failed("x", 10_000 + FORGIVEN);
        assert_eq!(a.wait("x", 10_000 + FORGIVEN), 0, "counted from the beginning again");
    }

    #[test]
    fn concurrent_attempts_are_counted() {
        let mut a = Attempts::of_addresses();
        let begun = (0..100).filter(|_| a.begin("x", 1000).is_ok()).count();
        assert_eq!(begun, FREE as usize + 1);
        a.forgiven("x");
        assert!(a.begin("x", 1000).is_ok(), "what was right takes no place");
    }

    #[test]
    fn the_memory_of_attempts_is_bounded_and_keeps_the_latest() {
        let mut a = Attempts::of_addresses();
        for i in 0..100_000u64 {
            for _ in 0..7 {
                a.failed(&format!("address {i}"), 10_000 + i / 100);
            }
        }
        assert!(a.failures.len() <= REMEMBERED);
        assert!(a.wait("address 99999", 10_000 + 999) > 0);
        for i in 0..100_000u64 {
            a.failed(&format!("all at once {i}"), 20_000);
        }
        assert!(a.failures.len() <= REMEMBERED);
    }
}
