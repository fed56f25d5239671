//! Waiting for a state: a test checks it repeatedly until it is reached. If it never is, the failure names it.

#![allow(dead_code, reason = "each test program uses a part of it")]

use std::time::{Duration, Instant};

/// Even a machine that is busy with other things gets there within this time.
const DEADLINE: Duration = Duration::from_secs(60);
/// Pause between two checks.
const PAUSE: Duration = Duration::from_millis(5);

/// Check until there is a result, for a minute at most.
pub(crate) fn eventually<T>(what: &str, look: impl FnMut() -> Option<T>) -> T {
    eventually_every(PAUSE, what, look)
}

/// The same for a state that lasts only a moment: with another pause between two checks.
pub(crate) fn eventually_every<T>(pause: Duration, what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(began.elapsed() < DEADLINE, "{what}: not within {} s", DEADLINE.as_secs());
        std::thread::sleep(pause);
    }
}

/// As [`eventually`], for checks that wait for an answer.
pub(crate) async fn eventually_async<T>(what: &str, mut look: impl AsyncFnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(found) = look().await {
            return found;
        }
        assert!(began.elapsed() < DEADLINE, "{what}: not within {} s", DEADLINE.as_secs());
        tokio::time::sleep(PAUSE).await;
    }
}
