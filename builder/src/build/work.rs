//! What every stage of a build works with: its scratch folder, its share of memory and threads, the wish to stop, and
//! the list of jobs that threads take from while memory lasts.

use crate::build::options::BuildError;
use crate::build::progress::Progress;
use crate::scratch::Scratch;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// The wish to stop, set from a signal handler or another thread and looked at between pieces of work.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Ask the build to stop.
    pub fn ask(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was asked to.
    pub fn asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// # Errors
    /// [`BuildError::Stopped`] once asked.
    pub fn check(&self) -> Result<(), BuildError> {
        if self.asked() { Err(BuildError::Stopped) } else { Ok(()) }
    }
}

/// What a stage works with.
#[derive(Clone, Copy)]
pub struct Work<'a> {
    /// Where its files are.
    pub scratch: &'a Scratch,
    /// Bytes of memory that the build may hold. Never changes the result.
    pub memory: u64,
    /// Threads, at least 1. Never changes the result.
    pub threads: usize,
    /// Asked now and then.
    pub stop: &'a Stop,
    /// Called now and then.
    pub progress: &'a dyn Progress,
}

/// Jobs not yet taken and memory in use.
struct Queue {
    next: usize,
    in_use: u64,
    failed: bool,
}

/// Gives memory back when a job ends, however it ends.
struct Share<'a> {
    queue: &'a Mutex<Queue>,
    freed: &'a Condvar,
    cost: u64,
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        let mut queue = locked(self.queue);
        queue.in_use -= self.cost;
        queue.failed |= std::thread::panicking();
        self.freed.notify_all();
    }
}

fn locked(queue: &Mutex<Queue>) -> MutexGuard<'_, Queue> {
    queue.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Work<'_> {
    /// Run jobs `0..count` on the build's threads, in order of their numbers, such that those in progress together cost at
    /// most `memory` bytes; one that costs more runs alone. Returns what they gave, in order of their numbers.
    ///
    /// Threads of its own, not rayon's: a job that waits for memory must not be taken up inside another that holds some.
    ///
    /// # Errors
    /// Of the failed job with the smallest number; no job is begun after one has failed or a stop was asked for.
    pub fn run_jobs<T: Send>(
        &self,
        count: usize,
        memory: u64,
        cost: impl Fn(usize) -> u64 + Sync,
        job: impl Fn(usize) -> Result<T, BuildError> + Sync,
    ) -> Result<Vec<T>, BuildError> {
        let queue = Mutex::new(Queue { next: 0, in_use: 0, failed: false });
        let freed = Condvar::new();
        let results: Mutex<Vec<(usize, Result<T, BuildError>)>> = Mutex::new(Vec::with_capacity(count));
        let take = || {
            let mut q = locked(&queue);
            loop {
                if q.failed || q.next >= count {
                    return None;
                }
                let cost = cost(q.next).min(memory);
                if q.in_use == 0 || q.in_use + cost <= memory {
                    let number = q.next;
                    q.next += 1;
                    q.in_use += cost;
                    return Some((number, Share { queue: &queue, freed: &freed, cost }));
                }
                q = freed.wait(q).unwrap_or_else(PoisonError::into_inner);
            }
        };
        let worker = || {
            while let Some((number, share)) = take() {
                let result = self.stop.check().and_then(|()| job(number));
                if result.is_err() {
                    locked(&queue).failed = true;
                }
                results.lock().unwrap_or_else(PoisonError::into_inner).push((number, result));
                drop(share);
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..self.threads.min(count) {
                scope.spawn(worker);
            }
            worker();
        });
        let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
        results.sort_unstable_by_key(|(number, _)| *number);
        results.into_iter().map(|(_, result)| result).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::progress::Silent;
    use std::sync::atomic::AtomicU64;

    fn with_work<T>(threads: usize, f: impl FnOnce(Work<'_>, &Stop) -> T) -> T {
        let (scratch, stop) = (Scratch::temporary().unwrap(), Stop::default());
        f(Work { scratch: &scratch, memory: 0, threads, stop: &stop, progress: &Silent }, &stop)
    }

    #[test]
    fn parallel_jobs_never_exceed_the_memory_and_finish_in_order() {
        for threads in [1, 3, 8] {
            let (now, max) = (AtomicU64::new(0), AtomicU64::new(0));
            let cost = |i: usize| [10, 45, 20, 500][i % 4];
            let done = with_work(threads, |work, _| {
                work.run_jobs(200, 100, cost, |i| {
                    let sum = now.fetch_add(cost(i).min(100), Ordering::SeqCst) + cost(i).min(100);
                    max.fetch_max(sum, Ordering::SeqCst);
                    std::thread::yield_now();
                    now.fetch_sub(cost(i).min(100), Ordering::SeqCst);
                    Ok(i * 2)
                })
            });
            assert_eq!(done.unwrap(), (0..200).map(|i| i * 2).collect::<Vec<_>>());
            assert!(max.into_inner() <= 100);
        }
    }

    #[test]
    fn no_job_starts_after_a_stop() {
        let begun = AtomicU64::new(0);
        let result = with_work(2, |work, stop| {
            work.run_jobs(
                1000,
                10,
                |_| 1,
                |i| {
                    begun.fetch_add(1, Ordering::Relaxed);
                    if i == 10 {
                        stop.ask();
                    }
                    Ok(())
                },
            )
        });
        assert!(matches!(result, Err(BuildError::Stopped)));
        assert!(begun.into_inner() < 20);
    }
}
